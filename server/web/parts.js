// The parts of a scan: coloured, picked in the view or by name, each with an example of its own, and stitched.

import { make } from "/web/call.js";
import { chooseSegment } from "/web/bench.js";
import { begin } from "/web/painting.js";
import { button, showPanel } from "/web/panel.js";
import { key, nameOf } from "/web/ranking.js";
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
  return laid && query.rankings.get(segment)?.entries.find((e) => key(e) === laid.key);
};

function item(query, { segment, topology, faces }) {
  const made = make("li", undefined, { className: segment === query.segment ? "chosen" : "" });
  const dot = make("span", undefined, { className: "dot" });
  dot.style.background = css(colourOf(segment, segment === query.segment));
  const pick = make("button", `Part ${segment + 1}`, { type: "button", className: "part", ariaPressed: String(segment === query.segment), id: `part-${segment}` });
  pick.onclick = () => choose(query, segment);
  const own = query.chosen?.has(segment) ? example(query, segment) : null;
  made.append(dot, pick, make("small", `${SURFACES[topology] ?? topology}, ${faces} faces · ${own ? nameOf(own) : query.took?.get(segment) ?? "its best example"}`));
  if (own) made.append(button("Forget", () => { query.chosen.delete(segment); query.laid.delete(segment); chooseSegment(segment); showPanel(query); }, { className: "plain small", ariaLabel: `Forget the example of part ${segment + 1}`, id: `forget-${segment}` }));
  return made;
}

export function showParts(query, { stitch }) {
  paint(query);
  const section = make("section");
  const list = make("ul", undefined, { id: "part-list" });
  list.append(...query.segments.map((s) => item(query, s)));
  const label = make("label", "Density ");
  const density = make("select", undefined, { id: "density" });
  density.append(...Object.entries(DENSITIES).map(([value, text]) => make("option", text, { value })));
  density.value = String(query.density ?? 0);
  density.onchange = () => { query.density = Number(density.value); };
  label.append(density);
  const row = make("p", undefined, { className: "row" });
  row.append(button("Stitch all parts", () => { query.touched = true; return stitch(query, { density: query.density ?? 0 }); }, { className: "", id: "stitch" }), button("Show the parts", () => { tools.set({ show: "scan", layout: "one" }); say("Click a part to choose it."); }, { id: "show-parts" }), button("Repaint the parts", () => begin(query), { id: "repaint" }));
  section.append(make("h2", `${query.segments.length} parts`), make("p", "Choose a part, here or on the scan, then an example for it; the others take their best.", { className: "soft" }), list, label, row);
  return section;
}

