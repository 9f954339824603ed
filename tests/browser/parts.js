// Parts of a scan: cut along lines, painted, joined, named, given examples, and stitched.

import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { addExample, check, drop, folder, holdBack, shoot, until } from "./bed.js";
import { rest, viewer } from "./correcting.js";
import { laid, noComplaints, opened } from "./looking.js";

// A mesh of triangles over a square of so many cells; `closes`: it closes both ways.
function grid(wide, high, closes, place) {
  const [nx, ny] = closes ? [wide, high] : [wide + 1, high + 1];
  const lines = [];
  for (let y = 0; y < ny; y++) for (let x = 0; x < nx; x++) lines.push(`v ${place(x / wide, y / high).join(" ")}`);
  const at = (x, y) => (y % ny) * nx + (x % nx) + 1;
  for (let y = 0; y < high; y++) {
    for (let x = 0; x < wide; x++) lines.push(`f ${at(x, y)} ${at(x + 1, y)} ${at(x + 1, y + 1)}`, `f ${at(x, y)} ${at(x + 1, y + 1)} ${at(x, y + 1)}`);
  }
  return `${lines.join("\n")}\n`;
}

// A stroke of the mouse over the viewport, by shares of its size.
async function stroke(page, points) {
  const box = await page.locator("#canvas").boundingBox();
  const at = ([x, y]) => [box.x + x * box.width, box.y + y * box.height];
  await page.mouse.move(...at(points[0]));
  await page.mouse.down();
  for (const point of points.slice(1)) await page.mouse.move(...at(point), { steps: 12 });
}

async function draw(page, points) {
  await stroke(page, points);
  await page.mouse.up();
  await page.waitForTimeout(150);
}

// What the labels are worth: of each its faces, how many pieces it is in, and how often its border passes a vertex.
const labelled = (page) => page.evaluate(async () => {
  const { beside, edgeKey, endOf, endsOf, pieces, used } = await import("/web/regions.js");
  const { scan } = document.querySelector("#canvas").viewer.meshes;
  const labels = scan.segments;
  const next = beside(scan);
  return used(labels).map((label) => {
    const faces = [...labels.keys()].filter((f) => labels[f] === label);
    const border = new Set();
    for (const f of faces) for (let k = scan.starts[f]; k < scan.starts[f + 1]; k++) if (next[k] >= 0 && labels[next[k]] !== label) border.add(edgeKey(scan.corners[k], endOf(scan, f, k)));
    const passes = new Map();
    for (const key of border) for (const v of endsOf(key)) passes.set(v, (passes.get(v) ?? 0) + 1);
    const at = [...passes.keys()].map((v) => [0, 1, 2].map((k) => scan.positions[3 * v + k]));
    return { label, faces: faces.length, pieces: pieces(scan, faces, (f, g) => labels[g] === labels[f]).length, border: border.size, passes: [...new Set(passes.values())], at };
  });
});

async function makeParts(page) {
  await page.click("#repaint");
  await page.waitForSelector("#tool-cut");
  await page.waitForTimeout(300);
}

// The line across the middle of what is seen of an arm, by shares of the view, and how wide it is there in pixels.
const acrossArm = (page) => viewer(page, `(v) => {
  const box = v.paneBoxes()[0];
  const { positions } = v.meshes.scan;
  const at = [];
  for (let k = 0; k < positions.length; k += 3) at.push(v.onScreen([...positions.subarray(k, k + 3)], box));
  const mean = [0, 1].map((c) => at.reduce((s, p) => s + p[c], 0) / at.length);
  // The long axis of what is seen.
  const m = at.reduce(([a, b, d], [x, y]) => [a + (x - mean[0]) ** 2, b + (x - mean[0]) * (y - mean[1]), d + (y - mean[1]) ** 2], [0, 0, 0]);
  const angle = Math.atan2(2 * m[1], m[0] - m[2]) / 2;
  const axis = [Math.cos(angle), Math.sin(angle)];
  const along = at.map((p) => (p[0] - mean[0]) * axis[0] + (p[1] - mean[1]) * axis[1]);
  const off = at.map((p) => -(p[0] - mean[0]) * axis[1] + (p[1] - mean[1]) * axis[0]);
  const near = off.filter((_, k) => Math.abs(along[k]) < 10);
  const share = (o) => [(mean[0] - axis[1] * o) / box.width, (mean[1] + axis[0] * o) / box.height];
  return { across: Math.max(...near) - Math.min(...near), from: share(Math.min(...near) - 12), to: share(Math.max(...near) + 12) };
}`);

