// Reads mesh files into typed arrays, so that a mesh turns before the server has seen it:
// { positions: [x, y, z, …], starts, corners (face f has corners[starts[f]] … corners[starts[f + 1] - 1]), uvs (a pair a
// corner) or null, segments (a number a face) or null }.

import { welded } from "/web/weld.js";

const SIZES = { char: 1, uchar: 1, int8: 1, uint8: 1, short: 2, ushort: 2, int16: 2, uint16: 2, int: 4, uint: 4, int32: 4, uint32: 4, float: 4, float32: 4, double: 8, float64: 8 };
const READERS = { char: "getInt8", uchar: "getUint8", int8: "getInt8", uint8: "getUint8", short: "getInt16", ushort: "getUint16", int16: "getInt16", uint16: "getUint16", int: "getInt32", uint: "getUint32", int32: "getInt32", uint32: "getUint32", float: "getFloat32", float32: "getFloat32", double: "getFloat64", float64: "getFloat64" };

// An array that grows.
class Growing {
  constructor(Kind, room = 1024) { [this.values, this.length] = [new Kind(room), 0]; }

  push(value) {
    if (this.length === this.values.length) {
      const larger = new this.values.constructor(2 * this.values.length);
      larger.set(this.values);
      this.values = larger;
    }
    this.values[this.length++] = value;
  }

  done() { return this.values.subarray(0, this.length); }
}

// Numbers out of bytes: `parseFloat` on a string of each would take ten times as long.
class Scanner {
  constructor(bytes, at = 0) { [this.bytes, this.at] = [bytes, at]; }

  get ended() { return this.at >= this.bytes.length; }

  // Skips blanks, but no line end.
  blanks() {
    while (this.bytes[this.at] === 32 || this.bytes[this.at] === 9 || this.bytes[this.at] === 13) this.at++;
    return this.bytes[this.at];
  }

  space() {
    for (;;) {
      while (this.bytes[this.at] <= 32) this.at++;
      if (this.bytes[this.at] !== 35) return;
      this.line();
    }
  }

  line() {
    while (this.at < this.bytes.length && this.bytes[this.at] !== 10) this.at++;
    this.at++;
  }

  word() {
    this.space();
    const from = this.at;
    while (this.bytes[this.at] > 32) this.at++;
    return String.fromCharCode(...this.bytes.subarray(from, Math.min(this.at, from + 64)));
  }

  number() {
    const { bytes } = this;
    let sign = 1;
    if (bytes[this.at] === 45) { sign = -1; this.at++; } else if (bytes[this.at] === 43) this.at++;
    let [value, exponent] = [0, 0];
    const from = this.at;
    for (; bytes[this.at] >= 48 && bytes[this.at] <= 57; this.at++) value = 10 * value + bytes[this.at] - 48;
    if (bytes[this.at] === 46) {
      this.at++;
      for (; bytes[this.at] >= 48 && bytes[this.at] <= 57; this.at++, exponent--) value = 10 * value + bytes[this.at] - 48;
    }
    if (this.at === from) throw new Error("expected a number");
    if (bytes[this.at] === 101 || bytes[this.at] === 69) { this.at++; exponent += this.number(); }
    return sign * (exponent ? value * 10 ** exponent : value);
  }

  next() { this.space(); return this.number(); }
}

const latin = (bytes) => new TextDecoder("latin1").decode(bytes);

// ---- PLY

function elements(header) {
  const found = [];
  for (const words of header.split("\n").map((line) => line.trim().split(/\s+/))) {
    if (words[0] === "element") found.push({ name: words[1], count: Number(words[2]), properties: [] });
    if (words[0] === "property") found.at(-1)?.properties.push(words[1] === "list" ? { name: words[4], type: words[3], count: words[2] } : { name: words[2], type: words[1] });
  }
  return found;
}

// A function that reads the next value of a type.
function source(buffer, at, kind) {
  if (kind === "ascii") {
    const scanner = new Scanner(new Uint8Array(buffer), at);
    return () => scanner.next();
  }
  const view = new DataView(buffer);
  const little = kind === "binary_little_endian";
  return (type) => { const value = view[READERS[type]](at, little); at += SIZES[type]; return value; };
}

export function readPly(buffer) {
  const head = latin(new Uint8Array(buffer, 0, Math.min(buffer.byteLength, 65536)));
  const end = head.indexOf("end_header");
  if (end < 0) throw new Error("expected end_header");
  const header = head.slice(0, end);
  const next = source(buffer, head.indexOf("\n", end) + 1, /format\s+(\S+)/.exec(header)?.[1]);
  const [positions, corners, starts, uvs, segments] = [new Growing(Float64Array), new Growing(Uint32Array), new Growing(Uint32Array), new Growing(Float32Array), new Growing(Int32Array)];
  starts.push(0);
  for (const { name, count, properties } of elements(header)) {
    const sink = properties.map((p) => {
      if (name === "vertex" && p.count === undefined && ["x", "y", "z"].includes(p.name)) return positions;
      if (name !== "face") return null;
      if (p.count !== undefined && /^vertex_ind/.test(p.name)) return corners;
      if (p.count !== undefined && /^texcoords?$/.test(p.name)) return uvs;
      return p.name === "segment" ? segments : null;
    });
    for (let k = 0; k < count; k++) {
      for (let p = 0; p < properties.length; p++) {
        const { type, count: list } = properties[p];
        const to = sink[p];
        for (let n = list === undefined ? 1 : next(list); n > 0; n--) { const value = next(type); if (to) to.push(value); }
        if (to === corners) starts.push(corners.length);
      }
    }
  }
  return finished(positions, starts, corners, uvs.length === 2 * corners.length ? uvs : null, segments.length === starts.length - 1 ? segments : null);
}

