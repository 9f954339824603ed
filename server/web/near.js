// Where a ray meets a mesh, and the nearest point of it.

import { bounds, triangles } from "/web/mesh.js";

// The corners of all triangles, nine numbers each.
function flattened(mesh) {
  if (mesh.flat) return mesh.flat;
  const { at } = triangles(mesh);
  const flat = new Float64Array(3 * at.length);
  for (let k = 0; k < at.length; k++) {
    const v = 3 * mesh.corners[at[k]];
    flat[3 * k] = mesh.positions[v];
    flat[3 * k + 1] = mesh.positions[v + 1];
    flat[3 * k + 2] = mesh.positions[v + 2];
  }
  mesh.flat = flat;
  return flat;
}

// Where a ray first meets the mesh: { face, point, barycentric (a weight a corner) }, or null. Möller–Trumbore. A pass over
// 200,000 triangles takes a few milliseconds, so no tree is needed.
export function hit(mesh, [ox, oy, oz], [dx, dy, dz]) {
  const points = flattened(mesh);
  let [nearest, best, weights] = [Infinity, -1, null];
  for (let t = 0; t < points.length; t += 9) {
    const ax = points[t], ay = points[t + 1], az = points[t + 2];
    const ux = points[t + 3] - ax, uy = points[t + 4] - ay, uz = points[t + 5] - az;
    const vx = points[t + 6] - ax, vy = points[t + 7] - ay, vz = points[t + 8] - az;
    const px = dy * vz - dz * vy, py = dz * vx - dx * vz, pz = dx * vy - dy * vx;
    const det = ux * px + uy * py + uz * pz;
    if (det === 0) continue;
    const sx = ox - ax, sy = oy - ay, sz = oz - az;
    const u = (sx * px + sy * py + sz * pz) / det;
    if (u < 0 || u > 1) continue;
    const qx = sy * uz - sz * uy, qy = sz * ux - sx * uz, qz = sx * uy - sy * ux;
    const v = (dx * qx + dy * qy + dz * qz) / det;
    if (v < 0 || u + v > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / det;
    if (distance > 0 && distance < nearest) [nearest, best, weights] = [distance, t / 9, [1 - u - v, u, v]];
  }
  if (best < 0) return null;
  const { at, of } = triangles(mesh);
  const face = of[best];
  const barycentric = new Array(mesh.starts[face + 1] - mesh.starts[face]).fill(0);
  for (let k = 0; k < 3; k++) barycentric[at[3 * best + k] - mesh.starts[face]] = weights[k];
  return { face, barycentric, point: [ox + nearest * dx, oy + nearest * dy, oz + nearest * dz] };
}

// A grid of the triangles of a mesh, of about one a cell: answers which point of the mesh is nearest.
class Nearest {
  constructor(mesh, { low, high, diagonal }) {
    this.flat = flattened(mesh);
    const count = this.flat.length / 9;
    const side = Math.max(diagonal / 1e4, diagonal / Math.max(4, Math.sqrt(count)));
    this.low = low;
    this.side = side;
    this.cells = [0, 1, 2].map((k) => Math.max(1, Math.ceil((high[k] - low[k]) / side)));
    this.fill(count);
  }

  // Counting first, then filling: two passes, and no list a cell.
  fill(count) {
    const [nx, ny, nz] = this.cells;
    this.first = new Uint32Array(nx * ny * nz + 1);
    const each = (act) => {
      for (let t = 0; t < count; t++) {
        const [from, to] = [[], []];
        for (let k = 0; k < 3; k++) {
          const [a, b, c] = [this.flat[9 * t + k], this.flat[9 * t + 3 + k], this.flat[9 * t + 6 + k]];
          from.push(this.cell(Math.min(a, b, c), k));
          to.push(this.cell(Math.max(a, b, c), k));
        }
        for (let z = from[2]; z <= to[2]; z++) for (let y = from[1]; y <= to[1]; y++) for (let x = from[0]; x <= to[0]; x++) act((z * ny + y) * nx + x, t);
      }
    };
    each((cell) => { this.first[cell + 1]++; });
    for (let k = 1; k < this.first.length; k++) this.first[k] += this.first[k - 1];
    this.list = new Uint32Array(this.first.at(-1));
    const next = this.first.slice();
    each((cell, t) => { this.list[next[cell]++] = t; });
  }

  cell(x, axis) { return Math.min(this.cells[axis] - 1, Math.max(0, Math.floor((x - this.low[axis]) / this.side))); }

  // How far a point is from the mesh; what is farther than `limit` counts as far as that.
  distance(p, limit) { return Math.sqrt(this.search(p, limit).best); }

  // The nearest point of the mesh, or null beyond `limit`.
  point(p, limit) {
    const { t, s, r } = this.search(p, limit);
    const { flat } = this;
    return t < 0 ? null : [0, 1, 2].map((k) => flat[t + k] + s * (flat[t + 3 + k] - flat[t + k]) + r * (flat[t + 6 + k] - flat[t + k]));
  }

  // Shells of cells around the point's, until no farther one can hold a nearer triangle.
  search(p, limit) {
    const [nx, ny, nz] = this.cells;
    const at = [0, 1, 2].map((k) => this.cell(p[k], k));
    const found = { best: limit * limit, t: -1, s: 0, r: 0 };
    for (let shell = 0; shell <= nx + ny + nz; shell++) {
      const reach = (shell - 1) * this.side;
      if (shell > 1 && reach * reach > found.best) break;
      for (let z = Math.max(0, at[2] - shell); z <= Math.min(nz - 1, at[2] + shell); z++) {
        for (let y = Math.max(0, at[1] - shell); y <= Math.min(ny - 1, at[1] + shell); y++) {
          const face = Math.abs(z - at[2]) === shell || Math.abs(y - at[1]) === shell;
          for (let x = at[0] - shell; x <= at[0] + shell; x += face || shell === 0 ? 1 : 2 * shell) {
            if (x < 0 || x >= nx) continue;
            const cell = (z * ny + y) * nx + x;
            for (let k = this.first[cell]; k < this.first[cell + 1]; k++) compare(this.flat, 9 * this.list[k], p, found);
          }
        }
      }
    }
    return found;
  }
}

// The grid of a mesh, made once.
export const nearestOf = (mesh) => (mesh.nearest ??= new Nearest(mesh, bounds(mesh)));

// Takes a triangle if it is nearer to a point than what was found. Source: C. Ericson, Real-Time Collision Detection, 5.1.5.
function compare(flat, t, [px, py, pz], found) {
  const ax = flat[t], ay = flat[t + 1], az = flat[t + 2];
  const ux = flat[t + 3] - ax, uy = flat[t + 4] - ay, uz = flat[t + 5] - az;
  const vx = flat[t + 6] - ax, vy = flat[t + 7] - ay, vz = flat[t + 8] - az;
  const wx = px - ax, wy = py - ay, wz = pz - az;
  const d1 = ux * wx + uy * wy + uz * wz, d2 = vx * wx + vy * wy + vz * wz;
  const uu = ux * ux + uy * uy + uz * uz, uv = ux * vx + uy * vy + uz * vz, vv = vx * vx + vy * vy + vz * vz;
  const d3 = d1 - uu, d4 = d2 - uv, d5 = d1 - uv, d6 = d2 - vv;
  const vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  let [s, r] = [0, 0];
  if (d1 <= 0 && d2 <= 0) [s, r] = [0, 0];
  else if (d3 >= 0 && d4 <= d3) [s, r] = [1, 0];
  else if (vc <= 0 && d1 >= 0 && d3 <= 0) [s, r] = [d1 / (d1 - d3 || 1), 0];
  else if (d6 >= 0 && d5 <= d6) [s, r] = [0, 1];
  else if (vb <= 0 && d2 >= 0 && d6 <= 0) [s, r] = [0, d2 / (d2 - d6 || 1)];
  else if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) { r = (d4 - d3) / (d4 - d3 + (d5 - d6) || 1); s = 1 - r; }
  else { const sum = va + vb + vc || 1; [s, r] = [vb / sum, vc / sum]; }
  const squared = (wx - s * ux - r * vx) ** 2 + (wy - s * uy - r * vy) ** 2 + (wz - s * uz - r * vz) ** 2;
  if (squared < found.best) [found.best, found.t, found.s, found.r] = [squared, t, s, r];
}

