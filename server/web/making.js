// Has the server make a map or a composition, and tells how far it is until it is there.

import { call, json, problemOf, send, sentence } from "/web/call.js";

// For so long (in seconds) the server holds an answer: it comes sooner where what is made is there sooner.
const WAIT_S = 0.4;

const isOpen = ({ state }) => state === "queued" || state === "running";

// Follows what is made under an address until it is there. `tell(text, share)` is told how far it is; whoever ends `signal` has the
// server stop.
export async function attend(address, first, signal, tell) {
  let now = first;
  try {
    while (isOpen(now)) {
      tell(`${sentence(now.stage).replace(/\.$/, "")}…`, now.progress);
      now = await json(`${address}?wait=${WAIT_S}`, { signal });
    }
  } catch (error) {
    if (signal.aborted) call(address, { method: "DELETE" }).catch(() => {});
    throw error;
  }
  if (now.state === "failed") throw problemOf(now.problem?.status ?? 500, now.problem ?? {});
  if (now.state === "cancelled") throw new DOMException("cancelled", "AbortError");
  return now;
}

export async function made(path, body, signal, tell) {
  // Not ended by the signal: what is begun has to be known to be stopped.
  const first = await send(path, body);
  return attend(`${path}/${first.id}`, first, signal, tell);
}
