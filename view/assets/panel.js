// State, figures, processes and events in words and numbers.

import { significant } from "./charts.js";

const MOOD = ["good", "warning", "warning", "warning", "bad", "bad"];
const SILENT_MS = 2500;

const element = (id) => document.getElementById(id);

function show(id, text) {
  const place = element(id);
  if (place.textContent !== text) place.textContent = text;
}

export class Panel {
  constructor(scene, store, seek) {
    Object.assign(this, { scene, store, seek });
    this.figures = new Map();
    show("title", scene.title);
    show("subject", `${scene.controller} · ${scene.trajectory}`);
    document.title = `${scene.title} · oqtal`;
    show("events-zero", scene.is_live ? "time since the first tick received from this daemon" : "time since arming, or else since the first tick");
    element("legend-cameras").hidden = scene.cameras.length === 0;
    this.list("faults", scene.faults.map((fault) => ({ name: fault, text: "" })));
  }

  // Shows the time `t`.
  draw(t) {
    const { ticks, vehicles, tick, vehicle } = this.store;
    if (ticks.length) this.drawTick(this.store.at(ticks, t), tick);
    // The vehicle's messages come on when the daemon has ended.
    const isNewest = this.store.isBounded && (!ticks.length || t >= this.store.last(ticks)[0]);
    if (vehicles.length) this.drawVehicle(isNewest ? this.store.last(vehicles) : this.store.at(vehicles, t), vehicle);
    this.drawEvents(t);
  }

  drawTick(newest, column) {
    const isSilent = this.store.isSilent("ticks");
    this.drawState(newest, column, isSilent);
    const row = isSilent ? newest.map(() => null) : newest;
    const place = element("place");
    if (!place.firstChild) {
      for (const axis of ["x", "y", "z"]) {
        const span = place.appendChild(document.createElement("span"));
        span.appendChild(document.createElement("b")).textContent = axis;
        span.appendChild(document.createElement("span")).id = axis;
      }
    }
    for (const axis of ["x", "y", "z"]) {
      const value = this.store.isOld(row) ? null : row[column[axis]];
      show(axis, value === null ? "–" : `${value.toFixed(3).replace("-", "−")} m`);
    }
    this.figure("Position error", row[column.position], (v) => `${significant(v * 1000)} mm`);
    this.figure("Attitude error", row[column.attitude], (v) => `${significant(v)}°`);
    this.figure("Age of the pose", row[column.age], (v) => `${significant(v)} ms`);
    this.figure("Deadlines missed since the daemon's start", row[column.missed], String, (v) => v > 0 && "warning");
    this.figure("Poses lost since the daemon's start", row[column.lost], String);
    this.figure("Poses refused since the daemon's start", row[column.refused], String);
  }

  drawState(row, column, isSilent) {
    const state = row[column.state];
    const mode = this.scene.modes[row[column.mode]];
    const isFlying = mode === "flying" || mode === "landing";
    const phase = isFlying ? this.scene.phases[row[column.phase]] : "";
    const words = [mode, phase].filter((word) => word).filter((word, i, all) => all.indexOf(word) === i);
    show("state", (!isSilent && this.scene.states[state]) || "unknown");
    show("mode", isSilent ? "–" : words.join(" · "));
    show("cause", isSilent ? (this.store.isBehind() ? "the page is behind" : "the daemon is silent") : this.scene.causes[row[column.cause]] ?? "");
    element("state").parentElement.className = `card state ${isSilent ? "" : MOOD[state] ?? "bad"}`;
  }

