
// A slice of the grid on the plane of the cut, with the value under the pointer.

const SLICE_PIXELS = 360;

class Slice {
  constructor() {
    this.box = make("figure", { id: "slice", hidden: true });
    this.canvas = make("canvas", { width: 1, height: 1 });
    this.canvas.setAttribute("aria-label", "Slice of the level set: distances from the surface");
    this.canvas.setAttribute("role", "img");
    this.text = make("figcaption", {});
    this.box.append(this.canvas, this.text);
    document.querySelector("main").append(this.box);
    this.canvas.onpointermove = (e) => this.pick(e);
    this.canvas.onpointerleave = () => this.caption();
  }

  toggle(visible) {
    this.box.hidden = !visible;
    this.update();
  }

  // Requests the slice of the cut; the newest place wins.
  async update() {
    if (this.box.hidden) return;
    if (axis === "view") {
      this.text.textContent = "slices are across x, y or z";
      return;
    }
    this.wanted = JSON.stringify({ axis, at: side * drawing.state.at, pixels: SLICE_PIXELS });
    if (this.busy) return;
    this.busy = true;
    while (this.wanted) {
      const body = this.wanted;
      this.wanted = null;
      const answer = await ask("slice", body);
      if (answer) this.show(await answer.arrayBuffer());
    }
    this.busy = false;
  }

  show(buffer) {
    const { about, offset } = readHead(buffer);
    this.about = about;
    this.values = new Float32Array(buffer, offset);
    const { width, height } = about;
    Object.assign(this.canvas, { width, height });
    const picture = new ImageData(width, height);
    const limit = this.values.reduce((m, v) => Math.max(m, Math.abs(v)), 0) || 1;
    for (let row = 0; row < height; row++) {
      for (let k = 0; k < width; k++) {
        const value = this.values[row * width + k];
        const depth = 1 - Math.min(1, Math.abs(value) / limit);
        const color = value < 0 ? [238, 150 + 60 * depth, 60 + 110 * depth] : [205 + 40 * depth, 214 + 32 * depth, 228 + 20 * depth];
        const next = [k + 1 < width ? this.values[row * width + k + 1] : value, row + 1 < height ? this.values[(row + 1) * width + k] : value];
        const isEdge = next.some((v) => (v < 0) !== (value < 0));
        picture.data.set([...(isEdge ? [30, 36, 48] : color), 255], 4 * ((height - 1 - row) * width + k));
      }
    }
    this.canvas.getContext("2d").putImageData(picture, 0, 0);
    this.caption();
  }

  caption() {
    if (!this.about) return;
    const solid = this.values.reduce((n, v) => n + (v < 0), 0) * this.about.step ** 2;
    const place = `${"xyz"[this.about.axis]} = ${lengthText(this.about.at)}`;
    this.text.textContent = `${withUnit(place, scene.unit)}, solid ${withUnit(numberText(solid), scene.unit && `${scene.unit}²`)}`;
  }

  pick(e) {
    if (!this.about) return;
    const { width, height, low, step, axis: across, at } = this.about;
    const frame = this.canvas.getBoundingClientRect();
    const k = Math.floor((e.clientX - frame.left) / frame.width * width);
    const row = height - 1 - Math.floor((e.clientY - frame.top) / frame.height * height);
    const value = this.values[row * width + k];
    if (value === undefined) return;
    const place = [low[0] + (k + 0.5) * step, low[1] + (row + 0.5) * step];
    place.splice(across, 0, at);
    this.text.textContent = `${withUnit(`(${place.map(lengthText).join(", ")})`, scene.unit)}: ${withUnit(numberText(value), scene.unit)}`;
  }
}
