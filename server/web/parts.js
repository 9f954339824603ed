// The parts of a scan: coloured, picked in the view or by name, each with an example of its own, and stitched.

import { make } from "/web/call.js";
import { lay } from "/web/laying.js";
import { chooseSegment, showSegments } from "/web/bench.js";
import { begin } from "/web/painting.js";
import { cleaned, partName, plainName, rename } from "/web/partnames.js";
import { button, showPanel } from "/web/panel.js";
import { key, nameOf } from "/web/ranking.js";
import { areas } from "/web/regions.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import * as tools from "/web/tools.js";
import { DENSITIES, SURFACES } from "/web/words.js";

// Colours that differ from their neighbours: steps of the golden angle around the hue.
export function colourOf(segment, isChosen) {
  const hue = (segment * 137.508 + 20) % 360;
  const [s, l] = isChosen ? [0.75, 0.6] : [0.32, 0.74];
  const f = (n) => { const k = (n + hue / 30) % 12; return l - s * Math.min(l, 1 - l) * Math.max(-1, Math.min(k - 3, 9 - k, 1)); };
  return [f(0), f(8), f(4)];
}

export const css = (rgb) => `rgb(${rgb.map((x) => Math.round(255 * x)).join(" ")})`;

export function paint(query) {
  if (query.painted === query.segment) return;
  query.painted = query.segment;
  const many = query.segments.length > 1 && query.mesh.segments;
  bench.viewer.tintScan(many ? query.segments.map((s) => colourOf(s.segment, s.segment === query.segment)) : null);
}

// A click on a part chooses it.
bench.onpart = (pane, face) => {
  const { query } = bench;
  const segment = query?.mesh.segments?.[face];
  if (pane === "result" && segment !== undefined) choose(query, segment);
};

export function choose(query, segment) {
  chooseSegment(segment);
  showPanel(query);
}

const example = (query, segment) => {
  const laid = query.laid.get(segment);
  if (!laid) return null;
  // What came from a part that is like it needn't stand in its own ranking.
  const rankings = [query.rankings.get(segment), ...query.rankings.values()];
  return rankings.flatMap((ranking) => ranking?.entries ?? []).find((e) => key(e) === laid.key) ?? null;
};

// Parts that are alike: of the same surface, and of a like size.
const SIZE_APART = 2.5;

function alikeParts(query) {
  const { segments: of } = query.mesh;
  if (!of) return [];
  const [size, sums] = [areas(query.mesh), new Map()];
  for (let f = 0; f < of.length; f++) sums.set(of[f], (sums.get(of[f]) ?? 0) + size[f]);
  const own = query.segments.find((s) => s.segment === query.segment);
  const isAlike = (s) => { const by = sums.get(s.segment) / sums.get(own.segment); return s.topology === own.topology && by < SIZE_APART && by > 1 / SIZE_APART; };
  return query.segments.filter((s) => s !== own && isAlike(s)).map((s) => s.segment);
}

// Lays what was chosen for a part on those that are alike, and tells which did not take it.
async function layAlike(query, entry, parts) {
  const { segment } = query;
  const refused = [];
  query.touched = true;
  for (const other of parts) {
    chooseSegment(other);
    const before = query.laid.get(other);
    const map = await lay(query, entry);
    if (bench.query !== query || !map) return;
    if (map.verdict === "broken" || map.verdict === "poor") {
      refused.push(other);
      if (before) query.laid.set(other, before);
      else query.laid.delete(other);
    } else query.chosen.add(other);
  }
  choose(query, segment);
  const took = parts.length - refused.length;
  say(`${nameOf(entry)} lies on ${took} more ${took === 1 ? "part" : "parts"} now.${refused.length ? ` It does not fit ${refused.map((s) => partName(query, s)).join(", ")}.` : ""}`);
}

function alikeRow(query) {
  const own = query.chosen?.has(query.segment) ? example(query, query.segment) : null;
  const parts = own ? alikeParts(query).filter((s) => !query.chosen.has(s) || example(query, s)?.example !== own.example) : [];
  if (!parts.length) return null;
  const row = make("p", undefined, { className: "row" });
  row.append(button(`Lay ${nameOf(own)} on ${parts.map((s) => partName(query, s)).join(", ")}, too`, () => layAlike(query, own, parts), { id: "alike", title: "Parts of the same kind and size take the same example" }));
  return row;
}

function item(query, { segment, topology, faces }) {
  const made = make("li", undefined, { className: segment === query.segment ? "chosen" : "" });
  const dot = make("span", undefined, { className: "dot" });
  dot.style.background = css(colourOf(segment, segment === query.segment));
  const pick = make("button", partName(query, segment), { type: "button", className: "part", ariaPressed: String(segment === query.segment), id: `part-${segment}` });
  pick.onclick = () => choose(query, segment);
  const own = query.chosen?.has(segment) ? example(query, segment) : null;
  made.append(dot, pick, make("small", `${SURFACES[topology] ?? topology}, ${faces} faces · ${own ? nameOf(own) : query.took?.get(segment) ?? "its best example"}`));
  if (own) made.append(button("Forget", () => { query.chosen.delete(segment); query.laid.delete(segment); chooseSegment(segment); showPanel(query); }, { className: "plain small", ariaLabel: `Forget the example of ${partName(query, segment)}`, id: `forget-${segment}` }));
  return made;
}

export function showParts(query, { stitch }) {
  paint(query);
  const section = make("section");
  const list = make("ul", undefined, { id: "part-list" });
  list.append(...query.segments.map((s) => item(query, s)));
  const called = make("label", `Name of ${plainName(query.segment).toLowerCase()} `);
  const name = make("input", undefined, { id: "part-name", value: partName(query, query.segment) === plainName(query.segment) ? "" : partName(query, query.segment), placeholder: plainName(query.segment), autocomplete: "off", maxLength: 60 });
  name.onchange = () => {
    const show = () => { if (bench.query === query) { showSegments(query); showPanel(query); } };
    rename(query, [{ segment: query.segment, name: cleaned(name.value, query.segment) }]).catch((error) => { say(error.message, "bad"); show(); });
    show();
  };
  called.append(name);
  const label = make("label", "Density ");
  const density = make("select", undefined, { id: "density" });
  density.append(...Object.entries(DENSITIES).map(([value, text]) => make("option", text, { value })));
  density.value = String(query.density ?? 0);
  density.onchange = () => { query.density = Number(density.value); };
  label.append(density);
  const row = make("p", undefined, { className: "row" });
  row.append(button("Stitch all parts", () => { query.touched = true; return stitch(query, { density: query.density ?? 0 }); }, { className: "", id: "stitch" }), button("Show the parts", () => { tools.set({ show: "scan", layout: "one" }); say("Click a part to choose it."); }, { id: "show-parts" }), button("Cut or paint parts", () => begin(query), { id: "repaint" }));
  section.append(make("h2", `${query.segments.length} parts`), make("p", "Choose a part, here or on the scan, then an example for it; the others take their best.", { className: "soft" }), list, called);
  const alike = alikeRow(query);
  if (alike) section.append(alike);
  section.append(label, row);
  return section;
}

