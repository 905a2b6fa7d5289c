// From the numbers of the page to arrays; `scene.rs` writes them in the same order.
"use strict";

const NO_VALUE = 65535;

// Bytes that were compressed by zlib.
async function inflate(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  varint() {
    let [value, shift, byte] = [0, 0, 0];
    do {
      byte = this.bytes[this.at++];
      value |= (byte & 127) << shift;
      shift += 7;
    } while (byte & 128);
    return value >>> 0;
  }

  signed() {
    const n = this.varint();
    return (n >>> 1) ^ -(n & 1);
  }

  // Words from differences; `put` gets each with its place.
  words(count, put) {
    const { bytes, at } = this;
    let word = 0;
    for (let k = 0; k < count; k++) {
      const n = bytes[at + k] | bytes[at + count + k] << 8;
      word = word + ((n >>> 1) ^ -(n & 1)) & 65535;
      put(k, word);
    }
    this.at += 2 * count;
  }

  differences(count) {
    const numbers = new Uint32Array(count);
    let before = 0;
    for (let k = 0; k < count; k++) numbers[k] = before += this.signed();
    return numbers;
  }

  body(about) {
    const n = about.vertices;
    const positions = new Uint16Array(3 * n);
    for (let axis = 0; axis < 3; axis++) this.words(n, (k, word) => { positions[3 * k + axis] = word; });
    const normals = new Int8Array(3 * n);
    for (let axis = 0; axis < 3; axis++) {
      for (let k = 0; k < n; k++) normals[3 * k + axis] = this.bytes[this.at++];
    }
    const triangles = new Uint32Array(3 * about.triangles);
    let next = 0;
    for (let k = 0; k < triangles.length; k++) {
      triangles[k] = next - this.signed();
      if (triangles[k] >= next) next = triangles[k] + 1;
    }
    const parts = this.differences(n);
    const lines = this.differences(2 * about.lines);
    const numbers = this.differences(about.numbers);
    const fields = about.fields.map((field) => {
      const values = new Float32Array(field.atParts ? about.parts : n);
      const step = (field.high - field.low) / 65534;
      this.words(values.length, (k, word) => { values[k] = word === NO_VALUE ? NaN : field.low + step * word; });
      return { ...field, values };
    });
    return { ...about, positions, normals, triangles, part: parts, lines, numbers, fields };
  }
}

// All bodies of a page.
async function decode(about, packed) {
  const reader = new Reader(await inflate(packed));
  return about.bodies.map((body) => reader.body(body));
}
