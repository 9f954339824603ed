//! A mapped example as a part: its polygons, with the edges that tessellation put in dissolved.
//!
//! *Source:* paper §6 (phantom edges).

use super::net::Net;
use crate::map::assemble::Winding;
use crate::mesh::tri::{NONE, TriMesh, next};
use crate::mesh::{PolyMesh, Vec3};

/// The polygons of an example's patch at the positions to which its vertices were mapped. A polygon of which the patch
/// holds several pieces, or a ring, stays in triangles.
pub fn polygons(patch: &TriMesh, positions: &[Vec3], winding: Winding) -> PolyMesh {
    let mut by_polygon: Vec<(u32, u32)> = patch.polygon_of.iter().enumerate().map(|(t, &p)| (p, t as u32)).collect();
    by_polygon.sort_unstable();
    let mut faces: Vec<Vec<u32>> = Vec::new();
    for run in by_polygon.chunk_by(|a, b| a.0 == b.0) {
        match outline(patch, run) {
            Some(face) => faces.push(face),
            None => faces.extend(run.iter().map(|(_, t)| patch.triangles[*t as usize].to_vec())),
        }
    }
    if winding == Winding::Reversed {
        faces.iter_mut().for_each(|f| f.reverse());
    }
    Net::new(positions.to_vec(), faces).into_mesh().0
}

/// The corners around the triangles of a polygon, if they have one outline.
fn outline(patch: &TriMesh, run: &[(u32, u32)]) -> Option<Vec<u32>> {
    let inside = |h: u32| {
        let g = patch.twin(h);
        g != NONE && patch.phantom[h as usize] && patch.polygon_of[g as usize / 3] == run[0].0
    };
    let border: Vec<u32> = run.iter().flat_map(|(_, t)| 3 * t..3 * t + 3).filter(|&h| !inside(h)).collect();
    let start = *border.first()?;
    let (mut face, mut h) = (Vec::new(), start);
    loop {
        face.push(patch.tail(h));
        if face.len() > border.len() {
            return None;
        }
        h = next(h);
        while inside(h) {
            h = next(patch.twin(h));
        }
        if h == start {
            break;
        }
    }
    let distinct = face.iter().enumerate().all(|(k, v)| !face[..k].contains(v));
    (face.len() == border.len() && distinct).then_some(face)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn quads_come_back_from_their_triangles() {
        let mut mesh = grid(3, 2, false, false);
        for t in 0..12 {
            mesh.polygon_of[t] = t as u32 / 2;
        }
        for cell in 0..6 {
            // Triangles (a, b, c) and (a, c, d): the diagonal is the third edge of the first, the first of the second.
            mesh.phantom[6 * cell + 2] = true;
            mesh.phantom[6 * cell + 3] = true;
        }
        let part = polygons(&mesh, &mesh.positions, Winding::Kept);
        assert_eq!(part.faces.len(), 6);
        assert!(part.faces.iter().all(|c| c.len() == 4));
        let turned = polygons(&mesh, &mesh.positions, Winding::Reversed);
        let mut back = turned.faces.face(0).to_vec();
        back.reverse();
        assert_eq!(back, part.faces.face(0));
    }
}
