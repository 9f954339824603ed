// Lays the edges of a cage onto the scan: long edges of coarse quads run below a bulge between their ends, and would not be
// seen there.

import { bounds } from "/web/mesh.js";
import { nearestOf } from "/web/near.js";

// Pieces an edge is cut into, and points that are laid on the scan at most, so that this takes a fraction of a second.
const PIECES_MAX = 8;
const POINTS_MAX = 36_000;

// `pairs`: vertices, two an edge. Answers with the ends of lines about `centre`.
export function draped(pairs, positions, scan, centre) {
  const edges = pairs.length / 2;
  const pieces = Math.max(1, Math.min(PIECES_MAX, Math.floor(POINTS_MAX / Math.max(1, edges))));
  const nearest = nearestOf(scan);
  const reach = bounds(scan).diagonal / 15;
  const at = new Float32Array(6 * edges * pieces);
  for (let e = 0; e < edges; e++) {
    const [a, b] = [3 * pairs[2 * e], 3 * pairs[2 * e + 1]];
    let from = [positions[a], positions[a + 1], positions[a + 2]];
    for (let k = 1; k <= pieces; k++) {
      const straight = [0, 1, 2].map((j) => positions[a + j] + (k / pieces) * (positions[b + j] - positions[a + j]));
      const to = k === pieces ? straight : nearest.point(straight, reach) ?? straight;
      const out = 6 * (e * pieces + k - 1);
      for (let j = 0; j < 3; j++) { at[out + j] = from[j] - centre[j]; at[out + 3 + j] = to[j] - centre[j]; }
      from = to;
    }
  }
  return { at };
}
