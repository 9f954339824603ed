//! Rough poses of one surface on another of which it shows a part: a mask on a head, a head on a mask; and of closed surfaces
//! on each other.
//!
//! The smaller surface is laid with its middle and mean normal on points spread over the larger, turned about the
//! normal in equal steps, at some sizes. The mean normal of what is bulky (a head with its neck) says little, and its
//! middle lies deep inside: if that leads to no sure pose, what is about each of some of its points is laid so, too.
//! Poses are sifted by a grid ([`Nearness`]); the likelier are refined by iterated closest points, of one size, from
//! the smaller onto the larger. Of two closed surfaces neither is a part of the other: they are laid middle on middle,
//! of one area, in rotations spread evenly. A pose is scored by how near the smaller lies, times how well its relief
//! ([`super::Evidence`]) agrees with what it lies on: nearness alone lays a face on the back of a head. Samples that
//! lie off the larger say nothing of relief: an example has no crown. *Ours, not a paper's.*

mod likeness;

pub use likeness::Likeness;

use super::effort::{Effort, FULL, MIDDLE, ON_A_PART, QUICK, Thoroughness};
use super::evidence::{ReliefSampler, correlation};
use super::input_surface::{FramedSamples, InputSurface, Samples, sixfold};
use super::matches::sigma;
use super::nearness::Nearness;
use super::similarity::Similarity;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::numerics::in_halves;
use crate::numerics::stage::Stage;
use crate::numerics::stop::Stop;
use nalgebra::Matrix3;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// An input of fewer triangles is flat nearly everywhere, and seen as well by few samples.
const FULL_FROM_TRIANGLES: usize = 256;
/// Samples of the smaller surface.
const SMALL: usize = 256;
/// Distance at which a sample counts 1/e, in √area of the smaller.
const NEAR: f64 = 0.06;
/// A mean normal is that of what lies so near about a point, in √area of the smaller.
const ABOUT: f64 = 0.4;
/// A surface whose normals have a shorter mean is bulky: two heads with necks have .06 and .21. *Untuned.*
const BULKY: f64 = 0.5;
/// A pose that scores so much is found by the middle alone, and no anchors are tried. *Untuned:* of heads on statues right poses have
/// .3 to .6, and wrong ones up to .35.
const SURE: f64 = 0.45;
/// So many times as many poses of what is bulky are refined: more are tried, and sifting tells them by nearness alone.
const BULKY_REFINED: usize = 3;
/// σ of the relief, in √area of the smaller.
const RELIEF_SCALES: [f64; 3] = [0.04, 0.1, 0.2];
/// Share of the way along the surface that a target keeps.
const TANGENTIAL: f64 = 0.3;
/// Partners may be so much farther than the nearest.
const SLACK: f64 = 0.2;
/// Poses that are returned, at most; those turned and moved by less against a better one are left out.
const POSES_MAX: usize = 12;
const TURNED: f64 = TAU / 18.0;
const MOVED: f64 = 0.1;

/// Poses of `example` on `input`, best first, of which either is a part of the other; never mirrored. With each its score,
/// at most 1. `may_be_small`: whether the example, and whether the input, may be the part: what is closed is not, and where
/// neither may be, one is laid on the other as a whole. Empty when stopped.
pub fn poses(
    example: &TriMesh,
    input: &TriMesh,
    may_be_small: [bool; 2],
    sought: Thoroughness,
    stop: Stop<'_>,
) -> Vec<(f64, Similarity)> {
    poses_on(example, may_be_small[0], &PosedSurface::sought(input, may_be_small[1], sought), stop)
}

/// The same on an input that is ready.
pub fn poses_on(example: &TriMesh, may_be_small: bool, input: &PosedSurface, stop: Stop<'_>) -> Vec<(f64, Similarity)> {
    let ground = InputSurface::new(example);
    let found = match input.whole.as_ref().filter(|_| !may_be_small) {
        Some(whole) => as_wholes(&ClosedSurface::new(&ground, input.effort), whole, input.effort, stop),
        None => {
            // Nothing is laid on it where the input is no part.
            let shares = if input.small.is_some() { input.effort.shares } else { &[] };
            found(&PosedSurface::new(&ground, may_be_small, (input.effort, shares)), input, stop)
        }
    };
    let mut kept: Vec<(f64, Similarity)> = Vec::new();
    let unit = (middle(example), example.total_area().sqrt());
    for (score, pose) in found {
        if kept.len() < POSES_MAX && !stop() && kept.iter().all(|(_, k)| is_other(k, &pose, &unit)) {
            kept.push((score, pose));
        }
    }
    kept
}

