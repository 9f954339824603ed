// What is laid on the scan: the best by itself, another by a click, and all parts stitched.

import { chooseSegment } from "/web/bench.js";
import { $, buffer, json } from "/web/call.js";
import { record } from "/web/history.js";
import { attend, made as make } from "/web/making.js";
import { faceCount } from "/web/mesh.js";
import { showPanel } from "/web/panel.js";
import { similarity } from "/web/pose.js";
import { drawRanking, inTurn, isTemplate, nameOf } from "/web/ranking.js";
import { readPly } from "/web/read.js";
import { go } from "/web/route.js";
import { bench } from "/web/state.js";
import { busy, say } from "/web/status.js";
import * as tools from "/web/tools.js";
import { mismatch } from "/web/words.js";

const RANKS = ["good", "fair", "poor", "broken"];
const isBad = (verdict) => verdict === "poor" || verdict === "broken";
// A poor map that leaves so much of the scan bare is no better than a broken one.
const COVERED_MIN = 0.7;
const badness = (map) => (map.verdict === "poor" && map.covers.input < COVERED_MIN ? RANKS.length - 1 : RANKS.indexOf(map.verdict));

// What a map that is not poor is worth beside others, as the service's own programs count it: how sure it is, times the share of the
// scan that its example covers.
const SURE = { good: 0.5, fair: 0.2 };
const SURE_MIN = 0.01;
// From this worth on no other example has to be tried.
const ENOUGH = 0.1;
const worth = (map) => (isBad(map.verdict) ? -1 - badness(map) : Math.max(SURE_MIN, map.evidence?.agreement ?? SURE[map.verdict]) * map.covers.input);

const meshes = new Map();
const facts = new Map();

// What is known of an example, but for its mesh.
const factsOf = (id) => {
  if (!facts.has(id)) facts.set(id, json(`/v1/examples/${id}`).catch(() => { facts.delete(id); return null; }));
  return facts.get(id);
};

export const forgetFacts = (id) => facts.delete(id);

// A mesh of the corpus, kept for when it is laid again.
export function exampleMesh(id) {
  if (!meshes.has(id)) {
    if (meshes.size > 24) meshes.delete(meshes.keys().next().value);
    meshes.set(id, buffer(`/v1/examples/${id}/mesh?format=ply`).then(readPly));
    meshes.get(id).catch(() => meshes.delete(id));
  }
  return meshes.get(id);
}

// The ranking of the part that is chosen, as cards.
export function draw(query = bench.query) {
  const ranking = query?.rankings.get(query.segment);
  if (!ranking) return;
  const own = ranking.entries.filter((e) => !isTemplate(e)).length;
  $("ranking-title").textContent = own ? (ranking.corpus_size === 1 ? "The only example" : `Best of ${ranking.corpus_size} examples`) : "Regular layouts";
  const missing = ranking.incomplete ?? [];
  $("ranking-missing").hidden = missing.length === 0;
  $("ranking-missing").textContent = `Incomplete: nobody answered for share ${missing.join(", ")} of the corpus. Drop the scan again once its server is back.`;
  drawRanking(ranking.entries, query.laid.get(query.segment)?.key, (entry) => {
    query.touched = true;
    // Whoever lays an example on a part has chosen it for that part.
    if (query.segments.length > 1) (query.chosen ??= new Set()).add(query.segment);
    lay(query, entry).catch((error) => say(error.message, "bad"));
  });
}

// The best is laid by itself: the first that is good or worth enough, of as many as are worth a try; else the one that is worth most.
export async function layBest(query) {
  if (query.segments.length > 1) { await (query.like ? layLike(query) : stitch(query, {})); return; }
  const { tries, topology } = query.segments[0];
  const entries = query.rankings.get(0)?.entries ?? [];
  const candidates = inTurn(entries);
  const isEmpty = entries.length === 0 || isTemplate(entries[0]);
  if (tries === 0 && !isEmpty) { say("This scan has too little form to choose an example by. Choose one yourself, or lay a regular layout."); return; }
  if (isEmpty || candidates.length === 0) {
    const ready = await json("/readyz").catch(() => null);
    const others = ready?.examples ? await surfaces() : [];
    query.mismatch = others.length > 0;
    const isAmongThem = others.includes(topology) && "No example lies well on this scan. Choose one yourself, cut the scan into parts, or lay a regular layout.";
    say(isAmongThem || (others.length ? mismatch(topology, others) : "The corpus is empty. Add examples, or lay a regular layout."), "bad");
    showPanel(query);
    return;
  }
  let best = null;
  for (const [k, entry] of candidates.entries()) {
    const map = await lay(query, entry, { beats: best });
    if (!map || bench.query !== query || query.touched) return;
    if (!best || worth(map) > worth(best)) best = map;
    if (map.verdict === "good" || worth(map) >= ENOUGH) return;
    if (k + 1 < candidates.length) say(`${nameOf(entry)} does not fit well enough; trying the next.`);
  }
}

