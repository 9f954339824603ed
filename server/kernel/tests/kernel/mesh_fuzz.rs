//! Meshes and files made at random, from fixed seeds: nothing panics, and what is prepared is valid.

use proptest::prelude::*;
use quadmuse_kernel::mesh::{self, Format, Limits, MeshError, NONE, PolyMesh, Polygons, Vec3};

/// Seeded numbers (splitmix64).
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) % sides as u64) as usize
    }
}

/// A bent sheet of `n × n` quads with UVs, groups and materials.
fn sheet(n: usize) -> PolyMesh {
    let mut text = String::new();
    for y in 0..=n {
        for x in 0..=n {
            let z = ((x * 3 + y * 5) % 7) as f64 * 0.1;
            text += &format!("v {x} {y} {z}\nvt {} {}\n", x as f64 / n as f64, y as f64 / n as f64);
        }
    }
    for y in 0..n {
        text += &format!("g row {y}\nusemtl {}\n", if y % 2 == 0 { "even" } else { "odd" });
        for x in 0..n {
            let a = y * (n + 1) + x + 1;
            let ring = [a, a + 1, a + n + 2, a + n + 1].map(|v| format!("{v}/{v}"));
            text += &format!("f {}\n", ring.join(" "));
        }
    }
    mesh::read(text.as_bytes(), Some(Format::Obj), &Limits::default()).expect("a sheet")
}

/// Files to be damaged: one or more of each format.
fn seeds() -> Vec<(Format, Vec<u8>)> {
    let sheet = sheet(3);
    let mut seeds: Vec<_> = Format::ALL.map(|f| (f, mesh::write(&sheet, f).expect("writable"))).into();
    let ply = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar int vertex_index\n\
        property int segment\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n\
        0 0 0 255 0 0\n1 0 0 0 0 0\n1 1 0 9 9 9\n0 1 0 1 2 3\n3 0 1 2 7\n3 0 2 3 8\n0 1\n";
    seeds.push((Format::Ply, ply.into()));
    let stl = "solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
        facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    seeds.push((Format::Stl, stl.into()));
    seeds.push((
        Format::Off,
        "STCNOFF\n3 1 0\n0 0 0 0 0 1 255 0 0 0 0\n1 0 0 0 0 1 255 0 0 1 0\n0 1 0 0 0 1 1 0 0 0 1\n3 0 1 2\n".into(),
    ));
    let gltf = "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"children\":[1]},\
        {\"rotation\":[0,0,0.6,0.8],\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":5}]}],\
        \"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"sparse\":{\"count\":1,\
        \"indices\":{\"bufferView\":0,\"componentType\":5121},\"values\":{\"bufferView\":0,\"byteOffset\":12}}}],\
        \"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,\"uri\":\
        \"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}]}";
    seeds.push((Format::Glb, gltf.into()));
    seeds
}

/// Damages a file in one to four places.
fn damage(bytes: &[u8], dice: &mut Dice) -> Vec<u8> {
    const WORDS: [&[u8]; 14] = [
        b"4294967295",
        b"-1",
        b"nan",
        b"1e999",
        b"18446744073709551616",
        b" ",
        b"\n",
        b"0",
        b"\\\n",
        b"f 1 1 1\n",
        b"{",
        b"[[[[",
        b"\xff\xff\xff\xff",
        b"-",
    ];
    let mut out = bytes.to_vec();
    for _ in 0..=dice.roll(4) {
        let at = dice.roll(out.len().max(1)).min(out.len());
        match dice.roll(6) {
            0 if at < out.len() => out[at] ^= 1 << dice.roll(8),
            1 if at < out.len() => out[at] = dice.roll(256) as u8,
            2 => out.truncate(at),
            3 => {
                let end = (at + dice.roll(20)).min(out.len());
                out.drain(at..end);
            }
            4 => {
                let end = (at + dice.roll(40)).min(out.len());
                let piece = out[at..end].to_vec();
                let to = dice.roll(out.len() + 1);
                out.splice(to..to, piece);
            }
            _ => {
                let end = (at + dice.roll(4)).min(out.len());
                out.splice(at..end, WORDS[dice.roll(WORDS.len())].iter().copied());
            }
        }
    }
    out
}

#[test]
fn damaged_files_are_read_or_refused() {
    let mut dice = Dice(1);
    for (format, bytes) in seeds() {
        let (mut read, mut prepared) = (0, 0);
        for _ in 0..2000 {
            let damaged = damage(&bytes, &mut dice);
            let declared = [Some(format), None][dice.roll(2)];
            match mesh::read(&damaged, declared, &Limits::default()) {
                Ok(poly) => {
                    read += 1;
                    prepared += usize::from(check(&poly).is_ok());
                    for format in Format::ALL {
                        mesh::write(&poly, format).map_or_else(|e| assert!(!e.to_string().is_empty()), drop);
                    }
                }
                Err(error) => assert!(error.to_string().contains("found"), "{error}"),
            }
        }
        println!("{format}: {read} of 2000 damaged files read, {prepared} prepared");
    }
}