/// A surface, made ready to be compared with many others by how well one lies on the other.
#[derive(Debug)]
pub struct PosedSurface {
    small: Option<Small>,
    large: Vec<Large>,
    /// Of a closed surface: as it is laid on others as a whole, and others on it.
    whole: Option<ClosedSurface>,
    area: f64,
    effort: &'static Effort,
}

impl PosedSurface {
    /// Of a surface that may be a part of another, or, being closed, may not.
    pub fn quick(mesh: &TriMesh, may_be_small: bool) -> Self {
        Self::of(mesh, may_be_small, &QUICK)
    }

    /// An input that others are laid on, and, where it `may_be_small`, that is laid on them.
    pub fn sought(input: &TriMesh, may_be_small: bool, sought: Thoroughness) -> Self {
        let effort = match sought {
            _ if input.triangles.len() < FULL_FROM_TRIANGLES => &QUICK,
            Thoroughness::Quickly => &QUICK,
            Thoroughness::Roughly => &MIDDLE,
            Thoroughness::Thoroughly => &FULL,
            Thoroughness::ByMiddle => &ON_A_PART,
        };
        Self::of(input, may_be_small, effort)
    }

    fn of(mesh: &TriMesh, may_be_small: bool, effort: &'static Effort) -> Self {
        let ground = InputSurface::new(mesh);
        let whole = (!may_be_small).then(|| ClosedSurface::new(&ground, effort));
        Self { whole, ..Self::new(&ground, may_be_small, (effort, effort.shares)) }
    }

    /// `shares`: those of the effort at which others are laid on it.
    fn new(ground: &InputSurface<'_>, may_be_small: bool, (effort, shares): (&'static Effort, &[f64])) -> Self {
        let samples = if shares.is_empty() { Samples::default() } else { ground.spread(effort.large) };
        let large = shares.iter().map(|share| Large::of(&samples, ground.area, *share)).collect();
        let small = may_be_small.then(|| Small::new(ground, effort));
        Self { small, large, whole: None, area: ground.area, effort }
    }

    /// Tells whether it is closed, so that others are laid on it as wholes.
    pub fn is_whole(&self) -> bool {
        self.whole.is_some()
    }
}

/// All poses of `one` on `two`, best first.
fn found(one: &PosedSurface, two: &PosedSurface, stop: Stop<'_>) -> Vec<(f64, Similarity)> {
    let tried =
        |of: &PosedSurface, on: &PosedSurface| of.small.as_ref().map_or(Vec::new(), |small| small.laid(on, stop));
    let mut found = tried(one, two);
    found.extend(tried(two, one).into_iter().map(|(score, onto)| (score, inverse(&onto))));
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found
}

/// All poses of a closed surface on another, best first.
fn as_wholes(one: &ClosedSurface, two: &ClosedSurface, effort: &Effort, stop: Stop<'_>) -> Vec<(f64, Similarity)> {
    let mut found = one.small.tried_whole(&two.large, effort, stop);
    let onto = two.small.tried_whole(&one.large, effort, stop);
    found.extend(onto.into_iter().map(|(score, onto)| (score, inverse(&onto))));
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
    /// Its middle comes first; what is bulky has some of its points, too.
    anchors: Vec<Anchor>,
    /// From its own coordinates to these.
    frame: Similarity,
    is_flat: bool,
}

/// A closed surface, as it is laid on others as a whole, and others on it.
#[derive(Debug)]
struct ClosedSurface {
    small: Small,
    large: Large,
}

impl ClosedSurface {
    fn new(ground: &InputSurface<'_>, effort: &Effort) -> Self {
        Self { small: Small::new(ground, effort), large: Large::new(ground, 1.0, effort.large) }
    }
}

/// A piece of the smaller surface is laid on places of the larger, and carries the rest with it.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    /// Its middle.
    middle: Vec3,
    /// Turns its mean normal onto z.
    upright: Matrix3<f64>,
}

/// The larger surface as seen from the smaller, laid at one size.
#[derive(Debug)]
struct Large {
    nearness: Nearness,
    seen: FramedSamples,
    around: ReliefSampler,
    /// The heights of each sample, made when it is first met: most never are.
    relief: Vec<OnceLock<[f64; 3]>>,
    /// ∫ height² over all of it, made when it is first asked for.
    relief_sums: OnceLock<[f64; 3]>,
    /// Area, where the smaller's is 1.
    area: f64,
    frame: Similarity,
    is_flat: bool,
}

