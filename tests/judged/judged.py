#!/usr/bin/env python3
"""Judges Quadmuse on the shared meshes: one table a set, in Markdown.

    judged.py SET[:PREFIX]… [--programs DIR] [--shared DIR] [--out DIR] [--without STAGE,…]

Sets: scans (retopo with the shared corpus), made (the same of scans that are made of shared meshes, without examples of their
family), flawed (shared scans with a triangle gone, openings, tiny handles, noise), extents, cross, species, unseen, groundtruth
(one example onto one input), unlike (the same of another kind: a hand onto a head, none of which can be right), kinds (which kind of
example comes first for busts, masks, heads and hands, open and closed), landmarks (maps that are wrong by themselves, before and after up to
five landmarks).
PREFIX limits a set to rows whose name begins with it. DIR of --programs has quadmuse and quadmuse-server (default:
target/release). Needs numpy and scipy. Starts a server of its own on a free port. Results, maps and pictures stay in --out.
"""

import argparse
import csv
import json
import os
import pathlib
import re
import subprocess
import sys
import time

import verdicts

ROOT = pathlib.Path(__file__).resolve().parents[2]
TICKS = os.sysconf("SC_CLK_TCK")


class Service:
    """A server on a free port, and the client that talks to it."""

    def __init__(self, programs, folder, without=None):
        self.client = str(programs / "quadmuse")
        log = open(folder / "server.log", "w")
        command = [programs / "quadmuse-server", "serve", "--data", folder / "data", "--listen", "127.0.0.1:0", *(["--without", without] if without else [])]
        self.server = subprocess.Popen(command, stdout=log, stderr=log)
        for _ in range(300):
            found = re.search(r'"address":"(127[0-9.:]*)', (folder / "server.log").read_text())
            if found:
                break
            time.sleep(0.1)
        self.url = f"http://{found[1]}"

    def run(self, *arguments):
        """Runs the client; answers with its last line of JSON and its complaints."""
        command = [self.client, "--server", self.url, "--json", *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        lines = done.stdout.strip().splitlines()
        try:
            answer = json.loads(lines[-1]) if lines else {}
        except json.JSONDecodeError:
            answer = {}
        return answer, done.stderr.strip()

    def seconds(self):
        """Processor seconds of the server until now."""
        fields = pathlib.Path(f"/proc/{self.server.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICKS

    def stop(self):
        self.server.terminate()
        self.server.wait()


def rows_of(path):
    with open(path) as file:
        return list(csv.DictReader(file))


def print_table(head, rows):
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join("–" if value is None else str(value) for value in row) + " |")


def mean(values):
    values = [value for value in values if value is not None]
    return round(sum(values) / len(values), 3) if values else None


def inspired_share(answer):
    """The share of the scan that has an example's quads; rows that continue a map beyond its example are not counted."""
    covered = (answer.get("covers") or {}).get("input") or 1
    return covered if "faces" in answer and answer.get("inspired") else (answer.get("inspired") or 0) * covered


def shared_corpus(meshes):
    rows = rows_of(meshes / "quads/manifest.csv")
    return [meshes / "quads" / row["file"] for row in rows if row["category"] not in ("cloth", "hair")]


def add_shared(service, meshes):
    service.run("add", *shared_corpus(meshes))


def judge_scans(service, meshes, out, prefix):
    """Retopology of all scans with the shared corpus; the mean of the inspired share is the figure."""
    add_shared(service, meshes)
    table = []
    for row in rows_of(meshes / "scans/manifest.csv"):
        name = row["file"]
        stem = name.rsplit(".", 1)[0]
        if not name.startswith(prefix):
            continue
        before, begun = service.seconds(), time.time()
        mesh, picture = out / f"{stem}.obj", out / f"{stem}.png"
        answer, problem = service.run("retopo", meshes / "scans" / name, "-o", mesh, "--force", "--picture", picture)
        took, used = time.time() - begun, service.seconds() - before
        (out / f"{stem}.json").write_text(json.dumps(answer, indent=1) + "\n" + problem)
        share = inspired_share(answer)
        judged = {}
        if mesh.exists():
            import judge

            vertices, faces = judge.load(mesh)
            judged = judge.mesh_report(vertices, faces)
            judged.update(judge.distance(vertices, faces, *judge.load(meshes / "scans" / name)))
        example = answer.get("example") or answer.get("name") or ""
        row = [stem, answer.get("verdict", "refused"), round(share, 3), example, judged.get("quads"), judged.get("extraordinary"),
               judged.get("angle_deviation_mean_deg"), judged.get("angle_deviation_p95_deg"), *far(judged), round(took, 1), round(used, 1)]
        table.append(row)
        print("|", *row, file=sys.stderr, flush=True)
    head = ["scan", "verdict", "inspired", "example", "quads", "extraordinary", "angle °", "p95 °", "to scan p95 %", "from scan p95 %", "s", "processor s"]
    print_table(head, table)
    print(f"\nscans: {len(table)}, inspired {mean([row[2] for row in table])}, seconds {mean([row[-2] for row in table])}, processor seconds {mean([row[-1] for row in table])}")


def judge_flawed(service, meshes, out, prefix):
    """Retopology of scans with flaws, with the shared corpus: none should come to less than it does without."""
    import flawed

    add_shared(service, meshes)
    table = []
    for path in flawed.make(meshes, out / "flawed"):
        if not path.stem.startswith(prefix):
            continue
        before = service.seconds()
        answer, problem = service.run("retopo", path, "-o", out / path.name, "--force", "--picture", out / f"{path.stem}.png")
        (out / f"{path.stem}.json").write_text(json.dumps(answer, indent=1) + "\n" + problem)
        share = inspired_share(answer)
        reasons = "; ".join(answer.get("reasons") or [problem])[:80]
        table.append([*path.stem.split("_"), answer.get("verdict", "refused"), round(share, 3), round(service.seconds() - before, 1), reasons])
        print("|", *table[-1], file=sys.stderr, flush=True)
    print_table(["scan", "flaw", "verdict", "inspired", "processor s", "reasons"], table)
    for flaw in dict.fromkeys(row[1] for row in table):
        print(f"\n{flaw}: inspired {mean([row[3] for row in table if row[1] == flaw])}")


def judge_made(service, meshes, out, prefix):
    """Retopology of scans that are cut, seen from one side, or on a rock, with the shared corpus but for their own family."""
    import made

    families = sorted({*made.INPUTS, *made.STANDING})
    by_tags = {}
    for path in shared_corpus(meshes):
        tags = tuple(f"not_{family}" for family in families if not any(part in path.name for part in made.kept_from(family)))
        by_tags.setdefault(tags, []).append(path)
    for tags, files in by_tags.items():
        service.run("add", *files, *[word for tag in tags for word in ("--tag", tag)])
    table = []
    for path in made.make(meshes, out / "made"):
        name, kind = path.stem.rsplit("_", 1)
        if not path.stem.startswith(prefix):
            continue
        before = service.seconds()
        answer, problem = service.run("retopo", path, "-o", out / path.name, "--force", "--picture", out / f"{path.stem}.png", "--tag", f"not_{name}")
        (out / f"{path.stem}.json").write_text(json.dumps(answer, indent=1) + "\n" + problem)
        share = inspired_share(answer)
        reasons = "; ".join(answer.get("reasons") or [problem])[:80]
        table.append([path.stem, kind, answer.get("verdict", "refused"), round(share, 3), round(service.seconds() - before, 1), reasons])
        print("|", *table[-1], file=sys.stderr, flush=True)
    print_table(["scan", "kind", "verdict", "inspired", "processor s", "reasons"], table)
    for kind in dict.fromkeys(row[1] for row in table):
        of = [row for row in table if row[1] == kind]
        print(f"\n{kind}: {len(of)}, inspired {mean([row[3] for row in of])}, processor seconds {mean([row[4] for row in of])}")


def far(judged):
    """The distances within which 95 % of the result lies from the scan, and of the scan from the result."""
    return [judged.get(way, {}).get("p95") for way in ("out_to_scan_pct", "scan_to_out_pct")]


def mapped(service, example, scan, out, tag, *options):
    """Maps one example onto one input; answers with the resource, the files, seconds and what went wrong."""
    mesh, kept = out / f"{tag}.obj", out / f"{tag}.kept"
    for stale in (mesh, kept):
        stale.unlink(missing_ok=True)
    # An example that is there keeps the tag that it came with.
    added, problem = service.run("add", example, "--whole-only", "--tag", example.stem)
    there = service.run("show", added.get("id", example.stem))[0]
    query, more = service.run("query", scan, "--tag", (there.get("tags") or [example.stem])[0], "--top", 1, "--segments", "whole")
    before = service.seconds()
    answer, most = service.run("map", query.get("query", "@last"), added.get("id", example.stem), "-o", mesh, "--force", "--kept", kept, *options)
    used = service.seconds() - before
    (out / f"{tag}.json").write_text(json.dumps(answer, indent=1) + "\n" + "\n".join([problem, more, most]))
    return answer, mesh if mesh.exists() else None, kept if kept.exists() else None, used, (most or more or problem).splitlines()[-1:]


def is_shown(prefix, *names):
    return any(name.startswith(prefix) for name in names)


def judge_pairs(service, meshes, out, prefix, folder):
    """Pairs with a truth for each vertex: extents, unseen, groundtruth."""
    import judge
    import judge_extents
    import numpy

    table = []
    for number, row in enumerate(rows_of(meshes / folder / "pairs.csv")):
        tag = f"{folder}-{row['kind']}-{number}"
        if not is_shown(prefix, row["kind"], row["example"]):
            continue
        at = meshes / folder
        answer, mesh, kept, used, problem = mapped(service, at / row["example"], at / row["input"], out, tag)
        judged = {}
        if mesh:
            vertices, faces = judge_extents.read(mesh)
            true_vertices, true_faces = judge_extents.read(at / row["truth"])
            numbers = numpy.loadtxt(kept).astype(int) if kept and answer.get("kept") is not None else None
            own = len(true_vertices) if numbers is None else len(numbers)
            inside = numpy.loadtxt(at / row["inside"]).astype(bool) if "inside" in row else numpy.ones(len(true_vertices), bool)
            judged = judge_extents.report(vertices[:own], true_vertices, true_faces, inside, numbers)
        cells = [row["kind"], row["example"].removeprefix("example_").removesuffix(".obj"), answer.get("verdict"), judged.get("median_pct"),
                 judged.get("p95_pct"), judged.get("missing"), round(used, 1), "; ".join(answer.get("reasons") or problem)[:100]]
        verdicts.note(out, folder, row["example"], row["input"], verdicts.is_right(judged), answer)
        table.append(cells)
        print("|", *cells, file=sys.stderr, flush=True)
    print_table(["kind", "pair", "verdict", "median %", "p95 %", "missing", "processor s", "reasons"], table)
    print("\n| kind | pairs | mean median % | worst median % | mean p95 % | verdicts | processor s |\n|---|---|---|---|---|---|---|")
    for kind in dict.fromkeys(row[0] for row in table):
        of = [row for row in table if row[0] == kind]
        medians = [row[3] for row in of if row[3] is not None]
        words = " ".join(f"{word} {[row[2] for row in of].count(word)}" for word in dict.fromkeys(row[2] for row in of))
        print(f"| {kind} | {len(of)} | {mean(medians)} | {max(medians, default=None)} | {mean([row[4] for row in of])} | {words} | {mean([row[6] for row in of])} |")


def judge_cross(service, meshes, out, prefix):
    """Heads of two families onto each other, by named points: m is asked at most .075 in the mean, .15 at worst."""
    import judge_cross
    import judge_extents
    import numpy

    table = []
    for family, other in (("mh", "ict"), ("ict", "mh")):
        for i in range(4):
            for j in range(4):
                example, scan = f"{family}_{i:02}", f"{other}_{j:02}"
                if not is_shown(prefix, example):
                    continue
                tag = f"cross-{example}-{scan}"
                at = meshes / "cross"
                answer, mesh, kept, used, problem = mapped(service, at / f"{example}.obj", at / f"input_{scan}.ply", out, tag)
                judged = {}
                if mesh:
                    numbers = numpy.loadtxt(kept).astype(int) if kept and answer.get("kept") is not None else None
                    judged = judge_cross.report(judge_extents.read(mesh)[0], family, scan, numbers)
                cells = [example, scan, answer.get("verdict"), judged.get("m"), judged.get("worst"), judged.get("missing"), round(used, 1)]
                verdicts.note(out, "cross", example, scan, verdicts.is_right(judged), answer)
                table.append(cells)
                print("|", *cells, *problem, file=sys.stderr, flush=True)
    print_table(["example", "scan", "verdict", "m", "worst point", "points missing", "processor s"], table)
    ms = [row[3] for row in table if row[3] is not None]
    print(f"\ncross: {len(table)} maps, mean m {mean(ms)}, worst {max(ms, default=None)}, processor seconds {mean([row[-1] for row in table])}")


def judge_species(service, meshes, out, prefix):
    """Animals onto each other, by named parts: agreement is asked at least .85 in the mean without trex."""
    import judge_extents
    import judge_species

    at = meshes / "species"
    species = sorted(path.stem.removeprefix("quads_") for path in at.glob("quads_*.obj"))
    table = []
    for example in species:
        for scan in species:
            if example == scan or not is_shown(prefix, example):
                continue
            answer, mesh, kept, used, problem = mapped(service, at / f"quads_{example}.obj", at / f"input_{scan}.ply", out, f"species-{example}-{scan}")
            agree = legs = None
            if mesh:
                vertices, faces = judge_extents.read(mesh)
                labels = (at / f"labels_{example}.txt").read_text().split()
                if kept and answer.get("kept") is not None:
                    labels = [labels[int(line)] for line in kept.read_text().split()]
                placed, _ = judge_extents.read(at / f"placed_{scan}.obj")
                own = len(labels)
                faces = [face for face in faces if max(face) < own]
                judged = judge_species.report(vertices[:own], faces, labels, placed, (at / f"labels_{scan}.txt").read_text().split())
                agree, legs = judged["agree"], judged["legs"]
            cells = [example, scan, answer.get("verdict"), agree, legs, round(used, 1)]
            verdicts.note(out, "species", example, scan, verdicts.is_right({"agree": agree or 0}), answer)
            table.append(cells)
            print("|", *cells, *problem, file=sys.stderr, flush=True)
    print_table(["example", "scan", "verdict", "agreement", "legs", "processor s"], table)
    known = [row for row in table if "trex" not in row[:2]]
    print(f"\nspecies: {len(table)} maps; without trex mean agreement {mean([row[3] for row in known])}, {sum((row[3] or 0) >= .96 for row in known)} of {len(known)} at least .96")


def judge_unlike(service, meshes, out, prefix):
    """Examples onto inputs of another kind: no map is right, so each is asked to be poor or broken."""
    import collections

    # Four limbs and a head are so on bodies, quadrupeds and birds: whether those maps are right is a matter of opinion.
    kinds = {
        "head": ([meshes / "cross/mh_00.obj", meshes / "cross/ict_02.obj"], [meshes / "cross/input_mh_03.ply", meshes / "cross/input_ict_01.ply"]),
        "limbs": ([meshes / "species/quads_cow.obj", *unseen(meshes, "mhbody_31", "example")], [meshes / "species/input_pig.ply", *unseen(meshes, "mhbody_31", "input"), *unseen(meshes, "animal_eagle_31", "input")]),
        "hand": (unseen(meshes, "mhhand_31", "example"), unseen(meshes, "mhhand_31", "input")),
        "dolphin": (unseen(meshes, "animal_dolphin_31", "example"), unseen(meshes, "animal_dolphin_31", "input")),
    }
    table = []
    for kind, (examples, _) in kinds.items():
        for example in examples:
            for other, (_, scans) in kinds.items():
                for scan in scans if other != kind else []:
                    # A body has a head, and there a head belongs.
                    if not is_shown(prefix, kind, example.stem) or kind == "head" and "mhbody" in scan.stem:
                        continue
                    answer, _, _, used, problem = mapped(service, example, scan, out, f"unlike-{example.stem}-{scan.stem}")
                    verdicts.note(out, "unlike", example.stem, scan.stem, False, answer)
                    table.append([example.stem, scan.stem, answer.get("verdict"), (answer.get("evidence") or {}).get("agreement"), round(used, 1)])
                    print("|", *table[-1], *problem, file=sys.stderr, flush=True)
    print_table(["example", "scan", "verdict", "agreement", "processor s"], table)
    print(f"\nunlike: {len(table)} maps, {dict(collections.Counter(str(row[2]) for row in table))}")


# What an example of the shared corpus is called that is of a kind.
KINDS = {"head": ("head", "bust", "face"), "hand": ("hand",)}


def kinds_queries(meshes, folder):
    """Scans whose kind is known: its name, the kind, and the file. Closed ones are made here."""
    import flawed
    import judge
    from made import write

    folder.mkdir(parents=True, exist_ok=True)
    extents = [row for row in rows_of(meshes / "extents/pairs.csv") if row["kind"] in ("bust", "chin", "mask")]
    yield from ((row["kind"], "head", meshes / "extents" / row["input"]) for row in extents)
    cross = sorted((meshes / "cross").glob("input_*.ply"))
    hands = [meshes / "unseen" / row["input"] for row in rows_of(meshes / "unseen/pairs.csv") if row["kind"] == "hand"]
    for kind, files in (("head", cross), ("hand", hands)):
        for file in files:
            yield kind, kind, file
            closed = folder / f"{file.stem}_closed.obj"
            if not closed.exists():
                vertices, faces = judge.load(file)
                write(closed, *flawed.capped(vertices, judge.triangles(faces)))
            yield f"closed {kind}", kind, closed


def judge_kinds(service, meshes, out, prefix):
    """Whether an example of the query's kind comes first, among all of the shared corpus: asked is .95."""
    add_shared(service, meshes)
    table = []
    for name, kind, file in kinds_queries(meshes, out / "kinds"):
        if not is_shown(prefix, name, file.stem):
            continue
        before = service.seconds()
        query, problem = service.run("query", file, "--top", 3)
        ranking, _ = service.run("ranking", query.get("query", "@last"), "--segment", 0)
        first = next((entry["name"] for entry in ranking.get("entries", [])), problem)
        is_right = any(word in first for word in KINDS[kind])
        table.append([name, file.stem, first, "yes" if is_right else "no", round(service.seconds() - before, 1)])
        print("|", *table[-1], file=sys.stderr, flush=True)
    print_table(["query", "scan", "first", "of its kind", "processor s"], table)
    for name in dict.fromkeys(row[0] for row in table):
        of = [row for row in table if row[0] == name]
        print(f"\n{name}: {sum(row[3] == 'yes' for row in of)} of {len(of)}")


def judge_landmarks(service, meshes, out, prefix):
    """Maps that are wrong by themselves, before and after up to five landmarks."""
    import judge_extents
    import landmarks

    table = []
    for kind in (landmarks.faces, landmarks.hands, landmarks.animals):
        for example, scan, pairs, judged in kind(meshes):
            if not is_shown(prefix, kind.__name__, example.stem):
                continue
            tag = f"landmarks-{example.stem}-{scan.stem}"
            file = out / f"{tag}.json"
            file.write_text(json.dumps(pairs))
            cells = [example.stem, scan.stem, len(pairs)]
            for way, options in (("by-itself", []), ("with", ["--landmarks", file])):
                picture = ["--picture", out / f"{tag}-{way}.png"]
                answer, mesh, kept, used, problem = mapped(service, example, scan, out, f"{tag}-{way}", *options, *picture)
                figure = None
                if mesh:
                    vertices, _ = judge_extents.read(mesh)
                    own = len(judge_extents.read(example)[0])
                    numbers = [int(line) for line in kept.read_text().split()] if kept and answer.get("kept") is not None else range(own)
                    figure = judged(vertices[: len(numbers)], list(numbers))
                cells += [figure, answer.get("verdict", *problem), round(used, 1)]
            table.append(cells)
            print("|", *cells, file=sys.stderr, flush=True)
    ways = [f"{what} {way}" for way in ("before", "after") for what in ("figure", "verdict", "processor s")]
    print_table(["example", "scan", "landmarks", *ways], table)


def unseen(meshes, name, side):
    """The example or the input of the first pair of a set of `unseen`."""
    return next([meshes / "unseen" / row[side]] for row in rows_of(meshes / "unseen/pairs.csv") if row["set"] == name)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", metavar="SET[:PREFIX]")
    parser.add_argument("--programs", type=pathlib.Path, default=ROOT / "target/release")
    parser.add_argument("--shared", type=pathlib.Path, default=pathlib.Path(os.environ.get("QUADMUSE_SHARED", ROOT.parent / "shared")))
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("judged"))
    parser.add_argument("--without", help="stages of the computation that are left out, as `quadmuse-server --help` tells them")
    arguments = parser.parse_args()
    meshes = arguments.shared / "meshes"
    if not meshes.is_dir():
        sys.exit(f"no meshes at {meshes}: set QUADMUSE_SHARED, or give --shared")
    sys.path.insert(0, str(arguments.shared / "eval"))
    for asked in arguments.sets:
        name, _, prefix = asked.partition(":")
        out = arguments.out / name
        out.mkdir(parents=True, exist_ok=True)
        service = Service(arguments.programs, out, arguments.without)
        try:
            print(f"\n## {name}\n", flush=True)
            if name == "scans":
                judge_scans(service, meshes, out, prefix)
            elif name == "flawed":
                judge_flawed(service, meshes, out, prefix)
            elif name == "kinds":
                judge_kinds(service, meshes, out, prefix)
            elif name == "landmarks":
                judge_landmarks(service, meshes, out, prefix)
            elif name == "made":
                judge_made(service, meshes, out, prefix)
            elif name == "cross":
                judge_cross(service, meshes, out, prefix)
            elif name == "species":
                judge_species(service, meshes, out, prefix)
            elif name == "unlike":
                judge_unlike(service, meshes, out, prefix)
            elif name in ("extents", "unseen", "groundtruth"):
                judge_pairs(service, meshes, out, prefix, name)
            else:
                sys.exit(f"no set is called {name}")
        finally:
            service.stop()


if __name__ == "__main__":
    main()
