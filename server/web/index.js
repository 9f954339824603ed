// The page: which view is shown, what comes in, and what is there when it is opened.

import { enter, whenBack } from "/web/access.js";
import { chooseSegment, openById } from "/web/bench.js";
import { $, json, make } from "/web/call.js";
import * as corpus from "/web/corpus.js";
import * as files from "/web/files.js";
import * as points from "/web/points.js";
import { route } from "/web/route.js";
import * as samples from "/web/samples.js";
import { bench } from "/web/state.js";
import { say } from "/web/status.js";
import * as tools from "/web/tools.js";
import { Viewer } from "/web/viewer.js";

async function showHealth() {
  const ready = await json("/readyz").catch(() => null);
  $("health").textContent = ready ? `${ready.examples} example${ready.examples === 1 ? "" : "s"}` : "";
  if (!$("no-corpus")) return;
  $("no-corpus").hidden = !ready || ready.examples > 0;
  if (ready?.examples) offerScans().catch(() => {});
}

// Scans to begin with, for who has none at hand.
async function offerScans() {
  const box = $("sample-scans");
  if (box.childElementCount) return;
  const scans = await samples.scans();
  for (const scan of box.childElementCount ? [] : scans) {
    const button = make("button", scan.name.replace(/^scan_/, "").replaceAll("_", " "), { type: "button", className: "plain small" });
    button.onclick = async () => {
      button.disabled = true;
      try { files.add([await samples.fileOf(scan)]); } catch (error) { say(error.message, "bad"); }
      button.disabled = false;
    };
    box.append(button, " ");
  }
  box.hidden = !scans.length;
}

function showView() {
  const at = route();
  const isCorpus = at.view === "corpus";
  $("bench").hidden = isCorpus;
  $("corpus").hidden = !isCorpus;
  for (const [id, on] of [["to-bench", !isCorpus], ["to-corpus", isCorpus]]) {
    if (on) $(id).setAttribute("aria-current", "page");
    else $(id).removeAttribute("aria-current");
  }
  document.title = isCorpus ? "Corpus · Quadmuse" : "Quadmuse";
  if (isCorpus) corpus.show(at.example);
  else if (sees && at.query && bench.query?.id !== at.query) openById(at.query, { map: at.map, composition: at.composition }, files.nameOf(at.query));
}

// Back to where one was on the workbench.
$("to-bench").onclick = (event) => {
  event.preventDefault();
  const { query } = bench;
  const shown = query?.shown;
  history.pushState(null, "", query ? `#${query.id}${shown?.map ? `/map/${shown.map.id}` : shown?.made ? `/composition/${shown.made.id}` : ""}` : location.pathname);
  showView();
};

// Whether meshes can be drawn; the corpus is tended without.
let sees = true;

function takeFiles(list) {
  if (route().view === "corpus") corpus.add(list);
  else if (sees) files.add(list);
}

function beginViewer() {
  try {
    bench.viewer = new Viewer($("canvas"), $("marks"), points.hooks);
  } catch (error) {
    $("welcome").replaceChildren(make("h2", "No picture"), make("p", `This page needs a browser with WebGL 2 (${error.message}). The command quadmuse does all of it without.`));
    return false;
  }
  tools.begin(bench.viewer);
  points.begin($("canvas"));
  return true;
}

async function begin() {
  files.catchDrops(takeFiles, () => (route().view === "corpus" ? "Drop to add to the corpus" : "Drop to find quads for it"));
  for (const [id, take] of [["file", takeFiles], ["example-file", corpus.add]]) {
    $(id).onchange = () => { if ($(id).files.length) take([...$(id).files]); $(id).value = ""; };
  }
  $("segment").onchange = () => chooseSegment(Number($("segment").value));
  sees = beginViewer();
  await enter();
  bench.onchange = files.draw;
  corpus.begin(showHealth);
  whenBack(() => { showHealth(); files.resume(); if (route().view === "corpus") corpus.show(); say("The server is back."); });
  addEventListener("hashchange", showView);
  showHealth();
  if (sees) files.list();
  showView();
}

begin();
