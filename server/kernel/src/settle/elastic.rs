//! The elastic stage: the example bends, coarse to fine, until it lies on the input.
//!
//! E(x, L) = β Σ w_ij |x_j − x_i − ½(L_i + L_j)(e_j − e_i)|² + α Σ w_ij |L_i − L_j|² + δ Σ a_i |L_i − S_i|²
//! + Σ a_v ω_v [(n·(x_v − c_v))² + ε |x_v − c_v|²] + Σ_y a_y ω_y (n_y·(x_{v(y)} − g_y))².
//!
//! x_i is a node's place, L_i its affine map, S_i the similarity nearest to L_i (of the round before). The scale r below
//! which details are smoothed sets α = r⁴, β = α/(r/2)², δ = α. *Sources:* Amberg et al. 2007 (a map each vertex,
//! stiffness by steps, both in one linear system); Li et al. 2008 (planes). *Ours, not the papers':* edges couple to the
//! mean of two maps, which makes α a bending energy; similarities are free instead of rotations; the input's samples
//! pull too. The data term couples the coordinates: conjugate gradients, preconditioned by the same system with
//! tr/3 of each vertex's term, which all three share, so that one factor serves a whole scale.

use super::held::{FramedLandmark, HELD};
use super::input_surface::{FramedSamples, Samples, sixfold};
use super::matches::{BackwardMatches, Partners, back, onto};
use super::rest::{Nodes, Pose, Rest, vertex_normals};
use super::similarity::nearest_scaled_rotation;
use super::tree::KdTree;
use crate::mesh::Vec3;
use crate::numerics::stop::Stop;
use crate::numerics::{Factored, Pattern, side_by_side};
use nalgebra::Matrix3;

/// ε: what counts along the surface.
const TANGENTIAL: f64 = 0.02;
/// β = α/(this · r)².
const COUPLING: f64 = 0.5;
/// Steps of conjugate gradients, and the part of the start's error at which they end.
const STEPS_MAX: usize = 12;
const ERROR: f64 = 1e-6;
/// Part of r by which the last round of a scale moves.
const STILL: f64 = 2e-3;
/// σ is at least this, in √area of the example.
const SIGMA_MIN: f64 = 0.005;
/// A sample meets nothing farther than 3 σ and this.
const REACH: f64 = 0.05;
/// Keeps what nothing holds from floating.
const FLOATING: f64 = 1e-9;

/// What pulls at the nodes.
#[derive(Clone, Debug)]
struct Pull {
    /// Σ ω (n nᵀ + ε) of each node.
    stiff: Vec<Matrix3<f64>>,
    /// Σ ω (n nᵀ + ε) · target.
    to: Vec<Vec3>,
}

/// One set of nodes with its pattern.
#[derive(Clone, Debug)]
pub(super) struct Body<'a> {
    rest: &'a Rest,
    pub(super) nodes: &'a Nodes,
    /// Vertices that look for partners, with their areas.
    data: &'a Nodes,
    /// e_j − e_i of each edge.
    ways: Vec<Vec3>,
    pattern: Pattern,
}

/// Holds what the input shows to one scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScaleView<'a> {
    pub(super) seen: &'a FramedSamples,
    pub(super) sent: &'a Samples,
    /// Area, in the frame, that a sample sent stands for.
    pub(super) share: f64,
    pub(super) held: &'a [FramedLandmark],
}

/// α, β, δ.
#[derive(Clone, Copy, Debug)]
struct Stiffness {
    bend: f64,
    couple: f64,
    keep: f64,
}

/// The pattern of the system whose unknowns are the nodes' places and maps, in one coordinate: four a node, (x, L's row); `None` where
/// it does not fit in memory.
pub(super) fn pattern(nodes: &Nodes) -> Option<Pattern> {
    let between = nodes.edges.iter().flat_map(|e| (0..16u32).map(move |k| (4 * e.0 + k / 4, 4 * e.1 + k % 4)));
    let within = (0..nodes.vertices.len() as u32)
        .flat_map(|i| [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(p, q)| (4 * i + p, 4 * i + q)));
    Pattern::new(4 * nodes.vertices.len(), between.chain(within)).ok()
}