function finished(positions, starts, corners, uvs = null, segments = null) {
  const mesh = { positions: positions.done(), starts: starts.done(), corners: corners.done(), uvs: uvs?.length ? uvs.done() : null, segments: segments?.length ? segments.done() : null };
  const vertices = mesh.positions.length / 3;
  if (mesh.corners.length === 0 || mesh.corners.some((v) => v >= vertices)) throw new Error("expected faces of vertices that are there");
  return mesh;
}

// ---- OBJ

function readObj(buffer) {
  const scanner = new Scanner(new Uint8Array(buffer));
  const [positions, corners, starts, texture, uvs] = [new Growing(Float64Array), new Growing(Uint32Array), new Growing(Uint32Array), new Growing(Float32Array), new Growing(Float32Array)];
  starts.push(0);
  let full = true;
  // The number behind a word, of those there were: from 1, or below 0 from the last.
  const index = (there) => { const n = scanner.number(); return n < 0 ? there + n : n - 1; };
  const face = () => {
    for (let c = scanner.blanks(); c === 45 || (c >= 48 && c <= 57); c = scanner.blanks()) {
      corners.push(index(positions.length / 3));
      let uv = -1;
      for (let part = 1; scanner.bytes[scanner.at] === 47; part++) {
        scanner.at++;
        if (scanner.bytes[scanner.at] === 47 || scanner.bytes[scanner.at] <= 32) continue;
        const value = index(texture.length / 2);
        if (part === 1) uv = value;
      }
      full &&= uv >= 0 && 2 * uv + 1 < texture.length;
      if (full) { uvs.push(texture.values[2 * uv]); uvs.push(texture.values[2 * uv + 1]); }
    }
    starts.push(corners.length);
  };
  while (!scanner.ended) {
    const [a, b] = [scanner.blanks(), scanner.bytes[scanner.at + 1]];
    if (a === 118 && b <= 32) {
      scanner.at++;
      for (let k = 0; k < 3; k++) { scanner.blanks(); positions.push(scanner.number()); }
    } else if (a === 118 && b === 116) {
      scanner.at += 2;
      for (let k = 0; k < 2; k++) { const c = scanner.blanks(); texture.push(c > 32 && c !== undefined ? scanner.number() : 0); }
    } else if (a === 102 && b <= 32) { scanner.at++; face(); }
    scanner.line();
  }
  return finished(positions, starts, corners, full && uvs.length === 2 * corners.length ? uvs : null);
}

// ---- STL and OFF

function readStl(buffer) {
  const view = new DataView(buffer);
  const count = buffer.byteLength >= 84 ? view.getUint32(80, true) : 0;
  let soup;
  if (buffer.byteLength === 84 + 50 * count) {
    soup = new Float64Array(9 * count);
    for (let t = 0; t < count; t++) for (let k = 0; k < 9; k++) soup[9 * t + k] = view.getFloat32(84 + 50 * t + 12 + 4 * k, true);
  } else {
    const points = new Growing(Float64Array);
    const scanner = new Scanner(new Uint8Array(buffer));
    while (!scanner.ended) if (scanner.word() === "vertex") for (let k = 0; k < 3; k++) points.push(scanner.next());
    soup = points.done();
  }
  if (soup.length === 0) throw new Error("expected triangles");
  const { positions, corners } = welded(soup);
  return { positions, corners, starts: Uint32Array.from({ length: corners.length / 3 + 1 }, (_, k) => 3 * k), uvs: null, segments: null };
}

function readOff(buffer) {
  const scanner = new Scanner(new Uint8Array(buffer));
  if (!scanner.word().endsWith("OFF")) throw new Error("expected OFF");
  const [vertices, faces] = [scanner.next(), scanner.next(), scanner.next()];
  const [positions, corners, starts] = [new Growing(Float64Array), new Growing(Uint32Array), new Growing(Uint32Array)];
  starts.push(0);
  for (let v = 0; v < vertices; v++) { for (let k = 0; k < 3; k++) positions.push(scanner.next()); scanner.line(); }
  for (let f = 0; f < faces; f++) {
    for (let n = scanner.next(); n > 0; n--) corners.push(scanner.next());
    starts.push(corners.length);
    scanner.line();
  }
  return finished(positions, starts, corners);
}

const FORMATS = { ply: readPly, obj: readObj, stl: readStl, off: readOff };

// A mesh file, or null where the server has to read it: another format, or one that is odd here.
export function readMesh(buffer, name) {
  const read = FORMATS[name.split(".").pop().toLowerCase()];
  try {
    return read ? read(buffer) : null;
  } catch { return null; }
}
