// Beside the viewport: what came out, in words, and what can be done about it.

import { $, make, save, sentence } from "/web/call.js";
import { histograms } from "/web/histograms.js";
import { lay, layAll, refine, stitch } from "/web/laying.js";
import { begin as paintParts, showPainting } from "/web/painting.js";
import { partName } from "/web/partnames.js";
import { showParts } from "/web/parts.js";
import { showPoints } from "/web/points.js";
import { isTemplate, key, nameOf } from "/web/ranking.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import { DENSITIES, headline, reasons, unlike } from "/web/words.js";

const FORMATS = ["obj", "ply", "off", "stl", "glb"];
// Reasons told at once; all of them stand under the details.
const REASONS_MAX = 4;

const percent = (share) => `${(100 * share).toFixed(0)} %`;

export function button(text, act, more = {}) {
  const made = make("button", text, { type: "button", className: "plain", ...more });
  made.onclick = () => Promise.resolve(act(made)).catch((error) => say(error.message, "bad"));
  return made;
}

function facts(rows) {
  const table = make("table", undefined, { className: "facts" });
  for (const [name, value] of rows) {
    const row = make("tr");
    row.append(make("th", name, { scope: "row" }), make("td", value));
    table.append(row);
  }
  return table;
}

function bars(title, { edges, counts, median, p95 }, unit) {
  const box = make("div");
  const most = Math.max(1, ...counts);
  const row = make("div", undefined, { className: "bars" });
  row.setAttribute("role", "img");
  row.ariaLabel = `${title}: median ${median.toFixed(1)}${unit}, 95 in a hundred below ${p95.toFixed(1)}${unit}`;
  for (const count of counts) {
    const bar = make("i");
    bar.style.height = `${(100 * count) / most}%`;
    row.append(bar);
  }
  const scale = make("div", undefined, { className: "scale" });
  scale.append(make("span", `${edges[0]}${unit}`), make("span", `${edges.at(-1)}${unit}`));
  box.append(make("h3", title), row, scale);
  return box;
}

function downloads(query) {
  const { path, name } = query.shown;
  const row = make("p", undefined, { className: "row" });
  const stem = `${query.name.replace(/\.[^.]*$/, "")}_${name}`.replace(/[^\w.-]+/g, "_");
  for (const format of FORMATS) row.append(button(format.toUpperCase(), () => save(`${path}/mesh?format=${format}`, `${stem}.${format}`), { className: format === "obj" ? "" : "plain", ariaLabel: `Download as ${format.toUpperCase()}`, id: `save-${format}` }));
  const section = make("section");
  section.append(make("h2", "Take it along"));
  if (query.segments.length === 1) section.append(density(query));
  section.append(row, button("Copy the link to this result", async (b) => { await navigator.clipboard.writeText(location.href); b.textContent = "Copied"; }, { className: "plain small", id: "copy" }));
  return section;
}

// How dense the quads are, of a scan in one piece; parts have it where they are stitched.
function density(query) {
  const label = make("label", "Density ");
  const select = make("select", undefined, { id: "density" });
  select.append(...Object.entries(DENSITIES).map(([value, text]) => make("option", text, { value })));
  select.value = String(query.shown.made?.density ?? 0);
  select.onchange = () => refine(query, Number(select.value)).catch((error) => { say(error.message, "bad"); showPanel(query); });
  label.append(select);
  return label;
}

// What to try next, the cheapest first.
function wayOut(query) {
  const row = make("p", undefined, { className: "row" });
  const { map } = query.shown;
  const entries = query.rankings.get(query.segment)?.entries ?? [];
  const laid = entries.findIndex((e) => key(e) === query.laid.get(query.segment)?.key);
  const next = entries.slice(laid + 1).find((e) => !isTemplate(e) && !e.similar_to);
  if (map && next) row.append(button("Try the next example", () => { query.touched = true; return lay(query, next); }, { title: nameOf(next), id: "next" }));
  if (map && map.covers.input < 0.97 && map.own_faces === map.faces) {
    row.append(button("Go on to where the scan ends", () => lay(query, { example: map.example, example_segment: map.example_segment, name: query.shown.name }, { beyond: "extend" }), { title: "Rows of quads continue the example's rim", id: "beyond" }));
  }
  if (map && query.segments.length === 1 && (map.covers.input < 0.97 || isBad(map))) row.append(allButton(query));
  if (map && query.segments.length === 1) row.append(paintButton(query));
  if (map && query.segments.length === 1 && query.shown.inParts) row.append(button(`Cut it as ${query.shown.name} is cut`, () => bench.cut(query, { example: map.example, name: query.shown.name }), { id: "cut-like", title: "Each part of the scan then takes its part of the example" }));
  return row.childElementCount ? row : null;
}

const isBad = ({ verdict }) => verdict === "poor" || verdict === "broken";
const allButton = (query) => button("Quads for all of it", () => layAll(query), { id: "lay-all", title: "The best examples on the whole scan or on its parts, and regular layouts between them" });
const cutButton = (query) => button("Cut it into limbs, head and torso", () => bench.cut(query), { id: "cut" });
const paintButton = (query) => button("Cut or paint parts", () => paintParts(query), { id: "repaint", title: "Parts of the scan take examples of their own" });

