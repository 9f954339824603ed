// Calls on the service.

export const $ = (id) => document.getElementById(id);
export const make = (tag, text, more = {}) => Object.assign(document.createElement(tag), text === undefined ? {} : { textContent: text }, more);

let token = sessionStorage.getItem("token") ?? "";

export function setToken(value) {
  token = value;
  sessionStorage.setItem("token", value);
}

// Every call goes through here: the token, and problems as errors.
export async function call(path, options = {}) {
  const headers = { accept: "application/json", ...(options.headers ?? {}) };
  if (token) headers.authorization = `Bearer ${token}`;
  let response;
  try {
    response = await fetch(path, { ...options, headers });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The server is out of reach. Is it running?");
  }
  if (response.status === 401) $("token-form").hidden = false;
  if (!response.ok) {
    const problem = await response.json().catch(() => ({}));
    throw Object.assign(new Error(sentence(problem.detail ?? `${response.status} ${response.statusText}`)), { code: problem.code });
  }
  return response;
}

export const sentence = (text) => `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;

export const json = async (path, options) => (await call(path, options)).json();

export const send = (path, body, method = "POST") => json(path, { method, body: JSON.stringify(body), headers: { "content-type": "application/json" } });

// Pictures are fetched, not linked: an <img> can't carry a token.
export async function picture(path, alt) {
  const img = make("img", undefined, { alt });
  try {
    const url = URL.createObjectURL(await (await call(path, { headers: { accept: "image/png" } })).blob());
    img.onload = () => URL.revokeObjectURL(url);
    img.src = url;
  } catch { /* a missing picture is no reason to stop */ }
  return img;
}

export async function save(path, name) {
  const url = URL.createObjectURL(await (await call(path, { headers: { accept: "*/*" } })).blob());
  make("a", undefined, { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

export function tell(text, kind = "") {
  $("message").textContent = text;
  $("message").className = kind;
}
