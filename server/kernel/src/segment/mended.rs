//! What a scan of several pieces is meant to be: its pieces primitives with small holes filled, its small components left out.
//!
//! [`topology::primitive`] mends a scan of one piece. Here each component is mended alone; a component with a boundary is a
//! small component if it has less than 1 % of the area, and all small components together have at most 10 %. A closed component is an object,
//! however small, and stays. *Ours, not the paper's.*

use super::Segmented;
use crate::mesh::tri::TriMesh;
use crate::topology::{self, Components, Patch};

/// A component with a boundary and less than this share of the area is a small component.
const SMALL_COMPONENT_SHARE: f64 = 0.01;
/// Share of the area that all small components may have together.
pub(super) const SMALL_COMPONENTS_SHARE: f64 = 0.1;

/// The pieces of a surface with their areas, the largest first.
pub(super) fn by_area(surface: &TriMesh) -> Vec<(f64, Vec<u32>)> {
    let area = |set: &[u32]| set.iter().map(|&t| surface.area(t as usize)).sum();
    let mut sets: Vec<(f64, Vec<u32>)> = topology::pieces(surface).into_iter().map(|set| (area(&set), set)).collect();
    sets.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    sets
}

/// One part a piece, the largest first; `None` where a piece is no primitive even when its small holes are filled, or
/// nothing has to be filled: such a surface is to be cut as it is.
pub(super) fn pieces(surface: &TriMesh) -> Option<Segmented> {
    let sets = by_area(surface);
    let total: f64 = sets.iter().map(|set| set.0).sum();
    let (mut parts, mut left_out, mut small) = (Vec::new(), 0, 0.0);
    for (area, set) in sets {
        let (mesh, vertex_of) = topology::submesh(surface, &set);
        if area < SMALL_COMPONENT_SHARE * total && !mesh.boundary_loops().is_empty() {
            left_out += 1;
            small += area;
            if small > SMALL_COMPONENTS_SHARE * total {
                return None;
            }
            continue;
        }
        let patch = topology::primitive(&mesh, Components::Refuse).ok()?;
        parts.push(Patch {
            vertex_of: patch.vertex_of.iter().map(|&v| vertex_of[v as usize]).collect(),
            triangle_of: patch.triangle_of.iter().map(|&t| set[t as usize]).collect(),
            ..patch
        });
    }
    if parts.iter().all(|part| part.holes.is_empty()) {
        return None;
    }
    parts.first_mut()?.left_out = left_out;
    Some(Segmented::uncut(surface, parts))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::Topology;
    use crate::topology::tests::grid;

    /// Sheets of 24 × 24 squares side by side without some of their triangles, each times a factor.
    fn sheets(of: &[(f64, &[u32])]) -> TriMesh {
        let sheet = grid(24, 24, false, false);
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for (k, (factor, without)) in of.iter().enumerate() {
            let first = positions.len() as u32;
            positions.extend(sheet.positions.iter().map(|p| p * *factor + Vec3::new(2.0 * k as f64, 0.0, 0.0)));
            let kept = sheet.triangles.iter().zip(0u32..).filter(|(_, t)| !without.contains(t));
            triangles.extend(kept.map(|(t, _)| t.map(|v| v + first)));
        }
        TriMesh::from_triangles(positions, triangles).expect("sheets")
    }

    #[test]
    fn pieces_with_small_holes_are_discs_and_small_components_are_left_out() {
        let surface = sheets(&[(0.8, &[333, 500]), (0.05, &[]), (1.0, &[200, 611, 777])]);
        let found = pieces(&surface).expect("two pieces");
        let told: Vec<_> = found.parts.iter().map(|p| (p.topology, p.holes.len(), p.left_out)).collect();
        assert_eq!(told, [(Topology::Disc, 3, 1), (Topology::Disc, 2, 0)]);
        for part in &found.parts {
            for (t, &whole) in part.triangle_of.iter().enumerate() {
                let of_whole = surface.triangles[whole as usize];
                assert_eq!(part.mesh.triangles[t].map(|v| part.vertex_of[v as usize]), of_whole);
            }
        }
    }

    #[test]
    fn what_has_no_hole_to_fill_is_cut_as_it_is() {
        assert!(pieces(&sheets(&[(1.0, &[]), (0.8, &[])])).is_none());
        // Many small components are no small components.
        let many: Vec<(f64, &[u32])> =
            std::iter::once((1.0, &[333u32, 500][..])).chain([(0.09, &[][..]); 16]).collect();
        assert!(pieces(&sheets(&many)).is_none());
    }
}
