//! Where to put the poles.
//!
//! Disc: the maximum of the *smoothed conformal radius*. From any first pole, w = exp(2πi·u − 2πv/P) maps the disc
//! conformally to the unit disc; R = √(A₃/A₂)·(1 − |w|²) does not depend on that first pole. log √(A₃/A₂) is
//! smoothed by (M + tL)x = My, log(1 − |w|²) is added exactly.
//! Sphere: the ends of the intrinsic diameter (longest shortest edge path, by repeated sweeps).
//! *Source:* paper §4.2 ("maximum of the conformal factor induced by a singularity-free parameterization");
//! *ours:* the smoothing and the Möbius invariance (METHOD §2).

use super::harmonic::{Harmonic, HarmonicSolver};
use super::laplacian::Laplacian;
use super::path::{distances, for_each_spoke};
use crate::mesh::tri::{NONE, TriMesh, next};
use crate::numerics::{Factored, SolveError};
use crate::topology::Topology;

/// Smoothing time in units of the area: features smaller than 15 % of √area do not move the pole.
const SMOOTHING: f64 = 0.15 * 0.15;
/// Smoothing times for tips: a hand's finger or an animal's leg is some 7 % of √area wide, a whole body's finger 2 %.
const LIMB_SMOOTHING: f64 = 0.04 * 0.04;
const FINGER_SMOOTHING: f64 = 0.025 * 0.025;
/// Rise of log √(A₃/A₂) that makes a tip: a tube half as long as its circumference.
const PROMINENCE: f64 = 1.5;
/// 1 − |w|² below which log √(A₃/A₂) and log (1 − |w|²) are added before the smoothing: behind the necks of a ragged
/// boundary each of them grows without bounds, and only their sum does not.
const GAP_MIN: f64 = 0.03;
/// Tips kept at most.
const TIPS_MAX: usize = 16;
/// Poles offered at most: the best and its rivals (two ears are a real tie).
const CANDIDATES_MAX: usize = 3;
/// A rival must reach this much of the best conformal radius.
const RIVAL_RADIUS: f64 = 0.75;
/// Sweeps towards the intrinsic diameter of a closed surface.
const DIAMETER_SWEEPS: usize = 4;

/// How broad the protrusions are whose tips are sought. Finer smoothing finds more of them, but not as surely: the top
/// of a head moves to an ear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Breadth {
    /// Legs, and the fingers of a hand.
    Limbs,
    /// The fingers of a body too.
    Fingers,
}

/// Poles of a disc, best first; at least one. `smoother`: the one for poles, where it was made already.
///
/// # Errors
/// [`SolveError`] when a system cannot be factored.
pub fn disc_candidates(solver: &HarmonicSolver, smoother: Option<Smoother>) -> Result<Vec<u32>, SolveError> {
    let first = torsion_centre(solver)?;
    let harmonic = solver.v(&[first])?;
    let raw = log_scale(solver, &harmonic, &[first]);
    let smoother = match smoother {
        Some(smoother) => smoother,
        None => {
            solver.make_room();
            Smoother::for_poles(&solver.laplacian)?
        }
    };
    let smooth = smoother.smooth(&solver.laplacian, &raw);
    let tau = std::f64::consts::TAU;
    let log_radius = |v: usize| {
        let inside = if v as u32 == first { 1.0 } else { gap(tau * harmonic.v[v] / harmonic.energy) };
        if solver.on_boundary[v] { f64::NEG_INFINITY } else { smooth[v] + inside.max(GAP_MIN).ln() }
    };
    let radius: Vec<f64> = (0..raw.len()).map(log_radius).collect();
    let found = local_maxima(solver, &radius);
    // On a ribbon the scale falls by so much that no vertex stands out.
    Ok(if found.is_empty() { vec![first] } else { found })
}

