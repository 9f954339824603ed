// Meshes as the viewer needs them: read from the service's PLY, with normals, edges, and where a ray meets them.

const SIZES = { char: 1, uchar: 1, short: 2, ushort: 2, int: 4, uint: 4, float: 4, double: 8 };
const READERS = { char: "getInt8", uchar: "getUint8", short: "getInt16", ushort: "getUint16", int: "getInt32", uint: "getUint32", float: "getFloat32", double: "getFloat64" };

function elements(header) {
  const found = [];
  for (const words of header.split("\n").map((line) => line.trim().split(" "))) {
    if (words[0] === "element") found.push({ name: words[1], count: Number(words[2]), properties: [] });
    if (words[0] === "property") found.at(-1)?.properties.push(words[1] === "list" ? { name: words[4], type: words[3], count: words[2] } : { name: words[2], type: words[1] });
  }
  return found;
}

// Binary little-endian PLY: { positions: [x, y, z, …], faces: [[a, b, c, …], …] }.
export function readPly(buffer) {
  const head = new TextDecoder("latin1").decode(new Uint8Array(buffer, 0, Math.min(buffer.byteLength, 65536)));
  const end = head.indexOf("end_header\n") + "end_header\n".length;
  const view = new DataView(buffer);
  let at = end;
  const scalar = (type) => { const value = view[READERS[type]](at, true); at += SIZES[type]; return value; };
  const positions = [];
  const faces = [];
  for (const { name, count, properties } of elements(head.slice(0, end))) {
    for (let k = 0; k < count; k++) {
      for (const property of properties) {
        const values = property.count === undefined ? scalar(property.type) : Array.from({ length: scalar(property.count) }, () => scalar(property.type));
        if (name === "vertex" && "xyz".includes(property.name)) positions.push(values);
        if (name === "face" && property.name === "vertex_indices") faces.push(values);
      }
    }
  }
  return { positions, faces };
}

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

const corner = (mesh, v) => [mesh.positions[3 * v], mesh.positions[3 * v + 1], mesh.positions[3 * v + 2]];

// The triangles of a face, as a fan.
function* fan(face) {
  for (let k = 2; k < face.length; k++) yield [0, k - 1, k];
}

// Centre of the box, and the distance of the farthest vertex from it.
export function bounds(mesh) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  mesh.positions.forEach((x, k) => { low[k % 3] = Math.min(low[k % 3], x); high[k % 3] = Math.max(high[k % 3], x); });
  const centre = low.map((x, k) => (x + high[k]) / 2);
  let radius = 0;
  for (let v = 0; v < mesh.positions.length / 3; v++) radius = Math.max(radius, Math.hypot(...minus(corner(mesh, v), centre)));
  return { centre, radius: radius || 1 };
}

// Triangles with a normal at each corner (smoothed by area), about `centre`: interleaved, six numbers a corner.
export function shaded(mesh, centre) {
  const normals = new Float64Array(mesh.positions.length);
  let corners = 0;
  for (const face of mesh.faces) {
    for (const [a, b, c] of fan(face)) {
      corners += 3;
      const n = cross(minus(corner(mesh, face[b]), corner(mesh, face[a])), minus(corner(mesh, face[c]), corner(mesh, face[a])));
      for (const v of [face[a], face[b], face[c]]) for (let k = 0; k < 3; k++) normals[3 * v + k] += n[k];
    }
  }
  const out = new Float32Array(6 * corners);
  let at = 0;
  for (const face of mesh.faces) {
    for (const triangle of fan(face)) {
      for (const k of triangle) {
        const v = face[k];
        const n = [normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]];
        const length = Math.hypot(...n) || 1;
        out.set([...minus(corner(mesh, v), centre), n[0] / length, n[1] / length, n[2] / length], at);
        at += 6;
      }
    }
  }
  return out;
}

// The edges, each once, about `centre`: six numbers an edge; those of one face only apart.
export function edges(mesh, centre) {
  const count = mesh.positions.length / 3;
  const sides = new Map();
  for (const face of mesh.faces) {
    face.forEach((a, k) => {
      const b = face[(k + 1) % face.length];
      const key = Math.min(a, b) * count + Math.max(a, b);
      sides.set(key, (sides.get(key) ?? 0) + 1);
    });
  }
  const [inner, rim] = [[], []];
  for (const [key, faces] of sides) {
    (faces > 1 ? inner : rim).push(...minus(corner(mesh, Math.floor(key / count)), centre), ...minus(corner(mesh, key % count), centre));
  }
  return { inner: new Float32Array(inner), rim: new Float32Array(rim) };
}

// The corners of all triangles, nine numbers each, and the face and corners that each came of.
function flattened(mesh) {
  if (mesh.flat) return mesh.flat;
  const [points, of] = [[], []];
  mesh.faces.forEach((face, at) => {
    for (const triangle of fan(face)) {
      of.push([at, triangle]);
      for (const k of triangle) points.push(...corner(mesh, face[k]));
    }
  });
  mesh.flat = { points: new Float64Array(points), of };
  return mesh.flat;
}

// Where a ray first meets the mesh: { face, point, barycentric (a weight a corner) }, or null. Möller–Trumbore.
export function hit(mesh, [ox, oy, oz], [dx, dy, dz]) {
  const { points, of } = flattened(mesh);
  let [nearest, best] = [Infinity, null];
  for (let t = 0; t < points.length; t += 9) {
    const [ax, ay, az] = [points[t], points[t + 1], points[t + 2]];
    const [ux, uy, uz] = [points[t + 3] - ax, points[t + 4] - ay, points[t + 5] - az];
    const [vx, vy, vz] = [points[t + 6] - ax, points[t + 7] - ay, points[t + 8] - az];
    const [px, py, pz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
    const det = ux * px + uy * py + uz * pz;
    if (det === 0) continue;
    const [sx, sy, sz] = [ox - ax, oy - ay, oz - az];
    const u = (sx * px + sy * py + sz * pz) / det;
    if (u < 0 || u > 1) continue;
    const [qx, qy, qz] = [sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux];
    const v = (dx * qx + dy * qy + dz * qz) / det;
    if (v < 0 || u + v > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / det;
    if (distance > 0 && distance < nearest) [nearest, best] = [distance, { t, weights: [1 - u - v, u, v] }];
  }
  if (!best) return null;
  const [face, corners] = of[best.t / 9];
  const barycentric = mesh.faces[face].map(() => 0);
  corners.forEach((k, j) => { barycentric[k] = best.weights[j]; });
  return { face, barycentric, point: [ox + nearest * dx, oy + nearest * dy, oz + nearest * dz] };
}
