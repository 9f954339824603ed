// A picture to turn: quads on the input, and the constraints as points that can be dragged over it.

import { bounds, edges, hit, shaded } from "/web/mesh.js";

const VERTEX = `
attribute vec3 at, normal; uniform mat3 turn; uniform vec2 pan, size; uniform float scale, deep, dot_size, nearer; varying vec3 n;
void main() {
  vec3 x = turn * at * scale;
  n = turn * normal;
  gl_Position = vec4((x.xy + pan) * size, -x.z * deep - nearer, 1.0);
  gl_PointSize = dot_size;
}`;
const FRAGMENT = `
precision mediump float; uniform vec4 colour; uniform float lit, round; varying vec3 n;
void main() {
  if (round > 0.5 && length(gl_PointCoord - 0.5) > 0.5) discard;
  // Lines and points have no normal.
  if (lit < 0.5) { gl_FragColor = vec4(colour.rgb, 1.0); return; }
  vec3 up = normalize(n) * (gl_FrontFacing ? 1.0 : -1.0);
  float light = 0.5 + 0.45 * max(dot(up, vec3(0.35, 0.5, 0.79)), 0.0) + 0.12 * up.y;
  vec3 tint = gl_FrontFacing ? colour.rgb : vec3(0.62, 0.68, 0.8);
  gl_FragColor = vec4(tint * light, 1.0);
}`;

const QUADS = [0.93, 0.9, 0.85, 1];
const SCAN = [0.72, 0.76, 0.82, 1];
const COLOURS = { feature: [0.12, 0.36, 0.85, 1], user: [0.85, 0.33, 0.05, 1], held: [0.05, 0.55, 0.3, 1] };
// How near (in CSS pixels) the pointer has to be to take hold of a point.
const REACH = 12;
const STEP = 0.15;

const times = (a, b) => a.map((_, k) => [0, 1, 2].reduce((sum, j) => sum + a[3 * j + (k % 3)] * b[3 * Math.floor(k / 3) + j], 0));
const about = (x, y) => {
  const [cx, sx, cy, sy] = [Math.cos(x), Math.sin(x), Math.cos(y), Math.sin(y)];
  // Columns of Rx·Ry.
  return [cy, sx * sy, -cx * sy, 0, cx, sx, sy, -sx * cy, cx * cy];
};

export class Viewer {
  // `onmove(id, point)` when a point was dragged to another place of the input; `onpin(hit)` on a double click on the quads.
  constructor(canvas, { onmove, onpin }) {
    this.canvas = canvas;
    this.gl = canvas.getContext("webgl", { antialias: true, alpha: true });
    if (!this.gl) throw new Error("this browser draws no WebGL");
    Object.assign(this, { onmove, onpin, layer: "quads", points: [], held: null, turn: about(0.25, -0.5), pan: [0, 0], zoom: 1, buffers: {} });
    this.program = this.compile();
    this.listen();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  compile() {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "at");
    gl.bindAttribLocation(program, 1, "normal");
    gl.linkProgram(program);
    return program;
  }

  // The input: what points are dragged over. It sets the frame.
  setInput(mesh) {
    this.input = mesh;
    Object.assign(this, bounds(mesh));
    this.fill("scan", shaded(mesh, this.centre));
    this.draw();
  }

  setQuads(mesh) {
    this.quads = mesh;
    const { inner, rim } = edges(mesh, this.centre);
    this.fill("quads", shaded(mesh, this.centre));
    this.fill("inner", inner);
    this.fill("rim", rim);
    this.draw();
  }

  // `points`: [{ id, origin, point }].
  setPoints(points) {
    this.points = points;
    this.draw();
  }

  show(layer) {
    this.layer = layer;
    this.draw();
  }