/// Tips of protrusions (fingers, limbs): maxima of the smoothed log √(A₃/A₂) that rise by [`PROMINENCE`] over the
/// saddle to a higher one, highest first. Along a tube of circumference c it grows by 2π/c a unit of length.
///
/// # Errors
/// [`SolveError`] when a system cannot be factored.
pub fn protrusions(solver: &HarmonicSolver, poles: &[u32], breadth: Breadth) -> Result<Vec<u32>, SolveError> {
    let time = match breadth {
        Breadth::Limbs => LIMB_SMOOTHING,
        Breadth::Fingers => FINGER_SMOOTHING,
    };
    let harmonic = solver.v(poles)?;
    let raw = log_scale(solver, &harmonic, poles);
    solver.make_room();
    let smooth = Smoother::new(&solver.laplacian, time)?.smooth(&solver.laplacian, &raw);
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
fn torsion_centre(solver: &HarmonicSolver) -> Result<u32, SolveError> {
    let x = solver.poisson(solver.laplacian.masses.clone())?;
    let inside = (0..x.len() as u32).filter(|&v| !solver.on_boundary[v as usize]);
    Ok(inside.max_by(|&a, &b| x[a as usize].total_cmp(&x[b as usize]).then(b.cmp(&a))).unwrap_or(0))
}

/// log √(A₃/A₂) at each vertex: how much larger its faces are on the surface than on the unit disc (or, closed
/// surfaces, on the unit sphere). log w is conformal with |∇ log w| = 2π|∇v|/P, so that v alone tells both areas. Where
/// 1 − |w|² is below [`GAP_MIN`], √(A₃/A₂) is taken down as far as that is.
fn log_scale(solver: &HarmonicSolver, harmonic: &Harmonic, poles: &[u32]) -> Vec<f64> {
    let t = &solver.laplacian.triangulation;
    let closed = solver.topology == Topology::Sphere;
    let rate = std::f64::consts::TAU / harmonic.energy;
    let depth = |v: u32| rate * (harmonic.v[v as usize] - if closed { 0.5 } else { 0.0 });
    let around = angles_at(solver, poles);
    let mut areas = vec![[0.0f64; 2]; harmonic.v.len()];
    for f in 0..t.tails.len() / 3 {
        let corners = [0, 1, 2].map(|k| t.tails[3 * f + k]);
        let flat = match (0..3).find(|&k| poles.contains(&corners[k])) {
            Some(k) => {
                // In plane polar coordinates about the pole, where v has a logarithm.
                let turn = std::f64::consts::TAU * angle(solver, 3 * f + k) / around(corners[k]);
                let radius = |v: u32| from_pole(depth(v).abs(), closed);
                0.5 * radius(corners[(k + 1) % 3]) * radius(corners[(k + 2) % 3]) * turn.sin().abs()
            }
            None => {
                let middle = corners.map(depth).iter().sum::<f64>() / 3.0;
                let near_rim = if closed { 1.0 } else { (GAP_MIN / gap(middle).max(f64::MIN_POSITIVE)).max(1.0) };
                let stretch = rate * at_depth(middle, closed) * near_rim;
                stretch * stretch * solver.laplacian.energy_within(f, &harmonic.v)
            }
        };
        // A triangle between three boundary vertices (flips make such) tells nothing: v is 0 on it.
        if flat > 0.0 {
            let area = t.area(f);
            for v in corners {
                areas[v as usize][0] += area;
                areas[v as usize][1] += flat;
            }
        }
    }
    let scale = |[a3, a2]: &[f64; 2]| (*a2 > 0.0).then(|| 0.5 * (a3.ln() - a2.ln()));
    filled_in(solver, areas.iter().map(scale).collect())
}

/// The values, each that is missing replaced by the mean of its neighbours', or of all.
fn filled_in(solver: &HarmonicSolver, values: Vec<Option<f64>>) -> Vec<f64> {
    let t = &solver.laplacian.triangulation;
    let mut around = vec![[0.0f64; 2]; values.len()];
    for h in 0..t.tails.len() {
        let (a, b) = (t.tails[h] as usize, t.head(h as u32) as usize);
        for (from, to) in [(a, b), (b, a)] {
            if let (Some(x), None) = (values[from], values[to]) {
                around[to] = [around[to][0] + x, around[to][1] + 1.0];
            }
        }
    }
    let (sum, count) = values.iter().flatten().fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    let mean = |[sum, count]: [f64; 2]| (count > 0.0).then(|| sum / count);
    let overall = mean([sum, count]).unwrap_or(0.0);
    values.iter().zip(around).map(|(x, around)| x.or(mean(around)).unwrap_or(overall)).collect()
}

/// Angle of a corner of the intrinsic triangulation, in radians.
fn angle(solver: &HarmonicSolver, corner: usize) -> f64 {
    let opposite = next(corner as u32);
    1.0f64.atan2(solver.laplacian.triangulation.cotangent(opposite))
}

/// The sum of the angles about each pole.
fn angles_at<'a>(solver: &HarmonicSolver, poles: &'a [u32]) -> impl Fn(u32) -> f64 + 'a {
    let tails = &solver.laplacian.triangulation.tails;
    let about = |p: u32| (0..tails.len()).filter(|&c| tails[c] == p).map(|c| angle(solver, c)).sum::<f64>();
    let sums: Vec<f64> = poles.iter().map(|&p| about(p)).collect();
    move |p| poles.iter().position(|&q| q == p).map_or(1.0, |k| sums[k])
}

