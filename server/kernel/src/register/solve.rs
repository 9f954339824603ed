//! Minimising the registration energy over where the controls go.
//!
//! Two solvers behind one trait: Levenberg–Marquardt on the analytic Jacobian, and the paper's pixel descent, kept as
//! the reference. *Source:* paper §5.2 (descent); METHOD §5 (Levenberg–Marquardt, its constants).

use super::problem::{Pixels, Problem};
use crate::encode::features::distance;
use crate::numerics::dense::solve_spd;
use crate::topology::Topology;
use crate::unfold::Uv;

/// Iterations a level. *Source:* paper §7.
pub const ITERATIONS_MAX: usize = 10;
/// Relative decrease below which a level is done.
const DECREASE_MIN: f64 = 1e-4;
/// Damping at the start, its factor on success (divide) and failure (multiply), and where it gives up.
const DAMPING: f64 = 1e-2;
const DAMPING_FACTOR: f64 = 5.0;
const DAMPING_MAX: f64 = 1e4;
/// Longest step of a control, in pixels: at the coarsest level, and above.
const STEP_MAX_COARSE_PX: f64 = 2.0;
const STEP_MAX_PX: f64 = 4.0;

/// Why a solver stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Termination {
    /// The energy no longer decreases.
    Converged,
    /// The iterations are spent.
    IterationLimit,
    /// Whoever asked has gone.
    Stopped,
}

/// A minimiser of the registration energy.
pub trait Solver: Sync {
    /// Moves `q` to lower E; polls `stop` once an iteration. Returns E and why it stopped.
    fn solve(&self, problem: &Problem, q: &mut Vec<Uv>, stop: &dyn Fn() -> bool) -> (f64, Termination);
}

/// Levenberg–Marquardt with a prior that holds the controls' displacements together.
#[derive(Clone, Copy, Debug)]
pub struct LevenbergMarquardt {
    /// Weight of the prior, in units of var(√λ₁) / number of controls.
    pub prior: f64,
}

impl Default for LevenbergMarquardt {
    fn default() -> Self {
        Self { prior: 1.0 }
    }
}

impl Solver for LevenbergMarquardt {
    fn solve(&self, problem: &Problem, q: &mut Vec<Uv>, stop: &dyn Fn() -> bool) -> (f64, Termination) {
        let alpha = self.prior * problem.example.variance / problem.p().len() as f64;
        let step_px = if problem.example.side <= 32 { STEP_MAX_COARSE_PX } else { STEP_MAX_PX };
        let step_max = step_px / problem.example.side as f64;
        let mut damping = DAMPING;
        let mut pixels = problem.pixels(q);
        let mut normal = problem.normal(q, &pixels);
        let mut total = pixels.energy + prior_energy(alpha, problem.p(), q);
        let mut iterations = 0;
        while iterations < ITERATIONS_MAX {
            if stop() {
                return (pixels.energy, Termination::Stopped);
            }
            iterations += 1;
            let Some(step) = damped_step(&normal.matrix, &normal.gradient, alpha, damping, problem.p(), q) else {
                damping *= DAMPING_FACTOR;
                continue;
            };
            let trial = stepped(problem.nodes.domain.topology, q, &step, step_max);
            let seen = problem.unfolded_pixels(&trial);
            let totals = |seen: Pixels| (seen.energy + prior_energy(alpha, problem.p(), &trial), seen);
            let better = seen.map(totals).filter(|(trial_total, _)| *trial_total < total);
            if let Some((trial_total, seen)) = better {
                let decrease = (total - trial_total) / total.max(1e-300);
                (*q, total, pixels) = (trial, trial_total, seen);
                damping /= DAMPING_FACTOR;
                if decrease < DECREASE_MIN {
                    return (pixels.energy, Termination::Converged);
                }
                if iterations < ITERATIONS_MAX {
                    normal = problem.normal(q, &pixels);
                }
            } else {
                damping *= DAMPING_FACTOR;
                if damping > DAMPING_MAX {
                    return (pixels.energy, Termination::Converged);
                }
            }
        }
        (pixels.energy, Termination::IterationLimit)
    }
}

/// α·Σ|d_i − mean d|², d = q − p.
fn prior_energy(alpha: f64, p: &[Uv], q: &[Uv]) -> f64 {
    deviations(p, q).iter().map(|d| alpha * (d[0] * d[0] + d[1] * d[1])).sum()
}

