// The page: the corpus, an upload, its ranking as it is refined, and what is chosen of it.

import { $, call, json, make, picture, send, sentence, setToken, tell } from "/web/call.js";
import { say, showComposition, showMap } from "/web/stage.js";

// Ids of regular layouts, which have no picture.
const TEMPLATE = /^0+1$/;
const STATES = { refining: "being refined", locked: "passed over", done: "refined" };
const ENDS = { done: "Done", cancelled: "Cancelled", failed: "Failed", deadline: "Stopped by its deadline" };

let query = null; // the query shown: { id, segment, segments, rankings, stop, thumbnails, chosen, viewer }

async function showHealth() {
  const ready = await json("/readyz").catch(() => null);
  const count = (n, what) => `${n} ${what}${n === 1 ? "" : "s"}`;
  $("health").textContent = ready ? `${count(ready.examples, "example")} · ${count(ready.segments, "segment")}` : "not ready";
}

// ---- corpus

let next = "";

async function showCorpus(from) {
  const page = await json(`/v1/examples?limit=24${from ? `&cursor=${encodeURIComponent(from)}` : ""}`);
  if (!from) $("corpus").replaceChildren();
  if (!from && page.items.length === 0) $("corpus").append(make("p", "Nothing in it yet. Choose a quad mesh above and add it to the corpus.", { className: "soft" }));
  for (const example of page.items) {
    const name = example.name || example.id;
    const figure = make("figure", undefined, { title: [name, ...example.tags].join(", ") });
    const caption = make("figcaption");
    caption.append(make("span", name), make("small", `${example.counts.faces} faces`));
    figure.append(make("div", undefined, { className: "blank" }), caption);
    $("corpus").append(figure);
    picture(`/v1/examples/${example.id}/thumbnail.png?size=256`, name).then((img) => figure.firstChild.replaceWith(img));
  }
  next = page.next ?? "";
  $("more").hidden = !next;
}

// ---- upload

function chosen() {
  const file = $("file").files[0];
  if (!file) { tell("Choose a file first.", "bad"); $("file").focus(); return null; }
  const format = file.name.split(".").pop().toLowerCase();
  const known = ["obj", "ply", "off", "stl", "glb"].includes(format);
  const parameters = new URLSearchParams(known ? { format } : {});
  if ($("parts").value) parameters.set("parts", $("parts").value);
  if ($("tag").value.trim()) parameters.set("tag", $("tag").value.trim());
  return { file, parameters };
}

// Uploads, with the form at rest meanwhile; `take` gets the answer.
async function upload(path, { file, parameters }, take) {
  const buttons = $("query-form").querySelectorAll("button");
  buttons.forEach((button) => { button.disabled = true; });
  tell(`Uploading ${file.name}…`);
  try {
    await take(await call(`${path}?${parameters}`, { method: "POST", body: file, headers: { "content-type": "application/octet-stream" } }));
  } catch (error) {
    tell(error.message, "bad");
  } finally {
    buttons.forEach((button) => { button.disabled = false; });
  }
}

function ask(event) {
  event.preventDefault();
  const choice = chosen();
  if (!choice) return;
  choice.parameters.set("top", $("top").value);
  choice.parameters.set("resolution", $("resolution").value);
  upload("/v1/queries", choice, async (response) => {
    const started = await response.json();
    tell("");
    history.replaceState(null, "", `#${started.id}`);
    show(started);
  });
}

// The same file again, cut into parts.
function askInParts() {
  $("parts").value = "auto";
  $("query-form").requestSubmit();
}

function add() {
  const choice = chosen();
  if (!choice) return;
  choice.parameters.set("name", choice.file.name.replace(/\.[^.]*$/, ""));
  upload("/v1/examples", choice, async (response) => {
    const example = await response.json();
    const parts = example.segments.filter((s) => s.is_part).length;
    const whole = parts || example.segments.length === 1 ? `a ${example.segments[0].topology}` : `${example.segments.length} segments`;
    const segments = parts ? `${whole} and ${parts} parts of it` : whole;
    tell(`${example.name}: ${response.status === 201 ? "added" : "was there already"} (${segments}, ${example.counts.faces} faces).`, "good");
    showCorpus();
    showHealth();
  });
}

// ---- ranking

function show(started) {
  query?.stop.abort();
  query = { id: started.id, segment: 0, segments: started.segments, rankings: new Map(), stop: new AbortController(), thumbnails: new Map(), chosen: new Map(), cut: askInParts };
  $("result").hidden = false;
  $("entries").replaceChildren();
  $("repairs").replaceChildren(...started.repairs.map((repair) => make("li", sentence(repair))));
  $("progress").value = 0;
  $("state").textContent = "Unfolding the mesh…";
  say("Choose an example to lay its quads on your mesh.");
  $("segment").replaceChildren(...started.segments.map((s) => make("option", `segment ${s.segment} (${s.topology}, ${s.faces} faces)`, { value: s.segment })));
  $("segment-row").hidden = started.segments.length < 2;
  $("result").focus({ preventScroll: true });
  $("result").scrollIntoView({ behavior: "smooth" });
  follow(query);
}

// Server-sent events, read by hand so that the request can carry a token.
async function follow(mine) {
  let last = null;
  while (query === mine) {
    try {
      const headers = { accept: "text/event-stream", ...(last === null ? {} : { "last-event-id": last }) };
      const response = await call(`/v1/queries/${mine.id}/stream?limit=50`, { headers, signal: mine.stop.signal });
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        const frames = text.split("\n\n");
        text = frames.pop();
        for (const frame of frames) {
          const field = (name) => frame.split("\n").find((line) => line.startsWith(`${name}: `))?.slice(name.length + 2);
          last = field("id") ?? last;
          if (field("data") && take(mine, JSON.parse(field("data")))) return;
        }
      }
    } catch (error) {
      if (mine.stop.signal.aborted) return;
      tell(error.message, "bad");
      if (error.code === "not_found") return;
    }
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
}

