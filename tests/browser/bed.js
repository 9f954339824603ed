// What every test of the page needs: a server of its own, a browser, pages whose mistakes are noted, and pictures of them.

import { spawn, spawnSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";

const root = resolve(import.meta.dirname, "../..");
const target = process.env.CARGO_TARGET_DIR ?? join(root, "target");
const program = process.env.QUADMUSE_SERVER_PROGRAM ?? join(target, "debug/quadmuse-server");
// Modules from outside are installed beside what is built, not into the project: see `tests/run`.
const modules = createRequire(join(process.env.QUADMUSE_MODULES ?? join(target, "browser"), "any.js"));
const { chromium } = modules("playwright-core");
const axe = readFileSync(modules.resolve("axe-core/axe.min.js"), "utf8");
export const out = process.env.QUADMUSE_PICTURES ?? join(target, "page");
mkdirSync(out, { recursive: true });

// The page from the sources in place of that in the program: for work on it without a build.
const web = process.env.QUADMUSE_WEB && resolve(process.env.QUADMUSE_WEB);
const TYPES = { html: "text/html; charset=utf-8", js: "text/javascript; charset=utf-8", css: "text/css; charset=utf-8", svg: "image/svg+xml" };

const PATIENCE_MS = 300_000;

const pause = (ms) => new Promise((done) => { setTimeout(done, ms); });

export async function until(what, is, limit = PATIENCE_MS) {
  const end = Date.now() + limit;
  for (;;) {
    const found = await is();
    if (found) return found;
    if (Date.now() > end) throw new Error(`waited in vain for ${what}`);
    await pause(100);
  }
}

export function check(is, told) {
  if (!is) throw new Error(told);
}

// A folder that is gone at the end.
const folders = [];
export function folder() {
  folders.push(mkdtempSync(join(tmpdir(), "quadmuse-page-")));
  return folders.at(-1);
}

// Servers that a failed test left behind end with the rest.
const running = new Set();

// A port that nobody listens on; `QUADMUSE_PAGE_PORT` names the first of those to take instead.
let next = Number(process.env.QUADMUSE_PAGE_PORT ?? 0);
function freePort() {
  if (next) return Promise.resolve(next++);
  return new Promise((done) => {
    const probe = createServer().listen(0, "127.0.0.1", () => { const { port } = probe.address(); probe.close(() => done(port)); });
  });
}

export class Server {
  static async make() {
    const [server, port] = [new Server(), await freePort()];
    return Object.assign(server, { port, data: folder(), url: `http://127.0.0.1:${port}` });
  }

  async start() {
    running.add(this);
    this.process = spawn(program, ["serve", "--data", this.data, "--listen", `127.0.0.1:${this.port}`], { stdio: "ignore" });
    await until("the server", () => fetch(`${this.url}/readyz`).then((r) => r.ok, () => false));
    return this;
  }

  async stop(signal = "SIGTERM") {
    const ended = new Promise((done) => { this.process.once("exit", done); });
    this.process.kill(signal);
    await ended;
    running.delete(this);
  }

  token(role) {
    const made = spawnSync(program, ["token", "create", "--data", this.data, "--role", role, "--name", "test"], { encoding: "utf8" });
    return /qm_\S+|[A-Za-z0-9_-]{32,}/.exec(made.stdout)?.[0] ?? made.stdout.trim().split(/\s+/).at(-1);
  }
}

// The samples that the program makes, each a folder; they are there once a demo has run.
const kept = process.env.QUADMUSE_PAGE_SAMPLES ?? join(target, "page-samples");
export const samples = { examples: join(kept, "examples"), scans: join(kept, "scans") };

// A server with all samples, rated 3: that of the demo, which also writes them as files, or, where these are there from a
// run before, one that they are sent to.
export async function withSamples() {
  if (!existsSync(samples.scans)) return demo();
  const server = await (await Server.make()).start();
  for (const name of readdirSync(samples.examples).filter((n) => n.endsWith(".obj"))) await addExample(server.url, join(samples.examples, name), "&tag=sample");
  return server;
}

async function demo() {
  mkdirSync(kept, { recursive: true });
  const server = new Server();
  running.add(server);
  server.process = spawn(program, ["demo", "--keep", "--out", kept]);
  let told = "";
  for (const stream of [server.process.stdout, server.process.stderr]) stream.on("data", (text) => { told += text; });
  await until("the demo", () => {
    check(server.process.exitCode === null, `the demo ended: ${told}`);
    server.url = /^(http:\S+) goes on/m.exec(told)?.[1];
    return server.url;
  });
  const ask = async (path, more) => {
    const answer = await fetch(`${server.url}/v1/${path}`, more);
    check(answer.ok, `${path}: ${answer.status} ${await answer.clone().text()}`);
    return answer;
  };
  const all = async (what) => (await (await ask(`${what}?limit=500`)).json()).items;
  for (const { id } of (await all("examples")).filter((e) => !e.template)) await ask(`examples/${id}`, { method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify({ tags: ["sample"], relevance: 3 }) });
  // The page lists what was asked before: it begins without.
  for (const { id } of await all("queries")) await ask(`queries/${id}`, { method: "DELETE" });
  return server;
}

export async function addExample(url, path, parameters = "") {
  const name = path.split("/").at(-1).replace(/\..*$/, "");
  const answer = await fetch(`${url}/v1/examples?name=${name}${parameters}`, { method: "POST", body: readFileSync(path), headers: { "content-type": "application/octet-stream" } });
  check(answer.ok, `${path}: ${answer.status} ${await answer.clone().text()}`);
  return answer.json();
}

const executablePath = process.env.QUADMUSE_BROWSER ?? "/usr/bin/chromium";
const found = executablePath.includes("/") ? executablePath : spawnSync("which", [executablePath], { encoding: "utf8" }).stdout.trim();

// Without a graphics card WebGL is computed, and so is all else: the page itself is put together by the browser's own means,
// which take a third of the time of a computed card.
const SWITCHES = ["--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-compositing", "--disable-gpu-rasterization"];

// `more`: further switches of the browser.
export const launch = (more = []) => chromium.launch({ executablePath: found, args: [...more, ...SWITCHES] });

// A page of its own profile. `page.mistakes`: what its console said, save what a test says it expects.
export async function open(browser, url, { width = 1440, height = 900, dark = false, touch = false, token = "", expected = [] } = {}) {
  const context = await browser.newContext({ viewport: { width, height }, colorScheme: dark ? "dark" : "light", hasTouch: touch, reducedMotion: "no-preference", permissions: ["clipboard-read", "clipboard-write"] });
  // On a loaded machine a state that takes seconds may take minutes: only what never comes fails.
  context.setDefaultTimeout(PATIENCE_MS);
  const page = await context.newPage();
  page.mistakes = [];
  page.expected = expected;
  const note = (text) => { if (!page.expected.some((e) => e.test(text))) page.mistakes.push(text); };
  page.on("console", (message) => { if (["error", "warning"].includes(message.type()) && !/GPU stall|software WebGL|SwiftShader/.test(message.text())) note(message.text()); });
  page.on("pageerror", (error) => note(`${error.message}\n${error.stack}`));
  if (web) await fromDisk(context, url);
  if (token) await page.addInitScript((value) => sessionStorage.setItem("token", value), token);
  await page.goto(url);
  return page;
}

async function fromDisk(context, url) {
  const policy = await fetch(url).then((r) => r.headers.get("content-security-policy"), () => null);
  const serve = (name) => async (route) => {
    const path = join(web, name ?? new URL(route.request().url()).pathname.replace("/web/", ""));
    await route.fulfill({ path, contentType: TYPES[path.split(".").pop()], headers: policy ? { "content-security-policy": policy } : {} });
  };
  await context.route((at) => at.pathname === "/", serve("index.html"));
  await context.route((at) => at.pathname.startsWith("/web/"), serve());
}

// Holds requests back for a while, so that what can be cancelled is not over before.
export const holdBack = (page, pattern, ms = 3000) => page.route(pattern, async (route) => { await pause(ms); await route.continue().catch(() => {}); });

// A picture for people to judge.
export const shoot = (page, name) => page.screenshot({ path: join(out, `${name}.png`) });

// What axe finds against WCAG 2.2 A and AA and its own best practices.
export async function axeFinds(page) {
  await page.evaluate(axe);
  const { violations, passes } = await page.evaluate(() => globalThis.axe.run(document, { resultTypes: ["violations", "passes"] }));
  return { passes: passes.length, violations: violations.map((v) => `${v.id}: ${v.help} (${v.nodes.map((n) => `${n.target.join(" ")}: ${n.any.concat(n.all)[0]?.message ?? ""}`).join("; ")})`) };
}

// Drops files as a person does, on an element or anywhere.
export async function drop(page, files, selector = "body") {
  const items = files.map((path) => ({ name: path.split("/").at(-1), text: readFileSync(path).toString("base64") }));
  const transfer = await page.evaluateHandle((all) => {
    const data = new DataTransfer();
    for (const { name, text } of all) data.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
    return data;
  }, items);
  for (const kind of ["dragenter", "dragover", "drop"]) await page.dispatchEvent(selector, kind, { dataTransfer: transfer });
}

/** Stops a test's own server once nothing on the page asks it any more: what is not answered would be a complaint. */
export async function gone(page, server) {
  await page.goto("about:blank");
  await server.stop();
}

export async function clean() {
  await Promise.all([...running].map((server) => server.stop()));
  folders.forEach((path) => rmSync(path, { recursive: true, force: true }));
}
