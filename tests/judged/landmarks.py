"""Maps that are wrong by themselves, with up to five landmarks: how many of them that puts right."""

import json
import pathlib

import numpy

# Points of scans, and of an example, picked by eye in pictures of them.
POINTS = json.loads(pathlib.Path(__file__).with_name("points.json").read_text())
# What is given of a face; its other points judge the map.
OF_A_FACE = ("eye_r_out", "eye_l_out", "nose_tip", "mouth_r", "mouth_l")
OF_A_FACE_WITHOUT_EYES = ("nose_tip", "mouth_r", "mouth_l", "chin")


def pairs(names, on_example, on_scan):
    """Landmarks as `--landmarks FILE` reads them."""
    return [{"name": name, "on_example": list(map(float, on_example[name])), "on_input": list(map(float, on_scan[name]))} for name in names]


def faces(meshes):
    """Heads of both families on statues: example, scan, landmarks, and a judge of the example's mapped vertices, which answers
    with the mean distance of the points that were not given, as a share of the distance between the mouth's corners."""
    import judge_extents

    numbers = json.loads((meshes / "cross/landmarks.json").read_text())
    for scan in ("nefertiti.ply", "demosthenes.ply"):
        on_scan = POINTS["scans"][scan]
        given = OF_A_FACE if "eye_l_out" in on_scan else OF_A_FACE_WITHOUT_EYES
        for family in ("mh", "ict"):
            example = meshes / f"cross/{family}_00.obj"
            vertices, _ = judge_extents.read(example)
            of = numbers[family]
            wide = numpy.linalg.norm(numpy.subtract(on_scan["mouth_l"], on_scan["mouth_r"]))

            def judged(mapped, kept, of=of, on_scan=on_scan, given=given, wide=wide):
                there = {number: at for at, number in enumerate(kept)}
                far = [numpy.linalg.norm(mapped[there[of[name]]] - on_scan[name]) / wide if of[name] in there else 1 for name in on_scan if name not in given]
                return round(float(numpy.mean(far)), 3)

            yield example, meshes / "scans" / scan, pairs(given, {name: vertices[of[name]] for name in given}, on_scan), judged


def tip(vertices, labels, part):
    """The vertex of a part that lies farthest from the middle of the animal."""
    inside = [at for at, label in enumerate(labels) if label == part]
    trunk = [at for at, label in enumerate(labels) if label in ("-", "body")]
    far = numpy.linalg.norm(vertices[inside] - vertices[trunk].mean(axis=0), axis=1)
    return vertices[inside[int(far.argmax())]]


def animals(meshes):
    """A biped and quadrupeds onto each other, whose maps are wrong by themselves; the judge answers with the share of the area
    on its part."""
    import judge_extents
    import judge_species

    at = meshes / "species"
    others = [path.stem.removeprefix("quads_") for path in sorted(at.glob("quads_*.obj")) if "trex" not in path.stem]
    parts = ["head", "front_leg_L", "front_leg_R", "back_leg_L", "back_leg_R"]
    for example, scan in [("trex", other) for other in others] + [(other, "trex") for other in others]:
        vertices, polygons = judge_extents.read(at / f"quads_{example}.obj")
        placed, _ = judge_extents.read(at / f"placed_{scan}.obj")
        labels, on = ((at / f"labels_{name}.txt").read_text().split() for name in (example, scan))
        tips = [{part: tip(numpy.asarray(points), names, part) for part in parts} for points, names in ((vertices, labels), (placed, on))]

        def judged(mapped, kept, polygons=polygons, labels=labels, placed=placed, on=on):
            there = {number: at for at, number in enumerate(kept)}
            inside = [[there[vertex] for vertex in face] for face in polygons if all(vertex in there for vertex in face)]
            return judge_species.report(mapped, inside, [labels[number] for number in kept], placed, on)["agree"]

        yield at / f"quads_{example}.obj", at / f"input_{scan}.ply", pairs(parts, *tips), judged


def hands(meshes):
    """An open hand on a closed one, by its finger tips; nothing judges it but its verdict and its picture."""
    example = "mh_hm08_hand_R.obj"
    on_example, on_scan = POINTS["examples"][example], POINTS["scans"]["hand_closed.ply"]
    yield meshes / "quads" / example, meshes / "scans/hand_closed.ply", pairs(list(on_scan), on_example, on_scan), lambda mapped, kept: None
