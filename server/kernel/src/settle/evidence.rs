//! Scalars that tell a right map from a wrong one. Compare them between maps of one pair only: no absolute threshold holds
//! from pair to pair.
//!
//! Relief: h(x) = n·(x − Σ g y / Σ g)/σ, g = (1 − |x − y|²/9σ²)⁴ · max(n·n_y, 0) · area within 3 σ (a Gaussian's shape,
//! without exponentials), at two σ; correlated between the example at rest and the input at its place, whose σ grows with
//! the map's size. *Ours, not a paper's:* a mean over samples instead of a smoothing solve, so that the input's size does
//! not matter.
//!
//! One correlation over all of the example asks whether the input has no other relief than it: the curls of a statue's head drown
//! out its eyes and nose. So relief is correlated within small windows, too, each of which counts as much as the example's relief
//! varies there: that asks whether the input has what the example has. *Source:* the normalized cross-correlation of images.

use super::input_surface::{InputSurface, Samples, sixfold};
use super::place::normal_at;
use super::rest::{Nodes, Pose, Rest, vertex_normals};
use super::similarity::{Similarity, singular_values};
use super::tree::KdTree;
use crate::mesh::Vec3;
use crate::mesh::bvh::Closest;
use crate::numerics::stop;
use crate::numerics::wide::{LANES, Lanes, Wide, wide};

/// What a map looks like. Lengths in √area of the example as the start has it laid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Root mean square distance from the input before the projection, each at most 0.1.
    pub residual: f64,
    /// Mean of 1 − cos between the example's and the input's normals.
    pub normal_disagreement: f64,
    /// Mean |log of the local map's singular values − their mean|: right maps below some 0.25.
    pub shear: f64,
    /// Standard deviation of the log of the local size: right maps below some 0.15.
    pub scale_spread: f64,
    /// Σ w |L_i − L_j|² over the squared size: right maps below some 25.
    pub bend: f64,
    /// Correlation of relief, −1 to 1; the arbiter between maps of one pair.
    pub relief: f64,
    /// The same within windows, where the example has relief: right maps have .28 and more, most wrong ones less than .22.
    pub local_relief: f64,
    /// Share of the example's area that has no place on the input.
    pub lost: f64,
    /// Share of the input's area that the example lies on.
    pub covered: f64,
}

/// σ of the relief, in √area.
const RELIEF_SCALES: [f64; 2] = [0.04, 0.1];
/// Radius of a window within which relief is compared, in √area.
const WINDOW: f64 = 0.08;
/// What log₁₀ of the bend, and the disagreement of normals, count against relief.
const BEND_WEIGHT: f64 = 0.2;
const NORMAL_WEIGHT: f64 = 2.0;
/// Distances count up to this.
const RESIDUAL_MAX: f64 = 0.1;

/// A settled map, to be judged. All but the ground is in the example's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct JudgedMap<'a> {
    pub(super) rest: &'a Rest,
    pub(super) ground: &'a InputSurface<'a>,
    pub(super) frame: &'a Similarity,
    pub(super) nodes: &'a Nodes,
    pub(super) pose: &'a Pose,
    pub(super) positions: &'a [Vec3],
    pub(super) places: &'a [Closest],
    pub(super) lost: &'a [bool],
}

/// What is farther from the example, in √area, lies beyond it.
const COVERS: f64 = 0.05;
/// The same where the example ends.
const AT_RIM: f64 = 0.02;

impl Evidence {
    /// How sure the map is: relief, less what its bend and its normals count. Below 1; right maps have some .3 to .9. *Untuned.*
    pub fn confidence(&self) -> f64 {
        self.agreement() - NORMAL_WEIGHT * self.normal_disagreement
    }

    /// The same but for the normals, which tell the places of one example from each other, and between two species say little.
    pub fn agreement(&self) -> f64 {
        self.relief - BEND_WEIGHT * self.bend.max(1.0).log10()
    }

    /// [Confidence](Self::confidence) with half of the relief compared within windows: tells the places of one example from each other,
    /// of which what the input has beyond it says nothing.
    pub fn place_confidence(&self) -> f64 {
        self.confidence() + 0.5 * (self.local_relief - self.relief)
    }
}

