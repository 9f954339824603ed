//! A scan with handles, opened: cut along the shortest loop around each, so that examples without handles can be laid on all of it.
//!
//! An animal that stands on a rock has three handles between its legs, and no animal among the examples has any. Both sides of
//! each cut count as holes that are filled where the surface is unfolded; the surface itself stays as it is. *Ours, not the
//! paper's.*

use std::collections::BTreeSet;
use std::sync::Arc;

use super::Segmented;
use super::mended::{SMALL_COMPONENTS_SHARE, by_area};
use super::split::{loops, shortest_ring};
use crate::mesh::tri::{NONE, TriMesh};
use crate::topology::{self, Patch, invariants, primitive, split_pinched};

/// A surface of more handles is no body with something between its limbs: it is cut into parts. *Untuned.*
const HANDLES_MAX: i64 = 6;
/// A closed surface of one handle is a torus where the shortest loops around and through it span this share of its area: those of a
/// tube bent to a ring span nearly all, two legs on a base .1, antlers that touch an ear .24. *Untuned.*
const TORUS_SHARE: f64 = 0.5;

/// The largest component of a surface without its handles, as one part; `None` where it has none, or too many, or is a torus, or is
/// no primitive even then.
pub(super) fn opened(surface: &TriMesh) -> Option<Segmented> {
    let sets = by_area(surface);
    let total: f64 = sets.iter().map(|set| set.0).sum();
    let left_out = sets.len().checked_sub(1)?;
    let (area, mut triangle_of) =
        sets.into_iter().next().filter(|first| first.0 >= (1.0 - SMALL_COMPONENTS_SHARE) * total)?;
    let (mut mesh, mut vertex_of) = topology::submesh(surface, &triangle_of);
    let found = invariants(&mesh);
    if !(1..=HANDLES_MAX).contains(&found.genus) {
        return None;
    }
    let is_torus = found.genus == 1 && found.boundary_loops == 0;
    let mut is_slit = vec![false; mesh.twins.len()];
    for left in (1..=found.genus).rev() {
        let (length, ring) = shortest_ring(&mesh, left)?;
        if is_torus {
            // Of the two from a vertex of the shortest one leads through the handle.
            let through = loops(&mesh, ring[0]).iter().map(|found| found.length).fold(0.0, f64::max);
            if length * through >= TORUS_SHARE * area {
                return None;
            }
        }
        for h in cut(&mesh, (0..ring.len()).map(|k| [ring[k], ring[(k + 1) % ring.len()]])) {
            mesh.twins[h as usize] = NONE;
            is_slit[h as usize] = true;
        }
        for copied in split_pinched(&mut mesh) {
            vertex_of.push(vertex_of[copied as usize]);
        }
        // A loop that touches a small hole twice cuts off what lies between.
        let sets = by_area(&mesh);
        if sets.len() > 1 {
            let kept = sets.into_iter().next().filter(|first| first.0 >= (1.0 - SMALL_COMPONENTS_SHARE) * area)?.1;
            let (part, of_mesh) = topology::submesh(&mesh, &kept);
            vertex_of = of_mesh.iter().map(|&v| vertex_of[v as usize]).collect();
            triangle_of = kept.iter().map(|&t| triangle_of[t as usize]).collect();
            is_slit = kept.iter().flat_map(|&t| (0..3).map(move |k| 3 * t + k)).map(|h| is_slit[h as usize]).collect();
            mesh = part;
        }
    }
    let (gaps, _) = primitive::gaps(&mesh, &|_| false);
    let is_filled = |edges: &Vec<u32>| edges.iter().all(|&h| is_slit[h as usize]) || gaps.contains(edges);
    let (holes, ends): (Vec<_>, Vec<_>) = mesh.boundary_loops().into_iter().partition(is_filled);
    let topology = primitive::with_ends(&mesh, ends.len()).ok()?;
    let part = Patch { topology, mesh: Arc::new(mesh), vertex_of, triangle_of, holes, left_out };
    Some(Segmented { handles_opened: found.genus as u32, ..Segmented::uncut(surface, vec![part]) })
}

