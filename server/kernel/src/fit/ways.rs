//! The ways in which tips that are matched lay a symmetric example.
//!
//! Limbs of what is symmetric match as well back to front, with left and right exchanged, and the pictures do not tell for sure which
//! way it lies. So each match has a likely way and its twin. *Ours, not a paper's.*

use crate::mesh::TriMesh;
use crate::settle::{Symmetry, VertexLandmark};

/// Ways that match an input's tips with places of the example less apart than this, in its √area, are one.
const SAME: f64 = 0.03;

/// Tips of an example that are matched with an input's.
#[derive(Clone, Debug)]
pub struct MatchedTips {
    /// Points of the example with theirs on the input.
    pub landmarks: Vec<VertexLandmark>,
    /// True where the pictures match mirrored.
    pub mirrored: bool,
}

/// A way to lay an example after its tips.
#[derive(Clone, Debug)]
pub(super) struct TipPairing {
    /// Points of the example with theirs on the input.
    pub(super) landmarks: Vec<VertexLandmark>,
    /// True where the example lies mirrored.
    pub(super) mirrored: bool,
}

/// The ways that the pictures speak for, one a match: what is symmetric need never lie mirrored.
pub(super) fn likely(matches: &[MatchedTips], symmetry: &Symmetry) -> Vec<TipPairing> {
    matches.iter().map(|tips| way(tips, symmetry, tips.mirrored)).collect()
}

/// The twins of the `likely` ways, less those that are likely themselves. `example`: the mesh that is laid.
pub(super) fn twins(
    matches: &[MatchedTips],
    symmetry: &Symmetry,
    example: &TriMesh,
    likely: &[TipPairing],
) -> Vec<TipPairing> {
    let reach = SAME * example.total_area().sqrt();
    let at = |tip: &VertexLandmark| example.positions[tip.vertex() as usize];
    let same = |a: &VertexLandmark, b: &VertexLandmark| a.to.point == b.to.point && (at(a) - at(b)).norm() <= reach;
    let is_one = |one: &TipPairing, other: &TipPairing| {
        let has = |tip: &VertexLandmark| other.landmarks.iter().any(|known| same(tip, known));
        one.landmarks.len() == other.landmarks.len() && one.landmarks.iter().all(has)
    };
    let mut twins: Vec<TipPairing> = Vec::new();
    for twin in matches.iter().map(|tips| way(tips, symmetry, !tips.mirrored)) {
        if likely.iter().chain(&twins).all(|known| !is_one(known, &twin)) {
            twins.push(twin);
        }
    }
    twins
}

fn way(tips: &MatchedTips, symmetry: &Symmetry, is_swapped: bool) -> TipPairing {
    let swapped = |tip: &VertexLandmark| if is_swapped { symmetry.swapped_landmark(tip) } else { *tip };
    TipPairing { landmarks: tips.landmarks.iter().map(swapped).collect(), mirrored: false }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::mesh::bvh::Bvh;
    use crate::topology::tests::grid;

    #[test]
    fn a_match_has_a_twin_with_left_and_right_exchanged_unless_that_is_matched_too() {
        let flat = grid(20, 15, false, false);
        let place = |p: &Vec3| Vec3::new(2.0 * p.x - 1.0, 1.3 * p.y, 0.3 * (4.0 * (2.0 * p.x - 1.0).abs() + p.y).sin());
        let mesh = TriMesh::from_triangles(flat.positions.iter().map(place).collect(), flat.triangles.clone())
            .expect("a sheet");
        let (symmetry, tree) = (Symmetry::of(&mesh).expect("symmetric"), Bvh::new(&mesh));
        let tip = |v: usize| VertexLandmark {
            corners: [(v as u32, 1.0), (v as u32, 0.0), (v as u32, 0.0)],
            to: tree.closest(mesh.positions[v]),
        };
        let landmarks: Vec<VertexLandmark> = [0, 20, 330].map(tip).to_vec();
        let one = MatchedTips { landmarks: landmarks.clone(), mirrored: false };
        let ways = likely(std::slice::from_ref(&one), &symmetry);
        let found = twins(std::slice::from_ref(&one), &symmetry, &mesh, &ways);
        assert_eq!((ways.len(), found.len()), (1, 1));
        let side = |way: &TipPairing, k: usize| mesh.positions[way.landmarks[k].vertex() as usize].x;
        assert_eq!(ways[0].landmarks, landmarks);
        assert!(side(&ways[0], 0) * side(&found[0], 0) < -0.5, "left for right");
        assert!(found[0].landmarks.iter().zip(&landmarks).all(|(a, b)| a.to == b.to));
        let both = [one.clone(), MatchedTips { mirrored: true, ..one }];
        assert!(twins(&both, &symmetry, &mesh, &likely(&both, &symmetry)).is_empty(), "all are likely");
    }
}
