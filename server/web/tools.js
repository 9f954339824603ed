// The viewport's tools: what is shown, how, and the legend of its colours.

import { $, make } from "/web/call.js";
import { RAMP, angle, areaRatio, distance } from "/web/heat.js";
import { say } from "/web/status.js";

const LAYOUTS = { one: "One", two: "Side by side" };
const SHOWS = { quads: "Quads", over: "Quads on scan", scan: "Scan" };
const TOGGLES = { edges: "Edges", dots: "Poles", flat: "Facets", checker: "UV checker", points: "Points" };
const TIPS = { edges: "The true edges of the faces", dots: "Extraordinary vertices: inner ones with another number of edges than four", flat: "Each face as flat as it is", checker: "A checker by the example's UVs", points: "The points that hold the quads" };
const HEATS = { "": "no colours", distance: "distance to the scan", angle: "angles", area: "size against the example" };
const POLES = [["#1a59e6", "≤ 3"], ["#f28005", "5"], ["#9926bf", "≥ 6"]];

let viewer;
let heat = "";
let laid = null; // what heat maps need to know of the map: { kept, ownFaces }

function group(values, option, label) {
  const box = make("span", undefined, { className: "group" });
  box.setAttribute("role", "radiogroup");
  box.ariaLabel = label;
  for (const [value, text] of Object.entries(values)) {
    const button = make("button", text, { type: "button", className: "plain small", id: `${option}-${value}` });
    button.setAttribute("role", "radio");
    button.onclick = () => set({ [option]: value });
    box.append(button);
  }
  // Radios are one stop of Tab; arrows go on among them.
  box.onkeydown = (event) => {
    const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!by) return;
    event.preventDefault();
    const there = [...box.children].filter((b) => !b.disabled);
    const next = there[(there.indexOf(document.activeElement) + by + there.length) % there.length];
    next.focus();
    next.click();
  };
  return box;
}

export function set(options) {
  viewer.set(options);
  draw();
}

// The map that is shown has changed.
export function setLaid(what) {
  laid = what;
  showHeat();
}

function showHeat() {
  const { quads, scan, example } = viewer.meshes;
  let found = null;
  if (heat && quads && scan) {
    if (heat === "distance") found = distance(quads, scan);
    if (heat === "angle") found = angle(quads);
    if (heat === "area") found = areaRatio(quads, example, laid ?? {});
  }
  viewer.setHeat(found?.values ?? null);
  if (found && viewer.options.show !== "quads") viewer.set({ show: "quads" });
  draw(found?.legend);
}

function drawLegend(legend) {
  const box = $("legend");
  const parts = [];
  if (legend) {
    const bar = make("canvas", undefined, { width: 200, height: 10 });
    const paint = bar.getContext("2d");
    const ramp = paint.createLinearGradient(0, 0, 200, 0);
    RAMP.forEach((c, k) => ramp.addColorStop(k / (RAMP.length - 1), `rgb(${c.map((x) => Math.round(255 * x)).join(" ")})`));
    paint.fillStyle = ramp;
    paint.fillRect(0, 0, 200, 10);
    bar.ariaHidden = "true";
    const ends = make("div");
    ends.append(make("span", legend.low), make("span", legend.middle ?? ""), make("span", legend.high));
    parts.push(make("strong", legend.title), bar, ends);
  }
  if (viewer.options.dots && viewer.meshes.quads) {
    const line = make("div", "Poles, edges:");
    for (const [colour, text] of POLES) {
      const chip = make("span", undefined, { className: "chip" });
      const dot = make("span", undefined, { className: "dot" });
      dot.style.background = colour;
      chip.append(dot, text);
      line.append(chip);
    }
    parts.push(line);
  }
  box.hidden = parts.length === 0;
  box.replaceChildren(...parts);
}

let legendNow = null;

export function draw(legend) {
  if (legend !== undefined) legendNow = legend;
  if (!heat) legendNow = null;
  const { meshes, options } = viewer;
  $("tools").hidden = !meshes.scan;
  for (const [option, values] of [["layout", LAYOUTS], ["show", SHOWS]]) {
    for (const value of Object.keys(values)) {
      const button = $(`${option}-${value}`);
      const on = options[option] === value;
      button.setAttribute("aria-checked", String(on));
      button.tabIndex = on ? 0 : -1;
      button.disabled = (value === "two" && !meshes.example) || (option === "show" && value !== "scan" && !meshes.quads);
    }
  }
  for (const option of Object.keys(TOGGLES)) $(`toggle-${option}`).ariaPressed = String(options[option] !== false && Boolean(options[option] ?? option === "points"));
  $("toggle-checker").hidden = !meshes.quads?.uvs && !meshes.example?.uvs;
  for (const id of ["toggle-dots", "toggle-points", "toggle-edges"]) $(id).hidden = !meshes.quads && !meshes.example;
  $("heat-label").hidden = !meshes.quads;
  drawLegend(legendNow);
  drawCaptions();
}

let names = { example: "", result: "" };

export function setNames(more) {
  names = { ...names, ...more };
  drawCaptions();
}

function drawCaptions() {
  const boxes = viewer.paneBoxes();
  const shown = [];
  for (const box of boxes) {
    const label = make("span", names[box.name] || (box.name === "example" ? "Example" : ""));
    label.style.left = `${box.left + 10}px`;
    label.style.top = `${box.top + 8}px`;
    if (label.textContent) shown.push(label);
    if (viewer.picks === box.name) {
      const cross = make("span", "+", { className: "cross" });
      cross.style.left = `${box.left + box.width / 2}px`;
      cross.style.top = `${box.top + box.height / 2}px`;
      shown.push(cross);
    }
  }
  if (boxes.length === 2) {
    const line = make("i");
    const below = boxes[1].top > 0;
    Object.assign(line.style, below ? { left: 0, right: 0, top: `${boxes[1].top}px`, height: "1px" } : { top: 0, bottom: 0, left: `${boxes[1].left}px`, width: "1px" });
    shown.push(line);
  }
  $("captions").replaceChildren(...shown);
}

export function begin(of) {
  viewer = of;
  const tools = $("tools");
  tools.append(group(LAYOUTS, "layout", "Panes"), group(SHOWS, "show", "What is shown"));
  const toggles = make("span", undefined, { className: "row" });
  for (const [option, text] of Object.entries(TOGGLES)) {
    const button = make("button", text, { type: "button", className: "plain small", id: `toggle-${option}`, title: TIPS[option] });
    button.onclick = () => {
      const on = option === "points" ? viewer.options.points === false : !viewer.options[option];
      if (option === "checker" && on) { heat = ""; $("heat").value = ""; viewer.setHeat(null); }
      set({ [option]: on });
    };
    toggles.append(button);
  }
  const label = make("label", "Colours ", { id: "heat-label" });
  const select = make("select", undefined, { id: "heat" });
  select.append(...Object.entries(HEATS).map(([value, text]) => make("option", text, { value })));
  select.onchange = () => {
    heat = select.value;
    if (heat === "distance") say("Measuring the distance to the scan…");
    // The line is drawn before the work begins.
    setTimeout(() => { if (heat) viewer.options.checker = false; showHeat(); if (heat === "distance") say(""); }, 30);
  };
  label.append(select);
  const home = make("button", "Reset view", { type: "button", className: "plain small", title: "Home; 1 front, 3 side, 7 top" });
  home.onclick = () => viewer.camera.view("Home");
  tools.append(toggles, label, home);
  new ResizeObserver(drawCaptions).observe(viewer.canvas);
  draw();
}
