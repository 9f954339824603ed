//! Which tips belong together, and whether the map mirrors.
//!
//! Distances along the surfaces leave a few matches ([`super::assignment`]), a match and its mirror image among them.
//! Each is laid into a pair of charts with poles at two of its pairs: there tips must come to lie on tips by a mere
//! rotation, and the pictures must register from there. *Ours, not the paper's.*

use std::sync::Arc;

use super::assignment::{Assignment, Assignments};
use super::{Side, unwrap_shifts};
use crate::encode::encode_to;
use crate::encode::features::distance;
use crate::mesh::geodesic::Marcher;
use crate::register::entry::MIRROR_MARGIN;
use crate::register::solve::Rigid;
use crate::register::{Flip, Level, Query, Registration, Solver, query_images};
use crate::topology::Topology;
use crate::unfold::Uv;
use crate::unfold::pole::Breadth;

/// Level at which matches are compared.
const MATCH_SIDE: usize = 32;
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

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    Example,
    Query,
}

/// Matches tips by their distances and by registering charts with poles at them.
pub(super) struct Matcher<'a> {
    example: &'a Query,
    query: &'a Query,
    breadth: Breadth,
    solver: &'a dyn Solver,
    stop: &'a dyn Fn() -> bool,
    /// Distances between tips along each surface, in √area; of discs the boundary comes last.
    between: [Vec<Vec<f64>>; 2],
    /// Number of tips of each surface.
    tips: [usize; 2],
    /// u of tip t in the chart with its lower pole at tip p and its upper at q, at [p][q][t].
    angles: [Vec<f64>; 2],
}

impl<'a> Matcher<'a> {
    pub(super) fn new(
        example: &'a Query,
        query: &'a Query,
        breadth: Breadth,
        solver: &'a dyn Solver,
        stop: &'a dyn Fn() -> bool,
    ) -> Self {
        let sides = [example, query];
        Self {
            example,
            query,
            breadth,
            solver,
            stop,
            between: sides.map(|side| distances_between(side, side.tips(breadth))),
            tips: sides.map(|side| side.tips(breadth).len()),
            angles: sides.map(|side| angles_between(side, side.tips(breadth))),
        }
    }

    /// The best match. A mirrored one has to beat the best unmirrored one, on surfaces neither of which is its own mirror
    /// image: on one that is, both fit and the pictures cannot tell.
    pub(super) fn best(&self) -> Option<Match> {
        let [plain, mirror] = self.search(&[Flip { u: false, v: false }, Flip { u: true, v: false }]);
        let mirror_wins = match (&plain, &mirror) {
            (Some(plain), Some(mirror)) => {
                mirror.cost * MIRROR_MARGIN < plain.cost
                    && ![Which::Example, Which::Query].into_iter().any(|which| self.is_symmetric(which))
            }
            (plain, _) => plain.is_none(),
        };
        if mirror_wins { mirror } else { plain }
    }

