//! Families of meshes that are hard on data structures: twice the size must not take much more than twice the time.
//!
//! No time is asserted; the table shows it. What is asserted is that each ends, and how.

use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{self, MeshError, MeshErrorKind, PolyMesh, Polygons, Vec3};
use std::time::Instant;

fn poly(positions: Vec<Vec3>, faces: Polygons) -> PolyMesh {
    PolyMesh { positions, faces, ..PolyMesh::default() }
}

fn rim(n: usize) -> impl Iterator<Item = Vec3> {
    (0..n).map(move |k| {
        let angle = std::f64::consts::TAU * k as f64 / n as f64;
        Vec3::new(angle.cos(), angle.sin(), 0.0)
    })
}

/// One vertex of valence `n`.
fn fan(n: usize) -> PolyMesh {
    let faces: Vec<[u32; 3]> = (0..n as u32).map(|k| [0, 1 + k, 1 + (k + 1) % n as u32]).collect();
    poly(std::iter::once(Vec3::zeros()).chain(rim(n)).collect(), faces.iter().map(<[u32; 3]>::as_slice).collect())
}

/// A sheet whose vertices all lie at one point but one.
fn collapsed(n: usize) -> PolyMesh {
    let side = (n as f64).sqrt() as u32;
    let mut positions = vec![Vec3::zeros(); (side as usize + 1).pow(2)];
    positions[0] = Vec3::new(1.0, 0.0, 0.0);
    poly(positions, sheet_faces(side).iter().map(<[u32; 4]>::as_slice).collect())
}

fn sheet_faces(side: u32) -> Vec<[u32; 4]> {
    let at = |x: u32, y: u32| y * (side + 1) + x;
    let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    cells.map(|(x, y)| [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]).collect()
}

/// `n` faces at one edge.
fn book(n: usize) -> PolyMesh {
    let spine = [Vec3::zeros(), Vec3::new(0.0, 0.0, 1.0)];
    let faces: Vec<[u32; 3]> = (0..n as u32).map(|k| [0, 1, 2 + k]).collect();
    poly(spine.into_iter().chain(rim(n)).collect(), faces.iter().map(<[u32; 3]>::as_slice).collect())
}

/// The same, as a soup.
fn loose_book(n: usize) -> PolyMesh {
    let positions: Vec<Vec3> = rim(n).flat_map(|p| [Vec3::zeros(), Vec3::new(0.0, 0.0, 1.0), p]).collect();
    let indices: Vec<u32> = (0..positions.len() as u32).collect();
    poly(positions, indices.chunks(3).collect())
}

/// One polygon with `n` corners, every second of them far in.
fn star(n: usize) -> PolyMesh {
    let positions = rim(n).enumerate().map(|(k, p)| if k % 2 == 0 { p } else { 0.2 * p }).collect();
    let ring: Vec<u32> = (0..n as u32).collect();
    poly(positions, std::iter::once(ring.as_slice()).collect())
}

/// One polygon with `n` corners that is a comb of long thin teeth: every ear sees many corners.
fn comb(n: usize) -> PolyMesh {
    let tooth = |k: usize| Vec3::new(k as f64, if k.is_multiple_of(2) { 0.1 } else { n as f64 }, 0.0);
    let base = [Vec3::new(n as f64, 0.0, 0.0), Vec3::zeros()];
    let positions: Vec<Vec3> = (0..n - 2).map(tooth).chain(base).rev().collect();
    let ring: Vec<u32> = (0..n as u32).collect();
    poly(positions, std::iter::once(ring.as_slice()).collect())
}

/// `n` triangles apart.
fn small_components(n: usize) -> PolyMesh {
    let corners = [Vec3::zeros(), Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.0, 0.5, 0.0)];
    let positions: Vec<Vec3> =
        (0..n).flat_map(|k| corners.map(|c| c + Vec3::new((k % 300) as f64, (k / 300) as f64, 0.0))).collect();
    let indices: Vec<u32> = (0..positions.len() as u32).collect();
    poly(positions, indices.chunks(3).collect())
}

/// `n` triangles that touch in one vertex.
fn pinched(n: usize) -> PolyMesh {
    let faces: Vec<[u32; 3]> = (0..n as u32).map(|k| [0, 1 + 2 * k, 2 + 2 * k]).collect();
    poly(std::iter::once(Vec3::zeros()).chain(rim(2 * n)).collect(), faces.iter().map(<[u32; 3]>::as_slice).collect())
}

/// `n` copies of one face, every second reversed.
fn copies(n: usize) -> PolyMesh {
    let faces: Vec<[u32; 3]> = (0..n).map(|k| if k % 2 == 0 { [0, 1, 2] } else { [2, 1, 0] }).collect();
    poly(rim(3).collect(), faces.iter().map(<[u32; 3]>::as_slice).collect())
}

