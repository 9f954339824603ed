// A stand-in for a large scan while it is turned on a computer without a graphics card: vertices of a cell become one, and
// triangles that vanish so are left out. Source: J. Rossignac and P. Borrel, Multi-resolution 3D approximations, 1993.

import { triangles } from "/web/mesh.js";

// Cells along the diagonal: some 20,000 triangles are left of any scan.
const CELLS = 110;

// Triangles below which a scan needs no stand-in.
export const LARGE = 40_000;

export function coarse(mesh, { low, diagonal }) {
  const cells = new Map();
  const count = mesh.positions.length / 3;
  const cellOf = new Uint32Array(count);
  const [sums, sizes] = [[], []];
  for (let v = 0; v < count; v++) {
    const [x, y, z] = [0, 1, 2].map((k) => Math.floor(((mesh.positions[3 * v + k] - low[k]) / diagonal) * CELLS));
    const key = (x * (CELLS + 1) + y) * (CELLS + 1) + z;
    let cell = cells.get(key);
    if (cell === undefined) {
      cell = sizes.length;
      cells.set(key, cell);
      sizes.push(0);
      sums.push(0, 0, 0);
    }
    cellOf[v] = cell;
    sizes[cell]++;
    for (let k = 0; k < 3; k++) sums[3 * cell + k] += mesh.positions[3 * v + k];
  }
  const { at, of } = triangles(mesh);
  const [corners, segments] = [[], mesh.segments ? [] : null];
  for (let t = 0; t < of.length; t++) {
    const [a, b, c] = [0, 1, 2].map((k) => cellOf[mesh.corners[at[3 * t + k]]]);
    if (a === b || b === c || c === a) continue;
    corners.push(a, b, c);
    segments?.push(mesh.segments[of[t]]);
  }
  return {
    positions: Float64Array.from(sums, (x, k) => x / sizes[Math.floor(k / 3)]), corners: Uint32Array.from(corners), uvs: null,
    starts: Uint32Array.from({ length: corners.length / 3 + 1 }, (_, k) => 3 * k), segments: segments && Int32Array.from(segments),
  };
}
