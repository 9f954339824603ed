// What the parts of a scan are called. The server keeps their names with the query, for all who look at it; here they are at
// once, and taken back where it refuses them.

import { send } from "/web/call.js";

const NAME_MAX = 60;

export const plainName = (segment) => `Part ${segment + 1}`;
export const partName = (query, segment) => query.names.get(segment) ?? plainName(segment);
export const namesOf = ({ segments }) => new Map(segments.filter((s) => s.name).map((s) => [s.segment, s.name]));

// A name as it is kept: without surplus space; empty where it says no more than the number does.
export const cleaned = (text, segment) => { const name = [...text.trim().replace(/\s+/g, " ")].slice(0, NAME_MAX).join(""); return name === plainName(segment) ? "" : name; };

const put = ({ names }, segment, name) => (name ? names.set(segment, name) : names.delete(segment));

// `given`: [{ segment, name }], an empty name for none.
export async function rename(query, given) {
  const before = given.map(({ segment }) => query.names.get(segment));
  for (const { segment, name } of given) put(query, segment, name);
  try {
    await send(`/v1/queries/${query.id}`, { segments: given }, "PATCH");
  } catch (error) {
    given.forEach(({ segment }, k) => put(query, segment, before[k]));
    throw error;
  }
}

// Gives names that labels of faces had to the parts that the server made of these: each takes the name of the label that most of
// its faces had.
export async function adopt(query, made) {
  const { labels, names } = made;
  const { segments } = query.mesh;
  if (made.isAdopted || !segments || segments.length !== labels.length || !names.size) return;
  // Once: who opens the scan again may have changed them meanwhile.
  made.isAdopted = true;
  const counts = new Map();
  for (let f = 0; f < labels.length; f++) {
    const of = counts.get(segments[f]) ?? counts.set(segments[f], new Map()).get(segments[f]);
    of.set(labels[f], (of.get(labels[f]) ?? 0) + 1);
  }
  const given = new Map();
  for (const [segment, of] of counts) {
    const [label] = [...of].sort((a, b) => b[1] - a[1])[0];
    const name = names.get(label);
    if (name && !given.has(label)) given.set(label, { segment, name });
  }
  if (given.size) await rename(query, [...given.values()]);
}
