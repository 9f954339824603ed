// The corpus: found by name, tag and surface, added to, and looked at.

import { $, call, json, make, picture, send, sentence, upload } from "/web/call.js";
import { showExample } from "/web/example.js";
import { formatOf } from "/web/files.js";
import { forgetFacts } from "/web/laying.js";
import * as samples from "/web/samples.js";
import { SURFACES } from "/web/words.js";

const PAGE = 500;
const UNDO_MS = 8000;
// So many are added until the grid is drawn anew.
const SHOWN_EVERY = 4;

let examples = [];
let loaded = false;
let onchange = () => {};

export const begin = (changed) => { onchange = changed; };

async function load() {
  const all = [];
  let next = "";
  do {
    const page = await json(`/v1/examples?limit=${PAGE}${next ? `&cursor=${encodeURIComponent(next)}` : ""}`);
    all.push(...page.items.filter((e) => !e.template));
    next = page.next ?? "";
  } while (next);
  examples = all;
  loaded = true;
}

export async function show(id) {
  try {
    await load();
  } catch (error) { $("corpus-state").textContent = error.message; return; }
  draw();
  if (id) openExample(id);
}

const RATED = { "": () => true, low: (r) => r < 3, 3: (r) => r >= 3, 4: (r) => r >= 4, 5: (r) => r >= 5 };
const ORDERS = { "": () => 0, name: (a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }), rating: (a, b) => b.relevance - a.relevance, faces: (a, b) => a.counts.faces - b.counts.faces };

function wanted(example) {
  const words = $("search").value.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const text = [example.name, example.id, ...example.tags, example.author, example.licence, example.notes].join(" ").toLowerCase();
  const [tag, topology] = [$("filter-tag").value, $("filter-topology").value];
  return words.every((w) => text.includes(w)) && (!tag || example.tags.includes(tag)) && RATED[$("filter-rating").value](example.relevance) && (!topology || example.segments.some((s) => !s.is_part && s.topology === topology));
}

const share = ({ faces, quads }) => Math.round((100 * quads) / Math.max(1, faces));

function tile(example) {
  const item = make("li");
  const button = make("button", undefined, { type: "button" });
  button.dataset.id = example.id;
  const name = example.name || example.id;
  const text = make("span", undefined, { className: "text" });
  const surface = SURFACES[example.segments[0]?.topology] ?? "";
  const quads = share(example.counts);
  text.append(make("span", name), make("small", [`${example.counts.faces} faces`, surface, quads < 95 ? `${quads} % quads` : "", example.relevance === 3 ? "" : `rated ${example.relevance}`].filter(Boolean).join(" · ")));
  if (example.tags.length) text.append(make("small", example.tags.join(", ")));
  button.append(picture(`/v1/examples/${example.id}/thumbnail.png?size=256`, ""), text);
  button.onclick = () => openExample(example.id);
  item.append(button);
  return item;
}

export function draw() {
  const tags = [...new Set(examples.flatMap((e) => e.tags))].sort();
  const tag = $("filter-tag").value;
  $("filter-tag").replaceChildren(make("option", "any", { value: "" }), ...tags.map((t) => make("option", t, { value: t })));
  $("filter-tag").value = tags.includes(tag) ? tag : "";
  const found = examples.filter(wanted).sort(ORDERS[$("order").value]);
  const focused = document.activeElement?.dataset?.id;
  $("grid").replaceChildren(...found.map(tile));
  if (focused) $("grid").querySelector(`[data-id="${focused}"]`)?.focus();
  const state = $("corpus-state");
  const isEmpty = loaded && examples.length === 0;
  $("empty").hidden = !isEmpty;
  $("filters").classList.toggle("empty", isEmpty);
  state.textContent = isEmpty ? "" : found.length === examples.length ? `${examples.length} examples` : `${found.length} of ${examples.length} examples`;
}

// ---- one of them

function openExample(id) {
  const at = examples.findIndex((e) => e.id === id);
  if (at < 0) { $("corpus-state").textContent = "This example is not in the corpus (any more)."; return; }
  showExample(examples[at], {
    async change(patch) {
      examples[at] = await send(`/v1/examples/${id}`, patch, "PATCH");
      forgetFacts(id);
      draw();
      return examples[at];
    },
    remove: () => remove(id),
    closed: () => { if (location.hash.startsWith("#corpus/")) history.replaceState(null, "", "#corpus"); $("grid").querySelector(`[data-id="${id}"]`)?.focus(); },
  });
}

