//! Correspondences, both ways: what the example's vertices meet on the input, and what the input's samples meet on the
//! example.
//!
//! ω = exp(−(d/σ)²) · max(cos, 0)², σ = 3 × the median distance; 0 where the partner lies on the other surface's
//! rim, as it then may have none. *Source:* Zhang 1994 (σ from the distances); Chetverikov et al. 2005 (free ends).

use super::input_surface::{FramedSamples, Samples, sixfold};
use super::tree::KdTree;
use crate::mesh::Vec3;

/// σ in median distances.
pub(super) const SIGMA: f64 = 3.0;

/// Holds for each of the example's points its target on the input.
#[derive(Clone, Debug, Default)]
pub(super) struct ForwardMatches {
    pub(super) targets: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) weights: Vec<f64>,
    pub(super) sigma: f64,
}

/// Holds for each of the input's samples the example's point that meets it.
#[derive(Clone, Debug, Default)]
pub(super) struct BackwardMatches {
    pub(super) met: Vec<u32>,
    pub(super) weights: Vec<f64>,
}

/// Partners of the last round, where the next begins to look; it finds the same without them.
#[derive(Clone, Debug, Default)]
pub(super) struct Partners {
    pub(super) onto: Vec<u32>,
    pub(super) back: Vec<u32>,
}

/// Targets of points with normals; σ is at least `floor`. `last` has their partners of the last round, and is given the new.
pub(super) fn onto(
    seen: &FramedSamples,
    points: &[Vec3],
    normals: &[Vec3],
    floor: f64,
    last: &mut Vec<u32>,
) -> ForwardMatches {
    let mut found = ForwardMatches::default();
    let mut distances = Vec::with_capacity(points.len());
    last.resize(points.len(), u32::MAX);
    for ((x, n), last) in points.iter().zip(normals).zip(last) {
        *last = seen.tree.nearest_from(&sixfold(x, n), *last).map_or(0, |f| f.0);
        let near = *last as usize;
        let (c, m) = (seen.samples.points[near], seen.samples.normals[near]);
        distances.push((c - x).norm());
        found.targets.push(c);
        found.normals.push(m);
        found.weights.push(if seen.samples.rim[near] { 0.0 } else { facing(n, &m) });
    }
    found.sigma = sigma(&distances, &found.weights, floor);
    found.weights.iter_mut().zip(&distances).for_each(|(w, d)| *w *= (-(d / found.sigma).powi(2)).exp());
    found
}

/// What the samples meet: `tree` holds the points with their normals; `rim` says where the example ends. The weights are
/// without the distance, which the stages judge each in its way. `last` as for [`onto`].
pub(super) fn back(
    samples: &Samples,
    tree: &KdTree<6>,
    normals: &[Vec3],
    rim: &[bool],
    last: &mut Vec<u32>,
) -> BackwardMatches {
    let mut found = BackwardMatches::default();
    last.resize(samples.points.len(), u32::MAX);
    for ((y, n), last) in samples.points.iter().zip(&samples.normals).zip(last) {
        *last = tree.nearest_from(&sixfold(y, n), *last).map_or(0, |f| f.0);
        let v = *last as usize;
        let ends = rim.get(v).copied().unwrap_or(true) || normals.is_empty();
        found.met.push(*last);
        found.weights.push(if ends { 0.0 } else { facing(n, &normals[v]) });
    }
    found
}

/// 3 × the median of the distances that count.
pub(super) fn sigma(distances: &[f64], weights: &[f64], floor: f64) -> f64 {
    let mut counted: Vec<f64> = distances.iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(d, _)| *d).collect();
    if counted.is_empty() {
        return 1.0;
    }
    let half = counted.len() / 2;
    let (_, median, _) = counted.select_nth_unstable_by(half, f64::total_cmp);
    (SIGMA * *median).max(floor)
}

fn facing(n: &Vec3, m: &Vec3) -> f64 {
    n.dot(m).max(0.0).powi(2)
}