/// The halfedges on both sides of some edges, each told by its vertices.
pub(super) fn cut(mesh: &TriMesh, edges: impl Iterator<Item = [u32; 2]>) -> Vec<u32> {
    let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let edges: BTreeSet<[u32; 2]> = edges.map(sorted).collect();
    let is_cut = |h: &u32| mesh.twin(*h) != NONE && edges.contains(&sorted([mesh.tail(*h), mesh.head(*h)]));
    (0..mesh.twins.len() as u32).filter(is_cut).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Vec3, prepare};
    use crate::topology::Topology;
    use crate::topology::tests::{grid, voxels};

    /// A torus of n × n squares whose tube has a radius of `tube`, around a ring of radius 1.
    fn torus(n: u32, tube: f64) -> TriMesh {
        let flat = grid(n, n, true, true);
        let turn = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(n);
        let place = |k: u32| {
            let (u, v) = (turn(k % n), turn(k / n));
            let radius = 1.0 + tube * v.cos();
            Vec3::new(radius * u.cos(), radius * u.sin(), tube * v.sin())
        };
        let positions = (0..flat.positions.len() as u32).map(place).collect();
        TriMesh::from_triangles(positions, flat.triangles.clone()).expect("a torus")
    }

    /// A block with a handle of two legs and a bar.
    fn with_handle() -> TriMesh {
        let is_solid = |[x, y, z]: [i32; 3]| {
            let is_leg = (4..6).contains(&y) && ((2..4).contains(&x) || (8..10).contains(&x)) && (6..10).contains(&z);
            let is_block = (0..12).contains(&x) && (0..10).contains(&y) && (0..6).contains(&z);
            is_block || is_leg || ((4..6).contains(&y) && (2..10).contains(&x) && (8..10).contains(&z))
        };
        TriMesh::clone(&prepare(&voxels(&is_solid, [12, 10, 11])).expect("closed").mesh)
    }

    #[test]
    fn a_handle_is_opened_and_its_surface_stays() {
        let body = with_handle();
        assert_eq!(invariants(&body).genus, 1);
        let found = opened(&body).expect("one handle");
        assert_eq!((found.handles_opened, found.parts.len()), (1, 1));
        let part = &found.parts[0];
        assert_eq!((part.topology, part.holes.len()), (Topology::Sphere, 2));
        assert!(found.mesh.positions == body.positions && found.mesh.triangles == body.triangles);
        for (own, &of_surface) in part.mesh.triangles.iter().zip(&part.triangle_of) {
            assert_eq!(own.map(|v| part.vertex_of[v as usize]), body.triangles[of_surface as usize]);
        }
        for (v, &of_surface) in part.vertex_of.iter().enumerate() {
            assert_eq!(part.mesh.positions[v], body.positions[of_surface as usize]);
        }
    }

    #[test]
    fn a_torus_stays_one_and_what_has_no_handle_is_as_it_is() {
        assert!(opened(&torus(40, 0.4)).is_none());
        assert!(opened(&torus(40, 0.03)).is_none());
        assert!(opened(&grid(20, 20, false, false)).is_none());
    }

    #[test]
    fn a_torus_with_a_hole_is_a_disc_once_it_is_opened() {
        let whole = torus(40, 0.4);
        let cut_out: Vec<u32> = (0..whole.triangles.len() as u32)
            .filter(|&t| whole.triangles[t as usize].iter().all(|&v| whole.positions[v as usize].x < 0.5))
            .collect();
        // A bent tube, open at both ends, has no handle.
        assert!(opened(&topology::submesh(&whole, &cut_out).0).is_none());
        let holed: Vec<u32> = (0..whole.triangles.len() as u32)
            .filter(|&t| whole.triangles[t as usize].iter().any(|&v| whole.positions[v as usize].x < 1.2))
            .collect();
        let found = opened(&topology::submesh(&whole, &holed).0).expect("one handle, and an end");
        assert_eq!((found.parts[0].topology, found.parts[0].holes.len()), (Topology::Disc, 2));
    }

    #[test]
    fn what_a_loop_cuts_off_between_it_and_holes_is_left_out() {
        let whole = torus(40, 0.4);
        for seed in 0..12u32 {
            // One triangle of eight is missing, and a cap, which is its end.
            let is_there = |&t: &u32| {
                let is_gone =
                    (t.wrapping_mul(2_654_435_761) ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b) >> 29
                        == 0;
                !is_gone && whole.triangles[t as usize].iter().any(|&v| whole.positions[v as usize].x < 1.2)
            };
            let kept: Vec<u32> = (0..whole.triangles.len() as u32).filter(is_there).collect();
            let found = opened(&topology::submesh(&whole, &kept).0).expect("one handle, and an end");
            let part = &found.parts[0];
            assert_eq!((topology::components(&part.mesh).1, invariants(&part.mesh).genus), (1, 0));
            assert_eq!(
                (part.triangle_of.len(), part.vertex_of.len()),
                (part.mesh.triangles.len(), part.mesh.positions.len())
            );
        }
    }
}
