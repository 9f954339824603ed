// The samples that the server makes by itself: examples for an empty corpus, and scans to try it with.

import { call, json } from "/web/call.js";

let listed = null;

const list = (kind) => (listed ??= json("/v1/samples").catch((error) => { listed = null; throw error; })).then(({ items }) => items.filter((s) => s.kind === kind));

export const examples = () => list("example");
export const scans = () => list("scan");

// A sample as the file that it would be.
export async function fileOf(sample) {
  const bytes = await (await call(`/v1/samples/${sample.number}/mesh`, { headers: { accept: "*/*" } })).blob();
  return new File([bytes], `${sample.name}.obj`);
}
