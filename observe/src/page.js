// Values under the pointer, and enlarged stretches of time, read from the lines of the plots.
(() => {
  "use strict";
  const svgName = "http" + "://www.w3.org/2000/svg";
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  // The points of a path written in steps of a tenth of a pixel, as values; `null` is a gap.
  function decode(path, { x, y, area: [left, top, right, bottom] }) {
    const points = [];
    for (const run of path.getAttribute("d").split("M").slice(1)) {
      const numbers = run.match(/-?\d+/g).map(Number);
      let [a, b] = [0, 0];
      for (let i = 0; i + 1 < numbers.length; i += 2) {
        a += numbers[i];
        b += numbers[i + 1];
        points.push([
          x[0] + ((a / 10 - left) / (right - left)) * (x[1] - x[0]),
          y[0] + ((bottom - b / 10) / (bottom - top)) * (y[1] - y[0]),
        ]);
      }
      points.push(null);
    }
    return points;
  }

  function add(parent, name, attributes, text) {
    const element = document.createElementNS(svgName, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    return parent.appendChild(element);
  }

  function nice(step) {
    const decade = 10 ** Math.floor(Math.log10(step));
    return [1, 2, 5, 10].map((factor) => factor * decade).find((value) => value >= 0.999 * step);
  }

  function ticks(from, to, count) {
    const step = nice((to - from) / count);
    const decimals = Math.min(6, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
    const found = [];
    for (let k = Math.ceil(from / step - 1e-9); k * step <= to + step * 1e-9; k += 1) {
      found.push([k * step, (k * step).toFixed(decimals).replace("-", "−")]);
    }
    return found;
  }

  function number(value) {
    const size = Math.abs(value);
    const decimals = size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : 4;
    return value.toFixed(decimals).replace("-", "−");
  }

  const tip = document.body.appendChild(document.createElement("div"));
  tip.className = "tip";
  tip.hidden = true;
  const reset = document.body.appendChild(document.createElement("button"));
  reset.className = "reset";
  reset.textContent = "Whole flight";
  reset.hidden = true;

  const plots = [...document.querySelectorAll("[data-plot]")].map((place) => {
    const data = JSON.parse(place.dataset.plot);
    const svg = place.querySelector("svg");
    svg.style.touchAction = "pan-y";
    const paths = [...svg.querySelectorAll("path.line")];
    const lines = paths.map((path, i) => ({
      points: decode(path, data),
      color: path.style.stroke,
      name: data.names[i] ?? "",
    }));
    return { ...data, whole: data.x, height: data.y, svg, lines, over: add(svg, "g", { class: "over" }) };
  });
  const timed = plots.filter((plot) => plot.is_time);

  const toX = ({ x, area }, value) => area[0] + ((value - x[0]) / (x[1] - x[0])) * (area[2] - area[0]);
  const toY = ({ y, area }, value) => area[3] - ((value - y[0]) / (y[1] - y[0])) * (area[3] - area[1]);

  // Where the pointer is, in pixels of the plot.
  function pixel({ svg }, event) {
    const box = svg.getBoundingClientRect();
    const { width, height } = svg.viewBox.baseVal;
    return [((event.clientX - box.left) / box.width) * width, ((event.clientY - box.top) / box.height) * height];
  }

  function time(plot, event) {
    const [left, , right] = plot.area;
    const share = (pixel(plot, event)[0] - left) / (right - left);
    return plot.x[0] + Math.min(1, Math.max(0, share)) * (plot.x[1] - plot.x[0]);
  }

  function nearest(points, t) {
    let best = null;
    for (const point of points) if (point && (!best || Math.abs(point[0] - t) < Math.abs(best[0] - t))) best = point;
    return best;
  }

  function mark(t) {
    for (const plot of timed) {
      plot.over.replaceChildren();
      if (t === null || t < plot.x[0] || t > plot.x[1]) continue;
      const at = toX(plot, t);
      add(plot.over, "path", { d: `M${at} ${plot.area[1]}V${plot.area[3]}`, stroke: style("text"), "stroke-width": 2, opacity: 0.55 });
    }
  }

  function tell(event, rows) {
    tip.replaceChildren(...rows.map(([color, text]) => {
      const row = document.createElement("p");
      if (color) row.appendChild(document.createElement("i")).style.background = color;
      row.append(text);
      return row;
    }));
    tip.hidden = false;
    const [width, height] = [tip.offsetWidth, tip.offsetHeight];
    const x = event.clientX + 16 + width > innerWidth ? event.clientX - width - 16 : event.clientX + 16;
    tip.style.left = `${Math.max(4, x)}px`;
    tip.style.top = `${Math.max(4, Math.min(innerHeight - height - 4, event.clientY + 14))}px`;
  }

  function overTime(plot, event) {
    const t = time(plot, event);
    mark(t);
    const rows = [["", `${number(t)} s`]];
    for (const { points, color, name } of plot.lines) {
      const point = nearest(points, t);
      if (!point || Math.abs(point[0] - t) > 0.05 * (plot.whole[1] - plot.whole[0])) continue;
      rows.push([color, `${name} ${number(point[1])}`.trim()]);
      add(plot.over, "circle", { cx: toX(plot, point[0]), cy: toY(plot, point[1]), r: 7, style: `fill:${color}` });
    }
    tell(event, rows);
  }

  function inPlane(plot, event) {
    const [px, py] = pixel(plot, event);
    let best = null;
    for (const { points, color, name } of plot.lines) {
      for (const point of points) {
        if (!point) continue;
        const distance = Math.hypot(toX(plot, point[0]) - px, toY(plot, point[1]) - py);
        if (!best || distance < best.distance) best = { distance, point, color, name };
      }
    }
    plot.over.replaceChildren();
    if (!best || best.distance > 80) return leave(plot);
    const [x, y] = best.point;
    add(plot.over, "circle", { cx: toX(plot, x), cy: toY(plot, y), r: 9, style: `fill:${best.color}` });
    tell(event, [[best.color, `${best.name} ${number(x)}, ${number(y)} m`]]);
  }

  function leave(plot) {
    tip.hidden = true;
    plot.over.replaceChildren();
    mark(null);
  }

  // Shows the stretch of time `x` in every plot; the whole flight for `null`.
  function zoom(x) {
    reset.hidden = x === null;
    for (const plot of timed) {
      plot.svg.querySelector(".zoomed")?.remove();
      plot.svg.classList.toggle("is-zoomed", x !== null);
      plot.x = x ?? plot.whole;
      plot.y = plot.height;
      if (x) draw(plot);
      plot.svg.append(plot.over);
    }
    mark(null);
  }

  function draw(plot) {
    const [from, to] = plot.x;
    const seen = plot.lines.flatMap(({ points }) => points.filter((p) => p && p[0] >= from && p[0] <= to).map((p) => p[1]));
    if (seen.length) {
      let [low, high] = [Math.min(...seen), Math.max(...seen)];
      const room = 0.08 * (high - low) || 0.1 * Math.abs(high) || 1;
      plot.y = [low - room, high + room];
    }
    const [left, top, right, bottom] = plot.area;
    const group = add(plot.svg, "g", { class: "zoomed" });
    const clip = `clip-${timed.indexOf(plot)}`;
    add(add(group, "clipPath", { id: clip }), "rect", { x: left, y: top, width: right - left, height: bottom - top });
    for (const [value, label] of ticks(...plot.y, 5)) {
      const y = toY(plot, value);
      add(group, "path", { d: `M${left} ${y}H${right}`, stroke: style("grid"), "stroke-width": 2 });
      add(group, "text", { x: left - 10, y: y + 8, "text-anchor": "end", "font-size": 24 }, label);
    }
    for (const [value, label] of ticks(from, to, 7)) {
      const x = toX(plot, value);
      add(group, "path", { d: `M${x} ${top}V${bottom}`, stroke: style("grid"), "stroke-width": 2 });
      add(group, "text", { x, y: bottom + 32, "text-anchor": "middle", "font-size": 24 }, `${label} s`);
    }
    const inside = add(group, "g", { "clip-path": "url" + `(#${clip})` });
    for (const at of plot.instants) {
      add(inside, "path", { d: `M${toX(plot, at)} ${top}V${bottom}`, stroke: style("warning"), "stroke-width": 2 });
    }
    for (const { points, color } of plot.lines) {
      let [d, pen] = ["", "M"];
      points.forEach((point, i) => {
        const near = [points[i - 1], point, points[i + 1]].some((p) => p && p[0] >= from && p[0] <= to);
        if (!point || !near) return void (pen = "M");
        d += `${pen}${toX(plot, point[0]).toFixed(1)} ${toY(plot, point[1]).toFixed(1)}`;
        pen = "L";
      });
      add(inside, "path", { d, style: `stroke:${color}`, "stroke-width": 3, fill: "none" });
    }
  }

  for (const plot of plots) {
    let start = null;
    plot.svg.addEventListener("pointerdown", (event) => {
      if (plot.is_time && event.button === 0 && event.pointerType === "mouse") start = event;
    });
    plot.svg.addEventListener("pointermove", (event) => {
      if (!plot.is_time) return inPlane(plot, event);
      overTime(plot, event);
      if (!start || !event.buttons) return void (start = null);
      event.preventDefault();
      const [a, b] = [pixel(plot, start)[0], pixel(plot, event)[0]].sort((p, q) => p - q);
      const [, top, , bottom] = plot.area;
      add(plot.over, "rect", { x: a, y: top, width: b - a, height: bottom - top, fill: style("actual"), opacity: 0.15 });
    });
    plot.svg.addEventListener("pointerup", (event) => {
      if (!start) return;
      const [from, to] = [time(plot, start), time(plot, event)].sort((p, q) => p - q);
      if (Math.abs(event.clientX - start.clientX) > 6) zoom([from, to]);
      start = null;
    });
    plot.svg.addEventListener("pointerleave", () => leave(plot));
    plot.svg.addEventListener("dblclick", () => zoom(null));
    if (plot.is_time) plot.svg.style.cursor = "crosshair";
  }
  reset.addEventListener("click", () => zoom(null));
  for (const line of document.querySelectorAll("[data-t]")) {
    const at = Number(line.dataset.t);
    line.addEventListener("pointerenter", () => mark(at));
    line.addEventListener("pointerleave", () => mark(null));
    line.addEventListener("click", () => zoom([at - 1.5, at + 1.5]));
  }
})();
