//! A surface's own triangles as quads, where no layout can stand.
//!
//! Triangles are joined in pairs, the best first, as an artist's quads were cut before, and those that are left are resolved as any
//! others. Where that leaves one over, or makes no such mesh, each triangle is cut into three quads. *Ours, not the paper's.*

use super::check::{TopologyCounts, check_structure};
use super::net::Net;
use super::resolve::resolve;
use super::subdivide::subdivide;
use crate::mesh::tri::TriMesh;
use std::ops::RangeInclusive;

/// Of so many triangles some are joined: a lone one would become a quad with a straight corner, and between those that are left of
/// very many the search for a way takes long.
const JOINED: RangeInclusive<usize> = 2..=20_000;

/// The quads: half as many as triangles, or a few more; else three times as many.
pub(super) fn own_quads(surface: &TriMesh) -> Net {
    let triangles = Net::new(surface.positions.clone(), surface.triangles.iter().map(|t| t.to_vec()).collect());
    let joined = JOINED.contains(&surface.triangles.len()).then(|| {
        let mut net = triangles.clone();
        resolve(&mut net);
        net
    });
    let holds = |net: &Net| check_structure(&net.clone().into_mesh().0, TopologyCounts::of(surface)).is_ok();
    joined.filter(holds).unwrap_or_else(|| subdivide(&triangles))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::tests::grid;

    #[test]
    fn quads_that_were_cut_into_triangles_come_back() {
        let surface = grid(9, 7, false, false);
        let net = own_quads(&surface);
        assert_eq!((net.faces().count(), 2 * 9 * 7), (9 * 7, surface.triangles.len()));
        assert!(net.faces().all(|(_, c)| c.len() == 4));
    }

    #[test]
    fn a_closed_surface_takes_about_half_as_many_quads_and_a_lone_triangle_three() {
        let surface = grid(10, 6, true, true);
        assert_eq!(own_quads(&surface).faces().count(), 60);
        let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let lone = TriMesh::from_triangles(positions, vec![[0, 1, 2]]).expect("a triangle");
        assert_eq!(own_quads(&lone).faces().count(), 3);
    }
}