impl JudgedMap<'_> {
    /// `probes`: vertices at which the relief is compared; `samples` of the input, in the frame.
    pub(super) fn evidence(&self, probes: &Nodes, samples: &Samples) -> Evidence {
        let kept: Vec<f64> =
            self.rest.areas.iter().zip(self.lost).map(|(a, lost)| if *lost { 0.0 } else { *a }).collect();
        let sum = kept.iter().sum::<f64>();
        let (normals, _) = vertex_normals(self.positions, &self.rest.triangles);
        let mut found = Evidence { lost: (1.0 - sum).max(0.0), ..Evidence::default() };
        for v in (0..kept.len()).filter(|v| kept[*v] > 0.0) {
            let w = kept[v] / sum;
            found.residual += w * (self.places[v].distance / self.frame.scale).min(RESIDUAL_MAX).powi(2);
            found.normal_disagreement += w * (1.0 - normals[v].dot(&self.normal(v)));
        }
        found.residual = found.residual.sqrt();
        found.covered = self.covered(&normals, samples);
        let size = self.strain(&mut found);
        (found.relief, found.local_relief) = match self.heights(probes, samples, size) {
            Ok(heights) => (heights.correlation(), heights.local_correlation()),
            Err(flat) => (flat, flat),
        };
        found
    }

    /// The share of the samples whose nearest vertex is near and lies within the example.
    fn covered(&self, normals: &[Vec3], samples: &Samples) -> f64 {
        let tree = KdTree::new(self.positions.iter().zip(normals).map(|(x, n)| sixfold(x, n)));
        let is_on = |k: &usize| {
            let near = tree.nearest(&sixfold(&samples.points[*k], &samples.normals[*k]));
            near.is_some_and(|(v, squared)| {
                let reach = if self.rest.rim[v as usize] { AT_RIM } else { COVERS };
                squared < reach * reach
            })
        };
        (0..samples.points.len()).filter(is_on).map(|k| samples.shares[k]).sum()
    }

    fn normal(&self, v: usize) -> Vec3 {
        self.frame.rotation.tr_mul(&normal_at(self.ground, &self.places[v]))
    }

    /// Fills in what the local maps say; returns the size of the map.
    fn strain(&self, found: &mut Evidence) -> f64 {
        let logs: Vec<[f64; 3]> = self.pose.maps.iter().map(|m| singular_values(m).map(|s| s.max(1e-6).ln())).collect();
        let means: Vec<f64> = logs.iter().map(|l| l.iter().sum::<f64>() / 3.0).collect();
        let weight = |k: usize| if self.lost[self.nodes.vertices[k] as usize] { 0.0 } else { self.nodes.areas[k] };
        let sum: f64 = (0..means.len()).map(weight).sum::<f64>().max(f64::MIN_POSITIVE);
        let mean = (0..means.len()).map(|k| weight(k) * means[k]).sum::<f64>() / sum;
        let of = |value: &dyn Fn(usize) -> f64| (0..means.len()).map(|k| weight(k) * value(k)).sum::<f64>() / sum;
        found.shear = of(&|k| logs[k].iter().map(|l| (l - means[k]).powi(2)).sum::<f64>().sqrt());
        found.scale_spread = of(&|k| (means[k] - mean).powi(2)).sqrt();
        let between = |(i, j, w): &(u32, u32, f64)| {
            w * (self.pose.maps[*i as usize] - self.pose.maps[*j as usize]).norm_squared()
        };
        let size = mean.exp();
        found.bend = self.nodes.edges.iter().map(between).sum::<f64>() / (size * size);
        size
    }

    /// `size`: how much larger the example is laid than the frame has it.
    pub(super) fn relief(&self, probes: &Nodes, samples: &Samples, size: f64) -> f64 {
        self.heights(probes, samples, size).map_or_else(|flat| flat, |heights| heights.correlation())
    }

    /// The heights of the probes that are not lost; where either surface is flat, the correlation that stands for theirs.
    fn heights(&self, probes: &Nodes, samples: &Samples, size: f64) -> Result<ProbeHeights, f64> {
        let own = Samples {
            points: probes.vertices.iter().map(|v| self.rest.positions[*v as usize]).collect(),
            normals: probes.vertices.iter().map(|v| self.rest.normals[*v as usize]).collect(),
            rim: Vec::new(),
            shares: probes.areas.clone(),
        };
        match (own.is_flat(), samples.is_flat()) {
            // Nothing stands out from either, so that they are alike; what stands out from one alone has no like on the other.
            (true, true) => return Err(1.0),
            (true, false) | (false, true) => return Err(0.0),
            (false, false) => {}
        }
        let (around, beyond) = (ReliefSampler::new(&own), ReliefSampler::new(samples));
        let mut kept: Vec<usize> = (0..own.points.len()).filter(|k| !self.lost[probes.vertices[*k] as usize]).collect();
        kept.sort_by(|a, b| own.points[*a].x.total_cmp(&own.points[*b].x));
        let mut values = RELIEF_SCALES.map(|_| Vec::with_capacity(kept.len()));
        for &k in &kept {
            let v = probes.vertices[k] as usize;
            let at = self.frame.undo(&self.places[v].point);
            let here = around.heights(&own.points[k], &own.normals[k], RELIEF_SCALES);
            let there = beyond.heights(&at, &self.normal(v), RELIEF_SCALES.map(|scale| scale * size));
            for (s, values) in values.iter_mut().enumerate() {
                values.push((here[s], there[s], own.shares[k]));
            }
        }
        Ok(ProbeHeights { probes: kept.iter().map(|&k| (own.points[k], own.normals[k])).collect(), values })
    }
}

