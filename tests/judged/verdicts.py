#!/usr/bin/env python3
"""Whether verdicts on maps are right, over all sets with a truth, with limits that were chosen without the family they are tried on.

    verdicts.py DIR…

DIR: what `judged.py --out DIR` wrote for groundtruth, unseen, extents, cross, species, and unlike. A map is right whose median is at
most 2.5 % and its p95 10 %, or m at most .10, or the agreement of parts at least .95; of `unlike` none is right.

A family is what an example shows: a species, heads, hands, bodies. Limits of agreement are chosen on the maps of all other families:
the lowest from which good maps are right to 97 %, and the highest below which poor maps are wrong to 80 %. Needs nothing beside Python.
"""

import json
import pathlib
import sys

GOOD, POOR = 0.97, 0.8
# Limits of agreement as the service has them for closed examples on parts and on open scans, and what it says of a map that falls short
# of the first. Open ones need .1; no map of an open example in these sets lies between. One closed surface on another needs a
# confidence of -.4 instead (pipeline/rested).
SERVED = (0.4, -0.08)
OF_AGREEMENT = "bumps and hollows"
WORDS = ("good", "fair", "poor", "broken")
SAME_FAMILY = {"mhhead": "head", "icthead": "head", "ict": "head", "mh": "head", "mask": "head", "bust": "head", "chin": "head", "head": "head",
               "mhbody": "body", "mhpose": "body", "shin": "body", "mhhand": "hand", "forearm": "hand"}


def note(out, name, example, scan, is_right, answer):
    """Adds a map to what `report` reads; maps that were refused have no verdict and are left out."""
    if answer.get("verdict") not in WORDS:
        return
    row = {"set": name, "example": example, "scan": scan, "right": is_right, "verdict": answer["verdict"],
           "reasons": answer.get("reasons") or [], "agreement": (answer.get("evidence") or {}).get("agreement")}
    with open(out / "verdicts.jsonl", "a") as file:
        file.write(json.dumps(row) + "\n")


def is_right(judged):
    """Whether a map of a known truth lies right, by what a judge says of it; a map without a mesh does not."""
    if "median_pct" in judged:
        return judged["median_pct"] <= 2.5 and judged["p95_pct"] <= 10
    if "m" in judged:
        return judged["m"] is not None and judged["m"] <= 0.1
    return judged.get("agree", 0) >= 0.95


def family(row):
    words = [word for word in row["example"].removeprefix("example_").removeprefix("quads_").split("_") if word not in ("animal", "truth")]
    return SAME_FAMILY.get(words[0], words[0])


def share(rows, right=True):
    return sum(row["right"] == right for row in rows) / len(rows) if rows else None


def limits_of(rows):
    """The limits of agreement from which a map is good, and fair, by the maps whose agreement is told."""
    told = sorted((row for row in rows if row["agreement"] is not None), key=lambda row: row["agreement"])
    values = [row["agreement"] for row in told]
    good = next((values[k] for k in range(len(told)) if share(told[k:]) >= GOOD), float("inf"))
    fair = next((values[k] for k in reversed(range(1, len(told))) if share(told[:k], False) >= POOR), float("-inf"))
    return max(good, fair), fair


def verdict_by(limits, row):
    """The verdict with other limits of agreement: what else was found wanting (folds, spans, gaps) counts as it did."""
    if row["agreement"] is None or row["verdict"] == "broken":
        return row["verdict"]
    lacks_else = any(not reason.startswith(OF_AGREEMENT) for reason in row["reasons"])
    beside = "good" if not lacks_else else "poor" if row["verdict"] == "poor" and row["agreement"] >= SERVED[1] else "fair"
    by_agreement = WORDS[sum(row["agreement"] < limit for limit in limits)]
    return max(beside, by_agreement, key=WORDS.index)


def print_verdicts(head, rows, verdicts):
    print(f"\n{head}\n\n| verdict | maps | right | share right |\n|---|---|---|---|")
    for word in WORDS:
        of = [row for row, verdict in zip(rows, verdicts) if verdict == word]
        print(f"| {word} | {len(of)} | {sum(row['right'] for row in of)} | {'–' if not of else f'{100 * share(of):.1f} %'} |")
    right = [verdict for row, verdict in zip(rows, verdicts) if row["right"]]
    kept = sum(verdict in ("good", "fair") for verdict in right)
    print(f"\n{kept} of the {len(right)} right ones are good or fair ({100 * kept / max(len(right), 1):.1f} %).")


def report(folders):
    # A map that was judged twice counts as it was judged last.
    judged = {}
    for folder in folders:
        for path in sorted(pathlib.Path(folder).glob("**/verdicts.jsonl")):
            rows = map(json.loads, path.read_text().splitlines())
            judged.update(((row["set"], row["example"], row["scan"]), row) for row in rows)
    rows = list(judged.values())
    if not rows:
        sys.exit("no verdicts there: run judged.py with the sets that have a truth, and give its --out")
    print_verdicts("As delivered", rows, [row["verdict"] for row in rows])
    families = sorted(set(map(family, rows)))
    limits = {name: limits_of([row for row in rows if family(row) != name]) for name in families}
    print_verdicts("With limits chosen without the family", rows, [verdict_by(limits[family(row)], row) for row in rows])
    print("\n| family left out | maps | good from | fair from |\n|---|---|---|---|")
    for name in families:
        good, fair = limits[name]
        print(f"| {name} | {sum(family(row) == name for row in rows)} | {good:.3f} | {fair:.3f} |")


if __name__ == "__main__":
    report(sys.argv[1:])
