// The few operations on WebGL 2 that the page needs: programs, vertex buffers, and a frame buffer to read back.
"use strict";

// A program of a vertex and a fragment shader, with the places of its attributes and uniforms by name.
function createProgram(gl, sources) {
  const program = gl.createProgram();
  [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((type, k) => {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, sources[k]);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
    gl.deleteShader(shader);
  });
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  const named = (kind, get, locate) => {
    const count = gl.getProgramParameter(program, kind);
    const names = Array.from({ length: count }, (_, k) => get.call(gl, program, k).name);
    return names.map((name) => [name, locate.call(gl, program, name)]);
  };
  return {
    program,
    attributes: named(gl.ACTIVE_ATTRIBUTES, gl.getActiveAttrib, gl.getAttribLocation),
    uniforms: named(gl.ACTIVE_UNIFORMS, gl.getActiveUniform, gl.getUniformLocation),
  };
}

// The types of arrays as vertex attributes; integers are shares of their greatest value.
function attributeType(gl, data) {
  if (data instanceof Uint16Array) return [gl.UNSIGNED_SHORT, true];
  if (data instanceof Int8Array) return [gl.BYTE, true];
  return [gl.FLOAT, false];
}

function createBuffer(gl, target, data) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(target, buffer);
  gl.bufferData(target, data, gl.STATIC_DRAW);
  return buffer;
}

// Vertex buffers from arrays by attribute name; `sizes` has the components of each, 3 where it has none. `index` has
// the vertices to draw, if they are not all in order.
function createGeometry(gl, arrays, sizes = {}, index = null) {
  const geometry = { buffers: {}, count: 0, index: null };
  for (const [name, data] of Object.entries(arrays)) setAttribute(gl, geometry, name, data, sizes[name] ?? 3);
  if (index) {
    geometry.index = createBuffer(gl, gl.ELEMENT_ARRAY_BUFFER, index);
    geometry.count = index.length;
  }
  return geometry;
}

// Adds or replaces an attribute.
function setAttribute(gl, geometry, name, data, size) {
  if (geometry.buffers[name]) gl.deleteBuffer(geometry.buffers[name].buffer);
  const [type, normalized] = attributeType(gl, data);
  geometry.buffers[name] = { buffer: createBuffer(gl, gl.ARRAY_BUFFER, data), size, type, normalized };
  if (!geometry.index) geometry.count = data.length / size;
}

function deleteGeometry(gl, geometry) {
  Object.values(geometry.buffers).forEach(({ buffer }) => gl.deleteBuffer(buffer));
  if (geometry.index) gl.deleteBuffer(geometry.index);
}

// Draws a geometry as gl.TRIANGLES or gl.LINES. Uniforms are numbers, vectors, and 4 x 4 matrices in order of columns.
function drawGeometry(gl, { program, attributes, uniforms }, geometry, values, mode) {
  gl.useProgram(program);
  for (const [name, place] of attributes) {
    const { buffer, size, type, normalized } = geometry.buffers[name];
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalized, 0, 0);
  }
  for (const [name, place] of uniforms) {
    const value = values[name];
    if (typeof value === "number") gl.uniform1f(place, value);
    else if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
    else gl[`uniform${value.length}fv`](place, value);
  }
  if (geometry.index) {
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, geometry.index);
    gl.drawElements(mode, geometry.count, gl.UNSIGNED_INT, 0);
  } else {
    gl.drawArrays(mode, 0, geometry.count);
  }
  for (const [, place] of attributes) gl.disableVertexAttribArray(place);
}

// A frame buffer of colour and depth in the size of the canvas.
function createFramebuffer(gl) {
  const made = { framebuffer: gl.createFramebuffer(), color: gl.createRenderbuffer(), depth: gl.createRenderbuffer() };
  resizeFramebuffer(gl, made);
  gl.bindFramebuffer(gl.FRAMEBUFFER, made.framebuffer);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, made.color);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, made.depth);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return made;
}

function resizeFramebuffer(gl, { color, depth }) {
  for (const [renderbuffer, format] of [[color, gl.RGBA8], [depth, gl.DEPTH_COMPONENT24]]) {
    gl.bindRenderbuffer(gl.RENDERBUFFER, renderbuffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, format, gl.drawingBufferWidth, gl.drawingBufferHeight);
  }
}

// Draws from now on into a frame buffer, or onto the canvas.
function bindTarget(gl, target) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, target?.framebuffer ?? null);
  gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
}

// Gives the canvas a pixel for each pixel of the screen; whether its size changed.
function resizeCanvas(canvas) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((n) => Math.floor(n * window.devicePixelRatio));
  if (canvas.width === width && canvas.height === height) return false;
  Object.assign(canvas, { width, height });
  return true;
}
