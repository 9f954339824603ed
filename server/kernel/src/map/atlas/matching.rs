//! Which tips belong together, and whether the map mirrors.
//!
//! Distances along the surfaces leave a few matches ([`super::assignment`]), a match and its mirror image among them.
//! Each is laid into a pair of charts with poles at two of its pairs: there tips must come to lie on tips by a mere
//! rotation, and the pictures must register from there. *Ours, not the paper's.*

use std::sync::Arc;

use super::assignment::{Assignment, Assignments};
use super::unwrap_shifts;
use crate::encode::features::distance;
use crate::register::entry::MIRROR_MARGIN;
use crate::register::solve::Rigid;
use crate::register::tips::{MATCH_SIDE, TipView, Tips};
use crate::register::{Flip, Level, Query, Registration, Solver, query_images};
use crate::topology::Topology;
use crate::unfold::Uv;
use crate::unfold::pole::Breadth;

/// Mean difference of u that costs as much as a distortion of [`DISTORTION`].
const TWIST: f64 = 0.06;
/// The best of those that are looked at in several charts, how much worse than the best they may be, and charts each.
const FINALISTS_MAX: usize = 6;
const FINALISTS_WITHIN: f64 = 3.0;
const CHARTS_LOOKED_AT: usize = 4;
/// Mean distance in the domain between matched tips that doubles a match's cost.
const TIP_DISTANCE: f64 = 0.06;
/// A surface that matches its own mirror image at this cost or less is symmetric. Bodies in symmetric poses have .05–.16,
/// hands .27–.40.
const SYMMETRIC_MATCH: f64 = 0.2;
/// Distortion that doubles a match's cost.
const DISTORTION: f64 = 0.1;

/// A way to match the tips.
#[derive(Debug)]
pub(super) struct Match {
    /// Pairs of tips, by their numbers.
    pub(super) assignment: Assignment,
    pub(super) flip: Flip,
    pub(super) cost: f64,
}

/// Names one of the two surfaces.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum WhichSurface {
    Example,
    Query,
}

/// Matches tips by their distances and by registering charts with poles at them.
pub(super) struct Matcher<'a> {
    example: &'a Query,
    query: &'a Query,
    solver: &'a dyn Solver,
    stop: &'a dyn Fn() -> bool,
    /// The tips of each surface.
    tips: [Arc<Tips>; 2],
}

impl<'a> Matcher<'a> {
    pub(super) fn new(
        example: &'a Query,
        query: &'a Query,
        breadth: Breadth,
        solver: &'a dyn Solver,
        stop: &'a dyn Fn() -> bool,
    ) -> Self {
        Self { example, query, solver, stop, tips: [example, query].map(|side| side.matched_by(breadth)) }
    }

    /// The best match. A mirrored one has to beat the best unmirrored one, on surfaces neither of which is its own mirror
    /// image: on one that is, both fit and the pictures cannot tell.
    pub(super) fn best(&self) -> Option<Match> {
        let [plain, mirror] = self.search(&[Flip { u: false, v: false }, Flip { u: true, v: false }]);
        let mirror_wins = match (&plain, &mirror) {
            (Some(plain), Some(mirror)) => {
                mirror.cost * MIRROR_MARGIN < plain.cost
                    && ![WhichSurface::Example, WhichSurface::Query].into_iter().any(|which| self.is_symmetric(which))
            }
            (plain, _) => plain.is_none(),
        };
        if mirror_wins { mirror } else { plain }
    }

    /// Whether a surface matches its own mirror image without bending: a hand's palm bends onto its back, a body's
    /// left side lies on its right as it is.
    fn is_symmetric(&self, which: WhichSurface) -> bool {
        let (surface, s) = match which {
            WhichSurface::Example => (self.example, 0),
            WhichSurface::Query => (self.query, 1),
        };
        let tips = [Arc::clone(&self.tips[s]), Arc::clone(&self.tips[s])];
        let own = Matcher { example: surface, query: surface, tips, solver: &Rigid, ..*self };
        let [_, mirror] = own.search(&[Flip { u: true, v: false }]);
        mirror.is_some_and(|m| m.cost < SYMMETRIC_MATCH)
    }

