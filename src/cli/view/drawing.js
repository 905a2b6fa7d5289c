// Drawing of bodies on a canvas: surfaces, the filled cut, edges, the box, and what lies under a pixel.
"use strict";

const NO_NUMBER = -2e30;
const NO_CUT = [0, 0, 1, 3e38];
const THEMES = {
  light: { back: [0.957, 0.965, 0.976], base: [0.70, 0.75, 0.81], cap: [0.93, 0.66, 0.38], ink: [0.1, 0.12, 0.16, 1], box: [0.45, 0.5, 0.58, 1] },
  dark: { back: [0.086, 0.098, 0.122], base: [0.62, 0.68, 0.75], cap: [0.80, 0.53, 0.27], ink: [0.02, 0.025, 0.035, 1], box: [0.55, 0.6, 0.68, 1] },
};
const ALARM = [0.95, 0.10, 0.30];

class Drawing {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = this.gl = canvas.getContext("webgl2", { antialias: true, stencil: true, preserveDrawingBuffer: false });
    if (!gl) throw new Error("this browser has no WebGL 2; Chrome, Edge, Firefox and Safari from 2023 on have it");
    const program = (shaders) => createProgram(gl, shaders);
    [this.surface, this.stencil, this.cap, this.lines, this.pick, this.pickCap] =
      [SURFACE, STENCIL, CAP, LINES, PICK, PICK_CAP].map(program);
    this.camera = new Camera();
    this.state = { cut: false, normal: [1, 0, 0], at: 0, field: -1, range: [0, 1], mark: NO_NUMBER, chosen: -1,
      shrink: 0, edges: false, box: false, theme: "light", filled: true };
    this.target = null;
    this.drawn = { triangles: 0, calls: 0 };
  }

  // Shows a body; `isSame` keeps the camera, for another state of the same part.
  show(body, isSame) {
    const gl = this.gl;
    if (this.geometry) {
      if (this.wire) gl.deleteBuffer(this.wire.index);
      deleteGeometry(gl, this.geometry);
    }
    this.body = body;
    this.wire = null;
    this.hidden = new Set();
    const sizes = { value: 2, shown: 1 };
    const n = body.vertices;
    const arrays = { position: body.positions, normal: body.normals, value: new Float32Array(2 * n), shown: Float32Array.from(body.part) };
    if (body.elements) arrays.centre = this.centres(body);
    this.geometry = createGeometry(gl, arrays, sizes, body.triangles);
    if (!body.elements) this.geometry.buffers.centre = this.geometry.buffers.position;
    this.boxLines = null;
    const high = body.low.map((c, k) => c + body.size[k]);
    if (isSame) this.camera.adopt(body.low, high);
    else this.camera.frame(body.low, high, this.wide());
    this.request();
  }

  // Width of the picture over its height.
  wide() {
    return this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
  }

  // The middle of each vertex's element, as shares of the box.
  centres(body) {
    const sums = new Float64Array(4 * body.parts);
    for (let v = 0; v < body.vertices; v++) {
      const at = 4 * body.part[v];
      for (let k = 0; k < 3; k++) sums[at + k] += body.positions[3 * v + k];
      sums[at + 3]++;
    }
    const centres = new Uint16Array(3 * body.vertices);
    for (let v = 0; v < body.vertices; v++) {
      const at = 4 * body.part[v];
      for (let k = 0; k < 3; k++) centres[3 * v + k] = sums[at + k] / sums[at + 3];
    }
    return centres;
  }

  // Colours by a field of the body; -1 for none.
  color(field) {
    this.state.field = field;
    if (field >= 0) {
      const { values, atParts } = this.body.fields[field];
      const data = new Float32Array(2 * this.body.vertices);
      for (let v = 0; v < this.body.vertices; v++) {
        const value = values[atParts ? this.body.part[v] : v];
        if (!Number.isNaN(value)) data.set([value, 1], 2 * v);
      }
      setAttribute(this.gl, this.geometry, "value", data, 2);
    }
    this.request();
  }

  toggle(part, visible) {
    if (visible) this.hidden.delete(part);
    else this.hidden.add(part);
    const data = Float32Array.from(this.body.part, (p) => this.hidden.has(p) ? -1 : p);
    setAttribute(this.gl, this.geometry, "shown", data, 1);
    this.request();
  }

  // The lines of elements, or the edges of triangles.
  edges() {
    const { body, gl } = this;
    if (!this.wire) {
      let index = body.lines;
      if (!index.length) {
        const t = body.triangles;
        index = new Uint32Array(2 * t.length);
        let n = 0;
        for (let k = 0; k < t.length; k += 3) {
          for (const [a, b] of [[t[k], t[k + 1]], [t[k + 1], t[k + 2]], [t[k + 2], t[k]]]) {
            if (a < b) { index[n++] = a; index[n++] = b; }
          }
        }
        index = index.subarray(0, n);
      }
      this.wire = { buffers: this.geometry.buffers, index: createBuffer(gl, gl.ELEMENT_ARRAY_BUFFER, index), count: index.length };
    }
    return this.wire;
  }

  plane() {
    const { cut, normal, at } = this.state;
    return cut ? [...normal, at] : NO_CUT;
  }

  // The range of the cut's position along its normal.
  cutRange() {
    const { low, size } = this.body;
    const ends = [0, 0];
    this.state.normal.forEach((c, k) => {
      const [a, b] = [c * low[k], c * (low[k] + size[k])];
      ends[0] += Math.min(a, b);
      ends[1] += Math.max(a, b);
    });
    return ends;
  }

  request() {
    this.stale = true;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  uniforms() {
    const { body, state, camera } = this;
    const field = body.fields[state.field];
    const theme = THEMES[state.theme];
    const { right, up, back } = camera.axes();
    const light = [0, 1, 2].map((k) => 0.35 * up[k] * 1.4 - 0.5 * right[k] + 0.8 * back[k]);
    const length = Math.hypot(...light);
    return {
      ...camera.matrices(this.wide()),
      low: body.low, size: body.size, plane: this.plane(), whole: body.elements ? 1 : 0, shrink: state.shrink,
      base: theme.base, eye: camera.eye(), alarm: ALARM, light: [...light.map((c) => c / length), 0],
      chosen: state.chosen, mode: !field ? 0 : field.labels ? 2 : 1, mark: state.mark, range: state.range,
      cap: theme.cap, spacing: camera.size * camera.away * 0.022, ink: theme.ink,
    };
  }

  draw() {
    const { gl, state, body } = this;
    resizeCanvas(this.canvas);
    if (!body) return;
    bindTarget(gl, null);
    const values = this.uniforms();
    this.drawn = { triangles: 0, calls: 0 };
    gl.clearColor(...THEMES[state.theme].back, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    this.put(this.surface, this.geometry, values, gl.TRIANGLES);
    if (this.fills()) this.fill(values, this.cap, [gl.BACK]);
    if (state.edges) this.put(this.lines, this.edges(), values, gl.LINES);
    if (state.box) this.drawBox(values);
    this.stale = true;
    this.onDraw?.();
  }

  put(program, geometry, values, mode) {
    drawGeometry(this.gl, program, geometry, values, mode);
    this.drawn.calls++;
    if (mode === this.gl.TRIANGLES) this.drawn.triangles += geometry.count / 3;
  }

  fills() {
    return this.state.cut && this.state.filled && this.body.closed && !this.body.elements;
  }

  // Fills the cut: where more back faces than front faces remain along a ray, the plane is in the solid. `buffers` are
  // the colours that the cut is drawn to.
  fill(values, program, buffers) {
    const gl = this.gl;
    gl.enable(gl.STENCIL_TEST);
    gl.drawBuffers(buffers.map(() => gl.NONE));
    gl.depthMask(false);
    gl.disable(gl.DEPTH_TEST);
    gl.stencilFunc(gl.ALWAYS, 0, 255);
    gl.stencilOpSeparate(gl.FRONT, gl.KEEP, gl.KEEP, gl.DECR_WRAP);
    gl.stencilOpSeparate(gl.BACK, gl.KEEP, gl.KEEP, gl.INCR_WRAP);
    this.put(this.stencil, this.geometry, values, gl.TRIANGLES);
    gl.drawBuffers(buffers);
    gl.depthMask(true);
    gl.enable(gl.DEPTH_TEST);
    gl.stencilFunc(gl.NOTEQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    const quad = createGeometry(gl, { position: this.planeQuad() });
    this.put(program, quad, values, gl.TRIANGLES);
    deleteGeometry(gl, quad);
    gl.disable(gl.STENCIL_TEST);
  }

  planeQuad() {
    const { normal, at } = this.state;
    const { home, size } = this.camera;
    const side = Math.abs(normal[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const u = cross(normal, side), v = cross(normal, u);
    const [lu, lv] = [Math.hypot(...u), Math.hypot(...v)];
    const off = at - dot(home, normal);
    const corner = (a, b) => [0, 1, 2].map((k) => home[k] + off * normal[k] + 1.1 * size * (a * u[k] / lu + b * v[k] / lv));
    const [p, q, r, s] = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
    return new Float32Array([...p, ...q, ...r, ...p, ...r, ...s]);
  }

  drawBox(values) {
    const gl = this.gl;
    if (!this.boxLines) {
      const corner = (n) => [n & 1, n >> 1 & 1, n >> 2 & 1];
      const ends = [];
      for (let a = 0; a < 8; a++) for (const bit of [1, 2, 4]) if (!(a & bit)) ends.push(...corner(a), ...corner(a | bit));
      this.boxLines = createGeometry(gl, { position: new Float32Array(ends), centre: new Float32Array(ends), shown: new Float32Array(24) }, { shown: 1 });
    }
    this.put(this.lines, this.boxLines, { ...values, whole: 0, shrink: 0, plane: NO_CUT, ink: THEMES[this.state.theme].box }, gl.LINES);
  }

  // The place, part and value under a point of the page, or null.
  under(x, y) {
    const { gl, canvas, body } = this;
    const frame = canvas.getBoundingClientRect();
    const scale = canvas.width / frame.width;
    const at = [Math.floor((x - frame.left) * scale), canvas.height - 1 - Math.floor((y - frame.top) * scale)];
    if (!body || at.some((v, k) => v < 0 || v >= [canvas.width, canvas.height][k])) return null;
    if (this.stale) this.drawPick();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.framebuffer);
    const [place, found] = [0, 1].map((k) => {
      const pixel = new Uint32Array(4);
      gl.readBuffer(gl.COLOR_ATTACHMENT0 + k);
      gl.readPixels(...at, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, pixel);
      return pixel;
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    if (!place[3]) return null;
    const point = body.low.map((c, k) => c + body.size[k] * place[k] / 65535);
    if (place[3] === 2) return { point, cap: true };
    const value = new Float32Array(new Uint32Array([found[0] | found[1] << 16]).buffer)[0];
    return { point, part: found[2] + 65536 * found[3], value: value > -1e30 ? value : NaN };
  }

  drawPick() {
    const { gl, canvas } = this;
    const { width, height } = canvas;
    if (this.target?.width !== width || this.target.height !== height) this.target = this.pickTarget(width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.framebuffer);
    gl.viewport(0, 0, width, height);
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
    gl.clearBufferuiv(gl.COLOR, 1, [0, 0, 0, 0]);
    gl.clearBufferfi(gl.DEPTH_STENCIL, 0, 1, 0);
    gl.enable(gl.DEPTH_TEST);
    const values = this.uniforms();
    drawGeometry(gl, this.pick, this.geometry, values, gl.TRIANGLES);
    if (this.fills()) this.fill(values, this.pickCap, [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.stale = false;
  }

  pickTarget(width, height) {
    const gl = this.gl;
    if (this.target) {
      gl.deleteFramebuffer(this.target.framebuffer);
      this.target.stores.forEach((s) => gl.deleteRenderbuffer(s));
    }
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    const store = (format, place) => {
      const made = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, made);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, made);
      return made;
    };
    const stores = [store(gl.RGBA16UI, gl.COLOR_ATTACHMENT0), store(gl.RGBA16UI, gl.COLOR_ATTACHMENT1),
      store(gl.DEPTH24_STENCIL8, gl.DEPTH_STENCIL_ATTACHMENT)];
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    return { framebuffer, stores, width, height };
  }

  // The picture as it is on the screen, as a PNG.
  picture() {
    this.draw();
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }
}
