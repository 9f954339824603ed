// A cut without a pointer: a cross over the scan that Alt and the arrows move, as they move points elsewhere, and a line through the
// places where it was set. These stay where they are on the scan while that is turned.

import { nameOf, stroke } from "/web/painting.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";

// By how far (in CSS pixels) an arrow moves the cross, alone and with Shift.
const STEP = 6;
const LEAP = 48;
// So near to each other (in CSS pixels) two places are one.
const SAME = 2;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

const KEYS = "Alt and the arrows move the cross, Enter sets a point.";

// `cross`: the place of the cross in the view, in CSS pixels, null where it is not seen; `set`: the places of the line, in the
// scan's units; `under`: what the cross was last told to lie on; `of`: the making of parts that they belong to.
const line = { cross: null, set: [], under: "", of: null };
let ink = null;

const pane = () => bench.viewer.paneBoxes().find((b) => b.name === "result");
const onScreen = (at) => { const [x, y] = bench.viewer.onScreen(at, pane()); return { x, y }; };
const isOn = () => bench.query?.painting?.tool === "cut" && bench.viewer.draws;
const event = ({ x, y }) => { const { left, top } = bench.viewer.canvas.getBoundingClientRect(); return { clientX: left + x, clientY: top + y }; };
const isSame = (a, b) => Math.hypot(a.x - b.x, a.y - b.y) < SAME;
const points = (count) => (count === 1 ? "1 point" : `${count} points`);

// The place in space of one of the view: on the scan, or beside it, as deep as its middle.
function place(at) {
  const { viewer } = bench;
  const found = viewer.under(event(at), pane());
  if (found) return found.point;
  const [origin, to] = viewer.ray(viewer.pointer(event(at), pane()), pane());
  return origin.map((x, k) => x + 4 * viewer.frames.result.radius * to[k]);
}

function under(at) {
  const { query, viewer } = bench;
  const found = viewer.under(event(at), pane());
  return found ? `on ${nameOf(query.painting, query.painting.labels[found.face])}` : "beside the scan";
}

// Shows the cross, in the middle where it was nowhere; a line that was begun for other parts is gone.
function show() {
  const { left, top, width, height } = pane();
  if (line.of !== bench.query.painting) Object.assign(line, { cross: null, set: [], of: bench.query.painting });
  line.cross ??= { x: left + width / 2, y: top + height / 2 };
  line.isSeen = true;
  draw();
}

function hide() {
  line.isSeen = false;
  draw();
}

function move([dx, dy], by) {
  const { left, top, width, height } = pane();
  const within = (x, low, high) => Math.min(high, Math.max(low, x));
  line.cross = { x: within(line.cross.x + by * dx, left, left + width), y: within(line.cross.y + by * dy, top, top + height) };
  const now = under(line.cross);
  if (now !== line.under) say(`The cross is ${now}.`);
  line.under = now;
}

function set() {
  const last = line.set.at(-1);
  if (last && isSame(onScreen(last), line.cross)) { cut(); return; }
  line.set.push(place(line.cross));
  say(`Point ${line.set.length} is set, ${under(line.cross)}. ${line.set.length === 1 ? "Move the cross to the next one." : "C, or Enter again, cuts along the line."}`);
}

// Cuts along the line, and on to the cross. What parts nothing stays, to be put right.
function cut() {
  const all = line.set.map(onScreen);
  if (all.length && !isSame(all.at(-1), line.cross)) all.push(line.cross);
  if (all.length < 2) { say("A cut needs two points: set one with Enter, and move the cross on."); return; }
  if (stroke(bench.viewer.pen.sampled(all))) line.set = [];
}

function takeBack() {
  if (!line.set.pop()) { say("There is no point to take back."); return; }
  say(`The last point is taken back; ${points(line.set.length)} left.`);
}

function leave() {
  if (!line.set.length) { document.getElementById("tool-cut")?.focus(); return; }
  line.set = [];
  say("The line is taken away. Escape again leaves the scan.");
}

const ACTS = { Enter: set, c: cut, C: cut, Backspace: takeBack, Escape: leave };

// A key that was pressed on the canvas.
export function key(pressed) {
  if (!isOn() || pressed.ctrlKey || pressed.metaKey) return;
  const arrow = pressed.altKey ? ARROWS[pressed.key] : null;
  const act = pressed.altKey ? null : ACTS[pressed.key];
  if (!arrow && !act) return;
  pressed.preventDefault();
  show();
  if (arrow) move(arrow, pressed.shiftKey ? LEAP : STEP);
  else act();
  draw();
}

// With each frame: the scan may have been turned.
export function draw() {
  if (!ink && !line.isSeen) return;
  if (!ink) {
    bench.viewer.marks.insertAdjacentHTML("afterend", '<svg class="stroke keyed" aria-hidden="true"><polyline/><polyline/><path/><path/></svg>');
    ink = bench.viewer.marks.nextElementSibling;
  }
  const isSeen = line.isSeen && isOn() && line.of === bench.query.painting;
  const all = isSeen ? line.set.map(onScreen) : [];
  const dots = all.map(({ x, y }) => `M${x - 3} ${y}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`);
  const cross = isSeen ? `M${line.cross.x - 12} ${line.cross.y}h9m6 0h9m-12 -12v9m0 6v9` : "";
  const along = [...all, ...(all.length ? [line.cross] : [])].map(({ x, y }) => `${x},${y}`).join(" ");
  for (const drawn of ink.querySelectorAll("polyline")) drawn.setAttribute("points", along);
  for (const drawn of ink.querySelectorAll("path")) drawn.setAttribute("d", dots.join("") + cross);
}

export function begin(canvas) {
  canvas.addEventListener("focus", () => { if (isOn() && canvas.matches(":focus-visible")) { show(); say(`${KEYS} The cross is ${line.under = under(line.cross)}.`); } });
  canvas.addEventListener("blur", hide);
  canvas.addEventListener("pointerdown", hide);
}
