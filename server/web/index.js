// The page: the corpus, an upload, its ranking as it is refined, and the chosen map.
"use strict";

const $ = (id) => document.getElementById(id);
const make = (tag, text, more = {}) => Object.assign(document.createElement(tag), text === undefined ? {} : { textContent: text }, more);

let token = sessionStorage.getItem("token") ?? "";
let query = null; // the query shown: { id, segment, rankings, stop }

// Every call goes through here: the token, and problems as errors.
async function call(path, options = {}) {
  const headers = { accept: "application/json", ...(options.headers ?? {}) };
  if (token) headers.authorization = `Bearer ${token}`;
  const response = await fetch(path, { ...options, headers });
  if (response.status === 401) $("token-label").hidden = false;
  if (!response.ok) {
    const problem = await response.json().catch(() => ({}));
    throw new Error(problem.detail ?? `${response.status} ${response.statusText}`);
  }
  return response;
}

const json = async (path, options) => (await call(path, options)).json();

// Pictures are fetched, not linked: an <img> can't carry a token.
async function picture(path, alt) {
  const img = make("img", undefined, { alt, loading: "lazy" });
  try {
    const url = URL.createObjectURL(await (await call(path, { headers: { accept: "image/png" } })).blob());
    img.onload = () => URL.revokeObjectURL(url);
    img.src = url;
  } catch { /* a missing picture is no reason to stop */ }
  return img;
}

function tell(text, kind = "") {
  $("message").textContent = text;
  $("message").className = kind;
}

async function showHealth() {
  const ready = await json("/readyz").catch(() => null);
  $("health").textContent = ready ? `${ready.examples} examples · ${ready.segments} segments` : "not ready";
}

// ---- corpus

let next = "";

async function showCorpus(from) {
  if (!from) $("corpus").replaceChildren();
  const page = await json(`/v1/examples?limit=24${from ? `&cursor=${encodeURIComponent(from)}` : ""}`);
  if (!from && page.items.length === 0) $("corpus").append(make("p", "Nothing in it yet: add quad meshes.", { className: "soft" }));
  for (const example of page.items) {
    const figure = make("figure", undefined, { title: example.tags.join(", ") });
    const caption = make("figcaption", `${example.name || example.id} · ${example.counts.faces}`);
    figure.append(caption);
    $("corpus").append(figure);
    picture(`/v1/examples/${example.id}/thumbnail.png?size=256`, example.name).then((img) => figure.prepend(img));
  }
  next = page.next ?? "";
  $("more").hidden = !next;
}

// ---- upload

function chosen() {
  const file = $("file").files[0];
  if (!file) { tell("Choose a file first.", "bad"); return null; }
  const format = file.name.split(".").pop().toLowerCase();
  const known = ["obj", "ply", "off", "stl", "glb"].includes(format);
  return { file, parameters: new URLSearchParams(known ? { format } : {}) };
}

async function upload(path, { file, parameters }) {
  return call(`${path}?${parameters}`, { method: "POST", body: file, headers: { "content-type": "application/octet-stream" } });
}

async function ask(event) {
  event.preventDefault();
  const choice = chosen();
  if (!choice) return;
  choice.parameters.set("top", $("top").value);
  choice.parameters.set("resolution", $("resolution").value);
  if ($("tag").value) choice.parameters.set("tag", $("tag").value);
  tell("Uploading…");
  try {
    const started = await (await upload("/v1/queries", choice)).json();
    tell("");
    show(started);
  } catch (error) { tell(error.message, "bad"); }
}

async function add() {
  const choice = chosen();
  if (!choice) return;
  choice.parameters.set("name", choice.file.name.replace(/\.[^.]*$/, ""));
  if ($("tag").value) choice.parameters.set("tag", $("tag").value);
  tell("Uploading…");
  try {
    const response = await upload("/v1/examples", choice);
    const example = await response.json();
    tell(`${example.name}: ${response.status === 201 ? "added" : "was there already"}, ${example.segments.length} segments.`, "good");
    showCorpus();
    showHealth();
  } catch (error) { tell(error.message, "bad"); }
}

// ---- ranking

function show(started) {
  query?.stop.abort();
  query = { id: started.id, segment: 0, rankings: new Map(), stop: new AbortController(), thumbnails: new Map() };
  $("result").hidden = false;
  $("entries").replaceChildren();
  $("map").replaceChildren(make("p", "Choose an entry to lay it on the input.", { className: "soft" }));
  $("segment").replaceChildren(...started.segments.map((s) => make("option", `${s.segment} (${s.topology})`, { value: s.segment })));
  $("segment-label").hidden = started.segments.length < 2;
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
    }
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
}

