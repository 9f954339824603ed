// Putting a map right.

import { check, shoot, until } from "./bed.js";
import { laid, noComplaints, opened } from "./looking.js";

export const viewer = (page, act, arg) => page.evaluate(`(${act})(document.querySelector("#canvas").viewer, ${JSON.stringify(arg ?? null)})`);
export const rest = (page) => until("a rest", () => page.evaluate(() => !document.querySelector("#status button") && !/Laying|…/.test(document.querySelector("#status").textContent)));
const constraints = (page) => viewer(page, "(v) => JSON.stringify(v.points.map((p) => [p.id, p.origin, p.point.map((x) => Math.round(1e4 * x) / 1e4)]))");

// A point in front that can be taken hold of, in the window's pixels.
const inFront = (page) => viewer(page, `(v) => {
  const box = v.paneBoxes().find((b) => b.name === "result");
  const { left, top } = v.canvas.getBoundingClientRect();
  const seen = v.points.filter((p) => !v.isHidden(p.point, box)).map((p) => ({ id: p.id, at: v.onScreen(p.point, box) }));
  const lone = seen.map((p) => ({ ...p, far: Math.min(...seen.filter((q) => q !== p).map((q) => Math.hypot(p.at[0] - q.at[0], p.at[1] - q.at[1]))) })).sort((a, b) => b.far - a.far)[0];
  return { id: lone.id, x: left + lone.at[0], y: top + lone.at[1] };
}`);

