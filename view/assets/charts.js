// Strip charts over time: the latest seconds of an instance, or a whole recording with a line at the time shown.

import { palette } from "./palette.js";

const WINDOW_S = 20;
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 8, 6, 18];

// The charts of a scene: title, unit, factor, and traces by column, name and colour.
function plan(scene) {
  const colors = ["actual", "second", "third", "fourth", "fifth", "sixth", "axis"];
  const hops = scene.hops.map((hop, i) => [hop, hop.replaceAll("_", " "), colors[i]]);
  return [
    { title: "Position error", hasSource: true, unit: "mm", factor: 1000, rows: "ticks", traces: [["position", "", "actual"]], zero: true },
    { title: "Attitude error", hasSource: true, unit: "°", factor: 1, rows: "ticks", traces: [["attitude", "", "actual"]], zero: true },
    { title: `Command, ${scene.command_unit}`, unit: "", factor: 1, rows: "ticks", traces: [["roll", "roll", "actual"], ["pitch", "pitch", "second"], ["yaw", "yaw", "third"]] },
    { title: "Thrust, share of the maximum", unit: "%", factor: 100, rows: "ticks", traces: [["thrust", "", "actual"]], zero: true },
    { title: "Capture to effect", unit: "ms", factor: 1, rows: "vehicles", total: "whole", traces: hops, isStacked: true, zero: true },
    { title: "Battery", unit: "V", factor: 1, rows: "vehicles", traces: [["battery", "", "third"]] },
  ];
}

export class Charts {
  // `seek` is called with the time of a click in a recording.
  constructor(place, scene, store, seek) {
    this.store = store;
    this.isLive = scene.is_live;
    this.charts = plan(scene).map((chart) => this.make(place, chart, seek));
  }

  make(place, chart, seek) {
    const figure = document.createElement("figure");
    figure.className = "card";
    const caption = figure.appendChild(document.createElement("figcaption"));
    const title = chart.unit ? `${chart.title} [${chart.unit}]` : chart.title;
    const heading = caption.appendChild(document.createElement("b"));
    heading.textContent = title;
    const names = caption.appendChild(document.createElement("span"));
    names.className = "names";
    const labels = chart.traces.map(([, name, color]) => this.label(names, name, color));
    const output = caption.appendChild(document.createElement("output"));
    const canvas = figure.appendChild(document.createElement("canvas"));
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", title);
    place.appendChild(figure);
    const columns = chart.rows === "ticks" ? this.store.tick : this.store.vehicle;
    const made = { ...chart, heading, canvas, output, labels, columns };
    if (!this.isLive) {
      const at = (event) => {
        const share = (event.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
        const [from, to] = this.span;
        seek(from + Math.min(1, Math.max(0, share)) * (to - from));
      };
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        at(event);
      });
      canvas.addEventListener("pointermove", (event) => event.buttons && at(event));
    }
    return made;
  }

  label(names, name, color) {
    if (!name) return null;
    const label = names.appendChild(document.createElement("span"));
    label.appendChild(document.createElement("i")).className = color;
    label.append(name);
    return label;
  }

  // Draws all charts at the time `t`.
  draw(t) {
    const { ticks } = this.store;
    if (this.isLive) this.span = [t - WINDOW_S, t];
    else this.span = ticks.length ? [ticks[0][0], ticks[ticks.length - 1][0]] : [0, 1];
    if (this.span[1] <= this.span[0]) this.span[1] = this.span[0] + 1;
    this.color = palette();
    for (const chart of this.charts) this.drawChart(chart, t);
  }

  drawChart(chart, t) {
    const [from, to] = this.span;
    const rows = this.store[chart.rows];
    const [start, end] = [Math.max(0, this.store.until(rows, from) - 1), this.store.until(rows, to)];
    const lines = chart.traces.map(([name]) => chart.columns[name]);
    const seen = lines.map((column) => rows.length > 0 && this.has(rows, column, start, end));
    chart.labels.forEach((label, i) => label && (label.hidden = !seen[i] && chart.isStacked));
    this.tell(chart, rows, t);
    const pen = this.prepare(chart.canvas);
    const { clientWidth: width, clientHeight: height } = chart.canvas;
    const values = this.values(chart, rows.slice(start, end), lines);
    const [low, high] = range(values, chart.zero);
    const x = (time) => LEFT + ((time - from) / (to - from)) * (width - LEFT - RIGHT);
    const y = (value) => height - BOTTOM - ((value - low) / (high - low)) * (height - BOTTOM - TOP);
    this.drawAxes(pen, { low, high, x, y, width, height });
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP - 2, width - LEFT - RIGHT, height - BOTTOM - TOP + 4);
    pen.clip();
    // Points of adjacent pixels are less than two pixels apart.
    const gap = Math.max(this.store.gap, (2 * (to - from)) / (width - LEFT - RIGHT));
    const order = values.map((_, i) => i);
    const isEmpty = rows.slice(start, end).map((row) => lines.every((column) => row[column] === null));
    for (const i of chart.isStacked ? order.reverse() : order) {
      const points = thin(values[i].filter(([, value], k) => value !== null || isEmpty[k]), x, width);
      this.drawTrace(pen, points, { x, y, gap, color: this.color(chart.traces[i][2]), floor: chart.isStacked ? y(0) : null });
    }
    pen.restore();
    if (!this.isLive) this.drawCursor(pen, x(t), height);
  }

  // Points of each trace; those of a stack are summed up.
  values(chart, rows, columns) {
    const sums = rows.map(() => 0);
    return columns.map((column) => rows.map((row, i) => {
      const value = row[column];
      if (!chart.isStacked) return [row[0], value === null ? null : value * chart.factor];
      sums[i] += value ?? 0;
      return [row[0], row[chart.columns.whole] === null ? null : sums[i]];
    }));
  }

  has(rows, column, start, end) {
    for (let i = start; i < end; i += 1) if (rows[i][column] !== null) return true;
    return false;
  }

  // The value at the time shown.
  tell(chart, rows, t) {
    // The vehicle's messages continue without ticks, and `t` is the time of the latest tick.
    const latest = () => (this.isLive ? rows[rows.length - 1] : this.store.at(rows, t));
    const newest = rows.length ? latest() : null;
    const row = this.store.isSilent(chart.rows) ? null : newest;
    if (chart.hasSource && newest) chart.heading.textContent = `${chart.title}, ${this.store.isTrue ? "true" : "estimated"} motion [${chart.unit}]`;
    const columns = chart.total ? [chart.total] : chart.traces.map(([name]) => name);
    const values = row ? columns.map((name) => row[chart.columns[name]]) : [null];
    const text = values.map((value) => (value === null ? "–" : significant(value * chart.factor))).join("  ");
    chart.output.textContent = values.every((value) => value === null) ? "–" : `${text} ${chart.unit}`.trim();
  }

  prepare(canvas) {
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    return pen;
  }

  drawAxes(pen, { low, high, x, y, width, height }) {
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = this.color("muted");
    pen.strokeStyle = this.color("grid");
    pen.lineWidth = 1;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    const step = nice((high - low) / 4);
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
      const at = Math.round(y(k * step)) + 0.5;
      stroke(pen, [LEFT, at], [width - RIGHT, at]);
      pen.fillText(decimal(k * step, step), LEFT - 6, at);
    }
    const [from, to] = this.span;
    const seconds = nice((to - from) / Math.max(2, width / 90));
    pen.textBaseline = "alphabetic";
    pen.textAlign = "center";
    for (let k = Math.ceil(from / seconds); k * seconds <= to; k += 1) {
      const at = x(k * seconds);
      if (at > LEFT + 12 && at < width - RIGHT - 10) pen.fillText(`${decimal(k * seconds, seconds)} s`, at, height - 4);
    }
  }

  // Draws lines through the points, except over a time of more than `gap` without one.
  drawTrace(pen, points, { x, y, gap, color, floor }) {
    let [run, last] = [[], -Infinity];
    const flush = () => {
      if (run.length > 1) {
        pen.beginPath();
        run.forEach((point, i) => (i ? pen.lineTo(...point) : pen.moveTo(...point)));
        if (floor === null) {
          pen.strokeStyle = color;
          pen.lineWidth = 1.5;
          pen.stroke();
        } else {
          pen.lineTo(run[run.length - 1][0], floor);
          pen.lineTo(run[0][0], floor);
          pen.fillStyle = color;
          pen.fill();
        }
      }
      run = [];
    };
    for (const [t, value] of points) {
      if (t - last > gap || value === null) flush();
      if (value === null) continue;
      run.push([x(t), y(value)]);
      last = t;
    }
    flush();
  }

  drawCursor(pen, at, height) {
    pen.strokeStyle = this.color("text");
    pen.lineWidth = 1;
    stroke(pen, [at, TOP - 4], [at, height - BOTTOM]);
  }
}