/// 1 − |w|² at a depth.
fn gap(depth: f64) -> f64 {
    -(-2.0 * depth).exp_m1()
}

/// Length on the disc (sphere) a length of log w, at depth −log |w|.
fn at_depth(depth: f64, closed: bool) -> f64 {
    if closed { 1.0 / depth.cosh() } else { (-depth).exp() }
}

/// Distance (sphere: chord) from the pole to a point at `depth` = |log |w||.
fn from_pole(depth: f64, closed: bool) -> f64 {
    if closed { 2.0 / ((2.0 * depth).exp() + 1.0).sqrt() } else { (-depth).exp() }
}

/// (M + tL)x = My, factored.
#[derive(Debug)]
pub struct Smoother {
    factor: Factored,
    /// 1/t.
    weight: f64,
}

impl Smoother {
    /// For the poles of a disc.
    ///
    /// # Errors
    /// [`SolveError`] when the system cannot be factored.
    pub fn for_poles(laplacian: &Laplacian) -> Result<Self, SolveError> {
        Self::new(laplacian, SMOOTHING)
    }

    /// With t = `time` × the surface's area.
    fn new(laplacian: &Laplacian, time: f64) -> Result<Self, SolveError> {
        let weight = 1.0 / (time * laplacian.masses.iter().sum::<f64>());
        let free = vec![false; laplacian.masses.len()];
        Ok(Self { factor: laplacian.factor(&free, weight, |_| false)?, weight })
    }

    fn smooth(&self, laplacian: &Laplacian, y: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = y.iter().zip(&laplacian.masses).map(|(y, m)| self.weight * m * y).collect();
        self.factor.solve(&mut x);
        x
    }
}

/// The highest local maxima, best first.
fn local_maxima(solver: &HarmonicSolver, value: &[f64]) -> Vec<u32> {
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
pub fn sphere_poles(solver: &HarmonicSolver) -> [u32; 2] {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;
    use std::sync::Arc;

    #[test]
    fn a_triangle_between_three_boundary_vertices_is_not_infinitely_large() {
        // Two corners of a grid are such triangles: v is 0 on them.
        let (solver, _) =
            HarmonicSolver::beside(Arc::new(grid(12, 12, false, false)), Topology::Disc, |_| ()).expect("solvable");
        let middle = 13 * 6 + 6;
        let scale = log_scale(&solver, &solver.v(&[middle]).expect("solvable"), &[middle]);
        assert!(scale.iter().all(|x| x.abs() < 20.0), "{scale:?}");
    }
}
