//! Pole refinement: moving the input's pole until the registered energy is least.
//!
//! The pole found on each surface alone is good to some per cent of its size; how well two encodings register tells
//! it better. Pattern search: six directions on the surface at 12, 6, then 3 % of √area, each trial unfolded by a
//! Möbius transformation instead of a solve.
//! *Source:* METHOD §2 ("pole refinement"); *ours, not the paper's.*

use std::sync::Arc;

use super::entry::Hypothesis;
use super::query::{Query, SEARCH_SIDE, Unfolded};
use super::{Flip, Level, Registration, Solver, coarse_flip};
use crate::encode::Encoding;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::unfold::path::within;

/// Radii of the search, in √area. *Source:* METHOD §2.
const RADII: [f64; 3] = [0.12, 0.06, 0.03];
/// Radii of the search that weighs distortion: it starts near.
const RADII_BURDEN: [f64; 3] = [0.06, 0.03, 0.015];
/// Power of the distortion in its score.
const BURDEN_POWER: i32 = 4;
/// Directions tried at each radius.
const DIRECTIONS: usize = 6;
/// How near and how far, in radii, a trial may be.
const NEAREST: f64 = 0.5;
const FARTHEST: f64 = 1.5;
/// Rounds at one radius at most.
const ROUNDS_MAX: usize = 4;
/// Poles at which the coarsest level costs more than so many times what it does at the best so far are left at that: first by
/// translation alone, then with the features moved. *Ours:* three of five are, and of 72 moves that were taken, in 1,233
/// trials on 17 inputs, the largest were 1.44 and 1.76 (tests/records).
const HOPELESS: TrialCost = TrialCost { translated: 1.6, registered: 2.0 };
/// Nothing is.
const NEVER_HOPELESS: TrialCost = TrialCost { translated: f64::INFINITY, registered: f64::INFINITY };
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
    let search = Search::new(query, start, flip, example, solver, stop);
    search.descend(&start.unfolded.poles, &RADII, HOPELESS, &Hypothesis::cost).unwrap_or_else(|| start.clone())
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
    let search = Search::new(query, start, start.registration.flip, example, solver, stop);
    let score = |h: &Hypothesis| h.cost() * burden(h).powi(BURDEN_POWER);
    // A map may distort so much less that it costs more: none is hopeless.
    search.descend(&start.unfolded.poles, &RADII_BURDEN, NEVER_HOPELESS, &score).unwrap_or_else(|| start.clone())
}

/// The cost of a trial at the coarsest level, or how many times as much it may cost.
#[derive(Clone, Copy, Debug)]
struct TrialCost {
    /// By the best translation.
    translated: f64,
    /// With the features moved.
    registered: f64,
}

/// What every trial of a search has in common.
struct Search<'a> {
    query: &'a Query,
    flip: Flip,
    /// The example's levels up to the search's.
    levels: Vec<Level<'a>>,
    solver: &'a dyn Solver,
    stop: &'a dyn Fn() -> bool,
}

impl<'a> Search<'a> {
    fn new(
        query: &'a Query,
        start: &'a Hypothesis,
        flip: Flip,
        example: &'a Encoding,
        solver: &'a dyn Solver,
        stop: &'a dyn Fn() -> bool,
    ) -> Self {
        let images = start.unfolded.images.iter().filter(|image| image.side <= SEARCH_SIDE);
        let levels = images.filter_map(|image| Level::new(example, image)).collect();
        Self { query, flip, levels, solver, stop }
    }

    /// Registers with these poles; `None` if the coarsest level costs more than `most`. Told too is what it costs.
    fn attempt(&self, poles: &[u32], most: TrialCost) -> Option<(Hypothesis, TrialCost)> {
        let unfolded = self.query.tried(poles)?;
        let mut levels = self.levels.iter().zip(&unfolded.images);
        let (coarsest, image) = levels.next()?;
        let coarsest = coarsest.against(image)?;
        let translated = coarsest.translation_cost(self.flip);
        if translated > most.translated {
            return None;
        }
        let registration = coarse_flip(&coarsest, self.flip, self.solver, self.stop);
        let mut trial = Hypothesis { registration, unfolded: Arc::clone(&unfolded) };
        let coarse = TrialCost { translated, registered: trial.cost() };
        if coarse.registered > most.registered {
            return None;
        }
        for (level, image) in levels {
            trial.registration.advance(&level.against(image)?, self.solver, self.stop);
        }
        Some((trial, coarse))
    }

