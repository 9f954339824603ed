//! Rough poses of one surface on another of which it shows a part: a mask on a head, a head on a mask.
//!
//! The smaller surface is laid with its middle and mean normal on points spread over the larger, turned about the normal in
//! equal steps, at some sizes; the likelier poses come to rest by iterated closest points, of one size, from the smaller
//! onto the larger. A pose is scored by how near the smaller lies, times how well its relief ([`super::Evidence`]) agrees
//! with what it lies on: nearness alone lays a face on the back of a head. *Ours, not a paper's.*

use super::evidence::{correlation, height};
use super::ground::{Ground, Samples, Seen, sixfold};
use super::matches::sigma;
use super::similarity::Similarity;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// How thoroughly poses are sought.
#[derive(Clone, Copy, Debug)]
struct Effort {
    /// Points of the larger surface that are tried, and turns about the normal at each.
    places: usize,
    turns: usize,
    /// Areas of the smaller surface, laid, as shares of the larger's.
    shares: &'static [f64],
    /// Samples of the larger surface.
    large: usize,
    /// Samples of the smaller one by which a pose is sifted.
    sifted_by: usize,
    /// Poses of one size that are brought to rest, by how many samples of the smaller surface, in how many rounds.
    rests: &'static [(usize, usize, usize)],
}

/// To lay an example.
const FULL: Effort = Effort {
    places: 100,
    turns: 12,
    shares: &[0.14, 0.2, 0.28, 0.4, 0.56, 0.78, 1.1],
    large: 3000,
    sifted_by: 32,
    rests: &[(240, 64, 4), (24, 256, 12)],
};
/// To tell which of many examples are worth it.
const QUICK: Effort = Effort {
    places: 60,
    turns: 12,
    shares: &[0.2, 0.4, 0.8],
    large: 1500,
    sifted_by: 24,
    rests: &[(48, 64, 4), (6, 128, 6)],
};
/// How many poses are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sought {
    /// As for a scan.
    Thoroughly,
    /// A twelfth of the work: for inputs of few faces.
    Quickly,
}

/// An input of fewer triangles is flat nearly everywhere, and seen as well by few samples.
const FULL_FROM_TRIANGLES: usize = 256;
/// Samples of the smaller surface.
const SMALL: usize = 256;
/// Distance at which a sample counts 1/e, in √area of the smaller.
const NEAR: f64 = 0.06;
/// A mean normal is that of what lies so near about a point, in √area of the smaller.
const ABOUT: f64 = 0.4;
/// σ of the relief, in √area of the smaller.
const RELIEF_SCALES: [f64; 3] = [0.04, 0.1, 0.2];
/// Share of the way along the surface that a target keeps.
const TANGENTIAL: f64 = 0.3;
/// Poses that are told; those turned and moved by less against a better one are left out.
const TOLD: usize = 12;
const TURNED: f64 = TAU / 18.0;
const MOVED: f64 = 0.1;

/// Poses of `example` on `input`, best first, of which either is a part of the other; never mirrored. With each its score,
/// at most 1. `may_be_small`: whether the example, and whether the input, may be the part: what is closed is not. Empty when
/// stopped.
pub fn poses(
    example: &TriMesh,
    input: &TriMesh,
    may_be_small: [bool; 2],
    sought: Sought,
    stop: &dyn Fn() -> bool,
) -> Vec<(f64, Similarity)> {
    let is_quick = sought == Sought::Quickly || input.triangles.len() < FULL_FROM_TRIANGLES;
    let effort = if is_quick { &QUICK } else { &FULL };
    let [one, two] = [(example, may_be_small[0]), (input, may_be_small[1])].map(|s| Posed::new(s.0, s.1, effort));
    let mut kept: Vec<(f64, Similarity)> = Vec::new();
    let unit = (middle(example), example.total_area().sqrt());
    for (score, pose) in found(&one, &two, stop) {
        if kept.len() < TOLD && !stop() && kept.iter().all(|(_, k)| is_other(k, &pose, &unit)) {
            kept.push((score, pose));
        }
    }
    kept
}

/// A surface, made ready to be compared with many others by how well one lies on the other.
#[derive(Debug)]
pub struct Posed {
    small: Option<Small>,
    large: Vec<Large>,
    effort: &'static Effort,
}

impl Posed {
    /// Of a surface that may be a part of another, or, being closed, may not.
    pub fn quick(mesh: &TriMesh, may_be_small: bool) -> Self {
        Self::new(mesh, may_be_small, &QUICK)
    }

    fn new(mesh: &TriMesh, may_be_small: bool, effort: &'static Effort) -> Self {
        let ground = Ground::new(mesh);
        let large = effort.shares.iter().map(|share| Large::new(&ground, *share, effort.large)).collect();
        Self { small: may_be_small.then(|| Small::new(&ground, effort.large)), large, effort }
    }

    /// The score of the best pose on another, or of the other on it, at most 1; 0 where there is none, or when stopped.
    pub fn likeness(&self, other: &Self, stop: &dyn Fn() -> bool) -> f64 {
        found(self, other, stop).first().map_or(0.0, |best| best.0)
    }
}

