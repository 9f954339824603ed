//! The readers of meshes.

use crate::{damage::damaged, dice::Dice};
use quadmuse_kernel::mesh::{self, Format, Limits, PolyMesh};
use std::fmt::Write;

/// What readers promise.
pub const PROMISE: &str =
    "a spoilt file is refused with what was found, or is a mesh that prepares to a valid one and is written again";

const PLY: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar int vertex_index\n\
    property int segment\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n\
    0 0 0 255 0 0\n1 0 0 0 0 0\n1 1 0 9 9 9\n0 1 0 1 2 3\n3 0 1 2 7\n3 0 2 3 8\n0 1\n";
const STL: &str = "solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
    facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
const OFF: &str = "STCNOFF\n3 1 0\n0 0 0 0 0 1 255 0 0 0 0\n1 0 0 0 0 1 255 0 0 1 0\n0 1 0 0 0 1 1 0 0 0 1\n3 0 1 2\n";
const GLTF: &str = "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"children\":[1]},\
    {\"rotation\":[0,0,0.6,0.8],\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":5}]}],\
    \"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"sparse\":{\"count\":1,\
    \"indices\":{\"bufferView\":0,\"componentType\":5121},\"values\":{\"bufferView\":0,\"byteOffset\":12}}}],\
    \"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,\"uri\":\
    \"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}]}";

/// A bent sheet of quads with UVs, groups and materials.
fn sheet(n: usize) -> PolyMesh {
    let mut text = String::new();
    for k in 0..(n + 1) * (n + 1) {
        let (x, y) = (k % (n + 1), k / (n + 1));
        let z = ((x * 3 + y * 5) % 7) as f64 * 0.1;
        let _ = writeln!(text, "v {x} {y} {z}\nvt {} {}", x as f64 / n as f64, y as f64 / n as f64);
    }
    for y in 0..n {
        let _ = writeln!(text, "g row {y}\nusemtl {}", if y % 2 == 0 { "even" } else { "odd" });
        for x in 0..n {
            let a = y * (n + 1) + x + 1;
            let [a, b, c, d] = [a, a + 1, a + n + 2, a + n + 1];
            let _ = writeln!(text, "f {a}/{a} {b}/{b} {c}/{c} {d}/{d}");
        }
    }
    mesh::read(text.as_bytes(), Some(Format::Obj), &Limits::default()).unwrap_or_default()
}

/// Reads a spoilt file of a format, and does all with it that may be done.
fn read(seed: u64, format: Format, plain: &str) -> bool {
    let mut dice = Dice::new(seed);
    let side = 1 + dice.below(4);
    let written =
        || mesh::write(&sheet(side), format).unwrap_or_else(|error| panic!("a sheet is not written: {error}"));
    let whole = if plain.is_empty() || dice.below(2) == 0 { written() } else { plain.into() };
    let file = damaged(&whole, &mut dice);
    let declared = [Some(format), None][dice.below(2)];
    let poly = match mesh::read(&file, declared, &Limits::default()) {
        Ok(poly) => poly,
        Err(error) => {
            assert!(error.to_string().contains("found"), "{error}");
            return false;
        }
    };
    if let Ok(prepared) = mesh::prepare(&poly) {
        assert_eq!(mesh::validate(&prepared.mesh), Ok(()));
        assert!(!prepared.mesh.triangles.is_empty());
    }
    for format in Format::ALL {
        if let Err(error) = mesh::write(&poly, format) {
            assert!(!error.to_string().is_empty());
        }
    }
    true
}

/// OBJ.
pub fn obj(seed: u64) -> bool {
    read(seed, Format::Obj, "")
}

/// PLY, ASCII and binary.
pub fn ply(seed: u64) -> bool {
    read(seed, Format::Ply, PLY)
}

/// OFF with all that may stand before the numbers.
pub fn off(seed: u64) -> bool {
    read(seed, Format::Off, OFF)
}

/// STL, binary and ASCII.
pub fn stl(seed: u64) -> bool {
    read(seed, Format::Stl, STL)
}

/// glTF, in one binary and as JSON.
pub fn glb(seed: u64) -> bool {
    read(seed, Format::Glb, GLTF)
}
