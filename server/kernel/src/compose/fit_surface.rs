//! Moves the vertices of a net so that its faces, and not its vertices alone, lie on the input.
//!
//! Between vertices on a curved surface the faces lie inside of it, by 2/3 of the sagitta on average, and a row of
//! quads that crosses a sharp rim cuts it off. With x_k points of the faces, w_kv their weights of the corners, a_k the
//! area that each stands for, r_k = π(x_k) − x_k, and likewise the input's sample points with r_k from the nearest
//! point of the net, the moves d_v make
//!
//! Σ_k a_k |r_k − Σ_v w_kv d_v|²_k + λ Σ_v Σ_k a_k w_kv |D_v − mean of the neighbours' D|²
//!
//! small. The distance |r|²_k = (n_k·r)² counts along the input's normal n_k at π(x_k), so that faces slide along the
//! input; so far as r_k does not point along n_k, as beyond the tip of an ear, it counts in every direction. Where
//! normals differ, on both sides of a ridge, only a vertex on the ridge makes all of it small: rows beside a rim go
//! onto it, be it sharp or rounded. D_v is by how much v was moved in all: a layout is bent, and its spacing kept.
//!
//! Each round solves 3 × 3 equations for each vertex with the others held, and takes π anew; as Σ_v w_kv = 1, the
//! distances can only fall with that for a given π. The vertices then lie a little outside where the surface bulges,
//! and the surface cuts through the faces: a layout of half the quads follows the input as closely. *Source:* Pottmann
//! and Hofer, *Geometry of the squared distance function to curves and surfaces* (2003): which distance counts. *Ours,
//! not the paper's:* on faces, both ways, and that the moves are kept even.

use super::net::Net;
use super::smooth::Target;
use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::side_by_side;
use nalgebra::Matrix3;

/// Rounds. *Untuned.*
const ROUNDS: u32 = 12;
/// λ: `tests/records/fit-surface-2026-11-27.md`.
const EVENNESS: f64 = 0.05;
/// Points of a quad along each side, at ±1/√3 of its half.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// A point farther from the other surface than this share of its face's size has no say: it looks at another sheet.
const BELIEVED: f64 = 0.6;

/// Which vertices stay where they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FixedVertices<'a> {
    /// None.
    Nothing,
    /// Those on the net's boundary.
    Boundary,
    /// Those on the net's boundary, and those told, by their numbers.
    BoundaryAnd(&'a [bool]),
}

/// Sums up what the points ask of a vertex: the least of Σ_k w_k |r_k − d|²_k is where the quadric times d is the sum.
#[derive(Clone, Copy, Default)]
struct QuadricSum {
    quadric: Matrix3<f64>,
    sum: Vec3,
    weight: f64,
}

impl QuadricSum {
    /// Adds a point that misses by `r`, where the input has the normal `n`.
    fn add(&mut self, r: Vec3, n: Vec3, weight: f64) {
        let along = n.dot(&r);
        // The share of r that points along n counts there alone, the rest in all directions.
        let share = (along * along / r.norm_squared().max(f64::MIN_POSITIVE)).min(1.0);
        self.quadric += (n * n.transpose() * share + Matrix3::identity() * (1.0 - share)) * weight;
        self.sum += (n * (along * share) + r * (1.0 - share)) * weight;
        self.weight += weight;
    }

    fn plus(&self, other: &Self) -> Self {
        let (quadric, sum) = (self.quadric + other.quadric, self.sum + other.sum);
        Self { quadric, sum, weight: self.weight + other.weight }
    }

    /// Asks for a move to be even, too.
    fn with_evenness(mut self, to_mean: Vec3) -> Self {
        self.quadric += Matrix3::identity() * (EVENNESS * self.weight);
        self.sum += to_mean * (EVENNESS * self.weight);
        self
    }

    /// The move that is asked for; none where no point asks.
    fn step(self) -> Vec3 {
        self.quadric.try_inverse().map_or_else(Vec3::zeros, |inverse| inverse * self.sum)
    }
}

