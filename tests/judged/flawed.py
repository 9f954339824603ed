"""Shared scans with flaws that scanners make: a triangle or more gone, large openings, tiny handles, unwelded, noisy, closed at an end.

A directory of OBJ files, NAME_FLAW.obj. What a scan came to without the flaw, it should come to with it.
"""

import collections

import numpy
from made import write

BASES = {"head": "leeperrysmith_head.ply", "bust": "demosthenes_head.obj", "hand": "hand_lowres.obj", "horse": "m2m_horse.obj"}


def spread(vertices, triangles, count):
    """Middles of triangles, each as far from those before as may be."""
    middles = vertices[triangles].mean(1)
    away = numpy.linalg.norm(middles - middles.mean(0), axis=1)
    chosen = []
    for _ in range(count):
        chosen.append(middles[away.argmin() if not chosen else away.argmax()])
        away = numpy.linalg.norm(middles[:, None] - numpy.array(chosen), axis=2).min(1)
    return chosen


def without(vertices, triangles, places, radius):
    """The mesh without what is nearer to one of the places than a share of its diagonal."""
    middles, size = vertices[triangles].mean(1), numpy.linalg.norm(numpy.ptp(vertices, axis=0))
    away = numpy.min([numpy.linalg.norm(middles - place, axis=1) for place in places], axis=0)
    return vertices, triangles[(away > radius * size) & (away > away.min())]


def with_handles(vertices, triangles, count, seed=2):
    """Pairs of triangles near each other, joined by tubes."""
    random, size = numpy.random.default_rng(seed), numpy.linalg.norm(numpy.ptp(vertices, axis=0))
    middles, used, gone, tubes = vertices[triangles].mean(1), set(), set(), []
    for one in random.permutation(len(triangles)):
        if len(gone) == 2 * count:
            break
        away = numpy.linalg.norm(middles - middles[one], axis=1)
        near = [t for t in numpy.flatnonzero((away > 0.02 * size) & (away < 0.06 * size)) if not used & {*triangles[t], *triangles[one]}]
        if not near:
            continue
        two = near[random.integers(len(near))]
        a, b = triangles[one], triangles[two][::-1]
        b = min((numpy.roll(b, k) for k in range(3)), key=lambda b: numpy.linalg.norm(vertices[a] - vertices[b], axis=1).sum())
        for k in range(3):
            tubes += [[a[k], a[k - 2], b[k - 2]], [a[k], b[k - 2], b[k]]]
        used |= {*triangles[one], *triangles[two]}
        gone |= {one, two}
    return vertices, numpy.concatenate([numpy.delete(triangles, list(gone), 0), tubes])


def capped(vertices, triangles):
    """Each boundary loop filled with a fan."""
    beyond = collections.Counter(zip(triangles.ravel().tolist(), numpy.roll(triangles, -1, 1).ravel().tolist()))
    onward = {b: a for a, b in beyond if (b, a) not in beyond}
    while onward:
        loop = [next(iter(onward))]
        while onward.get(loop[-1], loop[0]) != loop[0]:
            loop.append(onward[loop[-1]])
        middle = len(vertices)
        vertices = numpy.vstack([vertices, vertices[loop].mean(0)])
        triangles = numpy.vstack([triangles, [[a, b, middle] for a, b in zip(loop, loop[1:] + loop[:1])]])
        for vertex in loop:
            onward.pop(vertex)
    return vertices, triangles


def noisy(vertices, triangles, share=0.003):
    size = numpy.linalg.norm(numpy.ptp(vertices, axis=0))
    return vertices + numpy.random.default_rng(0).normal(size=vertices.shape) * share * size, triangles


FLAWS = {
    "gap": lambda v, t: without(v, t, spread(v, t, 1), 0),
    "opening": lambda v, t: without(v, t, spread(v, t, 1), 0.06),
    "openings": lambda v, t: without(v, t, spread(v, t, 3), 0.06),
    "handles": lambda v, t: with_handles(v, t, 20),
    "capped": capped,
    "soup": lambda v, t: (v[t.ravel()], numpy.arange(t.size).reshape(-1, 3)),
    "noisy": noisy,
}


def make(meshes, folder):
    """Makes all scans that are not there yet, and those they are made of; answers with their files."""
    import judge

    folder.mkdir(parents=True, exist_ok=True)
    for name, file in BASES.items():
        vertices, faces = judge.load(meshes / "scans" / file)
        mesh = vertices, judge.triangles(faces)
        for flaw, flawed in {"plain": lambda v, t: (v, t), **FLAWS}.items():
            path = folder / f"{name}_{flaw}.obj"
            if not path.exists():
                write(path, *flawed(*mesh))
    return sorted(folder.glob("*.obj"))
