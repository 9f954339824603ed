// The parts of a scan, made by hand: faces by a brush, a part cut along a line, two joined; then the scan is sent again, cut so.

import { buffer, make } from "/web/call.js";
import { cutAlong, seenBy } from "/web/cutting.js";
import { faceCount } from "/web/mesh.js";
import { button, showPanel } from "/web/panel.js";
import { cleaned, plainName } from "/web/partnames.js";
import { colourOf, css } from "/web/parts.js";
import { readPly } from "/web/read.js";
import { endsOf, facing, free, tidied, used } from "/web/regions.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import * as tools from "/web/tools.js";

const PARTS_MAX = 64;
const UNDO_MAX = 24;
// The brush, in the radius of the scan as it is seen.
const SIZES = { small: 0.04, medium: 0.1, large: 0.22 };
const TOOLS = { cut: "Cut", brush: "Brush", join: "Join" };
const HINTS = {
  cut: "Draw a line across the scan: around the back it finds the shortest way by itself. A line that comes back to where it began cuts out what is in it.",
  brush: "Choose a part and drag over the scan.",
  join: "Drag from one part to another: the first takes the other in.",
};

const KEYS = "By keyboard: go to the scan, move the cross with Alt and the arrows (farther with Shift, too), set points with Enter, and cut with C, or Enter again. Backspace takes a point back, Escape the line.";

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// What was made of scans, by their ids: where it was refused it is there again.
const tried = new Map();

export const nameOf = ({ names }, label) => names.get(label) ?? plainName(label);

let waiting = 0;
function show(query) {
  const { painting } = query;
  query.mesh.segments = painting.labels;
  bench.viewer.setCut(painting.before.flatMap(endsOf));
  waiting ||= requestAnimationFrame(() => {
    waiting = 0;
    if (bench.query !== query || !query.painting) return;
    bench.viewer.tintScan(Array.from({ length: Math.max(...used(painting.labels), painting.label) + 1 }, (_, k) => colourOf(k, k === painting.label)));
  });
}

function take(query, tool) {
  const { painting } = query;
  painting.tool = tool;
  // With one part alone a brush would paint nothing: it begins a second.
  if (tool === "brush" && used(painting.labels).length === 1) { painting.label = free([...painting.labels]); show(query); }
  Object.assign(bench.viewer, { brush: tool === "brush", draws: tool !== "brush" });
  bench.viewer.canvas.classList.toggle("picking", tool !== "brush");
  say("Drag beside the scan to turn it, or press the arrows there.");
}

export async function begin(query) {
  if (!query.mesh.segments) {
    // Faces are labelled in the server's order.
    const mesh = readPly(await buffer(`/v1/queries/${query.id}/mesh?format=ply`));
    if (bench.query !== query) return;
    query.mesh = mesh;
    bench.viewer.setScan(mesh);
  }
  const old = query.mesh.segments;
  const last = tried.get(query.id);
  const labels = Uint16Array.from(last?.labels ?? old ?? new Uint16Array(faceCount(query.mesh)));
  query.painting = { old, labels, names: new Map(last?.names ?? query.names), label: old ? query.segment : 0, size: "medium", past: [], before: [] };
  // Points of a map, and landmarks, would lie in the way.
  bench.viewer.setPoints([]);
  bench.viewer.setPairs([]);
  tools.set({ show: "scan", layout: "one" });
  take(query, "cut");
  show(query);
  showPanel(query);
}

function end(query) {
  query.mesh.segments = query.painting.old;
  query.painting = null;
  query.painted = null;
  Object.assign(bench.viewer, { brush: false, draws: false });
  bench.viewer.canvas.classList.remove("picking");
  bench.viewer.setCut([]);
  bench.viewer.tintScan(null);
}

function keep({ painting }) {
  const { labels, names, label, before } = painting;
  painting.past.push({ labels: labels.slice(), names: new Map(names), label, before });
  if (painting.past.length > UNDO_MAX) painting.past.shift();
}

