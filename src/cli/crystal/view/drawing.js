// Drawing of the model on a canvas: faces in the colours of their groups, edges, and picking of faces.
"use strict";

const FACES = [`#version 300 es
in vec3 position; in vec3 normal; in vec3 color; in float face; in float group;
uniform mat4 view, projection; uniform float hovered, chosen;
out vec3 tint; out float shade;
void main() {
  gl_Position = projection * view * vec4(position, 1.0);
  vec3 n = mat3(view) * normal;
  shade = 0.42 + 0.58 * clamp(dot(n, normalize(vec3(0.35, 0.55, 0.85))), 0.0, 1.0);
  float lit = face == hovered ? 0.6 : group == chosen ? 0.3 : 0.0;
  tint = mix(color, vec3(1.0, 1.0, 0.95), lit);
}`, `#version 300 es
precision highp float;
in vec3 tint; in float shade; out vec4 pixel;
void main() { pixel = vec4(tint * shade, 1.0); }`];

const EDGES = [`#version 300 es
in vec3 position; uniform mat4 view, projection;
void main() {
  gl_Position = projection * view * vec4(position, 1.0);
  gl_Position.z -= 0.0004 * gl_Position.w;
}`, `#version 300 es
precision highp float;
out vec4 pixel; uniform vec3 ink;
void main() { pixel = vec4(ink, 1.0); }`];

// The number of a face, from 1, in red, green and blue.
const NUMBERS = [`#version 300 es
in vec3 position; in float face; uniform mat4 view, projection; flat out int number;
void main() { gl_Position = projection * view * vec4(position, 1.0); number = int(face) + 1; }`, `#version 300 es
precision highp float;
flat in int number; out vec4 pixel;
void main() { pixel = vec4(number & 255, (number >> 8) & 255, (number >> 16) & 255, 255) / 255.0; }`];

const THEMES = { light: { back: [0.957, 0.965, 0.976], ink: [0.1, 0.11, 0.16] }, dark: { back: [0.086, 0.098, 0.122], ink: [0.02, 0.025, 0.035] } };
// Where the camera stands at first.
const HOME = [0.6, 0.45];

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((c) => c / l); };

// Decodes a model from the bytes of the server.
function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  if (!about.drawn) return { about };
  const { vertices, triangles, edges, faces } = about.counts;
  let at = 4 + length;
  const take = (Kind, count) => { const part = new Kind(buffer, at, count); at += 4 * count; return part; };
  return {
    about,
    positions: take(Float32Array, 3 * vertices),
    triangles: take(Uint32Array, 3 * triangles),
    owners: take(Uint32Array, triangles),
    edges: take(Uint32Array, 2 * edges),
    groups: take(Uint32Array, faces),
  };
}

class Drawing {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl2", { antialias: true });
    if (!this.gl) throw new Error("this browser has no WebGL 2");
    const program = (shaders) => createProgram(this.gl, shaders);
    [this.faces, this.edges, this.numbers] = [FACES, EDGES, NUMBERS].map(program);
    this.hidden = createFramebuffer(this.gl);
    Object.assign(this, { hovered: -1, chosen: 0, camera: new Camera(), state: { theme: "light", edges: true } });
  }

  // Sets the model; fits the view to it if required.
  show(model, look) {
    for (const old of [this.solid, this.wire]) {
      if (old) deleteGeometry(this.gl, old);
    }
    this.solid = this.wire = null;
    this.model = model;
    if (!model.about.drawn) return this.draw();
    const { positions, triangles, owners, edges, groups } = model;
    const colors = Object.fromEntries(model.about.groups.map((g) => [g.group, g.color]));
    const n = triangles.length;
    const flat = { position: new Float32Array(3 * n), normal: new Float32Array(3 * n), color: new Float32Array(3 * n) };
    const [face, group] = [new Float32Array(n), new Float32Array(n)];
    const point = (v) => positions.subarray(3 * v, 3 * v + 3);
    for (let t = 0; t < n; t += 3) {
      const corners = [0, 1, 2].map((k) => point(triangles[t + k]));
      const normal = unit(cross(minus(corners[1], corners[0]), minus(corners[2], corners[0])));
      const owner = owners[t / 3];
      for (let k = 0; k < 3; k++) {
        flat.position.set(corners[k], 3 * (t + k));
        flat.normal.set(normal, 3 * (t + k));
        flat.color.set(colors[groups[owner]], 3 * (t + k));
        face[t + k] = owner;
        group[t + k] = groups[owner];
      }
    }
    const lines = new Float32Array(3 * edges.length);
    edges.forEach((v, k) => lines.set(point(v), 3 * k));
    this.solid = createGeometry(this.gl, { ...flat, face, group }, { face: 1, group: 1 });
    this.wire = createGeometry(this.gl, { position: lines });
    this.frame(look);
    this.draw();
  }

  // Width of the picture over its height.
  wide() {
    return this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
  }

  // Takes the box of the model; shows all of it if required.
  frame(look) {
    const { positions, triangles } = this.model;
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (const v of triangles) {
      for (let k = 0; k < 3; k++) {
        low[k] = Math.min(low[k], positions[3 * v + k]);
        high[k] = Math.max(high[k], positions[3 * v + k]);
      }
    }
    if (!triangles.length) return;
    if (!look) return this.camera.adopt(low, high);
    this.camera.frame(low, high, this.wide());
    this.home();
  }

  home() {
    this.camera.face(...HOME, this.wide());
  }

  request() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  draw() {
    const gl = this.gl;
    if (resizeCanvas(this.canvas)) resizeFramebuffer(gl, this.hidden);
    bindTarget(gl, null);
    const theme = THEMES[this.state.theme];
    gl.clearColor(...theme.back, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.stale = true;
    if (!this.solid) return;
    gl.enable(gl.DEPTH_TEST);
    const camera = this.camera.matrices(this.wide());
    const lit = { hovered: this.hovered, chosen: this.chosen };
    drawGeometry(gl, this.faces, this.solid, { ...camera, ...lit }, gl.TRIANGLES);
    if (this.state.edges) drawGeometry(gl, this.edges, this.wire, { ...camera, ink: theme.ink }, gl.LINES);
    this.onDraw?.();
  }

  // The face under a point of the page, or -1.
  under(x, y) {
    if (!this.solid) return -1;
    const gl = this.gl;
    const box = this.canvas.getBoundingClientRect();
    const scale = this.canvas.width / box.width;
    const at = [Math.floor((x - box.left) * scale), this.canvas.height - 1 - Math.floor((y - box.top) * scale)];
    bindTarget(gl, this.hidden);
    if (this.stale) {
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      drawGeometry(gl, this.numbers, this.solid, this.camera.matrices(this.wide()), gl.TRIANGLES);
      this.stale = false;
    }
    const pixel = new Uint8Array(4);
    gl.readPixels(...at, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    bindTarget(gl, null);
    return pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1;
  }

  // Draws with another face or group highlighted.
  light(face, group) {
    if (face === this.hovered && group === this.chosen) return;
    const kept = this.stale;
    Object.assign(this, { hovered: face, chosen: group });
    this.draw();
    this.stale = kept;
  }

  // The picture as it is on the screen, as a PNG.
  picture() {
    this.draw();
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }
}
