// Mirrored editing: on an example that is about its own mirror image, what is done to a point is done to the one across, too.

import { bounds, place, triangles } from "/web/mesh.js";
import { nearestOf } from "/web/near.js";
import { mirrorPlane, reflected, turned, unit } from "/web/plane.js";

// Of a mesh that is its own mirror image 95 in a hundred vertices lie so near to its surface once they are mirrored, in the diagonal
// of its box: heads as artists draw them do, hands and limbs lie three times as far.
const FAR_MAX = 0.013;
// Vertices that are tried.
const SAMPLES = 800;
// A constraint so near to where another's point is mirrored (in the diagonal) is the one across; a point so near to the plane has none.
const SAME = 0.02;

const minus = (a, b) => a.map((x, k) => x - b[k]);
const length = (a) => Math.hypot(...a);

// Where a point lies on a mesh: three vertices and their weights; null where it is farther than `limit`.
function located(mesh, point, limit) {
  const { t, s, r } = nearestOf(mesh).search(point, limit);
  if (t < 0) return null;
  const { at } = triangles(mesh);
  return { vertices: [0, 1, 2].map((k) => mesh.corners[at[t / 3 + k]]), weights: [1 - s - r, s, r] };
}

const mirrored = (point, { axis, at }) => point.map((x, k) => (k === axis ? 2 * at - x : x));

function tried(mesh, plane, diagonal) {
  const count = mesh.positions.length / 3;
  const step = Math.max(1, Math.floor(count / SAMPLES));
  const [far, pairs] = [[], []];
  for (let v = 0; v < count; v += step) {
    const across = mirrored(place(mesh, v), plane);
    const image = located(mesh, across, 0.1 * diagonal);
    far.push(image ? nearestOf(mesh).distance(across, 0.1 * diagonal) / diagonal : 1);
    if (image) pairs.push({ vertex: v, image });
  }
  return { far: far.sort((a, b) => a - b)[Math.floor(0.95 * (far.length - 1))], pairs };
}

// How a mesh is its own mirror image: { axis, at, pairs, diagonal }, or null. It is sought once.
export function symmetry(mesh) {
  if (mesh.symmetry !== undefined) return mesh.symmetry;
  const { low, high, diagonal } = bounds(mesh);
  mesh.symmetry = null;
  let least = FAR_MAX;
  for (const axis of [0, 1, 2]) {
    const middle = (low[axis] + high[axis]) / 2;
    // Artists draw across a plane through the origin; what was moved is across the middle of its box.
    for (const at of Math.abs(middle) < 0.05 * diagonal ? [0, middle] : [middle]) {
      const { far, pairs } = tried(mesh, { axis, at }, diagonal);
      if (far < least) [least, mesh.symmetry] = [far, { axis, at, pairs, diagonal }];
    }
  }
  return mesh.symmetry;
}

// The place on the quads of a place on the example; null where its face was left out.
function laid({ vertices, weights }, quads, numberOf) {
  const numbers = vertices.map((v) => numberOf.get(v));
  if (numbers.includes(undefined)) return null;
  const points = numbers.map((n) => place(quads, n));
  return [0, 1, 2].map((c) => points.reduce((sum, p, k) => sum + weights[k] * p[c], 0));
}

// The mirror plane of the quads, by what lies across on the example: { normal, at }.
function planeOf(quads, { axis, at, pairs }, example, numberOf) {
  const [normal, middle] = [[0, 0, 0], [0, 0, 0]];
  let count = 0;
  for (const { vertex, image } of pairs) {
    const to = numberOf.has(vertex) ? laid(image, quads, numberOf) : null;
    if (!to) continue;
    const from = place(quads, numberOf.get(vertex));
    const side = Math.sign(example.positions[3 * vertex + axis] - at);
    minus(from, to).forEach((x, k) => { normal[k] += side * x; middle[k] += (from[k] + to[k]) / 2; });
    count += 1;
  }
  return { normal: unit(normal), at: middle.map((x) => x / Math.max(1, count)) };
}

// What lies across: the point of the example, and where it and the first are on the quads now; null where the first lies in the plane.
function opposite({ map, example, quads }, onExample) {
  const found = symmetry(example);
  if (!found) return null;
  const other = mirrored(onExample, found);
  if (length(minus(other, onExample)) < SAME * found.diagonal) return null;
  const all = map.kept ?? Array.from({ length: example.positions.length / 3 }, (_, v) => v);
  const numberOf = new Map(all.map((v, k) => [v, k]));
  const [here, there] = [onExample, other].map((point) => { const at = located(example, point, found.diagonal); return at && laid(at, quads, numberOf); });
  return { other, here, there, plane: planeOf(quads, found, example, numberOf) };
}

// Whether a point of the example is the one across from another.
export function isAcross(example, point, from) {
  const found = symmetry(example);
  return found !== null && length(minus(mirrored(from, found), point)) < SAME * found.diagonal;
}

// What is to be done across where a point of the example is brought to a point of the scan: a further entry of `set`. Null where the
// point lies in the plane, or nothing lies across.
export function across(shown, onExample, onInput) {
  const found = opposite(shown, onExample);
  if (!found?.here || !found.there) return null;
  const { other, here, there, plane } = found;
  // As far from where it lay as the point is moved, the other way round.
  const off = turned(minus(onInput, here), plane.normal);
  const to = there.map((x, k) => x + off[k]);
  const known = shown.map.constraints.find((c) => isAcross(shown.example, c.on_example.point, onExample));
  return known ? { id: known.id, on_input: to } : { on_example: other, on_input: to };
}

// The landmark across from one: { example, input }, the latter on the scan. It goes by the scan's own mirror plane where it has one, since
// whoever places landmarks mistrusts the map; else by the map. Null where the landmark lies in the plane, or nothing lies across.
export function acrossLandmark({ map, example, quads, scan }, onExample, onInput) {
  const found = opposite({ map, example, quads }, onExample);
  if (!found) return null;
  const { other, here, there, plane } = found;
  scan.plane ??= { is: mirrorPlane(scan, plane) };
  const own = scan.plane.is;
  const off = here && there ? turned(minus(onInput, here), plane.normal) : null;
  const to = own ? reflected(onInput, own) : off && there.map((x, k) => x + off[k]);
  const input = to && nearestOf(scan).point(to, 0.2 * bounds(scan).diagonal);
  return input ? { example: other, input } : null;
}
