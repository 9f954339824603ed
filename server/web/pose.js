// How one mesh lies in another's frame: the similarity that takes points to points best. Source: B. Horn, Closed-form
// solution of absolute orientation using unit quaternions, 1987.

const middle = (points, count) => {
  const sum = [0, 0, 0];
  for (let k = 0; k < 3 * count; k++) sum[k % 3] += points[k];
  return sum.map((x) => x / count);
};

// The largest eigenvector of a symmetric 4×4 matrix; the shift makes its eigenvalue the largest in size, too.
function largest(m) {
  const shift = Math.max(...m.map((row) => row.reduce((sum, x) => sum + Math.abs(x), 0)));
  let q = [1, 0.1, 0.2, 0.3];
  for (let round = 0; round < 300; round++) {
    const next = m.map((row, i) => row.reduce((sum, x, j) => sum + x * q[j], shift * q[i]));
    const length = Math.hypot(...next) || 1;
    q = next.map((x) => x / length);
  }
  return q;
}

// { turn (columns), scale, from, to }: a point p of the first lies at scale · turn · (p − from) + to.
export function similarity(from, to, count) {
  const [a, b] = [middle(from, count), middle(to, count)];
  const s = Array.from({ length: 3 }, () => [0, 0, 0]);
  let [size, other] = [0, 0];
  for (let v = 0; v < count; v++) {
    for (let i = 0; i < 3; i++) {
      const x = from[3 * v + i] - a[i];
      size += x * x;
      other += (to[3 * v + i] - b[i]) ** 2;
      for (let j = 0; j < 3; j++) s[i][j] += x * (to[3 * v + j] - b[j]);
    }
  }
  const [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s;
  const [w, x, y, z] = largest([
    [xx + yy + zz, yz - zy, zx - xz, xy - yx],
    [yz - zy, xx - yy - zz, xy + yx, zx + xz],
    [zx - xz, xy + yx, yy - xx - zz, yz + zy],
    [xy - yx, zx + xz, yz + zy, zz - xx - yy],
  ]);
  const turn = [
    w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y),
    2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x),
    2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z,
  ];
  return { turn, scale: Math.sqrt(other / (size || 1)) || 1, from: a, to: b };
}