  drawVehicle(newest, column) {
    const isSilent = this.store.isSilent("vehicles");
    const row = isSilent ? newest.map(() => null) : newest;
    this.figure("Capture to effect", row[column.whole], (v) => `${significant(v)} ms`);
    const isLow = (v) => v < this.scene.battery_low_v && "warning";
    this.figure("Battery", row[column.battery], (v) => `${v.toFixed(1)} V`, isLow);
    // 2: it answers without reporting its motors.
    const answers = row[column.link] >= 1;
    const quality = row[column.quality];
    const link = answers ? (quality === null ? "answers" : `${(quality * 100).toFixed(0)} %`) : "silent";
    this.figure("Link", answers ? 1 : 0, () => (isSilent ? "unknown" : link), (v) => !isSilent && v === 0 && "bad");
    const state = row[column.armed] ? "running" : row[column.link] === 1 ? "off" : "unknown";
    const motors = row[column.stopped] ? "stopped" : state;
    this.figure("Motors", 0, () => motors, () => motors === "stopped" && "bad");
  }

  figure(name, value, text, mood = () => "") {
    if (!this.figures.has(name)) {
      const figure = element("figures").appendChild(document.createElement("div"));
      figure.appendChild(document.createElement("dt")).textContent = name;
      this.figures.set(name, { figure, value: figure.appendChild(document.createElement("dd")) });
    }
    const { figure, value: place } = this.figures.get(name);
    const shown = value === null || value === undefined ? "–" : text(value);
    if (place.textContent !== shown) place.textContent = shown;
    figure.className = (value !== null && mood(value)) || "";
  }

  // Processes, and what keeps a flight from beginning; returns whether the daemon runs with another configuration than is shown.
  status({ processes, obstacles, flown, config_agrees: agrees }) {
    if (flown) show("subject", flown);
    this.list("obstacles", obstacles.map((text) => ({ name: text, text: "" })), "hindrances");
    const lines = processes.filter(({ heard }) => heard).map(({ name, heard }) => {
      const isSilent = heard.age_ms > SILENT_MS;
      const problem = (heard.vehicle_answers === false && "vehicle silent")
        || heard.trouble || (heard.runs_late && "runs late");
      const text = isSilent ? `silent for ${(heard.age_ms / 1000).toFixed(0)} s` : problem || "well";
      return { name, text, mood: isSilent ? "bad" : problem ? "warning" : "" };
    });
    const daemon = processes.find(({ heard }) => heard?.daemon)?.heard;
    if (processes.length && !daemon) lines.unshift({ name: "daemon", text: "not started, or ended", mood: "bad" });
    if (agrees === false) lines.push({ name: "configurations differ", text: "restart with one --config", mood: "warning" });
    this.list("processes", lines);
    return Boolean(daemon) && daemon.config_hash !== this.scene.config_hash;
  }

  list(id, lines, card = `${id}-card`) {
    const key = JSON.stringify(lines);
    const place = element(id);
    if (place.dataset.key === key) return;
    place.dataset.key = key;
    element(card).hidden = lines.length === 0;
    place.replaceChildren(...lines.map(({ name, text, mood }) => {
      const line = document.createElement("li");
      line.className = mood ?? "";
      line.appendChild(document.createElement("span")).textContent = name;
      if (text) line.appendChild(document.createElement("span")).textContent = text;
      return line;
    }));
  }

  // The events up to the time `t`, the newest first; all of them in order in a recording.
  drawEvents(t) {
    const { events, isBounded } = this.store;
    const key = `${events.length} ${events[events.length - 1]?.t}`;
    const place = element("events");
    if (place.dataset.key === key) return;
    place.dataset.key = key;
    const shown = isBounded ? events.slice(-200).reverse() : events;
    const lines = shown.map((event) => this.event(event));
    if (!lines.length) {
      const none = document.createElement("li");
      none.className = "none";
      none.textContent = "none yet";
      lines.push(none);
    }
    place.replaceChildren(...lines);
  }

  event({ t, mood, text }) {
    const line = document.createElement("li");
    line.className = mood;
    line.appendChild(document.createElement("time")).textContent = `${(Math.round(t * 100) / 100 || 0).toFixed(2)} s`.replace("-", "−");
    line.appendChild(document.createElement("span")).textContent = text;
    if (this.seek) line.addEventListener("click", () => this.seek(t));
    return line;
  }
}
