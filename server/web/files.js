// Files that come in: dropped anywhere in the window or chosen; a queue of scans, uploaded one after the other.

import { $, buffer, json, make, upload } from "/web/call.js";
import { cancelQuery, close, open, openById, preview } from "/web/bench.js";
import { readMesh } from "/web/read.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";

const FORMATS = ["obj", "ply", "off", "stl", "glb"];
// Files beyond this are left to the server to read: the page would stand still.
const READ_BYTES_MAX = 200e6;
const NAMES_MAX = 200;
// Scans of before that are listed at first.
const HELD_SHOWN_MAX = 8;

const scans = []; // { file, name, mesh, state, progress, started, cut }
let shown = null;
let running = false;

export const formatOf = (name) => { const end = name.split(".").pop().toLowerCase(); return FORMATS.includes(end) ? end : null; };

// The server gives scans no names: this browser keeps those that it sent.
const names = JSON.parse(localStorage.getItem("names") ?? "{}");
export const nameOf = (id) => names[id];

function remember(id, name) {
  names[id] = name;
  const ids = Object.keys(names).sort();
  for (const old of ids.slice(0, Math.max(0, ids.length - NAMES_MAX))) delete names[old];
  localStorage.setItem("names", JSON.stringify(names));
}

const STATES = { waiting: "waiting", sending: "uploading", there: "" };

function state(scan) {
  if (scan.trouble) return scan.trouble;
  if (scan.state === "sending") return scan.progress < 1 ? `uploading, ${Math.floor(100 * scan.progress)} %` : "the server is reading it…";
  if (scan.state === "there" && bench.query?.id === scan.started.id) return bench.query.ended ? "" : "comparing…";
  return STATES[scan.state] ?? "";
}

export function draw() {
  const items = scans.map((scan) => {
    const item = make("li");
    const current = scan === shown || (scan.started && bench.query?.id === scan.started.id);
    const button = make("button", undefined, { type: "button", className: "scan" });
    if (current) button.setAttribute("aria-current", "true");
    button.append(make("span", scan.name));
    const told = state(scan);
    if (told) button.append(make("small", told, { className: scan.trouble ? "bad" : "" }));
    button.onclick = () => show(scan);
    const shut = make("button", "×", { type: "button", className: "plain small", ariaLabel: `Close ${scan.name}` });
    shut.onclick = () => forget(scan);
    item.append(button, shut);
    if (scan.state === "sending") item.append(make("progress", undefined, { max: 1, value: scan.progress, ariaLabel: `Uploading ${scan.name}` }));
    return item;
  });
  const focus = [...$("scans").querySelectorAll("button")].indexOf(document.activeElement);
  $("scans").replaceChildren(...items);
  if (focus >= 0) $("scans").querySelectorAll("button")[focus]?.focus();
}

async function show(scan) {
  shown = scan;
  if (scan.started) {
    if (bench.query?.id !== scan.started.id) {
      if (scan.file) await open(await json(`/v1/queries/${scan.started.id}`), { mesh: scan.mesh, name: scan.name, made: scan.made });
      else await openById(scan.started.id, {}, scan.name);
    }
  } else if (scan.trouble && scan.state !== "stuck") refused(scan);
  else preview(scan.mesh, scan.name);
  draw();
}

export function add(files) {
  const fresh = [...files].map((file) => ({ file, name: file.name, mesh: null, state: "waiting", progress: 0, trouble: formatOf(file.name) ? "" : "not a mesh that is read here: OBJ, PLY, STL, OFF or GLB" }));
  scans.unshift(...fresh);
  const first = fresh.find((scan) => !scan.trouble);
  shown = first ?? shown;
  draw();
  if (!first) { say(`${fresh[0].name}: ${fresh[0].trouble}.`, "bad"); return; }
  run();
}

async function run() {
  if (running) return;
  running = true;
  for (;;) {
    // Oldest first, though the newest stand above.
    const scan = scans.filter((s) => s.state === "waiting" && !s.trouble).at(shown?.state === "waiting" ? scans.filter((s) => s.state === "waiting" && !s.trouble).indexOf(shown) : -1);
    if (!scan) break;
    await send(scan);
  }
  running = false;
}