    /// The best unmirrored and the best mirrored match among the given flips.
    fn search(&self, flips: &[Flip]) -> [Option<Match>; 2] {
        let mut best = [None, None];
        for finalist in self.finalists(flips) {
            best[usize::from(finalist.flip.is_mirror())].get_or_insert(finalist);
        }
        best
    }

    /// The likeliest matches of both orientations, best first.
    pub(super) fn likely(&self) -> Vec<Match> {
        self.finalists(&[Flip { u: false, v: false }, Flip { u: true, v: false }])
    }

    /// The likeliest matches among the given flips, best first.
    fn finalists(&self, flips: &[Flip]) -> Vec<Match> {
        let anchors = usize::from(self.is_disc());
        let table = Assignments::new([&self.tips[0].between, &self.tips[1].between], anchors);
        let mut found: Vec<Match> = Vec::new();
        for likely in table.likely() {
            if (self.stop)() {
                break;
            }
            for &flip in flips {
                let twist = |pairs: &[(usize, usize)]| self.twist(pairs, flip) * DISTORTION / TWIST;
                let assignment = table.exchanged(likely.pairs.clone(), &twist);
                let cost = assignment.distortion + twist(&assignment.pairs);
                if found.iter().all(|f| f.flip != flip || f.assignment != assignment) {
                    found.push(Match { assignment, flip, cost });
                }
            }
        }
        self.looked_at(found)
    }

    fn is_disc(&self) -> bool {
        self.example.encoding().topology == Topology::Disc
    }

    /// How far tips are from their partners around the axes of some charts: mean difference of u after the best
    /// rotation, in periods, over charts with poles at pairs of the match.
    fn twist(&self, pairs: &[(usize, usize)], flip: Flip) -> f64 {
        let sign = if flip.is_mirror() { -1.0 } else { 1.0 };
        let (mut sum, mut count) = (0.0, 0);
        for k in self.spread(pairs) {
            let bottom = self.opposite(pairs, k);
            let turn = |&(a, x): &(usize, usize)| {
                let u = |s: usize, p: usize, q: usize, t: usize| {
                    let count = self.tips[s].vertices.len();
                    self.tips[s].angles[(p * count + q) * count + t]
                };
                u(1, pairs[bottom].1, pairs[k].1, x) - sign * u(0, pairs[bottom].0, pairs[k].0, a)
            };
            let others = || pairs.iter().enumerate().filter(|(j, _)| *j != k && *j != bottom).map(|(_, p)| turn(p));
            let tau = std::f64::consts::TAU;
            let (sin, cos) = others().map(|t| (tau * t).sin_cos()).fold((0.0, 0.0), |s, t| (s.0 + t.0, s.1 + t.1));
            let mean = sin.atan2(cos) / tau;
            sum += others().map(|t| (t - mean - (t - mean).round()).abs()).sum::<f64>();
            count += others().count();
        }
        sum / f64::from(count.max(1) as u32)
    }

    /// The pair at which the lower pole stands when the upper one stands at pair `k`: the farthest one; of discs, which
    /// have one pole, that same pair.
    fn opposite(&self, pairs: &[(usize, usize)], k: usize) -> usize {
        if self.is_disc() {
            return k;
        }
        let from = &self.tips[0].between[pairs[k].0];
        let other = (0..pairs.len()).filter(|&j| j != k);
        other.max_by(|&a, &b| from[pairs[a].0].total_cmp(&from[pairs[b].0])).unwrap_or(k)
    }

    /// Looks at the best matches again in charts with poles at several of their tips.
    fn looked_at(&self, mut found: Vec<Match>) -> Vec<Match> {
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut finalists: Vec<Match> = Vec::new();
        for one in found {
            let same = |f: &Match| f.assignment == one.assignment && f.flip == one.flip;
            if finalists.len() < FINALISTS_MAX && !finalists.iter().any(same) {
                finalists.push(one);
            }
        }
        let limit = finalists.first().map_or(0.0, |f| f.cost * FINALISTS_WITHIN);
        finalists.retain(|f| f.cost <= limit);
        for finalist in &mut finalists {
            let pairs = &finalist.assignment.pairs;
            let mut costs = Vec::new();
            for k in self.spread(pairs) {
                let one = self.tips[0].view(self.example, &self.poles_at(pairs, k, WhichSurface::Example));
                let two = self.tips[1].view(self.query, &self.poles_at(pairs, k, WhichSurface::Query));
                if let (Some(one), Some(two)) = (one, two) {
                    costs.push(self.cost(&finalist.assignment, finalist.flip, &one, &two));
                }
            }
            if !costs.is_empty() {
                finalist.cost = costs.iter().sum::<f64>() / costs.len() as f64;
            }
        }
        finalists.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        finalists
    }

