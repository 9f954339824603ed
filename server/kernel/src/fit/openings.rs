//! A layout that lies on one side of a cut, without the faces that cover the openings the cut left.
//!
//! A closed example on a figure that was cut from its base has soles, which lie over the openings at its ankles. The base goes
//! on there. *Ours, not the paper's.*

use super::is_on_rim;
use crate::map::assemble::select;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh};
use crate::mesh::{PolyMesh, prepare};
use crate::topology;

/// The largest piece of those faces of a layout that keep off the rim of the surface it lies on. No vertex of it is passed by
/// the boundary twice. `None` where nothing is left.
pub fn off_rim(laid: &PolyMesh, surface: &TriMesh) -> Option<PolyMesh> {
    let tree = Bvh::new(surface);
    let on_rim: Vec<bool> = laid.positions.iter().map(|&x| is_on_rim(surface, &tree.closest(x))).collect();
    let keep: Vec<bool> = laid.faces.iter().map(|face| !face.iter().any(|&v| on_rim[v as usize])).collect();
    let mut left = largest(&select(laid, &keep))?;
    loop {
        let pinched = pinched(&left)?;
        if !pinched.contains(&true) {
            return Some(left);
        }
        let keep: Vec<bool> = left.faces.iter().map(|face| !face.iter().any(|&v| pinched[v as usize])).collect();
        left = largest(&select(&left, &keep))?;
    }
}

/// The largest piece of a layout by area.
fn largest(laid: &PolyMesh) -> Option<PolyMesh> {
    let mesh = prepare(laid).ok()?.mesh;
    let area = |piece: &Vec<u32>| piece.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
    let piece = topology::pieces(&mesh).into_iter().max_by(|a, b| area(a).total_cmp(&area(b)).then(b.cmp(a)))?;
    let mut keep = vec![false; laid.faces.len()];
    piece.iter().for_each(|&t| keep[mesh.polygon_of[t as usize] as usize] = true);
    Some(select(laid, &keep))
}

/// Which vertices of a layout the boundary passes more than once.
fn pinched(laid: &PolyMesh) -> Option<Vec<bool>> {
    let prepared = prepare(laid).ok()?;
    let mesh = &prepared.mesh;
    // A vertex that preparing has copied lies in the same place as another.
    let mut passes = vec![0u32; laid.positions.len()];
    for h in (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE) {
        let face = laid.faces.face(mesh.polygon_of[h as usize / 3] as usize);
        let at = mesh.positions[mesh.tail(h) as usize];
        if let Some(&v) = face.iter().find(|&&v| laid.positions[v as usize] == at) {
            passes[v as usize] += 1;
        }
    }
    Some(passes.into_iter().map(|count| count > 1).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Polygons, Vec3};
    use crate::topology::tests::grid;

    /// n × n quads over a square from (low, low) to (high, high).
    fn sheet(n: u32, low: f64, high: f64) -> PolyMesh {
        let at = |k: u32| low + (high - low) * f64::from(k) / f64::from(n);
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| Vec3::new(at(i), at(j), 0.0))).collect();
        let mut faces = Polygons::default();
        for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
            faces.push(&[(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| j * (n + 1) + i));
        }
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    #[test]
    fn what_reaches_over_the_rim_is_left_out_and_what_lies_within_stays() {
        let surface = grid(20, 20, false, false);
        let within = sheet(6, 0.2, 0.8);
        assert_eq!(off_rim(&within, &surface).map(|left| left.faces.len()), Some(36));
        // Two columns and two rows of vertices lie beyond, or on the rim.
        let over = sheet(6, 0.2, 1.1);
        let left = off_rim(&over, &surface).expect("what lies within");
        assert_eq!(left.faces.len(), 25);
        assert!(off_rim(&sheet(3, 2.0, 3.0), &surface).is_none());
    }

    #[test]
    fn faces_that_meet_at_a_corner_only_are_no_piece() {
        let mut laid = sheet(4, 0.1, 0.9);
        let keep: Vec<bool> = (0..16).map(|f| matches!(f, 0 | 1 | 4 | 5 | 10 | 11 | 14 | 15)).collect();
        laid = select(&laid, &keep);
        let left = off_rim(&laid, &grid(20, 20, false, false)).expect("one of both");
        assert_eq!(left.faces.len(), 4);
    }
}
