//! The example's boundary lands on the input's boundary exactly, on every scan that has one.
//!
//! The meshes lie outside of the project, in `../shared/meshes` or where `QUADMUSE_SHARED` says.

use crate::folder;
use quadmuse_kernel::encode::index::PlanarIndex;
use quadmuse_kernel::map::cross_map;
use quadmuse_kernel::mesh::{self, Format, Limits, TriMesh, Vec3};
use quadmuse_kernel::register::{Flip, Registration};
use quadmuse_kernel::topology::{Components, Topology, primitive, whole};
use quadmuse_kernel::unfold::{UnfoldOptions, unfold};

/// A sheet of `n` by `n` cells, or a tube where it is closed around.
fn grid(n: u32, closed: bool) -> TriMesh {
    let columns = if closed { n } else { n + 1 };
    let at = |i: u32, j: u32| j * columns + i % columns;
    let place = |i: u32, j: u32| {
        let (a, z) = (std::f64::consts::TAU * f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
        if closed { Vec3::new(a.cos(), a.sin(), 4.0 * z) } else { Vec3::new(a, 6.0 * z, (3.0 * z).sin() * a.sin()) }
    };
    let positions = (0..=n).flat_map(|j| (0..columns).map(move |i| place(i, j))).collect();
    let cell =
        |i: u32, j: u32| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    let triangles = (0..n).flat_map(|j| (0..n).flat_map(move |i| cell(i, j))).collect();
    TriMesh::from_triangles(positions, triangles).expect("a grid is manifold")
}

fn to_segment(p: Vec3, a: Vec3, b: Vec3) -> f64 {
    let d = b - a;
    let t = if d.norm_squared() > 0.0 { ((p - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + t * d)).norm()
}

#[test]
fn boundaries_land_on_boundaries() {
    let Some(folder) = folder("scans") else { return };
    let entries = std::fs::read_dir(&folder).expect("a readable folder");
    let mut files: Vec<_> = entries.map(|entry| entry.expect("readable").path()).collect();
    files.sort();
    let mut tried = 0;
    for path in files {
        let Some(format) = path.extension().and_then(|e| e.to_str()).and_then(Format::from_extension) else { continue };
        let bytes = std::fs::read(&path).expect("a readable file");
        let Ok(prepared) = mesh::read(&bytes, Some(format), &Limits::default()).and_then(|poly| mesh::prepare(&poly))
        else {
            continue;
        };
        let Ok(patch) = primitive(&prepared.mesh, Components::Largest) else { continue };
        if !matches!(patch.topology, Topology::Disc | Topology::Annulus) {
            continue;
        }
        let example = whole(&grid(40, patch.topology == Topology::Annulus)).expect("a primitive");
        let chart = unfold(&example, &UnfoldOptions::default()).expect("solvable");
        let input = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        // Controls that pull the map about; the boundary stays on itself all the same.
        let (p, q) = (vec![[0.2, 0.3], [0.7, 0.6]], vec![[0.25, 0.35], [0.72, 0.55]]);
        let registration = Registration::from_controls(Flip::default(), p, q);
        let map = cross_map(&registration, &chart, &input, &PlanarIndex::new(&input));
        // Ends only: the holes were filled.
        let ends: Vec<u32> = input.mesh.boundary_loops().into_iter().flatten().collect();
        let end = |v: u32| input.mesh.positions[v as usize];
        let root = input.mesh.total_area().sqrt();
        let on = example.mesh.boundary_vertices();
        let distance = |v: usize| {
            let to = |h: &u32| to_segment(map.positions[v], end(input.mesh.tail(*h)), end(input.mesh.head(*h)));
            ends.iter().map(to).fold(f64::INFINITY, f64::min) / root
        };
        let worst = (0..on.len()).filter(|&v| on[v]).map(distance).fold(0.0, f64::max);
        println!("{}: {worst:.1e} of √area", path.file_name().unwrap_or_default().to_string_lossy());
        assert!(worst < 1e-9, "{}: {worst}", path.display());
        tried += 1;
    }
    assert!(tried > 0);
}