// What was cut as an example is takes that example, part by part.
async function layLike(query) {
  const { example, name } = query.like;
  query.chosen = new Set();
  for (const { segment } of query.segments) {
    chooseSegment(segment);
    if (!(await lay(query, { example, example_segment: segment, name })) || bench.query !== query || query.touched) return;
    query.chosen.add(segment);
  }
  chooseSegment(query.segments[0].segment);
  await stitch(query, {});
}

async function surfaces() {
  const kinds = ["disc", "annulus", "sphere", "torus"];
  const found = await Promise.all(kinds.map((t) => json(`/v1/examples?limit=1&topology=${t}`).catch(() => ({ items: [] }))));
  return kinds.filter((_, k) => found[k].items.some((e) => !e.template));
}

// The points of the scan that were placed by name, where the example has the same names.
async function namesFor(query, entry) {
  const placed = query.pairs.filter((p) => p.name && p.input);
  if (!placed.length || isTemplate(entry)) return {};
  const known = new Set(((await factsOf(entry.example))?.landmarks ?? []).map((l) => l.name));
  return Object.fromEntries(placed.filter((p) => known.has(p.name)).map((p) => [p.name, p.input]));
}

// Lays an entry on the scan, and shows it, unless `beats` names a map that is as good.
export async function lay(query, entry, { landmarks = [], beyond = "leave", beats = null } = {}) {
  const begun = performance.now();
  const { segment } = query;
  const names = landmarks.length ? {} : await namesFor(query, entry);
  const met = Object.keys(names).length;
  const body = { segment, example: entry.example, example_segment: entry.example_segment, beyond, ...(landmarks.length ? { landmarks } : {}), ...(met ? { names } : {}) };
  const map = await busy(`Laying ${nameOf(entry)} on the scan…`, (signal, tell) => make(`/v1/queries/${query.id}/maps`, body, signal, (_, share) => tell(`Laying ${nameOf(entry)} on the scan…`, share)));
  if (!map || bench.query !== query) return null;
  if (beats && worth(map) <= worth(beats)) return map;
  await showMap(query, map);
  query.layMs = performance.now() - begun;
  say(`${nameOf(entry)} was laid in ${(query.layMs / 1000).toFixed(1)} s${met ? `, held by ${met === 1 ? "the point" : `${met} points`} that the scan and it both name` : ""}.`);
  return map;
}

// How the example lies in the scan's frame, and which of its faces are laid; null where that can't be told.
function correspond(map, example, quads) {
  const count = map.kept?.length ?? example.positions.length / 3;
  if (count !== map.own_vertices || count < 3) return null;
  const from = map.kept ? Float64Array.from({ length: 3 * count }, (_, k) => example.positions[3 * map.kept[Math.floor(k / 3)] + (k % 3)]) : example.positions;
  return similarity(from, quads.positions, count);
}

// The faces of an example that are laid stand out where others are left out.
function highlight(map, example) {
  if (!map.kept || map.kept.length === example.positions.length / 3) return null;
  const has = new Set(map.kept);
  const isLaid = (f) => example.corners.subarray(example.starts[f], example.starts[f + 1]).every((v) => has.has(v));
  return (f) => (isLaid(f) ? [0.93, 0.86, 0.7] : [0.62, 0.64, 0.68]);
}

export async function showMap(query, map, { keep = true } = {}) {
  const path = `/v1/queries/${query.id}/maps/${map.id}`;
  const template = isTemplate({ example: map.example });
  const [bytes, example] = await Promise.all([buffer(`${path}/mesh?format=ply`), template ? null : exampleMesh(map.example).catch(() => null)]);
  if (bench.query !== query) return;
  const { viewer } = bench;
  const quads = readPly(bytes);
  const isNew = query.shown?.map?.example !== map.example || query.shown?.map?.segment !== map.segment;
  query.shown = { map, path };
  query.laid.set(map.segment, { key: `${map.example}:${map.example_segment}`, map: map.id });
  query.quads = faceCount(quads);
  viewer.setQuads(quads);
  if (isNew) viewer.setExample(example, example ? { lies: correspond(map, example, quads), tint: highlight(map, example) } : {});
  if (keep) record(query, map);
  const entry = query.rankings.get(map.segment)?.entries.find((e) => e.example === map.example);
  const known = template ? null : await factsOf(map.example);
  const name = template ? "Regular layout" : known?.name || (entry ? nameOf(entry) : map.example);
  query.shown.name = name;
  query.shown.named = known?.landmarks ?? [];
  // Points of another example mean nothing on this one, but for those that both name.
  if (isNew) query.pairs = query.pairs.flatMap((p) => { const own = p.name && query.shown.named.find((l) => l.name === p.name); return own ? [{ ...p, example: own.point }] : []; });
  query.shown.inParts = (known?.segments.filter((s) => !s.is_part).length ?? 0) > 1;
  query.shown.topology = known?.segments.find((s) => s.segment === map.example_segment)?.topology;
  tools.setNames({ example: name, result: `${query.name} with ${faceCount(quads)} quads` });
  tools.set({ layout: viewer.options.layout, show: query.segments.length > 1 ? "over" : viewer.options.show === "scan" ? "quads" : viewer.options.show });
  tools.setLaid({ kept: map.kept, ownFaces: map.own_faces });
  go(`${query.id}/map/${map.id}`);
  draw(query);
  showPanel(query);
}