function verdict(query) {
  const { map, made } = query.shown;
  const it = map ?? made;
  const { word, advice, kind } = headline(it.verdict, it.inspired);
  const section = make("section");
  section.append(make("h2", word, { className: `verdict ${kind}` }), make("p", advice));
  const told = reasons(it.reasons.filter((raw) => !/\(good up to/.test(raw) || it.verdict !== "good"), (segment) => partName(query, segment));
  const other = map && unlike(query.segments[map.segment]?.topology, query.shown.topology);
  if (other) told.unshift(other);
  if (told.length && it.verdict !== "good") {
    const list = make("ul", undefined, { className: "reasons" });
    for (const { text, help } of told.slice(0, REASONS_MAX)) {
      const item = make("li", text);
      if (help) item.append(" ", make("span", help, { className: "soft" }));
      list.append(item);
    }
    section.append(list);
  }
  const quads = map ? map.faces : made.quads;
  const parts = [`${quads} quads`, `${percent(it.inspired)} of it an example's`, `${percent(it.covers.input)} of the scan covered`];
  if (map && map.covers.example < 0.995) parts.push(`${percent(map.covers.example)} of the example used`);
  section.append(make("p", parts.join(" · "), { className: "soft" }));
  const way = wayOut(query);
  if (way) section.append(way);
  if (map && isBad(it) && query.segments.length === 1) section.append(make("p", "Where no example fits as a whole, some may fit its parts:", { className: "soft" }), cutButton(query));
  return section;
}

function details(query, wasOpen) {
  const { map, made } = query.shown;
  const it = map ?? made;
  const box = make("details", undefined, { id: "details", open: wasOpen });
  const inner = make("div");
  if (map) {
    inner.append(bars("Change of angles", map.distortion.angle, "°"), bars("Change of size (log₂)", map.distortion.area, ""));
    inner.append(facts([["Vertices", map.vertices], ["Faces", map.faces], ["Turned over", map.folds], ["Median change of angle", `${map.distortion.angle.median.toFixed(1)}°`], ["Laid in", `${(map.timings.total_ms / 1000).toFixed(2)} s`], ...(query.editMs ? [["Last edit, to the picture", `${Math.round(query.editMs)} ms`]] : [])]));
  } else inner.append(facts([["Vertices", made.vertices], ["Quads", made.quads], ["Triangles left", made.triangles], ["Poles", made.extraordinary_vertices], ["Poles in the examples", made.extraordinary_before], ["Stitched in", `${(made.total_ms / 1000).toFixed(2)} s`]]));
  const raw = [...it.reasons, ...(made?.notes ?? []), ...(query.repairs ?? [])];
  if (raw.length) {
    const list = make("ul", undefined, { className: "soft" });
    list.append(...raw.map((text) => make("li", sentence(text))));
    inner.append(make("h3", "What the service says"), list);
  }
  box.append(make("summary", "Details"), inner);
  return box;
}

// What stitching did, beside what the parts brought.
function added(made) {
  const section = make("section");
  const more = made.extraordinary_vertices - made.extraordinary_before;
  section.append(make("h2", "What stitching added"), make("p", more > 0 ? `${more} poles along the seams, beside ${made.extraordinary_before} that the examples have.` : "No pole beyond those of the examples."));
  if (made.templates.length) section.append(make("p", `Regular layouts on ${made.templates.length === 1 ? "part" : "parts"} ${made.templates.map((s) => partName(bench.query, s).replace(/^Part (?=\d+$)/, "")).join(", ")}.`, { className: "soft" }));
  section.append(button("Show the poles", () => $("toggle-dots").click(), { className: "plain small", id: "show-poles" }));
  return section;
}

// The example's quads beside those of the result. They are counted once a revision: the panel is drawn often.
let counted = { of: "", box: null };
function alike(map) {
  const { example, quads } = bench.viewer.meshes;
  if (!example || !quads) return [];
  const of = `${map.id} ${map.revision}`;
  if (counted.of !== of) counted = { of, box: histograms(example, quads, { kept: map.kept, ownFaces: map.own_faces }) };
  return counted.box ? [counted.box] : [];
}

// Draws the panel anew; what had the focus keeps it.
export function showPanel(query) {
  if (bench.query !== query) return;
  const focused = document.activeElement?.id;
  const wasOpen = $("details")?.open ?? false;
  const sections = [];
  if (query.painting) { $("panel").replaceChildren(showPainting(query)); if (focused && document.activeElement === document.body) $(focused)?.focus({ preventScroll: true }); return; }
  if (query.shown) sections.push(verdict(query));
  else if (query.mismatch) {
    const section = make("section");
    section.append(make("h2", "No example used", { className: "verdict poor" }), make("p", $("status").textContent));
    if (query.segments.length === 1) section.append(allButton(query), cutButton(query), paintButton(query));
    sections.push(section);
  }
  if (query.segments.length > 1) sections.push(showParts(query, { stitch }));
  if (query.shown?.made && query.segments.length > 1) sections.push(added(query.shown.made));
  if (query.shown?.map) sections.push(showPoints(query));
  if (query.shown) sections.push(downloads(query));
  if (query.shown?.map) sections.push(...alike(query.shown.map));
  if (query.shown) sections.push(details(query, wasOpen));
  $("panel").replaceChildren(...sections);
  if (focused && document.activeElement === document.body) $(focused)?.focus({ preventScroll: true });
}
