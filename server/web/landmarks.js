// Landmarks: points of the example and where they belong on the scan, placed before an example is laid by them; with undo, across the
// mirror plane too, and by the names that the example gives.

import { make } from "/web/call.js";
import { lay } from "/web/laying.js";
import { acrossLandmark, isAcross, symmetry } from "/web/mirror.js";
import { button, showPanel } from "/web/panel.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import * as tools from "/web/tools.js";

const LANDMARKS_MAX = 32;
const DEPTH_MAX = 100;

const isFull = (pair) => Boolean(pair.example && pair.input);

// ---- undo

// Called before landmarks are changed: whatever was undone is gone.
function keep(query) {
  query.marks ??= { past: [], later: [] };
  query.marks.past.push(query.pairs.map((p) => ({ ...p })));
  if (query.marks.past.length > DEPTH_MAX) query.marks.past.shift();
  query.marks.later = [];
}

// While landmarks are placed, undo and redo are theirs.
export const canStep = (query, by) => Boolean(query.placing && (by < 0 ? query.marks?.past : query.marks?.later)?.length);

export function step(query, by) {
  const { past, later } = query.marks;
  const [from, to] = by < 0 ? [past, later] : [later, past];
  to.push(query.pairs);
  query.pairs = from.pop();
  waitFor(query);
}

// ---- placing

// Which pane the next click is for.
function waitFor(query) {
  const half = query.pairs.find((p) => !isFull(p));
  bench.viewer.picks = query.placing && (half?.example ? "result" : "example");
  tools.draw();
  showPanel(query);
}

export function pick(query, pane, point) {
  const end = pane === "example" ? "example" : "input";
  const open = query.pairs.find((p) => !isFull(p));
  if (!open && query.pairs.length >= LANDMARKS_MAX) { say(`${LANDMARKS_MAX} landmarks are the most that a map is held by.`, "bad"); return; }
  keep(query);
  if (open) open[end] = point;
  else query.pairs.push({ example: null, input: null, [end]: point });
  if (open && isFull(open)) mirror(query, open);
  // Whoever places a point by name goes on with the next.
  const next = open?.name && query.shown?.named?.find((l) => query.pairs.every((p) => p.name !== l.name));
  if (next) placeNamed(query, next);
  else if (open?.name) place(query, false);
  else waitFor(query);
}

const across = (query, pair) => query.pairs.find((p) => p !== pair && isFull(p) && isAcross(bench.viewer.meshes.example, p.example, pair.example));

// Where editing is mirrored, the landmark across from one: it is placed, or goes along.
function mirror(query, pair) {
  const { meshes } = bench.viewer;
  if (!query.mirrors || !query.shown?.map || !meshes.example || !meshes.quads) return;
  const there = across(query, pair);
  if (!there && query.pairs.length >= LANDMARKS_MAX) return;
  const found = acrossLandmark({ map: query.shown.map, ...meshes }, pair.example, pair.input);
  if (!found) return;
  if (there) { Object.assign(there, found); return; }
  // A point with a name has one across with a name of its own, mostly.
  const named = pair.name && query.shown.named?.find((l) => isAcross(meshes.example, l.point, pair.example));
  if (pair.name && !named) return;
  query.pairs.push({ ...found, ...(named ? { name: named.name, example: named.point } : {}) });
  say("The landmark across was placed, too. Drag its number where it is off.");
}

export function dragged(k, end, point) {
  const { query } = bench;
  const pair = query?.pairs[k];
  if (!pair) return;
  keep(query);
  const there = query.mirrors && isFull(pair) ? across(query, pair) : null;
  pair[end] = point;
  if (there) {
    const found = acrossLandmark({ map: query.shown.map, ...bench.viewer.meshes }, pair.example, pair.input);
    if (found) Object.assign(there, found);
  }
  showPanel(query);
}

function remove(query, k) {
  keep(query);
  const pair = query.pairs[k];
  const there = query.mirrors && isFull(pair) ? across(query, pair) : null;
  query.pairs = query.pairs.filter((p) => p !== pair && p !== there);
  waitFor(query);
}