// ---- stitching

export async function stitch(query, { density = 0 }) {
  const parts = [...query.laid].filter(([segment]) => query.chosen?.has(segment)).map(([segment, { map }]) => ({ segment, map }));
  // Whoever chose a part wants its layout.
  const body = { parts, keep: parts.map((p) => p.segment), density };
  const made = await busy(`Laying an example on each of ${query.segments.length} parts, and stitching them…`, (signal, tell) => make(`/v1/queries/${query.id}/compositions`, body, signal, tell));
  if (!made || bench.query !== query) { if (bench.query === query) showPanel(query); return; }
  say(`Stitched in ${(made.total_ms / 1000).toFixed(1)} s.`);
  await showComposition(query, made);
}

// Quads for all of a scan in one piece: those that an example has on the whole of it, or, where that is little, on its parts. For these the
// server cuts it anew, and the page goes on with what was cut.
export async function layAll(query) {
  query.touched = true;
  const done = await busy("Laying examples on all of the scan…", (signal, tell) => make(`/v1/queries/${query.id}/retopos`, {}, signal, tell));
  if (!done || bench.query !== query) { if (bench.query === query) showPanel(query); return; }
  const { map, composition } = done.result;
  if (done.result_query !== query.id) await bench.goOn(query, done.result_query, { map, composition });
  else if (map) await showMap(query, await json(`/v1/queries/${query.id}/maps/${map}`));
  else await showComposition(query, await json(`/v1/queries/${query.id}/compositions/${composition}`));
  say(`Quads for all of it in ${(done.total_ms / 1000).toFixed(1)} s.`);
}

// The map of a scan in one piece, with denser or coarser quads; 0 shows the map itself.
export async function refine(query, density) {
  const map = query.shown.map?.id ?? query.shown.made.parts[0]?.map;
  if (!map) { say("This is a regular layout, and has no other density.", "bad"); showPanel(query); return; }
  query.touched = true;
  if (!density) { await showMap(query, await json(`/v1/queries/${query.id}/maps/${map}`)); say(""); return; }
  const body = { parts: [{ segment: 0, map }], keep: [0], density };
  const made = await busy("Changing the density of the quads…", (signal, tell) => make(`/v1/queries/${query.id}/compositions`, body, signal, tell));
  if (!made || bench.query !== query) { if (bench.query === query) showPanel(query); return; }
  await showComposition(query, made);
  say(made.quads === query.quads ? "This layout can't be made coarser." : `${made.quads} quads, in ${(made.total_ms / 1000).toFixed(1)} s.`);
}

// What was being made when the page was loaded: it is followed on, and shown.
export async function resume(query, making) {
  const of = making.product === "map" ? "maps" : "compositions";
  const now = await busy("Going on with what was begun…", (signal, tell) => attend(`/v1/queries/${query.id}/${of}/${making.id}`, making, signal, tell));
  if (!now || bench.query !== query) return;
  await (making.product === "map" ? showMap(query, now) : showComposition(query, now));
  say("");
}

// What each part took, by its number: the name of an example, or that it is a regular layout.
async function taken(query, { parts, templates }) {
  const { items } = await json(`/v1/queries/${query.id}/maps`);
  const names = new Map(templates.map((segment) => [segment, "a regular layout"]));
  await Promise.all(parts.map(async ({ segment, map }) => {
    const of = items.find((m) => m.id === map)?.example;
    const known = of && !isTemplate({ example: of }) ? await factsOf(of) : null;
    if (known) names.set(segment, known.name || of);
  }));
  return names;
}

export async function showComposition(query, made) {
  const path = `/v1/queries/${query.id}/compositions/${made.id}`;
  const [bytes, took] = await Promise.all([buffer(`${path}/mesh?format=ply`), taken(query, made).catch(() => new Map())]);
  if (bench.query !== query) return;
  const quads = readPly(bytes);
  query.took = took;
  query.touched = true;
  const inParts = query.segments.length > 1;
  query.shown = { made, path, name: inParts ? "all parts" : `${made.quads} quads` };
  bench.viewer.setQuads(quads);
  bench.viewer.setExample(null);
  bench.viewer.setPoints([]);
  bench.viewer.setPairs([]);
  tools.setNames({ example: "", result: inParts ? `${query.name}, stitched: ${made.quads} quads` : `${query.name} with ${made.quads} quads` });
  tools.set({ layout: "one", show: "quads" });
  tools.setLaid(null);
  go(`${query.id}/composition/${made.id}`);
  showPanel(query);
}
