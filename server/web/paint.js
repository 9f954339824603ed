// Drawing with WebGL 2: surfaces, lines and dots. Our own, not a library: two programs of some lines each do all that is
// drawn here, and a mesh is sent to the graphics card once.

import { RAMP } from "/web/heat.js";
import { normals, triangles } from "/web/mesh.js";

const VERTEX = `#version 300 es
layout(location = 0) in vec3 at;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in float value;
layout(location = 4) in vec3 tint;
uniform mat3 turn;
uniform vec2 pan, size;
uniform float scale, deep, nearer, dot_size;
out vec3 n, x, colour_of;
out vec2 st;
out float heat;
void main() {
  x = turn * at * scale;
  n = turn * normal;
  st = uv;
  heat = value;
  colour_of = tint;
  gl_Position = vec4((x.xy + pan) * size, -x.z * deep - nearer, 1.0);
  gl_PointSize = dot_size;
}`;

// `mode`: 0 one colour, 1 a tint each, 2 heat, 3 a checker by UV.
const SURFACE = `#version 300 es
precision highp float;
uniform vec3 colour, ramp[5];
uniform int mode;
uniform bool flat_shaded;
in vec3 n, x, colour_of;
in vec2 st;
in float heat;
out vec4 shown;
void main() {
  vec3 up = flat_shaded ? normalize(cross(dFdx(x), dFdy(x))) : normalize(n) * (gl_FrontFacing ? 1.0 : -1.0);
  vec3 base = gl_FrontFacing ? colour : vec3(0.50, 0.58, 0.74);
  if (mode == 1) base = colour_of;
  if (mode == 2) {
    float t = clamp(heat, 0.0, 1.0) * 4.0;
    int k = min(int(t), 3);
    base = heat < -0.5 ? vec3(0.7) : mix(ramp[k], ramp[k + 1], t - float(k));
  }
  if (mode == 3) {
    vec2 cell = floor(st * 32.0);
    base = mod(cell.x + cell.y, 2.0) < 0.5 ? vec3(0.93) : vec3(0.36, 0.45, 0.56);
    cell = floor(st * 4.0);
    base *= mod(cell.x + cell.y, 2.0) < 0.5 ? vec3(1.0) : vec3(1.0, 0.86, 0.7);
  }
  float light = 0.42 + 0.42 * max(dot(up, vec3(0.35, 0.5, 0.79)), 0.0) + 0.14 * up.y + 0.1 * up.z;
  shown = vec4(base * light, 1.0);
}`;

const MARK = `#version 300 es
precision highp float;
uniform vec3 colour;
uniform int mode;
uniform bool round;
uniform float opacity;
in vec3 n, x, colour_of;
in vec2 st;
in float heat;
out vec4 shown;
void main() {
  if (round && length(gl_PointCoord - 0.5) > 0.5) discard;
  shown = vec4(mode == 1 ? colour_of : colour, opacity);
}`;

const PLACES = { at: [0, 3], normal: [1, 3], uv: [2, 2], value: [3, 1], tint: [4, 3] };

let software;

// Whether pictures are computed without a graphics card, which is a hundred times slower. A context of its own tells, since
// it has to be known before one is made.
const isSoftware = () => (software ??= findsSoftware());

function findsSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const told = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = told ? gl.getParameter(told.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

export class Painter {
  constructor(canvas) {
    this.isSlow = isSoftware();
    this.gl = canvas.getContext("webgl2", { antialias: !this.isSlow, alpha: true });
    if (!this.gl) throw new Error("this browser draws no WebGL 2");
    this.programs = { surface: this.compile(SURFACE), mark: this.compile(MARK) };
    this.shapes = new Map();
  }

  compile(fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) || "the picture's program does not link");
    const places = {};
    return { program, place: (name) => (places[name] ??= gl.getUniformLocation(program, name)) };
  }

  // Sends a shape: { at, normal?, uv?, value?, tint?, index? }; in place of one of the same name. Null removes it.
  send(name, shape) {
    const { gl } = this;
    const old = this.shapes.get(name);
    if (old) {
      Object.values(old.buffers).forEach((buffer) => gl.deleteBuffer(buffer));
      gl.deleteVertexArray(old.array);
      this.shapes.delete(name);
    }
    if (!shape?.at?.length) return;
    const sent = { array: gl.createVertexArray(), buffers: {}, count: shape.index ? shape.index.length : shape.at.length / 3, indexed: Boolean(shape.index) };
    gl.bindVertexArray(sent.array);
    for (const [what, [place, size]] of Object.entries(PLACES)) {
      if (!shape[what]) { gl.disableVertexAttribArray(place); continue; }
      sent.buffers[what] = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, sent.buffers[what]);
      gl.bufferData(gl.ARRAY_BUFFER, shape[what], gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
    }
    if (shape.index) {
      sent.buffers.index = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, sent.buffers.index);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, shape.index, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
    this.shapes.set(name, sent);
  }

  // Gives the context back: a browser has few, and takes the oldest where one more is asked for.
  end() { this.gl.getExtension("WEBGL_lose_context")?.loseContext(); }

  has(name) { return this.shapes.has(name); }

  // Begins a picture of a part of the canvas, in device pixels from the lower left.
  pane([left, bottom, width, height]) {
    const { gl } = this;
    gl.enable(gl.SCISSOR_TEST);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.viewport(left, bottom, width, height);
    gl.scissor(left, bottom, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  use(kind, view) {
    const { gl } = this;
    const { program, place } = this.programs[kind];
    gl.useProgram(program);
    gl.uniformMatrix3fv(place("turn"), false, view.turn);
    gl.uniform2fv(place("pan"), view.pan);
    gl.uniform2fv(place("size"), view.size);
    gl.uniform1f(place("scale"), view.scale);
    gl.uniform1f(place("deep"), view.deep);
    return place;
  }

  surface(name, view, { colour, mode = 0, flat = false }) {
    const shape = this.shapes.get(name);
    if (!shape) return;
    const { gl } = this;
    const place = this.use("surface", view);
    gl.uniform3fv(place("colour"), colour);
    gl.uniform3fv(place("ramp"), RAMP.flat());
    gl.uniform1i(place("mode"), mode);
    gl.uniform1i(place("flat_shaded"), flat);
    gl.uniform1f(place("nearer"), 0);
    // Faces step back from the lines that lie on them, the more so the steeper they are: else both fight for the same depth.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1.5, 4);
    this.draw(shape, gl.TRIANGLES);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  marks(name, view, { lines = false, colour, tinted = false, nearer = 0, dot = 1, opacity = 1, behind = false }) {
    const shape = this.shapes.get(name);
    if (!shape) return;
    const { gl } = this;
    const place = this.use("mark", view);
    gl.uniform3fv(place("colour"), colour ?? [0, 0, 0]);
    gl.uniform1i(place("mode"), tinted ? 1 : 0);
    gl.uniform1i(place("round"), !lines);
    gl.uniform1f(place("nearer"), nearer);
    gl.uniform1f(place("dot_size"), dot);
    gl.uniform1f(place("opacity"), opacity);
    if (opacity < 1) { gl.enable(gl.BLEND); gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA); }
    if (behind) gl.disable(gl.DEPTH_TEST);
    this.draw(shape, lines ? gl.LINES : gl.POINTS);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
  }

  draw(shape, kind) {
    const { gl } = this;
    gl.bindVertexArray(shape.array);
    if (shape.indexed) gl.drawElements(kind, shape.count, gl.UNSIGNED_INT, 0);
    else gl.drawArrays(kind, 0, shape.count);
    gl.bindVertexArray(null);
  }
}

// ---- shapes of meshes, about a centre

export function centred(positions, centre) {
  const out = new Float32Array(positions.length);
  for (let k = 0; k < out.length; k++) out[k] = positions[k] - centre[k % 3];
  return out;
}

// A surface with a corner of its own for each triangle, so that faces can differ: by `value` or `tint`, one a face.
export function separate(mesh, centre, { value = null, tint = null } = {}) {
  const { at, of } = triangles(mesh);
  const smooth = normals(mesh);
  const shape = { at: new Float32Array(3 * at.length), normal: new Float32Array(3 * at.length) };
  if (mesh.uvs) shape.uv = new Float32Array(2 * at.length);
  if (value) shape.value = new Float32Array(at.length);
  if (tint) shape.tint = new Float32Array(3 * at.length);
  for (let k = 0; k < at.length; k++) {
    const v = 3 * mesh.corners[at[k]];
    for (let j = 0; j < 3; j++) {
      shape.at[3 * k + j] = mesh.positions[v + j] - centre[j];
      shape.normal[3 * k + j] = smooth[v + j];
    }
    const face = of[Math.floor(k / 3)];
    if (mesh.uvs) { shape.uv[2 * k] = mesh.uvs[2 * at[k]]; shape.uv[2 * k + 1] = mesh.uvs[2 * at[k] + 1]; }
    if (value) shape.value[k] = value[face];
    if (tint) shape.tint.set(tint(face), 3 * k);
  }
  return shape;
}

// A surface whose triangles share their vertices: a third of the memory, for large scans.
export function shared(mesh, centre) {
  const { at } = triangles(mesh);
  return { at: centred(mesh.positions, centre), normal: normals(mesh), index: Uint32Array.from(at, (k) => mesh.corners[k]) };
}

export const linesOf = (pairs, positions, centre) => {
  const out = new Float32Array(3 * pairs.length);
  for (let k = 0; k < pairs.length; k++) for (let j = 0; j < 3; j++) out[3 * k + j] = positions[3 * pairs[k] + j] - centre[j];
  return { at: out };
};