/// Prepares a mesh and checks all that the result promises.
fn check(poly: &PolyMesh) -> Result<(), MeshError> {
    let prepared = mesh::prepare(poly)?;
    let mesh = &prepared.mesh;
    assert_eq!(mesh::validate(mesh), Ok(()));
    assert!(!mesh.triangles.is_empty());
    assert_eq!((prepared.vertex_of.len(), prepared.reversed.len()), (poly.positions.len(), poly.faces.len()));
    assert!(prepared.vertex_of.iter().all(|v| *v == NONE || (*v as usize) < mesh.positions.len()));
    assert!(mesh.polygon_of.iter().all(|f| (*f as usize) < poly.faces.len()));
    assert_eq!(mesh::prepare(poly).as_ref(), Ok(&prepared), "twice the same");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, rng_seed: prop::test_runner::RngSeed::Fixed(7), ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_prepared_is_valid(
        faces in prop::collection::vec(prop::collection::vec(0u32..12, 3..7), 1..14),
        places in prop::collection::vec(prop::array::uniform3(0i32..3), 12),
    ) {
        let positions = places.iter().map(|p| Vec3::from(p.map(f64::from))).collect();
        let faces = faces.iter().map(Vec::as_slice).collect();
        let _ = check(&PolyMesh { positions, faces, ..PolyMesh::default() });
    }

    #[test]
    fn pieces_of_a_soup_find_together(
        triangles in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(0i32..3)), 1..40),
    ) {
        let positions: Vec<Vec3> = triangles.iter().flatten().map(|p| Vec3::from(p.map(f64::from))).collect();
        let indices: Vec<u32> = (0..positions.len() as u32).collect();
        let faces = indices.chunks(3).collect();
        let _ = check(&PolyMesh { positions, faces, ..PolyMesh::default() });
    }

    /// A box of quads with turned, copied and unwelded faces is a closed surface again.
    #[test]
    fn a_battered_box_is_a_sphere_again(
        turned in prop::collection::vec(any::<bool>(), 24),
        copied in prop::collection::vec(0usize..24, 0..5),
        loose in prop::collection::vec(any::<bool>(), 24),
        jitter in prop_oneof![Just(0.0), Just(1e-8)],
    ) {
        let mut positions: Vec<Vec3> = Vec::new();
        let mut shared = std::collections::HashMap::new();
        let mut rings: Vec<Vec<u32>> = Vec::new();
        for (f, ring) in box_of_quads().into_iter().enumerate() {
            let mut corners: Vec<u32> = Vec::new();
            for p in ring {
                let exact = Vec3::from(p.map(f64::from));
                let fresh = positions.len() as u32;
                let vertex = if loose[f] { fresh } else { *shared.entry(p).or_insert(fresh) };
                if vertex == fresh {
                    positions.push(exact.add_scalar(if loose[f] { jitter } else { 0.0 }));
                }
                corners.push(vertex);
            }
            if turned[f] {
                corners.reverse();
            }
            rings.push(corners);
        }
        copied.iter().for_each(|f| rings.push(rings[*f].clone()));
        let faces: Polygons = rings.iter().map(Vec::as_slice).collect();
        let poly = PolyMesh { positions, faces, ..PolyMesh::default() };
        prop_assert_eq!(check(&poly), Ok(()));
        let mesh = mesh::prepare(&poly).expect("checked").mesh;
        prop_assert_eq!((mesh.positions.len(), mesh.triangles.len(), mesh.boundary_loops().len()), (26, 48, 0));
        let volume: f64 = mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            a.dot(&b.cross(&c)) / 6.0
        }).sum();
        prop_assert!((volume - 8.0).abs() < 1e-6, "the outside is out: {}", volume);
    }
}

/// The 24 quads of a box of side 2, wound outwards.
fn box_of_quads() -> Vec<[[i32; 3]; 4]> {
    let mut quads = Vec::new();
    for axis in 0..3 {
        for side in [0, 2] {
            for (u, v) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let at = |du: i32, dv: i32| {
                    let mut p = [0; 3];
                    (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, u + du, v + dv);
                    p
                };
                let mut ring = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                if side == 0 {
                    ring.reverse();
                }
                quads.push(ring);
            }
        }
    }
    quads
}
