// The ranking as cards that change places while it is refined.

import { $, make, picture } from "/web/call.js";
import { STATES } from "/web/words.js";

// Ids of regular layouts, which have no picture.
const TEMPLATE = /^0+1$/;
const MOVE_MS = 350;
// Cards shown until more are asked for.
const SHOWN_MAX = 12;
let everything = false;

export const key = (entry) => `${entry.example}:${entry.example_segment}`;
export const isTemplate = (entry) => Boolean(entry.template) || TEMPLATE.test(entry.example);
export const nameOf = (entry) => (isTemplate(entry) ? `Regular layout (${entry.template ?? "plain"})` : entry.name || entry.example);

function card(entry, onlay) {
  const item = make("li");
  item.dataset.key = key(entry);
  const button = make("button", undefined, { type: "button" });
  button.append(isTemplate(entry) ? make("span", "▦", { className: "blank", ariaHidden: "true" }) : picture(`/v1/examples/${entry.example}/thumbnail.png?size=136&segment=${entry.example_segment}`, ""), make("span", nameOf(entry), { className: "name" }), make("span", "", { className: "what" }), make("span", "", { className: "place" }));
  button.onclick = () => onlay(item.entry);
  item.append(button);
  return item;
}

function refresh(item, entry, chosen) {
  item.entry = entry;
  item.className = [entry.state, key(entry) === chosen ? "chosen" : ""].join(" ").trim();
  const marks = [
    key(entry) === chosen ? "on the scan" : isTemplate(entry) ? "no artist's" : STATES[entry.state] ?? entry.state,
    entry.flip.u !== entry.flip.v ? "mirrored" : "", entry.similar_to ? `like no. ${entry.similar_to}` : "", entry.example_segment > 0 ? `its part ${entry.example_segment}` : "",
  ];
  item.querySelector(".what").textContent = marks.filter(Boolean).join(" · ");
  item.querySelector(".place").textContent = entry.rank;
  item.querySelector("button").ariaPressed = String(key(entry) === chosen);
}

// Draws the entries; `chosen`: the key of the one that is laid. Cards that are there already keep their element, their
// focus and their picture, and slide to their new place.
export function drawRanking(all, chosen, onlay) {
  const entries = all.length > SHOWN_MAX && !everything ? all.filter((e, k) => k < SHOWN_MAX || key(e) === chosen) : all;
  $("all").hidden = entries.length === all.length;
  $("all").textContent = `Show all ${all.length}`;
  $("all").onclick = () => { everything = true; drawRanking(all, chosen, onlay); };
  const list = $("entries");
  const old = new Map([...list.children].map((item) => [item.dataset.key, { item, top: item.getBoundingClientRect().top }]));
  const focused = list.contains(document.activeElement) ? document.activeElement : null;
  const items = entries.map((entry) => {
    const item = old.get(key(entry))?.item ?? card(entry, onlay);
    refresh(item, entry, chosen);
    return item;
  });
  if (items.length !== list.children.length || items.some((item, k) => item !== list.children[k])) list.replaceChildren(...items);
  if (focused?.isConnected && focused !== document.activeElement) focused.focus({ preventScroll: true });
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
  for (const item of items) {
    const before = old.get(item.dataset.key)?.top;
    const by = before === undefined ? 0 : before - item.getBoundingClientRect().top;
    if (before === undefined) item.animate([{ opacity: 0 }, { opacity: 1 }], MOVE_MS);
    else if (by) item.animate([{ transform: `translateY(${by}px)` }, { transform: "none" }], { duration: MOVE_MS, easing: "ease-out" });
  }
}

// The entries that are laid where nobody chooses, in turn until one fits.
export const inTurn = (entries) => entries.filter((e) => e.turn).sort((a, b) => a.turn - b.turn);
