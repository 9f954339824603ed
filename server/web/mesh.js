// What is derived of a mesh for drawing it: its size, triangles, normals, true edges and extraordinary vertices.

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export const place = (mesh, v) => [mesh.positions[3 * v], mesh.positions[3 * v + 1], mesh.positions[3 * v + 2]];
export const faceCount = (mesh) => mesh.starts.length - 1;
export const cornersOf = (mesh, f) => mesh.corners.subarray(mesh.starts[f], mesh.starts[f + 1]);

// Centre of the box, the distance of the farthest vertex from it, and the box's diagonal.
export function bounds(mesh) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  const { positions } = mesh;
  for (let k = 0; k < positions.length; k++) {
    const axis = k % 3;
    if (positions[k] < low[axis]) low[axis] = positions[k];
    if (positions[k] > high[axis]) high[axis] = positions[k];
  }
  const centre = low.map((x, k) => (x + high[k]) / 2);
  let far = 0;
  for (let k = 0; k < positions.length; k += 3) far = Math.max(far, (positions[k] - centre[0]) ** 2 + (positions[k + 1] - centre[1]) ** 2 + (positions[k + 2] - centre[2]) ** 2);
  return { centre, radius: Math.sqrt(far) || 1, diagonal: Math.hypot(...minus(high, low)) || 1, low, high };
}

// Corners of all triangles as places in `mesh.corners`, three each, and the face of each. A quad is cut along the
// diagonal whose triangles agree better about its front.
export function triangles(mesh) {
  if (mesh.triangles) return mesh.triangles;
  const faces = faceCount(mesh);
  const count = mesh.corners.length - 2 * faces;
  const [at, of] = [new Uint32Array(3 * count), new Uint32Array(count)];
  let t = 0;
  for (let f = 0; f < faces; f++) {
    const [from, to] = [mesh.starts[f], mesh.starts[f + 1]];
    const degree = to - from;
    const turn = degree === 4 && secondIsBetter(mesh, from) ? 1 : 0;
    for (let k = 2; k < degree; k++, t++) {
      at[3 * t] = from + turn;
      at[3 * t + 1] = from + ((k - 1 + turn) % degree);
      at[3 * t + 2] = from + ((k + turn) % degree);
      of[t] = f;
    }
  }
  mesh.triangles = { at: at.subarray(0, 3 * t), of: of.subarray(0, t) };
  return mesh.triangles;
}

function secondIsBetter(mesh, from) {
  const [a, b, c, d] = [0, 1, 2, 3].map((k) => place(mesh, mesh.corners[from + k]));
  const agree = (p, q, r, s) => dot(cross(minus(q, p), minus(r, p)), cross(minus(r, p), minus(s, p)));
  return agree(b, c, d, a) > agree(a, b, c, d) + 1e-12;
}

// A normal a vertex, smoothed by area.
export function normals(mesh) {
  const { positions, corners } = mesh;
  const { at } = triangles(mesh);
  const out = new Float32Array(positions.length);
  for (let t = 0; t < at.length; t += 3) {
    const [a, b, c] = [3 * corners[at[t]], 3 * corners[at[t + 1]], 3 * corners[at[t + 2]]];
    const [ux, uy, uz] = [positions[b] - positions[a], positions[b + 1] - positions[a + 1], positions[b + 2] - positions[a + 2]];
    const [vx, vy, vz] = [positions[c] - positions[a], positions[c + 1] - positions[a + 1], positions[c + 2] - positions[a + 2]];
    const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const v of [a, b, c]) { out[v] += nx; out[v + 1] += ny; out[v + 2] += nz; }
  }
  for (let v = 0; v < out.length; v += 3) {
    const length = Math.hypot(out[v], out[v + 1], out[v + 2]) || 1;
    out[v] /= length; out[v + 1] /= length; out[v + 2] /= length;
  }
  return out;
}

// The edges of its faces, each once, as pairs of vertices: `inner` between two faces, `rim` of one. With them the number of
// edges a vertex, and whether it lies on the rim.
export function edges(mesh) {
  if (mesh.edges) return mesh.edges;
  const sides = mesh.corners.length;
  let size = 1024;
  while (size < 2 * sides) size *= 2;
  const table = new Int32Array(size).fill(-1);
  const [from, to, uses] = [new Uint32Array(sides), new Uint32Array(sides), new Uint8Array(sides)];
  let made = 0;
  for (let f = 0; f < faceCount(mesh); f++) {
    for (let k = mesh.starts[f]; k < mesh.starts[f + 1]; k++) {
      const [p, q] = [mesh.corners[k], mesh.corners[k + 1 < mesh.starts[f + 1] ? k + 1 : mesh.starts[f]]];
      const [a, b] = p < q ? [p, q] : [q, p];
      let slot = (Math.imul(a, 73856093) ^ Math.imul(b, 19349663)) & (size - 1);
      while (table[slot] >= 0 && (from[table[slot]] !== a || to[table[slot]] !== b)) slot = (slot + 1) & (size - 1);
      if (table[slot] < 0) { table[slot] = made; [from[made], to[made]] = [a, b]; made++; }
      uses[table[slot]]++;
    }
  }
  const valence = new Uint16Array(mesh.positions.length / 3);
  const onRim = new Uint8Array(valence.length);
  const [inner, rim] = [[], []];
  for (let e = 0; e < made; e++) {
    valence[from[e]]++;
    valence[to[e]]++;
    if (uses[e] > 1) inner.push(from[e], to[e]);
    else { rim.push(from[e], to[e]); onRim[from[e]] = onRim[to[e]] = 1; }
  }
  mesh.edges = { inner: Uint32Array.from(inner), rim: Uint32Array.from(rim), valence, onRim };
  return mesh.edges;
}

// Inner vertices with another number of edges than four: [{ vertex, valence }].
export function extraordinary(mesh) {
  const { valence, onRim } = edges(mesh);
  const found = [];
  valence.forEach((n, vertex) => { if (n > 0 && n !== 4 && !onRim[vertex]) found.push({ vertex, valence: n }); });
  return found;
}

// Whether the faces are mostly quads, so that their edges are worth seeing.
export function isQuads(mesh) {
  let quads = 0;
  for (let f = 0; f < faceCount(mesh); f++) if (mesh.starts[f + 1] - mesh.starts[f] === 4) quads++;
  return 2 * quads > faceCount(mesh);
}