function stroke(pen, from, to) {
  pen.beginPath();
  pen.moveTo(...from);
  pen.lineTo(...to);
  pen.stroke();
}

// At most two points for each pixel: minimum and maximum.
function thin(points, x, width) {
  if (points.length < 3 * width) return points;
  const kept = [];
  const flush = (group) => {
    group.sort((a, b) => a[1] - b[1]);
    kept.push(...[group[0], group[group.length - 1]].sort((a, b) => a[0] - b[0]));
  };
  let group = [];
  for (const point of points) {
    if (point[1] === null) {
      if (group.length) flush(group);
      group = [];
      kept.push(point);
      continue;
    }
    if (group.length && Math.floor(x(point[0])) !== Math.floor(x(group[0][0]))) {
      flush(group);
      group = [];
    }
    group.push(point);
  }
  if (group.length) flush(group);
  return kept;
}

function range(values, fromZero) {
  let [low, high] = [Infinity, -Infinity];
  for (const points of values) {
    for (const [, value] of points) {
      if (value === null) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  if (low > high) [low, high] = [0, 1];
  if (fromZero) low = 0;
  if (high - low < 1e-3 * Math.max(1e-6, Math.abs(high))) [low, high] = [fromZero ? 0 : low - 0.5, high + 0.5];
  const room = 0.08 * (high - low);
  return [fromZero ? low : low - room, high + room];
}

// The smallest of 1, 2 and 5 times a power of ten that is not below `step`.
export function nice(step) {
  const decade = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 5, 10].map((factor) => factor * decade).find((value) => value >= 0.999 * step) ?? 10 * decade;
}

function decimal(value, step) {
  return value.toFixed(Math.min(5, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)))).replace("-", "−");
}

// A number with three digits.
export function significant(value) {
  const size = Math.abs(value);
  const decimals = size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  return value.toFixed(decimals).replace("-", "−");
}