    /// Some pairs of a match, far from each other.
    fn spread(&self, pairs: &[(usize, usize)]) -> Vec<usize> {
        let mut chosen = vec![0];
        while chosen.len() < CHARTS_LOOKED_AT.min(pairs.len()) {
            let nearest = |k: usize| {
                chosen.iter().map(|&c| self.tips[0].between[pairs[k].0][pairs[c].0]).fold(f64::INFINITY, f64::min)
            };
            let farthest = (0..pairs.len()).filter(|k| !chosen.contains(k));
            match farthest.max_by(|&a, &b| nearest(a).total_cmp(&nearest(b)).then(b.cmp(&a))) {
                Some(k) => chosen.push(k),
                None => break,
            }
        }
        chosen
    }

    fn tip(&self, which: WhichSurface, k: usize) -> u32 {
        match which {
            WhichSurface::Example => self.tips[0].vertices[k],
            WhichSurface::Query => self.tips[1].vertices[k],
        }
    }

    /// The poles of the chart for pair `k`: its tip at the top, and on spheres the matched tip furthest from it below.
    pub(super) fn poles_at(&self, pairs: &[(usize, usize)], k: usize, which: WhichSurface) -> Vec<u32> {
        let tip = |j: usize| self.tip(which, if which == WhichSurface::Example { pairs[j].0 } else { pairs[j].1 });
        if self.is_disc() { vec![tip(k)] } else { vec![tip(self.opposite(pairs, k)), tip(k)] }
    }

    /// How well a match holds in a pair of charts: tips on tips by a rotation, pictures alike from there; infinite where
    /// it can't be told.
    fn cost(&self, assignment: &Assignment, flip: Flip, one: &TipView, two: &TipView) -> f64 {
        let mut controls =
            tip_controls(&self.vertices(&assignment.pairs), flip, |tip| one.place(tip), |tip| two.place(tip));
        let images = query_images(&two.encoding, MATCH_SIDE);
        let level = images.first().and_then(|image| Level::new(&one.encoding, image));
        let (Some(level), false) = (level, controls.is_empty()) else { return f64::INFINITY };
        let off = off(&mut controls);
        let (p, q) = controls.into_iter().unzip();
        let mut registration = Registration::from_controls(flip, p, q);
        registration.solve_level(&level, self.solver, self.stop);
        let alike = registration.energy / registration.variance.max(1e-300);
        alike * (1.0 + off / TIP_DISTANCE) * (1.0 + assignment.distortion / DISTORTION)
    }

    /// Matched tips as vertices of the two meshes.
    pub(super) fn vertices(&self, pairs: &[(usize, usize)]) -> Vec<(u32, u32)> {
        let (one, two) = (&self.tips[0].vertices, &self.tips[1].vertices);
        pairs.iter().map(|&(a, b)| (one[a], two[b])).collect()
    }
}

/// Mean distance in the domain of matched tips after the best rotation; their targets are unwrapped.
fn off(controls: &mut [(Uv, Uv)]) -> f64 {
    let shift = unwrap_shifts(controls);
    let sum: f64 = controls.iter().map(|(p, q)| distance([p[0] + shift, p[1]], *q)).sum();
    sum / controls.len().max(1) as f64
}

/// Matched tips in a pair of charts, given where each tip lies, those at poles left out.
pub(super) fn tip_controls(
    matches: &[(u32, u32)],
    flip: Flip,
    one: impl Fn(u32) -> Option<Uv>,
    two: impl Fn(u32) -> Option<Uv>,
) -> Vec<(Uv, Uv)> {
    matches.iter().filter_map(|&(a, b)| Some((flip.apply(one(a)?), two(b)?))).collect()
}
