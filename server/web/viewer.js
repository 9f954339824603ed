// The viewport: the scan with the quads laid on it, and beside it the example, seen by one camera.

import { Camera, times } from "/web/camera.js";
import { LARGE, coarse } from "/web/coarse.js";
import { draped } from "/web/drape.js";
import { bounds, edges, extraordinary, isQuads } from "/web/mesh.js";
import { hit } from "/web/near.js";
import { Painter, centred, linesOf, separate, shared } from "/web/paint.js";
import { Pen } from "/web/pen.js";

const COLOURS = { quads: [0.93, 0.9, 0.85], scan: [0.72, 0.76, 0.82], example: [0.9, 0.92, 0.88], line: [0.16, 0.2, 0.28], rim: [0.75, 0.16, 0.08] };
const POINTS = { feature: [0.12, 0.36, 0.85], user: [0.85, 0.33, 0.05], held: [0.05, 0.55, 0.3] };
// As in the service's own pictures: fewer than four edges, five, more.
const valenceColour = (n) => (n < 4 ? [0.1, 0.35, 0.9] : n === 5 ? [0.95, 0.5, 0.05] : [0.6, 0.15, 0.75]);
// How near (in CSS pixels) the pointer has to be to take hold of a point; a finger is wider.
const REACH = { mouse: 12, touch: 24 };
// How long nothing moves until it is at rest.
const REST_MS = 160;
const UPRIGHT = [1, 0, 0, 0, 1, 0, 0, 0, 1];

