//! Takes the faces of some segments out of a composition.

use super::model::Model;
use super::sound::{area, middle};
use super::stitched::Stitched;
use crate::map::assemble::select;
use crate::mesh::bvh::Bvh;
use crate::mesh::disjoint::Sets;
use crate::mesh::{PolyMesh, Vec3};
use std::collections::BTreeMap;

/// The faces of a composition that stand on some segments, and which of them, in order, bridge a gap. Each component of the mesh
/// belongs to the segment on which most of its area lies, so that segments that share a component of the input are not parted.
pub fn of_segments(query: &Model, made: &Stitched, segments: &[u32]) -> (PolyMesh, Vec<u32>) {
    let mesh = &*made.mesh;
    let ground = query.ground();
    let input = ground.input();
    let mut sets = Sets::new(mesh.positions.len());
    mesh.faces.iter().for_each(|face| face.iter().for_each(|&v| sets.join(face[0], v)));
    let tree = Bvh::new(input.surface);
    let middles: Vec<Vec3> = mesh.faces.iter().map(|face| middle(mesh, face)).collect();
    let mut areas: BTreeMap<(u32, u32), f64> = BTreeMap::new();
    for (face, near) in mesh.faces.iter().zip(tree.closest_to_all(&middles)) {
        if let Some(&owner) = input.owner.get(near.triangle as usize) {
            *areas.entry((sets.root(face[0]), owner)).or_default() += area(mesh, face);
        }
    }
    let mut owners: BTreeMap<u32, (f64, u32)> = BTreeMap::new();
    for ((component, owner), area) in areas {
        let most = owners.entry(component).or_insert((area, owner));
        if area > most.0 {
            *most = (area, owner);
        }
    }
    let mut stands = |face: &[u32]| owners.get(&sets.root(face[0])).is_some_and(|(_, owner)| segments.contains(owner));
    let keep: Vec<bool> = mesh.faces.iter().map(&mut stands).collect();
    let kept = (0u32..).zip(&keep).filter(|(_, keep)| **keep).map(|(face, _)| face);
    let bridging = (0u32..).zip(kept).filter(|(_, face)| made.bridging.binary_search(face).is_ok());
    let bridging = bridging.map(|(number, _)| number).collect();
    (select(mesh, &keep), bridging)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Format, Limits, Polygons, write};
    use crate::pipeline::{Cut, LayoutOwner, read};
    use std::sync::Arc;

    /// Sheets of n × n quads of unit side, each at its own place along x.
    fn sheets(at: &[f64], n: u32) -> PolyMesh {
        let (mut positions, mut faces) = (Vec::new(), Polygons::default());
        for x in at {
            let first = positions.len() as u32;
            let point =
                |(i, j): (u32, u32)| Vec3::new(x + f64::from(i) / f64::from(n), f64::from(j) / f64::from(n), 0.0);
            positions.extend((0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(point));
            let quad = |(i, j): (u32, u32)| [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            let corners = |at: (u32, u32)| quad(at).map(|(i, j)| first + j * (n + 1) + i);
            (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).for_each(|at| faces.push(&corners(at)));
        }
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    #[test]
    fn the_faces_of_one_segment_come_with_those_of_them_that_bridge_a_gap() {
        let bytes = write(&sheets(&[0.0, 2.0, 4.0], 6), Format::Obj).expect("writable");
        let query = read(&bytes, None, &Cut::default(), &Limits::default()).expect("three sheets");
        let mut made = Stitched::as_it_is(Arc::new(sheets(&[4.0, 0.0, 2.0], 3)), vec![LayoutOwner::Regular; 3]);
        made.bridging = vec![0, 9, 10, 18];
        let ends = query.patch(1).expect("a sheet").mesh.positions.iter().map(|p| p.x);
        let from = ends.fold(f64::INFINITY, f64::min);
        let (mesh, bridging) = of_segments(&query, &made, &[1]);
        assert_eq!(mesh.faces.len(), 9);
        assert!(mesh.positions.iter().all(|p| (from..=from + 1.0).contains(&p.x)), "from {from}");
        // The sheet that begins at 4, 0 and 2 comes first, second and third.
        let expected: &[u32] = if from == 0.0 { &[0, 1] } else { &[0] };
        assert_eq!(bridging, expected);
        assert_eq!(of_segments(&query, &made, &[]).0.faces.len(), 0);
        assert_eq!(of_segments(&query, &made, &[0, 1, 2]).1, made.bridging);
    }
}