  fill(name, values) {
    const gl = this.gl;
    this.buffers[name] ??= { buffer: gl.createBuffer() };
    this.buffers[name].length = values.length;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name].buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  }

  // ---- drawing

  draw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.drawNow(); });
  }

  size() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [Math.min(1, height / width), Math.min(1, width / height)];
  }

  drawNow() {
    const { gl, canvas } = this;
    if (!this.input) return;
    const ratio = window.devicePixelRatio || 1;
    [canvas.width, canvas.height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    const place = (name) => gl.getUniformLocation(this.program, name);
    gl.uniformMatrix3fv(place("turn"), false, this.turn);
    gl.uniform2fv(place("pan"), this.pan);
    gl.uniform2fv(place("size"), this.size());
    gl.uniform1f(place("scale"), (0.95 * this.zoom) / this.radius);
    gl.uniform1f(place("deep"), 0.5 / this.zoom);
    const paint = (name, mode, colour, { lit = 0, nearer = 0, stride = 3, round = 0, dot = 1 } = {}) => {
      const from = this.buffers[name];
      if (!from?.length) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, from.buffer);
      gl.enableVertexAttribArray(0);
      gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 4 * stride, 0);
      if (stride > 3) {
        gl.enableVertexAttribArray(1);
        gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 4 * stride, 12);
      } else gl.disableVertexAttribArray(1);
      gl.uniform4fv(place("colour"), colour);
      gl.uniform1f(place("lit"), lit);
      gl.uniform1f(place("round"), round);
      gl.uniform1f(place("nearer"), nearer);
      gl.uniform1f(place("dot_size"), dot * ratio);
      gl.drawArrays(mode, 0, from.length / stride);
    };
    const solid = { lit: 1, stride: 6 };
    if (this.layer !== "quads" || !this.quads) paint("scan", gl.TRIANGLES, SCAN, solid);
    if (this.layer === "quads") paint("quads", gl.TRIANGLES, QUADS, solid);
    if (this.layer !== "scan") {
      paint("inner", gl.LINES, [0.22, 0.26, 0.33, 1], { nearer: 0.0015 });
      paint("rim", gl.LINES, [0.8, 0.2, 0.1, 1], { nearer: 0.0015 });
    }
    for (const { id, origin, point } of this.points) {
      const held = this.held?.id === id;
      this.fill("dot", new Float32Array((held ? this.held.point : point).map((x, k) => x - this.centre[k])));
      paint("dot", gl.POINTS, [1, 1, 1, 1], { nearer: 0.004, round: 1, dot: held ? 17 : 12 });
      paint("dot", gl.POINTS, held ? COLOURS.held : COLOURS[origin], { nearer: 0.005, round: 1, dot: held ? 13 : 8 });
    }
  }

  // ---- pointing

  // The pointer in units of the picture, before panning; and a point of space in the same.
  pointer(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const [sx, sy] = this.size();
    return [((2 * (event.clientX - left)) / width - 1) / sx - this.pan[0], (1 - (2 * (event.clientY - top)) / height) / sy - this.pan[1]];
  }

  seen(point) {
    const x = point.map((value, k) => value - this.centre[k]);
    const scale = (0.95 * this.zoom) / this.radius;
    return [0, 1, 2].map((row) => scale * (this.turn[row] * x[0] + this.turn[3 + row] * x[1] + this.turn[6 + row] * x[2]));
  }

  ray(event) {
    const scale = this.radius / (0.95 * this.zoom);
    const [x, y] = this.pointer(event);
    const back = (a) => [0, 1, 2].map((k) => this.turn[3 * k] * a[0] + this.turn[3 * k + 1] * a[1] + this.turn[3 * k + 2] * a[2]);
    const origin = back([x * scale, y * scale, 4 * this.radius]).map((value, k) => value + this.centre[k]);
    return [origin, back([0, 0, -1])];
  }

  grasped(event) {
    const [x, y] = this.pointer(event);
    const { width, height } = this.canvas.getBoundingClientRect();
    const pixels = Math.min(width, height) / 2;
    const near = this.points.map((p) => ({ ...p, at: this.seen(p.point) })).filter((p) => Math.hypot(p.at[0] - x, p.at[1] - y) * pixels < REACH);
    return near.sort((a, b) => b.at[2] - a.at[2])[0] ?? null;
  }

  listen() {
    const { canvas } = this;
    let last = null;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      last = event;
      const point = event.button === 0 && !event.shiftKey ? this.grasped(event) : null;
      this.held = point && { id: point.id, point: point.point, moved: false };
      this.draw();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) { canvas.classList.toggle("over-point", this.points.length > 0 && this.grasped(event) !== null); return; }
      const [dx, dy] = [event.clientX - last.clientX, event.clientY - last.clientY];
      if (this.held) {
        const found = hit(this.input, ...this.ray(event));
        if (found) Object.assign(this.held, { point: found.point, moved: true });
      } else if (event.shiftKey || event.buttons & 6) {
        const unit = 2 / Math.min(canvas.clientWidth, canvas.clientHeight);
        this.pan = [this.pan[0] + dx * unit, this.pan[1] - dy * unit];
      } else this.turn = times(about(dy / 150, dx / 150), this.turn);
      last = event;
      this.draw();
    });
    const drop = () => {
      const held = this.held;
      [last, this.held] = [null, null];
      if (held?.moved) this.onmove(held.id, held.point);
      this.draw();
    };
    canvas.addEventListener("pointerup", drop);
    canvas.addEventListener("pointercancel", () => { [last, this.held] = [null, null]; this.draw(); });
    canvas.addEventListener("dblclick", (event) => {
      const found = this.quads && !this.grasped(event) && hit(this.quads, ...this.ray(event));
      if (found) this.onpin(found);
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY / 500));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [0, -STEP], ArrowRight: [0, STEP], ArrowUp: [-STEP, 0], ArrowDown: [STEP, 0] };
      if (turns[event.key]) this.turn = times(about(...turns[event.key]), this.turn);
      else if (event.key === "+" || event.key === "=") this.zoomBy(1.15);
      else if (event.key === "-") this.zoomBy(1 / 1.15);
      else return;
      event.preventDefault();
      this.draw();
    });
  }

  zoomBy(factor) {
    this.zoom = Math.min(40, Math.max(0.2, this.zoom * factor));
    this.draw();
  }
}
