// The page: a running instance as it is now, or a recording at the time of the slider.

import { Charts } from "./charts.js";
import { offerControl } from "./control.js";
import { Refused, follow, load, setToken } from "./feed.js";
import { Panel } from "./panel.js";
import { Player } from "./player.js";
import { Room } from "./room.js";
import { Store } from "./store.js";

const element = (id) => document.getElementById(id);

function tell(text, mood) {
  element("connection").textContent = text;
  element("connection").className = `badge ${mood}`;
}

function notice(text) {
  element("notice").textContent = text;
  element("notice").hidden = !text;
}

// The scene, once the server admits this page.
async function enter() {
  for (;;) {
    try {
      return await load("scene");
    } catch (error) {
      if (!(error instanceof Refused && error.status === 401)) {
        tell(error.message, "bad");
        throw error;
      }
      tell("locked", "warning");
      await askToken();
    }
  }
}

function askToken() {
  element("gate").hidden = false;
  return new Promise((resolve) => {
    element("gate").addEventListener("submit", (event) => {
      event.preventDefault();
      setToken(element("gate-token").value);
      element("gate-token").value = "";
      element("gate").hidden = true;
      resolve();
    }, { once: true });
  });
}

function buttons(room) {
  element("view-flight").addEventListener("click", () => {
    Object.assign(room.orbit, { azimuth: -2.15, elevation: 0.45 });
    room.isTouched = false;
  });
  element("view-room").addEventListener("click", () => room.showRoom());
  element("view-top").addEventListener("click", () => room.showTop());
  element("view-follow").addEventListener("click", () => {
    room.isFollowing = !room.isFollowing;
    room.isTouched = true;
    element("view-follow").setAttribute("aria-pressed", String(room.isFollowing));
  });
}

// Updates in the latest second, as the connection shows them.
class Rate {
  constructor() {
    this.arrivals = [];
  }

  count(now) {
    this.arrivals.push(now);
    while (this.arrivals[0] < now - 1000) this.arrivals.shift();
    return this.arrivals.length;
  }
}

// Shows the room of the daemon that runs, once its configuration is known.
async function renew({ config_hash: shown }) {
  const { config_hash: hash } = await load("scene");
  if (hash !== shown) location.reload();
  else notice("The daemon's configuration cannot be read: room, cameras and faults may be others than shown.");
}

function live(store, panel) {
  const rate = new Rate();
  let shown = 0;
  follow({
    begin: () => store.begin(),
    take: (update) => {
      store.add(update);
      const now = performance.now();
      store.noteDelay(update.at_ms, now);
      const updates = rate.count(now);
      if (update.status) {
        store.setAge("ticks", update.status.silence_s);
        store.setAge("vehicles", update.status.vehicle_silence_s);
        const isOther = panel.status(update.status);
        if (isOther) renew(panel.scene);
        else notice("");
        const silence = update.status.silence_s;
        const hasDaemon = update.status.processes.some(({ heard }) => heard?.daemon);
        if (store.isBehind()) tell(`${store.lag.toFixed(0)} s behind`, "bad");
        else if (silence === null) tell(hasDaemon ? "waiting for the first tick" : "no daemon runs", "warning");
        else if (silence > 1) tell(`no tick for ${silence.toFixed(0)} s`, "bad");
        else if (now - shown > 900) tell(`live · ${updates} updates/s`, "good");
        if (silence !== null && silence <= 1 && now - shown > 900) shown = now;
      }
    },
    tell: (text) => {
      tell(text, "bad");
      panel.status({ processes: [], obstacles: [] });
    },
  });
  return () => store.last(store.ticks)?.[0] ?? 0;
}

// Time after arming at which a recording is opened: the vehicle takes off.
const TAKE_OFF_S = 1.0;

async function recorded(store, player) {
  const recording = await load("recording");
  store.add(recording);
  const { ticks } = store;
  tell(`recording · ${ticks.length ? (store.last(ticks)[0] - ticks[0][0]).toFixed(1) : 0} s`, "good");
  const thinned = recording.thinning > 1 ? `About one tick in ${recording.thinning} is shown, with the extremes of the curves. ` : "";
  const cut = recording.cut_off ? `The file is cut off (${recording.cut_off}) and shown up to there.` : "";
  notice(thinned + cut);
  // The vehicle is armed at 0; before, there may be no pose.
  const [from, to] = ticks.length ? [ticks[0][0], store.last(ticks)[0]] : [0, 1];
  player.made = new Player(from, to, Math.min(to, Math.max(from, TAKE_OFF_S)));
  let last = performance.now();
  return () => {
    const now = performance.now();
    const elapsed = (now - last) / 1000;
    last = now;
    return player.made.advance(elapsed);
  };
}

async function main() {
  const scene = await enter();
  const store = new Store(scene);
  const player = {};
  const seek = scene.is_live ? null : (t) => player.made?.seek(t);
  document.body.className = scene.is_live ? "live" : "recorded";
  element("main").hidden = false;
  const panel = new Panel(scene, store, seek);
  const room = new Room(element("room"), scene, store);
  const charts = new Charts(element("charts"), scene, store, seek);
  buttons(room);
  if (scene.has_control) offerControl(scene);
  const time = scene.is_live ? live(store, panel) : await recorded(store, player);
  const frame = () => {
    const t = time();
    room.draw(t);
    charts.draw(t);
    panel.draw(t);
    requestAnimationFrame(frame);
  };
  frame();
}

main();
