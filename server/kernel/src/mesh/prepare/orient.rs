//! Which rows are turned: those against their neighbours, and closed components that are inside out.

use super::surface::CornerRows;
use crate::mesh::disjoint::Sides;
use crate::mesh::error::MeshError;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::{NONE, Vec3};
use std::collections::VecDeque;

/// A closed component is inside out when its volume is below minus this times its area to the power 3/2 (a sphere has
/// 0.094 of it).
const VOLUME_MIN: f64 = 1e-6;

/// The two sides of the surface as the shared vertices of the upload demand them. A surface with one side is cut where its
/// sides contradict each other if `may_cut`.
///
/// # Errors
/// [`MeshError::OneSided`] where they do and it may not be cut.
pub(super) fn sides(surface: &mut CornerRows, may_cut: bool, repairs: &mut Repairs) -> Result<Sides, MeshError> {
    let mut sides = Sides::new(surface.rows.len());
    let Some(first) = joined(surface, &mut sides, &edges(surface)).next() else { return Ok(sides) };
    if !may_cut {
        let vertices = [surface.tail(first), surface.head(first)];
        return Err(MeshError::OneSided { face: surface.face_of[surface.row_of[first as usize] as usize], vertices });
    }
    // From face to face, so that the cut is short: it runs where a front that spreads over the surface meets itself.
    let mut sides = Sides::new(surface.rows.len());
    let cut: Vec<u32> = joined(surface, &mut sides, &spreading(surface)).collect();
    repairs.note_many(RepairKind::CutEdges, cut.len() as u64, cut.first().map_or(0, |c| surface.tail(*c)));
    for c in cut {
        let d = surface.twins[c as usize];
        surface.twins[c as usize] = NONE;
        surface.twins[d as usize] = NONE;
    }
    Ok(sides)
}

/// A halfedge of each edge of two faces.
fn edges(surface: &CornerRows) -> Vec<u32> {
    let is_first = |c: &u32| surface.twins[*c as usize] != NONE && surface.twins[*c as usize] > *c;
    (0..surface.corner_count()).filter(is_first).collect()
}

/// The same in the order in which a front from the first row of each component comes across them: first those over which it
/// spreads.
fn spreading(surface: &CornerRows) -> Vec<u32> {
    let rows = surface.rows.len();
    let mut is_reached = vec![false; rows];
    let mut is_crossed = vec![false; surface.twins.len()];
    let (mut order, mut front) = (Vec::new(), VecDeque::new());
    for first in 0..rows as u32 {
        if std::mem::replace(&mut is_reached[first as usize], true) {
            continue;
        }
        front.push_back(first);
        while let Some(row) = front.pop_front() {
            let start = surface.rows.start(row as usize) as u32;
            for c in start..start + surface.rows.face(row as usize).len() as u32 {
                let d = surface.twins[c as usize];
                if d == NONE {
                    continue;
                }
                let next = surface.row_of[d as usize];
                if !std::mem::replace(&mut is_reached[next as usize], true) {
                    is_crossed[c.min(d) as usize] = true;
                    order.push(c.min(d));
                    front.push_back(next);
                }
            }
        }
    }
    order.extend(edges(surface).into_iter().filter(|c| !is_crossed[*c as usize]));
    order
}

/// Joins the rows at edges in order; those at which the sides contradict what was demanded before.
fn joined<'a>(surface: &'a CornerRows, sides: &'a mut Sides, edges: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
    edges.iter().copied().filter(|&c| {
        let d = surface.twins[c as usize];
        let (row_c, row_d) = (surface.row_of[c as usize], surface.row_of[d as usize]);
        !sides.join(row_c, row_d, surface.tail(c) == surface.tail(d))
    })
}

/// Turns the fewer rows of each component that disagree, then closed components whose volume is negative. Returns whether
/// each row was turned.
pub(super) fn turn(surface: &mut CornerRows, mut sides: Sides, positions: &[Vec3], repairs: &mut Repairs) -> Vec<bool> {
    let rows = surface.rows.len();
    let placed: Vec<(u32, bool)> = (0..rows as u32).map(|r| sides.root(r)).collect();
    let mut on_side = vec![[0u32; 2]; rows];
    placed.iter().for_each(|(root, side)| on_side[*root as usize][usize::from(*side)] += 1);
    let mut turned: Vec<bool> = placed
        .iter()
        .map(|(root, side)| {
            let [with_root, against] = on_side[*root as usize];
            *side == (with_root >= against)
        })
        .collect();
    note(RepairKind::TurnedFaces, &turned, surface, repairs);
    let inward = inside_out(surface, &placed, &turned, positions);
    let inside_out: Vec<bool> = placed.iter().map(|(root, _)| inward[*root as usize]).collect();
    note(RepairKind::InsideOutFaces, &inside_out, surface, repairs);
    turned.iter_mut().zip(&inside_out).for_each(|(turned, other)| *turned ^= other);
    if turned.iter().any(|turned| *turned) {
        surface.turn(&turned);
    }
    turned
}

fn note(kind: RepairKind, rows: &[bool], surface: &CornerRows, repairs: &mut Repairs) {
    if let Some(first) = rows.iter().position(|turned| *turned) {
        repairs.note_many(kind, rows.iter().filter(|turned| **turned).count() as u64, surface.face_of[first]);
    }
}

/// Whether the component of each root is closed and has a negative volume.
fn inside_out(surface: &CornerRows, placed: &[(u32, bool)], turned: &[bool], positions: &[Vec3]) -> Vec<bool> {
    let mut closed = vec![true; placed.len()];
    for c in (0..surface.corner_count()).filter(|c| surface.twins[*c as usize] == NONE) {
        closed[placed[surface.row_of[c as usize] as usize].0 as usize] = false;
    }
    let (mut volume, mut area) = (vec![0.0; placed.len()], vec![0.0; placed.len()]);
    for (r, row) in surface.rows.iter().enumerate() {
        let root = placed[r].0 as usize;
        let origin = positions[surface.rows.face(root)[0] as usize];
        let at = |k: usize| positions[row[k] as usize] - origin;
        let sign = if turned[r] { -1.0 } else { 1.0 };
        for k in 1..row.len() - 1 {
            let normal = (at(k) - at(0)).cross(&(at(k + 1) - at(0)));
            volume[root] += sign * at(0).dot(&normal) / 6.0;
            area[root] += 0.5 * normal.norm();
        }
    }
    (0..placed.len()).map(|r| closed[r] && volume[r] < -VOLUME_MIN * area[r].powf(1.5)).collect()
}
