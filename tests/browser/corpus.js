// The corpus: found, added to, changed and deleted.

import { join } from "node:path";
import { writeFileSync } from "node:fs";
import { check, drop, folder, gone, Server, shoot, until } from "./bed.js";
import { noComplaints } from "./looking.js";

const names = (page) => page.evaluate(() => [...document.querySelectorAll("#grid li .text span")].map((s) => s.textContent));

// Once all thumbnails are there.
const pictures = (page) => until("the thumbnails", () => page.evaluate(() => [...document.querySelectorAll("#grid img")].every((i) => i.complete && i.naturalWidth)));

export const corpus = {
  async "the corpus is searched and filtered"({ open, url }) {
    const page = await open({}, `${url}/#corpus`);
    await page.waitForSelector("#grid li");
    await pictures(page);
    await shoot(page, "corpus");
    await noComplaints(page, "corpus");
    const all = await names(page);
    await page.fill("#search", "head");
    const heads = await names(page);
    check(heads.length > 0 && heads.length < all.length && heads.every((n) => n.includes("head")), `${heads}`);
    await page.fill("#search", "");
    await page.selectOption("#filter-topology", "annulus");
    check((await names(page)).length < all.length, "the filter does nothing");
    await page.selectOption("#filter-topology", "");
    // The samples are rated 3; one of them is preferred here.
    const { items } = await (await fetch(`${url}/v1/examples`)).json();
    const rate = (relevance) => fetch(`${url}/v1/examples/${items[1].id}`, { method: "PATCH", headers: { "content-type": "application/json" }, body: JSON.stringify({ relevance }) });
    await rate(5);
    await page.reload();
    await page.waitForSelector("#grid li");
    await page.selectOption("#order", "rating");
    check((await names(page))[0] === items[1].name, "the preferred does not stand first");
    await page.selectOption("#order", "name");
    const ordered = await names(page);
    check(ordered.every((n, k) => k === 0 || ordered[k - 1].localeCompare(n, undefined, { numeric: true }) <= 0), `${ordered}`);
    await page.selectOption("#filter-rating", "5");
    check((await names(page)).join() === items[1].name, "the rating is not filtered by");
    await rate(3);
    const dark = await open({ dark: true, width: 390, height: 844 }, `${url}/#corpus`);
    await dark.waitForSelector("#grid li");
    await pictures(dark);
    await shoot(dark, "corpus-phone-dark");
    await noComplaints(dark, "corpus, phone, dark");
  },

  async "an example is looked at, renamed, deleted and taken back"({ open, url }) {
    const page = await open({}, `${url}/#corpus`);
    await page.waitForSelector("#grid li");
    await page.fill("#search", "duck");
    await page.click("#grid li button");
    await page.waitForSelector("#example-dialog[open] canvas");
    await page.waitForTimeout(1000);
    await shoot(page, "example");
    await noComplaints(page, "example");
    await page.fill("#edit-name", "a duck");
    await page.fill("#edit-tags", "sample, bird");
    await page.selectOption("#edit-rating", "5");
    await page.fill("#edit-author", "Ada");
    await page.fill("#edit-licence", "CC0-1.0");
    // One landmark by mouse, one by keyboard; the first is named, and moved.
    const box = await page.locator("#example-dialog canvas").boundingBox();
    await page.click("#add-landmark");
    await page.mouse.click(box.x + 0.5 * box.width, box.y + 0.45 * box.height);
    await page.waitForSelector("#landmark-0");
    await page.keyboard.type("breast");
    await page.click("#add-landmark");
    await page.keyboard.press("ArrowLeft");
    await page.waitForTimeout(500);
    await shoot(page, "example-placing");
    await page.keyboard.press("Enter");
    await page.waitForSelector("#landmark-1");
    await page.click("#move-0");
    await page.mouse.click(box.x + 0.5 * box.width, box.y + 0.6 * box.height);
    await page.waitForTimeout(300);
    await shoot(page, "example-landmarks");
    await noComplaints(page, "example with landmarks");
    await page.click("#example-dialog button:has-text('Save')");
    await page.waitForFunction(() => document.querySelector("#example-told").textContent === "Saved.");
    await page.click("#example-dialog button:has-text('Delete')");
    await page.waitForSelector(".toast");
    check((await names(page)).length === 0, "it is still there");
    await page.waitForTimeout(300);
    await shoot(page, "deleted");
    await noComplaints(page, "deleted");
    await page.click(".toast button");
    check((await names(page))[0] === "a duck", "it is not back");
    const there = await page.evaluate(() => fetch("/v1/examples?tag=bird").then((r) => r.json()));
    check(there.items.length === 1 && there.items[0].relevance === 5, JSON.stringify(there));
    const { author, licence, landmarks } = there.items[0];
    check(author === "Ada" && licence === "CC0-1.0" && landmarks.map((l) => l.name).join() === "breast,landmark 2", JSON.stringify(landmarks));
  },

  async "the parts of an example stand out, all of them or one"({ open, url }) {
    const page = await open({}, `${url}/#corpus`);
    await page.waitForSelector("#grid li");
    await page.fill("#search", "pig");
    await page.click("#grid li button");
    await page.waitForSelector("#example-part-all:not([disabled])");
    const seen = () => page.evaluate(() => { const v = document.querySelector("#example-dialog canvas").viewer; v.drawNow(); const { gl } = v.painter; const out = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight); gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, out); return out.reduce((sum, x, k) => (sum * 31 + x * (k % 7 + 1)) % 1000003, 7); });
    const parts = await page.locator("#example-parts li").count();
    check(parts > 2, `the pig has no parts: ${parts}`);
    const bare = await seen();
    await page.click("#example-part-all");
    const all = await seen();
    await shoot(page, "example-parts");
    await noComplaints(page, "example with parts");
    await page.click("#example-part-1");
    const one = await seen();
    check(bare !== all && all !== one && (await page.getAttribute("#example-part-1", "aria-pressed")) === "true", "the parts do not stand out");
    await page.click("#example-part-1");
    check((await seen()) === bare, "the picture is not as it was");
  },

  async "an empty corpus takes the samples at a click, and a sample scan is laid at another"({ open }) {
    const server = await (await Server.make()).start();
    const page = await open({}, `${server.url}/#corpus`);
    await page.click("#add-samples");
    await until("the first", () => page.evaluate(() => document.querySelectorAll("#uploads .good").length > 2));
    await shoot(page, "samples-coming");
    await noComplaints(page, "samples coming");
    await until("all of them", () => page.evaluate(() => document.querySelectorAll("#uploads li").length > 10 && !document.querySelector("#uploads progress")));
    await pictures(page);
    await shoot(page, "samples");
    check((await names(page)).length === (await page.locator("#uploads .good").count()), "some are missing");
    await page.click("#to-bench");
    await page.waitForSelector("#sample-scans button");
    await shoot(page, "sample-scans");
    await noComplaints(page, "sample scans");
    await page.click("#sample-scans button:has-text('old man')");
    await until("a map", () => page.url().includes("/map/"));
    await gone(page, server);
  },

  async "several examples are added with tags, and each tells what came of it"({ open, example, scan }) {
    const server = await (await Server.make()).start();
    const page = await open({ expected: [/415|422|400/] }, `${server.url}/`);
    await page.waitForSelector("#no-corpus:not([hidden])");
    await shoot(page, "no-corpus");
    await page.click("#no-corpus a");
    await page.waitForFunction(() => !document.querySelector("#empty").hidden);
    check(await page.isVisible("#add-samples"), "no way out");
    await shoot(page, "empty-corpus");
    await noComplaints(page, "empty corpus");
    const bad = join(folder(), "broken.obj");
    writeFileSync(bad, "v 0 0 0\nf 1 2 3\n");
    const odd = join(folder(), "notes.txt");
    writeFileSync(odd, "no mesh");
    await page.fill("#new-tags", "head, sample");
    await drop(page, [example("head_man"), example("head_woman"), scan("old_man"), bad, odd], "header");
    await until("all of them", () => page.evaluate(() => document.querySelectorAll("#uploads li").length === 5 && !document.querySelector("#uploads progress")));
    await pictures(page);
    await shoot(page, "added");
    await noComplaints(page, "added");
    check((await page.locator("#uploads .good").count()) === 3, "not three were added");
    await page.click("#uploads button:has-text('Take it out')");
    await until("it is out", async () => (await names(page)).length === 2);
    const tags = await page.evaluate(() => fetch("/v1/examples").then((r) => r.json()).then((p) => p.items.filter((e) => !e.template).map((e) => e.tags.join())));
    check(tags.every((t) => t === "head,sample"), `${tags}`);
    await gone(page, server);
  },
};
