// The workbench: one scan at a time, its ranking, and what is laid on it.

import { $, buffer, call, canStartAgain, json, make, sentence } from "/web/call.js";
import { follow } from "/web/follow.js";
import { draw, layBest, resume, showComposition, showMap } from "/web/laying.js";
import { showPanel } from "/web/panel.js";
import { adopt, namesOf, partName } from "/web/partnames.js";
import { readPly } from "/web/read.js";
import { go } from "/web/route.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import * as tools from "/web/tools.js";
import { ENDS } from "/web/words.js";

// Shows a mesh before the server knows it.
export function preview(mesh, name) {
  bench.query?.stop.abort();
  bench.query = null;
  bench.viewer.clear();
  $("welcome").hidden = true;
  $("trouble").textContent = "";
  $("ranking").hidden = true;
  $("panel").replaceChildren();
  if (mesh) bench.viewer.setScan(mesh);
  tools.setNames({ result: name, example: "" });
  tools.set({ layout: "one", show: "quads" });
}

// Nothing is open any more.
export function close() {
  bench.query?.stop.abort();
  bench.query = null;
  bench.viewer.clear();
  $("welcome").hidden = false;
  $("ranking").hidden = true;
  $("panel").replaceChildren();
  tools.setNames({ result: "", example: "" });
  tools.draw();
  say("");
  go("");
}

// The parts among which the ranking's is chosen.
export function showSegments(query) {
  $("segment").replaceChildren(...query.segments.map((s) => make("option", `${partName(query, s.segment)} (${s.faces} faces)`, { value: s.segment })));
  $("segment").value = query.segment;
  $("segment-row").hidden = query.segments.length < 2;
}

// Opens a query; `mesh`: as it was read here, if it was; `wanted`: the map or composition to show; `made`: the labels of its
// faces and their names, where its parts were made here; `like`: the example that it was cut as.
export async function open(started, { mesh = null, name = "", wanted = {}, made = null, like = null } = {}) {
  bench.query?.stop.abort();
  const query = { id: started.id, name: name || `scan of ${started.counts.faces} faces`, state: started.state, repairs: started.repairs, segments: started.segments, names: namesOf(started), segment: 0, rankings: new Map(), ended: false, shown: null, laid: new Map(), touched: false, like, stop: new AbortController(), past: [], at: -1, pairs: [] };
  bench.query = query;
  $("welcome").hidden = true;
  $("trouble").textContent = "";
  $("ranking").hidden = false;
  $("entries").replaceChildren();
  $("progress").value = 0;
  $("progress").hidden = false;
  $("state").textContent = "Looking at its form…";
  say("");
  $("panel").replaceChildren();
  showSegments(query);
  go([query.id, ...Object.entries(wanted).filter(([, id]) => id)[0] ?? []].join("/"));
  bench.onchange();
  try {
    const viewer = bench.viewer;
    viewer.clear();
    // What is cut into parts is fetched with its parts.
    query.mesh = mesh && started.segments.length < 2 ? mesh : readPly(await buffer(`/v1/queries/${query.id}/mesh?format=ply`));
    if (bench.query !== query) return;
    if (made) {
      adopt(query, made).catch((error) => { say(error.message, "bad"); showSegments(query); });
      showSegments(query);
    }
    viewer.setScan(query.mesh);
    tools.setNames({ result: query.name, example: "" });
    tools.set({ layout: "one", show: "quads" });
    if (query.segments.length > 1) showPanel(query);
    query.before = showBefore(query, wanted);
    const open = started.making?.findLast((m) => m.state === "queued" || m.state === "running");
    if (open) {
      query.touched = true;
      query.before.then(() => resume(query, open)).catch((error) => say(error.message, "bad"));
    }
    follow(query.id, query.stop.signal, (event) => take(query, event)).catch((error) => lost(query, error));
    await query.before;
  } catch (error) { lost(query, error); }
}

// The server that had a scan, one of several, is gone, or let it go as nobody asked for it: it is started again with what is
// kept of it.
const startAgain = (id) => json(`/v1/queries/${id}/restart`, { method: "POST" });

async function goOn(query, isLetGo) {
  query.stop.abort();
  const started = await startAgain(query.id);
  if (bench.query !== query) return;
  await open(started, { mesh: query.mesh, name: query.name });
  say(isLetGo ? "The server had let this scan go; it has started it again." : "The server that had this scan is gone; another one has started it again.");
}

function lost(query, error) {
  if (bench.query !== query) return;
  if (canStartAgain(error)) {
    // Told by whoever asks first.
    if (!query.isGone) goOn(query, error.code === "query_expired").catch((failed) => lost(query, failed));
    query.isGone = true;
    return;
  }
  const gone = error.code === "not_found";
  say(gone ? "The server no longer holds this scan: it keeps scans while it runs, and as long as it has room. Drop the file again." : error.message, "bad");
  if (gone) $("state").textContent = "";
}

// What was laid before the page was loaded: the one that the address names, or the last.
async function showBefore(query, { map, composition }) {
  if (composition) { await showComposition(query, await json(`/v1/queries/${query.id}/compositions/${composition}`)); return; }
  const { items } = await json(`/v1/queries/${query.id}/maps`);
  const shown = items.find((m) => m.id === map) ?? items.at(-1);
  items.forEach((m) => query.laid.set(m.segment, { key: `${m.example}:${m.example_segment}`, map: m.id }));
  if (shown && bench.query === query && (map || query.segments.length < 2)) { query.touched = true; await showMap(query, shown); }
}

// ---- the ranking

function take(query, event) {
  if (bench.query !== query) return true;
  if (event.event === "begin") $("state").textContent = event.corpus_size ? "Comparing with the corpus…" : "";
  if (event.event === "level") {
    query.rankings.set(event.segment, event);
    query.firstCard ??= performance.now();
    const done = [...query.rankings.values()].reduce((sum, r) => sum + Math.log2(r.level / 16) / Math.log2(r.resolution / 16), 0);
    $("progress").value = done / Math.max(1, query.segments.length);
    if (event.segment === query.segment) draw(query);
  }
  if (event.event === "end") { ended(query, event); return true; }
  return false;
}

function ended(query, { state, summary }) {
  query.ended = true;
  query.state = state;
  query.segments = summary.segments;
  $("progress").value = 1;
  $("progress").hidden = true;
  $("state").textContent = `${ENDS[state]} after ${(summary.timings.total_ms / 1000).toFixed(1)} s`;
  if (summary.problem) say(sentence(summary.problem.detail), "bad");
  bench.onchange();
  draw(query);
  // What was laid before comes first: it may still be on its way.
  const isNew = () => (state === "done" || state === "deadline") && bench.query === query && !query.touched && !query.shown;
  query.before.then(() => (isNew() ? layBest(query) : null)).catch((error) => say(error.message, "bad"));
}

export function chooseSegment(segment) {
  if (!bench.query) return;
  bench.query.segment = segment;
  $("segment").value = segment;
  draw();
}

// Opens the query that the address names.
export async function openById(id, wanted, name) {
  try {
    const found = await json(`/v1/queries/${id}`).catch((error) => (canStartAgain(error) ? startAgain(id) : Promise.reject(error)));
    await open(found, { name, wanted: found.id === id ? wanted : {} });
  } catch (error) {
    say(error.code === "not_found" || error.status === 404 ? "The server no longer holds this scan: it keeps scans while it runs, and as long as it has room. Drop the file again." : error.message, "bad");
    $("welcome").hidden = false;
    go("");
  }
}

export const cancelQuery = (id) => call(`/v1/queries/${id}`, { method: "DELETE" });