    /// Moves the poles about, at ever smaller radii (in √area), while the score falls. Trials that cost more than `hopeless`
    /// times what the best does at the coarsest level are given up there.
    fn descend(
        &self,
        start: &[u32],
        radii: &[f64],
        hopeless: TrialCost,
        score: &dyn Fn(&Hypothesis) -> f64,
    ) -> Option<Hypothesis> {
        let mesh = self.query.unfolder().mesh();
        let (surroundings, scale) = (VertexSurroundings::new(mesh), mesh.total_area().sqrt());
        let (mut best, mut coarse) = self.attempt(start, NEVER_HOPELESS)?;
        let mut least = score(&best);
        for radius in radii {
            for _ in 0..ROUNDS_MAX {
                let before = least;
                for which in 0..best.unfolded.poles.len() {
                    for neighbour in surroundings.around(best.unfolded.poles[which], radius * scale) {
                        if (self.stop)() {
                            return Some(best);
                        }
                        let mut poles = best.unfolded.poles.clone();
                        poles[which] = neighbour;
                        let most = TrialCost {
                            translated: hopeless.translated * coarse.translated,
                            registered: hopeless.registered * coarse.registered,
                        };
                        let Some((trial, cost)) = self.attempt(&poles, most) else { continue };
                        let scored = score(&trial);
                        if scored < least * (1.0 - GAIN_MIN) {
                            (best, least, coarse) = (trial, scored, cost);
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

/// The surface about its vertices, prepared once a search.
pub struct VertexSurroundings<'a> {
    mesh: &'a TriMesh,
    outgoing: Vec<u32>,
    on_boundary: Vec<bool>,
}

impl<'a> VertexSurroundings<'a> {
    /// Prepares a surface.
    pub fn new(mesh: &'a TriMesh) -> Self {
        Self { mesh, outgoing: mesh.outgoing(), on_boundary: mesh.boundary_vertices() }
    }

    /// Interior vertices at about `radius` from `centre` along edges, one in each of six directions where there is one.
    pub fn around(&self, centre: u32, radius: f64) -> Vec<u32> {
        let Self { mesh, on_boundary, .. } = self;
        let reached = within(mesh, &self.outgoing, centre, FARTHEST * radius);
        let is_near = |&(v, d): &(u32, f64)| d / radius >= NEAREST && !on_boundary[v as usize];
        let candidates: Vec<(u32, f64)> = reached.into_iter().filter(is_near).collect();
        let Some(&(first, _)) = candidates.first() else { return Vec::new() };
        let origin = mesh.positions[centre as usize];
        let mut normal = Vec3::zeros();
        for t in (0..mesh.triangles.len()).filter(|&t| mesh.triangles[t].contains(&centre)) {
            normal += mesh.area_vector(t);
        }
        let x = (mesh.positions[first as usize] - origin).normalize();
        let y = normal.cross(&x).normalize();
        // Of each: which way, as a point of the unit circle, and how much too near or far.
        let placed = candidates.iter().map(|&(v, distance)| {
            let d = mesh.positions[v as usize] - origin;
            let (dx, dy) = (d.dot(&x), d.dot(&y));
            let length = dx.hypot(dy).max(1e-300);
            (v, [dx / length, dy / length], (distance / radius - 1.0).abs())
        });
        let placed: Vec<(u32, [f64; 2], f64)> = placed.collect();
        let mut chosen: Vec<u32> = Vec::new();
        for k in 0..DIRECTIONS {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
            let misfit = |(_, way, off): &(u32, [f64; 2], f64)| 1.0 - (way[0] * cos + way[1] * sin) + off;
            let best = placed.iter().min_by(|&a, &b| misfit(a).total_cmp(&misfit(b)).then(a.0.cmp(&b.0)));
            if let Some(v) = best.map(|best| best.0).filter(|v| !chosen.contains(v)) {
                chosen.push(v);
            }
        }
        chosen
    }
}
