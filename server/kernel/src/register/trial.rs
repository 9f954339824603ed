//! The encoding of a query for poles that are only tried: some forty of them for each of the best examples.
//!
//! The chart is a Möbius transformation away ([`Conformal`]). v is the area of all vertices that lie less deep, a vertex
//! having a third of its faces and being half below itself:
//!
//! ```text
//! v(i) = (Σ_{d_j < d_i} a_j + a_i/2) / Σ a_j,   a_j = ⅓ Σ area of the faces at j;   0 on the boundary
//! ```
//!
//! which is one sort, where the exact share of area ([`AreaFraction`](crate::unfold::area_fraction::AreaFraction)) cuts
//! every triangle at every level; it is within a vertex's area of it. The poles that are chosen are unfolded exactly.
//! *Source:* METHOD §2 ("pole refinement"). *Ours, not the paper's:* all of it.

use super::view::View;
use crate::encode::raster::{Footprint, picture};
use crate::encode::{Encoding, Picture, from_finest};
use crate::mesh::tri::TriMesh;
use crate::topology::Topology;
use crate::unfold::area_fraction::MODULUS_SHARES;
use crate::unfold::moebius::Conformal;

/// What all trials of a query have in common.
#[derive(Debug)]
pub struct Trials {
    /// Each triangle's share of the area, and each vertex's.
    of_triangle: Vec<f64>,
    of_vertex: Vec<f64>,
}

impl Trials {
    /// Measures a mesh.
    pub fn new(mesh: &TriMesh) -> Self {
        let areas: Vec<f64> = (0..mesh.triangles.len()).map(|t| mesh.area(t)).collect();
        let total: f64 = areas.iter().sum();
        let of_triangle: Vec<f64> = areas.into_iter().map(|area| area / total).collect();
        let mut of_vertex = vec![0.0; mesh.positions.len()];
        for (triangle, share) in mesh.triangles.iter().zip(&of_triangle) {
            triangle.iter().for_each(|&v| of_vertex[v as usize] += share / 3.0);
        }
        Self { of_triangle, of_vertex }
    }

    /// The encoding with other poles, `finest` pixels a side at its finest level.
    pub fn encoding(&self, conformal: &Conformal, poles: &[u32], finest: usize) -> Encoding {
        let topology = conformal.topology();
        let (u, depth) = conformal.coordinates(poles);
        let (v, modulus) = self.shares_below(topology, &depth);
        from_finest(self.picture(conformal, poles, (&u, &v), finest), topology, modulus)
    }

    /// The view about other poles, `side` pixels a side.
    pub fn view(&self, conformal: &Conformal, poles: &[u32], side: usize) -> View {
        let (u, depth) = conformal.coordinates(poles);
        let (v, _) = self.shares_below(conformal.topology(), &depth);
        let picture = self.picture(conformal, poles, (&u, &v), side);
        View::new(poles, picture, &v, &depth)
    }

    fn picture(&self, conformal: &Conformal, poles: &[u32], (u, v): (&[f64], &[f64]), side: usize) -> Picture {
        let mesh = conformal.mesh();
        let shapes = mesh.triangles.iter().zip(&self.of_triangle).map(|(triangle, share)| {
            let shape = match triangle.iter().position(|corner| poles.contains(corner)) {
                Some(k) => pole_shape(*triangle, k, poles, u, v),
                None => Footprint::Triangle(continued(*triangle, u).map(|(vertex, u)| [u, v[vertex as usize]])),
            };
            (shape, *share)
        });
        picture(conformal.topology(), side, shapes)
    }

    /// v of each vertex, and the modulus.
    fn shares_below(&self, topology: Topology, depth: &[f64]) -> (Vec<f64>, f64) {
        let mut order: Vec<(f64, u32)> = depth.iter().copied().zip(0..).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let least = order.first().map_or(0.0, |first| first.0);
        let mut v = vec![0.0; depth.len()];
        let (mut below, mut levels) = (0.0, MODULUS_SHARES.map(|share| (share, None)));
        for &(d, vertex) in &order {
            let share = self.of_vertex[vertex as usize];
            let own = if d > least { below + 0.5 * share } else { 0.0 };
            v[vertex as usize] = own;
            below += share;
            for (wanted, found) in &mut levels {
                if found.is_none() && own >= *wanted {
                    *found = Some(d);
                }
            }
        }
        let level = |k: usize| levels[k].1.unwrap_or(least);
        // The poles, deepest of all, are points: what is left belongs to them.
        if let Some(&(_, last)) = order.last() {
            v[last as usize] = 1.0;
        }
        let low = if topology == Topology::Sphere { level(0) } else { 0.0 };
        (v, (level(1) - low) / std::f64::consts::TAU)
    }
}

/// u of a triangle's corners, continuous, from the first in 0–1. Away from the poles no triangle is wider than half a
/// period.
fn continued(triangle: [u32; 3], u: &[f64]) -> [(u32, f64); 3] {
    let first = u[triangle[0] as usize];
    let from = first - first.floor();
    let corners = triangle.map(|vertex| {
        let step = u[vertex as usize] - first;
        (vertex, from + step - step.round())
    });
    let lowest = corners.iter().map(|c| c.1).fold(f64::INFINITY, f64::min).floor();
    corners.map(|(vertex, u)| (vertex, u - lowest))
}

/// A pole's triangle is the quad between its opposite edge and the pole's line.
fn pole_shape(triangle: [u32; 3], k: usize, poles: &[u32], u: &[f64], v: &[f64]) -> Footprint {
    let [_, a, b] = [0, 1, 2].map(|j| triangle[(k + j) % 3]);
    let end = if poles.last() == Some(&triangle[k]) { 1.0 } else { 0.0 };
    let [(_, ua), (_, ub), _] = continued([a, b, a], u);
    Footprint::Pole([[ua, v[a as usize]], [ub, v[b as usize]], [ub, end], [ua, end]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::encode_to;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, Unfolder, solve_mesh};

    #[test]
    fn a_trial_shows_what_the_chart_shows_that_cuts_triangles_at_every_level() {
        let patch = whole(&grid(64, 56, false, false)).expect("a disc");
        let (mesh, own) = (solve_mesh(&patch), patch.mesh.positions.len());
        let (unfolder, _) =
            Unfolder::with_poles(mesh, patch.topology, own, &UnfoldOptions::default()).expect("solvable");
        let (from, to) = (65 * 28 + 32, 65 * 20 + 38);
        let conformal = unfolder.conformal(&unfolder.solve(&[from]).expect("solvable")).expect("a disc");
        let trial = Trials::new(unfolder.mesh()).encoding(&conformal, &[to], 64);
        let plain = encode_to(&conformal.chart(&[to]), 64);
        assert!((trial.modulus - plain.modulus).abs() < 0.01 * plain.modulus);
        assert!((trial.pyramid[0].mean() - 1.0).abs() < 1e-6);
        for (trial, plain) in trial.pyramid.iter().zip(&plain.pyramid) {
            let side = trial.side;
            for y in 0..side {
                let row = y * side..(y + 1) * side;
                let apart = trial.values[row.clone()].iter().zip(&plain.values[row]).map(|(a, b)| (a - b).abs() / b);
                let mean = apart.sum::<f32>() / side as f32;
                assert!(mean < 0.08, "{side}², row {y}: {mean}");
            }
        }
    }
}
