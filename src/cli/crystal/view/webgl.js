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

// Vertex buffers from arrays of floats by attribute name; `sizes` has the components of each, 3 where it has none.
function createGeometry(gl, arrays, sizes = {}) {
  const buffers = {};
  let count = 0;
  for (const [name, data] of Object.entries(arrays)) {
    const [buffer, size] = [gl.createBuffer(), sizes[name] ?? 3];
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    buffers[name] = { buffer, size };
    count = data.length / size;
  }
  return { buffers, count };
}

function deleteGeometry(gl, geometry) {
  Object.values(geometry.buffers).forEach(({ buffer }) => gl.deleteBuffer(buffer));
}

// Draws a geometry as gl.TRIANGLES or gl.LINES. Uniforms are numbers and 4 x 4 matrices in order of columns.
function drawGeometry(gl, { program, attributes, uniforms }, geometry, values, mode) {
  gl.useProgram(program);
  for (const [name, place] of attributes) {
    const { buffer, size } = geometry.buffers[name];
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
  }
  for (const [name, place] of uniforms) {
    if (typeof values[name] === "number") gl.uniform1f(place, values[name]);
    else gl.uniformMatrix4fv(place, false, values[name]);
  }
  gl.drawArrays(mode, 0, geometry.count);
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
