//! Landmarks: points of the example that a caller holds on points of the input.
//!
//! The similarity that carries them there best is a start. Each pulls, all along, at the nodes to which its corners belong. Three
//! points leave open which side of their plane is out, so the normals count as well. *Ours, not a paper's.*

use super::input_surface::InputSurface;
use super::place::normal_at;
use super::rest::Rest;
use super::similarity::Similarity;
use crate::mesh::Vec3;
use crate::mesh::bvh::Closest;
use crate::mesh::tri::TriMesh;

/// What a landmark pulls with in the elastic stage; all the example's vertices together pull with 1.
pub(super) const HELD: f64 = 0.05;
/// What all landmarks together pull with in the similarity stage.
pub(super) const HELD_AS_WHOLE: f64 = 3.0;
/// What a normal counts beside its point, and its length in root mean square distances of the landmarks from their middle.
const NORMAL_COUNTS: f64 = 0.25;
const NORMAL_LENGTH: f64 = 0.5;

/// A point of the example, by its vertices, that goes to a point of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VertexLandmark {
    /// Vertices of the example with their weights, whose sum is 1.
    pub corners: [(u32, f64); 3],
    /// The point of the input.
    pub to: Closest,
}

/// A point of the axis of one of the example's limbs, which goes to the axis of one of the input's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPoint {
    /// Vertices about it with their weights, whose sum is 1.
    pub corners: [(u32, f64); 3],
    /// The point within the input.
    pub to: Vec3,
}

/// A landmark in the frame of a start.
#[derive(Clone, Copy, Debug)]
pub(super) struct FramedLandmark {
    pub(super) corners: [(u32, f64); 3],
    pub(super) to: Vec3,
}

impl VertexLandmark {
    /// Holds a place of the example's mesh on a point of the input; `None` where the place is none.
    pub fn between(example: &TriMesh, from: &Closest, to: Closest) -> Option<Self> {
        let corners = example.triangles.get(from.triangle as usize)?;
        Some(Self { corners: [0, 1, 2].map(|k| (corners[k], from.barycentric[k])), to })
    }

    /// How far it is from its point where the example's vertices have these positions.
    pub fn distance(&self, positions: &[Vec3]) -> f64 {
        (self.of(positions) - self.to.point).norm()
    }

    /// The vertex of the example that it is nearest to: the one with the greatest weight.
    pub fn vertex(&self) -> u32 {
        let first = self.corners[0];
        self.corners.iter().fold(first, |a, b| if b.1 > a.1 { *b } else { a }).0
    }

    pub(super) fn seen_from(&self, frame: &Similarity) -> FramedLandmark {
        FramedLandmark { corners: self.corners, to: frame.undo(&self.to.point) }
    }

    fn of(&self, values: &[Vec3]) -> Vec3 {
        weighted(&self.corners, values)
    }
}

impl AxisPoint {
    pub(super) fn seen_from(&self, frame: &Similarity) -> FramedLandmark {
        FramedLandmark { corners: self.corners, to: frame.undo(&self.to) }
    }
}

impl FramedLandmark {
    /// Where it is.
    pub(super) fn at(&self, positions: &[Vec3]) -> Vec3 {
        weighted(&self.corners, positions)
    }
}

fn weighted(corners: &[(u32, f64); 3], values: &[Vec3]) -> Vec3 {
    corners.iter().map(|(v, w)| values[*v as usize] * *w).sum()
}

/// The similarity that carries the landmarks from where the example rests to the input best, and by how much it misses them, in
/// parts of their spread; `None` where they are one point.
pub(super) fn carried(
    rest: &Rest,
    ground: &InputSurface<'_>,
    landmarks: &[VertexLandmark],
) -> Option<(Similarity, f64)> {
    let ends: Vec<(Vec3, Vec3)> = landmarks.iter().map(|l| (l.of(&rest.positions), l.to.point)).collect();
    let first = Similarity::fit(ends.iter().map(|(p, q)| (*p, *q, 1.0)))?;
    let count = ends.len() as f64;
    let middle = ends.iter().map(|e| e.0).sum::<Vec3>() / count;
    let spread = (ends.iter().map(|e| (e.0 - middle).norm_squared()).sum::<f64>() / count).sqrt();
    let size = NORMAL_LENGTH * spread;
    let mut pairs: Vec<(Vec3, Vec3, f64)> = ends.iter().map(|(p, q)| (*p, *q, 1.0)).collect();
    for (l, (p, q)) in landmarks.iter().zip(&ends) {
        let from = l.of(&rest.normals).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
        pairs.push((p + from * size, q + normal_at(ground, &l.to) * size * first.scale, NORMAL_COUNTS));
    }
    let found = Similarity::fit(pairs.iter().copied())?;
    let missed = pairs.iter().map(|(p, q, w)| w * (found.apply(p) - q).norm_squared()).sum::<f64>();
    Some((found, (missed / count).sqrt() / (found.scale * spread)))
}
