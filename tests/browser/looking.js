// From a drop to quads, and looking at them.

import { axeFinds, check, drop, holdBack, shoot, until } from "./bed.js";

// Drops a scan and waits until something is laid on it.
export async function laid(page, path, selector) {
  await drop(page, [path], selector);
  await page.waitForSelector("#panel .verdict");
  await page.waitForTimeout(300);
}

// The same for tests of what comes after it, which leave the map as it is: a scan is dropped, ranked and laid for the first of
// them, and the others open its address.
const addresses = new Map();
export async function opened(page, path) {
  const server = new URL(page.url()).origin;
  const key = `${server} ${path}`;
  if (!addresses.has(key)) {
    await laid(page, path);
    await until("the ranking's end", () => page.evaluate(() => document.querySelector("#state").textContent.startsWith("Done")));
    addresses.set(key, page.url());
    return;
  }
  await page.goto(addresses.get(key));
  await page.waitForSelector("#panel .verdict");
  await page.waitForTimeout(300);
}

export async function noComplaints(page, where) {
  // What moves is not judged while it does.
  await page.waitForTimeout(500);
  const { violations } = await axeFinds(page);
  check(violations.length === 0, `axe, ${where}: ${violations.join("\n")}`);
}

const viewer = (page, act, arg) => page.evaluate(`(${act})(document.querySelector("#canvas").viewer, ${JSON.stringify(arg ?? null)})`);

// Whether a pane shows something else than its background.
const colours = (page) => viewer(page, `(v) => {
  v.drawNow();
  const { gl } = v.painter;
  const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
  gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const half = { left: 0, right: 0 };
  for (let k = 0; k < pixels.length; k += 4) if (pixels[k + 3]) half[(k / 4) % gl.drawingBufferWidth < gl.drawingBufferWidth / 2 ? "left" : "right"]++;
  return half;
}`);

