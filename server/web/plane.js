// The plane across which a scan is its own mirror image, in whatever pose it stands: found from a guess, as one scan is aligned with
// another. Source: P. Besl, N. McKay, A method for registration of 3-D shapes, 1992; the plane of a reflection in place of a rigid motion.

import { LARGE, coarse } from "/web/coarse.js";
import { bounds, place } from "/web/mesh.js";
import { nearestOf } from "/web/near.js";

// Vertices that are tried.
const SAMPLES = 400;
const ROUNDS = 50;
// What has no partner within this share of the diagonal is passed over: one side of a scan may be torn or bent.
const REACH = 0.06;
// Pairs farther apart than so many times the median don't count.
const TRIMMED = 3;
// A scan is called its own mirror image where four of five vertices lie so near to it (in the diagonal) once they are mirrored.
const FAR_MAX = 0.02;
// What lies so near needs no other try.
const FAR_SURE = 0.01;
const KEPT = 0.8;
// What moves less (in the diagonal, and as an angle) is settled.
const STILL = 2e-4;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const unit = (a) => { const size = Math.hypot(...a) || 1; return a.map((x) => x / size); };

// A direction on the other side of a plane, and a point there.
export const turned = (a, normal) => { const along = dot(a, normal); return a.map((x, k) => x - 2 * along * normal[k]); };
export const reflected = (point, { normal, at }) => turned(point.map((x, k) => x - at[k]), normal).map((x, k) => x + at[k]);

const mean = (points) => [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / Math.max(1, points.length));

// The sum of products of two lists of points about their means: a 3×3 matrix, made symmetric.
function products(ones, others) {
  const [a, b] = [mean(ones), mean(others)];
  const sum = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  ones.forEach((p, n) => { for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) sum[i][j] += (p[i] - a[i]) * (others[n][j] - b[j]); });
  return sum.map((row, i) => row.map((x, j) => (x + sum[j][i]) / 2));
}

// The eigenvectors of a symmetric 3×3 matrix, the smallest first, by Jacobi's rotations.
function axes(matrix) {
  const m = matrix.map((row) => [...row]);
  const v = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  for (let sweep = 0; sweep < 12; sweep++) {
    for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) {
      if (m[i][j] === 0) continue;
      const angle = 0.5 * Math.atan2(2 * m[i][j], m[j][j] - m[i][i]);
      const [c, s] = [Math.cos(angle), Math.sin(angle)];
      for (const of of [m, v]) for (const row of of) [row[i], row[j]] = [c * row[i] - s * row[j], s * row[i] + c * row[j]];
      for (let k = 0; k < 3; k++) [m[i][k], m[j][k]] = [c * m[i][k] - s * m[j][k], s * m[i][k] + c * m[j][k]];
    }
  }
  return [0, 1, 2].sort((a, b) => m[a][a] - m[b][b]).map((k) => v.map((row) => row[k]));
}

// What a guess comes to: { normal, at, far }; `far`: how far from the scan its vertices lie once they are mirrored.
function settled(mesh, points, diagonal, guess) {
  let plane = guess;
  const nearest = nearestOf(mesh);
  for (let round = 0; ; round++) {
    const pairs = [];
    for (const point of points) {
      const image = reflected(point, plane);
      const partner = nearest.point(image, REACH * diagonal);
      if (partner) pairs.push({ point, partner, far: Math.hypot(...image.map((x, k) => x - partner[k])) });
    }
    const fars = pairs.map((p) => p.far).sort((a, b) => a - b);
    // Those that have none count as far.
    const far = (fars[Math.floor(KEPT * (points.length - 1))] ?? Infinity) / diagonal;
    if (round === ROUNDS || pairs.length < points.length / 4) return { ...plane, far };
    const near = pairs.filter((p) => p.far <= TRIMMED * fars[fars.length >> 1]);
    const [ones, others] = [near.map((p) => p.point), near.map((p) => p.partner)];
    // A reflection turns what lies along its normal: there the products are least.
    const [normal] = axes(products(ones, others));
    const at = mean([mean(ones), mean(others)]);
    const moved = Math.abs(dot(at.map((x, k) => x - plane.at[k]), normal)) / diagonal + Math.acos(Math.min(1, Math.abs(dot(normal, plane.normal))));
    plane = { normal, at };
    if (moved < STILL) return { ...plane, far };
  }
}

// The plane of a scan, or null where it has none. `guess`: { normal, at } to begin with; where that leads nowhere, its own axes are tried.
export function mirrorPlane(scan, guess) {
  const box = bounds(scan);
  const { diagonal } = box;
  const mesh = scan.starts.length > LARGE ? coarse(scan, box) : scan;
  const count = mesh.positions.length / 3;
  const step = Math.max(1, Math.floor(count / SAMPLES));
  const points = [];
  for (let v = 0; v < count; v += step) points.push(place(mesh, v));
  const begun = settled(mesh, points, diagonal, guess);
  if (begun.far <= FAR_SURE) return begun;
  const at = mean(points);
  const own = axes(products(points, points)).map((normal) => settled(mesh, points, diagonal, { normal, at }));
  const best = [begun, ...own].reduce((a, b) => (b.far < a.far ? b : a));
  return best.far <= FAR_MAX ? best : null;
}