    /// Whether a surface matches its own mirror image without bending: a hand's palm bends onto its back, a body's
    /// left side lies on its right as it is.
    fn is_symmetric(&self, which: Which) -> bool {
        let (surface, s) = match which {
            Which::Example => (self.example, 0),
            Which::Query => (self.query, 1),
        };
        let between = [self.between[s].clone(), self.between[s].clone()];
        let (tips, angles) = ([self.tips[s]; 2], [self.angles[s].clone(), self.angles[s].clone()]);
        let own = Matcher { example: surface, query: surface, between, tips, angles, solver: &Rigid, ..*self };
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
        let table = Assignments::new([&self.between[0], &self.between[1]], anchors);
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
                let u =
                    |s: usize, p: usize, q: usize, t: usize| self.angles[s][(p * self.tips[s] + q) * self.tips[s] + t];
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
        let from = &self.between[0][pairs[k].0];
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
                let one = self.quick(Which::Example, &self.poles_at(pairs, k, Which::Example));
                let two = self.quick(Which::Query, &self.poles_at(pairs, k, Which::Query));
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
                chosen.iter().map(|&c| self.between[0][pairs[k].0][pairs[c].0]).fold(f64::INFINITY, f64::min)
            };
            let farthest = (0..pairs.len()).filter(|k| !chosen.contains(k));
            match farthest.max_by(|&a, &b| nearest(a).total_cmp(&nearest(b)).then(b.cmp(&a))) {
                Some(k) => chosen.push(k),
                None => break,
            }
        }
        chosen
    }

    fn tip(&self, which: Which, k: usize) -> u32 {
        match which {
            Which::Example => self.example.tips(self.breadth)[k],
            Which::Query => self.query.tips(self.breadth)[k],
        }
    }

    /// The poles of the chart for pair `k`: its tip at the top, and on spheres the matched tip furthest from it below.
    pub(super) fn poles_at(&self, pairs: &[(usize, usize)], k: usize, which: Which) -> Vec<u32> {
        let tip = |j: usize| self.tip(which, if which == Which::Example { pairs[j].0 } else { pairs[j].1 });
        if self.is_disc() { vec![tip(k)] } else { vec![tip(self.opposite(pairs, k)), tip(k)] }
    }

    fn quick(&self, which: Which, poles: &[u32]) -> Option<Side> {
        let side = match which {
            Which::Example => self.example,
            Which::Query => self.query,
        };
        let chart = side.quick_chart(poles)?;
        let encoding = encode_to(&chart, MATCH_SIDE);
        Some(Side { chart: Arc::new(chart), encoding })
    }

    /// How well a match holds in a pair of charts: tips on tips by a rotation, pictures alike from there; infinite where
    /// it can't be told.
    fn cost(&self, assignment: &Assignment, flip: Flip, one: &Side, two: &Side) -> f64 {
        let mut controls = tip_controls(&self.vertices(&assignment.pairs), flip, one, two);
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
        let (one, two) = (self.example.tips(self.breadth), self.query.tips(self.breadth));
        pairs.iter().map(|&(a, b)| (one[a], two[b])).collect()
    }
}

/// Mean distance in the domain of matched tips after the best rotation; their targets are unwrapped.
fn off(controls: &mut [(Uv, Uv)]) -> f64 {
    let shift = unwrap_shifts(controls);
    let sum: f64 = controls.iter().map(|(p, q)| distance([p[0] + shift, p[1]], *q)).sum();
    sum / controls.len().max(1) as f64
}

/// Matched tips in a pair of charts, those at poles left out.
pub(super) fn tip_controls(matches: &[(u32, u32)], flip: Flip, one: &Side, two: &Side) -> Vec<(Uv, Uv)> {
    let is_pole = |side: &Side, v: u32| side.chart.poles.iter().any(|p| p.vertex == v);
    matches
        .iter()
        .filter(|(a, b)| !is_pole(one, *a) && !is_pole(two, *b))
        .map(|&(a, b)| (flip.apply(one.chart.uv[a as usize]), two.chart.uv[b as usize]))
        .collect()
}

fn angles_between(side: &Query, tips: &[u32]) -> Vec<f64> {
    let disc = side.encoding().topology == Topology::Disc;
    let mut all = Vec::with_capacity(tips.len().pow(3));
    for &p in tips {
        for &q in tips {
            let poles = if disc { vec![q] } else { vec![p, q] };
            all.extend(side.angles(&poles, tips).unwrap_or_else(|| vec![0.0; tips.len()]));
        }
    }
    all
}

fn distances_between(side: &Query, tips: &[u32]) -> Vec<Vec<f64>> {
    let mesh = side.unfolder().mesh();
    let marcher = Marcher::new(mesh);
    let scale = mesh.total_area().sqrt();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for &tip in tips {
        let d = marcher.distances(&[tip]);
        rows.push(tips.iter().map(|&x| d[x as usize] / scale).collect());
    }
    if side.encoding().topology == Topology::Disc {
        let rim: Vec<u32> =
            mesh.boundary_vertices().iter().enumerate().filter(|(_, on)| **on).map(|(v, _)| v as u32).collect();
        let d = marcher.distances(&rim);
        rows.iter_mut().zip(tips).for_each(|(row, &tip)| row.push(d[tip as usize] / scale));
        rows.push(tips.iter().map(|&tip| d[tip as usize] / scale).chain([0.0]).collect());
    }
    rows
}
