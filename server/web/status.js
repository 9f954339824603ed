// The line below the viewport: what happens, for how long it has, and how to stop it.

import { $, make } from "/web/call.js";

let timer = 0;

export function say(text, kind = "") {
  clearInterval(timer);
  $("status").className = kind;
  $("status").textContent = text;
}

// Runs `act(signal, tell)` while the line tells `text` with the seconds that went by. A click on Cancel ends the signal, and
// this in null. `tell(text, share)` says how far it is.
export async function busy(text, act) {
  const stop = new AbortController();
  const begun = performance.now();
  const seconds = make("span", "", { ariaHidden: "true" });
  const cancel = make("button", "Cancel", { type: "button", className: "plain small" });
  cancel.onclick = () => stop.abort();
  const tick = () => { seconds.textContent = ` ${Math.round((performance.now() - begun) / 1000)} s `; };
  clearInterval(timer);
  const mine = setInterval(tick, 1000);
  timer = mine;
  tick();
  $("status").className = "";
  const what = make("span", text);
  const bar = make("progress", undefined, { max: 1, value: 0, hidden: true, ariaLabel: text });
  $("status").replaceChildren(what, seconds, bar, cancel);
  const tell = (now, share) => { what.textContent = now; bar.hidden = false; bar.value = share; };
  try {
    return await act(stop.signal, tell);
  } catch (error) {
    if (error.name !== "AbortError") throw error;
    say("Cancelled.");
    return null;
  } finally {
    clearInterval(mine);
  }
}