// Goes to an element by Tab alone.
async function tabTo(page, id) {
  for (let k = 0; k < 200; k++) {
    if ((await page.evaluate(() => document.activeElement?.id)) === id) return;
    await page.keyboard.press("Tab");
  }
  throw new Error(`Tab never comes to ${id}`);
}

// Moves the cross to a place, by shares of the view.
async function steer(page, [x, y]) {
  const { width, height } = await page.locator("#canvas").boundingBox();
  const at = await page.evaluate(() => /M([\d.]+) ([\d.]+)h9/.exec(document.querySelector(".keyed path").getAttribute("d")).slice(1).map(Number));
  const [dx, dy] = [x * width - (at[0] + 12), y * height - at[1]].map((by) => Math.round(by / 6));
  for (const [by, keys] of [[dx, ["ArrowLeft", "ArrowRight"]], [dy, ["ArrowUp", "ArrowDown"]]]) {
    const key = keys[by < 0 ? 0 : 1];
    for (let k = 0; k < Math.floor(Math.abs(by) / 8); k++) await page.keyboard.press(`Alt+Shift+${key}`);
    for (let k = 0; k < Math.abs(by) % 8; k++) await page.keyboard.press(`Alt+${key}`);
  }
}

export const parts = {
  async "a part is cut off by a line across it, named, joined again, and each step undone"({ open, scan }) {
    const page = await open();
    await opened(page, scan("arm"));
    await rest(page);
    await makeParts(page);
    check((await page.getAttribute("#tool-cut", "aria-pressed")) === "true" && (await page.isDisabled("#paint-done")), "it does not begin with the cut, or one part can be used");
    await shoot(page, "cut-begin");
    // Across the arm, seen from its front.
    await page.focus("#canvas");
    await page.keyboard.press("1");
    await page.waitForTimeout(200);
    const { across, from, to } = await acrossArm(page);
    check(across > 20, `the arm is ${across} pixels wide`);
    await stroke(page, [from, to]);
    await shoot(page, "cut-drawing");
    await page.mouse.up();
    await until("two parts", async () => (await labelled(page)).length === 2, 5000);
    await page.waitForTimeout(300);
    const cut = await labelled(page);
    // The theorem: each side is one piece, and their border is a closed line that crosses itself nowhere.
    for (const part of cut) check(part.pieces === 1 && part.border > 5 && part.passes.join() === "2", JSON.stringify({ ...part, at: 0 }));
    check(Math.min(...cut.map((p) => p.faces)) > 0.15 * (cut[0].faces + cut[1].faces), `not about half: ${cut.map((p) => p.faces)}`);
    await shoot(page, "cut-two");
    await noComplaints(page, "cut");
    // A line that lies on the front alone closes behind, too; one that parts nothing says so.
    await draw(page, [[0.02, 0.02], [0.03, 0.03]]);
    check((await labelled(page)).length === 2, "turning cut something");
    await page.focus("#canvas");
    await page.keyboard.press("1");
    const name = "Forearm";
    await page.fill("#part-name", name);
    await page.press("#part-name", "Enter");
    await until("the name", async () => (await page.textContent("#part-list .chosen .part")) === name, 5000);
    await page.click("#paint-undo");
    await until("one part again", async () => (await labelled(page)).length === 1);
    check(await page.isDisabled("#paint-undo"), "more to undo");
    await draw(page, [from, to]);
    await until("two parts again", async () => (await labelled(page)).length === 2);
    // Joined by a line from one to the other, and parted again by undo.
    await page.click("#tool-join");
    const seen = await viewer(page, `(v) => {
      const box = v.paneBoxes()[0];
      const { scan } = v.meshes;
      const found = new Map();
      const step = Math.max(1, Math.floor(scan.segments.length / 600));
      for (let f = 0; f < scan.segments.length; f += step) {
        const p = [0, 1, 2].map((k) => scan.positions[3 * scan.corners[scan.starts[f]] + k]);
        if (found.has(scan.segments[f]) || v.isHidden(p, box)) continue;
        const [x, y] = v.onScreen(p, box);
        const { left, top } = v.canvas.getBoundingClientRect();
        const hit = v.under({ clientX: left + x, clientY: top + y }, box);
        if (hit && scan.segments[hit.face] === scan.segments[f]) found.set(scan.segments[f], [x / box.width, y / box.height]);
      }
      return [...found.values()];
    }`);
    check(seen.length === 2, "not both parts are seen");
    await draw(page, seen);
    await until("one part", async () => (await labelled(page)).length === 1);
    await page.keyboard.press("Control+z");
    await until("two parts", async () => (await labelled(page)).length === 2);
    await page.click("#part-list .part >> nth=1");
    await page.fill("#part-name", name);
    await page.press("#part-name", "Enter");
    await page.click("#paint-done");
    await until("a stitched mesh", () => page.url().includes("/composition/"));
    await rest(page);
    const names = (at = page) => at.evaluate(() => [...document.querySelectorAll("#part-list .part")].map((b) => b.textContent).sort().join());
    check((await names()).includes(name) && (await names()).includes("Part "), await names());
    check((await page.locator("#segment option").allTextContents()).some((text) => text.startsWith(name)), "the ranking does not tell the name");
    await page.click("#show-parts");
    await page.waitForTimeout(300);
    await shoot(page, "cut-used");
    await noComplaints(page, "cut used");
    // Kept over a reload, and told to who opens the link in another browser; changed, and taken back.
    const before = await names();
    await page.reload();
    await page.waitForSelector("#part-list li");
    check((await names()) === before, `after a reload: ${await names()}`);
    const other = await open({}, page.url());
    await other.waitForSelector("#part-list li");
    check((await names(other)) === before, `in another browser: ${await names(other)}`);
    check((await other.locator("#segment option").allTextContents()).some((text) => text.startsWith(name)), "the other's ranking does not tell the name");
    await shoot(other, "named-elsewhere");
    await page.fill("#part-name", "Oberarm <b>");
    await page.press("#part-name", "Enter");
    await until("another name", async () => (await names()).includes("Oberarm <b>"));
    await page.fill("#part-name", " ");
    await page.press("#part-name", "Enter");
    await until("its number", async () => !(await names()).includes("Oberarm"));
    // What the server refuses is told, and is as it was.
    page.expected = [/status of 400/];
    await page.fill("#part-name", "a\u202eb");
    await page.press("#part-name", "Enter");
    await until("a refusal", async () => /direction characters/.test(await page.textContent("#status")));
    check(!(await names()).includes("\u202e"), await names());
    await other.reload();
    await other.waitForSelector("#part-list li");
    check((await names(other)) === (await names()), `in another browser, after all: ${await names(other)}`);
  },

  async "a scan is cut in two by keyboard alone"({ open, scan }) {
    const page = await open();
    await opened(page, scan("arm"));
    await rest(page);
    await tabTo(page, "repaint");
    await page.keyboard.press("Enter");
    await page.waitForSelector("#tool-cut");
    await tabTo(page, "canvas");
    check(/Alt and the arrows/.test(await page.textContent("#status")), `nothing tells the keys: ${await page.textContent("#status")}`);
    await page.keyboard.press("1");
    await page.waitForTimeout(200);
    const { from, to } = await acrossArm(page);
    const said = () => page.textContent("#status");
    const line = () => page.evaluate(() => document.querySelector(".keyed polyline").getAttribute("points").split(" ").filter(Boolean).length);
    await page.keyboard.press("c");
    check(/needs two points/.test(await said()), await said());
    await steer(page, from);
    await page.keyboard.press("Enter");
    check(/Point 1 is set, beside the scan/.test(await said()), await said());
    await steer(page, [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2]);
    check(/on Part 1/.test(await said()), await said());
    await page.keyboard.press("Enter");
    check(/Point 2 is set, on Part 1/.test(await said()) && (await line()) === 3, `${await said()}, ${await line()}`);
    await page.keyboard.press("Backspace");
    check(/1 point left/.test(await said()) && (await line()) === 2, `${await said()}, ${await line()}`);
    // What was set goes along where the scan is turned.
    const first = () => page.evaluate(() => document.querySelector(".keyed polyline").getAttribute("points").split(" ")[0]);
    const before = await first();
    for (const key of ["ArrowLeft", "ArrowUp"]) await page.keyboard.press(key);
    await until("the scan turned", async () => (await first()) !== before, 5000);
    await page.keyboard.press("1");
    await until("the scan turned back", async () => (await first()) === before, 5000);
    await steer(page, to);
    await shoot(page, "cut-keys-drawing");
    await noComplaints(page, "cut by keyboard");
    await page.keyboard.press("c");
    await until("two parts", async () => (await labelled(page)).length === 2, 5000);
    check(/Part 2 is a part of its own now/.test(await said()) && (await line()) === 0, `${await said()}, ${await line()}`);
    await page.waitForTimeout(300);
    await shoot(page, "cut-keys");
    const cut = await labelled(page);
    for (const part of cut) check(part.pieces === 1 && part.border > 5 && part.passes.join() === "2", JSON.stringify({ ...part, at: 0 }));
    check(Math.min(...cut.map((p) => p.faces)) > 0.15 * (cut[0].faces + cut[1].faces), `not about half: ${cut.map((p) => p.faces)}`);
    // Taken back, and cut by Enter twice; what parts nothing keeps its line until Escape.
    await page.keyboard.press("Control+z");
    await until("one part", async () => (await labelled(page)).length === 1);
    await page.keyboard.press("Enter");
    await steer(page, from);
    await page.keyboard.press("Enter");
    await page.keyboard.press("Enter");
    await until("two parts again", async () => (await labelled(page)).length === 2, 5000);
    await page.keyboard.press("Enter");
    await page.keyboard.press("Alt+ArrowLeft");
    await page.keyboard.press("c");
    check(/line/.test(await said()) && (await line()) === 2 && (await labelled(page)).length === 2, `${await said()}, ${await line()}`);
    await page.keyboard.press("Escape");
    check((await line()) === 0 && /taken away/.test(await said()), await said());
    await page.keyboard.press("Escape");
    check((await page.evaluate(() => document.activeElement.id)) === "tool-cut", "Escape does not leave the scan");
    check((await page.evaluate(() => document.querySelector(".keyed path").getAttribute("d"))) === "", "the cross is still there");
    await tabTo(page, "paint-done");
    await page.keyboard.press("Enter");
    await until("a stitched mesh", () => page.url().includes("/composition/"));
  },

  async "a line that comes back to where it began cuts out what is in it, and one beside all parts nothing"({ open, scan }) {
    const page = await open({ dark: true });
    await opened(page, scan("old_man"));
    await rest(page);
    await makeParts(page);
    await page.focus("#canvas");
    await page.keyboard.press("1");
    await page.waitForTimeout(200);
    const ring = Array.from({ length: 25 }, (_, k) => [0.5 + 0.06 * Math.cos((2 * Math.PI * k) / 24), 0.5 + 0.12 * Math.sin((2 * Math.PI * k) / 24)]);
    await stroke(page, ring);
    await shoot(page, "cut-ring-drawing-dark");
    await page.mouse.up();
    await until("two parts", async () => (await labelled(page)).length === 2, 5000);
    await page.waitForTimeout(300);
    await shoot(page, "cut-ring-dark");
    await noComplaints(page, "ring, dark");
    const [head, face] = await labelled(page);
    check(face.pieces === 1 && head.pieces === 1 && face.passes.join() === "2", JSON.stringify([{ ...head, at: 0 }, { ...face, at: 0 }]));
    check(face.faces < head.faces, `${face.faces} of ${head.faces}`);
    // All of the border lies where the line was drawn: within the ring's own width of it.
    const off = await viewer(page, `(v, at) => { const box = v.paneBoxes()[0]; return at.map((p) => v.onScreen(p, box)).map(([x, y]) => Math.hypot((x / box.width - 0.5) / 0.06, (y / box.height - 0.5) / 0.12)); }`, face.at);
    check(Math.min(...off) > 0.6 && Math.max(...off) < 1.4, `the border is off the line: ${Math.min(...off)} to ${Math.max(...off)}`);
    // Too short to part anything.
    await draw(page, [[0.5, 0.5], [0.503, 0.503]]);
    check(/line/.test(await page.textContent("#status")) && (await labelled(page)).length === 2, await page.textContent("#status"));
    await page.click("#paint-leave");
    await page.waitForSelector("#panel .verdict");
    check(!(await page.locator("#tool-cut").count()), "still making parts");
  },

  async "a ring takes two cuts, and a sheet is cut from rim to rim"({ open }) {
    // A ring that lies in the plane of the picture, and a sheet.
    const ring = grid(60, 24, true, (s, t) => {
      const [a, b] = [2 * Math.PI * s, 2 * Math.PI * t];
      return [(3 + Math.cos(b)) * Math.cos(a), (3 + Math.cos(b)) * Math.sin(a), Math.sin(b)];
    });
    const sheet = grid(60, 60, false, (s, t) => [4 * s - 2, 4 * t - 2, 0.4 * Math.sin(3 * s) * Math.cos(2 * t)]);
    const at = folder();
    for (const [name, text, lines] of [["ring", ring, [[[0.5, 0.01], [0.5, 0.27]], [[0.5, 0.73], [0.5, 0.99]]]], ["sheet", sheet, [[[0.42, 0.13], [0.45, 0.87]]]]]) {
      writeFileSync(join(at, `${name}.obj`), text);
      const page = await open();
      await drop(page, [join(at, `${name}.obj`)]);
      await page.waitForSelector("#repaint");
      await rest(page);
      await makeParts(page);
      await page.focus("#canvas");
      await page.keyboard.press("1");
      await page.waitForTimeout(200);
      // By the height of what is seen, in the middle of the picture.
      const frame = await viewer(page, "(v) => { const { width, height } = v.paneBoxes()[0]; const side = 0.95 * Math.min(width, height); return { x: (width - side) / 2 / width, y: (height - side) / 2 / height, w: side / width, h: side / height }; }");
      for (const [k, line] of lines.entries()) {
        await draw(page, line.map(([x, y]) => [frame.x + x * frame.w, frame.y + y * frame.h]));
        const count = (await labelled(page)).length;
        check(count === (k === lines.length - 1 ? 2 : 1), `${name}: ${count} parts after ${k + 1} lines: ${await page.textContent("#status")}`);
        await shoot(page, `cut-${name}-${k + 1}`);
        if (count === 1) check(/second one/.test(await page.textContent("#status")), await page.textContent("#status"));
      }
      const cut = await labelled(page);
      for (const part of cut) check(part.pieces === 1, JSON.stringify({ ...part, at: 0 }));
      check(Math.min(...cut.map((p) => p.faces)) > 0.3 * cut.reduce((sum, p) => sum + p.faces, 0), `not about half: ${cut.map((p) => p.faces)}`);
      // Undone line by line.
      for (let k = lines.length; k > 0; k--) await page.click("#paint-undo");
      check((await labelled(page)).length === 1 && (await page.isDisabled("#paint-undo")), "not undone line by line");
    }
  },

  async "on a phone a part is cut off by a finger, in both themes, and two fingers draw nothing"({ open, scan }) {
    for (const dark of [false, true]) {
      const page = await open({ width: 390, height: 844, touch: true, dark });
      await opened(page, scan("arm"));
      await rest(page);
      await makeParts(page);
      await page.locator("#canvas").scrollIntoViewIfNeeded();
      const session = await page.context().newCDPSession(page);
      const box = await page.locator("#canvas").boundingBox();
      const touch = (type, points) => session.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x: box.x + x, y: box.y + y, id })) });
      // Across what is seen in the middle of the picture, from above to below it.
      const x = box.width / 2;
      const ys = await viewer(page, `(v, x) => { const { left, top } = v.canvas.getBoundingClientRect(); const at = []; for (let y = 0; y < v.canvas.clientHeight; y += 3) if (v.under({ clientX: left + x, clientY: top + y })) at.push(y); return [at[0], at.at(-1)]; }`, x);
      check(ys[1] - ys[0] > 20, `${ys}`);
      const line = Array.from({ length: 20 }, (_, k) => [x, ys[0] - 6 + (k / 19) * (ys[1] - ys[0] + 12)]);
      await touch("touchStart", [line[0]]);
      for (const at of line.slice(1, 10)) await touch("touchMove", [at]);
      // A second finger: they pinch now.
      await touch("touchStart", [line[9], [40, 40]]);
      await touch("touchEnd", []);
      await page.waitForTimeout(200);
      check((await labelled(page)).length === 1, "two fingers cut");
      await page.focus("#canvas");
      await touch("touchStart", [line[0]]);
      for (const at of line.slice(1)) await touch("touchMove", [at]);
      await shoot(page, `cut-phone-drawing${dark ? "-dark" : ""}`);
      await touch("touchEnd", []);
      await until("two parts", async () => (await labelled(page)).length === 2, 5000);
      await page.waitForTimeout(300);
      await shoot(page, `cut-phone${dark ? "-dark" : ""}`);
      check(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "the page is wider than the phone");
      await noComplaints(page, `cut on a phone, ${dark ? "dark" : "light"}`);
      await page.locator("#part-name").scrollIntoViewIfNeeded();
      await shoot(page, `cut-phone-panel${dark ? "-dark" : ""}`);
    }
  },

  async "what is chosen for a finger is chosen for all fingers at a click, and may be forgotten for one"({ open, example }) {
    const page = await open();
    await page.evaluate(() => { document.querySelector("#how").open = true; });
    await page.selectOption("#parts", "auto");
    await drop(page, [example("hand_human")]);
    await until("a stitched mesh", () => page.url().includes("/composition/"));
    await rest(page);
    await page.click("#show-parts");
    await page.waitForTimeout(400);
    await shoot(page, "alike-parts");
    const all = () => page.evaluate(() => [...document.querySelectorAll("#part-list li")].map((li) => ({ id: li.querySelector(".part").id, what: li.querySelector("small").textContent, isForgettable: Boolean(li.querySelector("[id^=forget]")) })));
    // Of the parts with one rim that one whose example others take, too.
    const facesOf = (p) => Number(/(\d+) faces/.exec(p.what)[1]);
    const fingers = (await all()).filter((p) => p.what.startsWith("open")).sort((a, b) => facesOf(a) - facesOf(b));
    check(fingers.length >= 3, JSON.stringify(await all()));
    let [took, after] = [0, []];
    for (const { id } of fingers) {
      await page.click(`#${id}`);
      await page.locator("#entries li button").first().click();
      await until("its map", () => page.url().includes("/map/"));
      await rest(page);
      const before = (await all()).filter((p) => p.isForgettable).length;
      if (await page.locator("#alike").count()) {
        const offered = (await page.textContent("#alike")).match(/Part \d+/g);
        check(offered.length >= 1 && !offered.includes(await page.textContent(`#${id}`)), `${offered}`);
        await page.waitForTimeout(300);
        await shoot(page, "alike-offered");
        await noComplaints(page, "alike offered");
        await page.click("#alike");
        await until("all of them", async () => /lies on \d+ more parts? now/.test(await page.textContent("#status")));
        took = Number(/lies on (\d+) more/.exec(await page.textContent("#status"))[1]);
        after = (await all()).filter((p) => p.isForgettable);
        check(after.length === before + took && took <= offered.length, `${took} took it, ${after.length - before} can forget it`);
        if (took) break;
      }
      await page.click(`#forget-${id.split("-")[1]}`);
    }
    check(took >= 1, `no part has another like it: ${JSON.stringify(await all())}`);
    const names = new Set(after.map((p) => p.what.split(" · ")[1]));
    check(names.size === 1, `not the same example: ${[...names]}`);
    await page.waitForTimeout(300);
    await shoot(page, "alike-laid");
    await page.click(`#${after.at(-1).id.replace("part", "forget")}`);
    check((await all()).filter((p) => p.isForgettable).length === after.length - 1, "nothing was forgotten");
    await page.click("#stitch");
    await until("a stitched mesh", () => page.url().includes("/composition/"));
    await rest(page);
    await page.waitForTimeout(300);
    await shoot(page, "alike-stitched");
  },

  async "a scan is cut as an example is, and takes it part by part"({ open, scan, example, url }) {
    const { id } = await addExample(url, example("arm_human"), "_in_groups&segments=groups");
    try {
      const page = await open();
      await laid(page, scan("arm"));
      await rest(page);
      check(!(await page.locator("#cut-like").count()), "an example in one piece offers its cut");
      await page.locator("#entries button:has-text('arm_human_in_groups')").first().click();
      await page.waitForSelector("#cut-like");
      await rest(page);
      await shoot(page, "like-offered");
      await page.click("#cut-like");
      await until("a stitched mesh", () => page.url().includes("/composition/"));
      await rest(page);
      const took = await page.locator("#part-list small").allTextContents();
      const chosen = await page.evaluate(() => document.querySelector("#part-list .chosen .part").id);
      check(chosen === `part-${await page.inputValue("#segment")}`, `the panel has chosen ${chosen}, the ranking another`);
      check(!(await page.locator("#alike").count()), "what all have is offered to others");
      check(took.length === 3 && took.every((text) => text.endsWith("arm_human_in_groups")), took.join("; "));
      // The parts of one example are one mesh again: no pole is added.
      check((await page.textContent("#panel")).includes("No pole beyond those of the examples"), "stitching added poles");
      await page.waitForTimeout(300);
      await shoot(page, "like-stitched");
      await noComplaints(page, "cut alike");
    } finally {
      await fetch(`${url}/v1/examples/${id}`, { method: "DELETE" });
    }
  },

  async "parts are painted on a scan, merged, and the scan is cut so"({ open, scan }) {
    const page = await open();
    await opened(page, scan("old_man"));
    await rest(page);
    await page.click("#repaint");
    await page.waitForSelector("#tool-brush");
    await page.click("#tool-brush");
    const box = await page.locator("#canvas").boundingBox();
    const at = (x, y) => [box.x + x * box.width, box.y + y * box.height];
    // The face, stroke by stroke.
    await page.selectOption("#brush-size", "large");
    const stroke = async (from, to) => { await page.mouse.move(...at(...from)); await page.mouse.down(); await page.mouse.move(...at(...to), { steps: 6 }); await page.mouse.up(); };
    await stroke([0.56, 0.38], [0.6, 0.62]);
    await page.waitForTimeout(400);
    await shoot(page, "painting");
    await noComplaints(page, "painting");
    const counts = () => page.evaluate(() => [...document.querySelectorAll("#part-list small")].map((s) => Number(s.textContent.split(" ")[0])));
    const painted = await counts();
    check(painted.length === 2 && painted[1] > 100, `${painted}`);
    // A third part, taken back, and one merged.
    await page.click("#paint-new");
    await page.selectOption("#brush-size", "small");
    await stroke([0.44, 0.3], [0.46, 0.32]);
    check((await counts()).length === 3, "no third part");
    await page.selectOption("#merge-into", { label: "Part 1" });
    check((await counts()).join() === painted.join(), `merged: ${await counts()}, before ${painted}`);
    await page.click("#paint-undo");
    check((await counts()).length === 3, "the merging is not undone");
    await page.click("#paint-undo");
    await page.waitForTimeout(200);
    await page.click("#paint-done");
    await until("two parts", () => page.evaluate(() => document.querySelector("#panel h2")?.textContent === "2 parts" || document.querySelectorAll("#part-list li").length === 2 && !document.querySelector("#paint-new")));
    await until("a stitched mesh", () => page.url().includes("/composition/"));
    await rest(page);
    await page.click("#show-parts");
    await page.waitForTimeout(400);
    await shoot(page, "painted-parts");
    await noComplaints(page, "painted parts");
  },

  async "quads for all of a scan come at a click, and the page goes on with what the server has cut for them"({ open, scan, url }) {
    const page = await open();
    await opened(page, scan("arm"));
    await rest(page);
    // The map of an arm reaches all of it, so that there is no button: what it does is called here, and answered with another cut.
    const whole = page.url().split("#")[1].split("/")[0];
    const cut = await (await fetch(`${url}/v1/queries?parts=2`, { method: "POST", body: readFileSync(scan("arm")) })).json();
    const made = await (await fetch(`${url}/v1/queries/${cut.id}/compositions?wait=240`, { method: "POST", headers: { "content-type": "application/json" }, body: "{}" })).json();
    const asked = [];
    await page.route("**/retopos**", (route) => {
      asked.push(route.request().method());
      const { verdict, inspired, reasons, covers } = made;
      route.fulfill({ status: 201, contentType: "application/json", body: JSON.stringify({ id: made.id, query: whole, state: "done", progress: 1, result_query: cut.id, result: { composition: made.id }, verdict, inspired, reasons, covers, notes: [], total_ms: 1500 }) });
    });
    await page.evaluate(async () => { const { bench } = await import("/web/state.js"); (await import("/web/laying.js")).layAll(bench.query); });
    await page.waitForFunction((id) => location.hash.startsWith(`#${id}/composition/`), cut.id);
    await page.waitForSelector("#part-list li");
    await page.waitForFunction(() => document.querySelector("#status").textContent.startsWith("Quads for all of it in 1.5 s"));
    check(asked.join() === "POST", `asked: ${asked}`);
    check((await page.locator("#scans .scan span").first().textContent()).includes("in parts"), "what was cut is not among the scans");
    await rest(page);
    await shoot(page, "all-of-it");
  },

  async "a scan in parts is coloured, picked in the view, given examples, and stitched"({ open, scan }) {
    const page = await open();
    await page.evaluate(() => { document.querySelector("#how").open = true; });
    await page.selectOption("#parts", "2");
    await laid(page, scan("arm")).catch(() => {});
    await page.waitForSelector("#part-list li");
    await until("a stitched mesh", () => page.url().includes("/composition/"));
    await rest(page);
    await page.waitForTimeout(300);
    await shoot(page, "stitched");
    await noComplaints(page, "stitched");
    const took = await page.locator("#part-list small").allTextContents();
    check(took.length === 2 && took.every((text) => !text.includes("its best example")), `the parts don't tell what they took: ${took}`);
    await page.click("#show-parts");
    await page.waitForTimeout(300);
    await shoot(page, "parts");
    const chosen = () => page.evaluate(() => document.querySelector("#part-list .chosen .part").id);
    const before = await chosen();
    const other = await page.evaluate((id) => [...document.querySelectorAll("#part-list .part")].find((b) => b.id !== id).id, before);
    const at = await viewer(page, `(v, segment) => {
      const { scan } = v.meshes;
      const box = v.paneBoxes()[0];
      const { left, top } = v.canvas.getBoundingClientRect();
      for (let f = 0; f < scan.segments.length; f++) {
        if (scan.segments[f] !== segment) continue;
        const vertex = scan.corners[scan.starts[f]];
        const p = [0, 1, 2].map((k) => scan.positions[3 * vertex + k]);
        if (!v.isHidden(p, box)) { const [x, y] = v.onScreen(p, box); const hit = v.under({ clientX: left + x, clientY: top + y }, box); if (hit && scan.segments[hit.face] === segment) return [left + x, top + y]; }
      }
      return null;
    }`, Number(other.split("-")[1]));
    check(at, "no face of the other part is seen");
    await page.mouse.click(...at);
    check((await chosen()) === other, "a click on a part does not choose it");
    await page.locator("#entries li button").first().click();
    await until("its map", () => page.url().includes("/map/"));
    await rest(page);
    await page.waitForTimeout(300);
    await shoot(page, "part-laid");
    await holdBack(page, "**/compositions**");
    await page.click("#stitch");
    await page.waitForSelector("#status button");
    await page.waitForSelector("#status progress:not([hidden])");
    await shoot(page, "stitching");
    await page.click("#status button");
    await page.waitForFunction(() => document.querySelector("#status").textContent === "Cancelled.");
  },
};
