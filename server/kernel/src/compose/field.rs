//! A layout of quads along a smooth field of crosses, for a surface that no example fits.
//!
//! The surface is [remeshed](remesh) to even triangles; a [field](cross) of crosses is made smooth on it, along its
//! creases, boundaries and curvature; an [integer-grid map](grid_map) follows the field; its quads are
//! [extracted](extract). *Source:* Bommes, Zimmer, Kobbelt, *Mixed-integer quadrangulation* (2009); each file names its
//! own. *Ours, not the paper's:* what each file says.

mod cross;
mod curvature;
mod editable;
mod extract;
mod grid_map;
mod jumps;
mod lines;
mod pinched;
mod plane;
mod remesh;
mod rounding;
mod unfolded;

use super::net::Net;
use super::resolve::{Resolved, remove_doublets};
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use plane::Planes;

/// Edges of the triangles on which the field is solved, in edges of the quads: *untuned*.
const TRIANGLE_EDGE: f64 = 0.5;
/// Least length of a crease, in edges of the quads: that of a line with a loose end, of `compose/crease`.
const LINE_LENGTH_MIN: f64 = 10.0;
/// Rounds in which doublets and pockets are removed: *untuned*, one or two are taken.
const MENDING_ROUNDS: usize = 8;
/// Most triangles that are solved on.
const TRIANGLES_MAX: usize = 400_000;

/// A net of quads with edges of length `h` on a connected surface, given with its tree, with some sharp edges; a few
/// triangles may stand at its boundary. `None` where there is none.
pub(super) fn field_layout((surface, tree): (&TriMesh, &Bvh), sharp: &[u32], h: f64) -> Option<Net> {
    if !(h > 0.0 && h.is_finite()) {
        return None;
    }
    let sharp = &lines::long(surface, sharp, LINE_LENGTH_MIN * h);
    let remeshed = remesh::remesh((surface, tree), sharp, h * TRIANGLE_EDGE, TRIANGLES_MAX)?;
    let (mesh, sharp) = (&remeshed.mesh, &remeshed.sharp);
    let planes = Planes::new(mesh);
    let field = cross::cross_field(mesh, &planes, sharp, h)?;
    let map = grid_map::grid_map(mesh, &planes, &field, sharp, h)?;
    let unfolded = unfolded::UnfoldedTriangles::new(mesh, sharp, &map, 2 * TRIANGLES_MAX)?;
    let mut net = extract::quads(&unfolded);
    // A doublet that goes may leave two edges between the same vertices, and the other way round.
    for _ in 0..MENDING_ROUNDS {
        if !pinched::cut_tips(&mut net) {
            return None;
        }
        let mut removed = Resolved::default();
        remove_doublets(&mut net, &mut removed);
        if removed.doublets == 0 {
            break;
        }
    }
    pinched::keep_largest(&mut net);
    pinched::cut_tips(&mut net).then_some(net)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check_structure, extraordinary};
    use crate::mesh::Vec3;
    use crate::topology::tests::grid;

    fn made(surface: &TriMesh, h: f64) -> crate::mesh::PolyMesh {
        field_layout((surface, &Bvh::new(surface)), &[], h).expect("there is a layout").into_mesh().0
    }

    /// An egg with three different axes.
    fn egg() -> TriMesh {
        let (n, m) = (48u32, 40u32);
        let at = |i: u32, j: u32| {
            let (a, b) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(m));
            let (a, b) = (a * std::f64::consts::TAU, b * std::f64::consts::PI);
            Vec3::new(b.sin() * a.cos(), 1.3 * b.sin() * a.sin(), -1.9 * b.cos())
        };
        let mut positions = vec![at(0, 0)];
        positions.extend((1..m).flat_map(|j| (0..n).map(move |i| at(i, j))));
        positions.push(at(0, m));
        let number = |i: u32, j: u32| 1 + (j - 1) * n + i % n;
        let last = positions.len() as u32 - 1;
        let mut triangles = Vec::new();
        for i in 0..n {
            triangles.push([0, number(i + 1, 1), number(i, 1)]);
            triangles.push([last, number(i, m - 1), number(i + 1, m - 1)]);
            for j in 1..m - 1 {
                triangles.push([number(i, j), number(i + 1, j), number(i + 1, j + 1)]);
                triangles.push([number(i, j), number(i + 1, j + 1), number(i, j + 1)]);
            }
        }
        TriMesh::from_triangles(positions, triangles).expect("closed")
    }

    #[test]
    fn a_torus_is_a_grid() {
        let surface = grid(72, 36, true, true);
        let mesh = made(&surface, (surface.total_area() / 1500.0).sqrt());
        assert_eq!(check_structure(&mesh, TopologyCounts::of(&surface)), Ok(()));
        assert_eq!(extraordinary(&mesh), 0);
        assert!((1350..=1650).contains(&mesh.faces.len()), "{}", mesh.faces.len());
    }

    #[test]
    fn a_square_is_a_grid_with_its_corners() {
        let surface = grid(24, 24, false, false);
        let mesh = made(&surface, 0.1);
        assert_eq!(check_structure(&mesh, TopologyCounts::of(&surface)), Ok(()));
        assert_eq!((mesh.faces.len(), extraordinary(&mesh)), (100, 0));
        for corner in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let away = |p: &Vec3| (p - Vec3::new(corner.0, corner.1, 0.0)).norm();
            assert!(mesh.positions.iter().any(|p| away(p) < 1e-6), "{corner:?}");
        }
    }

    #[test]
    fn an_egg_has_the_eight_corners_of_a_box_and_the_same_bits_each_time() {
        let surface = egg();
        let h = (surface.total_area() / 2000.0).sqrt();
        let mesh = made(&surface, h);
        assert_eq!(check_structure(&mesh, TopologyCounts::of(&surface)), Ok(()));
        assert!((8..=12).contains(&extraordinary(&mesh)), "{}", extraordinary(&mesh));
        assert!((1800..=2200).contains(&mesh.faces.len()), "{}", mesh.faces.len());
        assert_eq!(made(&surface, h), mesh);
    }

    #[test]
    fn what_is_smaller_than_a_quad_has_no_layout_or_one_that_is_no_panic() {
        let surface = grid(12, 6, true, true);
        for h in [3.0, 10.0, 1e6, f64::NAN] {
            let _ = field_layout((&surface, &Bvh::new(&surface)), &[], h);
        }
        let quad = grid(1, 1, false, false);
        let _ = field_layout((&quad, &Bvh::new(&quad)), &[], 0.3);
    }
}
