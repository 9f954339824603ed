//! Pieces of a scan that lie exactly on another.
//!
//! A piece (faces joined by common vertices) goes where each of its faces runs over the same points, in the same sense, as a face of
//! a piece before it that stays. A piece of which only some faces do stays whole.

use super::surface::CornerRows;
use crate::mesh::Vec3;
use crate::mesh::disjoint::Sets;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::weld::equal_points;
use std::collections::HashSet;

/// Leaves out pieces that repeat others.
pub(super) fn leave_out(surface: CornerRows, positions: &[Vec3], repairs: &mut Repairs) -> CornerRows {
    let Some(pieces) = pieces(&surface, positions.len()) else { return surface };
    let class_of = equal_points(positions);
    let mut keep = vec![true; surface.rows.len()];
    let mut seen: HashSet<Vec<u32>> = HashSet::new();
    for piece in pieces {
        let rings: Vec<Vec<u32>> = piece.iter().map(|r| ring(surface.rows.face(*r as usize), &class_of)).collect();
        if rings.iter().all(|ring| seen.contains(ring)) {
            piece.iter().for_each(|r| keep[*r as usize] = false);
        } else {
            seen.extend(rings);
        }
    }
    let gone = keep.iter().filter(|keep| !**keep).count();
    let Some(first) = keep.iter().position(|keep| !keep) else { return surface };
    repairs.note_many(RepairKind::DuplicateFaces, gone as u64, surface.face_of[first]);
    surface.retain(&keep)
}

/// The rows of each piece, in the order of their first rows; `None` where there is one piece.
fn pieces(surface: &CornerRows, vertices: usize) -> Option<Vec<Vec<u32>>> {
    let mut sets = Sets::new(vertices);
    for r in 0..surface.rows.len() {
        surface.rows.face(r).windows(2).for_each(|two| sets.join(two[0], two[1]));
    }
    let mut piece_of = vec![u32::MAX; vertices];
    let mut pieces: Vec<Vec<u32>> = Vec::new();
    for r in 0..surface.rows.len() {
        let root = sets.root(surface.rows.face(r)[0]) as usize;
        if piece_of[root] == u32::MAX {
            piece_of[root] = pieces.len() as u32;
            pieces.push(Vec::new());
        }
        pieces[piece_of[root] as usize].push(r as u32);
    }
    (pieces.len() > 1).then_some(pieces)
}

/// The points of a row from the lowest on, in its sense.
fn ring(row: &[u32], class_of: &[u32]) -> Vec<u32> {
    let mut ring: Vec<u32> = row.iter().map(|v| class_of[*v as usize]).collect();
    let first = (0..ring.len()).min_by_key(|k| ring[*k]).unwrap_or(0);
    ring.rotate_left(first);
    ring
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolyMesh;

    fn left(points: &[u32], faces: &[&[u32]]) -> Vec<u32> {
        let positions = points.iter().map(|x| Vec3::new(f64::from(*x), f64::from(x * x), 0.0)).collect();
        let poly = PolyMesh { positions, faces: faces.iter().copied().collect(), ..PolyMesh::default() };
        let mut repairs = Repairs::default();
        leave_out(CornerRows::cleaned(&poly, &mut repairs), &poly.positions, &mut repairs).face_of
    }

    #[test]
    fn pieces_at_the_same_places_go_and_those_that_run_back_stay() {
        let points = [0, 1, 2, 0, 1, 2, 0, 1, 2, 3];
        assert_eq!(left(&points, &[&[0, 1, 2], &[4, 5, 3], &[6, 8, 7]]), [0, 2]);
        assert_eq!(left(&points, &[&[0, 1, 2], &[4, 5, 9]]), [0, 1], "another place");
        assert_eq!(left(&points, &[&[0, 1, 2], &[0, 1, 2]]), [0, 1], "one piece: others look at its faces");
    }

    #[test]
    fn a_piece_that_repeats_another_in_part_stays_whole() {
        let points = [0, 1, 2, 3, 0, 1, 2, 4];
        assert_eq!(left(&points, &[&[0, 1, 2], &[0, 2, 3], &[4, 5, 6], &[4, 6, 7]]), [0, 1, 2, 3]);
        assert_eq!(left(&points, &[&[0, 1, 2], &[0, 2, 3], &[4, 5, 6]]), [0, 1], "all of it is there already");
    }
}