// Takes an event in; true after the last.
function take(mine, event) {
  if (query !== mine) return true;
  if (event.event === "begin") $("state").textContent = `against ${event.corpus_size} segments, up to ${event.resolution}²`;
  if (event.event === "level") {
    mine.rankings.set(event.segment, event);
    const done = [...mine.rankings.values()].reduce((sum, r) => sum + Math.log2(r.level / 16) / Math.log2(r.resolution / 16), 0);
    $("progress").value = done / Math.max(1, $("segment").options.length);
    if (event.segment === mine.segment) draw(mine);
  }
  if (event.event === "error") { tell(event.problem.detail, "bad"); return false; }
  if (event.event === "end") {
    $("progress").value = 1;
    $("state").textContent = `${event.state} after ${(event.summary.timings.total_ms / 1000).toFixed(2)} s`;
    if (event.summary.problem) tell(event.summary.problem.detail, "bad");
    return true;
  }
  return false;
}

function draw(mine) {
  const ranking = mine.rankings.get(mine.segment);
  if (!ranking) return;
  $("ranking-title").textContent = `Ranking at ${ranking.level}² (${ranking.corpus_size} segments)`;
  $("entries").replaceChildren(...ranking.entries.map((entry) => row(mine, entry)));
}

function row(mine, entry) {
  const tr = make("tr", undefined, { className: entry.state });
  const flip = [entry.flip.u ? "u" : "", entry.flip.v ? "v" : ""].join("") || "–";
  const image = make("td");
  if (!mine.thumbnails.has(entry.example)) mine.thumbnails.set(entry.example, picture(`/v1/examples/${entry.example}/thumbnail.png?size=88`, ""));
  mine.thumbnails.get(entry.example).then((img) => image.append(img.cloneNode()));
  const button = make("button", "Map", { type: "button", className: "plain" });
  button.onclick = () => lay(mine, entry, button);
  const act = make("td");
  act.append(button);
  tr.append(
    make("td", entry.rank, { className: "number" }), image, make("td", entry.name || entry.example),
    make("td", entry.score.toFixed(4), { className: "number" }), make("td", entry.energy.toFixed(4), { className: "number" }),
    make("td", flip), make("td", entry.resolution, { className: "number" }), make("td", entry.state), act,
  );
  if (mine.mapped === entry.example) tr.classList.add("chosen");
  return tr;
}

// ---- map

async function lay(mine, entry, button) {
  button.disabled = true;
  mine.mapped = entry.example;
  $("map").replaceChildren(make("p", `Laying ${entry.name} on the input…`, { className: "soft" }));
  try {
    const body = JSON.stringify({ segment: mine.segment, example: entry.example, example_segment: entry.example_segment });
    const map = await json(`/v1/queries/${mine.id}/maps`, { method: "POST", body, headers: { "content-type": "application/json" } });
    const path = `/v1/queries/${mine.id}/maps/${map.id}`;
    const parts = [await picture(`${path}/preview.png?size=768`, `${entry.name} on the input`)];
    parts.push(make("p", `${map.verdict}: ${map.faces} faces, ${map.folds} folded, angles ±${map.distortion.angle.mean.toFixed(1)}°, ${map.timings.total_ms.toFixed(0)} ms`, { className: map.verdict === "poor" ? "bad" : "good" }));
    parts.push(...map.reasons.map((reason) => make("p", reason, { className: "soft" })));
    const links = make("p", undefined, { className: "row" });
    for (const format of ["obj", "ply", "off", "stl", "glb"]) {
      const link = make("button", `.${format}`, { type: "button", className: "plain" });
      link.onclick = () => save(`${path}/mesh?format=${format}`, `${entry.name || "map"}.${format}`);
      links.append(link);
    }
    $("map").replaceChildren(...parts, links);
    draw(mine);
  } catch (error) {
    $("map").replaceChildren(make("p", error.message, { className: "bad" }));
  } finally { button.disabled = false; }
}

async function save(path, name) {
  try {
    const url = URL.createObjectURL(await (await call(path, { headers: { accept: "*/*" } })).blob());
    make("a", undefined, { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60_000);
  } catch (error) { tell(error.message, "bad"); }
}

// ---- events

$("query-form").onsubmit = ask;
$("add").onclick = add;
$("more").onclick = () => showCorpus(next).catch((error) => tell(error.message, "bad"));
$("segment").onchange = () => { if (query) { query.segment = Number($("segment").value); draw(query); } };
$("token").value = token;
$("token").onchange = () => { token = $("token").value; sessionStorage.setItem("token", token); begin(); };
for (const name of ["dragover", "dragleave", "drop"]) {
  $("drop").addEventListener(name, (event) => {
    event.preventDefault();
    $("drop").classList.toggle("over", name === "dragover");
    if (name === "drop" && event.dataTransfer.files.length) $("file").files = event.dataTransfer.files;
  });
}

function begin() {
  showHealth();
  showCorpus().catch((error) => tell(error.message, "bad"));
}

begin();
