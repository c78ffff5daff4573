// A camera that turns about a target: from metres in the world (x, y, z up) to pixels.

const NEAR_M = 0.05;
const FIELD = 0.9;

export class Orbit {
  constructor() {
    this.azimuth = -2.15;
    this.elevation = 0.45;
    this.distance = 5;
    this.target = [0, 0, 0.6];
  }

  // Prepares the projection onto a canvas of this size.
  fit(width, height) {
    const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    this.forward = [-ca * ce, -sa * ce, -se];
    this.right = [-sa, ca, 0];
    this.up = [-ca * se, -sa * se, ce];
    this.eye = this.target.map((value, i) => value - this.forward[i] * this.distance);
    this.centre = [width / 2, height / 2];
    this.scale = Math.min(width, height * 1.5) / FIELD;
  }

  // Coordinates in the frame of the camera: right, up, forward.
  view(point) {
    const d = [point[0] - this.eye[0], point[1] - this.eye[1], point[2] - this.eye[2]];
    return [dot(d, this.right), dot(d, this.up), dot(d, this.forward)];
  }

  screen([x, y, z]) {
    return [this.centre[0] + (this.scale * x) / z, this.centre[1] - (this.scale * y) / z];
  }

  // The point on the canvas; `null` behind the camera.
  point(world) {
    const seen = this.view(world);
    return seen[2] > NEAR_M ? this.screen(seen) : null;
  }

  // The visible part of a segment as two points; `null` if there is none.
  segment(from, to) {
    let [a, b] = [this.view(from), this.view(to)];
    if (a[2] <= NEAR_M && b[2] <= NEAR_M) return null;
    if (a[2] <= NEAR_M) a = cut(b, a);
    if (b[2] <= NEAR_M) b = cut(a, b);
    return [this.screen(a), this.screen(b)];
  }

  // Pixels of a metre at a point.
  pixelsPerMetre(world) {
    return this.scale / Math.max(NEAR_M, this.view(world)[2]);
  }

  turn(dx, dy) {
    this.azimuth -= dx * 0.008;
    this.elevation = clamp(this.elevation + dy * 0.008, -0.2, Math.PI / 2 - 0.001);
  }

  zoom(factor) {
    this.distance = clamp(this.distance * factor, 0.4, 80);
  }

  // Moves the target in the plane of the canvas.
  pan(dx, dy) {
    const metres = this.distance / this.scale;
    this.target = this.target.map((value, i) => value + (-dx * this.right[i] + dy * this.up[i]) * metres);
  }

  // Shows the box between two corners.
  frame(low, high) {
    this.target = low.map((value, i) => (value + high[i]) / 2);
    const radius = Math.hypot(...low.map((value, i) => high[i] - value)) / 2;
    this.distance = clamp(Math.max(radius, 0.6) * 2.5, 0.4, 80);
  }
}

function cut(inside, outside) {
  const share = (inside[2] - NEAR_M * 1.01) / (inside[2] - outside[2]);
  return inside.map((value, i) => value + share * (outside[i] - value));
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function clamp(value, low, high) {
  return Math.min(high, Math.max(low, value));
}
