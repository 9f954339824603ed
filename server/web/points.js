// Putting a map right: points that hold the quads are dragged, pinned and taken off; with undo, redo, and by keyboard.

import { $, buffer, make, send } from "/web/call.js";
import * as cutkeys from "/web/cutkeys.js";
import { canRedo, canUndo, step } from "/web/history.js";
import { showMap } from "/web/laying.js";
import * as landmarks from "/web/landmarks.js";
import { across } from "/web/mirror.js";
import { brush, stroke, undo as undoPainting } from "/web/painting.js";
import { button, showPanel } from "/web/panel.js";
import { readPly } from "/web/read.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";

// By how far (in CSS pixels) an arrow key moves a point.
const NUDGE = 6;
const NUDGE_PAUSE_MS = 350;

// ---- points

export function showOnScan(query) {
  const { map } = query.shown ?? {};
  bench.viewer.setPoints(map ? map.constraints.map((c) => ({ id: c.id, origin: c.origin, point: c.on_input.point, chosen: c.id === query.point })) : []);
  bench.viewer.setPairs(query.pairs.map((p, k) => ({ ...p, name: String(k + 1) })));
}

// Sends an edit, and shows what came of it. While a point is dragged (`isLive`) edits that would fold are passed over, and
// only what it is at last counts as a step of undo.
async function edit(query, change, isLive = false) {
  const { map, path } = query.shown;
  const begun = performance.now();
  try {
    const now = await send(`${path}/constraints`, change, "PATCH");
    if (bench.query !== query || query.shown.map?.id !== map.id) return;
    if (isLive) {
      const mesh = readPly(await buffer(`${path}/mesh?format=ply`));
      if (bench.query !== query || !query.shown.map) return;
      query.shown.map = now;
      bench.viewer.setQuads(mesh);
      showOnScan(query);
      bench.viewer.bend();
      query.editMs = performance.now() - begun;
      return;
    }
    await showMap(query, now);
    query.editMs = performance.now() - begun;
    say("");
    showPanel(query);
  } catch (error) {
    if (isLive) return;
    bench.viewer.sendQuads();
    showPanel(query);
    if (error.code !== "constraint_folds") throw error;
    const status = $("status");
    say("The quads would fold there. Move the point less, or ", "bad");
    status.append(button("let the other points make room", () => edit(query, { ...change, on_fold: "resolve" }), { className: "plain small" }));
  }
}

// What moves a point of the map; where editing is mirrored, the one across, too.
function moves(query, id, point) {
  const { map } = query.shown;
  const set = [{ id, on_input: point }];
  const from = map.constraints.find((c) => c.id === id);
  const other = query.mirrors && from ? across({ map, ...bench.viewer.meshes }, from.on_example.point, point) : null;
  if (other && other.id !== id) set.push(other);
  return { set };
}

// What pins a point of the quads where it is.
function pins(query, { face, barycentric, point }) {
  const set = [{ on_example: { face, barycentric }, on_input: point }];
  const { example, quads } = bench.viewer.meshes;
  const at = query.mirrors && example ? onExample(query.shown.map, example, quads, { face, barycentric }) : null;
  const other = at ? across({ map: query.shown.map, example, quads }, at, point) : null;
  if (other) set.push(other);
  return { set };
}

// The place on the example of a place on the quads that are its own.
function onExample({ kept }, example, quads, { face, barycentric }) {
  const corners = quads.corners.subarray(quads.starts[face], quads.starts[face + 1]);
  const at = [0, 0, 0];
  for (const [k, v] of corners.entries()) {
    const own = kept ? kept[v] : v;
    if (own === undefined || 3 * own + 2 >= example.positions.length) return null;
    for (let c = 0; c < 3; c++) at[c] += barycentric[k] * example.positions[3 * own + c];
  }
  return at;
}

let sending = null;
let waiting = null;

// While a point is dragged the quads follow: one edit at a time, and the newest place of those that came meanwhile.
async function follow(query, id, point) {
  waiting = point;
  if (sending) return;
  const run = async () => {
    while (waiting && bench.query === query) {
      const at = waiting;
      waiting = null;
      await edit(query, moves(query, id, at), true);
    }
  };
  sending = run();
  await sending;
  sending = null;
}

export const hooks = {
  onbrush: brush,
  onstroke: stroke,
  ondrag(id, point) { if (bench.query?.shown?.map) follow(bench.query, id, point); },
  async ondrop(id, point) {
    const { query } = bench;
    if (!query?.shown?.map) return;
    waiting = null;
    query.point = id;
    // The last word is this one's, not that of an edit still under way.
    await sending;
    if (bench.query !== query || !query.shown?.map) return;
    if (point) await edit(query, moves(query, id, point)).catch((error) => say(error.message, "bad"));
    else showPanel(query);
  },
  onpin(found) {
    const { query } = bench;
    if (query?.shown?.map) edit(query, pins(query, found)).catch((error) => say(error.message, "bad"));
  },
  onpick(pane, { face, point }) {
    const { query } = bench;
    if (!query) return;
    if (query.placing) landmarks.pick(query, pane, point);
    else bench.onpart(pane, face);
  },
  onpair: landmarks.dragged,
  ondraw: cutkeys.draw,
};