/// Moves a net's vertices; `points` are spread evenly by area over the surface.
pub fn fit_surface(net: &mut Net, points: &[Vec3], on: (&TriMesh, &Target), held: FixedVertices<'_>) {
    let is_held = |v: u32| match held {
        FixedVertices::Nothing => false,
        FixedVertices::Boundary => net.on_boundary(v),
        FixedVertices::BoundaryAnd(held) => held.get(v as usize) == Some(&true) || net.on_boundary(v),
    };
    let count = net.positions.len() as u32;
    let moving: Vec<u32> = (0..count).filter(|&v| !net.at(v).is_empty() && !is_held(v)).collect();
    let beside: Vec<Vec<u32>> = moving.iter().map(|&v| net.neighbours(v)).collect();
    let input = InputSamples::new(points, on);
    let start = net.positions.clone();
    let mut moved = vec![Vec3::zeros(); net.positions.len()];
    for _ in 0..ROUNDS {
        let (by_faces, by_points) = side_by_side(|| by_faces(net, &input), || by_points(net, &input));
        for (&v, beside) in moving.iter().zip(&beside) {
            let v = v as usize;
            let asked = by_faces[v].plus(&by_points[v]);
            let mean = beside.iter().map(|&w| moved[w as usize]).sum::<Vec3>() / beside.len().max(1) as f64;
            let step = asked.with_evenness(mean - moved[v]).step();
            moved[v] += step;
        }
        moving.iter().for_each(|&v| net.positions[v as usize] = start[v as usize] + moved[v as usize]);
    }
}

/// Samples of the input with their normals, and its surface with the search tree.
struct InputSamples<'a> {
    surface: &'a TriMesh,
    target: &'a Target,
    points: &'a [Vec3],
    at_points: Vec<Vec3>,
}

impl<'a> InputSamples<'a> {
    fn new(points: &'a [Vec3], (surface, target): (&'a TriMesh, &'a Target)) -> Self {
        let mut input = Self { surface, target, points, at_points: Vec::new() };
        input.at_points = target.tree().closest_to_all(points).iter().map(|near| input.normal(near)).collect();
        input
    }

    /// The unit normal where a point is closest; zero where there is none.
    fn normal(&self, near: &Closest) -> Vec3 {
        let is_there = near.triangle != NONE;
        let normal = is_there.then(|| self.surface.area_vector(near.triangle as usize).try_normalize(0.0));
        normal.flatten().unwrap_or_default()
    }
}

/// Points of the faces look for the surface; returns what they ask of each vertex.
fn by_faces(net: &Net, input: &InputSamples<'_>) -> Vec<QuadricSum> {
    let mut asked = vec![QuadricSum::default(); net.positions.len()];
    let of_quads: Vec<Vec<f64>> = GAUSS.iter().flat_map(|&s| GAUSS.map(|t| bilinear(s, t))).collect();
    let samples = |c: &[u32]| match c.len() {
        4 => of_quads.clone(),
        n => vec![vec![1.0 / n as f64; n]],
    };
    let point = |c: &[u32], weights: &[f64]| c.iter().zip(weights).map(|(&v, w)| net.positions[v as usize] * *w).sum();
    let points = net.faces().flat_map(|(_, c)| samples(c).into_iter().map(move |weights| point(c, &weights)));
    let points: Vec<Vec3> = points.collect();
    let mut met = points.iter().zip(input.target.tree().closest_to_all(&points));
    for (_, c) in net.faces() {
        let area = area_vector(net, c).norm();
        let samples = samples(c);
        let share = area / samples.len() as f64;
        for (weights, (x, near)) in samples.iter().zip(met.by_ref()) {
            let r = near.point - x;
            if r.norm_squared() > BELIEVED * BELIEVED * area {
                continue;
            }
            let n = input.normal(&near);
            c.iter().zip(weights).for_each(|(&v, w)| asked[v as usize].add(r, n, share * w));
        }
    }
    asked
}

fn bilinear(s: f64, t: f64) -> Vec<f64> {
    vec![(1.0 - s) * (1.0 - t), s * (1.0 - t), s * t, (1.0 - s) * t]
}

