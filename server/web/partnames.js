// What the parts of a scan are called. The server knows them by number; this browser keeps their names, by scan.

const SCANS_MAX = 200;
const NAME_MAX = 60;

const kept = JSON.parse(localStorage.getItem("parts") ?? "{}");

function keep() {
  const ids = Object.keys(kept).sort();
  for (const old of ids.slice(0, Math.max(0, ids.length - SCANS_MAX))) delete kept[old];
  localStorage.setItem("parts", JSON.stringify(kept));
}

export const plainName = (segment) => `Part ${segment + 1}`;
export const partName = (query, segment) => kept[query.id]?.[segment] ?? plainName(segment);
export const ownNames = (query) => new Map(Object.entries(kept[query.id] ?? {}).map(([segment, name]) => [Number(segment), name]));

// A name as it is kept: without surplus space; empty where it says no more than the number does.
export const cleaned = (text, segment) => { const name = text.trim().replace(/\s+/g, " ").slice(0, NAME_MAX); return name === plainName(segment) ? "" : name; };

export function rename(query, segment, text) {
  const [name, of] = [cleaned(text, segment), { ...kept[query.id] }];
  if (name) of[segment] = name;
  else delete of[segment];
  kept[query.id] = of;
  keep();
}

// Names that were given to labels of faces, for the parts that the server made of these: each takes the name of the label
// that most of its faces had.
export function adopt(query, { labels, names }) {
  const { segments } = query.mesh;
  if (!segments || segments.length !== labels.length || !names.size) return;
  const counts = new Map();
  for (let f = 0; f < labels.length; f++) {
    const of = counts.get(segments[f]) ?? counts.set(segments[f], new Map()).get(segments[f]);
    of.set(labels[f], (of.get(labels[f]) ?? 0) + 1);
  }
  const given = new Set();
  for (const [segment, of] of counts) {
    const [label] = [...of].sort((a, b) => b[1] - a[1])[0];
    const name = names.get(label);
    if (name && !given.has(label)) { rename(query, segment, name); given.add(label); }
  }
}
