// What goes wrong, and how the page says so.

import { join } from "node:path";
import { writeFileSync } from "node:fs";
import { addExample, check, drop, folder, gone, launch, open, Server, shoot, until } from "./bed.js";
import { noComplaints, opened } from "./looking.js";

// A closed scan: a cube, its faces cut fine enough to have form.
function cube(path) {
  const n = 8;
  const [lines, at] = [[], new Map()];
  const vertex = (p) => { const k = p.join(); if (!at.has(k)) { at.set(k, at.size + 1); lines.push(`v ${p.map((x) => x / n - 0.5).join(" ")}`); } return at.get(k); };
  const faces = [];
  for (const axis of [0, 1, 2]) {
    for (const side of [0, n]) {
      for (let a = 0; a < n; a++) for (let b = 0; b < n; b++) {
        const corner = (i, j) => { const p = [0, 0, 0]; p[axis] = side; p[(axis + 1) % 3] = a + i; p[(axis + 2) % 3] = b + j; return vertex(p); };
        const q = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        if (!side) q.reverse();
        faces.push(`f ${q[0]} ${q[1]} ${q[2]}`, `f ${q[0]} ${q[2]} ${q[3]}`);
      }
    }
  }
  writeFileSync(path, [...lines, ...faces].join("\n"));
  return path;
}

export const trouble = {
  async "the contract is readable, too"({ open, url }) {
    const page = await open({}, `${url}/docs`);
    await page.waitForSelector("main details");
    await shoot(page, "contract");
    await noComplaints(page, "contract");
  },

  async "a file that is no mesh is refused with a reason, and the page stays"({ open }) {
    const page = await open({ expected: [/4\d\d/] });
    const bad = join(folder(), "broken.obj");
    writeFileSync(bad, "v 0 0 0\nf 1 2 3\n");
    const odd = join(folder(), "notes.txt");
    writeFileSync(odd, "no mesh");
    await drop(page, [odd], "nav");
    await page.waitForFunction(() => document.querySelector("#status").textContent.includes("not a mesh"));
    await drop(page, [bad], "nav");
    await page.waitForFunction(() => document.querySelector("#trouble").textContent.startsWith("broken.obj"));
    await page.waitForTimeout(200);
    await shoot(page, "refused");
    await noComplaints(page, "refused");
  },

  async "a closed scan among open examples is told, with the way out"({ open, example }) {
    const server = await (await Server.make()).start();
    await addExample(server.url, example("head_man"));
    const page = await open({}, `${server.url}/`);
    await drop(page, [cube(join(folder(), "closed.obj"))]);
    await page.waitForFunction(() => /[Ss]can is closed.*open/.test(document.querySelector("#panel").textContent));
    await page.waitForTimeout(300);
    await shoot(page, "closed-among-open");
    await noComplaints(page, "closed among open");
    await page.click("#lay-all");
    await page.waitForFunction(() => location.hash.includes("/composition/"));
    check((await page.textContent("#panel .verdict")).includes("No example used"), "a cube is called an example's");
    await gone(page, server);
  },

  async "a server with tokens asks for one before anything else"({ open }) {
    const server = await Server.make();
    const token = server.token("contributor");
    await server.start();
    const page = await open({ expected: [/401/] }, `${server.url}/`);
    await page.waitForSelector("#token-dialog[open]");
    await page.waitForTimeout(300);
    await shoot(page, "token");
    await noComplaints(page, "token");
    await page.keyboard.press("Escape");
    check(await page.isVisible("#token-dialog"), "Escape leads past the token");
    await page.fill("#token", "wrong");
    await page.keyboard.press("Enter");
    await page.waitForFunction(() => document.querySelector("#token-trouble").textContent);
    await page.fill("#token", token);
    await page.keyboard.press("Enter");
    await page.waitForFunction(() => !document.querySelector("#token-dialog").open);
    await page.waitForFunction(() => document.querySelector("#health").textContent.includes("examples"));
    await gone(page, server);
  },

  async "a server that goes is told, and the page goes on when it is back"({ open, example, scan }) {
    const server = await (await Server.make()).start();
    await addExample(server.url, example("head_man"));
    const page = await open({ expected: [/ERR_CONNECTION|ERR_INCOMPLETE|404|Failed to load/] }, `${server.url}/`);
    await page.waitForFunction(() => document.querySelector("#health").textContent);
    await server.stop("SIGKILL");
    await drop(page, [scan("old_man")]);
    await page.waitForSelector("#banner:not([hidden])");
    await page.waitForTimeout(300);
    await shoot(page, "server-gone");
    await noComplaints(page, "server gone");
    await server.start();
    await page.waitForSelector("#banner", { state: "hidden", timeout: 20_000 });
    await page.waitForSelector("#panel .verdict");
    // What was laid is gone with a server that ends: the page says so after a reload.
    await server.stop("SIGKILL");
    await server.start();
    await page.reload();
    await page.waitForFunction(() => document.querySelector("#status").textContent.includes("no longer holds"));
    await shoot(page, "scan-gone");
    await gone(page, server);
  },

  async "where nothing can be drawn the page says so, and the corpus is tended all the same"({ url }) {
    const browser = await launch(["--disable-3d-apis"]);
    try {
      const page = await open(browser, `${url}/`);
      await page.waitForFunction(() => document.querySelector("#welcome").textContent.includes("WebGL"));
      await noComplaints(page, "no WebGL");
      await page.click("#to-corpus");
      await page.waitForSelector("#grid li");
      check(page.mistakes.length === 0, `the console says: ${page.mistakes.join()}`);
    } finally { await browser.close(); }
  },

  async "two tabs don't get in each other's way"({ open, scan }) {
    const page = await open();
    await opened(page, scan("old_man"));
    const other = await page.context().newPage();
    await other.goto(page.url());
    await other.waitForSelector("#panel .verdict");
    const before = page.url();
    await other.bringToFront();
    await other.locator("#entries li:not(.chosen) button").first().click();
    await until("another map in the other tab", () => other.url() !== before);
    check(page.url() === before, "the first tab went along");
    await page.bringToFront();
    await page.reload();
    await page.waitForSelector("#panel .verdict");
    check(page.url() === before, "the first tab lost its map");
  },
};
