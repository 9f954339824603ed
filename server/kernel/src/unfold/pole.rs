//! Where to put the poles.
//!
//! Disc: the maximum of the *smoothed conformal radius*. From any first pole, w = exp(2πi·u − 2πv/P) maps the disc
//! conformally to the unit disc; R = √(A₃/A₂)·(1 − |w|²) does not depend on that first pole. log √(A₃/A₂) is
//! smoothed by (M + tL)x = My, log(1 − |w|²) is added exactly.
//! Sphere: the ends of the intrinsic diameter (longest shortest edge path, by repeated sweeps).
//! *Source:* paper §4.2 ("maximum of the conformal factor induced by a singularity-free parameterization");
//! *ours:* the smoothing and the Möbius invariance (METHOD §2).

use super::harmonic::{Harmonic, Solver};
use super::path::{distances, for_each_spoke};
use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::SolveError;
use crate::topology::Topology;

/// Smoothing time in units of the area: features smaller than 15 % of √area do not move the pole.
const SMOOTHING: f64 = 0.15 * 0.15;
/// Smoothing time for tips: a finger is some 7 % of √area wide.
const TIP_SMOOTHING: f64 = 0.04 * 0.04;
/// Rise of log √(A₃/A₂) that makes a tip: a tube half as long as its circumference.
const PROMINENCE: f64 = 1.5;
/// Tips kept at most.
const TIPS_MAX: usize = 16;
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
    let raw = log_scale(solver, &harmonic, &u, &s, &[first]);
    let smooth = smoothed(solver, &raw, SMOOTHING)?;
    let tau = std::f64::consts::TAU;
    let log_radius = |v: usize| {
        let inside = if v as u32 == first { 1.0 } else { -(-2.0 * tau * harmonic.v[v] / harmonic.energy).exp_m1() };
        if solver.on_boundary[v] { f64::NEG_INFINITY } else { smooth[v] + inside.max(1e-300).ln() }
    };
    let radius: Vec<f64> = (0..raw.len()).map(log_radius).collect();
    Ok(local_maxima(solver, &radius))
}

/// Tips of protrusions (fingers, limbs): maxima of the smoothed log √(A₃/A₂) that rise by [`PROMINENCE`] over the
/// saddle to a higher one, highest first. Along a tube of circumference c it grows by 2π/c a unit of length.
///
/// # Errors
/// [`SolveError`] when a system cannot be factored.
pub fn protrusions(solver: &Solver, poles: &[u32]) -> Result<Vec<u32>, SolveError> {
    let harmonic = solver.v(poles);
    let (u, s) = solver.conjugate(&harmonic, poles)?;
    let raw = log_scale(solver, &harmonic, &u, &s, poles);
    let smooth = smoothed(solver, &raw, TIP_SMOOTHING)?;
    let mut tips = prominent_maxima(&solver.mesh, &smooth, PROMINENCE);
    tips.retain(|&v| !solver.on_boundary[v as usize]);
    tips.truncate(TIPS_MAX);
    Ok(tips)
}

/// Maxima whose rise over the saddle that joins them to a higher maximum is at least `prominence` (persistence of the
/// superlevel sets, by union–find), highest first. The highest of all counts always.
fn prominent_maxima(mesh: &TriMesh, value: &[f64], prominence: f64) -> Vec<u32> {
    let n = value.len();
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_by(|&a, &b| value[b as usize].total_cmp(&value[a as usize]).then(a.cmp(&b)));
    let mut rank = vec![0u32; n];
    order.iter().enumerate().for_each(|(k, &v)| rank[v as usize] = k as u32);
    let out = mesh.outgoing();
    let mut parent: Vec<u32> = (0..n as u32).collect();
    let mut kept = Vec::new();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for &v in &order {
        if out[v as usize] == NONE {
            continue;
        }
        // Components of higher vertices that meet here; each is named by its maximum.
        let mut peaks = Vec::new();
        for_each_spoke(mesh, out[v as usize], |_, w| {
            if rank[w as usize] < rank[v as usize] {
                peaks.push(w);
            }
        });
        let mut peaks: Vec<u32> = peaks.into_iter().map(|w| root(&mut parent, w)).collect();
        peaks.sort_by_key(|&p| rank[p as usize]);
        peaks.dedup();
        if let Some(&highest) = peaks.first() {
            for &lower in &peaks[1..] {
                if value[lower as usize] - value[v as usize] >= prominence {
                    kept.push(lower);
                }
                parent[lower as usize] = highest;
            }
            parent[v as usize] = highest;
        }
    }
    kept.extend(order.first());
    kept.sort_by_key(|&p| rank[p as usize]);
    kept
}

