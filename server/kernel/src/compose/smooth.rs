//! Smoothing with projection back onto the input, most at the seams and fading away from them.
//!
//! x_v ← π(x_v + w_v·(mean of its neighbours − x_v)), π the nearest point of the input, w_v = 1 on what stitching touched
//! and less with each edge of distance. A vertex on the true boundary takes the mean of its two neighbours there, and is
//! put back onto the boundary. *Source:* paper §6. *Ours, not the paper's:* the weights, so that the parts' own layout
//! stays as the artist made it.

use super::net::{Net, Step};
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh};
use std::sync::Arc;

/// Edges away from what was touched at which smoothing ends.
const REACH: usize = 5;
/// Weight with which the inside of a regular layout is smoothed.
const INSIDE_WEIGHT: f64 = 0.5;
/// Rounds in which new faces get their room, whatever smoothing is asked for.
pub const OPENING_ROUNDS: u32 = 24;

/// The input as smoothing sees it.
#[derive(Clone, Debug)]
pub struct Target {
    surface: Arc<Bvh>,
    border: Bvh,
}

impl Target {
    /// Prepares an input.
    pub fn new(mesh: &TriMesh) -> Self {
        let edge = |h: &u32| [mesh.tail(*h), mesh.head(*h), mesh.head(*h)];
        let border: Vec<u32> = (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE).collect();
        let triangles: Vec<[u32; 3]> = border.iter().map(edge).collect();
        let border = TriMesh { positions: mesh.positions.clone(), triangles, ..TriMesh::default() };
        Self { surface: Arc::new(Bvh::new(mesh)), border: Bvh::new(&border) }
    }

    /// The search tree of the surface.
    pub(super) fn tree(&self) -> &Arc<Bvh> {
        &self.surface
    }

    /// The nearest point of the surface.
    pub fn onto_surface(&self, p: Vec3) -> Vec3 {
        self.surface.closest(p).point
    }

    /// The nearest points of the surface.
    pub fn all_onto_surface(&self, points: &[Vec3]) -> Vec<Vec3> {
        self.surface.closest_to_all(points).into_iter().map(|near| near.point).collect()
    }

    /// The nearest point of the true boundary.
    pub fn onto_border(&self, p: Vec3) -> Vec3 {
        self.border.closest(p).point
    }

    /// The place on the surface nearest to a point.
    pub fn location(&self, p: Vec3) -> Location {
        self.surface.closest(p).into()
    }

    /// The triangle nearest to a point.
    pub fn triangle(&self, p: Vec3) -> u32 {
        self.surface.closest(p).triangle
    }
}

/// How each vertex of a net is smoothed.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Vertices that move, with their weight.
    moving: Vec<(u32, f64)>,
    /// The neighbours that each of them follows.
    follows: Vec<Vec<u32>>,
    /// Whether each lies on the true boundary.
    on_border: Vec<bool>,
}

impl Plan {
    /// Smooths around `touched`.
    pub fn new(net: &Net, touched: &[u32]) -> Self {
        let mut from: Vec<u32> = touched.iter().copied().filter(|&v| !net.at(v).is_empty()).collect();
        from.sort_unstable();
        from.dedup();
        let weight = |d: usize| 1.0 - d as f64 / REACH as f64;
        let rings = net.rings(&from, REACH - 1).into_iter().enumerate();
        let moving = rings.flat_map(|(d, ring)| ring.into_iter().map(move |v| (v, weight(d)))).collect();
        let mut plan = Self { moving, follows: Vec::new(), on_border: Vec::new() };
        for &(v, _) in &plan.moving {
            let fan = net.fan(v).unwrap_or_default();
            let on_border = fan.last() == Some(&Step::Gap);
            let edges: Vec<u32> =
                fan.iter().filter_map(|s| if let Step::Edge(w) = s { Some(*w) } else { None }).collect();
            let ends = [edges.first(), edges.last()];
            plan.follows.push(if on_border { ends.into_iter().flatten().copied().collect() } else { edges });
            plan.on_border.push(on_border);
        }
        plan
    }

    /// Smooths everything inside, but for the boundary and what is `held`.
    pub fn inside(net: &Net, held: &[u32]) -> Self {
        let mut plan = Self { moving: Vec::new(), follows: Vec::new(), on_border: Vec::new() };
        for v in (0..net.positions.len() as u32).filter(|v| !held.contains(v)) {
            let fan = net.fan(v).unwrap_or_default();
            if fan.is_empty() || fan.last() == Some(&Step::Gap) {
                continue;
            }
            plan.moving.push((v, INSIDE_WEIGHT));
            plan.follows.push(fan.iter().filter_map(|s| if let Step::Edge(w) = s { Some(*w) } else { None }).collect());
            plan.on_border.push(false);
        }
        plan
    }

    /// From now on vertices on the true boundary stay.
    pub fn hold_border(&mut self) {
        for (follows, _) in self.follows.iter_mut().zip(&self.on_border).filter(|(_, on_border)| **on_border) {
            follows.clear();
        }
    }

    /// Goes `rounds` rounds.
    pub fn run(&self, net: &mut Net, target: &Target, rounds: u32) {
        let following = (0..self.moving.len()).filter(|k| !self.follows[*k].is_empty());
        let (border, inside): (Vec<usize>, Vec<usize>) = following.partition(|k| self.on_border[*k]);
        for _ in 0..rounds {
            let to: Vec<Vec3> = inside.iter().map(|&k| self.aim(net, k)).collect();
            let on_border: Vec<Vec3> = border.iter().map(|&k| target.onto_border(self.aim(net, k))).collect();
            let moved = inside.iter().zip(target.all_onto_surface(&to)).chain(border.iter().zip(on_border));
            moved.for_each(|(&k, p)| net.positions[self.moving[k].0 as usize] = p);
        }
    }

    /// Where one that moves would go if it were not put back onto the input.
    fn aim(&self, net: &Net, k: usize) -> Vec3 {
        let (v, weight) = self.moving[k];
        let here = net.positions[v as usize];
        let follows = &self.follows[k];
        let mean = follows.iter().map(|&w| net.positions[w as usize]).sum::<Vec3>() / follows.len() as f64;
        here + (mean - here) * weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    #[test]
    fn a_vertex_out_of_place_goes_back_and_the_far_ones_stay() {
        let mut input = grid(12, 12, false, false);
        input.positions.iter_mut().for_each(|p| *p *= 12.0);
        let target = Target::new(&input);
        let mut net = sheet(12, 12);
        let before = net.positions.clone();
        let middle = 6 * 13 + 6;
        net.positions[middle] += Vec3::new(0.9, 0.8, 0.0);
        Plan::new(&net, &[middle as u32]).run(&mut net, &target, 40);
        assert!((net.positions[middle] - before[middle]).norm() < 0.35);
        assert_eq!(net.positions[0], before[0]);
        let off = net.positions.iter().map(|p| p.z.abs()).fold(0.0, f64::max);
        assert!(off < 1e-12);
    }

    #[test]
    fn the_true_boundary_stays_on_its_curve() {
        let input = grid(8, 8, false, false);
        let target = Target::new(&input);
        let mut net = sheet(8, 8);
        net.positions.iter_mut().for_each(|p| *p /= 8.0);
        net.positions[4].x += 0.05;
        Plan::new(&net, &[4]).run(&mut net, &target, 10);
        assert!(net.positions[4].y.abs() < 1e-12 && (net.positions[4].x - 0.5).abs() < 0.04);
    }
}
