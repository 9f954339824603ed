// What the service says, in an artist's words: one headline, reasons, and the way out.

const HEADLINES = {
  good: ["Good", "Use it; a glance is enough."],
  fair: ["Fair", "Look at it first."],
  poor: ["Poor", "Try another example, or put it right."],
  broken: ["Broken", "Of no use as it is: try another example."],
};

// `inspired`: the share of it that is an example's quads.
export function headline(verdict, inspired) {
  if (inspired === 0) return { word: "No example used", advice: "All of it is regular layouts. Add examples that are like this scan.", kind: "poor" };
  const [word, advice] = HEADLINES[verdict] ?? [verdict, ""];
  return { word, advice: inspired < 0.5 ? `${advice} Most of it is regular layouts, not an example's quads.` : advice, kind: verdict };
}

const percent = (share) => `${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %`;

// What a reason says here; the last column says what helps. Numbers stay with the details.
const REASONS = [
  [/^bumps and hollows/, () => "Features may be misplaced: the example's nose beside the scan's, say.", "Place landmarks."],
  [/^the (scan|example) is flat/, () => "One of the two is flat, and the other is not: nothing tells where it belongs.", "Try another example, or a regular layout."],
  [/^the surfaces' pictures differ/, () => "The scan and this example are not alike.", "Try another example."],
  [/^the surfaces' proportions differ/, () => "One of the two is longer or thinner than the other.", "Try another example, or cut off what only one of them has."],
  [/^each of these is doubtful/, () => "Several measures are doubtful, which together is too much.", "Try another example, or place landmarks."],
  [/^the share (\S+) of the faces look inward/, (x) => `Some quads (${percent(x)}) are turned over, in folds or thin places.`, "Drag the point beside them."],
  [/^some faces look into the scan/, () => "Some quads are turned over, in folds or thin places.", "Drag the point beside them."],
  [/^quads are sheared: their angles change by (\S+)°/, (x) => `The quads are sheared: their angles change by ${x}° in the mean.`, "Place landmarks, or try another example."],
  [/^the edit turns some faces over/, () => "A point was dragged too far for a few quads beside it: they are turned over.", "Drag it less, or the points beside it, too."],
  [/^angles change by (\S+)°/, (x) => `Some quads are sheared, the worst by ${Math.round(x)}° or more.`, "Place landmarks, or look at the heat map of angles."],
  [/^before its faces were smoothed/, () => "The quads had to be pulled far to fit.", "Try another example."],
  [/^the share (\S+) of the input has no face near it/, (x) => `${percent(x)} of the scan has no quads on it.`, "Choose an example that reaches as far, or let its rows go on to where the scan ends."],
  [/^the share (\S+) of the input's features/, () => "The scan has forms that the example lacks, ears perhaps.", "Try another example."],
  [/^(\S+) edges cut through the scan/, (x) => `${x} edges run through the scan or leap over a gap.`, "Try another example, or cut apart what touches on the scan."],
  [/^a spike/, () => "A vertex sticks out far from its neighbours.", "Place landmarks, or try another example."],
  [/^the quads end before the scan does: (\S+) % of it/, (x) => `Limbs of the scan, or their ends, have no quads: ${x} % of it.`, "Choose an example with such limbs, or mark their ends with landmarks."],
  [/of the quads' area hangs off the scan/, () => "Some quads hang off the scan.", "Try another example."],
  [/of the scan that should be covered/, () => "Some of the scan that should be covered is bare.", "Try another example."],
  [/of the quads' area is inside out/, () => "Some quads are inside out.", "Try another example."],
  [/have collapsed/, () => "Some quads have collapsed to lines.", "Try another example."],
  [/^the scan has nothing for (\S+) %/, (x) => `The scan lacks ${x} % of what the example has: those quads are spanned flat.`, ""],
  [/^landmark (\d+) is met but for/, (x) => `Landmark ${x} could not be met exactly.`, ""],
  [/^landmark `(.+)` is met but for/, (x) => `The landmark ${x} could not be met exactly.`, ""],
  [/is met but for/, () => "A landmark could not be met exactly.", ""],
  [/^examples make up (\S+) %/, (x) => `Examples make up ${x} % of it; the rest is regular layouts.`, "Add examples for the bare parts."],
  [/^faces were extruded along (.+) of the scan/, (parts) => `Quads were added along ${parts} of the scan that the example lacks, such as a horn or a tail.`, "Look at where they begin."],
  [/rows of quads (would|can't)/, () => "Some of the scan stays bare: rows of quads can't go on there.", "Choose an example that reaches as far."],
  [/smaller parts of the scan are left bare/, () => "Only the largest piece of the scan has quads.", "Clean the scan, or cut it into parts."],
  [/best map is poor|best maps are poor/, () => "Some parts took regular layouts: no example fitted them well.", "Choose an example for the part yourself."],
  [/regular layout/, () => "Some parts are regular layouts.", ""],
];

// { text, help, raw }: `raw` is what the service said, for the details; `nameOf` tells what a part is called.
export function reason(raw, nameOf) {
  const [, of = "", rest = raw] = /^segment (\d+): (.*)$/.exec(raw) ?? [];
  const where = of ? `${nameOf(Number(of))}: ` : "";
  for (const [pattern, text, help] of REASONS) {
    const found = pattern.exec(rest);
    if (found) return { text: where + text(found[1]), help, raw };
  }
  return { text: `${where}${rest.charAt(0).toUpperCase()}${rest.slice(1)}.`, help: "", raw };
}

// Says in one line each what the reasons are; those that say the same stand once.
export function reasons(list, nameOf) {
  const said = new Map();
  for (const raw of list) { const told = reason(raw, nameOf); if (!said.has(told.text)) said.set(told.text, told); }
  return [...said.values()];
}

export const SURFACES = { disc: "open", annulus: "a tube", sphere: "closed", torus: "a ring" };

// A closed scan, say, can't take the quads of an open example: why a corpus that is not empty has nothing for a scan.
export function mismatch(topology, others) {
  const has = others.filter(Boolean).map((t) => ({ disc: "open ones", annulus: "tubes", sphere: "closed ones", torus: "rings" })[t]);
  const what = { disc: "This scan is open, with one rim", annulus: "This scan is a tube, with two rims", sphere: "This scan is closed", torus: "This scan is a ring" }[topology];
  const way = topology === "sphere" ? "Open the scan where the examples end (at the neck of a head, say), cut it into parts, or add a closed example." : "Close the scan's other holes, cut it into parts, or add an example that ends as the scan does.";
  return `${what}, and the corpus has no such examples${has.length ? `, only ${has.join(" and ")}` : ""}. ${way}`;
}

// Why an example that ends otherwise than the scan fits poorly: null where both end alike.
export function unlike(scan, example) {
  if (!scan || !example || scan === example) return null;
  if (scan === "sphere") return { text: `The scan is closed, and this example is ${example === "disc" ? "open" : SURFACES[example]}.`, help: "Open the scan where the example ends (at the neck of a head, say), or add a closed example." };
  return { text: `The scan is ${SURFACES[scan]}, and this example is ${SURFACES[example]}.`, help: "Let both end at the same places: close holes of the scan, or add an example that ends as it does." };
}

// Steps of density, by how often rows and columns are doubled.
export const DENSITIES = { "-1": "coarser", 0: "as the example", 1: "4 times the quads", 2: "16 times the quads" };

export const STATES = { refining: "being compared", locked: "passed over", done: "compared in full" };
export const ENDS = { done: "Done", cancelled: "Cancelled", failed: "Failed", deadline: "Stopped by its deadline" };
