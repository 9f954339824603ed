// Who may come in, and whether the server is there.

import { $, hooks, json, setToken } from "/web/call.js";

let waiting = null; // resolves when a token was accepted

// A token is asked for before anything else is shown, and again when one is revoked.
export function askForToken() {
  if (waiting) return waiting.promise;
  waiting = Promise.withResolvers?.() ?? withResolvers();
  $("token-dialog").showModal();
  return waiting.promise;
}

function withResolvers() {
  const made = {};
  made.promise = new Promise((resolve, reject) => Object.assign(made, { resolve, reject }));
  return made;
}

const allowed = () => json("/v1/examples?limit=1").then(() => true, (error) => {
  if (error.status === 401) return false;
  throw error;
});

$("token-form").onsubmit = async (event) => {
  event.preventDefault();
  setToken($("token").value.trim());
  try {
    if (!(await allowed())) { $("token-trouble").textContent = "This token is unknown here, or was revoked."; $("token").select(); return; }
  } catch (error) { $("token-trouble").textContent = error.message; return; }
  $("token-trouble").textContent = "";
  $("token-dialog").close();
  waiting?.resolve();
  waiting = null;
};
// Without a token there is nothing to see behind it.
$("token-dialog").oncancel = (event) => event.preventDefault();

let timer = 0;
const back = new Set();

// Called each time the server is there again.
export const whenBack = (act) => back.add(act);

hooks.unauthorized = () => { askForToken(); };
hooks.lost = () => {
  $("banner").hidden = false;
  $("banner").textContent = "The server is out of reach. The page goes on as soon as it is back.";
  timer ||= setInterval(() => fetch("/healthz").then((r) => { if (r.ok) hooks.reached(); }, () => {}), 2000);
};
hooks.reached = () => {
  if (!timer) return;
  clearInterval(timer);
  timer = 0;
  $("banner").hidden = true;
  back.forEach((act) => act());
};

// Resolves once the page may go on.
export async function enter() {
  for (;;) {
    try {
      if (!(await allowed())) await askForToken();
      return;
    } catch { await new Promise((resolve) => setTimeout(resolve, 2000)); }
  }
}
