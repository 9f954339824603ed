// Calls on the service.

export const $ = (id) => document.getElementById(id);
export const make = (tag, text, more = {}) => Object.assign(document.createElement(tag), text === undefined ? {} : { textContent: text }, more);

let token = sessionStorage.getItem("token") ?? "";

export function setToken(value) {
  token = value;
  sessionStorage.setItem("token", value);
}

// What the page does when the server asks for a token, and when it is out of reach or back: set by `access.js`.
export const hooks = { unauthorized: () => {}, reached: () => {}, lost: () => {} };

export const sentence = (text) => `${text.charAt(0).toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;

export const problemOf = (status, problem) => Object.assign(new Error(sentence(problem.detail ?? `the server answered with ${status}`)), { code: problem.code, status });

// A query that is not there can be started again if its server is gone, or let it go.
export const canStartAgain = (error) => error.code === "owner_gone" || error.code === "query_expired";

// Every call goes through here: the token, and problems as errors.
export async function call(path, options = {}) {
  const headers = { accept: "application/json", ...(options.headers ?? {}) };
  if (token) headers.authorization = `Bearer ${token}`;
  let response;
  try {
    response = await fetch(path, { ...options, headers });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    hooks.lost();
    throw Object.assign(new Error("The server is out of reach."), { code: "unreachable" });
  }
  hooks.reached();
  if (!response.ok) {
    if (response.status === 401) hooks.unauthorized();
    throw problemOf(response.status, await response.json().catch(() => ({})));
  }
  return response;
}

export const json = async (path, options) => (await call(path, options)).json();

export const send = (path, body, method = "POST", more = {}) => json(path, { ...more, method, body: JSON.stringify(body), headers: { "content-type": "application/json" } });

// Uploads a file and tells how much of it has gone, from 0 to 1: `fetch` can't tell that.
export function upload(path, file, onprogress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    request.setRequestHeader("accept", "application/json");
    // A form tells its own type.
    if (!(file instanceof FormData)) request.setRequestHeader("content-type", "application/octet-stream");
    if (token) request.setRequestHeader("authorization", `Bearer ${token}`);
    request.upload.onprogress = (event) => onprogress(event.lengthComputable ? event.loaded / event.total : 0);
    request.onerror = () => { hooks.lost(); reject(Object.assign(new Error("The server is out of reach."), { code: "unreachable" })); };
    request.onload = () => {
      let answer = {};
      try { answer = JSON.parse(request.responseText); } catch { /* told by its status */ }
      if (request.status < 300) { resolve({ status: request.status, answer }); return; }
      if (request.status === 401) hooks.unauthorized();
      reject(problemOf(request.status, answer));
    };
    request.send(file);
  });
}

// Pictures are fetched, not linked: an <img> can't carry a token.
const pictures = new Map();
const PICTURES_MAX = 2000;

export function picture(path, alt) {
  if (!pictures.has(path)) {
    if (pictures.size > PICTURES_MAX) {
      pictures.forEach((old) => old.then((url) => URL.revokeObjectURL(url)));
      pictures.clear();
    }
    pictures.set(path, call(path, { headers: { accept: "image/png" } }).then((r) => r.blob()).then((blob) => URL.createObjectURL(blob)).catch(() => { pictures.delete(path); return ""; }));
  }
  const img = make("img", undefined, { alt });
  // A missing picture is no reason to stop.
  pictures.get(path).then((url) => { if (url) img.src = url; });
  return img;
}

export async function save(path, name) {
  const url = URL.createObjectURL(await (await call(path, { headers: { accept: "*/*" } })).blob());
  make("a", undefined, { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

export const buffer = async (path) => (await call(path, { headers: { accept: "*/*" } })).arrayBuffer();