export async function undo(by) {
  const { query } = bench;
  if (query && landmarks.canStep(query, by)) { landmarks.step(query, by); return; }
  if (!query?.past.length || !query.past[query.at + by]) return;
  try {
    const map = await step(query, by);
    if (map) await showMap(query, map, { keep: false });
    say(by < 0 ? "Undone." : "Done again.");
  } catch (error) { say(error.message, "bad"); }
}

// ---- the keyboard

function nudge(query, key) {
  const { viewer } = bench;
  const by = { ArrowLeft: [-NUDGE, 0], ArrowRight: [NUDGE, 0], ArrowUp: [0, -NUDGE], ArrowDown: [0, NUDGE] }[key];
  const point = viewer.points.find((p) => p.id === query.point);
  if (!by || !point) return;
  const box = viewer.paneBoxes().find((b) => b.name === "result");
  const { left, top } = viewer.canvas.getBoundingClientRect();
  const [x, y] = viewer.onScreen(query.nudged ?? point.point, box);
  const found = viewer.under({ clientX: left + x + by[0], clientY: top + y + by[1] }, box);
  if (!found) return;
  query.nudged = found.point;
  viewer.setPoints(viewer.points.map((p) => (p.id === query.point ? { ...p, point: found.point } : p)));
  clearTimeout(query.nudging);
  query.nudging = setTimeout(() => {
    const to = query.nudged;
    query.nudged = null;
    edit(query, moves(query, query.point, to)).catch((error) => say(error.message, "bad"));
  }, NUDGE_PAUSE_MS);
}

export function begin(canvas) {
  cutkeys.begin(canvas);
  canvas.addEventListener("keydown", cutkeys.key);
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName)) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    if (bench.query?.painting) { if (key === "z" && !event.shiftKey) undoPainting(bench.query); } else undo(key === "y" || event.shiftKey ? 1 : -1);
  });
  document.addEventListener("keydown", (event) => {
    const { query } = bench;
    if (!query?.shown?.map) return;
    if (event.key === "Escape" && query.placing) { landmarks.place(query, false); return; }
    if (event.target === canvas && event.key === "Enter" && query.placing) {
      const pane = bench.viewer.picks;
      const found = bench.viewer.inTheMiddle(pane);
      if (found) hooks.onpick(pane, found);
      event.preventDefault();
    }
    if (event.altKey && event.key.startsWith("Arrow") && query.point) { event.preventDefault(); nudge(query, event.key); }
  });
}

// ---- the panel's part

function list(query) {
  const { map } = query.shown;
  const items = make("ul", undefined, { id: "points" });
  // What a caller set stands first.
  const points = [...map.constraints].sort((a, b) => (a.origin === "user" ? 0 : 1) - (b.origin === "user" ? 0 : 1));
  for (const c of points) {
    const item = make("li", undefined, { className: c.id === query.point ? "chosen" : "" });
    const what = c.origin === "user" ? (c.id.startsWith("f") ? "moved" : "yours") : "matched";
    item.append(button(`Point ${c.id} · ${what}`, () => { query.point = query.point === c.id ? null : c.id; showPanel(query); }, { className: "plain small", ariaPressed: String(c.id === query.point), id: `point-${c.id}` }));
    if (c.origin === "user") item.append(button("Put back", () => edit(query, { undo: [c.id] }), { className: "plain small", ariaLabel: `Put back point ${c.id}`, id: `back-${c.id}` }));
    else item.append(button("Remove", () => edit(query, { remove: [c.id] }), { className: "plain small", ariaLabel: `Remove point ${c.id}`, id: `remove-${c.id}` }));
    items.append(item);
  }
  return items;
}

export function showPoints(query) {
  const { map } = query.shown;
  if (!map.constraints.some((c) => c.id === query.point)) query.point = null;
  showOnScan(query);
  const section = make("section");
  const row = make("p", undefined, { className: "row" });
  row.append(button("Undo", () => undo(-1), { disabled: !canUndo(query) && !landmarks.canStep(query, -1), id: "undo", title: "Ctrl+Z" }), button("Redo", () => undo(1), { disabled: !canRedo(query) && !landmarks.canStep(query, 1), id: "redo", title: "Ctrl+Shift+Z" }));
  const mirror = landmarks.mirrorButton(query);
  if (mirror) row.append(mirror);
  section.append(make("h2", "Put it right"), row, landmarks.showLandmarks(query));
  if (map.constraints.length) {
    section.append(make("p", "Or drag a blue point to where it belongs; double-click the quads to pin another. Alt and the arrow keys move the chosen point.", { className: "soft" }));
    const box = make("details", undefined, { id: "point-list", open: $("point-list")?.open ?? false });
    const inner = make("div");
    inner.append(list(query));
    box.append(make("summary", `${map.constraints.length} points`), inner);
    section.append(box);
  } else section.append(make("p", "Double-click the quads to pin a point, then drag it to where it belongs.", { className: "soft" }));
  return section;
}

