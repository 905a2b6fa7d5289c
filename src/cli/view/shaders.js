// Programs of the page. A value has a weight of 1, no value one of 0, so that values at the border of places without
// one are not falsified by the interpolation. Positions are shares of the body's box; the cut keeps points p with dot(p, plane.xyz) below
// plane.w. The place is taken at the covered part of a pixel (centroid): beyond an outline it would be extrapolated.
"use strict";

// Value to colour: for numbers from dark violet to yellow (a polynomial close to viridis, by Matt Zucker, CC0), for
// categories hues by the golden ratio.
const COLORS = `
vec3 ramp(float t) {
  const vec3 a = vec3(0.2777, 0.0054, 0.3341), b = vec3(0.1051, 1.4046, 1.3846), c = vec3(-0.3309, 0.2148, 0.0951),
    d = vec3(-4.6342, -5.7991, -19.3324), e = vec3(6.2283, 14.1799, 56.6906), f = vec3(4.7764, -13.7451, -65.3530),
    g = vec3(-5.4355, 4.6459, 26.3124);
  return clamp(a + t * (b + t * (c + t * (d + t * (e + t * (f + t * g))))), 0.0, 1.0);
}
vec3 hue(float n) {
  vec3 k = abs(fract(n * 0.61803 + 0.58 + vec3(0.0, 0.6667, 0.3333)) * 6.0 - 3.0) - 1.0;
  return mix(vec3(0.93), clamp(k, 0.0, 1.0), 0.55) * (0.95 - 0.12 * mod(n, 3.0) / 2.0);
}`;

const SURFACE_VERTEX = `#version 300 es
precision highp float;
in vec3 position; in vec3 normal; in vec2 value; in float shown; in vec3 centre;
uniform mat4 view, projection; uniform vec3 low, size; uniform vec4 plane; uniform float whole, shrink;
centroid out vec3 world; centroid out vec2 shade; out vec3 share, facing; flat out float number;
void main() {
  share = position;
  world = low + size * mix(position, centre, whole * shrink);
  facing = normal;
  shade = value;
  number = shown;
  vec3 middle = low + size * centre;
  bool away = whole > 0.5 && dot(middle, plane.xyz) > plane.w;
  gl_Position = shown < 0.0 || away ? vec4(2.0, 2.0, 2.0, 1.0) : projection * view * vec4(world, 1.0);
}`;

const DISCARD = `if (whole < 0.5 && dot(world, plane.xyz) > plane.w) discard;`;

const SURFACE = [SURFACE_VERTEX, `#version 300 es
precision highp float;
centroid in vec3 world; centroid in vec2 shade; in vec3 share, facing; flat in float number;
uniform vec3 base, eye, alarm; uniform vec4 plane, light; uniform float whole, chosen, mode, mark; uniform vec2 range;
out vec4 pixel;
${COLORS}
void main() {
  ${DISCARD}
  vec3 tint = base;
  if (mode > 0.5) {
    float v = shade.x / max(shade.y, 1e-3);
    float width = max(range.y - range.x, 1e-5 * abs(range.y) + 1e-30);
    if (shade.y < 0.3) tint = mix(base, vec3(0.5), 0.6);
    else if (mode > 1.5) tint = hue(floor(v + 0.5));
    else tint = v < mark ? alarm : ramp(clamp((v - range.x) / width, 0.0, 1.0));
  }
  vec3 n = normalize(facing);
  vec3 towards = normalize(eye - world);
  bool back = !gl_FrontFacing;
  if (back) n = -n;
  float sky = 0.5 + 0.5 * n.z;
  float key = max(dot(n, light.xyz), 0.0);
  float head = max(dot(n, towards), 0.0);
  float gleam = pow(max(dot(n, normalize(light.xyz + towards)), 0.0), 40.0);
  vec3 lit = tint * (0.20 + 0.16 * sky + 0.44 * key + 0.30 * head) + 0.10 * gleam;
  if (back) lit = mix(lit, base * 0.45, 0.5);
  if (chosen >= 0.0) lit = number == chosen ? mix(lit, vec3(1.0, 0.62, 0.1), 0.55) : lit * 0.55 + base * 0.12;
  pixel = vec4(pow(lit, vec3(0.9)), 1.0);
}`];

const STENCIL = [SURFACE_VERTEX, `#version 300 es
precision highp float;
centroid in vec3 world; uniform vec4 plane; uniform float whole; out vec4 pixel;
void main() { ${DISCARD} pixel = vec4(0.0); }`];

