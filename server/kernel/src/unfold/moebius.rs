//! Other poles without another solve: a conformal map of a disc (sphere) is known up to a Möbius transformation.
//!
//! From one solution, w = exp(2πi·u − 2πv/P) maps a disc to the unit disc with its pole at 0. For a pole at a,
//! w′ = (w − a)/(1 − āw); for a sphere with poles at n and s, w′ = (w − n)/(w − s). Then u′ = arg w′/2π and
//! −log |w′| takes the place of v, to be re-marginalised as always. One pass over the vertices a pole; the chosen pole
//! is solved for exactly in the end. *Ours, not the paper's.*

use std::sync::Arc;

use super::area_fraction::{AreaFraction, MODULUS_SHARES};
use super::harmonic::Harmonic;
use super::{Chart, Pole, UnfoldReport, corner_uvs};
use crate::mesh::tri::TriMesh;
use crate::topology::Topology;

/// A conformal map of a surface to the disc or the Riemann sphere, in homogeneous coordinates w = x / y.
#[derive(Clone, Debug)]
pub struct Conformal {
    mesh: Arc<TriMesh>,
    topology: Topology,
    patch_vertices: usize,
    x: Vec<[f64; 2]>,
    y: Vec<[f64; 2]>,
    /// Disc: 1 − |w|², precise near the boundary.
    gap: Vec<f64>,
}

/// 1 − |w|² below which a pole so near the boundary of the disc is solved for instead.
const GAP_MIN: f64 = 1e-5;

type Complex = [f64; 2];