fn frame_of(samples: &Samples, size: f64) -> Similarity {
    let count = samples.points.len().max(1) as f64;
    let middle = samples.points.iter().sum::<Vec3>() / count;
    Similarity { scale: size, rotation: Matrix3::identity(), shift: middle }
}

/// The heights of a sample among all of them.
fn relief(around: &ReliefSampler, samples: &Samples, k: usize) -> [f64; 3] {
    around.heights(&samples.points[k], &samples.normals[k], RELIEF_SCALES)
}

impl Small {
    fn new(ground: &InputSurface<'_>, effort: &Effort) -> Self {
        let all = ground.spread(effort.large);
        let frame = frame_of(&all, ground.area.sqrt());
        let all = all.seen_from(&frame);
        let (few, around) = (spread(&all.points, SMALL), ReliefSampler::new(&all));
        let points: Vec<Vec3> = few.iter().map(|k| all.points[*k]).collect();
        let normals: Vec<Vec3> = few.iter().map(|k| all.normals[*k]).collect();
        let relief = few.iter().map(|k| relief(&around, &all, *k)).collect();
        let (more, is_flat) = (if Stage::Anchors.is_on() { effort.anchors } else { 0 }, all.is_flat());
        Self { is_flat, anchors: anchors(&points, &normals, more), points, normals, relief, frame }
    }
}

/// Returns the middle of samples that are spread evenly, and, if they are bulky, what lies about the first `more` of them.
fn anchors(points: &[Vec3], normals: &[Vec3], more: usize) -> Vec<Anchor> {
    let upright = |normal: Vec3| axes(normal.try_normalize(0.0).unwrap_or_else(Vec3::z)).transpose();
    let all = normals.iter().sum::<Vec3>();
    let mut found = vec![Anchor { middle: Vec3::zeros(), upright: upright(all) }];
    if all.norm() < BULKY * normals.len() as f64 {
        found.extend(points.iter().take(more).map(|at| {
            let (middle, normal) = mean_about(points, normals, *at);
            Anchor { middle, upright: upright(normal) }
        }));
    }
    found
}

/// Returns the mean of the points, and the sum of the normals, within [`ABOUT`] of a point.
fn mean_about(points: &[Vec3], normals: &[Vec3], at: Vec3) -> (Vec3, Vec3) {
    let (mut sum, mut place, mut normal) = (0.0, Vec3::zeros(), Vec3::zeros());
    for k in (0..points.len()).filter(|k| (points[*k] - at).norm_squared() < ABOUT * ABOUT) {
        sum += 1.0;
        place += points[k];
        normal += normals[k];
    }
    (place / f64::max(sum, 1.0), normal)
}

impl Large {
    fn new(ground: &InputSurface<'_>, share: f64, count: usize) -> Self {
        Self::of(&ground.spread(count), ground.area, share)
    }

    /// Of samples of a surface of some area.
    fn of(samples: &Samples, area: f64, share: f64) -> Self {
        let frame = frame_of(samples, (share * area).sqrt());
        let all = samples.seen_from(&frame);
        let (around, relief) = (ReliefSampler::new(&all), vec![OnceLock::new(); all.points.len()]);
        let is_flat = all.is_flat();
        let (nearness, seen, area) = (Nearness::new(&all), FramedSamples::new(all), 1.0 / share);
        Self { nearness, seen, around, relief, relief_sums: OnceLock::new(), area, frame, is_flat }
    }

    /// ∫ height² over all of it.
    fn relief_sums(&self) -> &[f64; 3] {
        self.relief_sums.get_or_init(|| {
            let count = self.relief.len();
            let mut sums = [0.0; 3];
            for k in 0..count {
                let heights = self.heights(k);
                (0..3).for_each(|s| sums[s] += heights[s] * heights[s]);
            }
            sums.map(|sum| sum * self.area / count.max(1) as f64)
        })
    }

    /// The heights of a sample.
    fn heights(&self, k: usize) -> [f64; 3] {
        *self.relief[k].get_or_init(|| relief(&self.around, &self.seen.samples, k))
    }