export class Viewer {
  // `hooks`: `ondrag(id, point)` while a point is dragged, `ondrop(id, point)` when it is let go; `onpick(pane, hit)` for a
  // click on a mesh where `picks` is set; `onpin(hit)` for a double click on the quads; `onbrush(hit, isFirst)` for strokes
  // where `brush` is set, with null at the end of each; `onstroke(samples)` for a line that was drawn where `draws` is set;
  // `onpair(k, end, point)` when a landmark was dragged; `ondraw()` after each frame.
  constructor(canvas, marks, hooks) {
    this.painter = new Painter(canvas);
    Object.assign(this, { canvas, marks, hooks, points: [], pairs: [], held: null, picks: false, meshes: {}, frames: {}, heat: null, tints: {} });
    this.options = { layout: "one", show: "quads", edges: true, flat: false, dots: false, checker: false };
    this.camera = new Camera(canvas, {
      onchange: () => this.moved(),
      place: (event) => this.pointer(event),
      unit: () => { const { width, height } = this.paneBoxes()[0]; return 2 / Math.min(width, height); },
      ongrasp: (event) => this.grasp(event),
      onhold: (event) => this.hold(event),
      onlet: (event) => this.letGo(event),
      onpoint: (event) => this.point(event),
      onhover: (event) => canvas.classList.toggle("over-point", this.picks || (this.pairs.length > 0 && this.graspedPair(event) !== null) || (this.points.length > 0 && this.grasped(event) !== null)),
    });
    this.pen = new Pen(this);
    canvas.addEventListener("dblclick", (event) => this.pin(event));
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.again());
    this.resizes = new ResizeObserver(() => this.draw());
    this.resizes.observe(canvas);
    canvas.viewer = this;
  }

  // All shapes are gone with a context that was lost: a driver was updated, or the computer slept.
  again() {
    this.painter = new Painter(this.canvas);
    const { scan, example } = this.meshes;
    if (scan) this.sendScan();
    this.sendQuads();
    this.isDraped = false;
    if (example) this.sendExample();
    this.draw();
  }

  end() {
    this.resizes.disconnect();
    this.painter.end();
  }

  // ---- what is shown

  clear() {
    for (const name of ["scan", "coarse", "cut", "quads", "inner", "rim", "dots", "example", "exampleInner", "exampleRim", "exampleDots"]) this.painter.send(name, null);
    Object.assign(this, { meshes: {}, frames: {}, points: [], pairs: [], heat: null, tints: {}, brush: false, draws: false });
    this.draw();
  }

  setScan(mesh) {
    this.meshes.scan = mesh;
    this.frames.result = { ...bounds(mesh), pose: UPRIGHT };
    this.sendScan();
  }

  sendScan() {
    const { scan } = this.meshes;
    const { centre } = this.frames.result;
    const shape = (mesh) => (this.tints.scan && mesh.segments ? separate(mesh, centre, { tint: (f) => this.tints.scan[mesh.segments[f]] ?? [0.7, 0.7, 0.7] }) : shared(mesh, centre));
    this.painter.send("scan", shape(scan));
    this.painter.send("coarse", this.painter.isSlow && scan.starts.length > LARGE ? shape(coarse(scan, this.frames.result)) : null);
    this.draw();
  }

  // Colours by segment of the scan; null for none.
  tintScan(colours) {
    this.tints.scan = colours;
    if (this.meshes.scan) this.sendScan();
  }

  // Edges of the scan that are drawn on it, as pairs of vertices.
  setCut(pairs) {
    this.painter.send("cut", pairs.length ? linesOf(pairs, this.meshes.scan.positions, this.frames.result.centre) : null);
    this.draw();
  }

  // `tint`: a colour a face, or null.
  setQuads(mesh, tint = null) {
    this.meshes.quads = mesh;
    this.tints.quads = tint;
    this.heat = null;
    this.isDraped = false;
    if (!mesh) for (const name of ["quads", "inner", "rim", "dots"]) this.painter.send(name, null);
    else this.sendQuads();
    this.draw();
  }

  sendQuads() {
    if (!this.meshes.quads) return;
    const { centre } = this.frames.result;
    this.sendFaces("quads", this.meshes.quads, centre, { inner: "inner", rim: "rim", dots: "dots" }, { value: this.heat, tint: this.tints.quads });
  }

  sendFaces(name, mesh, centre, names, more = {}) {
    const { inner, rim } = edges(mesh);
    this.painter.send(name, separate(mesh, centre, more));
    this.painter.send(names.inner, linesOf(inner, mesh.positions, centre));
    this.painter.send(names.rim, linesOf(rim, mesh.positions, centre));
    const dots = isQuads(mesh) ? extraordinary(mesh) : [];
    const at = dots.flatMap(({ vertex }) => [0, 1, 2].map((k) => mesh.positions[3 * vertex + k]));
    this.painter.send(names.dots, { at: centred(at, centre), tint: new Float32Array(dots.flatMap(({ valence }) => valenceColour(valence))) });
  }

  // `lies`: how it lies in the scan's frame (a similarity), so that both turn as one; `tint`: a colour a face.
  setExample(mesh, { lies = null, tint = null } = {}) {
    this.meshes.example = mesh;
    if (!mesh) for (const name of ["example", "exampleInner", "exampleRim", "exampleDots"]) this.painter.send(name, null);
    else {
      this.frames.example = lies ? this.beside(lies) : { ...bounds(mesh), pose: UPRIGHT };
      this.tints.example = tint;
      this.sendExample();
    }
    this.draw();
  }

  sendExample() {
    this.sendFaces("example", this.meshes.example, this.frames.example.centre, { inner: "exampleInner", rim: "exampleRim", dots: "exampleDots" }, { tint: this.tints.example });
  }

  // The frame in which an example is seen as the scan is: what corresponds is at the same place of both panes.
  beside({ turn, scale, from, to }) {
    const { centre, radius } = this.frames.result;
    const off = to.map((x, k) => (x - centre[k]) / scale);
    const back = [0, 1, 2].map((k) => turn[3 * k] * off[0] + turn[3 * k + 1] * off[1] + turn[3 * k + 2] * off[2]);
    return { centre: from.map((x, k) => x - back[k]), radius: radius / scale, pose: turn };
  }

  // `values`: a number a face of the quads from 0 to 1, or null.
  setHeat(values) {
    this.heat = values;
    if (this.meshes.quads) this.sendQuads();
    this.draw();
  }

  // `points`: [{ id, origin, point }] on the scan; `pairs`: [{ name, example: point or null, input: point or null }].
  setPoints(points) { this.points = points; this.draw(); }

  setPairs(pairs) { this.pairs = pairs; this.draw(); }

  set(options) { Object.assign(this.options, options); this.draw(); }

  // ---- panes

  // From the upper left, in CSS pixels. Two lie beside each other where there is room, else below each other.
  paneBoxes() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (this.options.layout !== "two" || !this.meshes.example) return [{ name: "result", left: 0, top: 0, width, height }];
    if (width < height) return [{ name: "example", left: 0, top: 0, width, height: height / 2 }, { name: "result", left: 0, top: height / 2, width, height: height / 2 }];
    return [{ name: "example", left: 0, top: 0, width: width / 2, height }, { name: "result", left: width / 2, top: 0, width: width / 2, height }];
  }

  paneAt(event) {
    const { left, top } = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - left, event.clientY - top];
    const boxes = this.paneBoxes();
    return boxes.find((b) => x >= b.left && x < b.left + b.width && y >= b.top && y < b.top + b.height) ?? boxes.at(-1);
  }

  view({ name, width, height }) {
    const { pose, radius } = this.frames[name] ?? this.frames.result ?? this.frames.example;
    const { turn, pan, zoom } = this.camera;
    return { turn: pose === UPRIGHT ? turn : times(turn, pose), pan, size: [Math.min(1, height / width), Math.min(1, width / height)], scale: (0.95 * zoom) / radius, deep: 0.5 / zoom };
  }

  // ---- drawing

  // Without a graphics card what moves is drawn coarsely, and fully once it rests.
  moved() {
    if (this.painter.isSlow) {
      this.isMoving = true;
      clearTimeout(this.resting);
      this.resting = setTimeout(() => { this.isMoving = false; this.draw(); }, REST_MS);
    }
    this.draw();
  }

  draw() { this.waiting ||= requestAnimationFrame(() => { this.waiting = 0; this.drawNow(); }); }

  drawNow() {
    const { canvas } = this;
    const ratio = this.isMoving ? 0.5 : Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    for (const box of this.paneBoxes()) {
      const rect = [box.left, canvas.clientHeight - box.top - box.height, box.width, box.height].map((x) => Math.round(x * ratio));
      this.painter.pane(rect);
      if (!this.frames[box.name]) continue;
      const view = this.view(box);
      if (box.name === "example") this.drawExample(view, ratio);
      else this.drawResult(view, ratio);
    }
    this.placeMarks();
    this.hooks.ondraw?.();
  }

  drawExample(view, ratio) {
    const { painter, options } = this;
    painter.surface("example", view, { colour: COLOURS.example, mode: this.tints.example ? 1 : options.checker && this.meshes.example.uvs ? 3 : 0, flat: options.flat });
    this.drawEdges("exampleInner", "exampleRim", view);
    if (options.dots) painter.marks("exampleDots", view, { tinted: true, nearer: 0.004, dot: 7 * ratio });
  }

  drawEdges(inner, rim, view) {
    if (!this.options.edges) return;
    this.painter.marks(inner, view, { lines: true, colour: COLOURS.line, nearer: 0.0004 });
    this.painter.marks(rim, view, { lines: true, colour: COLOURS.rim, nearer: 0.0008 });
  }

  drawResult(view, ratio) {
    const { painter, options, meshes } = this;
    const show = meshes.quads ? options.show : "scan";
    if (show !== "quads") painter.surface(this.isMoving && painter.has("coarse") ? "coarse" : "scan", view, { colour: COLOURS.scan, mode: this.tints.scan && meshes.scan.segments ? 1 : 0, flat: options.flat });
    painter.marks("cut", view, { lines: true, colour: COLOURS.rim, nearer: 0.004 });
    if (show === "quads") {
      const mode = this.heat ? 2 : options.checker && meshes.quads.uvs ? 3 : this.tints.quads ? 1 : 0;
      painter.surface("quads", view, { colour: COLOURS.quads, mode, flat: options.flat });
      this.drawEdges("inner", "rim", view);
    }
    if (show === "over") {
      this.drape();
      const [inner, rim] = this.isDraped ? ["drapedInner", "drapedRim"] : ["inner", "rim"];
      painter.marks(inner, view, { lines: true, colour: COLOURS.line, nearer: 0.003 });
      painter.marks(rim, view, { lines: true, colour: COLOURS.rim, nearer: 0.004 });
    }
    if (options.dots && show !== "scan") painter.marks("dots", view, { tinted: true, nearer: 0.007, dot: 7 * ratio });
    if (meshes.quads && options.points !== false) this.drawPoints(view, ratio);
  }

  // When they are first seen, and not while a point is dragged: the quads change with every move.
  drape() {
    const { scan, quads } = this.meshes;
    if (this.isDraped || this.held) return;
    const { inner, rim } = edges(quads);
    for (const [name, pairs] of [["drapedInner", inner], ["drapedRim", rim]]) this.painter.send(name, draped(pairs, quads.positions, scan, this.frames.result.centre));
    this.isDraped = true;
  }

  drawPoints(view, ratio) {
    for (const { id, origin, point, chosen } of this.points) {
      const held = this.held?.id === id;
      this.painter.send("dot", { at: centred(held ? this.held.point : point, this.frames.result.centre) });
      const large = held || chosen;
      this.painter.marks("dot", view, { colour: [1, 1, 1], nearer: 0.012, dot: (large ? 18 : 10) * ratio });
      this.painter.marks("dot", view, { colour: large ? POINTS.held : POINTS[origin], nearer: 0.013, dot: (large ? 13 : 7) * ratio });
    }
  }

  // Numbers over landmarks are elements of the page: a picture has no text.
  placeMarks() {
    const wanted = [];
    for (const box of this.paneBoxes()) {
      const end = box.name === "example" ? "example" : "input";
      for (const pair of this.pairs) {
        if (!pair[end] || !this.frames[box.name]) continue;
        const [x, y] = this.onScreen(pair[end], box);
        wanted.push({ text: pair.name, x, y, hidden: this.isHidden(pair[end], box) });
      }
    }
    while (this.marks.childElementCount < wanted.length) this.marks.append(document.createElement("span"));
    while (this.marks.childElementCount > wanted.length) this.marks.lastChild.remove();
    wanted.forEach(({ text, x, y, hidden }, k) => {
      const mark = this.marks.children[k];
      mark.textContent = text;
      mark.className = hidden ? "behind" : "";
      mark.style.transform = `translate(${x}px, ${y}px)`;
    });
  }

  // Milliseconds a frame takes, over some: each is waited for.
  measure(frames = 30) {
    const { gl } = this.painter;
    const pixel = new Uint8Array(4);
    const begun = performance.now();
    for (let k = 0; k < frames; k++) {
      this.camera.turnBy(0, 0.02);
      this.drawNow();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    }
    return (performance.now() - begun) / frames;
  }

  // ---- pointing

  // The pointer in units of its pane's picture, before panning.
  pointer(event, box = this.paneAt(event)) {
    const { left, top } = this.canvas.getBoundingClientRect();
    const size = [Math.min(1, box.height / box.width), Math.min(1, box.width / box.height)];
    return [((2 * (event.clientX - left - box.left)) / box.width - 1) / size[0], (1 - (2 * (event.clientY - top - box.top)) / box.height) / size[1]];
  }

  seen(point, box) {
    const { turn, scale } = this.view(box);
    const { centre } = this.frames[box.name];
    const x = [0, 1, 2].map((k) => point[k] - centre[k]);
    return [0, 1, 2].map((row) => scale * (turn[row] * x[0] + turn[3 + row] * x[1] + turn[6 + row] * x[2]));
  }

  onScreen(point, box) {
    const [x, y] = this.seen(point, box);
    const { size, pan } = this.view(box);
    return [box.left + (((x + pan[0]) * size[0] + 1) / 2) * box.width, box.top + ((1 - (y + pan[1]) * size[1]) / 2) * box.height];
  }

  ray([x, y], box) {
    const { turn, scale, pan } = this.view(box);
    const { centre, radius } = this.frames[box.name];
    const back = (a) => [0, 1, 2].map((k) => turn[3 * k] * a[0] + turn[3 * k + 1] * a[1] + turn[3 * k + 2] * a[2]);
    const origin = back([(x - pan[0]) / scale, (y - pan[1]) / scale, 4 * radius]).map((value, k) => value + centre[k]);
    return [origin, back([0, 0, -1])];
  }

  meshIn(box) { return box.name === "example" ? this.meshes.example : this.meshes.scan; }

  // Where the mesh of a pane is met under the pointer, or in the middle of the pane.
  under(event, box = this.paneAt(event), mesh = this.meshIn(box)) {
    return mesh && this.frames[box.name] ? hit(mesh, ...this.ray(event ? this.pointer(event, box) : [0, 0], box)) : null;
  }

  isHidden(point, box) {
    const [x, y, z] = this.seen(point, box);
    const { pan } = this.view(box);
    const found = hit(this.meshIn(box), ...this.ray([x + pan[0], y + pan[1]], box));
    return found !== null && this.seen(found.point, box)[2] > z + 0.02 * this.camera.zoom;
  }

  grasped(event) {
    const box = this.paneAt(event);
    if (box.name !== "result" || !this.meshes.quads || this.options.points === false || this.picks) return null;
    const { left, top } = this.canvas.getBoundingClientRect();
    const reach = REACH[event.pointerType] ?? REACH.mouse;
    const near = this.points.map((p) => {
      const [x, y] = this.onScreen(p.point, box);
      return { ...p, far: Math.hypot(x - event.clientX + left, y - event.clientY + top), depth: this.seen(p.point, box)[2] };
    });
    return near.filter((p) => p.far < reach).sort((a, b) => b.depth - a.depth)[0] ?? null;
  }

  // The end of a landmark that is under the pointer: { pair, end, point }, or null.
  graspedPair(event) {
    if (!this.hooks.onpair || !this.pairs.length) return null;
    const box = this.paneAt(event);
    const end = box.name === "example" ? "example" : "input";
    const { left, top } = this.canvas.getBoundingClientRect();
    const near = this.pairs.map((p, pair) => {
      if (!p[end] || !this.frames[box.name]) return { far: Infinity };
      const [x, y] = this.onScreen(p[end], box);
      return { pair, end, point: p[end], far: Math.hypot(x - event.clientX + left, y - event.clientY + top) };
    });
    const found = near.filter((p) => p.far < (REACH[event.pointerType] ?? REACH.mouse)).sort((a, b) => a.far - b.far);
    return found.find((p) => !this.isHidden(p.point, box)) ?? null;
  }

  grasp(event) {
    if (this.draws) return this.pen.begin(event);
    if (this.brush) {
      const found = this.under(event);
      this.isBrushing = Boolean(found);
      if (found) this.hooks.onbrush(found, true);
      return this.isBrushing;
    }
    // Numbers lie over points.
    const pair = this.graspedPair(event);
    const point = pair ?? this.grasped(event);
    this.held = point && { ...point, moved: false };
    this.draw();
    return point !== null;
  }

  hold(event) {
    if (this.pen.line) { this.pen.go(event); return; }
    if (this.isBrushing) {
      const found = this.under(event);
      if (found) this.hooks.onbrush(found, false);
      return;
    }
    const pane = this.held.end === "example" ? "example" : "result";
    const found = this.under(event, this.paneBoxes().find((b) => b.name === pane));
    if (!found) return;
    Object.assign(this.held, { point: found.point, moved: true });
    if (this.held.end) {
      this.pairs = this.pairs.map((p, k) => (k === this.held.pair ? { ...p, [this.held.end]: found.point } : p));
      this.draw();
      return;
    }
    this.hooks.ondrag(this.held.id, found.point);
    this.bend();
  }

  // Takes the quads around a dragged point along until the service tells where they go: that takes longer than a frame.
  bend() {
    const { quads } = this.meshes;
    const at = this.points.find((p) => p.id === this.held?.id)?.point;
    if (!at || !this.held.moved) return;
    const by = this.held.point.map((x, k) => x - at[k]);
    const others = this.points.filter((p) => p.id !== this.held.id).map((p) => Math.hypot(...p.point.map((x, k) => x - at[k])));
    const reach = Math.min(0.3 * this.frames.result.radius, Math.max(2 * Math.hypot(...by), ...[Math.min(...others)].filter(Number.isFinite)));
    const positions = quads.positions.slice();
    for (let v = 0; v < positions.length; v += 3) {
      const far = Math.hypot(positions[v] - at[0], positions[v + 1] - at[1], positions[v + 2] - at[2]) / reach;
      if (far >= 1) continue;
      const weight = (1 - far * far) ** 2;
      for (let k = 0; k < 3; k++) positions[v + k] += weight * by[k];
    }
    this.sendFaces("quads", { ...quads, positions }, this.frames.result.centre, { inner: "inner", rim: "rim", dots: "dots" }, { value: this.heat });
    this.isDraped = false;
    this.draw();
  }

  letGo(event) {
    if (this.pen.line) {
      const samples = this.pen.end(event);
      if (samples) this.hooks.onstroke(samples);
      return;
    }
    if (this.isBrushing) {
      this.isBrushing = false;
      this.hooks.onbrush(null, false);
      return;
    }
    const { held } = this;
    this.held = null;
    if (held?.end) {
      // A click on a number places what is placed, as anywhere else.
      if (held.moved) this.hooks.onpair(held.pair, held.end, held.point);
      else if (event) this.point(event);
    } else if (held && event) this.hooks.ondrop(held.id, held.moved ? held.point : null);
    else if (held) this.sendQuads();
    this.draw();
  }

  point(event) {
    const box = this.paneAt(event);
    // Parts are picked where their colours are seen.
    const isOnParts = box.name === "result" && this.tints.scan && (this.options.show !== "quads" || !this.meshes.quads);
    if (!this.picks && !isOnParts) return;
    const found = this.under(event, box);
    if (found) this.hooks.onpick(box.name, found);
  }

  pin(event) {
    const box = this.paneAt(event);
    if (this.picks || box.name !== "result" || !this.meshes.quads || this.grasped(event)) return;
    const found = this.under(event, box, this.meshes.quads);
    if (found) this.hooks.onpin(found);
  }

  // For the keyboard: what lies in the middle of a pane.
  inTheMiddle(name) {
    const box = this.paneBoxes().find((b) => b.name === name);
    return box ? this.under(null, box) : null;
  }
}
