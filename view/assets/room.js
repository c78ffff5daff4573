// The room in three dimensions: floor, fence, cameras, path, reference, vehicle. Drag turns, Shift and drag moves, the wheel
// zooms.

import { palette } from "./palette.js";
import { Orbit } from "./projection.js";

const ARM_M = 0.17;
const LEAST_ARM_PX = 17;
const TRAIL_S = 60;

export class Room {
  constructor(canvas, scene, store) {
    Object.assign(this, { canvas, scene, store });
    this.orbit = new Orbit();
    this.isFollowing = false;
    this.isTouched = false;
    this.floor = Math.max(scene.fence.z[0], Math.min(0, scene.fence.z[1]));
    this.listen();
  }

  listen() {
    const pointers = new Map();
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
      if (pointers.size === 2) {
        const other = [...pointers.values()].find((one) => one.pointerId !== event.pointerId);
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        this.orbit.zoom(apart(before) / Math.max(1, apart(event)));
      } else if (event.shiftKey || event.buttons & 2) {
        this.orbit.pan(dx, dy);
      } else {
        this.orbit.turn(dx, dy);
      }
      this.isTouched = true;
      pointers.set(event.pointerId, event);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    this.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.isTouched = true;
      this.orbit.zoom(Math.exp(event.deltaY * 0.0012));
    }, { passive: false });
    const keys = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, 20], ArrowDown: [0, -20] };
    this.canvas.addEventListener("keydown", (event) => {
      if (keys[event.key]) this.orbit.turn(...keys[event.key]);
      else if (event.key === "+") this.orbit.zoom(0.85);
      else if (event.key === "-") this.orbit.zoom(1.18);
      else return;
      this.isTouched = true;
      event.preventDefault();
    });
  }

  showRoom() {
    const xs = this.scene.fence.corners.map((corner) => corner[0]);
    const ys = this.scene.fence.corners.map((corner) => corner[1]);
    const low = [Math.min(...xs), Math.min(...ys), this.floor];
    this.orbit.frame(low, [Math.max(...xs), Math.max(...ys), this.scene.fence.z[1]]);
    this.isTouched = true;
  }

  showTop() {
    this.orbit.azimuth = -Math.PI / 2;
    this.orbit.elevation = Math.PI / 2 - 0.001;
    this.isTouched = true;
  }

  showFlight() {
    const low = [-0.8, -0.8, this.floor];
    const high = [0.8, 0.8, this.floor + 1];
    for (const row of this.store.ticks) {
      for (let i = 0; i < 3; i += 1) {
        const value = row[this.store.tick.x + i];
        if (value === null || Math.abs(value) > 50) continue;
        low[i] = Math.min(low[i], value);
        high[i] = Math.max(high[i], value);
      }
    }
    this.orbit.frame(low, high);
  }

  // Draws the room at the time `t`.
  draw(t) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    const row = this.store.ticks.length ? this.store.at(this.store.ticks, t) : null;
    if (!this.isTouched) this.showFlight();
    const position = row && this.position(row);
    if (this.isFollowing && position) this.orbit.target = position;
    this.orbit.fit(width, height);
    this.pen = this.canvas.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.clearRect(0, 0, width, height);
    this.pen.lineJoin = this.pen.lineCap = "round";
    this.color = palette();
    this.drawFloor();
    this.drawFence();
    for (const camera of this.scene.cameras) this.drawCamera(camera);
    this.drawPaths(t);
    const isSilent = this.store.isSilent("ticks");
    if (position) {
      this.isOld = isSilent || this.store.isOld(row);
      if (!isSilent) this.drawReference(this.reference(row));
      this.drawVehicle(position, row.slice(this.store.tick.qx, this.store.tick.qx + 4));
    }
  }

  position(row) {
    const at = row.slice(this.store.tick.x, this.store.tick.x + 3);
    return at.every((value) => value !== null) ? at : null;
  }

  reference(row) {
    return row.slice(this.store.tick.rx, this.store.tick.rx + 3);
  }

  line(from, to, color, width = 1) {
    const ends = this.orbit.segment(from, to);
    if (!ends) return;
    this.pen.strokeStyle = color;
    this.pen.lineWidth = width;
    this.pen.beginPath();
    this.pen.moveTo(...ends[0]);
    this.pen.lineTo(...ends[1]);
    this.pen.stroke();
  }

  drawFloor() {
    const xs = this.scene.fence.corners.map((corner) => corner[0]);
    const ys = this.scene.fence.corners.map((corner) => corner[1]);
    const [x0, x1] = [Math.max(-30, Math.min(...xs)), Math.min(30, Math.max(...xs))];
    const [y0, y1] = [Math.max(-30, Math.min(...ys)), Math.min(30, Math.max(...ys))];
    const z = this.floor;
    for (let x = Math.ceil(x0); x <= x1; x += 1) this.line([x, y0, z], [x, y1, z], this.color(x === 0 ? "axis" : "grid"));
    for (let y = Math.ceil(y0); y <= y1; y += 1) this.line([x0, y, z], [x1, y, z], this.color(y === 0 ? "axis" : "grid"));
    const length = 0.5;
    for (const [axis, name] of [[[length, 0, 0], "x"], [[0, length, 0], "y"], [[0, 0, length], "z"]]) {
      const tip = [axis[0], axis[1], axis[2] + z];
      this.line([0, 0, z], tip, this.color("muted"), 1.5);
      const at = this.orbit.point(tip.map((value, i) => value + axis[i] * 0.16));
      if (!at) continue;
      this.pen.fillStyle = this.color("muted");
      this.pen.font = "11px system-ui, sans-serif";
      this.pen.textAlign = "center";
      this.pen.textBaseline = "middle";
      this.pen.fillText(name, ...at);
    }
  }

  drawFence() {
    const color = this.color("axis");
    const { corners, z: [, top] } = this.scene.fence;
    corners.forEach(([x, y], i) => {
      const [nextX, nextY] = corners[(i + 1) % corners.length];
      this.line([x, y, this.floor], [nextX, nextY, this.floor], color, 1.5);
      this.line([x, y, top], [nextX, nextY, top], color);
      this.line([x, y, this.floor], [x, y, top], color);
    });
  }

  // A pyramid from the camera along its view.
  drawCamera({ position, aim, view, is_covered: isCovered }) {
    const color = this.color(isCovered ? "axis" : "fourth");
    const forward = unit(aim.map((value, i) => value - position[i]));
    const right = unit([forward[1], -forward[0], 0]);
    const up = cross(right, forward);
    const half = Math.tan((view * Math.PI) / 360) * 0.3;
    const corners = [[-1, -0.8], [1, -0.8], [1, 0.8], [-1, 0.8]].map(([a, b]) =>
      position.map((value, i) => value + forward[i] * 0.3 + right[i] * a * half + up[i] * b * half));
    corners.forEach((corner, i) => {
      this.line(position, corner, color);
      this.line(corner, corners[(i + 1) % 4], color, 1.5);
    });
  }

  drawPaths(t) {
    const { ticks, isBounded } = this.store;
    const end = this.store.until(ticks, t);
    const start = isBounded ? this.store.until(ticks, t - TRAIL_S) : 0;
    const reference = (row) => this.reference(row);
    const position = (row) => this.position(row);
    if (!isBounded) this.drawPath(ticks, position, { color: "grid", width: 2 });
    this.drawPath(ticks.slice(start, end), reference, { color: "reference", width: 1.25, dash: [4, 4] });
    this.drawPath(ticks.slice(start, end), position, { color: "actual", width: 2 });
  }

  drawPath(rows, point, { color, width, dash = [] }) {
    this.pen.strokeStyle = this.color(color);
    this.pen.lineWidth = width;
    this.pen.setLineDash(dash);
    this.pen.beginPath();
    const stride = Math.max(1, Math.floor(rows.length / 4000));
    let isDown = false;
    let last = null;
    for (let i = 0; i < rows.length; i += stride) {
      const at = point(rows[i]);
      const seen = at && this.orbit.point(at);
      if (i && rows[i][0] - rows[i - stride][0] > this.store.gap * stride) isDown = false;
      if (!seen) {
        isDown = false;
      } else if (!isDown) {
        this.pen.moveTo(...seen);
        [isDown, last] = [true, seen];
      } else if (Math.abs(seen[0] - last[0]) + Math.abs(seen[1] - last[1]) > 0.7) {
        this.pen.lineTo(...seen);
        last = seen;
      }
    }
    this.pen.stroke();
    this.pen.setLineDash([]);
  }

  drawReference(at) {
    const seen = at.every((value) => value !== null) && this.orbit.point(at);
    if (!seen) return;
    this.pen.strokeStyle = this.color("reference");
    this.pen.lineWidth = 1.5;
    this.pen.beginPath();
    this.pen.arc(...seen, 6, 0, 2 * Math.PI);
    for (const [x, y] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      this.pen.moveTo(seen[0] + 4 * x, seen[1] + 4 * y);
      this.pen.lineTo(seen[0] + 10 * x, seen[1] + 10 * y);
    }
    this.pen.stroke();
  }

  // Four rotors, the front ones in the accent colour, above a mark on the floor; grey where it was seen last.
  drawVehicle(at, attitude) {
    const ink = (name) => this.color(this.isOld ? "axis" : name);
    const arm = Math.max(ARM_M, LEAST_ARM_PX / this.orbit.pixelsPerMetre(at));
    const below = [at[0], at[1], this.floor];
    this.line(at, below, this.color("axis"));
    this.ring(below, arm * 0.35, (a) => [a[0], a[1], 0], this.color("axis"), 1.5);
    const turn = attitude.every((value) => value !== null) ? (v) => rotate(attitude, v) : (v) => v;
    const place = (v) => turn(v).map((value, i) => value + at[i]);
    const text = ink("text");
    for (const [x, y] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
      const hub = [x * arm * 0.71, y * arm * 0.71, 0];
      this.line(at, place(hub), text, 2.5);
      this.ring(place(hub), arm * 0.52, turn, ink(x > 0 ? "second" : "text"), 2);
    }
    this.line(at, place([arm * 0.9, 0, 0]), ink("second"), 2.5);
  }

  ring(centre, radius, turn, color, width) {
    for (let i = 0; i < 20; i += 1) {
      const [a, b] = [i, i + 1].map((k) => {
        const angle = (k / 20) * 2 * Math.PI;
        const v = turn([radius * Math.cos(angle), radius * Math.sin(angle), 0]);
        return v.map((value, j) => value + centre[j]);
      });
      this.line(a, b, color, width);
    }
  }
}

// A vector turned by a quaternion, scalar last.
function rotate([x, y, z, w], v) {
  const t = cross([x, y, z], v).map((value) => 2 * value);
  const u = cross([x, y, z], t);
  return v.map((value, i) => value + w * t[i] + u[i]);
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function unit(v) {
  const length = Math.hypot(...v) || 1;
  return v.map((value) => value / length);
}