/// Points of the surface look for the net; returns what they ask of each vertex.
fn by_points(net: &Net, input: &InputSamples<'_>) -> Vec<QuadricSum> {
    let mut asked = vec![QuadricSum::default(); net.positions.len()];
    let fans = net.fans();
    let areas: Vec<f64> = fans.face.iter().map(|&f| area_vector(net, net.face(f)).norm()).collect();
    let share = fans.mesh.total_area() / input.points.len().max(1) as f64;
    let bvh = Bvh::new(&fans.mesh);
    for ((x, n), near) in input.points.iter().zip(&input.at_points).zip(bvh.closest_to_all(input.points)) {
        let Some(&area) = areas.get(near.triangle as usize) else { continue };
        if near.distance * near.distance > BELIEVED * BELIEVED * area {
            continue;
        }
        let corners = fans.mesh.triangles[near.triangle as usize];
        let r = x - near.point;
        corners.iter().zip(near.barycentric).for_each(|(&v, w)| asked[v as usize].add(r, *n, share * w));
    }
    asked
}

/// Normal of a polygon, as long as its area.
fn area_vector(net: &Net, c: &[u32]) -> Vec3 {
    let p = |v: u32| net.positions[v as usize];
    let Some(&first) = c.first() else { return Vec3::zeros() };
    (2..c.len()).map(|k| (p(c[k - 1]) - p(first)).cross(&(p(c[k]) - p(first)))).sum::<Vec3>() * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::fit::MeasuredSurface;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    /// A piece of a sphere over a square, and a coarse net with its vertices on it.
    fn dome() -> (TriMesh, Net) {
        let height = |p: &Vec3| (1.0 - (p.x - 0.5).powi(2) - (p.y - 0.5).powi(2)).sqrt();
        let mut surface = grid(60, 60, false, false);
        surface.positions.iter_mut().for_each(|p| p.z = height(p));
        let mut net = sheet(6, 6);
        net.positions.iter_mut().for_each(|p| *p /= 6.0);
        net.positions.iter_mut().for_each(|p| p.z = height(p));
        (surface, net)
    }

    #[test]
    fn faces_of_a_dome_come_to_lie_on_both_sides_of_it() {
        let (surface, net) = dome();
        let (measured, target) = (MeasuredSurface::new(&surface), Target::new(&surface));
        let before = measured.fit(&net.clone().into_mesh().0).worst();
        for (held, left) in [(FixedVertices::Nothing, 0.45), (FixedVertices::Boundary, 0.8)] {
            let mut moved = net.clone();
            fit_surface(&mut moved, measured.points(), (&surface, &target), held);
            let after = measured.fit(&moved.clone().into_mesh().0).worst();
            assert!(after < left * before, "{held:?}: {before} to {after}");
            let stays = (0..49u32).filter(|&v| moved.positions[v as usize] == net.positions[v as usize]).count();
            assert_eq!(stays, if held == FixedVertices::Boundary { 24 } else { 0 });
        }
    }

    #[test]
    fn the_column_beside_a_rounded_ridge_goes_onto_it_and_the_others_follow() {
        // The radius is a tenth of a quad: no edge of the surface is sharp.
        let height = |p: &Vec3| -((p.x - 0.5).powi(2) + 0.0125f64.powi(2)).sqrt();
        let mut surface = grid(160, 40, false, false);
        surface.positions.iter_mut().for_each(|p| p.z = height(p));
        let mut net = sheet(8, 8);
        net.positions
            .iter_mut()
            .for_each(|p| *p = Vec3::new(p.x / 8.0 + 0.04 * (1.0 - (p.x / 4.0 - 1.0).abs()), p.y / 8.0, 0.0));
        net.positions.iter_mut().for_each(|p| p.z = height(p));
        let (measured, target) = (MeasuredSurface::new(&surface), Target::new(&surface));
        let before = net.clone();
        fit_surface(&mut net, measured.points(), (&surface, &target), FixedVertices::Boundary);
        let x = |net: &Net, column: usize, row: usize| net.positions[row * 9 + column].x;
        for row in 2..7 {
            assert!((x(&before, 4, row) - 0.54).abs() < 1e-9);
            assert!((x(&net, 4, row) - 0.5).abs() < 0.008, "{}", x(&net, 4, row));
            let moved = |column: usize| x(&before, column, row) - x(&net, column, row);
            assert!(moved(5) > 0.2 * moved(4), "{} {}", moved(5), moved(4));
        }
        let fit = |net: &Net| measured.fit(&net.clone().into_mesh().0).worst();
        assert!(fit(&net) < 0.5 * fit(&before), "{} to {}", fit(&before), fit(&net));
    }
}