// The filled cut: a plane with stripes of constant width in the part.
const CAP = [`#version 300 es
precision highp float;
in vec3 position; uniform mat4 view, projection; out vec3 world;
void main() { world = position; gl_Position = projection * view * vec4(position, 1.0); }`, `#version 300 es
precision highp float;
in vec3 world; uniform vec3 cap; uniform vec4 plane; uniform float spacing; out vec4 pixel;
void main() {
  vec3 a = abs(plane.xyz);
  vec3 along = a.z > 0.7 ? vec3(1.0, 1.0, 0.0) : a.y > 0.7 ? vec3(1.0, 0.0, 1.0) : vec3(0.0, 1.0, 1.0);
  float f = dot(world, along) / spacing, w = fwidth(f);
  float line = smoothstep(0.5 - w, 0.5 + w, abs(fract(f) - 0.5) * 2.0) * 0.5 + 0.25;
  pixel = vec4(cap * mix(0.86, 1.0, mix(line, 0.5, clamp(w * 2.0, 0.0, 1.0))), 1.0);
}`];

const LINES = [`#version 300 es
precision highp float;
in vec3 position; in float shown; in vec3 centre;
uniform mat4 view, projection; uniform vec3 low, size; uniform vec4 plane; uniform float whole, shrink;
out vec3 world;
void main() {
  world = low + size * mix(position, centre, whole * shrink);
  bool away = whole > 0.5 && dot(low + size * centre, plane.xyz) > plane.w;
  gl_Position = shown < 0.0 || away ? vec4(2.0, 2.0, 2.0, 1.0) : projection * view * vec4(world, 1.0);
  gl_Position.z -= 0.0005 * gl_Position.w;
}`, `#version 300 es
precision highp float;
in vec3 world; uniform vec4 plane, ink; uniform float whole; out vec4 pixel;
void main() { ${DISCARD} pixel = ink; }`];

// Place, value and part of each pixel, exact to the bit; kind 1 is the surface, 2 the filled cut.
const PICK = [SURFACE_VERTEX, `#version 300 es
precision highp float; precision highp int;
centroid in vec3 world; centroid in vec2 shade; in vec3 share; flat in float number; uniform vec4 plane; uniform float whole;
layout(location = 0) out uvec4 place; layout(location = 1) out uvec4 found;
void main() {
  ${DISCARD}
  uint bits = floatBitsToUint(shade.y < 0.3 ? -2e30 : shade.x / shade.y);
  uvec3 s = uvec3(clamp(share, 0.0, 1.0) * 65535.0 + 0.5);
  uint part = uint(number);
  place = uvec4(s, 1u);
  found = uvec4(bits & 65535u, bits >> 16, part & 65535u, part >> 16);
}`];

const PICK_CAP = [CAP[0], `#version 300 es
precision highp float; precision highp int;
in vec3 world; uniform vec3 low, size;
layout(location = 0) out uvec4 place; layout(location = 1) out uvec4 found;
void main() {
  vec3 share = (world - low) / max(size, vec3(1e-30));
  place = uvec4(uvec3(clamp(share, 0.0, 1.0) * 65535.0 + 0.5), 2u);
  found = uvec4(0u);
}`];

// The same colours outside of shaders, as CSS.
function rampColor(t) {
  const c = [[0.2777, 0.0054, 0.3341], [0.1051, 1.4046, 1.3846], [-0.3309, 0.2148, 0.0951], [-4.6342, -5.7991, -19.3324],
    [6.2283, 14.1799, 56.6906], [4.7764, -13.7451, -65.3530], [-5.4355, 4.6459, 26.3124]];
  const rgb = [0, 1, 2].map((k) => c.reduceRight((sum, row) => sum * t + row[k], 0));
  return `rgb(${rgb.map((v) => Math.round(255 * Math.max(0, Math.min(1, v)))).join(" ")})`;
}

function hueColor(n) {
  const fract = (v) => v - Math.floor(v);
  const rgb = [0, 0.6667, 0.3333].map((o) => {
    const k = Math.max(0, Math.min(1, Math.abs(fract(n * 0.61803 + 0.58 + o) * 6 - 3) - 1));
    return (0.93 * 0.45 + k * 0.55) * (0.95 - 0.12 * (n % 3) / 2);
  });
  return `rgb(${rgb.map((v) => Math.round(255 * v)).join(" ")})`;
}