async function send(scan) {
  scan.state = "sending";
  if (!scan.mesh && scan.file.size <= READ_BYTES_MAX) scan.mesh = readMesh(await scan.file.arrayBuffer(), scan.name);
  if (scan === shown) preview(scan.mesh, scan.name);
  draw();
  const parameters = new URLSearchParams({ format: formatOf(scan.name), top: $("top").value, resolution: $("resolution").value });
  const parts = scan.cut ?? $("parts").value;
  if (scan.like) parameters.set("like", scan.like.example);
  else if (parts && !scan.form) parameters.set("parts", parts);
  if ($("tag").value.trim()) parameters.set("tag", $("tag").value.trim());
  try {
    const { answer } = await upload(`/v1/queries?${parameters}`, scan.form ?? scan.file, (progress) => { scan.progress = progress; draw(); });
    Object.assign(scan, { started: answer, state: "there" });
    remember(answer.id, scan.name);
    draw();
    if (scan === shown) await open(answer, { mesh: scan.mesh, name: scan.name, made: scan.made, like: scan.like });
    if (scan === shown && parts && answer.segments.length === 1) say("No limbs were found to cut it at. Ask for a number of parts under “How to search”.");
  } catch (error) {
    // What could not be sent is sent again when the server is back.
    if (error.code === "unreachable") { scan.state = "stuck"; scan.trouble = "waits for the server"; } else Object.assign(scan, { state: "failed", trouble: error.message });
    if (scan === shown && error.code !== "unreachable") refused(scan);
  }
  draw();
}

// What is no mesh has no picture: the reason stands where that would be.
function refused(scan) {
  close();
  $("trouble").textContent = `${scan.name}: ${scan.trouble}`;
  say(`${scan.name} was refused.`, "bad");
}

export function resume() {
  for (const scan of scans.filter((s) => s.state === "stuck")) Object.assign(scan, { state: "waiting", trouble: "" });
  draw();
  run();
}

// The same scan again, cut into parts; or, with `like`, as that example is cut.
bench.cut = async (query, like = null) => {
  const scan = scans.find((s) => s.started?.id === query.id);
  let file = scan?.file;
  if (!file) file = new File([await buffer(`/v1/queries/${query.id}/mesh?format=ply`)], `${query.name.replace(/\.[^.]*$/, "")}.ply`);
  const again = { file, name: file.name.replace(/(\.[^.]*)$/, ` ${like ? `cut as ${like.name}` : "in parts"}$1`), mesh: scan?.mesh ?? null, state: "waiting", progress: 0, cut: "auto", like, trouble: "" };
  scans.unshift(again);
  shown = again;
  run();
};

// The same scan, which the server has cut; `wanted`: the map or composition to show.
bench.goOn = async (query, id, wanted) => {
  const name = query.name.replace(/(\.[^.]*)?$/, " in parts$1");
  remember(id, name);
  shown = { file: null, name, state: "there", started: await json(`/v1/queries/${id}`), progress: 1, trouble: "" };
  scans.unshift(shown);
  draw();
  await openById(id, wanted, name);
};

// The same scan again, cut as its faces are labelled: a mesh as PLY, and a number a face, one a line.
bench.cutAs = (query, mesh, labels, made) => {
  const name = `${query.name.replace(/\.[^.]*$/, "").replace(/ in parts$/, "")} in parts.ply`;
  const form = new FormData();
  form.append("mesh", mesh, name);
  form.append("segments", labels);
  const again = { file: new File([mesh], name), form, name, made, mesh: null, state: "waiting", progress: 0, trouble: "" };
  scans.unshift(again);
  shown = again;
  run();
};

// Scans that the server still holds, the newest first.
export async function list() {
  const { items } = await json("/v1/queries?limit=100").catch(() => ({ items: [] }));
  const there = new Set(scans.map((s) => s.started?.id));
  for (const query of items.reverse().slice(0, HELD_SHOWN_MAX)) if (!there.has(query.id)) scans.push({ file: null, name: names[query.id] ?? `${query.counts.faces} faces, ${query.created.slice(11, 16)}`, state: "there", started: query, progress: 1, trouble: "" });
  draw();
}

// Closes a scan: the server stops working on it and lets it go.
async function forget(scan) {
  scans.splice(scans.indexOf(scan), 1);
  if (scan.started) await cancelQuery(scan.started.id).catch(() => {});
  if (scan === shown || (scan.started && bench.query?.id === scan.started.id)) {
    shown = null;
    close();
  }
  draw();
}

// Drops count wherever they land: a browser shows a dropped file in place of the page otherwise. `take(files)` gets them.
export function catchDrops(take, hint) {
  let depth = 0;
  const holdsFiles = (event) => [...event.dataTransfer?.types ?? []].includes("Files");
  const over = (on) => { $("drop-hint").hidden = !on; if (on) $("drop-hint").firstElementChild.textContent = hint(); };
  addEventListener("dragenter", (event) => { event.preventDefault(); if (holdsFiles(event)) { depth++; over(true); } });
  addEventListener("dragover", (event) => { event.preventDefault(); event.dataTransfer.dropEffect = holdsFiles(event) ? "copy" : "none"; });
  addEventListener("dragleave", () => { depth = Math.max(0, depth - 1); if (!depth) over(false); });
  addEventListener("drop", (event) => {
    event.preventDefault();
    depth = 0;
    over(false);
    if (event.dataTransfer.files.length) take(event.dataTransfer.files);
  });
}
