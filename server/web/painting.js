// Painting the parts of a scan: faces by a brush, parts merged; then the scan is sent again, cut as it was painted.

import { buffer, make } from "/web/call.js";
import { cornersOf, faceCount, place } from "/web/mesh.js";
import { button, showPanel } from "/web/panel.js";
import { colourOf, css } from "/web/parts.js";
import { readPly } from "/web/read.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import * as tools from "/web/tools.js";

const PARTS_MAX = 64;
// Rounds in which teeth of a border are rubbed off.
const SMOOTHING = 4;
const UNDO_MAX = 24;
// The brush, in the radius of the scan as it is seen.
const SIZES = { small: 0.04, medium: 0.1, large: 0.22 };

const minus = (a, b) => a.map((x, k) => x - b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// The middle of each face, and where it looks: six numbers a face, made once.
function facing(mesh) {
  if (mesh.facing) return mesh.facing;
  const all = new Float32Array(6 * faceCount(mesh));
  for (let f = 0; f < faceCount(mesh); f++) {
    const points = Array.from(cornersOf(mesh, f), (v) => place(mesh, v));
    const [u, v] = [minus(points[1], points[0]), minus(points.at(-1), points[0])];
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const size = Math.hypot(...normal) || 1;
    for (let k = 0; k < 3; k++) {
      all[6 * f + k] = points.reduce((sum, p) => sum + p[k], 0) / points.length;
      all[6 * f + 3 + k] = normal[k] / size;
    }
  }
  mesh.facing = all;
  return all;
}

// The faces beside each face, across its sides: -1 at a rim. Three or more a face, from `mesh.starts` on.
function beside(mesh) {
  if (mesh.beside) return mesh.beside;
  const [all, open] = [new Int32Array(mesh.corners.length).fill(-1), new Map()];
  for (let f = 0; f < faceCount(mesh); f++) {
    for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
      const [p, q] = [mesh.corners[k], mesh.corners[k + 1 < mesh.starts[f + 1] ? k + 1 : mesh.starts[f]]];
      const edge = Math.min(p, q) * 2 ** 26 + Math.max(p, q);
      const other = open.get(edge);
      if (other === undefined) { open.set(edge, [f, k]); continue; }
      [all[k], all[other[1]]] = [other[0], f];
      open.delete(edge);
    }
  }
  mesh.beside = all;
  return all;
}

// The label that most of the faces beside some faces have, other than their own; null where all around is theirs.
function around(mesh, labels, faces) {
  const [next, counts] = [beside(mesh), new Map()];
  for (const f of faces) {
    for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
      const label = next[k] < 0 ? labels[f] : labels[next[k]];
      if (label !== labels[f]) counts.set(label, (counts.get(label) ?? 0) + 1);
    }
  }
  return [...counts].sort((a, b) => b[1] - a[1])[0] ?? null;
}

// Teeth along a border, islands and specks go over to what is around them: a part is one piece.
function tidied(mesh, painted) {
  const labels = painted.slice();
  for (let round = 0; round < SMOOTHING; round++) {
    for (let f = 0; f < labels.length; f++) {
      const most = around(mesh, labels, [f]);
      if (most && 2 * most[1] > mesh.starts[f + 1] - mesh.starts[f]) [labels[f]] = most;
    }
  }
  const next = beside(mesh);
  const pieces = [];
  const seen = new Uint8Array(labels.length);
  for (let first = 0; first < labels.length; first++) {
    if (seen[first]) continue;
    const faces = [first];
    seen[first] = 1;
    for (const f of faces) {
      for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
        const g = next[k];
        if (g >= 0 && !seen[g] && labels[g] === labels[f]) { seen[g] = 1; faces.push(g); }
      }
    }
    pieces.push(faces);
  }
  pieces.sort((a, b) => b.length - a.length);
  const kept = new Set();
  for (const faces of pieces) {
    const label = labels[faces[0]];
    const most = kept.has(label) ? around(mesh, labels, faces) : null;
    if (most) for (const f of faces) [labels[f]] = most;
    kept.add(label);
  }
  return labels;
}

const used = (labels) => [...new Set(labels)].sort((a, b) => a - b);
const free = (labels) => { const there = new Set(labels); let k = 0; while (there.has(k)) k++; return k; };

// What was painted on scans, by their ids: where it was refused it is there again.
const tried = new Map();

let waiting = 0;
function show(query) {
  const { painting } = query;
  query.mesh.segments = painting.labels;
  waiting ||= requestAnimationFrame(() => {
    waiting = 0;
    if (bench.query !== query || !query.painting) return;
    bench.viewer.tintScan(Array.from({ length: Math.max(...used(painting.labels), painting.label) + 1 }, (_, k) => colourOf(k, k === painting.label)));
  });
}

export async function begin(query) {
  if (!query.mesh.segments) {
    // Faces are labelled in the server's order.
    const mesh = readPly(await buffer(`/v1/queries/${query.id}/mesh?format=ply`));
    if (bench.query !== query) return;
    query.mesh = mesh;
    bench.viewer.setScan(mesh);
  }
  const before = query.mesh.segments;
  const labels = Uint16Array.from(tried.get(query.id) ?? before ?? new Uint16Array(faceCount(query.mesh)));
  query.painting = { before, labels, label: before ? query.segment : 1, size: "medium", past: [] };
  Object.assign(bench.viewer, { brush: true });
  tools.set({ show: "scan", layout: "one" });
  say("Drag over the scan to paint it. Drag beside it to turn it.");
  show(query);
  showPanel(query);
}

