//! Rough poses of one surface on another, where pictures tell nothing: a mask on a head, a head on a mask.
//!
//! The smaller surface is laid with its middle and mean normal on points spread over the larger, turned about the normal in
//! equal steps, at some sizes; a pose is scored by the share of the smaller that lies near the larger and faces as it does.
//! *Ours, not the paper's.*

use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::settle::Similarity;
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// Points of the larger surface that are tried, and turns about the normal at each.
const PLACES: usize = 60;
const TURNS: usize = 12;
/// Areas of the smaller surface, laid, as shares of the larger's.
const SHARES: [f64; 3] = [0.25, 0.4, 0.65];
/// Samples by which a pose is scored.
const SAMPLES: usize = 120;
/// Distance at which a sample counts 1/e, in √area of the smaller as it is laid.
const NEAR: f64 = 0.06;
/// A mean normal is that of what lies so near about a point, in √area of the smaller as it is laid.
const ABOUT: f64 = 0.4;
/// Poses that are told.
const TOLD: usize = 12;

/// Where the vertices of `example` would lie on `input`, best first, one of the two being much the smaller; never mirrored.
pub fn poses(example: &TriMesh, input: &TriMesh) -> Vec<Vec<Vec3>> {
    let (one, two) = (Sheet::new(example), Sheet::new(input));
    let mut found: Vec<(f64, Similarity)> = Vec::new();
    // The example on a part of the input, and the input on a part of the example.
    found.extend(tried(&one, &two));
    found.extend(tried(&two, &one).into_iter().map(|(score, onto)| (score, inverse(&onto))));
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<Similarity> = Vec::new();
    for (_, pose) in found {
        if kept.len() < TOLD && kept.iter().all(|k| turned_by(k, &pose) > TAU / 12.0 || moved_by(k, &pose, &one) > 0.2)
        {
            kept.push(pose);
        }
    }
    kept.iter().map(|pose| example.positions.iter().map(|x| pose.apply(x)).collect()).collect()
}

fn inverse(of: &Similarity) -> Similarity {
    let rotation = of.rotation.transpose();
    Similarity { scale: 1.0 / of.scale, rotation, shift: -(rotation * of.shift) / of.scale }
}

fn turned_by(a: &Similarity, b: &Similarity) -> f64 {
    (0.5 * ((a.rotation.transpose() * b.rotation).trace() - 1.0)).clamp(-1.0, 1.0).acos()
}

/// How far apart two poses have the middle of a surface, in √area.
fn moved_by(a: &Similarity, b: &Similarity, of: &Sheet) -> f64 {
    (a.apply(&of.middle) - b.apply(&of.middle)).norm() / (a.scale * of.area.sqrt()).max(f64::MIN_POSITIVE)
}

/// A surface with what poses need.
struct Sheet {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    areas: Vec<f64>,
    triangles: Vec<[u32; 3]>,
    area: f64,
    middle: Vec3,
    tree: Bvh,
}

impl Sheet {
    fn new(mesh: &TriMesh) -> Self {
        let TriMesh { positions, triangles, .. } = mesh;
        let (mut normals, mut areas) = (vec![Vec3::zeros(); positions.len()], vec![0.0; positions.len()]);
        for t in triangles {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            let vector = (b - a).cross(&(c - a)) * 0.5;
            t.iter().for_each(|&v| {
                normals[v as usize] += vector;
                areas[v as usize] += vector.norm() / 3.0;
            });
        }
        normals.iter_mut().for_each(|n| *n = n.try_normalize(0.0).unwrap_or_else(Vec3::z));
        let area: f64 = areas.iter().sum();
        let middle = positions.iter().zip(&areas).map(|(x, a)| x * *a).sum::<Vec3>() / area.max(f64::MIN_POSITIVE);
        let (positions, triangles) = (positions.clone(), triangles.clone());
        Self { positions, normals, areas, triangles, area, middle, tree: Bvh::new(mesh) }
    }

    fn normal_in(&self, triangle: u32, weights: [f64; 3]) -> Vec3 {
        let Some(corners) = self.triangles.get(triangle as usize) else { return Vec3::z() };
        (0..3).map(|k| self.normals[corners[k] as usize] * weights[k]).sum()
    }

    /// The mean of places and of normals within a distance of a point.
    fn about(&self, at: Vec3, within: f64) -> (Vec3, Vec3) {
        let near = |v: &usize| (self.positions[*v] - at).norm() < within;
        let (mut sum, mut place, mut normal) = (0.0, Vec3::zeros(), Vec3::zeros());
        for v in (0..self.positions.len()).filter(near) {
            sum += self.areas[v];
            place += self.positions[v] * self.areas[v];
            normal += self.normals[v] * self.areas[v];
        }
        (place / sum.max(f64::MIN_POSITIVE), normal.try_normalize(0.0).unwrap_or_else(Vec3::z))
    }

    /// Vertices spread over the surface.
    fn spread(&self, count: usize) -> Vec<usize> {
        let mut away = vec![f64::INFINITY; self.positions.len()];
        let mut chosen = Vec::new();
        let mut next = 0;
        for _ in 0..count.min(self.positions.len()) {
            chosen.push(next);
            let at = self.positions[next];
            away.iter_mut().zip(&self.positions).for_each(|(d, x)| *d = d.min((x - at).norm_squared()));
            let farthest = (0..away.len()).max_by(|&a, &b| away[a].total_cmp(&away[b]).then(b.cmp(&a)));
            next = farthest.unwrap_or(0);
        }
        chosen
    }
}

/// Two unit vectors that make a right-handed frame with `z`.
fn frame(z: Vec3) -> Matrix3<f64> {
    let other = if z.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let x = other.cross(&z).try_normalize(0.0).unwrap_or_else(Vec3::x);
    Matrix3::from_columns(&[x, z.cross(&x), z])
}

/// The best poses of the smaller on the larger surface, with their scores.
fn tried(small: &Sheet, large: &Sheet) -> Vec<(f64, Similarity)> {
    let samples = small.spread(SAMPLES);
    let places = large.spread(PLACES);
    let (middle, normal) = small.about(small.middle, f64::INFINITY);
    let own = frame(normal);
    let mut found = Vec::new();
    for share in SHARES {
        let scale = (share * large.area / small.area.max(f64::MIN_POSITIVE)).sqrt();
        let size = (share * large.area).sqrt();
        for &place in &places {
            let (to, along) = large.about(large.positions[place], ABOUT * size);
            let there = frame(along);
            for turn in 0..TURNS {
                let (sin, cos) = (TAU * turn as f64 / TURNS as f64).sin_cos();
                let turned = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
                let rotation = there * turned * own.transpose();
                let pose = Similarity { scale, rotation, shift: to - rotation * middle * scale };
                found.push((score(small, large, &samples, &pose, NEAR * size), pose));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(4 * TOLD);
    found
}

fn score(small: &Sheet, large: &Sheet, samples: &[usize], pose: &Similarity, near: f64) -> f64 {
    let of = |&v: &usize| {
        let closest = large.tree.closest(pose.apply(&small.positions[v]));
        let normal = large.normal_in(closest.triangle, closest.barycentric);
        let facing = (pose.rotation * small.normals[v]).dot(&normal).max(0.0);
        (-(closest.distance / near).powi(2)).exp() * facing
    };
    samples.iter().map(of).sum::<f64>() / samples.len().max(1) as f64
}
