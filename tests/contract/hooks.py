"""What schemathesis has to know besides the contract: meshes, and how bodies that are no JSON are written and read."""

import msgpack
import schemathesis
from hypothesis import strategies


def _sheet(side):
    """A bumpy sheet of quads as OBJ."""
    places = [(x, y) for y in range(side + 1) for x in range(side + 1)]
    lines = [f"v {x} {y} {0.1 * ((x * y) % 3)}" for x, y in places]
    for y in range(side):
        for x in range(side):
            first = y * (side + 1) + x + 1
            lines.append(f"f {first} {first + 1} {first + side + 2} {first + side + 1}")
    return "\n".join(lines).encode() + b"\n"


SHEETS = [_sheet(2), _sheet(3), _sheet(5)]
# Most are meshes, so that what is made of them is reached, too.
MESHES = strategies.one_of(
    strategies.sampled_from(SHEETS),
    strategies.sampled_from(SHEETS).map(lambda mesh: mesh[: len(mesh) // 2]),
    strategies.binary(max_size=64),
)
MESH_TYPES = ["application/octet-stream", "model/gltf-binary", "model/obj", "model/off", "model/ply", "model/stl"]
for media in MESH_TYPES:
    schemathesis.openapi.media_type(media, MESHES)


schemathesis.openapi.media_type("application/offset+octet-stream", strategies.binary(max_size=64))


@schemathesis.hook
def before_load_schema(ctx, raw_schema):
    # Of types with meshes of their own it takes no examples that are texts.
    for operations in raw_schema["paths"].values():
        for operation in operations.values():
            for media, content in operation.get("requestBody", {}).get("content", {}).items():
                if media in MESH_TYPES:
                    content.pop("example", None)


def packable(value):
    """Makes floats of the integers that MessagePack has no room for: a JSON number may be of any length."""
    if isinstance(value, dict):
        return {packable(key): packable(item) for key, item in value.items()}
    if isinstance(value, list):
        return [packable(item) for item in value]
    if isinstance(value, int) and not -(2**63) <= value < 2**64:
        return float(value) if abs(value) < 2**1000 else float("inf")
    return value


@schemathesis.serializer("application/msgpack")
def packed(ctx, value):
    return msgpack.packb(packable(value))


@schemathesis.deserializer("application/msgpack")
def unpacked(ctx, response):
    return msgpack.unpackb(response.content)
