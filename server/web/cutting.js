// A cut along a line that was drawn over a scan: the way along the line, and from its ends the shortest way around behind,
// or to a rim that is near. What lies on one side of it becomes a part of its own.

import { edges, normals, place } from "/web/mesh.js";
import { areas, beside, edgeKey, endOf, free, pieces, used } from "/web/regions.js";
import { graphOf, way } from "/web/ways.js";

// Half the width of the strip in which the way follows the line, in CSS pixels; and in edges, where these are longer.
const STRIP_PX = 8;
const STRIP_EDGES = 1.5;
// A line that is shorter (in CSS pixels) is a slip of the hand.
const SHORT_PX = 24;
// So near to each other (in CSS pixels) the ends of a line have to be to close it.
const CLOSED_PX = 26;
// So near an end has to be to a rim to go there, in widths of the strip.
const RIM_NEAR = 3;
// So many ways around are tried.
const ROUNDS_MAX = 8;
// What looks at the viewer costs so many times as much on the way behind: else it would come back beside the line.
const FRONT_COST = 6;
// A side that is smaller than this share of the square of the line's length is a sliver beside the line, no part.
const SLIVER = 0.03;
// What has fewer faces takes no example of its own.
const FACES_MIN = 16;
// Where the scan leaps back under the line by so many times the line's own step, another limb begins.
const LEAP = 6;

const far = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

// How far a point of the picture is from a line of it.
function offLine([x, y], line) {
  let least = Infinity;
  for (let k = 1; k < line.length; k++) {
    const [a, b] = [line[k - 1], line[k]];
    const [ux, uy] = [b.x - a.x, b.y - a.y];
    const t = Math.min(1, Math.max(0, ((x - a.x) * ux + (y - a.y) * uy) / (ux * ux + uy * uy || 1)));
    least = Math.min(least, Math.hypot(x - a.x - t * ux, y - a.y - t * uy));
  }
  return least;
}

const lengthOf = (line) => line.slice(1).reduce((sum, p, k) => sum + Math.hypot(p.x - line[k].x, p.y - line[k].y), 0);

// The longest piece of a line that lies on one part, and on one limb of it.
function onOnePart(line, labels, unit) {
  const runs = [[]];
  for (const sample of line) {
    const last = runs.at(-1).at(-1);
    const isNext = sample.face >= 0 && (!last || (labels[sample.face] === labels[last.face] && far(sample.point, last.point) < LEAP * unit * Math.hypot(sample.x - last.x, sample.y - last.y) + 2 * unit));
    if (isNext) runs.at(-1).push(sample);
    else runs.push(sample.face >= 0 ? [sample] : []);
  }
  return runs.sort((a, b) => lengthOf(b) - lengthOf(a))[0];
}

const nearestCorner = (mesh, { face, point }) => {
  let [best, least] = [-1, Infinity];
  for (let k = mesh.starts[face]; k < mesh.starts[face + 1]; k++) {
    const by = far(place(mesh, mesh.corners[k]), point);
    if (by < least) [best, least] = [mesh.corners[k], by];
  }
  return best;
};

// The vertices at which a part ends: on the rim of the scan, or on the border with other parts.
function rimOf(mesh, labels, faces, label) {
  const next = beside(mesh);
  const isRim = new Uint8Array(mesh.positions.length / 3);
  for (const f of faces) {
    for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) if (next[k] < 0 || labels[next[k]] !== label) isRim[mesh.corners[k]] = isRim[endOf(mesh, f, k)] = 1;
  }
  return isRim;
}

const keysOf = (path) => path.slice(1).map((v, k) => edgeKey(path[k], v));

// The sides of a cut: those pieces of a part that touch its edges, the largest first, with their sizes.
function sidesOf(mesh, faces, labels, label, cut) {
  const size = areas(mesh);
  const isCut = (f, k) => cut.has(edgeKey(mesh.corners[k], endOf(mesh, f, k)));
  const touching = new Set();
  for (const f of faces) for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) if (isCut(f, k)) touching.add(f);
  const all = pieces(mesh, faces, (f, g, k) => labels[g] === label && !isCut(f, k));
  const sides = all.filter((piece) => piece.some((f) => touching.has(f)));
  return sides.map((piece) => ({ faces: piece, area: piece.reduce((sum, f) => sum + size[f], 0) })).sort((a, b) => b.area - a.area);
}

