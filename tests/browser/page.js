// The page in a real browser, state by state: each leaves a picture for people to judge, a clean console, and nothing for axe.
// `node page.js [NAME…]` runs those whose name has one of the words in it.

import { join } from "node:path";
import * as bed from "./bed.js";
import { clicks } from "./clicks.js";
import { correcting } from "./correcting.js";
import { corpus } from "./corpus.js";
import { looking } from "./looking.js";
import { parts } from "./parts.js";
import { trouble } from "./trouble.js";

const { samples, check, open, launch, clean, withSamples } = bed;

// What every test gets: a server with the samples, where they lie, and a browser.
async function prepare() {
  const server = await withSamples();
  return { server, url: server.url, scan: (name) => join(samples.scans, `scan_${name}.obj`), example: (name) => join(samples.examples, `${name}.obj`), browser: await launch() };
}

const tests = { ...looking, ...correcting, ...parts, ...corpus, ...clicks, ...trouble };

async function main() {
  const words = process.argv.slice(2);
  const world = await prepare();
  const failed = [];
  for (const [name, test] of Object.entries(tests)) {
    if (words.length && !words.some((w) => name.includes(w))) continue;
    const begun = Date.now();
    const pages = [];
    // A page of this test: its mistakes are counted when the test is over.
    world.open = async (more = {}, at = `${world.url}/`) => { pages.push(await open(world.browser, at, more)); return pages.at(-1); };
    try {
      await test(world);
      for (const page of pages) check(page.mistakes.length === 0, `the console says: ${page.mistakes.join("\n")}`);
    } catch (error) {
      failed.push(name);
      console.log(`FAILED ${name}: ${error.message}`);
      if (pages.length) await bed.shoot(pages.at(-1), `failed-${name.replace(/\W+/g, "-")}`).catch(() => {});
    }
    for (const page of pages) await page.context().close();
    console.log(`${failed.includes(name) ? "     " : "ok   "}${name} (${((Date.now() - begun) / 1000).toFixed(1)} s)`);
  }
  await world.browser.close();
  await clean();
  console.log(`pictures: ${bed.out}`);
  process.exit(failed.length ? 1 : 0);
}

await main();