/// All poses of `one` on `two`, best first.
fn found(one: &Posed, two: &Posed, stop: &dyn Fn() -> bool) -> Vec<(f64, Similarity)> {
    let tried = |of: &Posed, on: &Posed| of.small.as_ref().map_or(Vec::new(), |small| small.tried(on, stop));
    let mut found = tried(one, two);
    found.extend(tried(two, one).into_iter().map(|(score, onto)| (score, inverse(&onto))));
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found
}

fn inverse(of: &Similarity) -> Similarity {
    let rotation = of.rotation.transpose();
    Similarity { scale: 1.0 / of.scale, rotation, shift: -(rotation * of.shift) / of.scale }
}

fn middle(mesh: &TriMesh) -> Vec3 {
    let count = mesh.positions.len().max(1) as f64;
    mesh.positions.iter().sum::<Vec3>() / count
}

/// Whether two poses of a surface with that middle and √area differ.
fn is_other(a: &Similarity, b: &Similarity, (middle, size): &(Vec3, f64)) -> bool {
    let turned = (0.5 * ((a.rotation.transpose() * b.rotation).trace() - 1.0)).clamp(-1.0, 1.0).acos();
    let moved = (a.apply(middle) - b.apply(middle)).norm() / (a.scale * size).max(f64::MIN_POSITIVE);
    turned > TURNED || moved > MOVED || (a.scale / b.scale).ln().abs() > MOVED
}

/// The smaller surface: samples with their relief, centred, of unit area.
#[derive(Debug)]
struct Small {
    points: Vec<Vec3>,
    normals: Vec<Vec3>,
    relief: Vec<[f64; 3]>,
    /// From its own coordinates to these.
    frame: Similarity,
}

/// The larger surface as seen from the smaller, laid at one size.
#[derive(Debug)]
struct Large {
    seen: Seen,
    relief: Vec<[f64; 3]>,
    frame: Similarity,
}

fn frame_of(samples: &Samples, size: f64) -> Similarity {
    let count = samples.points.len().max(1) as f64;
    let middle = samples.points.iter().sum::<Vec3>() / count;
    Similarity { scale: size, rotation: Matrix3::identity(), shift: middle }
}

fn relief(samples: &Samples) -> Vec<[f64; 3]> {
    let of = |k: usize| RELIEF_SCALES.map(|s| height(samples, &samples.points[k], &samples.normals[k], s));
    (0..samples.points.len()).map(of).collect()
}

impl Small {
    fn new(ground: &Ground<'_>, count: usize) -> Self {
        let all = ground.spread(count);
        let frame = frame_of(&all, ground.area.sqrt());
        let all = all.seen_from(&frame);
        let of = relief(&all);
        let few = spread(&all.points, SMALL);
        Self {
            points: few.iter().map(|k| all.points[*k]).collect(),
            normals: few.iter().map(|k| all.normals[*k]).collect(),
            relief: few.iter().map(|k| of[*k]).collect(),
            frame,
        }
    }
}

impl Large {
    fn new(ground: &Ground<'_>, share: f64, count: usize) -> Self {
        let all = ground.spread(count);
        let frame = frame_of(&all, (share * ground.area).sqrt());
        let all = all.seen_from(&frame);
        let relief = relief(&all);
        Self { seen: Seen::new(all), relief, frame }
    }

    /// The mean of places and of normals within [`ABOUT`] of a point.
    fn about(&self, at: Vec3) -> (Vec3, Vec3) {
        let samples = &self.seen.samples;
        let (mut sum, mut place, mut normal) = (0.0, Vec3::zeros(), Vec3::zeros());
        for k in (0..samples.points.len()).filter(|k| (samples.points[*k] - at).norm_squared() < ABOUT * ABOUT) {
            sum += 1.0;
            place += samples.points[k];
            normal += samples.normals[k];
        }
        (place / f64::max(sum, 1.0), normal.try_normalize(0.0).unwrap_or_else(Vec3::z))
    }
}

/// Numbers of points spread evenly, each prefix too.
fn spread(points: &[Vec3], count: usize) -> Vec<usize> {
    let mut away = vec![f64::INFINITY; points.len()];
    let (mut chosen, mut next) = (Vec::new(), 0);
    for _ in 0..count.min(points.len()) {
        chosen.push(next);
        let at = points[next];
        away.iter_mut().zip(points).for_each(|(d, x)| *d = d.min((x - at).norm_squared()));
        let farthest = (0..away.len()).max_by(|&a, &b| away[a].total_cmp(&away[b]).then(b.cmp(&a)));
        next = farthest.unwrap_or(0);
    }
    chosen
}

/// A rigid motion.
#[derive(Clone, Copy)]
struct Motion {
    rotation: Matrix3<f64>,
    shift: Vec3,
}