export const correcting = {
  async "a point is dragged, nudged, taken off and put back, and each step undone"({ open, scan }) {
    const page = await open();
    await laid(page, scan("old_man"));
    await rest(page);
    const first = await constraints(page);
    const point = await inFront(page);
    await page.mouse.move(point.x, point.y);
    await page.mouse.down();
    await page.mouse.move(point.x + 4, point.y + 4, { steps: 4 });
    await page.waitForTimeout(400);
    await shoot(page, "dragging");
    await page.mouse.up();
    await until("the edit", async () => (await constraints(page)) !== first);
    await until("something to undo", () => page.isEnabled("#undo"));
    const dragged = await constraints(page);
    await page.keyboard.press("Control+z");
    await until("undo", async () => (await constraints(page)) === first);
    check(await page.isDisabled("#undo"), "there is something left to undo");
    await page.keyboard.press("Control+Shift+z");
    await until("redo", async () => (await constraints(page)) === dragged);
    // The same by keyboard: choose the point, move it.
    await page.evaluate(() => { document.querySelector("#point-list").open = true; });
    const chosen = page.locator(`#point-${point.id}`);
    if ((await chosen.getAttribute("aria-pressed")) !== "true") { await chosen.focus(); await page.keyboard.press("Enter"); }
    await page.focus("#canvas");
    await page.keyboard.press("Alt+ArrowLeft");
    await until("the nudge", async () => { const now = await constraints(page); return now !== dragged && !(await page.evaluate(() => document.querySelector("#status").textContent)); });
    await page.waitForTimeout(800);
    const nudged = await constraints(page);
    // Off, and back by undo.
    const other = JSON.parse(nudged).map((p) => p[0]).find((id) => id !== point.id);
    await page.evaluate(() => { document.querySelector("#point-list").open = true; });
    await page.click(`#remove-${other}`);
    await until("the removal", async () => !(await constraints(page)).includes(`"${other}"`));
    await page.keyboard.press("Control+z");
    await until("it is back", async () => (await constraints(page)).includes(`"${other}"`));
    // A point of one's own.
    const before = JSON.parse(await constraints(page)).length;
    const box = await page.locator("#canvas").boundingBox();
    await page.mouse.dblclick(box.x + 0.5 * box.width, box.y + 0.35 * box.height);
    await until("a pin", async () => JSON.parse(await constraints(page)).length === before + 1);
    await page.evaluate(() => { document.querySelector("#point-list").open = true; });
    await shoot(page, "corrected");
    await noComplaints(page, "corrected");
    console.log(`     from an edit to its picture: ${await page.evaluate(() => { const row = [...document.querySelectorAll(".facts tr")].find((r) => r.textContent.startsWith("Last edit")); return row?.lastChild.textContent ?? "–"; })}`);
  },

  async "the quads of a whole scan are made denser, and as they were again"({ open, scan }) {
    const page = await open();
    await opened(page, scan("old_man"));
    await rest(page);
    const quads = () => viewer(page, "(v) => v.meshes.quads.starts.length - 1");
    const before = await quads();
    const map = page.url();
    await page.selectOption("#density", "1");
    await until("a denser mesh", () => page.url().includes("/composition/"));
    await rest(page);
    const after = await quads();
    check(after > 3.5 * before && after < 4.5 * before, `${before} quads became ${after}`);
    check((await page.inputValue("#density")) === "1", "the density is not told");
    await shoot(page, "denser");
    await noComplaints(page, "denser");
    // A reload shows it again, and the map is a choice away.
    await page.reload();
    await page.waitForSelector("#panel .verdict");
    check((await page.inputValue("#density")) === "1" && (await quads()) === after, "the denser mesh is not there again");
    await page.selectOption("#density", "0");
    await until("the map", () => page.url() === map);
    check((await quads()) === before, "the map is another one");
  },

  async "on a symmetric example the point across goes along"({ open, scan }) {
    const page = await open();
    await laid(page, scan("old_man"));
    await rest(page);
    await page.click("#mirror");
    check((await page.getAttribute("#mirror", "aria-pressed")) === "true", "it is not mirrored");
    const before = JSON.parse(await constraints(page)).length;
    const box = await page.locator("#canvas").boundingBox();
    // A cheek: far from the plane, and seen.
    await page.mouse.dblclick(box.x + 0.46 * box.width, box.y + 0.52 * box.height);
    await until("two pins", async () => JSON.parse(await constraints(page)).length === before + 2);
    const ends = await page.evaluate(() => document.querySelector("#canvas").viewer.points.filter((p) => p.id.startsWith("c")).map((p) => p.point));
    check(ends.length === 2 && Math.hypot(...ends[0].map((x, k) => x - ends[1][k])) > 0, JSON.stringify(ends));
    await shoot(page, "mirrored");
    await noComplaints(page, "mirrored");
    // One step takes back both.
    await page.click("#undo");
    await until("undo", async () => JSON.parse(await constraints(page)).length === before);
  },

  async "landmarks are placed by mouse and by keyboard, and hold what is laid"({ open, scan }) {
    const page = await open();
    await opened(page, scan("old_man"));
    await rest(page);
    await page.click("#place");
    await page.waitForTimeout(200);
    const box = await page.locator("#canvas").boundingBox();
    // Both panes show the same from the same side: the same place of both is a fair pair.
    for (const [x, y] of [[0.27, 0.35], [0.2, 0.45]]) {
      await page.mouse.click(box.x + x * box.width, box.y + y * box.height);
      await page.waitForTimeout(150);
      await page.mouse.click(box.x + (x + 0.5) * box.width, box.y + y * box.height);
      await page.waitForTimeout(150);
    }
    await page.focus("#canvas");
    await page.keyboard.press("Enter");
    await page.waitForTimeout(150);
    await page.keyboard.press("Enter");
    await page.waitForTimeout(300);
    check((await page.locator("#pairs li").count()) === 3, "not three landmarks");
    await shoot(page, "landmarks");
    await noComplaints(page, "landmarks");
    const before = page.url();
    await page.click("#lay-held");
    await until("a map by landmarks", () => page.url() !== before);
    await rest(page);
    await page.waitForTimeout(300);
    await shoot(page, "laid-by-landmarks");
    // Undo leads back to the map before.
    await page.click("#undo");
    await until("the map before", () => page.url() === before);
  },

  async "on a symmetric example the landmark across is placed, goes along, and is undone with it"({ open, scan }) {
    const page = await open();
    await opened(page, scan("old_man"));
    await rest(page);
    await page.click("#mirror");
    await page.click("#place");
    await page.waitForTimeout(200);
    const pairs = () => viewer(page, "(v) => v.pairs");
    // A point that both panes show, and the place of its mark in each.
    const marks = (k) => viewer(page, `(v, k) => {
      const { left, top } = v.canvas.getBoundingClientRect();
      return v.paneBoxes().map((box) => v.onScreen(v.pairs[k][box.name === "example" ? "example" : "input"], box)).map(([x, y]) => [left + x, top + y]);
    }`, k);
    const box = await page.locator("#canvas").boundingBox();
    const at = (x, y) => [box.x + x * box.width, box.y + y * box.height];
    await page.mouse.click(...at(0.2, 0.45));
    await page.waitForTimeout(150);
    await page.mouse.click(...at(0.7, 0.45));
    await until("the one across", async () => (await pairs()).length === 2);
    // Where the quads have the point across is where the scan has it, but for what the map is off: a twentieth of the scan.
    const off = () => viewer(page, `(v) => {
      const { example, quads, scan } = v.meshes;
      const far = (a, b) => Math.hypot(...a.map((x, k) => x - b[k]));
      const at = (mesh, k) => [...mesh.positions.subarray(3 * k, 3 * k + 3)];
      const nearest = (mesh, p) => { let best = 0; for (let k = 0; k < mesh.positions.length / 3; k++) if (far(at(mesh, k), p) < far(at(mesh, best), p)) best = k; return best; };
      return v.pairs.map((p) => far(at(quads, nearest(example, p.example)), p.input) / v.frames.result.radius);
    }`);
    const far = await off();
    check(far[1] < far[0] + 0.1, `the one across lies ${far[1]} of the scan's size from where the quads have it, the first ${far[0]}`);
    const both = await pairs();
    check(Math.abs(both[0].example[0] + both[1].example[0]) < 0.1 * Math.abs(both[0].example[0]), `not across on the example: ${JSON.stringify(both)}`);
    await shoot(page, "landmarks-mirrored");
    await noComplaints(page, "landmarks mirrored");
    // Dragging one takes the other along.
    const [, [x, y]] = await marks(0);
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 12, y + 10, { steps: 4 });
    await page.mouse.up();
    const moved = await pairs();
    check(moved.length === 2 && moved.every((p, k) => Math.hypot(...p.input.map((c, i) => c - both[k].input[i])) > 0), `not both moved: ${JSON.stringify(moved)}`);
    const same = (a, b) => JSON.stringify(a.map((p) => [p.example, p.input])) === JSON.stringify(b.map((p) => [p.example, p.input]));
    await page.keyboard.press("Control+z");
    await until("undo", async () => same(await pairs(), both));
    await page.keyboard.press("Control+Shift+z");
    await until("redo", async () => same(await pairs(), moved));
    // One step takes back both, and another the first click.
    for (const left of [2, 1, 0]) {
      await page.click("#undo");
      await until(`${left} landmarks`, async () => (await pairs()).length === left);
    }
    // Off goes the one across, too.
    await page.click("#redo");
    await page.click("#redo");
    await until("both are back", async () => (await pairs()).length === 2);
    await page.click("#pair-1");
    await until("none is left", async () => (await pairs()).length === 0);
  },

  async "points that examples name are placed by name, and hold other examples, too"({ open, scan, url }) {
    const all = (await (await fetch(`${url}/v1/examples`)).json()).items;
    const heads = all.filter((e) => e.name.startsWith("head"));
    // The tip of the nose lies foremost, an ear outermost, the crown highest: all of them are seen from where the page looks.
    for (const { id } of heads) {
      const text = await (await fetch(`${url}/v1/examples/${id}/mesh?format=obj`)).text();
      const at = text.split("\n").filter((line) => line.startsWith("v ")).map((line) => line.split(" ").slice(1, 4).map(Number));
      const farthest = (by) => at.reduce((best, p, k) => (by(p) > by(at[best]) ? k : best), 0);
      const landmarks = [["nose tip", (p) => p[2]], ["crown", (p) => p[1]], ["right ear", (p) => -p[0]]].map(([name, by]) => ({ name, vertex: farthest(by) }));
      const answer = await fetch(`${url}/v1/examples/${id}`, { method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify({ landmarks }) });
      check(answer.ok, await answer.text());
    }
    const page = await open();
    await opened(page, scan("old_man"));
    await rest(page);
    check((await page.locator("#names button").count()) === 3, "the names are not offered");
    await page.click("#name-0");
    // Where the laid example has its own: what it says is good enough here.
    const onScan = () => viewer(page, `(v) => {
      const { example, quads } = v.meshes;
      const pair = v.pairs.find((p) => p.name && p.example && !p.input) ?? v.pairs.at(-1);
      const box = v.paneBoxes().find((b) => b.name === "result");
      const at = [0, 1, 2].map((c) => pair.example[c]);
      let best = 0;
      for (let i = 0; i < example.positions.length; i += 3) if (Math.hypot(example.positions[i] - at[0], example.positions[i + 1] - at[1], example.positions[i + 2] - at[2]) < Math.hypot(example.positions[best] - at[0], example.positions[best + 1] - at[1], example.positions[best + 2] - at[2])) best = i;
      const [x, y] = v.onScreen([...quads.positions.subarray(best, best + 3)], box);
      const { left, top } = v.canvas.getBoundingClientRect();
      return { x: left + x, y: top + y };
    }`);
    for (let k = 0; k < 3; k++) {
      const { x, y } = await onScan();
      await page.mouse.click(x, y);
      await page.waitForTimeout(300);
      if (k === 0) await shoot(page, "named-placing");
    }
    await noComplaints(page, "named");
    check((await page.locator("#names .placed").count()) === 3, `not all are placed: ${await page.locator("#names .placed").count()}`);
    await shoot(page, "named-placed");
    const before = page.url();
    await page.click("#lay-held");
    await until("a map by landmarks", () => page.url() !== before);
    await rest(page);
    await shoot(page, "named-laid");
    // Another head is held by the same names, at a click.
    const held = page.url();
    await page.locator("#entries li:not(.chosen) button:has-text('head')").first().click();
    await until("another example", () => page.url() !== held);
    await until("words", async () => /held by 3 points/.test(await page.textContent("#status")));
    await shoot(page, "named-other");
  },
};
