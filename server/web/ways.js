// Shortest ways along the edges of a part of a mesh.

import { endOf } from "/web/regions.js";

// A queue that gives the smallest first. What has become smaller since is in it twice; who asks passes over the older.
class Queue {
  constructor() { [this.keys, this.values] = [[], []]; }

  push(key, value) {
    const { keys, values } = this;
    let k = keys.length;
    while (k > 0) {
      const up = (k - 1) >> 1;
      if (keys[up] <= key) break;
      [keys[k], values[k]] = [keys[up], values[up]];
      k = up;
    }
    [keys[k], values[k]] = [key, value];
  }

  pop() {
    const { keys, values } = this;
    if (!keys.length) return null;
    const first = [keys[0], values[0]];
    const [key, value] = [keys.pop(), values.pop()];
    if (!keys.length) return first;
    let k = 0;
    for (let down = 1; down < keys.length; down = 2 * k + 1) {
      if (down + 1 < keys.length && keys[down + 1] < keys[down]) down++;
      if (keys[down] >= key) break;
      [keys[k], values[k]] = [keys[down], values[down]];
      k = down;
    }
    [keys[k], values[k]] = [key, value];
    return first;
  }
}

// The edges of some faces as a graph of their vertices: `next[first[v]]…` are those beside vertex `v`.
export function graphOf(mesh, faces) {
  const count = mesh.positions.length / 3;
  const first = new Uint32Array(count + 1);
  const each = (act) => { for (const f of faces) for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) act(mesh.corners[k], endOf(mesh, f, k)); };
  each((a, b) => { first[a + 1]++; first[b + 1]++; });
  for (let v = 0; v < count; v++) first[v + 1] += first[v];
  const next = new Uint32Array(first[count]);
  const at = first.slice();
  each((a, b) => { next[at[a]++] = b; next[at[b]++] = a; });
  return { mesh, first, next, cost: new Float64Array(count), from: new Int32Array(count), mark: new Uint32Array(count), round: 0 };
}

// The cheapest way from a vertex to the first that `isGoal`, as its vertices: { path, cost }; null where there is none
// below `limit`. A step costs its length times `weight(to, from)`; Infinity bars it. Source: E. Dijkstra, 1959.
export function way(graph, start, isGoal, weight = () => 1, limit = Infinity) {
  const { mesh: { positions }, first, next, cost, from, mark } = graph;
  graph.round++;
  const queue = new Queue();
  [cost[start], from[start], mark[start]] = [0, -1, graph.round];
  queue.push(0, start);
  for (let top = queue.pop(); top; top = queue.pop()) {
    const [so, v] = top;
    if (so > cost[v]) continue;
    if (isGoal(v)) {
      const path = [v];
      while (from[path[0]] >= 0) path.unshift(from[path[0]]);
      return { path, cost: so };
    }
    for (let k = first[v]; k < first[v + 1]; k++) {
      const w = next[k];
      const by = Math.hypot(positions[3 * w] - positions[3 * v], positions[3 * w + 1] - positions[3 * v + 1], positions[3 * w + 2] - positions[3 * v + 2]);
      const far = so + by * weight(w, v);
      if (far < limit && (mark[w] !== graph.round || far < cost[w])) {
        [cost[w], from[w], mark[w]] = [far, v, graph.round];
        queue.push(far, w);
      }
    }
  }
  return null;
}
