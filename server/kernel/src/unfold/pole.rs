//! Where to put the poles.
//!
//! Disc: the maximum of the *smoothed conformal radius*. From any first pole, w = exp(2πi·u − 2πv/P) maps the disc
//! conformally to the unit disc; R = √(A₃/A₂)·(1 − |w|²) does not depend on that first pole. log √(A₃/A₂) is
//! smoothed by (M + tL)x = My, log(1 − |w|²) is added exactly.
//! Sphere: the ends of the intrinsic diameter (longest shortest edge path, by repeated sweeps).
//! *Source:* paper §4.2 ("maximum of the conformal factor induced by a singularity-free parameterization");
//! *ours:* the smoothing and the Möbius invariance (METHOD §2).

use super::harmonic::{Harmonic, Solver};
use super::path::distances;
use crate::mesh::tri::NONE;
use crate::numerics::SolveError;

/// Smoothing time in units of the area: features smaller than 15 % of √area do not move the pole.
const SMOOTHING: f64 = 0.15 * 0.15;
/// Poles offered at most: the best and its rivals (two ears are a real tie).
const CANDIDATES_MAX: usize = 3;
/// A rival must reach this much of the best conformal radius.
const RIVAL_RADIUS: f64 = 0.75;
/// Sweeps towards the intrinsic diameter of a closed surface.
const DIAMETER_SWEEPS: usize = 4;

/// Poles of a disc, best first.
///
/// # Errors
/// [`SolveError`] when a system cannot be factored.
pub fn disc_candidates(solver: &Solver) -> Result<Vec<u32>, SolveError> {
    let first = torsion_centre(solver);
    let harmonic = solver.v(&[first]);
    let (u, s) = solver.conjugate(&harmonic, &[first])?;
    let radius = smoothed_radius(solver, &harmonic, &u, &s, first)?;
    Ok(local_maxima(solver, &radius))
}

/// The interior vertex at which the solution of −Δx = 1, x = 0 on the boundary, is largest.
fn torsion_centre(solver: &Solver) -> u32 {
    let x = solver.poisson(solver.laplacian.masses.clone());
    let inside = (0..x.len() as u32).filter(|&v| !solver.on_boundary[v as usize]);
    inside.max_by(|&a, &b| x[a as usize].total_cmp(&x[b as usize]).then(b.cmp(&a))).unwrap_or(0)
}

/// log of the smoothed conformal radius at each vertex; −∞ on the boundary.
fn smoothed_radius(
    solver: &Solver,
    harmonic: &Harmonic,
    u: &[f64],
    s: &[i32],
    pole: u32,
) -> Result<Vec<f64>, SolveError> {
    let mesh = &solver.mesh;
    let tau = std::f64::consts::TAU;
    let depth = |v: u32| if v == pole { f64::NEG_INFINITY } else { -tau * harmonic.v[v as usize] / harmonic.energy };
    let mut areas = vec![[0.0f64; 2]; mesh.positions.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        // Turned about the first corner that is no pole: only differences of u count.
        let w = triangle_in_disc(corners, |k| depth(corners[k]), u, &s[3 * t..3 * t + 3], pole);
        let flat = 0.5 * ((w[1][0] - w[0][0]) * (w[2][1] - w[0][1]) - (w[2][0] - w[0][0]) * (w[1][1] - w[0][1]));
        let area = mesh.area(t);
        for &v in corners {
            areas[v as usize][0] += area;
            areas[v as usize][1] += flat.abs();
        }
    }
    let raw: Vec<f64> = areas.iter().map(|[a3, a2]| 0.5 * (a3.max(1e-300).ln() - a2.max(1e-300).ln())).collect();
    let area = mesh.total_area();
    let free = vec![false; raw.len()];
    let weight = 1.0 / (SMOOTHING * area);
    let factor = solver.laplacian.factor(&free, weight, |_| false)?;
    let mut x: Vec<f64> = raw.iter().zip(&solver.laplacian.masses).map(|(y, m)| weight * m * y).collect();
    factor.solve(&mut x);
    let inside = |v: u32| -(2.0 * depth(v)).exp_m1();
    let log_radius = |v: u32| match solver.on_boundary[v as usize] {
        true => f64::NEG_INFINITY,
        false => x[v as usize] + inside(v).max(1e-300).ln(),
    };
    Ok((0..raw.len() as u32).map(log_radius).collect())
}

/// Corners of a triangle in the unit disc, up to a rotation.
fn triangle_in_disc(
    corners: &[u32; 3],
    depth: impl Fn(usize) -> f64,
    u: &[f64],
    s: &[i32],
    pole: u32,
) -> [[f64; 2]; 3] {
    let k0 = corners.iter().position(|&v| v != pole).unwrap_or(0);
    let mut w = [[0.0; 2]; 3];
    for step in 0..3 {
        let k = (k0 + step) % 3;
        if corners[k] == pole {
            continue;
        }
        // The edge from k0 runs forward (step 1) or backward (step 2) along the triangle.
        let jump = match step {
            0 => 0,
            1 => s[k0],
            _ => -s[k],
        };
        let angle = u[corners[k] as usize] - u[corners[k0] as usize] - f64::from(jump);
        let (sin, cos) = (std::f64::consts::TAU * angle).sin_cos();
        let radius = depth(k).exp();
        w[k] = [radius * cos, radius * sin];
    }
    w
}

/// The highest local maxima, best first.
fn local_maxima(solver: &Solver, value: &[f64]) -> Vec<u32> {
    let mut is_peak: Vec<bool> = value.iter().map(|x| x.is_finite()).collect();
    for h in 0..solver.mesh.twins.len() as u32 {
        let (a, b) = (solver.mesh.tail(h) as usize, solver.mesh.head(h) as usize);
        if value[a] < value[b] || (value[a] == value[b] && a > b) {
            is_peak[a] = false;
        }
        if solver.mesh.twin(h) == NONE && (value[b] < value[a] || (value[a] == value[b] && b > a)) {
            is_peak[b] = false;
        }
    }
    let mut peaks: Vec<u32> = (0..value.len() as u32).filter(|&v| is_peak[v as usize]).collect();
    peaks.sort_by(|&a, &b| value[b as usize].total_cmp(&value[a as usize]).then(a.cmp(&b)));
    let best = peaks.first().map_or(0.0, |&p| value[p as usize]);
    peaks.retain(|&p| value[p as usize] >= best + RIVAL_RADIUS.ln());
    peaks.truncate(CANDIDATES_MAX);
    peaks
}

/// Two poles of a sphere, far apart: `[v = 0, v = 1]`.
pub fn sphere_poles(solver: &Solver) -> [u32; 2] {
    let farthest = |from: u32| {
        let (d, _) = distances(&solver.mesh, &[from]);
        (0..d.len() as u32).max_by(|&a, &b| d[a as usize].total_cmp(&d[b as usize]).then(b.cmp(&a))).unwrap_or(from)
    };
    let mut ends = [0, farthest(0)];
    for _ in 0..DIAMETER_SWEEPS {
        let next = farthest(ends[1]);
        if next == ends[0] {
            break;
        }
        ends = [ends[1], next];
    }
    ends
}
