//! Faces that repeat another.
//!
//! Copies with the same winding are left out. Of a face and its reverse one is left out where the two are a sheet drawn
//! from both sides, and both where they are a wall between two closed parts.

use super::surface::CornerRows;
use crate::mesh::disjoint::Sets;
use crate::mesh::repair::{RepairKind, Repairs};

/// Leaves out rows that repeat another.
pub(super) fn leave_out(surface: CornerRows, repairs: &mut Repairs) -> CornerRows {
    let mut keep = vec![true; surface.rows.len()];
    let mut opposed = Vec::new();
    for (forward, backward) in groups(&surface) {
        for same in [&forward, &backward] {
            same.iter().skip(1).for_each(|r| keep[*r as usize] = false);
        }
        if let (Some(a), Some(b)) = (forward.first(), backward.first()) {
            opposed.push([*a.min(b), *a.max(b)]);
        }
    }
    let walls = walls(&surface, &keep, &opposed);
    for ([first, second], wall) in opposed.into_iter().zip(walls) {
        keep[second as usize] = false;
        keep[first as usize] = !wall;
    }
    let gone = keep.iter().filter(|keep| !**keep).count();
    let Some(first) = keep.iter().position(|keep| !keep) else { return surface };
    repairs.note_many(RepairKind::DuplicateFaces, gone as u64, surface.face_of[first]);
    surface.retain(&keep)
}

/// Rows with the same ring of vertices: those that run forward and those that run backward. Only where there are several.
fn groups(surface: &CornerRows) -> Vec<(Vec<u32>, Vec<u32>)> {
    let mut hashed: Vec<(u64, u32)> =
        surface.rows.iter().enumerate().map(|(r, row)| (ring_hash(row), r as u32)).collect();
    hashed.sort_unstable();
    let mut groups = Vec::new();
    for run in hashed.chunk_by(|x, y| x.0 == y.0).filter(|run| run.len() > 1) {
        let mut rings: Vec<(Vec<u32>, bool, u32)> = run
            .iter()
            .map(|(_, r)| {
                let (ring, backward) = ring(surface.rows.face(*r as usize));
                (ring, backward, *r)
            })
            .collect();
        rings.sort_unstable();
        for group in rings.chunk_by(|x, y| x.0 == y.0).filter(|group| group.len() > 1) {
            let rows = |side: bool| group.iter().filter(|(_, b, _)| *b == side).map(|(_, _, r)| *r).collect();
            groups.push((rows(false), rows(true)));
        }
    }
    groups
}

/// A hash that depends neither on where the ring starts nor on its direction.
fn ring_hash(row: &[u32]) -> u64 {
    let mix = |x: u64| {
        let x = (x ^ (x >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9)
    };
    let edge = |a: u32, b: u32| mix(super::surface::edge_key(a, b));
    row.iter().zip(row.iter().cycle().skip(1)).map(|(a, b)| edge(*a, *b)).fold(0, u64::wrapping_add)
}

/// The ring from its smallest vertex towards the smaller neighbour, and whether that is backward.
fn ring(row: &[u32]) -> (Vec<u32>, bool) {
    let n = row.len();
    let start = (0..n).min_by_key(|k| row[*k]).unwrap_or(0);
    let backward = row[(start + n - 1) % n] < row[(start + 1) % n];
    let step = if backward { n - 1 } else { 1 };
    ((0..n).map(|k| row[(start + k * step) % n]).collect(), backward)
}

/// Whether each pair of a face and its reverse belongs to a wall: a patch of such pairs with an edge at which exactly two
/// other faces meet.
fn walls(surface: &CornerRows, keep: &[bool], opposed: &[[u32; 2]]) -> Vec<bool> {
    if opposed.is_empty() {
        return Vec::new();
    }
    let mut pair_of = vec![u32::MAX; surface.rows.len()];
    for (p, rows) in opposed.iter().enumerate() {
        rows.iter().for_each(|r| pair_of[*r as usize] = p as u32);
    }
    let mut patches = Sets::new(opposed.len());
    let mut at_wall = vec![false; opposed.len()];
    for run in surface.keyed_edges().chunk_by(|x, y| x.0 == y.0) {
        let rows = || run.iter().map(|(_, c)| surface.row_of[*c as usize] as usize).filter(|r| keep[*r]);
        let others = rows().filter(|r| pair_of[*r] == u32::MAX).count();
        let mut pairs = rows().map(|r| pair_of[r]).filter(|p| *p != u32::MAX);
        if let Some(first) = pairs.next() {
            at_wall[first as usize] |= others == 2;
            pairs.for_each(|p| patches.join(first, p));
        }
    }
    let mut is_wall = vec![false; opposed.len()];
    for p in 0..opposed.len() {
        is_wall[patches.root(p as u32) as usize] |= at_wall[p];
    }
    (0..opposed.len()).map(|p| is_wall[patches.root(p as u32) as usize]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolyMesh;

    fn left(faces: &[&[u32]]) -> Vec<u32> {
        let poly = PolyMesh { faces: faces.iter().copied().collect(), ..PolyMesh::default() };
        let mut repairs = Repairs::default();
        leave_out(CornerRows::cleaned(&poly, &mut repairs), &mut repairs).face_of
    }

    #[test]
    fn copies_are_found_wherever_they_start() {
        assert_eq!(left(&[&[0, 1, 2, 3], &[2, 3, 0, 1], &[4, 5, 6]]), [0, 2]);
        assert_eq!(left(&[&[0, 1, 2, 3], &[0, 2, 1, 3]]), [0, 1], "another ring over the same vertices");
    }

    #[test]
    fn a_sheet_drawn_from_both_sides_keeps_one() {
        assert_eq!(left(&[&[0, 1, 2], &[1, 3, 2], &[2, 1, 0], &[2, 3, 1]]), [0, 1]);
    }

    #[test]
    fn a_wall_between_two_tetrahedra_goes() {
        let faces: [&[u32]; 8] =
            [&[0, 1, 2], &[2, 1, 0], &[0, 3, 1], &[1, 3, 2], &[2, 3, 0], &[0, 1, 4], &[1, 2, 4], &[2, 0, 4]];
        assert_eq!(left(&faces), [2, 3, 4, 5, 6, 7]);
    }
}