// Takes an event in; true after the last.
function take(mine, event) {
  if (query !== mine) return true;
  if (event.event === "begin") $("state").textContent = `Comparing with ${event.corpus_size} segments of the corpus…`;
  if (event.event === "level") {
    mine.rankings.set(event.segment, event);
    const done = [...mine.rankings.values()].reduce((sum, r) => sum + Math.log2(r.level / 16) / Math.log2(r.resolution / 16), 0);
    $("progress").value = done / Math.max(1, mine.segments.length);
    if (event.segment === mine.segment) draw(mine);
  }
  if (event.event === "error") { tell(sentence(event.problem.detail), "bad"); return false; }
  if (event.event === "end") {
    $("progress").value = 1;
    $("state").textContent = `${ENDS[event.state]} after ${(event.summary.timings.total_ms / 1000).toFixed(1)} s`;
    if (event.summary.problem) tell(sentence(event.summary.problem.detail), "bad");
    return true;
  }
  return false;
}

function draw(mine) {
  const ranking = mine.rankings.get(mine.segment);
  if (!ranking) return;
  $("ranking-title").textContent = `Best of ${ranking.corpus_size} examples, compared at ${ranking.level} × ${ranking.level} pixels`;
  const focused = $("entries").contains(document.activeElement) ? document.activeElement.dataset.key : null;
  $("entries").replaceChildren(...ranking.entries.map((entry) => row(mine, entry)));
  if (focused) $("entries").querySelector(`[data-key="${focused}"]`)?.focus();
}

const key = (entry) => `${entry.example}:${entry.example_segment}`;

function row(mine, entry) {
  const name = entry.name || entry.example;
  const tr = make("tr", undefined, { className: entry.state });
  const image = make("td");
  if (!TEMPLATE.test(entry.example)) {
    if (!mine.thumbnails.has(key(entry))) mine.thumbnails.set(key(entry), picture(`/v1/examples/${entry.example}/thumbnail.png?size=88`, ""));
    mine.thumbnails.get(key(entry)).then((img) => image.append(img));
  }
  const marks = [entry.flip.u !== entry.flip.v ? "mirrored" : "", entry.similar_to ? `like no. ${entry.similar_to}` : "", entry.template ? "regular layout" : ""].filter(Boolean);
  const title = make("td", name, { className: "name", title: name });
  if (marks.length) title.append(make("small", marks.join(", ")));
  const button = make("button", "Lay on", { type: "button", className: "plain", ariaLabel: `Lay ${name} on the mesh` });
  button.dataset.key = key(entry);
  button.onclick = () => lay(mine, entry, button);
  const act = make("td");
  act.append(button);
  tr.append(make("td", entry.rank, { className: "number" }), image, title, make("td", entry.template ? "" : entry.score.toFixed(3), { className: "number" }), make("td", entry.template ? "" : STATES[entry.state] ?? entry.state), act);
  if (mine.chosen.get(mine.segment)?.key === key(entry)) tr.classList.add("chosen");
  return tr;
}

// ---- maps and compositions

async function lay(mine, entry, button) {
  const name = entry.name || entry.example;
  const segment = mine.segment;
  button.disabled = true;
  say(`Laying ${name} on the input…`);
  try {
    const map = await send(`/v1/queries/${mine.id}/maps`, { segment, example: entry.example, example_segment: entry.example_segment });
    if (query !== mine) return;
    mine.chosen.set(segment, { key: key(entry), map: map.id });
    draw(mine);
    await showMap(mine, map, name);
  } catch (error) {
    say(error.message, "bad");
  } finally { button.disabled = false; }
}

async function stitch() {
  const mine = query;
  $("compose").disabled = true;
  say("Laying the best example on each part that you have chosen none for, and stitching them. This may take a minute…");
  try {
    const parts = [...mine.chosen].map(([segment, { map }]) => ({ segment, map }));
    // Who chose a part wants its layout.
    const keep = parts.map((part) => part.segment);
    const made = await send(`/v1/queries/${mine.id}/compositions`, { parts, keep, density: Number($("density").value) });
    if (query === mine) await showComposition(mine, made);
  } catch (error) {
    say(error.message, "bad");
  } finally { $("compose").disabled = false; }
}

// ---- events

$("query-form").onsubmit = ask;
$("add").onclick = add;
$("compose").onclick = stitch;
$("more").onclick = () => showCorpus(next).catch((error) => tell(error.message, "bad"));
$("segment").onchange = () => { if (query) { query.segment = Number($("segment").value); draw(query); } };
$("token-form").onsubmit = (event) => { event.preventDefault(); setToken($("token").value); tell(""); begin(); };
for (const name of ["dragover", "dragleave", "drop"]) {
  $("drop").addEventListener(name, (event) => {
    event.preventDefault();
    $("drop").classList.toggle("over", name === "dragover");
    if (name === "drop" && event.dataTransfer.files.length) $("file").files = event.dataTransfer.files;
  });
}

// The query named behind the `#` of the address is shown again after a reload.
async function begin() {
  showHealth();
  showCorpus().catch((error) => tell(error.message, "bad"));
  const id = location.hash.slice(1);
  if (/^[0-9A-Z]{26}$/.test(id) && query?.id !== id) await json(`/v1/queries/${id}`).then(show, () => history.replaceState(null, "", "/"));
}

begin();
