//! Pole refinement: moving the input's pole until the registered energy is least.
//!
//! The pole found on each surface alone is good to some per cent of its size; how well two encodings register tells
//! it better. Pattern search: six directions on the surface at 12, 6, then 3 % of √area, each trial unfolded by a
//! Möbius transformation instead of a solve.
//! *Source:* METHOD §2 ("pole refinement"); *ours, not the paper's.*

use super::entry::Hypothesis;
use super::query::{Query, SEARCH_SIDE, Unfolded};
use super::{Flip, Level, Registration, Solver, coarse_flip};
use crate::encode::Encoding;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::unfold::path::distances;

/// Radii of the search, in √area. *Source:* METHOD §2.
const RADII: [f64; 3] = [0.12, 0.06, 0.03];
/// Radii of the search that weighs distortion: it starts near.
const RADII_BURDEN: [f64; 3] = [0.06, 0.03, 0.015];
/// Power of the distortion in its score.
const BURDEN_POWER: i32 = 4;
/// Directions tried at each radius.
const DIRECTIONS: usize = 6;
/// Rounds at one radius at most.
const ROUNDS_MAX: usize = 4;
/// A move must lower the cost by this share.
const GAIN_MIN: f64 = 0.005;

/// Registers one flip against one unfolding, from the coarsest level to `side`.
pub fn register(
    unfolded: &Unfolded,
    example: &Encoding,
    flip: Flip,
    side: usize,
    solver: &dyn Solver,
    stop: &dyn Fn() -> bool,
) -> Option<Registration> {
    let mut registration: Option<Registration> = None;
    for image in unfolded.images.iter().filter(|i| i.side <= side) {
        let level = Level::new(example, image)?;
        match &mut registration {
            None => registration = Some(coarse_flip(&level, flip, solver, stop)),
            Some(r) => r.advance(&level, solver, stop),
        }
    }
    registration
}

/// Searches from `start` for poles at which `flip` registers better. Stops early, with the best so far, when told to.
pub fn refine(
    query: &Query,
    start: &Hypothesis,
    flip: Flip,
    example: &Encoding,
    solver: &dyn Solver,
    stop: &dyn Fn() -> bool,
) -> Hypothesis {
    let search = Search { query, flip, example, solver, stop };
    search.descend(&start.unfolded.poles, &RADII, &Hypothesis::cost).unwrap_or_else(|| start.clone())
}

/// Searches again from `start`, now for poles at which the map distorts less as well: where a picture is plain about
/// the pole (a bald head), its energy says little about where the pole belongs. `burden` measures the map of a
/// hypothesis.
pub fn unburden(
    query: &Query,
    start: &Hypothesis,
    example: &Encoding,
    solver: &dyn Solver,
    burden: &dyn Fn(&Hypothesis) -> f64,
    stop: &dyn Fn() -> bool,
) -> Hypothesis {
    let search = Search { query, flip: start.registration.flip, example, solver, stop };
    let score = |h: &Hypothesis| h.cost() * burden(h).powi(BURDEN_POWER);
    search.descend(&start.unfolded.poles, &RADII_BURDEN, &score).unwrap_or_else(|| start.clone())
}

/// What every trial of a search has in common.
struct Search<'a> {
    query: &'a Query,
    flip: Flip,
    example: &'a Encoding,
    solver: &'a dyn Solver,
    stop: &'a dyn Fn() -> bool,
}

impl Search<'_> {
    fn attempt(&self, poles: &[u32]) -> Option<Hypothesis> {
        let unfolded = self.query.tried(poles)?;
        let registration = register(&unfolded, self.example, self.flip, SEARCH_SIDE, self.solver, self.stop)?;
        Some(Hypothesis { unfolded, registration })
    }

    /// Moves the poles about, at ever smaller radii (in √area), while the score falls.
    fn descend(&self, start: &[u32], radii: &[f64], score: &dyn Fn(&Hypothesis) -> f64) -> Option<Hypothesis> {
        let mesh = self.query.unfolder().mesh();
        let scale = mesh.total_area().sqrt();
        let mut best = self.attempt(start)?;
        let mut least = score(&best);
        for radius in radii {
            for _ in 0..ROUNDS_MAX {
                let before = least;
                for which in 0..best.unfolded.poles.len() {
                    for neighbour in around(mesh, best.unfolded.poles[which], radius * scale) {
                        if (self.stop)() {
                            return Some(best);
                        }
                        let mut poles = best.unfolded.poles.clone();
                        poles[which] = neighbour;
                        let Some(trial) = self.attempt(&poles) else { continue };
                        let scored = score(&trial);
                        if scored < least * (1.0 - GAIN_MIN) {
                            (best, least) = (trial, scored);
                        }
                    }
                }
                if least >= before {
                    break;
                }
            }
        }
        Some(best)
    }
}

/// Interior vertices at about `radius` from `centre` along edges, one in each of six directions where there is one.
fn around(mesh: &TriMesh, centre: u32, radius: f64) -> Vec<u32> {
    let (distance, _) = distances(mesh, &[centre]);
    let on_boundary = mesh.boundary_vertices();
    let origin = mesh.positions[centre as usize];
    let near = |v: u32| (0.5..=1.5).contains(&(distance[v as usize] / radius)) && !on_boundary[v as usize];
    let candidates: Vec<u32> = (0..distance.len() as u32).filter(|&v| near(v)).collect();
    let Some(&first) = candidates.first() else { return Vec::new() };
    let mut normal = Vec3::zeros();
    for t in mesh.triangles.iter().filter(|t| t.contains(&centre)) {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        normal += (b - a).cross(&(c - a));
    }
    let x = (mesh.positions[first as usize] - origin).normalize();
    let y = normal.cross(&x).normalize();
    let mut chosen: Vec<u32> = Vec::new();
    for k in 0..DIRECTIONS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
        let misfit = |v: u32| {
            let d = mesh.positions[v as usize] - origin;
            let (dx, dy) = (d.dot(&x), d.dot(&y));
            let angle = 1.0 - (dx * cos + dy * sin) / dx.hypot(dy).max(1e-300);
            angle + (distance[v as usize] / radius - 1.0).abs()
        };
        let best = candidates.iter().copied().min_by(|&a, &b| misfit(a).total_cmp(&misfit(b)).then(a.cmp(&b)));
        if let Some(v) = best.filter(|v| !chosen.contains(v)) {
            chosen.push(v);
        }
    }
    chosen
}
