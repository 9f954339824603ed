//! Which rows are turned: those against their neighbours, and closed components that are inside out.

use super::surface::Surface;
use crate::mesh::disjoint::Sides;
use crate::mesh::error::MeshError;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::{NONE, Vec3};

/// A closed component is inside out when its volume is below minus this times its area to the power 3/2 (a sphere has
/// 0.094 of it).
const VOLUME_MIN: f64 = 1e-6;

/// The two sides of the surface as the shared vertices of the upload demand them.
///
/// # Errors
/// [`MeshError::OneSided`] where they contradict each other.
pub(super) fn sides(surface: &Surface) -> Result<Sides, MeshError> {
    let mut sides = Sides::new(surface.rows.len());
    for c in 0..surface.corner_count() {
        let d = surface.twins[c as usize];
        if d == NONE || d < c {
            continue;
        }
        let (row_c, row_d) = (surface.row_of[c as usize], surface.row_of[d as usize]);
        if !sides.join(row_c, row_d, surface.tail(c) == surface.tail(d)) {
            let vertices = [surface.tail(c), surface.head(c)];
            return Err(MeshError::OneSided { face: surface.face_of[row_c as usize], vertices });
        }
    }
    Ok(sides)
}

/// Turns the fewer rows of each component that disagree, then closed components whose volume is negative. Returns whether
/// each row was turned.
pub(super) fn turn(surface: &mut Surface, mut sides: Sides, positions: &[Vec3], repairs: &mut Repairs) -> Vec<bool> {
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

fn note(kind: RepairKind, rows: &[bool], surface: &Surface, repairs: &mut Repairs) {
    if let Some(first) = rows.iter().position(|turned| *turned) {
        repairs.note_many(kind, rows.iter().filter(|turned| **turned).count() as u64, surface.face_of[first]);
    }
}

/// Whether the component of each root is closed and has a negative volume.
fn inside_out(surface: &Surface, placed: &[(u32, bool)], turned: &[bool], positions: &[Vec3]) -> Vec<bool> {
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