impl<'a> Body<'a> {
    /// Of nodes, with the [pattern] of their system.
    pub(super) fn new(rest: &'a Rest, (nodes, pattern): (&'a Nodes, Pattern), data: &'a Nodes) -> Self {
        let at = |k: u32| rest.positions[nodes.vertices[k as usize] as usize];
        let ways = nodes.edges.iter().map(|(i, j, _)| at(*j) - at(*i)).collect();
        Self { rest, nodes, data, ways, pattern }
    }

    /// Rounds at scale r towards the input; `None` when stopped or where there is nothing to solve.
    pub(super) fn bend(
        &self,
        pose: &mut Pose,
        (view, partners): (ScaleView<'_>, &mut Partners),
        scale: (f64, usize),
        stop: Stop<'_>,
    ) -> Option<()> {
        self.rounds(pose, scale, stop, |pose| self.pull(pose, view, partners))
    }

    /// Rounds at scale r towards places that the vertices are given, with weights. These are no robust ones: whatever
    /// redescends lets go of fingers.
    pub(super) fn follow(
        &self,
        pose: &mut Pose,
        (places, weights): (&[Vec3], &[f64]),
        held: &[FramedLandmark],
        scale: (f64, usize),
        stop: Stop<'_>,
    ) -> Option<()> {
        self.rounds(pose, scale, stop, |pose| {
            let all = pose.deformed(self.rest, self.nodes);
            let mut pull = self.no_pull();
            self.hold(pose, &all, held, &mut pull);
            for (v, area) in self.data.vertices.iter().zip(&self.data.areas) {
                let (v, k) = (*v as usize, self.nodes.owner[*v as usize] as usize);
                let w = weights[v] * area;
                pull.stiff[k] += Matrix3::from_diagonal_element(w);
                pull.to[k] += (places[v] - all[v] + pose.places[k]) * w;
            }
            pull
        })
    }

    /// Rounds at scale r after landmarks alone.
    pub(super) fn lead(
        &self,
        pose: &mut Pose,
        held: &[FramedLandmark],
        scale: (f64, usize),
        stop: Stop<'_>,
    ) -> Option<()> {
        self.rounds(pose, scale, stop, |pose| {
            let mut pull = self.no_pull();
            self.hold(pose, &pose.deformed(self.rest, self.nodes), held, &mut pull);
            pull
        })
    }

    /// Landmarks pull at the nodes that their corners belong to; `all` is where the vertices are.
    fn hold(&self, pose: &Pose, all: &[Vec3], held: &[FramedLandmark], pull: &mut Pull) {
        for landmark in held {
            let missing = landmark.to - landmark.at(all);
            for (v, weight) in landmark.corners {
                let (k, w) = (self.nodes.owner[v as usize] as usize, HELD * weight);
                pull.stiff[k] += Matrix3::from_diagonal_element(w);
                pull.to[k] += (missing + pose.places[k]) * w;
            }
        }
    }

    fn no_pull(&self) -> Pull {
        let m = self.nodes.vertices.len();
        Pull { stiff: vec![Matrix3::zeros(); m], to: vec![Vec3::zeros(); m] }
    }

    fn rounds(
        &self,
        pose: &mut Pose,
        (r, rounds): (f64, usize),
        stop: Stop<'_>,
        mut pull: impl FnMut(&Pose) -> Pull,
    ) -> Option<()> {
        let bend = r.powi(4);
        let stiffness = Stiffness { bend, couple: bend / (COUPLING * r).powi(2), keep: bend };
        let mut factor = None;
        for _ in 0..rounds {
            if stop() {
                return None;
            }
            let pull = pull(pose);
            let factor = match &mut factor {
                Some(factor) => factor,
                empty => empty.insert(self.factor(stiffness, &pull)?),
            };
            let moved = self.solve(pose, stiffness, &pull, factor)?;
            if moved < STILL * r {
                break;
            }
        }
        Some(())
    }

    /// Partners both ways, gathered at the nodes. A vertex pulls at the node that it belongs to, from where it stands.
    fn pull(&self, pose: &Pose, view: ScaleView<'_>, partners: &mut Partners) -> Pull {
        let all = pose.deformed(self.rest, self.nodes);
        let (all_normals, _) = vertex_normals(&all, &self.rest.triangles);
        let of = |values: &[Vec3]| self.data.vertices.iter().map(|v| values[*v as usize]).collect::<Vec<_>>();
        let (points, normals) = (of(&all), of(&all_normals));
        let owner: Vec<usize> = self.data.vertices.iter().map(|v| self.nodes.owner[*v as usize] as usize).collect();
        let mut pull = self.no_pull();
        self.hold(pose, &all, view.held, &mut pull);
        let last = &partners.back;
        let (met, back) = side_by_side(
            || onto(view.seen, &points, &normals, SIGMA_MIN, &mut partners.onto),
            || self.met_by_samples(view, (&points, &normals), last.clone()),
        );
        for i in 0..points.len() {
            let (n, w) = (met.normals[i], met.weights[i] * self.data.areas[i]);
            let d = (n * n.transpose() + Matrix3::from_diagonal_element(TANGENTIAL)) * w;
            pull.stiff[owner[i]] += d;
            pull.to[owner[i]] += d * (met.targets[i] - points[i] + pose.places[owner[i]]);
        }
        self.pull_back(pose, (view, &back), (&points, &normals), met.sigma, &owner, &mut pull);
        partners.back = back.met;
        pull
    }

    /// Finds the vertices that the input's samples meet; `last`: the partners of the last round.
    fn met_by_samples(
        &self,
        view: ScaleView<'_>,
        (points, normals): (&[Vec3], &[Vec3]),
        mut last: Vec<u32>,
    ) -> BackwardMatches {
        let tree = KdTree::new(points.iter().zip(normals).map(|(x, n)| sixfold(x, n)));
        let rim: Vec<bool> = self.data.vertices.iter().map(|v| self.rest.rim[*v as usize]).collect();
        back(view.sent, &tree, normals, &rim, &mut last)
    }

    fn pull_back(
        &self,
        pose: &Pose,
        (view, met): (ScaleView<'_>, &BackwardMatches),
        (points, normals): (&[Vec3], &[Vec3]),
        sigma: f64,
        owner: &[usize],
        pull: &mut Pull,
    ) {
        for k in 0..met.met.len() {
            let (v, y, n) = (met.met[k] as usize, view.sent.points[k], view.sent.normals[k]);
            let way = y - points[v];
            if met.weights[k] <= 0.0 || way.norm() >= 3.0 * sigma + REACH {
                continue;
            }
            // The vertex stands for the plane around it: only what is missing along its normal counts.
            let missing = normals[v] * normals[v].dot(&way);
            let w = met.weights[k] * (-(way.dot(&n) / sigma).powi(2)).exp() * view.share;
            let d = n * n.transpose() * w;
            pull.stiff[owner[v]] += d;
            pull.to[owner[v]] += d * (missing + pose.places[owner[v]]);
        }
    }

    /// The matrix that the three coordinates share, with tr/3 of what pulls.
    fn factor(&self, k: Stiffness, pull: &Pull) -> Option<Factored> {
        let m = self.nodes.vertices.len();
        let mut diagonal = vec![0.0; 4 * m];
        let mut entries = Vec::with_capacity(28 * self.ways.len());
        for i in 0..m {
            diagonal[4 * i] += pull.stiff[i].trace() / 3.0 + FLOATING * self.nodes.areas[i];
            (1..4).for_each(|p| diagonal[4 * i + p] += k.keep * self.nodes.areas[i]);
        }
        for ((i, j, w), way) in self.nodes.edges.iter().zip(&self.ways) {
            let half = way * 0.5;
            // The residual's derivatives by (x, L) of both ends.
            let ends = [[-1.0, -half.x, -half.y, -half.z], [1.0, -half.x, -half.y, -half.z]];
            for (node, b) in [i, j].into_iter().zip(&ends) {
                for p in 0..4 {
                    let own = if p > 0 { k.bend * w } else { 0.0 };
                    diagonal[4 * *node as usize + p] += k.couple * w * b[p] * b[p] + own;
                    for q in 0..p {
                        entries.push((4 * node + p as u32, 4 * node + q as u32, k.couple * w * b[p] * b[q]));
                    }
                }
            }
            for p in 0..4 {
                for q in 0..4 {
                    let own = if p == q && p > 0 { k.bend * w } else { 0.0 };
                    let entry = k.couple * w * ends[0][p] * ends[1][q] - own;
                    entries.push((4 * i + p as u32, 4 * j + q as u32, entry));
                }
            }
        }
        self.pattern.factor(&diagonal, entries.into_iter(), &vec![false; 4 * m]).ok()
    }

    /// H z: columns are coordinates, four entries (x, L's row) each node.
    fn apply(&self, k: Stiffness, pull: &Pull, z: &[f64]) -> Vec<f64> {
        let m = self.nodes.vertices.len();
        let mut y = vec![0.0; 12 * m];
        for (z, y) in z.chunks_exact(4 * m).zip(y.chunks_exact_mut(4 * m)) {
            for i in 0..m {
                let a = self.nodes.areas[i];
                y[4 * i] = FLOATING * a * z[4 * i];
                (1..4).for_each(|p| y[4 * i + p] = k.keep * a * z[4 * i + p]);
            }
            for ((i, j, w), way) in self.nodes.edges.iter().zip(&self.ways) {
                let (i, j) = (4 * *i as usize, 4 * *j as usize);
                let mut residual = z[j] - z[i];
                (0..3).for_each(|p| residual -= 0.5 * way[p] * (z[i + 1 + p] + z[j + 1 + p]));
                let s = k.couple * w * residual;
                y[i] -= s;
                y[j] += s;
                for p in 0..3 {
                    let t = k.bend * w * (z[i + 1 + p] - z[j + 1 + p]);
                    y[i + 1 + p] += t - 0.5 * way[p] * s;
                    y[j + 1 + p] += -t - 0.5 * way[p] * s;
                }
            }
        }
        for i in 0..m {
            let x = Vec3::new(z[4 * i], z[4 * (m + i)], z[4 * (2 * m + i)]);
            let d = pull.stiff[i] * x;
            (0..3).for_each(|c| y[4 * (c * m + i)] += d[c]);
        }
        y
    }

    /// Solves for the next pose; returns how far a node moved, `None` where that is not finite.
    fn solve(&self, pose: &mut Pose, k: Stiffness, pull: &Pull, factor: &Factored) -> Option<f64> {
        let m = self.nodes.vertices.len();
        let (mut z, mut right) = (vec![0.0; 12 * m], vec![0.0; 12 * m]);
        for i in 0..m {
            let similar = nearest_scaled_rotation(&pose.maps[i]);
            for c in 0..3 {
                let at = 4 * (c * m + i);
                z[at] = pose.places[i][c];
                right[at] = pull.to[i][c] + FLOATING * self.nodes.areas[i] * pose.places[i][c];
                for p in 0..3 {
                    z[at + 1 + p] = pose.maps[i][(c, p)];
                    right[at + 1 + p] = k.keep * self.nodes.areas[i] * similar[(c, p)];
                }
            }
        }
        let applied = self.apply(k, pull, &z);
        let residual = right.iter().zip(&applied).map(|(b, a)| b - a).collect();
        descend(&mut z, residual, |p| self.apply(k, pull, p), |r| factor.solve_columns(r, 3));
        let mut moved = 0.0f64;
        for i in 0..m {
            let x = Vec3::new(z[4 * i], z[4 * (m + i)], z[4 * (2 * m + i)]);
            let step = (x - pose.places[i]).amax();
            if !step.is_finite() {
                return None;
            }
            moved = moved.max(step);
            pose.places[i] = x;
            pose.maps[i] = Matrix3::from_fn(|c, p| z[4 * (c * m + i) + 1 + p]);
        }
        Some(moved)
    }
}

/// Preconditioned conjugate gradients on z, from its residual. *Source:* Hestenes and Stiefel 1952.
fn descend(
    z: &mut [f64],
    mut residual: Vec<f64>,
    apply: impl Fn(&[f64]) -> Vec<f64>,
    precondition: impl Fn(&mut [f64]),
) {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut step = residual.clone();
    precondition(&mut step);
    let mut error = dot(&residual, &step);
    let enough = ERROR * error;
    for k in 0..STEPS_MAX {
        let applied = apply(&step);
        let length = error / dot(&step, &applied).max(f64::MIN_POSITIVE);
        z.iter_mut().zip(&step).for_each(|(z, p)| *z += length * p);
        if k + 1 == STEPS_MAX {
            break;
        }
        residual.iter_mut().zip(&applied).for_each(|(r, a)| *r -= length * a);
        let mut next = residual.clone();
        precondition(&mut next);
        let after = dot(&residual, &next);
        // A comparison that also ends for what is not finite.
        if !(after >= enough && error > 0.0) {
            break;
        }
        let keep = after / error;
        step.iter_mut().zip(&next).for_each(|(p, n)| *p = n + keep * *p);
        error = after;
    }
}
