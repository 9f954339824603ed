"""A client that a program generated of the contract does all of it: adds, asks, lays, stitches, cancels, and reads problems.

client.py ADDRESS TOKEN FOLDER: FOLDER holds the generated package `quadmuse_api`, and `openapi.json`.
"""

import importlib
import json
import pathlib
import sys
import time
from io import BytesIO

address, token, folder = sys.argv[1:4]
sys.path.insert(0, folder)

from quadmuse_api import AuthenticatedClient, models  # noqa: E402
from quadmuse_api.types import File  # noqa: E402

client = AuthenticatedClient(base_url=f"http://{address}", token=token, timeout=120)


def call(operation, *arguments, **named):
    """The answer of an operation, as its type."""
    found = [module for module in operations() if module.endswith(f".{operation}")]
    assert len(found) == 1, f"{operation} is generated {len(found)} times"
    answer = importlib.import_module(found[0]).sync(*arguments, client=client, **named)
    assert answer is not None, f"{operation} told nothing"
    return answer


def operations():
    """The modules of all operations."""
    files = pathlib.Path(folder, "quadmuse_api", "api").rglob("*.py")
    return [".".join(file.relative_to(folder).with_suffix("").parts) for file in files if file.stem != "__init__"]


def all_are_generated():
    contract = json.loads(pathlib.Path(folder, "openapi.json").read_text())
    named = [operation["operationId"] for path in contract["paths"].values() for operation in path.values()]
    assert len(named) == len(set(named)), "an operation's name is not unique"
    missing = set(named) - {module.rsplit(".", 1)[1] for module in operations()}
    assert not missing, f"not generated: {missing}"
    return len(named)


def bumpy(side, height):
    """A bumpy sheet of quads as OBJ."""
    places = [(x, y) for y in range(side + 1) for x in range(side + 1)]
    lines = [f"v {x} {y} {height * ((x - side / 2) ** 2 + (y - side / 3) ** 2) ** 0.5}" for x, y in places]
    for y in range(side):
        for x in range(side):
            first = y * (side + 1) + x + 1
            lines.append(f"f {first} {first + 1} {first + side + 2} {first + side + 1}")
    return File(payload=BytesIO("\n".join(lines).encode() + b"\n"), mime_type="application/octet-stream")


def made(kind, of, making, whole):
    """Waits for what is made, by asking."""
    assert isinstance(making, (whole, models.Making)), making
    for _ in range(120):
        now = call(f"{kind}_get", of, making.id, wait=1.0)
        if isinstance(now, whole):
            assert now.state == models.MakingState.DONE and now.progress == 1.0, now
            return now
        assert now.state in (models.MakingState.QUEUED, models.MakingState.RUNNING), now
    raise AssertionError(f"{making.id} was not made in time")


count = all_are_generated()
example = call("examples_add", body=bumpy(24, 0.5), name="sheet", tag=["generated"])
assert isinstance(example, models.Example) and example.counts.quads == 576, example
landmarks = [models.NamedPoint(name="corner", vertex=0), models.NamedPoint(name="middle", point=[12.0, 8.0, 0.0])]
patch = models.ExamplePatch(author="a program", landmarks=landmarks)
named = call("examples_annotate", example.id, body=patch)
assert [landmark.name for landmark in named.landmarks] == ["corner", "middle"], named
assert len(call("examples_list", tag=["generated"]).items) == 1

query = call("queries_start", body=bumpy(40, 0.3))
assert isinstance(query, models.Query), query
while call("queries_get", query.id).state not in (models.QueryState.DONE, models.QueryState.FAILED):
    time.sleep(0.1)
given = models.QueryPatch(segments=[models.SegmentName(segment=0, name="all of it")])
assert call("queries_annotate", query.id, body=given).segments[0].name == "all of it"
entries = call("ranking_get", query.id, segment=0).entries
assert any(entry.example == example.id for entry in entries), entries

asked = call("maps_create", query.id, body=models.NewMap(example=example.id, segment=0))
laid = made("maps", query.id, asked, models.Map)
mesh = call("maps_mesh", query.id, laid.id, format_=models.MeshFormat.OBJ)
assert mesh.payload.read().startswith((b"v ", b"#", b"g ", b"o ")), "no OBJ"
waited = call("maps_create", query.id, body=models.NewMap(example=example.id, segment=0), wait=100.0)
assert isinstance(waited, models.Map), waited
composed = made(
    "compositions", query.id, call("compositions_create", query.id, body=models.NewComposition()), models.Composition
)
assert composed.quads > 0 and composed.triangles == 0, composed
refused = call("maps_get", query.id, "01ARZ3NDEKTSV4RRFFQ69G5FAV")
assert isinstance(refused, models.Problem) and refused.code == models.Code.NOT_FOUND, refused
assert call("samples_list").items
print(f"a generated client has all {count} operations, and lays and stitches")
