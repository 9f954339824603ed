//! The similarity stage: iterated closest points, both ways, until the example rests on the input as a whole.
//!
//! Each round fits (s, R, t) to e_i → x + 0.7 n(n·d) + 0.3 d, d the way to the partner, over the example's points and,
//! turned round, over the input's samples. *Source:* Besl and McKay 1992; Chen and Medioni 1991 (planes). *Ours, not the
//! papers':* both ways at once, without which a surface that ends inside the other slides off its place.

use super::input_surface::{FramedSamples, Samples, sixfold};
use super::matches::{Partners, back, onto, sigma};
use super::rest::{Nodes, Rest};
use super::similarity::Similarity;
use super::tree::KdTree;
use crate::mesh::Vec3;
use crate::numerics::stop::Stop;

/// Share of the way along the surface that a target keeps.
const TANGENTIAL: f64 = 0.3;
/// σ is at least this, in √area of the example.
const SIGMA_MIN: f64 = 0.01;
/// A round that moves no point farther than this is the last.
const STILL: f64 = 2e-3;

/// Points of the example that stand for it while it moves rigidly, with a tree over them at rest.
#[derive(Clone, Debug)]
pub(super) struct RigidPoints {
    points: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<f64>,
    rim: Vec<bool>,
    tree: KdTree<6>,
}

impl RigidPoints {
    pub(super) fn new(rest: &Rest, nodes: &Nodes) -> Self {
        let of = |values: &[Vec3]| nodes.vertices.iter().map(|v| values[*v as usize]).collect::<Vec<_>>();
        let (points, normals) = (of(&rest.positions), of(&rest.normals));
        let tree = KdTree::new(points.iter().zip(&normals).map(|(x, n)| sixfold(x, n)));
        let rim = nodes.vertices.iter().map(|v| rest.rim[*v as usize]).collect();
        Self { points, normals, areas: nodes.areas.clone(), rim, tree }
    }

    fn moved(&self, by: &Similarity) -> (Vec<Vec3>, Vec<Vec3>) {
        (self.points.iter().map(|p| by.apply(p)).collect(), self.normals.iter().map(|n| by.rotation * n).collect())
    }

    /// At most `rounds` rounds from where the example rests; `None` when stopped. `share`: the area, in the frame, that
    /// a sample of `sent` stands for; `held`: points at rest, where they go, and what they count.
    pub(super) fn align(
        &self,
        seen: &FramedSamples,
        (sent, share): (&Samples, f64),
        held: &[(Vec3, Vec3, f64)],
        rounds: usize,
        stop: Stop<'_>,
    ) -> Option<Similarity> {
        let mut found = Similarity::identity();
        let mut partners = Partners::default();
        for _ in 0..rounds {
            if stop() {
                return None;
            }
            let (points, normals) = self.moved(&found);
            let mut pairs = self.onto(seen, &points, &normals, &mut partners);
            self.back((sent, share), &found, &mut partners, &mut pairs);
            pairs.extend_from_slice(held);
            let Some(next) = Similarity::fit(pairs.iter().copied()) else { break };
            let step = self.points.iter().zip(&points).map(|(e, x)| (next.apply(e) - x).amax()).fold(0.0, f64::max);
            found = next;
            if step < STILL {
                break;
            }
        }
        Some(found)
    }

    fn onto(
        &self,
        seen: &FramedSamples,
        points: &[Vec3],
        normals: &[Vec3],
        partners: &mut Partners,
    ) -> Vec<(Vec3, Vec3, f64)> {
        let met = onto(seen, points, normals, SIGMA_MIN, &mut partners.onto);
        let pair = |i: usize| {
            let (way, n) = (met.targets[i] - points[i], met.normals[i]);
            let target = points[i] + n * n.dot(&way) * (1.0 - TANGENTIAL) + way * TANGENTIAL;
            (self.points[i], target, met.weights[i] * self.areas[i])
        };
        (0..points.len()).map(pair).collect()
    }

    fn back(
        &self,
        (sent, share): (&Samples, f64),
        found: &Similarity,
        partners: &mut Partners,
        pairs: &mut Vec<(Vec3, Vec3, f64)>,
    ) {
        let at_rest = sent.seen_from(found);
        let met = back(&at_rest, &self.tree, &self.normals, &self.rim, &mut partners.back);
        let ways: Vec<Vec3> =
            (0..sent.points.len()).map(|k| found.apply(&self.points[met.met[k] as usize]) - sent.points[k]).collect();
        let distances: Vec<f64> = ways.iter().map(|w| w.norm()).collect();
        let sigma = sigma(&distances, &met.weights, SIGMA_MIN);
        for k in 0..ways.len() {
            let (e, n) = (self.points[met.met[k] as usize], sent.normals[k]);
            let target = found.apply(&e) - ways[k] * TANGENTIAL - n * n.dot(&ways[k]) * (1.0 - TANGENTIAL);
            pairs.push((e, target, met.weights[k] * (-(distances[k] / sigma).powi(2)).exp() * share));
        }
    }
}
