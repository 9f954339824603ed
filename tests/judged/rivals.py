#!/usr/bin/env python3
"""Compares Quadmuse with Instant Meshes and QuadriFlow on the shared scans, at the same count of quads: one table, in Markdown.

    rivals.py [SCAN…] [--programs DIR] [--shared DIR] [--out DIR] [--venv DIR] [--seconds N]

SCAN is the beginning of a scan's file name; without any, all scans are taken. DIR of --programs has quadmuse and
quadmuse-server (default: target/release). The rivals come from their Python packages, which are installed, with numpy and
scipy, into a virtual environment of their own (default: target/rivals).

Quadmuse runs first, without examples and at its own density; the others are asked for as many quads as that gave. A corpus
with nothing in it is refused, so one torus stands in the corpus without examples, which is laid on tori alone. One program of
the shared folder measures all results. Seconds are those of the processor: of a rival around the call alone, of
Quadmuse all that the server used, reading and writing included. Results stay in --out.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time

from judged import ROOT, Service, mean, print_table, rows_of

PACKAGES = {"numpy": "numpy", "scipy": "scipy", "pynanoinstantmeshes": "pynanoinstantmeshes", "pyQuadriFlow": "pyquadriflow"}
RIVALS = ("Instant Meshes", "QuadriFlow")
HEAD = ["scan", "triangles", "program", "verdict", "quads", "other faces", "extraordinary / 1,000", "angle °", "p95 °",
        "to scan mean / p95 %", "from scan mean / p95 %", "processor s"]


def instant_meshes(vertices, faces, quads):
    """Asks for a fourth of the vertices: each face of its first mesh is split around its middle, to be rid of triangles."""
    import numpy
    import pynanoinstantmeshes

    at, of = numpy.asarray(vertices, numpy.float32), numpy.asarray(faces, numpy.uint32)
    begun = time.process_time()
    vertices, faces = pynanoinstantmeshes.remesh(at, of, max(quads // 4, 8), deterministic=True)
    return vertices.tolist(), faces.tolist(), time.process_time() - begun


def quadriflow(vertices, faces, quads):
    """Keeps boundaries, and all else as the package leaves it."""
    from pyQuadriFlow.pyQuadriFlow import pyquadriflow

    begun = time.process_time()
    made = pyquadriflow(quads, 0, vertices, faces, False, True, False, False, False)
    return made["vertices"], made["faces"], time.process_time() - begun


def remesh(rival, scan, quads, out):
    """Runs a rival in this process, and writes its mesh, and its processor seconds beside it."""
    import judge

    vertices, faces = judge.load(scan)
    triangles = [[face[0], face[k], face[k + 1]] for face in faces for k in range(1, len(face) - 1)]
    run = instant_meshes if rival == "Instant Meshes" else quadriflow
    vertices, faces, used = run(vertices.tolist(), triangles, quads)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    out.write_text("\n".join(lines) + "\n")
    out.with_suffix(".seconds").write_text(str(used))


def measured(scan, mesh):
    """The cells of a row from the count of quads to the distances; none of them where there is no mesh."""
    import judge

    if not mesh.exists():
        return [None] * 7
    vertices, faces = judge.load(mesh)
    found = judge.mesh_report(vertices, faces)
    found.update(judge.distance(vertices, faces, *scan))
    ways = [found[way] for way in ("out_to_scan_pct", "scan_to_out_pct")]
    per_thousand = round(1000 * found["extraordinary"] / max(found["faces"], 1), 1)
    return [found["quads"], found["triangles"] + found["other"], per_thousand, found["angle_deviation_mean_deg"],
            found["angle_deviation_p95_deg"], *[f"{way['mean']} / {way['p95']}" for way in ways]]


def by_quadmuse(service, scan, mesh, *wishes):
    """Retopology of a scan; answers with the verdict, or the complaint, and the processor seconds of the server."""
    mesh.unlink(missing_ok=True)
    before = service.seconds()
    answer, problem = service.run("retopo", scan, "-o", mesh, "--force", *wishes)
    mesh.with_suffix(".json").write_text(json.dumps(answer, indent=1) + "\n" + problem)
    return answer.get("verdict") or (problem.splitlines() or ["nothing"])[-1][:60], service.seconds() - before


def by_rival(rival, shared, scan, quads, mesh, seconds):
    """The same by a rival, in a process of its own, which may crash or take too long."""
    for stale in (mesh, mesh.with_suffix(".seconds")):
        stale.unlink(missing_ok=True)
    command = [sys.executable, __file__, "--shared", shared, "--remesh", rival, scan, str(quads), mesh]
    try:
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        return f"not within {seconds} s", None
    if done.returncode or not mesh.exists():
        return f"failed ({done.returncode})", None
    return "–", float(mesh.with_suffix(".seconds").read_text())


def compare(arguments, meshes):
    """Prints a row a scan and program, then the means of each program over the scans on which all of them had a result."""
    import judge

    services = {}
    for name in ("none", "corpus"):
        folder = arguments.out / name
        folder.mkdir(parents=True, exist_ok=True)
        services[name] = Service(arguments.programs, folder)
    try:
        services["none"].run("add", meshes / "quads/osd_torus.obj")
        names = [row["file"] for row in rows_of(meshes / "quads/manifest.csv") if row["category"] not in ("cloth", "hair")]
        services["corpus"].run("add", *[meshes / "quads" / name for name in names])
        table = []
        for row in rows_of(meshes / "scans/manifest.csv"):
            if arguments.scans and not row["file"].startswith(tuple(arguments.scans)):
                continue
            path, stem = meshes / "scans" / row["file"], row["file"].rsplit(".", 1)[0]
            scan = judge.load(path)
            mesh = arguments.out / f"{stem}-none.obj"
            said, used = by_quadmuse(services["none"], path, mesh)
            own = measured(scan, mesh)
            quads = own[0] or 4000
            rows = [["Quadmuse, no example", said, *own, round(used, 1)]]
            mesh = arguments.out / f"{stem}-corpus.obj"
            said, used = by_quadmuse(services["corpus"], path, mesh, "--quads", quads)
            rows.append(["Quadmuse, shared corpus", said, *measured(scan, mesh), round(used, 1)])
            for rival in RIVALS:
                mesh = arguments.out / f"{stem}-{rival.replace(' ', '')}.obj"
                said, used = by_rival(rival, arguments.shared, path, quads, mesh, arguments.seconds)
                rows.append([rival, said, *measured(scan, mesh), None if used is None else round(used, 1)])
            table += [[stem, len(scan[1]), *cells] for cells in rows]
            for cells in rows:
                print("|", stem, *cells, file=sys.stderr, flush=True)
    finally:
        for service in services.values():
            service.stop()
    print_table(HEAD, table)
    failed = {row[0] for row in table if row[4] is None}
    alike = [row for row in table if row[0] not in failed]
    print(f"\nMeans over the {len({row[0] for row in alike})} scans on which all had a result:\n")
    summary = []
    for program in dict.fromkeys(row[2] for row in table):
        of = [row for row in alike if row[2] == program]
        ways = [mean([float(row[at].split(" / ")[0]) for row in of]) for at in (9, 10)]
        summary.append([program, *[mean([row[at] for row in of]) for at in (4, 6, 7, 8)], *ways, mean([row[11] for row in of])])
    print_table(["program", "quads", "extraordinary / 1,000", "angle °", "p95 °", "to scan mean %", "from scan mean %", "processor s"], summary)


def in_own_python(venv):
    """Runs this program again with the Python that has the packages, which is made first where it is missing."""
    python = venv / "bin/python"
    wanted = "; ".join(f"import {name}" for name in PACKAGES)
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    if subprocess.run([python, "-c", wanted], capture_output=True).returncode:
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES.values()], check=True)
    os.execv(python, [str(python), *sys.argv])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scans", nargs="*", metavar="SCAN")
    parser.add_argument("--programs", type=pathlib.Path, default=ROOT / "target/release")
    parser.add_argument("--shared", type=pathlib.Path, default=pathlib.Path(os.environ.get("QUADMUSE_SHARED", ROOT.parent / "shared")))
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("rivals"))
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target/rivals")
    parser.add_argument("--seconds", type=int, default=300, help="that a rival may take")
    parser.add_argument("--remesh", nargs=4, metavar=("RIVAL", "SCAN", "QUADS", "OUT"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    meshes = arguments.shared / "meshes"
    if not meshes.is_dir():
        sys.exit(f"no meshes at {meshes}: set QUADMUSE_SHARED, or give --shared")
    if pathlib.Path(sys.prefix) != arguments.venv.resolve():
        in_own_python(arguments.venv.resolve())
    sys.path.insert(0, str(arguments.shared / "eval"))
    if arguments.remesh:
        rival, scan, quads, out = arguments.remesh
        remesh(rival, scan, int(quads), pathlib.Path(out))
    else:
        compare(arguments, meshes)


if __name__ == "__main__":
    main()