/// A sheet of slivers.
fn slivers(n: usize) -> PolyMesh {
    let side = (n as f64).sqrt() as u32;
    let positions = (0..=side).flat_map(|y| (0..=side).map(move |x| Vec3::new(f64::from(x), 1e-7 * f64::from(y), 0.0)));
    poly(positions.collect(), sheet_faces(side).iter().map(<[u32; 4]>::as_slice).collect())
}

/// A soup of a sheet whose points differ by less than the tolerance.
fn jittered(n: usize) -> PolyMesh {
    let side = (n as f64).sqrt() as u32;
    let faces = sheet_faces(side);
    let at = |k: usize, v: u32| {
        let exact = Vec3::new(f64::from(v % (side + 1)), f64::from(v / (side + 1)), 0.0);
        exact.add_scalar(1e-8 * (k % 7) as f64)
    };
    let positions: Vec<Vec3> = faces.iter().flatten().enumerate().map(|(k, v)| at(k, *v)).collect();
    let indices: Vec<u32> = (0..positions.len() as u32).collect();
    poly(positions, indices.chunks(4).collect())
}

/// A file of the hostile families: how it is made, its size, and what is to come of it.
type Family = (&'static str, fn(usize) -> PolyMesh, usize, Option<MeshErrorKind>);

#[test]
fn hard_families_end_as_they_should() {
    let families: [Family; 12] = [
        ("fan of valence n", fan, 200_000, None),
        ("n faces, all vertices but one equal", collapsed, 200_000, Some(MeshErrorKind::Empty)),
        ("one edge in n faces", book, 10_000, Some(MeshErrorKind::NotManifold)),
        ("one edge in n loose faces", loose_book, 100_000, None),
        ("star of n corners", star, 20_000, None),
        ("comb of n corners", comb, 20_000, None),
        ("n components and loops", small_components, 100_000, None),
        ("n triangles at one vertex", pinched, 100_000, None),
        ("n copies of a face", copies, 100_000, None),
        ("slivers", slivers, 200_000, None),
        ("jittered soup", jittered, 200_000, None),
        ("fan again", fan, 50_000, None),
    ];
    for (name, make, n, refusal) in families {
        let milliseconds = [n, 2 * n].map(|n| {
            let mesh = make(n);
            let started = Instant::now();
            let outcome = mesh::prepare(&mesh);
            let taken = started.elapsed().as_secs_f64() * 1e3;
            match outcome {
                Ok(prepared) => assert_eq!((mesh::validate(&prepared.mesh), refusal), (Ok(()), None), "{name}"),
                Err(error) => assert_eq!(Some(error.code()), refusal, "{name}: {error}"),
            }
            taken
        });
        let [once, twice] = milliseconds;
        println!("{name:40} {n:7} {once:8.1} ms, twice the size {twice:8.1} ms ({:.2} ×)", twice / once);
    }
}

#[test]
fn an_edge_of_too_many_faces_is_named_with_its_faces() {
    let error = mesh::prepare(&book(10_000)).expect_err("not manifold");
    assert!(matches!(&error, MeshError::EdgeShared { vertices: [0, 1], count: 10_000, faces, .. } if faces.len() == 6));
    assert!(error.to_string().len() < 400, "{error}");
}

#[test]
fn closest_points_are_found_fast_on_a_large_mesh() {
    let side = 215;
    let mut sheet = slivers(side * side);
    for (k, p) in sheet.positions.iter_mut().enumerate() {
        let (x, y) = (p.x / side as f64, (k / (side + 1)) as f64 / side as f64);
        *p = Vec3::new(x, y, 0.1 * (9.0 * x).sin() * (7.0 * y).cos());
    }
    let mesh = mesh::prepare(&sheet).expect("a sheet").mesh;
    let started = Instant::now();
    let bvh = Bvh::new(&mesh);
    let built = started.elapsed();
    for spread in [0.01, 0.1, 1.0] {
        let queries: Vec<Vec3> = (0..100_000)
            .map(|k| {
                let (x, y, z) =
                    ((k as f64 * 0.618_034).fract(), (k as f64 * 0.754_878).fract(), (k as f64 * 0.569_84).fract());
                Vec3::new(x, y, 0.1 * (9.0 * x).sin() * (7.0 * y).cos() + spread * (z - 0.5))
            })
            .collect();
        let started = Instant::now();
        let mean = queries.iter().map(|p| bvh.closest(*p).distance).sum::<f64>() / queries.len() as f64;
        let each = started.elapsed() / queries.len() as u32;
        println!("{} triangles: built in {built:?}, {each:?} a query, mean distance {mean:.4}", mesh.triangles.len());
        assert!(mean > 0.0 && mean < spread);
    }
}
