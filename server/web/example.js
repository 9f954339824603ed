// One example of the corpus: in the round, with its parts, and what is known of it.

import { $, buffer, make, save } from "/web/call.js";
import { exampleMesh } from "/web/laying.js";
import { Naming } from "/web/naming.js";
import { colourOf, css } from "/web/parts.js";
import { readPly } from "/web/read.js";
import { go } from "/web/route.js";
import { Viewer } from "/web/viewer.js";
import { SURFACES } from "/web/words.js";

const RATINGS = ["0", "1", "2", "3", "4", "5"];

function field(text, input) {
  const label = make("label", text);
  label.append(input);
  return label;
}

function pair(...fields) {
  const row = make("div", undefined, { className: "pair" });
  row.append(...fields);
  return row;
}

const ASIDE = [0.62, 0.64, 0.68];

// Its parts: all in their colours, or one that stands out. `take(viewer, mesh)` once the mesh is there, whose faces tell their part.
class Parts {
  constructor({ segments }) {
    this.element = make("div", undefined, { id: "example-parts" });
    this.shown = null;
    const whole = segments.find((s) => !s.is_part);
    const hasWhole = segments.some((s) => s.is_part);
    this.all = segments.length > 1 ? segments.filter((s) => s.is_part || !hasWhole) : [];
    this.element.append(make("p", segments.length === 1 || hasWhole ? `Surface: ${SURFACES[whole.topology] ?? whole.topology}` : "Kept by its parts alone", { className: "soft" }));
    this.list = make("ul");
    if (this.all.length) this.element.append(this.list);
    this.draw();
  }

  take(viewer, mesh) {
    Object.assign(this, { viewer, mesh });
    this.show(null);
  }

  // `part`: the number of one, "all", or null for none.
  show(part) {
    this.shown = part;
    const labels = this.mesh?.segments;
    const known = new Set(this.all.map((s) => s.segment));
    const tint = (label) => (!known.has(label) || (part !== "all" && label !== part) ? ASIDE : colourOf(label, part !== "all"));
    if (labels) this.viewer.setQuads(this.mesh, part === null ? null : (face) => tint(labels[face]));
    this.draw();
  }

  draw() {
    const focused = document.activeElement?.id;
    const toggle = (part, text, colour) => {
      const item = make("li");
      const button = make("button", undefined, { type: "button", className: "plain small", ariaPressed: String(this.shown === part), id: `example-part-${part}`, disabled: !this.mesh?.segments });
      if (colour) { const dot = make("span", undefined, { className: "dot" }); dot.style.background = css(colour); button.append(dot); }
      button.append(text);
      button.onclick = () => this.show(this.shown === part ? null : part);
      item.append(button);
      return item;
    };
    const items = this.all.map((s) => toggle(s.segment, `part ${s.segment}: ${SURFACES[s.topology] ?? s.topology}, ${s.faces} faces`, colourOf(s.segment, this.shown === s.segment)));
    if (items.length) this.list.replaceChildren(toggle("all", "All parts in colours"), ...items);
    if (focused && document.activeElement === document.body) document.getElementById(focused)?.focus();
  }
}

const labelled = (example) => (example.segments.length > 1 ? buffer(`/v1/examples/${example.id}/mesh?format=ply&labels=true`).then(readPly) : exampleMesh(example.id));

// `act`: { change(patch), remove(), closed() }.
export function showExample(example, act) {
  const dialog = $("example-dialog");
  const box = make("div", undefined, { className: "picture" });
  const canvas = make("canvas", undefined, { tabIndex: 0, ariaLabel: "The example. Drag or use the arrow keys to turn." });
  canvas.setAttribute("role", "application");
  const marks = make("div", undefined, { className: "marks", ariaHidden: "true" });
  box.append(canvas, marks);
  const form = make("form");
  const name = make("input", undefined, { value: example.name, maxLength: 256, id: "edit-name" });
  const tags = make("input", undefined, { value: example.tags.join(", "), id: "edit-tags" });
  const rating = make("select", undefined, { id: "edit-rating" });
  rating.append(...RATINGS.map((r) => make("option", r === "0" ? "0, rank it last" : r === "3" ? "3, as any other" : r === "5" ? "5, prefer it" : r, { value: r })));
  rating.value = String(Math.round(example.relevance));
  const author = make("input", undefined, { value: example.author, maxLength: 256, id: "edit-author" });
  const licence = make("input", undefined, { value: example.licence, maxLength: 256, id: "edit-licence", placeholder: "CC0-1.0" });
  const notes = make("textarea", undefined, { value: example.notes, maxLength: 4096, rows: 2, id: "edit-notes" });
  const told = make("p", "", { className: "soft", id: "example-told" });
  told.setAttribute("role", "status");
  const naming = new Naming(example.landmarks);
  const parts = new Parts(example);
  form.onsubmit = async (event) => {
    event.preventDefault();
    try {
      const texts = { name: name.value.trim(), author: author.value.trim(), licence: licence.value.trim(), notes: notes.value.trim() };
      const changed = await act.change({ ...texts, tags: tags.value.split(",").map((t) => t.trim()).filter(Boolean), relevance: Number(rating.value), landmarks: naming.value() });
      naming.renew(changed.landmarks);
      $("example-name").textContent = changed.name || changed.id;
      Object.assign(told, { textContent: "Saved.", className: "good" });
    } catch (error) { Object.assign(told, { textContent: error.message, className: "bad" }); }
  };
  const buttons = make("p", undefined, { className: "row" });
  const close = make("button", "Close", { type: "button", className: "plain" });
  close.onclick = () => dialog.close();
  const download = make("button", "Download", { type: "button", className: "plain" });
  download.onclick = () => save(`/v1/examples/${example.id}/mesh`, `${example.name || example.id}.${example.format}`).catch((error) => { told.textContent = error.message; });
  const remove = make("button", "Delete", { type: "button", className: "plain" });
  remove.onclick = () => { dialog.close(); act.remove(); };
  buttons.append(make("button", "Save"), download, remove, close);
  const { faces, quads, vertices } = example.counts;
  form.append(make("h2", example.name || example.id, { id: "example-name" }), field("Name", name), pair(field("Tags", tags), field("Rating", rating)), pair(field("Author", author), field("Licence", licence)), field("Notes", notes), naming.element, make("p", `${faces} faces (${Math.round((100 * quads) / Math.max(1, faces))} % quads), ${vertices} vertices, added ${example.created.slice(0, 10)}`, { className: "soft" }), parts.element, buttons, told);
  dialog.replaceChildren(box, form);
  let viewer = null;
  dialog.onclose = () => { viewer?.end(); dialog.replaceChildren(); act.closed(); };
  dialog.showModal();
  go(`corpus/${example.id}`);
  try {
    viewer = new Viewer(canvas, marks, {});
    labelled(example).then((mesh) => { if (!canvas.isConnected) return; viewer.setScan(mesh); viewer.setQuads(mesh); viewer.set({ dots: true }); naming.take(viewer, mesh); parts.take(viewer, mesh); }, (error) => { told.textContent = error.message; });
  } catch (error) { told.textContent = error.message; }
}