// The way along the line itself, from its first end to its last; null where the strip is torn.
function along(graph, mesh, line, seen) {
  const { inner } = edges(mesh);
  let edge = 0;
  for (let k = 0; k < inner.length; k += 2) edge += far(place(mesh, inner[k]), place(mesh, inner[k + 1]));
  edge /= Math.max(1, inner.length / 2);
  const strip = Math.max(STRIP_PX, (STRIP_EDGES * edge) / seen.unit);
  const between = (part) => {
    const [start, goal] = [nearestCorner(mesh, part[0]), nearestCorner(mesh, part.at(-1))];
    for (const wide of [strip, 2 * strip]) {
      const weight = (v) => {
        if (v === goal) return 1;
        const off = offLine(seen.place(v), part) / wide;
        return off > 1 || !seen.isFront(v) ? Infinity : 1 + 3 * off * off;
      };
      const found = way(graph, start, (v) => v === goal, weight);
      if (found) return found.path;
    }
    return null;
  };
  const ends = Math.hypot(line[0].x - line.at(-1).x, line[0].y - line.at(-1).y);
  if (ends > CLOSED_PX || lengthOf(line) < 4 * CLOSED_PX) { const path = between(line); return path && { path, isClosed: false, strip: strip * seen.unit }; }
  // A line that comes back to where it began is three ways.
  const closed = [...line, line[0]];
  const at = [0, Math.floor(closed.length / 3), Math.floor((2 * closed.length) / 3), closed.length - 1];
  const thirds = [0, 1, 2].map((k) => between(closed.slice(at[k], at[k + 1] + 1)));
  return thirds.every(Boolean) ? { path: thirds.flatMap((path, k) => (k ? path.slice(1) : path)), isClosed: true, strip: strip * seen.unit } : null;
}

// What the way along the line may be joined to, to part anything: lists of edges, the likelier first.
function* closings(graph, path, isRim, strip, seen) {
  const [start, end] = [path[0], path.at(-1)];
  const own = new Set(path);
  // Not back through the line, nor over an edge from end to end.
  const isBarred = (v, from) => (own.has(v) && v !== start && v !== end) || (v === start && from === end);
  const behind = (v, from) => (isBarred(v, from) ? Infinity : seen.isFront(v) ? FRONT_COST : 1);
  const off = (v) => (own.has(v) ? Infinity : 1);
  const rims = [start, end].map((v) => (isRim[v] ? [v] : way(graph, v, (w) => isRim[w], off, RIM_NEAR * strip)?.path));
  if (rims[0] && rims[1]) yield [...keysOf(rims[0]), ...keysOf(rims[1])];
  const [near, other] = rims[0] ? [rims[0], end] : [rims[1], start];
  const over = near && way(graph, other, (v) => isRim[v] && !near.includes(v), behind);
  let rim = over && { cost: over.cost, keys: [...keysOf(near), ...keysOf(over.path)] };
  for (let round = 0; round < ROUNDS_MAX; round++) {
    const around = way(graph, end, (v) => v === start, behind);
    if (rim && !(around?.cost < rim.cost)) { yield rim.keys; rim = null; }
    if (!around) return;
    yield keysOf(around.path);
    // It parted a sliver, or nothing: the next goes elsewhere.
    around.path.forEach((v) => own.add(v));
  }
}

// Cuts a part along a line. `line`: [{ x, y, face, point }] with `face` -1 beside the scan; `seen`: how the mesh is seen,
// { unit: the length of a pixel, place(v): its place in the picture, isFront(v) }; `before`: edges of cuts that parted
// nothing alone. Answers with { labels, label, of }, with { before } where it parts nothing yet, or with { trouble }.
export function cutAlong(mesh, labels, line, seen, before = []) {
  const run = onOnePart(line, labels, seen.unit);
  if (run.length < 2 || lengthOf(line) < SHORT_PX) return { trouble: "Draw the line over the scan, across what is to be parted; come nearer where that is thin." };
  const label = labels[run[0].face];
  const faces = [];
  labels.forEach((l, f) => { if (l === label) faces.push(f); });
  const graph = graphOf(mesh, faces);
  const main = along(graph, mesh, run, seen);
  if (main?.path.length === 1) return { trouble: "The scan has too few vertices under this line to cut it there." };
  if (!main) return { trouble: "The line leaps over a gap or a fold there. Turn the scan so that all of the line is seen, and draw it again." };
  const { path, isClosed, strip } = main;
  const isRim = rimOf(mesh, labels, faces, label);
  const long = path.slice(1).reduce((sum, v, k) => sum + far(place(mesh, path[k]), place(mesh, v)), 0);
  let open = null;
  for (const more of isClosed ? [[]] : closings(graph, path, isRim, strip, seen)) {
    const keys = [...keysOf(path), ...more];
    const sides = sidesOf(mesh, faces, labels, label, new Set([...before, ...keys]));
    if (sides.length < 2) { open ??= keys; continue; }
    if (sides.at(-1).area < SLIVER * long * long || sides.at(-1).faces.length < FACES_MIN) continue;
    const now = labels.slice();
    const made = [];
    for (const side of sides.slice(1)) {
      const fresh = free(used(now));
      for (const f of side.faces) now[f] = fresh;
      made.push(fresh);
    }
    return { labels: now, label: made[0], of: label };
  }
  if (open) return { before: [...before, ...open] };
  return { trouble: "The line parts nothing there. Draw it across, from one edge of what you see to the other, or back to where it began; come nearer where the scan is thin." };
}

// How a viewer sees a mesh in a pane.
export function seenBy(viewer, mesh, box) {
  mesh.looking ??= normals(mesh);
  const { turn, scale, size } = viewer.view(box);
  const unit = 2 / (scale * size[0] * box.width);
  return {
    unit,
    place: (v) => viewer.onScreen(place(mesh, v), box),
    isFront: (v) => turn[2] * mesh.looking[3 * v] + turn[5] * mesh.looking[3 * v + 1] + turn[8] * mesh.looking[3 * v + 2] > 0,
  };
}