export function place(query, on) {
  query.placing = on;
  query.pairs = query.pairs.filter((p) => on || isFull(p));
  bench.viewer.picks = on ? "example" : false;
  bench.viewer.canvas.classList.toggle("picking", on);
  tools.set({ layout: on ? "two" : bench.viewer.options.layout });
  if (on) say("Click a point of the example, then where it belongs on the scan. With the keyboard: turn until it lies under the cross, then Enter.");
  else say("");
  showPanel(query);
}

// ---- by name

// Begins a landmark at a point that the example names: its place on the scan is all that is wanted.
function placeNamed(query, { name, point }) {
  query.pairs = query.pairs.filter((p) => isFull(p) && p.name !== name);
  if (query.pairs.length >= LANDMARKS_MAX) { say(`${LANDMARKS_MAX} landmarks are the most that a map is held by.`, "bad"); return; }
  place(query, true);
  query.pairs.push({ name, example: point, input: null });
  bench.viewer.picks = "result";
  say(`Click where “${name}” is on the scan.`);
  tools.draw();
  showPanel(query);
}

// The points that the example names, to be placed on the scan one by one.
function names(query) {
  const { named = [] } = query.shown;
  if (!named.length) return null;
  const box = make("div", undefined, { id: "names" });
  const row = make("p", undefined, { className: "row" });
  for (const [k, landmark] of named.entries()) {
    const pair = query.pairs.find((p) => p.name === landmark.name);
    const isOpen = Boolean(pair && !pair.input);
    const number = pair?.input ? `${query.pairs.indexOf(pair) + 1} · ` : "";
    row.append(button(`${number}${landmark.name}`, () => { if (isOpen) place(query, false); else { keep(query); placeNamed(query, landmark); } }, { className: `plain small${pair?.input ? " placed" : ""}`, ariaPressed: String(isOpen), id: `name-${k}`, title: pair?.input ? "It is placed; click to place it anew" : "Place it on the scan" }));
  }
  box.append(make("p", "This example names points. Choose one, then click where it is on the scan:", { className: "soft" }), row);
  return box;
}

// ---- laying by them

function layHeld(query) {
  const { map, name } = query.shown;
  const landmarks = query.pairs.filter(isFull).map((p, k) => ({ name: p.name ?? String(k + 1), on_example: p.example, on_input: p.input }));
  query.touched = true;
  place(query, false);
  return lay(query, { example: map.example, example_segment: map.example_segment, name }, { landmarks });
}

function item(query, pair, k) {
  const made = make("li", isFull(pair) ? `Landmark ${k + 1} ` : `Landmark ${k + 1}: ${pair.example ? "now where it belongs on the scan" : "now the same point of the example"} `);
  made.append(button("Remove", () => remove(query, k), { className: "plain small", ariaLabel: `Remove landmark ${k + 1}`, id: `pair-${k}` }));
  return made;
}

export function showLandmarks(query) {
  const box = make("div");
  const full = query.pairs.filter(isFull).length;
  const { example } = bench.viewer.meshes;
  const own = names(query);
  if (own) box.append(own);
  box.append(button(query.placing ? "Stop placing" : "Place landmarks", () => place(query, !query.placing), { ariaPressed: String(Boolean(query.placing)), id: "place", disabled: !example }));
  if (query.pairs.some((p) => !p.name)) {
    const items = make("ul", undefined, { id: "pairs" });
    query.pairs.forEach((pair, k) => { if (!pair.name) items.append(item(query, pair, k)); });
    box.append(items);
  }
  if (full) box.append(button(`Lay it by ${full === 1 ? "this landmark" : `these ${full} landmarks`}`, () => layHeld(query), { className: "", id: "lay-held" }));
  if (full && full < 3) box.append(make("p", "Three or more fix how it lies. Drag a number to move it.", { className: "soft" }));
  else if (full) box.append(make("p", "Drag a number to move it.", { className: "soft" }));
  return box;
}

// What is mirrored: constraints and landmarks alike.
export function mirrorButton(query) {
  const { example } = bench.viewer.meshes;
  if (!example || !symmetry(example)) return null;
  const act = () => { query.mirrors = !query.mirrors; showPanel(query); };
  return button("Mirror", act, { ariaPressed: String(Boolean(query.mirrors)), id: "mirror", title: "What is done to a point or a landmark is done to the one across, too: this example is its own mirror image" });
}