/// Heights of probes on the example and at their places on the input.
struct ProbeHeights {
    /// A probe's point and normal on the example, in order of x.
    probes: Vec<(Vec3, Vec3)>,
    /// For each σ: a probe's height on the example, that on the input, and its share of the area.
    values: [Vec<(f64, f64, f64)>; 2],
}

impl ProbeHeights {
    /// The correlation of all, as the mean over the σ.
    fn correlation(&self) -> f64 {
        self.values.iter().map(|of| correlation(of)).sum::<f64>() / self.values.len() as f64
    }

    /// The mean of the correlations within the windows about each probe; each counts as much as the example's heights deviate there.
    fn local_correlation(&self) -> f64 {
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        let mut first = 0;
        for (k, (point, normal)) in self.probes.iter().enumerate() {
            first += self.probes[first..k].iter().take_while(|(other, _)| other.x < point.x - WINDOW).count();
            let in_reach = self.probes[first..].iter().take_while(|(other, _)| other.x <= point.x + WINDOW);
            let window: Vec<(usize, f64)> = (first..)
                .zip(in_reach)
                .map(|(j, (other, facing))| {
                    let within = (1.0 - (other - point).norm_squared() / (WINDOW * WINDOW)).max(0.0);
                    (j, within * within * facing.dot(normal).max(0.0))
                })
                .filter(|(_, near)| *near > 0.0)
                .collect();
            stop::pass(window.len());
            for (s, values) in self.values.iter().enumerate() {
                let weighed = |&(j, near): &(usize, f64)| (values[j].0, values[j].1, near * values[j].2);
                let near: Vec<(f64, f64, f64)> = window.iter().map(weighed).collect();
                let moments = Moments::of(&near);
                let count = values[k].2 * moments.deviation();
                (sums[s], counts[s]) = (sums[s] + count * moments.correlation(), counts[s] + count);
            }
        }
        let mean = |s: usize| if counts[s] > 0.0 { sums[s] / counts[s] } else { 0.0 };
        (mean(0) + mean(1)) / 2.0
    }
}

/// Tells how far points stand out from the mean of what is around them, in σ, for each of some σ.
#[derive(Clone, Debug)]
pub(super) struct ReliefSampler {
    /// x, y, z; the normal; the share: eight samples at a time, and what is left over counts nothing.
    blocks: Vec<[Lanes; 7]>,
}

impl ReliefSampler {
    pub(super) fn new(samples: &Samples) -> Self {
        let mut blocks = vec![[[0.0; LANES]; 7]; samples.points.len().div_ceil(LANES)];
        for k in 0..samples.points.len() {
            let (x, n) = (samples.points[k], samples.normals[k]);
            for (row, value) in [x.x, x.y, x.z, n.x, n.y, n.z, samples.shares[k]].into_iter().enumerate() {
                blocks[k / LANES][row][k % LANES] = value;
            }
        }
        Self { blocks }
    }

    /// The heights of a point.
    pub(super) fn heights<const N: usize>(&self, at: &Vec3, normal: &Vec3, sigmas: [f64; N]) -> [f64; N] {
        stop::pass(LANES * self.blocks.len());
        let (weights, means) = wide(Heights { around: self, at, normal, sigmas });
        let mut found = [0.0; N];
        for s in (0..N).filter(|s| weights[*s] > 0.0) {
            found[s] = -normal.dot(&means[s]) / (weights[s] * sigmas[s]);
        }
        found
    }
}

/// Σ g, and Σ g (y − x).
struct Heights<'a, const N: usize> {
    around: &'a ReliefSampler,
    at: &'a Vec3,
    normal: &'a Vec3,
    sigmas: [f64; N],
}

