//! What a scan of several pieces is meant to be: its pieces primitives with small holes filled, its small components left out.
//!
//! [`topology::primitive`] mends a scan of one piece. Here each component is mended alone; a component with a boundary is a
//! small component if it has less than 1 % of the area, and all small components together have at most 10 %. A closed component is an object,
//! however small, and stays. *Ours, not the paper's.*

use super::{Seam, Segmented};
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

/// The parts of the largest pieces of a surface that was cut up, `most` at most; the pieces that would be too many are small components.
/// As it was, where these would have more than [`SMALL_COMPONENTS_SHARE`] of the area.
pub(super) fn of_largest_pieces(cut: Segmented, most: usize) -> Segmented {
    if cut.parts.len() <= most {
        return cut;
    }
    let sets = by_area(&cut.mesh);
    let (mut kept, mut small, mut left_out) = (vec![false; cut.parts.len()], 0.0, 0);
    let mut count = 0;
    for (area, set) in &sets {
        let mut own: Vec<usize> = set.iter().map(|&t| cut.part_of[t as usize] as usize).collect();
        own.sort_unstable();
        own.dedup();
        if left_out == 0 && count + own.len() <= most {
            count += own.len();
            own.into_iter().for_each(|part| kept[part] = true);
        } else {
            small += area;
            left_out += 1;
        }
    }
    let total: f64 = sets.iter().map(|set| set.0).sum();
    if count == 0 || small > SMALL_COMPONENTS_SHARE * total {
        return cut;
    }
    let mut number_of = vec![0; kept.len()];
    (0..kept.len()).filter(|&part| kept[part]).zip(0u32..).for_each(|(part, number)| number_of[part] = number);
    let parts = cut.parts.into_iter().zip(&kept).filter(|(_, kept)| **kept).map(|(part, _)| part);
    let mut parts: Vec<Patch> = parts.collect();
    parts[0].left_out += left_out;
    let seams = cut.seams.into_iter().filter(|seam| kept[seam.parts[0] as usize]);
    let seams = seams.map(|seam| Seam { parts: seam.parts.map(|part| number_of[part as usize]), ..seam }).collect();
    let part_of = cut.part_of.iter().map(|&part| number_of[part as usize]).collect();
    Segmented { parts, seams, part_of, ..cut }
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
        let found_parts: Vec<_> = found.parts.iter().map(|p| (p.topology, p.holes.len(), p.left_out)).collect();
        assert_eq!(found_parts, [(Topology::Disc, 3, 1), (Topology::Disc, 2, 0)]);
        for part in &found.parts {
            for (t, &whole) in part.triangle_of.iter().enumerate() {
                let of_whole = surface.triangles[whole as usize];
                assert_eq!(part.mesh.triangles[t].map(|v| part.vertex_of[v as usize]), of_whole);
            }
        }
    }

    #[test]
    fn of_too_many_pieces_the_largest_are_kept_and_the_others_are_small_components() {
        let of: Vec<(f64, &[u32])> = [0.05, 1.0, 0.06, 0.9, 0.07].map(|size| (size, &[][..])).into();
        let surface = sheets(&of);
        let cut = || crate::segment::segment(&surface, crate::segment::PartCount::AsNeeded).expect("cut");
        let areas = |cut: &Segmented| cut.parts.iter().map(|p| p.mesh.total_area()).collect::<Vec<_>>();
        assert_eq!((cut().parts.len(), of_largest_pieces(cut(), 5).parts.len()), (5, 5));
        let found = of_largest_pieces(cut(), 3);
        assert_eq!((areas(&found), found.parts[0].left_out), (areas(&cut())[..3].to_vec(), 2));
        for (part, number) in found.parts.iter().zip(0u32..) {
            assert!(part.triangle_of.iter().all(|&t| found.part_of[t as usize] == number));
        }
        assert_eq!(of_largest_pieces(cut(), 1).parts.len(), 5, "nearly half is no small component");
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