// A touch of the brush on the scan; `isFirst` of a stroke; null when it is lifted.
export function brush(found, isFirst) {
  const { query } = bench;
  if (!query?.painting) return;
  if (!found) { showPanel(query); return; }
  const { painting } = query;
  if (isFirst) keep(query);
  painting.before = [];
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

// A line that was drawn: samples of it, each with the face under it, or -1. Answers whether anything came of it.
export function stroke(line) {
  const { query } = bench;
  if (!query?.painting) return false;
  return query.painting.tool === "cut" ? cutPart(query, line) : join(query, line);
}

function cutPart(query, line) {
  const { painting } = query;
  if (used(painting.labels).length >= PARTS_MAX) { say(`There are ${PARTS_MAX} parts already, and no more are possible.`, "bad"); return false; }
  const box = bench.viewer.paneBoxes().find((b) => b.name === "result");
  const found = cutAlong(query.mesh, painting.labels, line, seenBy(bench.viewer, query.mesh, box), painting.before);
  if (found.trouble) { say(found.trouble, "bad"); return false; }
  keep(query);
  if (found.labels) {
    Object.assign(painting, { labels: found.labels, label: found.label, before: [] });
    say(`${plainName(found.label)} is a part of its own now. Name it, or cut on.`);
  } else {
    painting.before = found.before;
    say("This cut goes through a ring, and leaves it in one piece. Draw a second one elsewhere on the ring.");
  }
  show(query);
  showPanel(query);
  return true;
}

function join(query, line) {
  const { painting } = query;
  const met = line.filter((s) => s.face >= 0).map((s) => painting.labels[s.face]);
  if (!met.length || met[0] === met.at(-1)) { say("Begin on one part, and end on another.", "bad"); return false; }
  merge(query, met.at(-1), met[0]);
  say(`${nameOf(painting, met[0])} has taken in ${nameOf(painting, met.at(-1))}.`);
  return true;
}

export function undo(query) {
  if (!query.painting.past.length) return;
  Object.assign(query.painting, query.painting.past.pop());
  show(query);
  showPanel(query);
}

function merge(query, from, into) {
  keep(query);
  const { painting } = query;
  painting.labels = painting.labels.map((label) => (label === from ? into : label));
  Object.assign(painting, { label: into, before: [] });
  show(query);
  showPanel(query);
}

// Sends the scan again, with the part of each face. The mesh goes as the server has it: its faces are those that were labelled.
async function cut(query) {
  const { names } = query.painting;
  const labels = tidied(query.mesh, query.painting.labels);
  if (used(labels).length < 2) { say("All of it is one part. Cut it, or paint a second one first.", "bad"); return; }
  tried.set(query.id, { labels, names });
  const mesh = new Blob([await buffer(`/v1/queries/${query.id}/mesh?format=ply`)]);
  const text = `${labels.join("\n")}\n`;
  end(query);
  bench.cutAs(query, mesh, text, { labels, names });
}

// ---- the panel's part

function list(query, labels) {
  const { painting } = query;
  const all = make("ul", undefined, { id: "part-list" });
  const counts = new Map();
  for (const label of painting.labels) counts.set(label, (counts.get(label) ?? 0) + 1);
  for (const label of labels) {
    const item = make("li", undefined, { className: label === painting.label ? "chosen" : "" });
    const mark = make("span", undefined, { className: "dot" });
    mark.style.background = css(colourOf(label, label === painting.label));
    const pick = make("button", nameOf(painting, label), { type: "button", className: "part", ariaPressed: String(label === painting.label), id: `paint-${label}` });
    pick.onclick = () => { painting.label = label; show(query); showPanel(query); };
    item.append(mark, pick, make("small", `${counts.get(label) ?? 0} faces`));
    all.append(item);
  }
  return all;
}

function toolRow(query) {
  const row = make("p", undefined, { className: "row" });
  row.setAttribute("role", "group");
  row.ariaLabel = "Tool";
  for (const [tool, text] of Object.entries(TOOLS)) row.append(button(text, () => { take(query, tool); showPanel(query); }, { className: "plain small", ariaPressed: String(query.painting.tool === tool), id: `tool-${tool}` }));
  row.append(button("Undo", () => undo(query), { className: "plain small", id: "paint-undo", disabled: !query.painting.past.length }));
  return row;
}

function naming({ painting }, done) {
  const label = make("label", `Name of ${plainName(painting.label).toLowerCase()} `);
  const input = make("input", undefined, { id: "part-name", value: painting.names.get(painting.label) ?? "", placeholder: plainName(painting.label), autocomplete: "off", maxLength: 60 });
  input.onchange = () => {
    const name = cleaned(input.value, painting.label);
    if (name) painting.names.set(painting.label, name);
    else painting.names.delete(painting.label);
    done();
  };
  label.append(input);
  return label;
}

function brushRow(query, there) {
  const { painting } = query;
  const size = make("select", undefined, { id: "brush-size" });
  size.append(...Object.keys(SIZES).map((name) => make("option", name, { value: name })));
  size.value = painting.size;
  size.onchange = () => { painting.size = size.value; };
  const label = make("label", "Brush ");
  label.append(size);
  const fresh = button("New part", () => { painting.label = free([...painting.labels]); show(query); showPanel(query); }, { id: "paint-new", disabled: there.length >= PARTS_MAX });
  const row = make("p", undefined, { className: "row" });
  row.append(label, fresh);
  return row;
}

function merging(query, there) {
  const { painting } = query;
  const others = there.filter((label) => label !== painting.label);
  const into = make("select", undefined, { id: "merge-into", disabled: !others.length || !there.includes(painting.label) });
  into.append(make("option", "…", { value: "" }), ...others.map((label) => make("option", nameOf(painting, label), { value: label })));
  into.onchange = () => { if (into.value !== "") merge(query, painting.label, Number(into.value)); };
  const label = make("label", `Merge ${nameOf(painting, painting.label)} into `);
  label.append(into);
  return label;
}

export function showPainting(query) {
  const { painting } = query;
  const there = used(painting.labels);
  const section = make("section");
  section.append(make("h2", "Making parts"), toolRow(query), make("p", `${HINTS[painting.tool]} Each part has to be one piece: open with one rim, a tube, or closed.`, { className: "soft" }), list(query, used([...there, painting.label])), naming(query, () => showPanel(query)));
  if (painting.tool === "cut") section.querySelector("p.soft").after(make("p", KEYS, { className: "soft" }));
  if (painting.tool === "brush") section.append(brushRow(query, there));
  section.append(merging(query, there));
  const out = make("p", undefined, { className: "row" });
  out.append(button("Use these parts", () => cut(query), { className: "", id: "paint-done", disabled: there.length < 2 }), button("Leave it as it was", () => { end(query); say(""); tools.draw(); showPanel(query); }, { id: "paint-leave" }));
  section.append(out);
  return section;
}
