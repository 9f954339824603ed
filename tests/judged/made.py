"""Scans made of shared meshes that their own family is kept from: whole, cut by a plane, seen from one side, on a rock.

A directory of OBJ files, NAME_KIND.obj. `whole`, `cut` and `view` are made of inputs of `species` and `unseen`; `rock` of examples,
joined with a lumpy base by a grid of voxels (needs scikit-image, else they are left out).
"""

import numpy

INPUTS = {
    "pig": "species/input_pig.ply", "horse": "species/input_horse.ply", "cow": "species/input_cow.ply",
    "triceratops": "species/input_triceratops.ply", "pug": "species/input_pug.ply",
    "wolf": "unseen/input_animal_wolf_31_0.ply", "frog": "unseen/input_animal_frog_31_0.ply",
    "eagle": "unseen/input_animal_eagle_31_0.ply", "dolphin": "unseen/input_animal_dolphin_31_0.ply",
    "alien": "unseen/input_animal_alien_31_0.ply", "body": "unseen/input_mhbody_31_0.ply",
    "hand": "unseen/input_mhhand_31_0.ply", "pose": "unseen/input_mhpose_31_1.ply",
}
STANDING = {
    "cat": "qt_cat_cc1", "dog": "qt_dog_cc1", "horse": "qt_horse_cc1", "pig": "qt_pig_cc1", "wolf": "qt_wolf_cc1",
    "triceratops": "qt_triceratops_cc1", "body": "mh_hm08_body_shut", "cow": "spot_control_cc1",
}
# Parts of names of examples that are of the same family.
KEPT_FROM = {
    "cow": ["spot"], "body": ["hm08"], "pose": ["hm08"], "hand": ["hm08_hand", "hm08_finger", "hm08_thumb", "hm08_armcyl"],
    "cat": ["qt_cat"], "dog": ["qt_dog"],
}


def kept_from(name):
    return KEPT_FROM.get(name, [name])


def used(vertices, triangles):
    numbers, again = numpy.unique(triangles, return_inverse=True)
    return vertices[numbers], again.reshape(triangles.shape)


def largest(vertices, triangles):
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = (triangles.ravel(), numpy.roll(triangles, 1, 1).ravel())
    graph = coo_matrix((numpy.ones(3 * len(triangles)), edges), shape=(len(vertices),) * 2)
    count, of_vertex = connected_components(graph, False)
    of_triangle = of_vertex[triangles[:, 0]]
    return used(vertices, triangles[of_triangle == numpy.bincount(of_triangle, minlength=count).argmax()])


def cut(vertices, triangles, upper):
    """What lies on one side of a plane across the longest extent: 60 or 40 % of the triangles."""
    axis = int(numpy.ptp(vertices, axis=0).argmax())
    middles = vertices[triangles].mean(1)[:, axis]
    plane = numpy.quantile(middles, 0.4)
    return largest(vertices, triangles[middles > plane if upper else middles < plane])


def crossings(points, triangles):
    """For each triangle the places of the grid that it covers, seen along the third axis, and its height there."""
    for corners in triangles:
        a, b, c = points[corners]
        low = numpy.ceil(numpy.minimum(numpy.minimum(a, b), c)[:2]).astype(int)
        high = numpy.floor(numpy.maximum(numpy.maximum(a, b), c)[:2]).astype(int)
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if (high < low).any() or abs(twice) < 1e-12:
            continue
        x, y = numpy.meshgrid(numpy.arange(low[0], high[0] + 1), numpy.arange(low[1], high[1] + 1), indexing="ij")
        u = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice
        v = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        yield x[inside], y[inside], (a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]))[inside]


