// Heat maps: a number a face, and what its scale means. Below 0 stands for a face that has none.

import { bounds, cornersOf, faceCount, place } from "/web/mesh.js";
import { nearestOf } from "/web/near.js";

// From little to much; read by the picture and by its legend.
export const RAMP = [[0.16, 0.33, 0.72], [0.24, 0.66, 0.74], [0.86, 0.88, 0.62], [0.95, 0.6, 0.22], [0.74, 0.1, 0.14]];

const mix = (points) => [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);

// The value below which 98 in a hundred lie: a single bad face is not to make all others look alike.
function most(values) {
  const known = Array.from(values).filter((x) => x >= 0).sort((a, b) => a - b);
  return known[Math.min(known.length - 1, Math.floor(0.98 * known.length))] ?? 0;
}

function scaled(values, top, legend) {
  return { values: values.map((x) => (x < 0 ? -1 : Math.min(1, x / top))), legend };
}

// How far faces leave the scan between their vertices, in hundredths of its size.
export function distance(mesh, scan) {
  const box = bounds(scan);
  const nearest = nearestOf(scan);
  const values = new Float32Array(faceCount(mesh));
  for (let f = 0; f < values.length; f++) {
    const points = Array.from(cornersOf(mesh, f), (v) => place(mesh, v));
    const samples = [mix(points), ...points.map((p, k) => mix([p, points[(k + 1) % points.length]]))];
    values[f] = samples.reduce((far, p) => Math.max(far, nearest.distance(p, box.diagonal / 10)), 0) / box.diagonal * 100;
  }
  const top = Math.max(0.05, most(values));
  return scaled(values, top, { title: "Distance to the scan", low: "on it", high: `${top.toPrecision(2)} % of its size` });
}

// How far the worst corner of a face is from a right angle.
export function angle(mesh) {
  const values = new Float32Array(faceCount(mesh));
  for (let f = 0; f < values.length; f++) {
    const points = Array.from(cornersOf(mesh, f), (v) => place(mesh, v));
    if (points.length !== 4) { values[f] = -1; continue; }
    for (let k = 0; k < 4; k++) {
      const [o, a, b] = [points[k], points[(k + 1) % 4], points[(k + 3) % 4]];
      const [u, v] = [a, b].map((p) => p.map((x, j) => x - o[j]));
      const cos = u.reduce((sum, x, j) => sum + x * v[j], 0) / (Math.hypot(...u) * Math.hypot(...v) || 1);
      values[f] = Math.max(values[f], Math.abs(90 - Math.acos(Math.min(1, Math.max(-1, cos))) * 180 / Math.PI));
    }
  }
  return scaled(values, 60, { title: "Worst angle of a quad", low: "90°", high: "30° or 150°" });
}

function area(mesh, f) {
  const points = Array.from(cornersOf(mesh, f), (v) => place(mesh, v));
  const sum = [0, 0, 0];
  for (let k = 1; k + 1 < points.length; k++) {
    const [u, v] = [points[k], points[k + 1]].map((p) => p.map((x, j) => x - points[0][j]));
    sum[0] += u[1] * v[2] - u[2] * v[1];
    sum[1] += u[2] * v[0] - u[0] * v[2];
    sum[2] += u[0] * v[1] - u[1] * v[0];
  }
  return Math.hypot(...sum) / 2;
}

// The faces of an example that a map of it has, in order: those with all of their vertices kept.
export function keptFaces(example, kept) {
  const all = Array.from({ length: faceCount(example) }, (_, f) => f);
  if (!kept) return all;
  const has = new Uint8Array(example.positions.length / 3);
  kept.forEach((v) => { has[v] = 1; });
  return all.filter((f) => cornersOf(example, f).every((v) => has[v]));
}

// How much larger or smaller faces are than the example has them, beside the others. Without an example, or where its
// faces can't be told, against the usual face of the mesh.
export function areaRatio(mesh, example, { kept = null, ownFaces = 0 } = {}) {
  const values = new Float32Array(faceCount(mesh)).fill(-1);
  const own = example ? keptFaces(example, kept) : [];
  const matched = own.length > 0 && own.length === ownFaces;
  const logs = [];
  for (let f = 0; f < (matched ? own.length : values.length); f++) {
    const before = matched ? area(example, own[f]) : 1;
    logs.push(Math.log2((area(mesh, f) || 1e-30) / (before || 1e-30)));
  }
  const middle = [...logs].sort((a, b) => a - b)[Math.floor(logs.length / 2)] ?? 0;
  // From −2 to 2: a quarter of its usual size to four times of it.
  logs.forEach((x, f) => { values[f] = Math.min(4, Math.max(0, x - middle + 2)); });
  return scaled(values, 4, { title: matched ? "Size of a face, against the example's" : "Size of a face, against the usual one", low: "¼", middle: "as is", high: "4 ×" });
}