/// Two unit vectors that make a right-handed frame with `z`.
fn axes(z: Vec3) -> Matrix3<f64> {
    let other = if z.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let x = other.cross(&z).try_normalize(0.0).unwrap_or_else(Vec3::x);
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

impl Small {
    /// The best poses on a larger surface, with their scores. Empty when stopped.
    fn tried(&self, whole: &Posed, stop: &dyn Fn() -> bool) -> Vec<(f64, Similarity)> {
        let effort = whole.effort;
        let normal = self.normals.iter().sum::<Vec3>().try_normalize(0.0).unwrap_or_else(Vec3::z);
        let own = axes(normal).transpose();
        let mut found = Vec::new();
        for large in &whole.large {
            let mut rough = Vec::new();
            for k in spread(&large.seen.samples.points, effort.places) {
                if stop() {
                    return Vec::new();
                }
                let (to, along) = large.about(large.seen.samples.points[k]);
                let there = axes(along);
                for turn in 0..effort.turns {
                    let (sin, cos) = (TAU * turn as f64 / effort.turns as f64).sin_cos();
                    let rotation = there * Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0) * own;
                    let motion = Motion { rotation, shift: to };
                    rough.push((self.nearness(large, effort.sifted_by, &motion), motion));
                }
            }
            for (kept, samples, rounds) in effort.rests {
                rough.sort_by(|a, b| b.0.total_cmp(&a.0));
                rough.truncate(*kept);
                for (score, motion) in &mut rough {
                    if stop() {
                        return Vec::new();
                    }
                    *motion = self.rest(large, *samples, *motion, *rounds);
                    *score = self.score(large, *samples, motion);
                }
            }
            let pose = |m: &Motion| Similarity { scale: 1.0, rotation: m.rotation, shift: m.shift };
            let undo = inverse(&self.frame);
            found.extend(rough.iter().map(|(score, m)| (*score, large.frame.after(&pose(m)).after(&undo))));
        }
        found
    }

    /// What sample `k` meets: its place and normal, the number of the partner, and how it counts.
    fn meets(&self, large: &Large, k: usize, motion: &Motion) -> (Vec3, Vec3, usize, f64) {
        let (x, n) = (motion.rotation * self.points[k] + motion.shift, motion.rotation * self.normals[k]);
        let met = large.seen.tree.nearest(&sixfold(&x, &n)).map_or(0, |f| f.0 as usize);
        let facing = n.dot(&large.seen.samples.normals[met]).max(0.0);
        (x, n, met, facing)
    }

    fn nearness(&self, large: &Large, samples: usize, motion: &Motion) -> f64 {
        let of = |k: usize| {
            let (x, _, met, facing) = self.meets(large, k, motion);
            facing * near(&x, &large.seen.samples.points[met])
        };
        let count = samples.min(self.points.len());
        (0..count).map(of).sum::<f64>() / count.max(1) as f64
    }

    fn score(&self, large: &Large, samples: usize, motion: &Motion) -> f64 {
        let count = samples.min(self.points.len());
        let mut values = RELIEF_SCALES.map(|_| Vec::with_capacity(count));
        let mut nearness = 0.0;
        for k in 0..count {
            let (x, _, met, facing) = self.meets(large, k, motion);
            let weight = facing * near(&x, &large.seen.samples.points[met]);
            nearness += weight / count as f64;
            for (s, values) in values.iter_mut().enumerate() {
                values.push((self.relief[k][s], large.relief[met][s], facing));
            }
        }
        let agreement = values.iter().map(|v| correlation(v)).sum::<f64>() / values.len() as f64;
        nearness * agreement.max(0.0)
    }

    /// Iterated closest points.
    fn rest(&self, large: &Large, samples: usize, mut motion: Motion, rounds: usize) -> Motion {
        let count = samples.min(self.points.len());
        for _ in 0..rounds {
            let met: Vec<_> = (0..count).map(|k| self.meets(large, k, &motion)).collect();
            let distances: Vec<f64> = met.iter().map(|m| (m.0 - large.seen.samples.points[m.2]).norm()).collect();
            let facing: Vec<f64> = met.iter().map(|m| m.3).collect();
            let sigma = sigma(&distances, &facing, NEAR);
            let pair = |k: usize| {
                let (x, _, j, facing) = met[k];
                let (c, n) = (large.seen.samples.points[j], large.seen.samples.normals[j]);
                let way = c - x;
                let target = x + n * n.dot(&way) * (1.0 - TANGENTIAL) + way * TANGENTIAL;
                (self.points[k], target, facing * facing * (-(distances[k] / sigma).powi(2)).exp())
            };
            let pairs: Vec<_> = (0..count).map(pair).collect();
            let Some(fit) = Similarity::fit(pairs.iter().copied()) else { break };
            let weight = pairs.iter().map(|p| p.2).sum::<f64>();
            let middle = pairs.iter().map(|p| p.0 * p.2).sum::<Vec3>() / weight;
            // The fit keeps the middle where it is at any size.
            motion = Motion { rotation: fit.rotation, shift: fit.shift + fit.rotation * middle * (fit.scale - 1.0) };
        }
        motion
    }
}

fn near(a: &Vec3, b: &Vec3) -> f64 {
    (-(a - b).norm_squared() / (NEAR * NEAR)).exp()
}