def view(vertices, triangles, towards=(0.8, 0.35, 0.6), side=220, noise=0.26, seed=0):
    """What is seen from one side, as a grid of depths with noise, dropouts and gaps at silhouettes."""
    random = numpy.random.default_rng(seed)
    depth = numpy.array(towards) / numpy.linalg.norm(towards)
    right = numpy.cross(depth, [0.1, 0.99, 0.05])
    right /= numpy.linalg.norm(right)
    frame = numpy.stack([right, numpy.cross(depth, right), depth])
    points = vertices @ frame.T
    low, step = points.min(0), numpy.ptp(points, axis=0)[:2].max() / side
    points = (points - low) / step
    count = int(points[:, :2].max()) + 2
    seen = numpy.full((count, count), -numpy.inf)
    for x, y, height in crossings(points, triangles):
        seen[x, y] = numpy.maximum(seen[x, y], height)
    seen = numpy.where(numpy.isfinite(seen), seen + random.normal(size=seen.shape) * noise, seen)
    seen[random.random(seen.shape) < 0.004] = -numpy.inf
    there = numpy.isfinite(seen)
    numbers = numpy.cumsum(there.ravel()).reshape(seen.shape) - 1
    x, y = numpy.nonzero(there)
    found = (numpy.stack([x, y, seen[there]], 1) * step + low) @ frame
    faces = []
    for shape in (((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1))):
        at = [numpy.s_[i : count - 1 + i, j : count - 1 + j] for i, j in shape]
        heights = numpy.stack([seen[k] for k in at])
        is_seen = numpy.isfinite(heights).all(0)
        spread = numpy.where(is_seen, numpy.ptp(numpy.where(is_seen, heights, 0), axis=0), numpy.inf)
        faces.append(numpy.stack([numbers[k] for k in at], -1)[spread < 5])
    return used(found, numpy.concatenate(faces))


def on_rock(vertices, triangles, up=1, side=110):
    """A closed surface joined with a lumpy base below it."""
    from scipy import ndimage
    from skimage import measure

    low, high = vertices.min(0), vertices.max(0)
    step = (high - low).max() / side
    low = low - 6 * step
    count = numpy.ceil((high - low) / step).astype(int) + 6
    crossed = numpy.zeros(count + 1, int)
    for x, y, height in crossings((vertices - low) / step + 1e-4 * numpy.array([0.37, 0.61, 0]), triangles):
        numpy.add.at(crossed, (x, y, numpy.clip(numpy.ceil(height).astype(int), 0, count[2])), 1)
    inside = numpy.cumsum(crossed, 2) % 2 == 1
    pads = [(side // 10, side // 10)] * 3
    pads[up] = (side * 14 // 100, 0)
    inside, low = numpy.pad(inside, pads), low - step * numpy.array([pad[0] for pad in pads])
    own_low, own_high = vertices.min(0), vertices.max(0)
    middle, radius = (own_low + own_high) / 2, (own_high - own_low) / 2
    middle[up], radius = own_low[up], numpy.maximum(radius, 0.35 * radius.max())
    radius[up] = 0.12 * (own_high - own_low).max()
    at = numpy.stack(numpy.meshgrid(*map(numpy.arange, inside.shape), indexing="ij"), -1) * step + low
    a, b = (axis for axis in range(3) if axis != up)
    lumps = 0.12 * numpy.sin(9 * at[..., a] / radius.max()) * numpy.cos(7 * at[..., b] / radius.max())
    rock = (abs((at - middle) / radius) ** 3).sum(-1) + lumps < 1
    field = numpy.pad(ndimage.gaussian_filter((inside | rock).astype(float), 0.8), 2)
    found, faces, _, _ = measure.marching_cubes(field, 0.5)
    return largest((found - 2) * step + low, faces[:, ::-1])


def write(path, vertices, triangles):
    lines = ["v %.6f %.6f %.6f" % tuple(v) for v in vertices] + ["f %d %d %d" % tuple(t + 1) for t in triangles]
    path.write_text("\n".join(lines) + "\n")


def make(meshes, folder):
    """Makes all scans that are not there yet; answers with their files."""
    import judge

    folder.mkdir(parents=True, exist_ok=True)

    def load(path):
        vertices, faces = judge.load(path)
        return vertices, judge.triangles(faces)

    def put(name, make_one):
        path = folder / f"{name}.obj"
        if not path.exists():
            write(path, *make_one())

    for name, at in INPUTS.items():
        mesh = load(meshes / at)
        put(f"{name}_whole", lambda: mesh)
        put(f"{name}_cut", lambda: cut(*mesh, upper=len(name) % 2 == 0))
        put(f"{name}_view", lambda: view(*mesh))
    try:
        import skimage  # noqa: F401
    except ImportError:
        return sorted(folder.glob("*.obj"))
    for name, example in STANDING.items():
        mesh = load(meshes / "quads" / f"{example}.obj")
        put(f"{name}_rock", lambda: on_rock(*mesh))
    return sorted(folder.glob("*.obj"))
