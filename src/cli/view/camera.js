// The camera: turns around a centre, pans and comes nearer. z is up.
"use strict";

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const clamp = (v, low, high) => Math.max(low, Math.min(high, v));

// Focal length over half the height of the picture.
const LENS = 2.4;
const MAX_TILT = Math.PI / 2;

class Camera {
  constructor() {
    Object.assign(this, { centre: [0, 0, 0], home: [0, 0, 0], half: [1, 1, 1], size: 1 });
    this.reset(1);
  }

  // Frames a box in a picture that is `wide` times as wide as high.
  frame(low, high, wide) {
    this.home = low.map((c, k) => (c + high[k]) / 2);
    this.half = high.map((c, k) => (c - low[k]) / 2);
    this.size = Math.hypot(...this.half) || 1;
    this.reset(wide);
  }

  // Takes another box of the same part; what is seen stays.
  adopt(low, high) {
    const size = this.size;
    this.home = low.map((c, k) => (c + high[k]) / 2);
    this.half = high.map((c, k) => (c - low[k]) / 2);
    this.size = Math.hypot(...this.half) || 1;
    this.away = clamp(this.away * size / this.size, 0.02, 20);
  }

  reset(wide) {
    this.face(-2.1, 0.5, wide);
  }

  // Shows the whole box from a direction.
  face(turn, tilt, wide) {
    Object.assign(this, { turn, tilt, centre: [...this.home], isFitted: true });
    const { right, up, back } = this.axes();
    const lens = this.lens(wide);
    let away = 0;
    for (let n = 0; n < 8; n++) {
      const corner = this.half.map((h, k) => n >> k & 1 ? h : -h);
      const [x, y, z] = [right, up, back].map((a) => dot(a, corner));
      away = Math.max(away, Math.abs(x) * lens / wide + z, Math.abs(y) * lens + z);
    }
    this.away = clamp(1.08 * away / this.size, 0.02, 20);
  }

  // Fits the box again in a picture of another shape, unless it was moved since.
  refit(wide) {
    if (this.isFitted) this.face(this.turn, this.tilt, wide);
  }

  // A narrow picture shows the same width.
  lens(wide) {
    return LENS * Math.min(1, wide * 1.1);
  }

  axes() {
    const { turn, tilt } = this;
    const back = [Math.cos(tilt) * Math.cos(turn), Math.cos(tilt) * Math.sin(turn), Math.sin(tilt)];
    const right = [-Math.sin(turn), Math.cos(turn), 0];
    return { right, up: cross(back, right), back };
  }

  eye() {
    const { back } = this.axes();
    return this.centre.map((c, k) => c + back[k] * this.away * this.size);
  }

  matrices(wide) {
    const { right, up, back } = this.axes();
    const eye = this.eye();
    const axes = [right, up, back];
    const view = [0, 1, 2].flatMap((k) => [...axes.map((a) => a[k]), 0]).concat(axes.map((a) => -dot(a, eye)), 1);
    const off = Math.hypot(...this.centre.map((c, k) => c - this.home[k]));
    const reach = 1.05 * this.size + off;
    const far = this.away * this.size + reach;
    const near = Math.max(this.away * this.size - reach, 0.002 * far);
    const lens = this.lens(wide);
    const projection = [lens / wide, 0, 0, 0, 0, lens, 0, 0, 0, 0, (near + far) / (near - far), -1,
      0, 0, 2 * near * far / (near - far), 0];
    return { view, projection };
  }

  orbit(dx, dy) {
    this.isFitted = false;
    this.turn -= dx * 0.008;
    this.tilt = clamp(this.tilt + dy * 0.008, -MAX_TILT, MAX_TILT);
  }

  // Moves by pixels of a picture of some height.
  pan(dx, dy, height) {
    this.isFitted = false;
    const { right, up } = this.axes();
    const scale = 2 * this.away * this.size / (LENS * height);
    this.centre = this.centre.map((c, k) => c + (up[k] * dy - right[k] * dx) * scale);
  }

  zoom(factor) {
    this.isFitted = false;
    this.away = clamp(this.away * factor, 0.02, 20);
  }

  // The state as text for the link, and back.
  text() {
    const shares = this.centre.map((c, k) => (c - this.home[k]) / this.size);
    return [this.turn, this.tilt, this.away, ...shares].map((v) => +v.toFixed(4)).join(",");
  }

  restore(text) {
    const v = text.split(",").map(Number);
    if (v.length !== 6 || !v.every(Number.isFinite)) return;
    this.isFitted = false;
    Object.assign(this, { turn: v[0], tilt: clamp(v[1], -MAX_TILT, MAX_TILT), away: clamp(v[2], 0.02, 20) });
    this.centre = this.home.map((c, k) => c + v[3 + k] * this.size);
  }
}