fn deviations(p: &[Uv], q: &[Uv]) -> Vec<Uv> {
    let n = p.len() as f64;
    let d: Vec<Uv> = p.iter().zip(q).map(|(p, q)| [q[0] - p[0], q[1] - p[1]]).collect();
    let mean = [0, 1].map(|k| d.iter().map(|d| d[k]).sum::<f64>() / n);
    d.iter().map(|d| [d[0] - mean[0], d[1] - mean[1]]).collect()
}

fn damped_step(matrix: &[f64], gradient: &[f64], alpha: f64, damping: f64, p: &[Uv], q: &[Uv]) -> Option<Vec<f64>> {
    let n = gradient.len();
    let m = p.len() as f64;
    let mut a = matrix.to_vec();
    for i in 0..n {
        for j in (i % 2..n).step_by(2) {
            a[i * n + j] += alpha * (f64::from(u8::from(i == j)) - 1.0 / m);
        }
    }
    let trace = (0..n).map(|i| a[i * n + i]).sum::<f64>() / n as f64;
    for i in 0..n {
        a[i * n + i] += damping * a[i * n + i] + 1e-9 * trace;
    }
    let d = deviations(p, q);
    let right: Vec<f64> = (0..n).map(|i| -gradient[i] - alpha * d[i / 2][i % 2]).collect();
    solve_spd(&a, &right, n)
}

/// `q` moved by `step`, no control further than `step_max`, none out of the domain.
fn stepped(topology: Topology, q: &[Uv], step: &[f64], step_max: f64) -> Vec<Uv> {
    let (low, high) = v_range(topology);
    let mut moved = Vec::with_capacity(q.len());
    for (q, s) in q.iter().zip(step.chunks_exact(2)) {
        let length = s[0].hypot(s[1]);
        let scale = if length > step_max { step_max / length } else { 1.0 };
        moved.push([q[0] + scale * s[0], (q[1] + scale * s[1]).clamp(low, high)]);
    }
    moved
}

/// Where v may lie: tori have no end.
fn v_range(topology: Topology) -> (f64, f64) {
    if topology.is_periodic_v() { (f64::NEG_INFINITY, f64::INFINITY) } else { (0.0, 1.0) }
}

/// The paper's descent: each control moves to the neighbouring pixel that its negative gradient points to, until E
/// stops decreasing; controls at a fold roll back and stay.
#[derive(Clone, Copy, Debug, Default)]
pub struct PixelDescent;

impl Solver for PixelDescent {
    fn solve(&self, problem: &Problem, q: &mut Vec<Uv>, stop: &dyn Fn() -> bool) -> (f64, Termination) {
        let pixel = 1.0 / problem.example.side as f64;
        let (low, high) = v_range(problem.nodes.domain.topology);
        let mut locked = vec![false; q.len()];
        let mut energy = problem.energy(q);
        for _ in 0..ITERATIONS_MAX {
            if stop() {
                return (energy, Termination::Stopped);
            }
            let gradient = problem.normal(q, &problem.pixels(q)).gradient;
            let mut trial = q.clone();
            for (i, to) in trial.iter_mut().enumerate().filter(|(i, _)| !locked[*i]) {
                let g = [gradient[2 * i], gradient[2 * i + 1]];
                let size = g[0].hypot(g[1]);
                if size > 0.0 {
                    // The neighbour pixel in direction −g: each component rounded to −1, 0 or 1 pixels.
                    to[0] -= (g[0] / size).round() * pixel;
                    to[1] = (to[1] - (g[1] / size).round() * pixel).clamp(low, high);
                }
            }
            roll_back_folds(problem, q, &mut trial, &mut locked);
            let trial_energy = problem.energy(&trial);
            if trial_energy >= energy {
                return (energy, Termination::Converged);
            }
            (*q, energy) = (trial, trial_energy);
        }
        (energy, Termination::IterationLimit)
    }
}

/// Leaves the controls where they are: only translations and flips remain.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rigid;

impl Solver for Rigid {
    fn solve(&self, problem: &Problem, q: &mut Vec<Uv>, _: &dyn Fn() -> bool) -> (f64, Termination) {
        (problem.energy(q), Termination::Converged)
    }
}

fn roll_back_folds(problem: &Problem, q: &[Uv], trial: &mut [Uv], locked: &mut [bool]) {
    for _ in 0..q.len() {
        let folds = problem.folded_cells(trial);
        let Some(fold) = folds.first() else { return };
        let free = (0..q.len()).filter(|&i| !locked[i]);
        let Some(i) = free.min_by(|&a, &b| distance(problem.p()[a], *fold).total_cmp(&distance(problem.p()[b], *fold)))
        else {
            return;
        };
        trial[i] = q[i];
        locked[i] = true;
    }
}