    /// The mean of places and of normals within [`ABOUT`] of a point.
    fn about(&self, at: Vec3) -> (Vec3, Vec3) {
        let samples = &self.seen.samples;
        let (place, normal) = mean_about(&samples.points, &samples.normals, at);
        (place, normal.try_normalize(0.0).unwrap_or_else(Vec3::z))
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

/// A sample of the smaller surface that was laid on the larger, and its partner there.
#[derive(Clone, Copy)]
struct MetSample {
    /// Where the sample lies.
    at: Vec3,
    /// The number of the sample of the larger that is nearest.
    partner: usize,
    /// How it counts: the cosine between their normals, or 0.
    facing: f64,
}

/// A refined pose, its score, and what it was scored by.
struct Posing {
    score: f64,
    motion: Motion,
    met: Vec<MetSample>,
}

/// One of equal turns about z.
fn turned(turn: usize, of: usize) -> Matrix3<f64> {
    let (sin, cos) = (TAU * turn as f64 / of as f64).sin_cos();
    Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

/// One of directions that are spread evenly. *Source:* González 2010 (Fibonacci lattice).
fn direction(k: usize, of: usize) -> Vec3 {
    let z = 1.0 - (2 * k + 1) as f64 / of as f64;
    let (sin, cos) = (TAU * (k as f64 * (5f64.sqrt() - 1.0) / 2.0).fract()).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    Vec3::new(radius * cos, radius * sin, z)
}

impl Small {
    /// The best poses on a larger surface, with their scores. Empty when stopped.
    fn laid(&self, whole: &PosedSurface, stop: Stop<'_>) -> Vec<(f64, Similarity)> {
        let found = whole.large.iter().zip(self.tried(whole, stop));
        found.flat_map(|(large, of_size)| of_size.into_iter().map(|p| (p.score, self.onto(large, &p.motion)))).collect()
    }

    /// The same by the size at which it is laid. Empty when stopped.
    fn tried(&self, whole: &PosedSurface, stop: Stop<'_>) -> Vec<Vec<Posing>> {
        let effort = whole.effort;
        let on = |anchors: &[Anchor], times: usize, large: &Large| -> Option<Vec<Posing>> {
            if self.is_flat != large.is_flat {
                return Some(Vec::new());
            }
            let mut rough = Vec::new();
            for k in spread(&large.seen.samples.points, effort.places) {
                if stop() {
                    return None;
                }
                let (to, along) = large.about(large.seen.samples.points[k]);
                let there = axes(along);
                for turn in 0..effort.turns {
                    let there = there * turned(turn, effort.turns);
                    for anchor in anchors {
                        let rotation = there * anchor.upright;
                        let motion = Motion { rotation, shift: to - rotation * anchor.middle };
                        rough.push((self.nearness(large, &motion, effort.sifted_by), motion));
                    }
                }
            }
            self.refined(large, (rough, times), effort, stop)
        };
        let by = |anchors: &[Anchor], times: usize| {
            let found = in_halves(&whole.large, |large| on(anchors, times, large));
            found.into_iter().collect::<Option<Vec<_>>>().unwrap_or_default()
        };
        let (middle, others) = self.anchors.split_at(1);
        let mut found = by(middle, 1);
        if !others.is_empty() && found.iter().flatten().all(|p| p.score < SURE) {
            found.iter_mut().zip(by(others, BULKY_REFINED)).for_each(|(all, more)| all.extend(more));
        }
        found
    }

    /// Where sample `k` is, and its normal.
    fn moved(&self, k: usize, motion: &Motion) -> (Vec3, Vec3) {
        (motion.rotation * self.points[k] + motion.shift, motion.rotation * self.normals[k])
    }

    /// A motion onto a larger surface, between the coordinates that both came in.
    fn onto(&self, large: &Large, motion: &Motion) -> Similarity {
        let pose = Similarity { scale: 1.0, rotation: motion.rotation, shift: motion.shift };
        large.frame.after(&pose).after(&inverse(&self.frame))
    }

    /// The best poses on another closed surface, middle on middle, with their scores. Empty when stopped.
    fn tried_whole(&self, large: &Large, effort: &Effort, stop: Stop<'_>) -> Vec<(f64, Similarity)> {
        let mut rough = Vec::new();
        for k in 0..effort.places {
            if stop() {
                return Vec::new();
            }
            let there = axes(direction(k, effort.places));
            for turn in 0..effort.turns {
                let rotation = there * turned(turn, effort.turns);
                let motion = Motion { rotation, shift: Vec3::zeros() };
                rough.push((self.nearness(large, &motion, effort.sifted_by), motion));
            }
        }
        let refined = self.refined(large, (rough, 1), effort, stop).unwrap_or_default();
        refined.iter().map(|p| (p.score, self.onto(large, &p.motion))).collect()
    }

    /// The likelier poses, refined, `times` as many as usual, each with its score; `None` when stopped.
    fn refined(
        &self,
        large: &Large,
        (mut rough, times): (Vec<(f64, Motion)>, usize),
        effort: &Effort,
        stop: Stop<'_>,
    ) -> Option<Vec<Posing>> {
        let mut last = Vec::new();
        for (kept, samples, rounds) in effort.refinements {
            rough.sort_by(|a, b| b.0.total_cmp(&a.0));
            rough.truncate(times * kept);
            last.clear();
            for (score, motion) in &mut rough {
                if stop() {
                    return None;
                }
                // What only one of the two has may draw a pose off its place: then it stays.
                let first = self.met(large, *samples, motion, &[]);
                let before = self.score(large, &first);
                let (refined, met) = self.iterate_closest_points(large, *motion, first.clone(), *rounds);
                *score = self.score(large, &met);
                if *score >= before {
                    *motion = refined;
                    last.push(met);
                } else {
                    *score = before;
                    last.push(first);
                }
            }
        }
        Some(rough.into_iter().zip(last).map(|((score, motion), met)| Posing { score, motion, met }).collect())
    }

    /// Seeks the partners of the first samples. `last`: those of the round before, if there was one.
    fn met(&self, large: &Large, samples: usize, motion: &Motion, last: &[MetSample]) -> Vec<MetSample> {
        let meets = |k: usize| {
            let (x, n) = self.moved(k, motion);
            let near = last.get(k).map_or(u32::MAX, |last| last.partner as u32);
            let found = large.seen.tree.near(&sixfold(&x, &n), near, (SLACK, f64::INFINITY));
            let partner = found.map_or(0, |f| f.0 as usize);
            MetSample { at: x, partner, facing: n.dot(&large.seen.samples.normals[partner]).max(0.0) }
        };
        (0..samples.min(self.points.len())).map(meets).collect()
    }

    /// How near its first samples lie, and how they face what they lie at, in the mean.
    fn nearness(&self, large: &Large, motion: &Motion, samples: usize) -> f64 {
        let count = samples.min(self.points.len());
        let of = |k: usize| {
            let (x, n) = self.moved(k, motion);
            large.nearness.at(&x, &n)
        };
        (0..count).map(of).sum::<f64>() / count.max(1) as f64
    }

    /// Scores a pose by what its samples meet.
    fn score(&self, large: &Large, met: &[MetSample]) -> f64 {
        let mut values = RELIEF_SCALES.map(|_| Vec::with_capacity(met.len()));
        let mut nearness = 0.0;
        for (k, MetSample { at, partner, facing }) in met.iter().enumerate() {
            let weight = facing * near(at, &large.seen.samples.points[*partner]);
            nearness += weight / met.len() as f64;
            let there = large.heights(*partner);
            for (s, values) in values.iter_mut().enumerate() {
                values.push((self.relief[k][s], there[s], weight));
            }
        }
        // What is flat lies alike on what is flat wherever it lies near.
        let agreement = match self.is_flat && large.is_flat {
            true => 1.0,
            false => values.iter().map(|v| correlation(v)).sum::<f64>() / values.len() as f64,
        };
        nearness * agreement.max(0.0)
    }

    /// Runs iterated closest points from what the samples meet first; returns what they meet at last, too.
    fn iterate_closest_points(
        &self,
        large: &Large,
        mut motion: Motion,
        mut met: Vec<MetSample>,
        rounds: usize,
    ) -> (Motion, Vec<MetSample>) {
        for _ in 0..rounds {
            let distances: Vec<f64> =
                met.iter().map(|m| (m.at - large.seen.samples.points[m.partner]).norm()).collect();
            let facing: Vec<f64> = met.iter().map(|m| m.facing).collect();
            let sigma = sigma(&distances, &facing, NEAR);
            let pair = |k: usize| {
                let MetSample { at, partner, facing } = met[k];
                let (c, n) = (large.seen.samples.points[partner], large.seen.samples.normals[partner]);
                let way = c - at;
                let target = at + n * n.dot(&way) * (1.0 - TANGENTIAL) + way * TANGENTIAL;
                (self.points[k], target, facing * facing * (-(distances[k] / sigma).powi(2)).exp())
            };
            let pairs: Vec<_> = (0..met.len()).map(pair).collect();
            let Some(fit) = Similarity::fit(pairs.iter().copied()) else { break };
            let weight = pairs.iter().map(|p| p.2).sum::<f64>();
            let middle = pairs.iter().map(|p| p.0 * p.2).sum::<Vec3>() / weight;
            // The fit keeps the middle where it is at any size.
            motion = Motion { rotation: fit.rotation, shift: fit.shift + fit.rotation * middle * (fit.scale - 1.0) };
            met = self.met(large, met.len(), &motion, &met);
        }
        (motion, met)
    }
}

fn near(a: &Vec3, b: &Vec3) -> f64 {
    (-(a - b).norm_squared() / (NEAR * NEAR)).exp()
}

#[cfg(test)]
mod tests;
