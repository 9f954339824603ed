// How the quads of a result are beside those of its example: the distributions of their angles and of the lengths of their edges.
// Source: the histograms of the paper's figures 1 and 14; lengths are in the diagonal of the box.

import { make } from "/web/call.js";
import { keptFaces } from "/web/heat.js";
import { bounds, cornersOf, faceCount, place } from "/web/mesh.js";

const BINS = 36;
const ANGLE_MAX = 180;
// Lengths beyond what so many of all edges have are not shown.
const SHARE_SHOWN = 0.985;
const [WIDE, HIGH] = [300, 64];

const minus = (a, b) => a.map((x, k) => x - b[k]);
const length = (a) => Math.hypot(...a);

// Angles of quads at their corners, in degrees, and lengths of edges, of some faces of a mesh.
function measured(mesh, faces) {
  const { diagonal } = bounds(mesh);
  const [angles, lengths, seen] = [[], [], new Set()];
  for (const f of faces) {
    const corners = cornersOf(mesh, f);
    const points = Array.from(corners, (v) => place(mesh, v));
    const count = points.length;
    for (let k = 0; k < count; k++) {
      const next = (k + 1) % count;
      const [u, v] = [minus(points[next], points[k]), minus(points[(k + count - 1) % count], points[k])];
      if (count === 4) {
        const cos = u.reduce((sum, x, j) => sum + x * v[j], 0) / (length(u) * length(v) || 1);
        angles.push((Math.acos(Math.min(1, Math.max(-1, cos))) * 180) / Math.PI);
      }
      const [a, b] = corners[k] < corners[next] ? [corners[k], corners[next]] : [corners[next], corners[k]];
      const edge = a * 2 ** 26 + b;
      if (seen.has(edge)) continue;
      seen.add(edge);
      lengths.push(length(u) / diagonal);
    }
  }
  return { angles, lengths };
}

function shares(values, top) {
  const bins = new Array(BINS).fill(0);
  for (const x of values) if (x <= top) bins[Math.min(BINS - 1, Math.floor((x / top) * BINS))] += 1 / values.length;
  return bins;
}

// The outline of bins as steps.
function outline(bins, most) {
  const step = WIDE / BINS;
  const at = (share) => (HIGH * (1 - share / most)).toFixed(1);
  return bins.map((share, k) => `${k ? "L" : `M0 ${HIGH}L`}${(k * step).toFixed(1)} ${at(share)}L${((k + 1) * step).toFixed(1)} ${at(share)}`).join("") + `L${WIDE} ${HIGH}`;
}

function chart(title, [example, result], low, high) {
  const most = Math.max(...example, ...result) || 1;
  const alike = Math.round(100 * example.reduce((sum, x, k) => sum + Math.min(x, result[k]), 0));
  const box = make("div", undefined, { className: "histogram" });
  const picture = make("div");
  // Nothing but numbers of ours goes into it.
  picture.innerHTML = `<svg viewBox="0 -1 ${WIDE} ${HIGH + 2}" preserveAspectRatio="none" role="img"><path class="of-result" d="${outline(result, most)}Z"/><path class="of-example" d="${outline(example, most)}"/></svg>`;
  picture.firstChild.setAttribute("aria-label", `${title} of the example and of the result: ${alike} in a hundred alike`);
  const head = make("h3", title);
  head.append(make("small", ` ${alike} % alike`));
  const scale = make("div", undefined, { className: "scale" });
  scale.append(make("span", low), make("span", high));
  box.append(head, picture, scale);
  return box;
}

// Both distributions; null where it can't be told which faces are the example's.
export function histograms(example, result, { kept, ownFaces }) {
  const own = keptFaces(example, kept);
  if (own.length === 0 || own.length !== ownFaces) return null;
  const before = measured(example, own);
  const after = measured(result, Array.from({ length: Math.min(ownFaces, faceCount(result)) }, (_, f) => f));
  if (!before.angles.length) return null;
  const all = [...before.lengths, ...after.lengths].sort((a, b) => a - b);
  const top = all[Math.floor(SHARE_SHOWN * (all.length - 1))] || 1;
  const box = make("section");
  const key = make("p", undefined, { className: "soft key" });
  key.append(make("span", "example", { className: "of-example" }), make("span", "result", { className: "of-result" }));
  box.append(make("h2", "The example's quads, and these"), key, chart("Angles", [before, after].map((m) => shares(m.angles, ANGLE_MAX)), "0°", `${ANGLE_MAX}°`), chart("Lengths of edges", [before, after].map((m) => shares(m.lengths, top)), "0", `${(100 * top).toPrecision(2)} % of the size`));
  return box;
}