export const looking = {
  async "an empty workbench says what to do"({ open }) {
    for (const dark of [false, true]) {
      const page = await open({ dark });
      await page.waitForFunction(() => document.querySelector("#health").textContent.includes("examples"));
      await shoot(page, `welcome${dark ? "-dark" : ""}`);
      await noComplaints(page, "welcome");
    }
  },

  async "a drop beside every box leads to quads by itself, and a reload and a link show them again"({ open, scan }) {
    const page = await open();
    const begun = Date.now();
    await drop(page, [scan("old_man")], "header");
    await page.waitForFunction(() => document.querySelector("#canvas").viewer.meshes.scan);
    const turns = Date.now() - begun;
    await shoot(page, "turns-at-once");
    await page.waitForSelector("#entries li");
    console.log(`     from the drop: turns after ${turns} ms, first card after ${Date.now() - begun} ms`);
    await page.waitForSelector("#panel .verdict");
    console.log(`     from the drop to quads: ${Date.now() - begun} ms`);
    check(new URL(page.url()).pathname === "/", `the drop led to ${page.url()}`);
    await until("the ranking's end", () => page.evaluate(() => document.querySelector("#state").textContent.startsWith("Done")));
    await page.waitForTimeout(400);
    await shoot(page, "laid");
    await noComplaints(page, "laid");
    const shown = await page.textContent("#panel .verdict");
    check(["Good", "Fair", "Poor", "Broken"].includes(shown), shown);
    for (const at of [page, await open({}, page.url())]) {
      if (at === page) await at.reload();
      await at.waitForSelector("#panel .verdict");
      check((await at.textContent("#panel .verdict")) === shown, "another verdict after a reload");
      check((await at.textContent("#entries li.chosen .what")).includes("on the scan"), "no card is marked");
    }
  },

  async "while files hover the window says what a drop does, and an upload tells its percent"({ open, scan }) {
    const page = await open();
    await page.waitForFunction(() => document.querySelector("#health").textContent.includes("examples"));
    const transfer = await page.evaluateHandle(() => { const data = new DataTransfer(); data.items.add(new File(["v 0 0 0"], "a.obj")); return data; });
    await page.dispatchEvent("header", "dragenter", { dataTransfer: transfer });
    check(await page.isVisible("#drop-hint"), "nothing is said");
    await shoot(page, "hovering");
    await page.dispatchEvent("header", "dragleave", { dataTransfer: transfer });
    check(!(await page.isVisible("#drop-hint")), "it is still said");
    const session = await page.context().newCDPSession(page);
    await session.send("Network.enable");
    await session.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: 250_000 });
    await drop(page, [scan("old_man")], "nav");
    await page.waitForFunction(() => /uploading, [1-9]\d? %/.test(document.querySelector("#scans").textContent));
    await page.waitForFunction(() => document.querySelector("#canvas").viewer.meshes.scan);
    await page.waitForTimeout(100);
    await shoot(page, "uploading");
    await noComplaints(page, "uploading");
    await session.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: -1 });
    await page.waitForSelector("#entries li");
  },

  async "panes, layers, colours and the camera"({ open, scan }) {
    const page = await open();
    await opened(page, scan("old_man"));
    await page.click("#layout-two");
    const both = await colours(page);
    check(both.left > 10_000 && both.right > 10_000, `a pane is empty: ${JSON.stringify(both)}`);
    await page.click("#toggle-dots");
    await shoot(page, "side-by-side");
    for (const heat of ["distance", "angle", "area"]) {
      await page.selectOption("#heat", heat);
      await page.waitForFunction(() => document.querySelector("#canvas").viewer.heat);
      await page.waitForTimeout(200);
      const legend = await page.textContent("#legend");
      check(legend.length > 10, "no legend");
      await shoot(page, `heat-${heat}`);
    }
    await noComplaints(page, "heat");
    await page.selectOption("#heat", "");
    await page.waitForTimeout(200);
    await page.click("#show-over");
    await page.waitForTimeout(400);
    await shoot(page, "quads-on-scan");
    await page.click("#show-quads");
    if (await page.isVisible("#toggle-checker")) { await page.click("#toggle-checker"); await page.waitForTimeout(200); await shoot(page, "checker"); await page.click("#toggle-checker"); }
    await page.click("#toggle-flat");
    await page.click("#show-scan");
    await page.waitForTimeout(200);
    await shoot(page, "scan-in-facets");
    await page.click("#toggle-flat");
    // Keys turn, come nearer and begin anew.
    await page.focus("#canvas");
    const state = () => viewer(page, "(v) => JSON.stringify([v.camera.turn, v.camera.zoom])");
    const before = await state();
    await page.keyboard.press("ArrowLeft");
    await page.keyboard.press("+");
    check((await state()) !== before, "keys do nothing");
    await page.keyboard.press("Home");
    check((await state()) === before, "Home does not begin anew");
    // The wheel comes nearer to what lies under the pointer.
    const box = await page.locator("#canvas").boundingBox();
    await page.mouse.move(box.x + 200, box.y + 200);
    await page.mouse.wheel(0, -400);
    check((await viewer(page, "(v) => v.camera.zoom")) > 1.5, "the wheel does not come nearer");
  },

  async "fingers turn with one and pinch with two, on a phone, too"({ open, scan }) {
    const page = await open({ width: 390, height: 844, touch: true });
    await shoot(page, "phone-welcome");
    await opened(page, scan("old_man"));
    await shoot(page, "phone");
    check(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "the page is wider than the phone");
    await noComplaints(page, "phone");
    await page.evaluate(() => scrollTo(0, 0));
    const box = await page.locator("#canvas").boundingBox();
    const session = await page.context().newCDPSession(page);
    const touch = (type, points) => session.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x: box.x + x, y: box.y + y, id })) });
    const before = await viewer(page, "(v) => [v.camera.zoom, v.camera.turn[0]]");
    await touch("touchStart", [[150, 60]]);
    await touch("touchMove", [[220, 60]]);
    await touch("touchEnd", []);
    await touch("touchStart", [[150, 60], [200, 60]]);
    await touch("touchMove", [[100, 60], [250, 60]]);
    await touch("touchEnd", []);
    const after = await viewer(page, "(v) => [v.camera.zoom, v.camera.turn[0]]");
    check(after[1] !== before[1], "one finger does not turn");
    check(after[0] > 1.5 * before[0], `two fingers don't come nearer: ${after[0]}`);
    await page.evaluate(() => scrollTo(0, document.body.scrollHeight));
    await page.waitForTimeout(300);
    await shoot(page, "phone-below");
    const wide = await open({ width: 2560, height: 1300 }, page.url());
    await wide.waitForSelector("#panel .verdict");
    await wide.click("#layout-two");
    await wide.waitForTimeout(300);
    await shoot(wide, "large");
    const tablet = await open({ width: 820, height: 1100, dark: true }, page.url());
    await tablet.waitForSelector("#panel .verdict");
    await tablet.waitForTimeout(500);
    await shoot(tablet, "tablet-dark");
    await noComplaints(tablet, "tablet, dark");
  },

  async "a scan of 200,000 triangles under 10,000 quads is read, turned and measured"({ open }) {
    const page = await open();
    await page.waitForFunction(() => document.querySelector("#canvas").viewer);
    const figures = await page.evaluate(async () => {
      // A bumpy ball of `n` by `n` quads, or twice as many triangles, as the text of an OBJ file.
      const ball = (n, cut) => {
        const lines = [];
        for (let i = 0; i <= n; i++) {
          for (let j = 0; j < n; j++) {
            const [a, b] = [(Math.PI * (i + 0.5)) / (n + 1), (2 * Math.PI * j) / n];
            const r = 1 + 0.05 * Math.sin(7 * b) * Math.sin(5 * a);
            lines.push(`v ${r * Math.sin(a) * Math.cos(b)} ${r * Math.cos(a)} ${-r * Math.sin(a) * Math.sin(b)}`);
          }
        }
        for (let i = 0; i < n; i++) {
          for (let j = 0; j < n; j++) {
            const [p, q] = [i * n + j + 1, i * n + ((j + 1) % n) + 1];
            if (cut) lines.push(`f ${p} ${p + n} ${q + n}`, `f ${p} ${q + n} ${q}`);
            else lines.push(`f ${p} ${p + n} ${q + n} ${q}`);
          }
        }
        return new TextEncoder().encode(lines.join("\n")).buffer;
      };
      const { readMesh } = await import("/web/read.js");
      const { distance } = await import("/web/heat.js");
      const { viewer } = document.querySelector("#canvas");
      const time = (act) => { const begun = performance.now(); const made = act(); return [made, Math.round(performance.now() - begun)]; };
      document.querySelector("#welcome").hidden = true;
      const [text, cage] = [ball(316, true), ball(100, false)];
      const [scan, read] = time(() => readMesh(text, "scan.obj"));
      const [, shown] = time(() => { viewer.setScan(scan); viewer.drawNow(); });
      const quads = readMesh(cage, "quads.obj");
      viewer.setQuads(quads);
      viewer.set({ show: "over" });
      const [, drape] = time(() => viewer.drawNow());
      const over = viewer.measure(30);
      viewer.set({ show: "quads" });
      const alone = viewer.measure(30);
      const [, heat] = time(() => distance(quads, scan));
      viewer.set({ show: "over" });
      return { triangles: scan.starts.length - 1, quads: quads.starts.length - 1, megabytes: text.byteLength / 1e6, read, shown, drape, over, alone, heat };
    });
    check(figures.triangles > 199_000 && figures.quads === 10_000, JSON.stringify(figures));
    await shoot(page, "large-mesh");
    console.log(`     ${figures.triangles} triangles (OBJ of ${figures.megabytes.toFixed(1)} MB) read in ${figures.read} ms, shown in ${figures.shown} ms; a frame with ${figures.quads} quads on it ${figures.over.toFixed(1)} ms, the quads alone ${figures.alone.toFixed(1)} ms; edges laid on the scan in ${figures.drape} ms, distances in ${figures.heat} ms`);
  },

  async "a lost picture comes back, and many examples may be looked at"({ open, scan, url }) {
    const page = await open({ expected: [/context/i] });
    await opened(page, scan("arm"));
    await viewer(page, `async (v) => {
      const lost = v.painter.gl.getExtension("WEBGL_lose_context");
      lost.loseContext();
      await new Promise((done) => setTimeout(done, 300));
      const restored = new Promise((done) => v.canvas.addEventListener("webglcontextrestored", done, { once: true }));
      lost.restoreContext();
      await restored;
    }`);
    await page.waitForTimeout(300);
    const shown = await colours(page);
    check(shown.left + shown.right > 10_000, "nothing is drawn after the context was lost");
    await page.goto(`${url}/#corpus`);
    await page.waitForSelector("#grid li");
    for (let k = 0; k < 18; k++) {
      await page.locator("#grid li button").nth(k).click();
      await page.waitForSelector("#example-dialog[open]");
      await page.keyboard.press("Escape");
      await page.waitForSelector("#example-dialog[open]", { state: "detached" });
    }
    await page.click("#to-bench");
    await page.waitForTimeout(300);
    const still = await colours(page);
    check(still.left + still.right > 10_000, "the workbench lost its picture to the examples");
  },

  async "several files wait in a queue, and another example is a click away"({ open, scan }) {
    const page = await open();
    await drop(page, [scan("arm"), scan("fish"), scan("old_man")], "#rail");
    await page.waitForTimeout(200);
    await shoot(page, "queue");
    await page.waitForSelector("#panel .verdict");
    await until("all three", () => page.evaluate(() => [...document.querySelectorAll("#scans small")].every((s) => !/waiting|uploading/.test(s.textContent))));
    check((await page.locator("#scans button.scan").count()) >= 3, "a file is missing");
    await until("a rest", () => page.evaluate(() => !document.querySelector("#status button")));
    const before = page.url();
    await page.locator("#entries li:not(.chosen) button").first().click();
    await until("another map", () => page.url() !== before && page.url().includes("/map/"));
    await page.waitForSelector("#entries li.chosen");
    check((await page.locator("#entries li.chosen").count()) === 1, "not one card is chosen");
    // Laying can be stopped.
    await holdBack(page, "**/maps");
    await page.locator("#entries li:not(.chosen) button").first().click();
    await page.click("#status button");
    await page.waitForFunction(() => document.querySelector("#status").textContent === "Cancelled.");
    await page.locator("#scans button.scan", { hasText: "scan_fish" }).first().click();
    await page.waitForFunction(() => document.querySelector('#scans [aria-current]')?.textContent.includes("fish"));
  },
};