// An example goes at once from view, and from the server when nobody took it back: it can't be made anew with its id.
function remove(id) {
  const gone = examples.find((e) => e.id === id);
  const place = examples.indexOf(gone);
  examples.splice(place, 1);
  draw();
  const toast = make("div", undefined, { className: "toast" });
  toast.setAttribute("role", "status");
  const undo = make("button", "Undo", { type: "button" });
  const now = () => { clearTimeout(timer); removeEventListener("pagehide", now); toast.remove(); call(`/v1/examples/${id}`, { method: "DELETE", keepalive: true }).then(onchange, (error) => { $("corpus-state").textContent = error.message; show(); }); };
  const timer = setTimeout(now, UNDO_MS);
  addEventListener("pagehide", now);
  undo.onclick = () => { clearTimeout(timer); removeEventListener("pagehide", now); toast.remove(); examples.splice(place, 0, gone); draw(); };
  toast.append(make("span", `${gone.name || "The example"} is removed.`), undo);
  document.querySelector(".toast")?.remove();
  document.body.append(toast);
  undo.focus();
}

// ---- adding

const queue = [];
let running = false;

const tagsGiven = () => $("new-tags").value.split(",").map((t) => t.trim()).filter(Boolean);

// `get`: gives the file of one that is not here yet.
function enqueue(all) {
  for (const { name, get, tags, relevance } of all) {
    const item = make("li");
    const stem = name.replace(/\.[^.]*$/, "");
    const bar = make("progress", undefined, { max: 1, value: 0, ariaLabel: `Uploading ${name}` });
    const told = make("span", "waiting", { className: "soft" });
    item.append(make("strong", stem), bar, told);
    $("uploads").prepend(item);
    queue.push({ name, get, tags, relevance, stem, bar, told, item });
  }
  run();
}

export const add = (files) => enqueue([...files].map((file) => ({ name: file.name, get: () => file, tags: tagsGiven() })));

// The samples, into a corpus that is empty.
export async function addSamples() {
  const button = $("add-samples");
  button.disabled = true;
  $("empty").hidden = true;
  $("corpus-state").textContent = "The server makes the samples…";
  try {
    const all = await samples.examples();
    enqueue(all.map((sample) => ({ name: `${sample.name}.obj`, get: () => samples.fileOf(sample), tags: [...sample.tags, "sample"], relevance: sample.relevance })));
  } catch (error) {
    $("corpus-state").textContent = error.message;
    $("empty").hidden = false;
  }
  button.disabled = false;
}

async function run() {
  if (running) return;
  running = true;
  let done = 0;
  while (queue.length) {
    const left = queue.length;
    $("corpus-state").textContent = left + done > 1 ? `Adding ${done + 1} of ${done + left}…` : "";
    await send1(queue.shift());
    done += 1;
    // What is there is seen, also while many are added.
    if (done % SHOWN_EVERY === 0 && queue.length) await load().then(draw, () => {});
  }
  running = false;
  await show();
  onchange();
}

async function send1({ name, get, tags, relevance, stem, bar, told, item }) {
  const format = formatOf(name);
  if (!format) { bar.remove(); Object.assign(told, { className: "bad", textContent: "not a mesh that is read here: OBJ, PLY, STL, OFF or GLB" }); return; }
  const parameters = new URLSearchParams({ name: stem, format });
  for (const tag of tags) parameters.append("tag", tag);
  if (relevance !== undefined) parameters.set("relevance", relevance);
  try {
    const { status, answer } = await upload(`/v1/examples?${parameters}`, await get(), (part) => { bar.value = part; told.textContent = part < 1 ? `${Math.floor(100 * part)} %` : "being read and encoded…"; });
    const parts = answer.segments.filter((s) => s.is_part).length;
    const facts = [status === 201 ? "added" : "was there already", `${answer.counts.faces} faces`, SURFACES[answer.segments[0]?.topology] ?? "", parts ? `${parts} parts` : ""].filter(Boolean).join(", ");
    Object.assign(told, { className: "good", textContent: facts });
    if (answer.doubts?.length) {
      item.append(make("span", `${answer.doubts.map(sentence).join(" ")} Scans taken as examples spoil rankings.`, { className: "bad" }));
      const out = make("button", "Take it out again", { type: "button", className: "plain small" });
      out.onclick = async () => { await call(`/v1/examples/${answer.id}`, { method: "DELETE" }); item.remove(); await show(); onchange(); };
      if (status === 201) item.append(out);
    }
  } catch (error) {
    Object.assign(told, { className: "bad", textContent: error.message });
  }
  bar.remove();
}

$("add-samples").onclick = addSamples;
for (const id of ["search", "filter-tag", "filter-topology", "filter-rating", "order"]) $(id).addEventListener("input", draw);
$("filters").onsubmit = (event) => event.preventDefault();
