//! One example against one query, coarse to fine, over flips and rival poles.
//!
//! A mirrored flip must beat the best unmirrored one by a clear margin: bodies and heads are nearly their own mirror
//! image, and a coin toss costs 22 % of error (METHOD §5).

use std::sync::Arc;

use super::image::Image;
use super::query::{Query, SEARCH_SIDE, Unfolded};
use super::{Flip, Level, Registration, Solver, coarse_flip, next_side, pole_search};
use crate::encode::Encoding;
use crate::topology::Topology;
use crate::unfold::{UnfoldError, Uv};

/// A mirrored registration's cost is multiplied by this before it is compared with an unmirrored one.
pub const MIRROR_MARGIN: f64 = 1.25;
/// An example that matches its own mirror image at this cost or less is symmetric: mirrored and unmirrored maps fit it
/// alike, and the unmirrored one is meant.
pub const SYMMETRIC_COST: f64 = 0.15;
/// The same for tori, all of which are wide outside and narrow inside: most of a picture's variance says nothing.
const SYMMETRIC_COST_TORUS: f64 = 0.02;
/// From so many tips on, no single pole does, and seeking it is wasted: such surfaces get a chart a tip.
pub const PROTRUSIONS_MANY: usize = 3;
/// Hypotheses within this factor of the best go on from the coarsest level; from the next, only the best.
const KEPT_WITHIN: f64 = 1.6;
/// Hypotheses whose best translation is within this factor of the best one's have their features moved. *Ours, not the
/// paper's*, for time: a choice between the others and 1.6, by which they are compared afterwards; not tuned.
const TRANSLATED_WITHIN: f64 = 2.0;
/// Hypotheses that go on at most.
const KEPT_MAX: usize = 3;

/// A flip and poles of the query, with the registration they give.
#[derive(Clone, Debug)]
pub struct Hypothesis {
    /// The query unfolded with these poles.
    pub unfolded: Arc<Unfolded>,
    /// The registration against it.
    pub registration: Registration,
}

impl Hypothesis {
    /// E / (var √λ₁ + var √λ₂): 0 for a perfect match, about 1 for none.
    pub fn cost(&self) -> f64 {
        self.registration.energy / self.registration.variance.max(1e-300)
    }

    /// Cost with the mirror's handicap.
    fn handicapped(&self) -> f64 {
        self.cost() * if self.registration.flip.is_mirror() { MIRROR_MARGIN } else { 1.0 }
    }
}

/// The state of one example against one query.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The hypotheses still alive, best first; never empty.
    hypotheses: Vec<Hypothesis>,
    /// Whether the poles have been refined.
    poles_refined: bool,
}

fn symmetric_cost(topology: Topology) -> f64 {
    if topology == Topology::Torus { SYMMETRIC_COST_TORUS } else { SYMMETRIC_COST }
}

/// Whether an example is its own mirror image, as far as its coarsest picture tells; `cost` registers the example with
/// itself under a flip.
fn is_symmetric(example: &Encoding, cost: impl Fn(&Level, Flip) -> f64) -> bool {
    let Some(picture) = example.pyramid.first() else { return false };
    let own = Image::new(picture, Flip::default(), example.topology.is_periodic_v());
    let Some(level) = Level::new(example, &own) else { return false };
    let mut mirrors = Flip::all(example.topology).iter().filter(|f| f.is_mirror());
    mirrors.any(|&flip| cost(&level, flip) < symmetric_cost(example.topology))
}

/// Whether mirrored hypotheses are tried.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mirrored {
    Too,
    Never,
}

impl Entry {
    /// Registers at the coarsest level all of one with all of the other: every flip with every rival pole. `None` when the
    /// example has no such level or another topology.
    pub fn coarse(query: &Query, example: &Encoding, solver: &dyn Solver, stop: &dyn Fn() -> bool) -> Option<Self> {
        let candidates = if example.topology == query.encoding().topology { query.candidates() } else { &[] };
        Self::among(candidates, query, example, solver, stop)
    }

