// The named landmarks of an example, in its view: placed by a click, named, moved and taken off.

import { make } from "/web/call.js";

const LANDMARKS_MAX = 128;
// A click so near to a corner of a face (as its weight there) means the vertex.
const CORNER = 0.7;
const WHAT = "Points by name, such as the tip of the nose. The example is laid by them on scans whose points have the same names.";
const HOW = "Click the point on the example. With the keyboard: turn until it lies under the cross, then Enter.";

// The landmark of a point that was clicked: a vertex where it is near one, which stays what it is in every shape of one topology.
function landmarkAt(mesh, { face, barycentric, point }) {
  const corner = barycentric.findIndex((weight) => weight >= CORNER);
  if (corner < 0) return { point };
  const vertex = mesh.corners[mesh.starts[face] + corner];
  return { vertex, point: [...mesh.positions.subarray(3 * vertex, 3 * vertex + 3)] };
}

function freeName(landmarks) {
  for (let k = landmarks.length + 1; ; k++) if (landmarks.every((l) => l.name !== `landmark ${k}`)) return `landmark ${k}`;
}

// The part of the view's form that holds them; `value()`: as the service takes them, `take(viewer, mesh)` once the mesh is there.
export class Naming {
  constructor(landmarks) {
    this.all = landmarks.map((landmark) => ({ ...landmark }));
    this.placing = null;
    this.element = make("fieldset", undefined, { id: "naming" });
    this.list = make("ol");
    this.add = make("button", "Add a landmark", { type: "button", className: "plain small", id: "add-landmark", disabled: true });
    this.add.onclick = () => this.place(this.placing === null ? this.all.length : null);
    this.hint = make("p", WHAT, { className: "soft" });
    this.hint.setAttribute("role", "status");
    this.element.append(make("legend", "Named landmarks"), this.list, this.add, this.hint);
    this.draw();
  }

  take(viewer, mesh) {
    Object.assign(this, { viewer, mesh });
    viewer.hooks.onpick = (_, found) => this.picked(found);
    viewer.canvas.addEventListener("keydown", (event) => {
      if (this.placing === null) return;
      if (event.key === "Escape") { event.preventDefault(); this.place(null); }
      if (event.key !== "Enter") return;
      event.preventDefault();
      const found = viewer.inTheMiddle("result");
      if (found) this.picked(found);
    });
    this.draw();
  }

  value() { return this.all.map((landmark) => ({ ...landmark, name: landmark.name.trim() })); }

  // As the service placed them.
  renew(landmarks) {
    this.all = landmarks.map((landmark) => ({ ...landmark }));
    this.draw();
  }

  // Waits for a click that places a landmark, by its number; null ends that.
  place(at) {
    if (!this.viewer || (at !== null && at >= LANDMARKS_MAX)) return;
    this.placing = at;
    this.viewer.picks = at !== null;
    this.viewer.canvas.classList.toggle("picking", at !== null);
    this.viewer.canvas.parentElement.classList.toggle("picking", at !== null);
    this.hint.textContent = at === null ? WHAT : HOW;
    this.draw();
    if (at !== null) this.viewer.canvas.focus();
  }

  picked(found) {
    const at = this.placing;
    if (at === null) return;
    const place = landmarkAt(this.mesh, found);
    const isNew = at >= this.all.length;
    const name = isNew ? freeName(this.all) : this.all[at].name;
    this.all[at] = { name, ...place };
    this.place(null);
    const input = this.list.children[at]?.querySelector("input");
    if (isNew) { input?.focus(); input?.select(); }
  }

  draw() {
    const focused = document.activeElement?.id;
    this.list.replaceChildren(...this.all.map((landmark, k) => this.item(landmark, k)));
    Object.assign(this.add, { textContent: this.placing === null ? "Add a landmark" : "Stop placing", disabled: !this.viewer || (this.placing === null && this.all.length >= LANDMARKS_MAX), ariaPressed: String(this.placing !== null) });
    this.viewer?.setPairs(this.all.map((landmark, k) => ({ name: String(k + 1), example: null, input: landmark.point })));
    if (focused && document.activeElement === document.body) document.getElementById(focused)?.focus();
  }

  item(landmark, k) {
    const item = make("li", undefined, { className: this.placing === k ? "chosen" : "" });
    const name = make("input", undefined, { value: landmark.name, maxLength: 64, required: true, ariaLabel: `Name of landmark ${k + 1}`, id: `landmark-${k}` });
    name.oninput = () => { landmark.name = name.value; };
    const move = make("button", "Move", { type: "button", className: "plain small", ariaLabel: `Move landmark ${k + 1}`, id: `move-${k}`, disabled: !this.viewer });
    move.onclick = () => this.place(this.placing === k ? null : k);
    const remove = make("button", "Remove", { type: "button", className: "plain small", ariaLabel: `Remove landmark ${k + 1}`, id: `drop-${k}` });
    remove.onclick = () => { this.all.splice(k, 1); this.place(null); this.draw(); this.add.focus(); };
    item.append(name, move, remove);
    return item;
  }
}
