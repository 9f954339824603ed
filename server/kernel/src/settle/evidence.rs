//! Scalars that tell a right map from a wrong one. Compare them between maps of one pair only: no absolute threshold holds
//! from pair to pair.
//!
//! Relief: h(x) = n·(x − Σ g y / Σ g)/σ, g = (1 − |x − y|²/9σ²)⁴ · max(n·n_y, 0) · area within 3 σ (a Gaussian's shape,
//! without exponentials), at two σ; correlated between the example at rest and the input at its place, whose σ grows with
//! the map's size. *Ours, not a paper's:* a mean over samples instead of a smoothing solve, so that the input's size does
//! not matter.

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
    /// Share of the example's area that has no place on the input.
    pub lost: f64,
    /// Share of the input's area that the example lies on.
    pub covered: f64,
}

/// σ of the relief, in √area.
const RELIEF_SCALES: [f64; 2] = [0.04, 0.1];
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
        found.relief = self.relief(probes, samples, size);
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
        let own = Samples {
            points: probes.vertices.iter().map(|v| self.rest.positions[*v as usize]).collect(),
            normals: probes.vertices.iter().map(|v| self.rest.normals[*v as usize]).collect(),
            rim: Vec::new(),
            shares: probes.areas.clone(),
        };
        match (own.is_flat(), samples.is_flat()) {
            // Nothing stands out from either, so that they are alike; what stands out from one alone has no like on the other.
            (true, true) => return 1.0,
            (true, false) | (false, true) => return 0.0,
            (false, false) => {}
        }
        let (around, beyond) = (ReliefSampler::new(&own), ReliefSampler::new(samples));
        let kept: Vec<usize> = (0..own.points.len()).filter(|k| !self.lost[probes.vertices[*k] as usize]).collect();
        let mut values = RELIEF_SCALES.map(|_| Vec::with_capacity(kept.len()));
        for k in kept {
            let v = probes.vertices[k] as usize;
            let at = self.frame.undo(&self.places[v].point);
            let here = around.heights(&own.points[k], &own.normals[k], RELIEF_SCALES);
            let there = beyond.heights(&at, &self.normal(v), RELIEF_SCALES.map(|scale| scale * size));
            for (s, values) in values.iter_mut().enumerate() {
                values.push((here[s], there[s], own.shares[k]));
            }
        }
        values.iter().map(|of| correlation(of)).sum::<f64>() / RELIEF_SCALES.len() as f64
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
    let sum = values.iter().map(|v| v.2).sum::<f64>().max(f64::MIN_POSITIVE);
    let mean = values.iter().fold((0.0, 0.0), |m, v| (m.0 + v.2 * v.0 / sum, m.1 + v.2 * v.1 / sum));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b, w) in values {
        let (a, b) = (a - mean.0, b - mean.1);
        (ab, aa, bb) = (ab + w * a * b, aa + w * a * a, bb + w * b * b);
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}
