// The faces of a mesh as regions: what lies beside what, and labels made neat.

import { cornersOf, faceCount, place } from "/web/mesh.js";

// Rounds in which teeth of a border are rubbed off.
const SMOOTHING = 4;

const minus = (a, b) => a.map((x, k) => x - b[k]);

// The middle of each face, and where it looks: six numbers a face, made once.
export function facing(mesh) {
  if (mesh.facing) return mesh.facing;
  const all = new Float32Array(6 * faceCount(mesh));
  for (let f = 0; f < faceCount(mesh); f++) {
    const points = Array.from(cornersOf(mesh, f), (v) => place(mesh, v));
    const [u, v] = [minus(points[1], points[0]), minus(points.at(-1), points[0])];
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const size = Math.hypot(...normal) || 1;
    for (let k = 0; k < 3; k++) {
      all[6 * f + k] = points.reduce((sum, p) => sum + p[k], 0) / points.length;
      all[6 * f + 3 + k] = normal[k] / size;
    }
  }
  mesh.facing = all;
  return all;
}

// The other end of the side of a face that begins at corner `k`.
export const endOf = (mesh, f, k) => mesh.corners[k + 1 < mesh.starts[f + 1] ? k + 1 : mesh.starts[f]];

// One number for an edge, whichever of its ends comes first.
export const edgeKey = (p, q) => Math.min(p, q) * 2 ** 26 + Math.max(p, q);
export const endsOf = (key) => [Math.floor(key / 2 ** 26), key % 2 ** 26];

// The faces beside each face, across its sides: -1 at a rim. Three or more a face, from `mesh.starts` on.
export function beside(mesh) {
  if (mesh.beside) return mesh.beside;
  const [all, open] = [new Int32Array(mesh.corners.length).fill(-1), new Map()];
  for (let f = 0; f < faceCount(mesh); f++) {
    for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
      const edge = edgeKey(mesh.corners[k], endOf(mesh, f, k));
      const other = open.get(edge);
      if (other === undefined) { open.set(edge, [f, k]); continue; }
      [all[k], all[other[1]]] = [other[0], f];
      open.delete(edge);
    }
  }
  mesh.beside = all;
  return all;
}

// The size of each face.
export function areas(mesh) {
  if (mesh.areas) return mesh.areas;
  const all = new Float64Array(faceCount(mesh));
  for (let f = 0; f < all.length; f++) {
    const points = Array.from(cornersOf(mesh, f), (v) => place(mesh, v));
    for (let k = 2; k < points.length; k++) {
      const [u, v] = [minus(points[k - 1], points[0]), minus(points[k], points[0])];
      all[f] += Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
    }
  }
  mesh.areas = all;
  return all;
}

export const used = (labels) => [...new Set(labels)].sort((a, b) => a - b);
export const free = (labels) => { const there = new Set(labels); let k = 0; while (there.has(k)) k++; return k; };

// The label that most of the faces beside some faces have, other than their own; null where all around is theirs.
function around(mesh, labels, faces) {
  const [next, counts] = [beside(mesh), new Map()];
  for (const f of faces) {
    for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
      const label = next[k] < 0 ? labels[f] : labels[next[k]];
      if (label !== labels[f]) counts.set(label, (counts.get(label) ?? 0) + 1);
    }
  }
  return [...counts].sort((a, b) => b[1] - a[1])[0] ?? null;
}

// Each face in one piece with those beside it for which `belongs(f, g, k)`, across side `k` of `f`: lists of faces.
export function pieces(mesh, faces, belongs) {
  const next = beside(mesh);
  const seen = new Uint8Array(faceCount(mesh));
  const all = [];
  for (const first of faces) {
    if (seen[first]) continue;
    const piece = [first];
    seen[first] = 1;
    for (const f of piece) {
      for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
        const g = next[k];
        if (g >= 0 && !seen[g] && belongs(f, g, k)) { seen[g] = 1; piece.push(g); }
      }
    }
    all.push(piece);
  }
  return all;
}

// Teeth along a border, islands and specks go over to what is around them: a part is one piece.
export function tidied(mesh, painted) {
  const labels = painted.slice();
  for (let round = 0; round < SMOOTHING; round++) {
    for (let f = 0; f < labels.length; f++) {
      const most = around(mesh, labels, [f]);
      if (most && 2 * most[1] > mesh.starts[f + 1] - mesh.starts[f]) [labels[f]] = most;
    }
  }
  const all = pieces(mesh, labels.keys(), (f, g) => labels[g] === labels[f]);
  all.sort((a, b) => b.length - a.length);
  const kept = new Set();
  for (const faces of all) {
    const label = labels[faces[0]];
    const most = kept.has(label) ? around(mesh, labels, faces) : null;
    if (most) for (const f of faces) [labels[f]] = most;
    kept.add(label);
  }
  return labels;
}