/// The interior vertex at which the solution of −Δx = 1, x = 0 on the boundary, is largest.
fn torsion_centre(solver: &Solver) -> u32 {
    let x = solver.poisson(solver.laplacian.masses.clone());
    let inside = (0..x.len() as u32).filter(|&v| !solver.on_boundary[v as usize]);
    inside.max_by(|&a, &b| x[a as usize].total_cmp(&x[b as usize]).then(b.cmp(&a))).unwrap_or(0)
}

/// log √(A₃/A₂) at each vertex: how much larger its faces are on the surface than on the unit disc (or, closed
/// surfaces, on the unit sphere).
fn log_scale(solver: &Solver, harmonic: &Harmonic, u: &[f64], s: &[i32], poles: &[u32]) -> Vec<f64> {
    let mesh = &solver.mesh;
    let closed = solver.topology == Topology::Sphere;
    let middle = if closed { 0.5 } else { 0.0 };
    let top = poles.last().copied().unwrap_or(NONE);
    let depth = |v: u32| match poles.contains(&v) {
        true if v == top => f64::NEG_INFINITY,
        true => f64::INFINITY,
        false => -std::f64::consts::TAU * (harmonic.v[v as usize] - middle) / harmonic.energy,
    };
    let mut areas = vec![[0.0f64; 2]; mesh.positions.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let depths = corners.map(depth);
        let flat = flat_area(corners, depths, u, &s[3 * t..3 * t + 3], poles, closed);
        let area = mesh.area(t);
        for &v in corners {
            areas[v as usize][0] += area;
            areas[v as usize][1] += flat.abs();
        }
    }
    areas.iter().map(|[a3, a2]| 0.5 * (a3.max(1e-300).ln() - a2.max(1e-300).ln())).collect()
}

/// Solves (M + tL)x = My with t = `time` × area.
fn smoothed(solver: &Solver, y: &[f64], time: f64) -> Result<Vec<f64>, SolveError> {
    let free = vec![false; y.len()];
    let weight = 1.0 / (time * solver.mesh.total_area());
    let factor = solver.laplacian.factor(&free, weight, |_| false)?;
    let mut x: Vec<f64> = y.iter().zip(&solver.laplacian.masses).map(|(y, m)| weight * m * y).collect();
    factor.solve(&mut x);
    Ok(x)
}

/// Area of a triangle in the unit disc, or on the unit sphere by stereographic projection.
fn flat_area(corners: &[u32; 3], depth: [f64; 3], u: &[f64], s: &[i32], poles: &[u32], closed: bool) -> f64 {
    let angles = angles_in_triangle(corners, u, s, poles);
    if closed {
        let on_sphere = |k: usize| {
            let d = depth[k];
            // |w| = e^d; z = (1 − |w|²)/(1 + |w|²), radius in the plane sech d.
            let (z, r) = (-d.tanh(), if d.is_finite() { 1.0 / d.cosh() } else { 0.0 });
            let (sin, cos) = angles[k].sin_cos();
            Vec3::new(r * cos, r * sin, z)
        };
        let (a, b, c) = (on_sphere(0), on_sphere(1), on_sphere(2));
        return 0.5 * (b - a).cross(&(c - a)).norm();
    }
    let w = [0, 1, 2].map(|k| {
        let (sin, cos) = angles[k].sin_cos();
        let r = depth[k].exp();
        [r * cos, r * sin]
    });
    0.5 * ((w[1][0] - w[0][0]) * (w[2][1] - w[0][1]) - (w[2][0] - w[0][0]) * (w[1][1] - w[0][1]))
}

/// Angles of a triangle's corners about the pole, continuous within it; a pole's is 0.
fn angles_in_triangle(corners: &[u32; 3], u: &[f64], s: &[i32], poles: &[u32]) -> [f64; 3] {
    let k0 = corners.iter().position(|v| !poles.contains(v)).unwrap_or(0);
    let mut angles = [0.0; 3];
    for step in 1..3 {
        let k = (k0 + step) % 3;
        if poles.contains(&corners[k]) {
            continue;
        }
        // The edge from k0 runs forward (step 1) or backward (step 2) along the triangle.
        let jump = if step == 1 { s[k0] } else { -s[k] };
        let turn = u[corners[k] as usize] - u[corners[k0] as usize] - f64::from(jump);
        angles[k] = std::f64::consts::TAU * turn;
    }
    angles
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
