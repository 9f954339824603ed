// Triangles without shared vertices get them: corners at the same place become one.

export function welded(soup) {
  const count = soup.length / 3;
  let size = 1024;
  while (size < 2 * count) size *= 2;
  const table = new Int32Array(size).fill(-1);
  const positions = new Float64Array(soup.length);
  const corners = new Uint32Array(count);
  const bits = new Uint32Array(new Float32Array(soup).buffer);
  let made = 0;
  for (let k = 0; k < count; k++) {
    const hash = Math.imul(bits[3 * k], 73856093) ^ Math.imul(bits[3 * k + 1], 19349663) ^ Math.imul(bits[3 * k + 2], 83492791);
    let slot = (hash ^ (hash >>> 15)) & (size - 1);
    for (;; slot = (slot + 1) & (size - 1)) {
      const v = table[slot];
      if (v < 0) {
        table[slot] = made;
        positions.set(soup.subarray(3 * k, 3 * k + 3), 3 * made);
        corners[k] = made++;
        break;
      }
      if (positions[3 * v] === soup[3 * k] && positions[3 * v + 1] === soup[3 * k + 1] && positions[3 * v + 2] === soup[3 * k + 2]) { corners[k] = v; break; }
    }
  }
  return { positions: positions.slice(0, 3 * made), corners };
}