impl<const N: usize> Wide for Heights<'_, N> {
    type Output = ([f64; N], [Vec3; N]);

    #[inline(always)]
    fn run(self) -> ([f64; N], [Vec3; N]) {
        let (at, normal) = ([self.at.x, self.at.y, self.at.z], [self.normal.x, self.normal.y, self.normal.z]);
        let narrowness = self.sigmas.map(|sigma| 1.0 / (9.0 * sigma * sigma));
        let mut sums = [[[0.0; LANES]; 4]; N];
        // One short loop after another, each over all lanes: that is what compiles to wide vectors.
        for [x, y, z, nx, ny, nz, share] in &self.around.blocks {
            let (mut way, mut squared, mut counts) = ([[0.0; LANES]; 3], [0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                way[0][lane] = x[lane] - at[0];
                way[1][lane] = y[lane] - at[1];
                way[2][lane] = z[lane] - at[2];
            }
            for lane in 0..LANES {
                squared[lane] = way[0][lane] * way[0][lane] + way[1][lane] * way[1][lane] + way[2][lane] * way[2][lane];
            }
            for lane in 0..LANES {
                let facing = nx[lane] * normal[0] + ny[lane] * normal[1] + nz[lane] * normal[2];
                counts[lane] = if facing > 0.0 { facing } else { 0.0 };
            }
            for lane in 0..LANES {
                counts[lane] *= share[lane];
            }
            for s in 0..N {
                let mut g = [0.0; LANES];
                for lane in 0..LANES {
                    let within = 1.0 - squared[lane] * narrowness[s];
                    g[lane] = if within > 0.0 { within } else { 0.0 };
                }
                for lane in 0..LANES {
                    let square = g[lane] * g[lane];
                    g[lane] = square * square * counts[lane];
                }
                for lane in 0..LANES {
                    sums[s][0][lane] += g[lane];
                }
                for d in 0..3 {
                    for lane in 0..LANES {
                        sums[s][d + 1][lane] += way[d][lane] * g[lane];
                    }
                }
            }
        }
        let (mut weights, mut means) = ([0.0; N], [Vec3::zeros(); N]);
        for s in 0..N {
            for lane in 0..LANES {
                let [weight, x, y, z] = sums[s].map(|row| row[lane]);
                weights[s] += weight;
                means[s] += Vec3::new(x, y, z);
            }
        }
        (weights, means)
    }
}

/// Of (a, b, weight); 0 where either is constant. Of what is [flat](Samples::is_flat) it would be that of rounding errors.
pub(super) fn correlation(values: &[(f64, f64, f64)]) -> f64 {
    Moments::of(values).correlation()
}

/// The second moments of some (a, b, weight) about their means.
struct Moments {
    weight: f64,
    aa: f64,
    ab: f64,
    bb: f64,
}

impl Moments {
    fn of(values: &[(f64, f64, f64)]) -> Self {
        let weight = values.iter().map(|v| v.2).sum::<f64>().max(f64::MIN_POSITIVE);
        let mean = values.iter().fold((0.0, 0.0), |m, v| (m.0 + v.2 * v.0 / weight, m.1 + v.2 * v.1 / weight));
        let mut found = Self { weight, aa: 0.0, ab: 0.0, bb: 0.0 };
        for (a, b, w) in values {
            let (a, b) = (a - mean.0, b - mean.1);
            (found.ab, found.aa, found.bb) = (found.ab + w * a * b, found.aa + w * a * a, found.bb + w * b * b);
        }
        found
    }

    /// 0 where either is constant.
    fn correlation(&self) -> f64 {
        if self.aa > 0.0 && self.bb > 0.0 { self.ab / (self.aa * self.bb).sqrt() } else { 0.0 }
    }

    /// The standard deviation of a.
    fn deviation(&self) -> f64 {
        (self.aa / self.weight).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_only_the_input_has_drowns_out_relief_as_a_whole_and_not_within_windows() {
        const SIDE: usize = 40;
        let place = |k: usize| ((k / SIDE) as f64 / SIDE as f64, (k % SIDE) as f64 / SIDE as f64);
        // A face on one half, and a smooth crown on the other.
        let face = |k: usize| {
            let (x, y) = place(k);
            let bump = (31.0 * x).sin() * (23.0 * y).cos();
            if x < 0.5 { bump } else { 0.02 * bump }
        };
        let curls = |k: usize| {
            let (x, y) = place(k);
            if x < 0.5 { 0.0 } else { 3.0 * (61.0 * x + 17.0 * y).sin() }
        };
        let heights = |there: &dyn Fn(usize) -> f64| {
            let values: Vec<(f64, f64, f64)> = (0..SIDE * SIDE).map(|k| (face(k), there(k), 1.0)).collect();
            let probe = |k: usize| (Vec3::new(place(k).0, place(k).1, 0.0), Vec3::z());
            ProbeHeights { probes: (0..SIDE * SIDE).map(probe).collect(), values: [values.clone(), values] }
        };
        let right = heights(&|k| face(k) + curls(k));
        assert!(right.correlation() < 0.3, "{}", right.correlation());
        assert!(right.local_correlation() > 0.8, "{}", right.local_correlation());
        // A face that is laid beside its place.
        let wrong = heights(&|k| face((k + 3 * SIDE + 7) % (SIDE * SIDE)) + curls(k));
        assert!(wrong.local_correlation() < 0.2, "{}", wrong.local_correlation());
        // The example has no relief, so that nothing speaks for it.
        let values = vec![(0.0, 1.0, 1.0); 4];
        let smooth = ProbeHeights { probes: vec![(Vec3::zeros(), Vec3::z()); 4], values: [values.clone(), values] };
        assert_eq!(smooth.local_correlation(), 0.0);
    }
}