fn mul(a: Complex, b: Complex) -> Complex {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn sub(a: Complex, b: Complex) -> Complex {
    [a[0] - b[0], a[1] - b[1]]
}

fn norm2(a: Complex) -> f64 {
    a[0] * a[0] + a[1] * a[1]
}

impl Conformal {
    /// The map that a harmonic v and its conjugate u give; discs and spheres only.
    pub fn new(
        mesh: Arc<TriMesh>,
        topology: Topology,
        patch_vertices: usize,
        harmonic: &Harmonic,
        u: &[f64],
        poles: &[u32],
    ) -> Option<Self> {
        let closed = match topology {
            Topology::Disc => false,
            Topology::Sphere => true,
            Topology::Annulus | Topology::Torus => return None,
        };
        let tau = std::f64::consts::TAU;
        let n = u.len();
        let (mut x, mut y, mut gap) = (vec![[0.0; 2]; n], vec![[1.0, 0.0]; n], vec![1.0; n]);
        for v in 0..n {
            let depth = tau * (harmonic.v[v] - if closed { 0.5 } else { 0.0 }) / harmonic.energy;
            let (sin, cos) = (tau * u[v]).sin_cos();
            if depth >= 0.0 {
                let r = (-depth).exp();
                x[v] = [r * cos, r * sin];
                gap[v] = -(-2.0 * depth).exp_m1();
            } else {
                let r = depth.exp();
                (x[v], y[v]) = ([1.0, 0.0], [r * cos, -r * sin]);
            }
        }
        let at = |k: usize| poles.get(k).map(|&p| p as usize);
        if closed {
            let (south, north) = (at(0)?, at(1)?);
            (x[south], y[south]) = ([1.0, 0.0], [0.0, 0.0]);
            (x[north], y[north]) = ([0.0, 0.0], [1.0, 0.0]);
        } else {
            (x[at(0)?], gap[at(0)?]) = ([0.0, 0.0], 1.0);
        }
        Some(Self { mesh, topology, patch_vertices, x, y, gap })
    }

    /// Whether the map still tells the poles' neighbourhoods apart from their surroundings.
    pub fn is_precise_at(&self, poles: &[u32]) -> bool {
        self.topology != Topology::Disc || poles.iter().all(|&p| self.gap[p as usize] > GAP_MIN)
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<TriMesh> {
        &self.mesh
    }

    /// What it is: a disc or a sphere.
    pub fn topology(&self) -> Topology {
        self.topology
    }

    /// u, in periods, and the depth −log |w′| of each vertex in the chart for other poles.
    pub fn coordinates(&self, poles: &[u32]) -> (Vec<f64>, Vec<f64>) {
        let (u, depth) = match (self.topology, poles) {
            (Topology::Sphere, &[south, north, ..]) => self.sphere(south as usize, north as usize),
            _ => self.disc(poles.first().map_or(0, |&p| p as usize)),
        };
        (u, self.cap_poles(depth, poles))
    }

    /// u, in periods, of some vertices in the chart for other poles.
    pub fn angles(&self, poles: &[u32], at: &[u32]) -> Vec<f64> {
        let (a, b) = (poles.first().copied().unwrap_or(0) as usize, poles.last().copied().unwrap_or(0) as usize);
        let angle = |v: u32| match self.topology {
            Topology::Sphere => self.sphere_at(a, b, v as usize).0,
            _ => self.disc_at(a, v as usize).0,
        };
        at.iter().map(|&v| angle(v)).collect()
    }

    /// The chart for other poles. Its report is empty: nothing was solved.
    pub fn chart(&self, poles: &[u32]) -> Chart {
        let (u, finite) = self.coordinates(poles);
        let fraction = AreaFraction::rough(&self.mesh, &finite);
        let v: Vec<f64> = finite.iter().map(|&d| fraction.at(d)).collect();
        let tau = std::f64::consts::TAU;
        let modulus = match self.topology {
            Topology::Sphere => (fraction.level(MODULUS_SHARES[1]) - fraction.level(MODULUS_SHARES[0])) / tau,
            _ => fraction.level(MODULUS_SHARES[1]) / tau,
        };
        let corners = (0..self.mesh.triangles.len())
            .map(|t| {
                let triangle = self.mesh.triangles[t];
                // Away from the poles no triangle is wider than half a period.
                let jump = |k: usize| (u[triangle[(k + 1) % 3] as usize] - u[triangle[k] as usize]).round() as i32;
                corner_uvs(triangle, &u, &[jump(0), jump(1), jump(2)], &v, poles)
            })
            .collect();
        let uv = u.iter().zip(&v).map(|(&u, &v)| [u.rem_euclid(1.0), v]).collect();
        let last = poles.len().saturating_sub(1);
        let poles = poles.iter().enumerate().map(|(k, &vertex)| Pole { vertex, at_top: k == last }).collect();
        Chart {
            topology: self.topology,
            mesh: Arc::clone(&self.mesh),
            patch_vertices: self.patch_vertices,
            uv,
            corners,
            poles,
            modulus,
            report: UnfoldReport::default(),
        }
    }

    /// u in periods and −log |w′| with the pole at vertex `pole`.
    fn disc(&self, pole: usize) -> (Vec<f64>, Vec<f64>) {
        (0..self.x.len()).map(|v| self.disc_at(pole, v)).unzip()
    }

    fn disc_at(&self, pole: usize, v: usize) -> (f64, f64) {
        let (a, gap_a) = (self.x[pole], self.gap[pole]);
        let top = sub(self.x[v], a);
        let bottom = sub([1.0, 0.0], mul([a[0], -a[1]], self.x[v]));
        let angle = mul(top, [bottom[0], -bottom[1]]);
        // 1 − |w′|² = (1 − |a|²)(1 − |w|²) / |1 − āw|²
        let inside = (gap_a * self.gap[v] / norm2(bottom)).clamp(0.0, 1.0);
        // Each form where it is precise: near the boundary, and near the pole.
        let depth = match inside < 0.5 {
            true => -0.5 * (-inside).ln_1p(),
            false => 0.5 * (norm2(bottom).max(1e-300).ln() - norm2(top).max(1e-300).ln()),
        };
        (angle[1].atan2(angle[0]) / std::f64::consts::TAU, depth)
    }

    /// The same with poles at two vertices of a sphere.
    fn sphere(&self, south: usize, north: usize) -> (Vec<f64>, Vec<f64>) {
        (0..self.x.len()).map(|v| self.sphere_at(south, north, v)).unzip()
    }

    fn sphere_at(&self, south: usize, north: usize, v: usize) -> (f64, f64) {
        let against = |pole: usize| sub(mul(self.x[v], self.y[pole]), mul(self.x[pole], self.y[v]));
        let (top, bottom) = (against(north), against(south));
        let angle = mul(top, [bottom[0], -bottom[1]]);
        let depth = 0.5 * (norm2(bottom).max(1e-300).ln() - norm2(top).max(1e-300).ln());
        (angle[1].atan2(angle[0]) / std::f64::consts::TAU, depth)
    }

    /// Gives the poles, where the depth is infinite, one unit more than their neighbours.
    fn cap_poles(&self, mut depth: Vec<f64>, poles: &[u32]) -> Vec<f64> {
        let is_pole = |v: u32| poles.contains(&v);
        let last = poles.len().saturating_sub(1);
        for (k, &pole) in poles.iter().enumerate() {
            let sign = if k == last { 1.0 } else { -1.0 };
            let mut edge = f64::NEG_INFINITY;
            for t in self.mesh.triangles.iter().filter(|t| t.contains(&pole)) {
                for &v in t.iter().filter(|&&v| !is_pole(v)) {
                    edge = edge.max(sign * depth[v as usize]);
                }
            }
            depth[pole as usize] = sign * (edge + 1.0);
        }
        depth
    }
}

#[cfg(test)]
mod tests {
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, Unfolder, solve_mesh};

    #[test]
    fn moving_the_pole_agrees_with_solving_for_it() {
        let patch = whole(&grid(48, 40, false, false)).expect("a disc");
        let (mesh, own) = (solve_mesh(&patch), patch.mesh.positions.len());
        let (unfolder, _) =
            Unfolder::with_poles(mesh, patch.topology, own, &UnfoldOptions::default()).expect("solvable");
        let (from, to) = (49 * 20 + 24, 49 * 14 + 30);
        let conformal = unfolder.conformal(&unfolder.solve(&[from]).expect("solvable")).expect("a disc");
        let (quick, exact) = (conformal.chart(&[to]), unfolder.chart(&[to]).expect("solvable"));
        assert!((quick.modulus - exact.modulus).abs() < 0.01 * exact.modulus);
        let turn = quick.uv[0][0] - exact.uv[0][0];
        for (q, e) in quick.uv.iter().zip(&exact.uv).filter(|(_, e)| e[1] < 0.97) {
            let du = (q[0] - e[0] - turn + 0.5).rem_euclid(1.0) - 0.5;
            assert!(du.abs() < 5e-3 && (q[1] - e[1]).abs() < 5e-3, "{q:?} {e:?}");
        }
    }
}
