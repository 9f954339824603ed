// The chosen map, or the stitched mesh, on the input: seen from all sides, its points moved, and downloaded.

import { $, call, make, picture, save, sentence, send } from "/web/call.js";
import { readPly } from "/web/mesh.js";
import { Viewer } from "/web/viewer.js";

const FORMATS = ["obj", "ply", "off", "stl", "glb"];
const LAYERS = { quads: "Quads", wires: "Quads on the input", scan: "Input" };
const VERDICTS = { good: "good", fair: "fair: look at it first", poor: "poor: choose another example, or move points", broken: "broken: of no use as it is; choose another example" };

const mesh = async (path) => readPly(await (await call(`${path}/mesh?format=ply`, { headers: { accept: "*/*" } })).arrayBuffer());

const place = () => $("map");

export const say = (text, kind = "soft") => place().replaceChildren(make("p", text, { className: kind }));

// The viewer of a query, made when it is first needed; null where the browser draws no WebGL.
async function viewer(query) {
  if (query.viewer === undefined) {
    const canvas = make("canvas", undefined, { tabIndex: 0, ariaLabel: "The mesh. Drag to turn it, scroll to come nearer; the arrow keys and + and - do the same." });
    canvas.setAttribute("role", "img");
    try {
      query.viewer = new Viewer(canvas, { onmove: (id, point) => query.onmove?.(id, point), onpin: (hit) => query.onpin?.(hit) });
      query.viewer.setInput(await mesh(`/v1/queries/${query.id}`));
    } catch { query.viewer = null; }
  }
  return query.viewer;
}

function layers(stage) {
  const row = make("p", undefined, { className: "row" });
  for (const [layer, text] of Object.entries(LAYERS)) {
    const button = make("button", text, { type: "button", className: "plain", ariaPressed: String(stage.layer === layer) });
    button.onclick = () => { stage.show(layer); row.querySelectorAll("button").forEach((other) => { other.ariaPressed = String(other === button); }); };
    row.append(button);
  }
  return row;
}

function downloads(path, name) {
  const row = make("p", "Download ", { className: "row" });
  for (const format of FORMATS) {
    const button = make("button", `.${format}`, { type: "button", className: "plain" });
    button.onclick = () => save(`${path}/mesh?format=${format}`, `${name}.${format}`).catch((error) => row.append(make("span", error.message, { className: "bad" })));
    row.append(button);
  }
  return row;
}

// Shows the mesh at `path` with `lines` of text; `points` are those that can be moved.
async function show(query, path, name, lines, points, layer) {
  const stage = await viewer(query);
  const parts = [];
  if (stage) {
    stage.setQuads(await mesh(path));
    stage.setPoints(points);
    if (query.layer !== layer) stage.show(layer);
    query.layer = layer;
    parts.push(stage.canvas, layers(stage));
  } else parts.push(await picture(`${path}/preview.png?size=768`, `${name} on the input`));
  place().replaceChildren(...parts, ...lines, downloads(path, name));
}

export async function showMap(query, map, name) {
  const path = `/v1/queries/${query.id}/maps/${map.id}`;
  const moved = map.constraints.filter((c) => c.origin === "user");
  const lines = [make("p", `${VERDICTS[map.verdict]} · ${map.faces} faces, ${map.folds} folded, angles changed by ${map.distortion.angle.mean.toFixed(1)}° on average`, { className: map.verdict })];
  if (map.reasons.length) {
    const reasons = make("ul", undefined, { className: "soft" });
    reasons.append(...map.reasons.map((reason) => make("li", reason)));
    lines.push(reasons);
  }
  if ((map.verdict === "poor" || map.verdict === "broken") && query.segments.length === 1) {
    const cut = make("p", "Where no example fits as a whole, some may fit its parts: ", { className: "soft" });
    const button = make("button", "Cut it into limbs, head and torso", { type: "button", className: "plain" });
    button.onclick = query.cut;
    cut.append(button);
    lines.push(cut);
  }
  const trouble = make("p", "", { className: "bad", role: "alert" });
  const edit = async (change) => {
    trouble.textContent = "";
    try {
      await showMap(query, await send(`${path}/constraints`, change, "PATCH"), name);
    } catch (error) {
      if (error.code !== "constraint_folds") { trouble.textContent = error.message; return; }
      trouble.textContent = "The quads would fold there. Move the point less, or ";
      const room = make("button", "let the other points make room", { type: "button", className: "plain", title: error.message });
      room.onclick = () => edit({ ...change, on_fold: "resolve" });
      trouble.append(room);
    }
  };
  query.onmove = (id, point) => edit({ set: [{ id, on_input: point }] });
  query.onpin = ({ face, barycentric, point }) => edit({ set: [{ on_example: { face, barycentric }, on_input: point }] });
  if (map.constraints.length) {
    const help = make("p", "Drag a blue point to where it belongs on the input; double-click the quads to pin another. ", { className: "soft" });
    if (moved.length) {
      const undo = make("button", `Put ${moved.length === 1 ? "it" : `all ${moved.length}`} back`, { type: "button", className: "plain" });
      undo.onclick = () => edit({ undo: moved.map((c) => c.id) });
      help.append(undo);
    }
    lines.push(help);
  }
  lines.push(trouble);
  await show(query, path, name, lines, map.constraints.map((c) => ({ id: c.id, origin: c.origin, point: c.on_input.point })), query.segments.length > 1 ? "wires" : "quads");
}

export async function showComposition(query, made) {
  [query.onmove, query.onpin] = [null, null];
  const word = made.inspired > 0 ? VERDICTS[made.verdict] : "no example used";
  const lines = [make("p", `${word} · ${(100 * made.inspired).toFixed(0)} % of it an example's`, { className: made.verdict })];
  if (made.reasons.length) {
    const reasons = make("ul", undefined, { className: "soft" });
    reasons.append(...made.reasons.map((reason) => make("li", sentence(reason))));
    lines.push(reasons);
  }
  lines.push(make("p", `${made.quads} quads on ${made.vertices} vertices, ${made.triangles} triangles left; ${made.extraordinary_vertices} extraordinary vertices (${made.extraordinary_before} in the examples)`));
  const notes = make("ul", undefined, { className: "soft" });
  notes.append(...made.notes.map((note) => make("li", sentence(note))));
  await show(query, `/v1/queries/${query.id}/compositions/${made.id}`, "stitched", [...lines, notes], [], "quads");
}
