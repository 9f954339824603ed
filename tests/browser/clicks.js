// How many clicks a task takes: ten tasks of every day, counted as they are done. A press of a button of the mouse is one, so is a
// drag, and so is a drop of files; an entry of a list takes two.

import { join } from "node:path";
import { addExample, check, drop, gone, samples, Server, until } from "./bed.js";
import { laid } from "./looking.js";

const rest = (page) => until("a rest", () => page.evaluate(() => !document.querySelector("#status button") && !/Laying|…/.test(document.querySelector("#status").textContent)));
const viewer = (page, act, arg) => page.evaluate(`(${act})(document.querySelector("#canvas").viewer, ${JSON.stringify(arg ?? null)})`);

// Counts what is pressed in a page from here on; `end()` answers with the number. The document listens, not the window: where a
// button moves under the press, Playwright stops the press at the window and makes another, and only one of the two was a click.
async function counting(page) {
  await page.evaluate(() => {
    if (globalThis.presses !== undefined) { globalThis.presses = 0; return; }
    globalThis.presses = 0;
    document.addEventListener("pointerdown", () => { globalThis.presses++; }, true);
  });
  return { end: (more = 0) => page.evaluate((n) => globalThis.presses + n, more) };
}

const counts = [];
function tell(task, clicks, most) {
  counts.push(`${String(clicks).padStart(3)}  ${task}`);
  check(clicks <= most, `${task}: ${clicks} clicks, and ${most} were enough`);
}

export const clicks = {
  async "ten tasks take as few clicks as they are told to"({ open, scan, example }) {
    const server = await (await Server.make()).start();
    for (const name of ["head_man", "head_woman", "head_child"]) await addExample(server.url, example(name));
    const page = await open({}, `${server.url}/`);
    const box = () => page.locator("#canvas").boundingBox();
    const at = async (x, y) => { const b = await box(); return [b.x + x * b.width, b.y + y * b.height]; };

    // A head is laid on a scan, and saved: one drop, one click.
    await page.waitForFunction(() => document.querySelector("#health").textContent.includes("examples"));
    let count = await counting(page);
    await laid(page, scan("old_man"));
    await rest(page);
    const saved = page.waitForEvent("download");
    await page.click("#save-obj");
    check((await saved).suggestedFilename().endsWith(".obj"), "nothing was saved");
    tell("lay a head on a scan, and save it as OBJ", await count.end(1), 2);

    count = await counting(page);
    const before = page.url();
    await page.locator("#entries li:not(.chosen) button").first().click();
    await until("another map", () => page.url() !== before);
    await rest(page);
    tell("lay another example in its place", await count.end(), 1);

    count = await counting(page);
    await page.click("#layout-two");
    tell("see scan and example side by side, turned as one", await count.end(), 1);

    count = await counting(page);
    // The list opens at a press, and takes another: a browser without a window draws none.
    await page.selectOption("#heat", "distance");
    await until("colours", () => viewer(page, "(v) => Boolean(v.heat)"));
    tell("see where the quads are off the scan", await count.end(2), 2);
    await page.selectOption("#heat", "");

    count = await counting(page);
    const points = () => viewer(page, "(v) => JSON.stringify(v.points.map((p) => p.point))");
    const old = await points();
    const point = await viewer(page, `(v) => {
      const b = v.paneBoxes().find((p) => p.name === "result");
      const { left, top } = v.canvas.getBoundingClientRect();
      const [x, y] = v.points.filter((p) => !v.isHidden(p.point, b)).map((p) => v.onScreen(p.point, b))[0];
      return [left + x, top + y];
    }`);
    await page.mouse.move(...point);
    await page.mouse.down();
    await page.mouse.move(point[0] + 3, point[1] + 3, { steps: 3 });
    await page.mouse.up();
    await until("the edit", async () => (await points()) !== old);
    await rest(page);
    tell("put a nose right", await count.end(), 1);

    count = await counting(page);
    await page.click("#mirror");
    await page.click("#place");
    // A temple and a corner of the jaw with those across, and the chin: five landmarks.
    for (const [x, y] of [[0.2, 0.45], [0.22, 0.58], [0.28, 0.6]]) {
      await page.mouse.click(...await at(x, y));
      await page.waitForTimeout(120);
      await page.mouse.click(...await at(x + 0.5, y));
      await page.waitForTimeout(120);
    }
    const placed = await viewer(page, "(v) => v.pairs.length");
    check(placed >= 5, `${placed} landmarks`);
    // The list of landmarks grows with each and moves the button below it.
    await until("all of them in the list", () => page.evaluate((n) => document.querySelector("#lay-held")?.textContent.includes(` ${n} `), placed));
    const held = page.url();
    await page.click("#lay-held");
    await until("a map by landmarks", () => page.url() !== held);
    await rest(page);
    tell("lay it by landmarks on both sides of a face", await count.end(), 9);

    count = await counting(page);
    await page.click("#undo");
    await until("the map before", () => page.url() === held);
    tell("take that back", await count.end(), 1);

    // The corpus: three samples more with a tag, one of them deleted and taken back.
    count = await counting(page);
    await page.click("#to-corpus");
    await page.click("#new-tags");
    await page.keyboard.type("limb");
    await drop(page, ["arm_human", "leg_human", "tentacle"].map((name) => join(samples.examples, `${name}.obj`)));
    await until("all of them", () => page.evaluate(() => document.querySelectorAll("#uploads .good").length === 3));
    tell("add examples with a tag", await count.end(1), 3);

    await until("a rest", () => page.evaluate(() => document.querySelectorAll("#grid li").length === 6));
    count = await counting(page);
    await page.locator("#grid button").first().click();
    await page.waitForSelector("#example-dialog[open]");
    await page.click("#example-dialog button:has-text('Delete')");
    await page.waitForSelector(".toast");
    tell("delete an example", await count.end(), 2);
    await page.click(".toast button");

    // A scan in parts, one of which takes another example. The parts are chosen before the scan is dropped.
    await page.click("#to-bench");
    await page.evaluate(() => { document.querySelector("#how").open = true; });
    await page.selectOption("#parts", "2");
    await drop(page, [scan("arm")]);
    await until("a stitched mesh", () => page.url().includes("/composition/"));
    await rest(page);
    count = await counting(page);
    const stitched = page.url();
    await page.locator("#part-list .part").nth(1).click();
    await page.locator("#entries li button").first().click();
    await until("its map", () => page.url().includes("/map/"));
    await rest(page);
    await page.click("#stitch");
    await until("stitched anew", () => page.url().includes("/composition/") && page.url() !== stitched);
    tell("exchange the example of a part, and stitch", await count.end(), 3);
    await gone(page, server);
    console.log(counts.map((line) => `     ${line}`).join("\n"));
  },
};
