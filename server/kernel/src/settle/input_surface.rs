//! The input as the registration sees it: points with normals, which of them lie on its rim, and a tree over both.
//!
//! Nearest neighbours are sought among (x, κ n): a point with a like normal is preferred to a nearer one that looks
//! another way. Large inputs are sampled evenly by area; the rim is kept, since what is nearest to it may lie beyond it.

use super::rest::vertex_normals;
use super::similarity::Similarity;
use super::tree::KdTree;
use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh, is_flat};
use std::ops::Deref;
use std::sync::Arc;

/// κ: what a turn of the normal counts, in units of √area of the example.
pub(super) const NORMAL_WEIGHT: f64 = 0.15;
/// Rim vertices kept are at most this share of the samples.
const RIM_SHARE: f64 = 0.15;
/// Points on each edge of the rim.
const ON_EDGE: usize = 4;
/// Of a rim of more edges than this fewer points are taken of each, one at least: it is sampled finely by itself.
const EDGES_FINE: usize = 16_384;
/// Golden ratio of the plane: steps of the sequence R₂. *Source:* Roberts 2018.
const R2: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// Points of the input.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples {
    pub(super) points: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    /// Whether the sample lies where the input ends.
    pub(super) rim: Vec<bool>,
    /// The share of the input's area that each stands for.
    pub(super) shares: Vec<f64>,
}

impl Samples {
    /// Tells whether what they are samples of is flat.
    pub(super) fn is_flat(&self) -> bool {
        is_flat(self.normals.iter().zip(&self.shares).map(|(n, share)| n * *share))
    }
}

/// Samples of the input in the example's frame, with their tree.
#[derive(Clone, Debug)]
pub(super) struct FramedSamples {
    pub(super) samples: Samples,
    pub(super) tree: KdTree<6>,
}

/// The input with what is known of it.
#[derive(Clone, Debug)]
pub(super) struct InputSurface<'a> {
    pub(super) mesh: &'a TriMesh,
    known: Arc<InputProperties>,
}

/// The input's normals, rim and area.
#[derive(Debug)]
pub(super) struct InputProperties {
    pub(super) normals: Vec<Vec3>,
    pub(super) rim: Vec<bool>,
    pub(super) area: f64,
    /// Points along the rim, a quarter of an edge apart or, where it has very many edges, up to an edge.
    pub(super) along_rim: KdTree<3>,
}

/// Position and weighted normal as one point.
pub(super) fn sixfold(x: &Vec3, n: &Vec3) -> [f64; 6] {
    let k = NORMAL_WEIGHT;
    [x.x, x.y, x.z, k * n.x, k * n.y, k * n.z]
}

impl<'a> InputSurface<'a> {
    pub(super) fn new(mesh: &'a TriMesh) -> Self {
        let (normals, _) = vertex_normals(&mesh.positions, &mesh.triangles);
        let mut rim = vec![false; mesh.positions.len()];
        let mut along = Vec::new();
        let edges: Vec<u32> = (0..mesh.twins.len() as u32).filter(|h| mesh.twin(*h) == NONE).collect();
        let on_edge = (ON_EDGE * EDGES_FINE / edges.len().max(1)).clamp(1, ON_EDGE);
        for h in edges {
            let ends = [mesh.tail(h) as usize, mesh.head(h) as usize];
            ends.iter().for_each(|v| rim[*v] = true);
            along.extend((0..on_edge).map(|k| <[f64; 3]>::from(mesh.point_on(h, k as f64 / on_edge as f64))));
        }
        let known =
            InputProperties { normals, rim, area: mesh.total_area(), along_rim: KdTree::new(along.into_iter()) };
        Self { mesh, known: Arc::new(known) }
    }

    /// A mesh of which all is known.
    pub(super) fn of(mesh: &'a TriMesh, known: &Arc<InputProperties>) -> Self {
        Self { mesh, known: Arc::clone(known) }
    }

    /// What is known of the mesh.
    pub(super) fn known(&self) -> &Arc<InputProperties> {
        &self.known
    }

    /// Every vertex and every triangle's middle, where these are at most `count`; else `count` points spread by area.
    pub(super) fn samples(&self, count: usize) -> Samples {
        let mut samples = Samples::default();
        if self.mesh.positions.len() + self.mesh.triangles.len() <= count {
            let (_, areas) = vertex_normals(&self.mesh.positions, &self.mesh.triangles);
            for v in 0..self.mesh.positions.len() {
                samples.push(self.mesh.positions[v], self.normals[v], self.rim[v], 0.5 * areas[v]);
            }
            for t in 0..self.mesh.triangles.len() {
                self.push_in(&mut samples, t, [1.0 / 3.0; 3], 0.5 * self.mesh.area(t) / self.area);
            }
            return samples;
        }
        let on_rim: Vec<usize> = (0..self.rim.len()).filter(|v| self.rim[*v]).collect();
        let stride = (on_rim.len() as f64 / (RIM_SHARE * count as f64)).ceil().max(1.0) as usize;
        for v in on_rim.into_iter().step_by(stride) {
            samples.push(self.mesh.positions[v], self.normals[v], true, 0.0);
        }
        samples.append(self.spread(count));
        samples
    }

    /// `count` points, each for the same area.
    pub(super) fn spread(&self, count: usize) -> Samples {
        let mut samples = Samples::default();
        let (step, mut so_far) = (self.area / count as f64, 0.0);
        for t in 0..self.mesh.triangles.len() {
            so_far += self.mesh.area(t);
            while samples.points.len() < count && (samples.points.len() as f64 + 0.5) * step < so_far {
                let k = samples.points.len() as f64 + 1.0;
                let (mut u, mut v) = ((k * R2[0]).fract(), (k * R2[1]).fract());
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                self.push_in(&mut samples, t, [1.0 - u - v, u, v], 1.0 / count as f64);
            }
        }
        samples
    }

    fn push_in(&self, samples: &mut Samples, t: usize, barycentric: [f64; 3], share: f64) {
        let corners = self.mesh.triangles[t].map(|v| v as usize);
        let mix = |values: &[Vec3]| (0..3).map(|k| values[corners[k]] * barycentric[k]).sum::<Vec3>();
        let normal = mix(&self.normals).try_normalize(0.0).unwrap_or(self.normals[corners[0]]);
        samples.push(mix(&self.mesh.positions), normal, corners.iter().any(|v| self.rim[*v]), share);
    }
}

impl Deref for InputSurface<'_> {
    type Target = InputProperties;

    fn deref(&self) -> &InputProperties {
        &self.known
    }
}

impl Samples {
    fn push(&mut self, point: Vec3, normal: Vec3, rim: bool, share: f64) {
        self.points.push(point);
        self.normals.push(normal);
        self.rim.push(rim);
        self.shares.push(share);
    }

    fn append(&mut self, mut other: Self) {
        self.points.append(&mut other.points);
        self.normals.append(&mut other.normals);
        self.rim.append(&mut other.rim);
        self.shares.append(&mut other.shares);
    }

    /// The same as seen from the frame that `frame` carries into the input's.
    pub(super) fn seen_from(&self, frame: &Similarity) -> Self {
        Self {
            points: self.points.iter().map(|p| frame.undo(p)).collect(),
            normals: self.normals.iter().map(|n| frame.rotation.tr_mul(n)).collect(),
            rim: self.rim.clone(),
            shares: self.shares.clone(),
        }
    }
}

impl FramedSamples {
    pub(super) fn new(samples: Samples) -> Self {
        let tree = KdTree::new(samples.points.iter().zip(&samples.normals).map(|(x, n)| sixfold(x, n)));
        Self { samples, tree }
    }
}