    /// The same with parts of the query too. `None` when the example has no such level, and where neither the query nor
    /// its parts are of its topology.
    pub fn coarse_with_parts(
        query: &Query,
        example: &Encoding,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Option<Self> {
        Self::among(&query.candidates_for(example.topology), query, example, solver, stop)
    }

    fn among(
        candidates: &[Arc<Unfolded>],
        query: &Query,
        example: &Encoding,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Option<Self> {
        let images = candidates.iter().map(|unfolded| unfolded.images.first());
        let images: Vec<&Image> = images.collect::<Option<_>>()?;
        let first = Level::new(example, images.first()?)?;
        let levels: Vec<Level> = images.into_iter().map(|image| first.against(image)).collect::<Option<_>>()?;
        // Moving features can only make it more so.
        let mirrored = if is_symmetric(example, |level, flip| level.translation_cost(flip)) {
            Mirrored::Never
        } else {
            Mirrored::Too
        };
        let flips = Flip::all(example.topology).iter().filter(|f| mirrored == Mirrored::Too || !f.is_mirror());
        let mut translated: Vec<(f64, usize, Flip)> = Vec::new();
        for &flip in flips {
            for (k, level) in levels.iter().enumerate() {
                let cost = level.translation_cost(flip) * if flip.is_mirror() { MIRROR_MARGIN } else { 1.0 };
                translated.push((cost, k, flip));
            }
        }
        let least = translated.iter().map(|t| t.0).fold(f64::INFINITY, f64::min);
        translated.retain(|t| t.0 <= least * TRANSLATED_WITHIN);
        let mut hypotheses = Vec::new();
        for (unfolded, (k, level)) in candidates.iter().zip(levels.iter().enumerate()) {
            for &(_, _, flip) in translated.iter().filter(|t| t.1 == k) {
                let registration = coarse_flip(level, flip, solver, stop);
                hypotheses.push(Hypothesis { unfolded: Arc::clone(unfolded), registration });
            }
        }
        let mut entry = Self { hypotheses, poles_refined: query.poles_given };
        entry.prune(KEPT_MAX);
        let bent = |level: &Level, flip: Flip| {
            let r = coarse_flip(level, flip, solver, stop);
            // Of a flat picture this is no number, and so it is not symmetric.
            r.energy / r.variance
        };
        if entry.hypotheses.iter().any(|h| h.registration.flip.is_mirror()) && is_symmetric(example, bent) {
            entry.drop_mirrors(candidates, example, solver, stop);
        }
        Some(entry)
    }

    /// Leaves only unmirrored hypotheses; where none survived, the best pole's is made again.
    fn drop_mirrors(
        &mut self,
        candidates: &[Arc<Unfolded>],
        example: &Encoding,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) {
        let plain: Vec<Hypothesis> =
            self.hypotheses.iter().filter(|h| !h.registration.flip.is_mirror()).cloned().collect();
        if !plain.is_empty() {
            self.hypotheses = plain;
            return;
        }
        let mut made = Vec::new();
        for unfolded in candidates {
            let Some(level) = unfolded.images.first().and_then(|image| Level::new(example, image)) else { continue };
            for &flip in Flip::all(example.topology).iter().filter(|f| !f.is_mirror()) {
                let registration = coarse_flip(&level, flip, solver, stop);
                made.push(Hypothesis { unfolded: Arc::clone(unfolded), registration });
            }
        }
        if !made.is_empty() {
            self.hypotheses = made;
            self.prune(KEPT_MAX);
        }
    }

    /// The state of an example that was laid otherwise than by a registration: its points `p` go to the places `q` of the
    /// query's own chart.
    pub fn laid(query: &Query, flip: Flip, side: usize, p: Vec<Uv>, q: Vec<Uv>) -> Option<Self> {
        let unfolded = query.candidates().first()?;
        let registration = Registration { side, energy: 0.0, ..Registration::from_controls(flip, p, q) };
        let hypotheses = vec![Hypothesis { unfolded: Arc::clone(unfolded), registration }];
        Some(Self { hypotheses, poles_refined: true })
    }

    /// The best hypothesis.
    pub fn best(&self) -> &Hypothesis {
        &self.hypotheses[0]
    }

    /// Level reached, in pixels a side.
    pub fn side(&self) -> usize {
        self.best().registration.side
    }

    /// Whether the poles have been refined (or need not be).
    pub fn poles_refined(&self) -> bool {
        self.poles_refined
    }

    /// Advances to the next level, if both sides have it.
    ///
    /// # Errors
    /// [`UnfoldError`] when the query cannot be unfolded for a rival's poles.
    pub fn advance(
        &mut self,
        query: &Query,
        example: &Encoding,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Result<(), UnfoldError> {
        let Some(side) = next_side(self.side()) else { return Ok(()) };
        if side > SEARCH_SIDE {
            self.prune(1);
        }
        for hypothesis in &mut self.hypotheses {
            if hypothesis.unfolded.image(side).is_none() {
                hypothesis.unfolded = query.refined(&hypothesis.unfolded, side)?;
            }
        }
        let with_it = self.hypotheses.iter().map(|h| &h.unfolded).find(|unfolded| unfolded.image(side).is_some());
        let with_it = with_it.cloned();
        let image = with_it.as_ref().and_then(|unfolded| unfolded.image(side));
        let Some(shared) = image.and_then(|image| Level::new(example, image)) else { return Ok(()) };
        for hypothesis in &mut self.hypotheses {
            let Some(level) = hypothesis.unfolded.image(side).and_then(|image| shared.against(image)) else { continue };
            hypothesis.registration.advance(&level, solver, stop);
        }
        self.prune(KEPT_MAX);
        Ok(())
    }

    /// Refines the query's poles for this example and registers anew up to the level reached so far.
    ///
    /// # Errors
    /// [`UnfoldError`] when the query cannot be unfolded for the poles found.
    pub fn refine_poles(
        &mut self,
        query: &Query,
        example: &Encoding,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Result<(), UnfoldError> {
        let is_done = std::mem::replace(&mut self.poles_refined, true) || !self.best().unfolded.is_whole();
        if is_done || query.protrusions().len() >= PROTRUSIONS_MANY {
            return Ok(());
        }
        let side = self.side();
        let flip = self.best().registration.flip;
        let mut rivals = vec![pole_search::refine(query, self.best(), flip, example, solver, stop)];
        if flip.is_mirror() {
            // A mirror may win by its pole alone: it has to win against the best unmirrored pole.
            let plain = Flip { u: false, v: flip.v && flip.u };
            rivals.push(pole_search::refine(query, self.best(), plain, example, solver, stop));
        }
        rivals.sort_by(|a, b| a.handicapped().total_cmp(&b.handicapped()));
        rivals.truncate(1);
        for rival in &mut rivals {
            if stop() {
                return Ok(());
            }
            rival.unfolded = query.unfolded_to(&rival.unfolded.poles, side)?;
            rival.registration =
                pole_search::register(&rival.unfolded, example, rival.registration.flip, side, solver, stop)
                    .unwrap_or_else(|| rival.registration.clone());
        }
        // A finer level may take back what the search's level promised.
        if rivals.first().is_some_and(|r| r.handicapped() < self.best().handicapped()) {
            self.hypotheses = rivals;
        }
        Ok(())
    }

    /// Refines the query's poles once more, now for a map that distorts less, and registers anew up to the level reached.
    /// `burden` measures the map of a hypothesis. Poles that the user gave stay.
    ///
    /// # Errors
    /// [`UnfoldError`] when the query cannot be unfolded for the poles found.
    pub fn unburden_poles(
        &mut self,
        query: &Query,
        example: &Encoding,
        solver: &dyn Solver,
        burden: &dyn Fn(&Hypothesis) -> f64,
        stop: &dyn Fn() -> bool,
    ) -> Result<(), UnfoldError> {
        let best = &self.best().unfolded;
        if query.poles_given || best.poles.is_empty() || !best.is_whole() {
            return Ok(());
        }
        let (side, start) = (self.side(), self.best());
        let mut found = pole_search::unburden(query, start, example, solver, burden, stop);
        if stop() || found.unfolded.poles == start.unfolded.poles {
            return Ok(());
        }
        found.unfolded = query.unfolded_to(&found.unfolded.poles, side)?;
        let flip = found.registration.flip;
        if let Some(registration) = pole_search::register(&found.unfolded, example, flip, side, solver, stop) {
            found.registration = registration;
            self.hypotheses = vec![found];
        }
        Ok(())
    }

    fn prune(&mut self, most: usize) {
        // Stable: of equals the earlier pole and flip stays first.
        self.hypotheses.sort_by(|a, b| a.handicapped().total_cmp(&b.handicapped()));
        let limit = self.best().handicapped() * KEPT_WITHIN;
        self.hypotheses.retain(|h| h.handicapped() <= limit);
        self.hypotheses.truncate(most);
    }
}