function end(query) {
  query.mesh.segments = query.painting.before;
  query.painting = null;
  query.painted = null;
  Object.assign(bench.viewer, { brush: false });
  bench.viewer.tintScan(null);
}

function keep(query) {
  query.painting.past.push(query.painting.labels.slice());
  if (query.painting.past.length > UNDO_MAX) query.painting.past.shift();
}

// A touch of the brush on the scan; `isFirst` of a stroke; null when it is lifted.
export function brush(found, isFirst) {
  const { query } = bench;
  if (!query?.painting) return;
  if (!found) { showPanel(query); return; }
  const { painting } = query;
  if (isFirst) keep(query);
  const reach = (SIZES[painting.size] * bench.viewer.frames.result.radius) / bench.viewer.camera.zoom;
  const all = facing(query.mesh);
  const [x, y, z] = found.point;
  const front = all.subarray(6 * found.face + 3, 6 * found.face + 6);
  painting.labels[found.face] = painting.label;
  for (let f = 0; f < painting.labels.length; f++) {
    const far = (all[6 * f] - x) ** 2 + (all[6 * f + 1] - y) ** 2 + (all[6 * f + 2] - z) ** 2;
    // Not what lies behind a thin part.
    if (far < reach * reach && dot(front, all.subarray(6 * f + 3, 6 * f + 6)) > 0) painting.labels[f] = painting.label;
  }
  show(query);
}

function undo(query) {
  const last = query.painting.past.pop();
  if (last) query.painting.labels.set(last);
  show(query);
  showPanel(query);
}

function merge(query, into) {
  keep(query);
  const { labels, label } = query.painting;
  for (let f = 0; f < labels.length; f++) if (labels[f] === label) labels[f] = into;
  query.painting.label = into;
  show(query);
  showPanel(query);
}

// Sends the scan again, with the part of each face. The mesh goes as the server has it: its faces are those that were painted.
async function cut(query) {
  const labels = tidied(query.mesh, query.painting.labels);
  tried.set(query.id, labels);
  if (used(labels).length < 2) { say("All of it is one part. Paint a second one first.", "bad"); return; }
  const mesh = new Blob([await buffer(`/v1/queries/${query.id}/mesh?format=ply`)]);
  const text = `${labels.join("\n")}\n`;
  end(query);
  bench.cutAs(query, mesh, text);
}

export function showPainting(query) {
  const { painting } = query;
  const there = used(painting.labels);
  const section = make("section");
  const list = make("ul", undefined, { id: "part-list" });
  for (const label of used([...there, painting.label])) {
    const item = make("li", undefined, { className: label === painting.label ? "chosen" : "" });
    const mark = make("span", undefined, { className: "dot" });
    mark.style.background = css(colourOf(label, label === painting.label));
    const faces = painting.labels.reduce((sum, l) => sum + (l === label ? 1 : 0), 0);
    const pick = make("button", `Part ${label + 1}`, { type: "button", className: "part", ariaPressed: String(label === painting.label), id: `paint-${label}` });
    pick.onclick = () => { painting.label = label; show(query); showPanel(query); };
    item.append(mark, pick, make("small", `${faces} faces`));
    list.append(item);
  }
  const row = make("p", undefined, { className: "row" });
  row.append(
    button("New part", () => { painting.label = free([...painting.labels]); show(query); showPanel(query); }, { id: "paint-new", disabled: there.length >= PARTS_MAX }),
    button("Undo", () => undo(query), { id: "paint-undo", disabled: !painting.past.length }),
  );
  const size = make("select", undefined, { id: "brush-size" });
  size.append(...Object.keys(SIZES).map((name) => make("option", name, { value: name })));
  size.value = painting.size;
  size.onchange = () => { painting.size = size.value; };
  const brushSize = make("label", "Brush ");
  brushSize.append(size);
  const others = there.filter((label) => label !== painting.label);
  const into = make("select", undefined, { id: "merge-into", disabled: !others.length || !there.includes(painting.label) });
  into.append(make("option", "…", { value: "" }), ...others.map((label) => make("option", `part ${label + 1}`, { value: label })));
  into.onchange = () => { if (into.value !== "") merge(query, Number(into.value)); };
  const merging = make("label", `Merge part ${painting.label + 1} into `);
  merging.append(into);
  const out = make("p", undefined, { className: "row" });
  out.append(button("Cut it so", () => cut(query), { className: "", id: "paint-done" }), button("Leave it as it was", () => { end(query); say(""); tools.draw(); showPanel(query); }, { id: "paint-leave" }));
  section.append(make("h2", "Painting parts"), make("p", "Choose a part and drag over the scan. Each part has to be one piece: open with one rim, a tube, or closed.", { className: "soft" }), list, row, brushSize, merging, out);
  return section;
}
