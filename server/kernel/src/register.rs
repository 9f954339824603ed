//! Registration: the planar map ψ̂ that carries an example's encoding onto the query's, coarse to fine.
//!
//! At the coarsest level every periodic translation is tried for each flip; at each level the translation is refined
//! by one pixel, features join as controls, and a solver moves them. *Source:* paper §5; METHOD §4, §5.

pub mod entry;
pub mod evaluate;
pub mod folds;
pub mod image;
pub mod likeness;
pub mod mls;
pub mod nodes;
pub mod normal;
pub mod pole_search;
pub mod problem;
pub mod query;
pub mod solve;
pub mod spectra;
pub mod tips;
pub mod trial;
pub mod view;

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::encode::features::{Feature, distance_on};
use crate::encode::{Encoding, LEVEL_SIDES, Picture};
use crate::numerics::wide::{Wide, wide};
use crate::topology::Topology;
use crate::unfold::Uv;
pub use entry::Entry;
use evaluate::psi;
use folds::is_translation;
pub use folds::{FOLD_SIDE_MAX, fold_cells};
use image::Image;
use mls::Domain;
use nodes::Nodes;
use problem::Problem;
pub use query::Query;
pub use solve::{LevenbergMarquardt, PixelDescent, Solver, Termination};

/// How the example is mirrored before registration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Flip {
    /// u → 1 − u.
    pub u: bool,
    /// v → 1 − v.
    pub v: bool,
}

impl Flip {
    /// The flips to try for a topology. *Source:* paper Fig. 6.
    pub fn all(topology: Topology) -> &'static [Self] {
        const NONE: Flip = Flip { u: false, v: false };
        const U: Flip = Flip { u: true, v: false };
        const V: Flip = Flip { u: false, v: true };
        const UV: Flip = Flip { u: true, v: true };
        match topology {
            Topology::Disc => &[NONE, U],
            _ => &[NONE, UV, U, V],
        }
    }

    /// Whether orientation is reversed: the map turns left hands into right ones.
    pub fn is_mirror(self) -> bool {
        self.u != self.v
    }

    /// A point of the example, mirrored.
    pub fn apply(self, p: Uv) -> Uv {
        [if self.u { 1.0 - p[0] } else { p[0] }, if self.v { 1.0 - p[1] } else { p[1] }]
    }
}

/// The state of one example (under one flip) against one query.
#[derive(Clone, Debug, PartialEq)]
pub struct Registration {
    /// How the example is mirrored.
    pub flip: Flip,
    /// Level reached: pixels a side.
    pub side: usize,
    /// Controls on the mirrored example.
    pub p: Vec<Uv>,
    /// Where they go; u is not wrapped.
    pub q: Vec<Uv>,
    /// E at the level reached.
    pub energy: f64,
    /// var √λ₁ + var √λ₂ at the level reached.
    pub variance: f64,
    /// Cells still folded after repair; 0 unless repair failed.
    pub folds: usize,
}

/// Half-way moves of the control nearest a fold before it takes its prediction whole. *Source:* METHOD §5.
const REPAIR_HALVINGS: usize = 6;
/// A feature this near to a control, in pixels, is that control.
const CONTROL_SPACING_PX: f64 = 3.0;
/// Repairs tried in all, as a multiple of the number of controls.
const REPAIRS_PER_CONTROL: usize = 3;
/// Aspect of the domain's metric: 1 is the paper's. From .5 to 2 the maps' mean errors do not differ.
pub const ASPECT: f64 = 1.0;

/// What registration works on at one level.
pub struct Level<'a> {
    /// The example.
    pub example: &'a Encoding,
    /// λ₁ at this level.
    picture: &'a Picture,
    /// What follows from the example alone.
    ready: Arc<LevelCache>,
    /// √λ₂ at this level.
    query: &'a Image,
}

/// Caches what a level of an example gives for any query: its pictures, and the nodes of ψ̂ for the controls asked for
/// so far.
#[derive(Debug)]
struct LevelCache {
    /// √λ₁ for each flip of [`Flip::all`], when it is asked for.
    flipped: Vec<OnceLock<Image>>,
    nodes: Mutex<Vec<Arc<Nodes>>>,
}

/// Sets of nodes that a level keeps: one before and one after new controls, for each flip.
const NODES_KEPT: usize = 8;

impl<'a> Level<'a> {
    /// Prepares an example's level against the query's image of the same side; `None` where the example lacks it.
    pub fn new(example: &'a Encoding, query: &'a Image) -> Option<Self> {
        let picture = example.level(query.side)?;
        let flipped = Flip::all(example.topology).iter().map(|_| OnceLock::new()).collect();
        Some(Self { example, picture, ready: Arc::new(LevelCache { flipped, nodes: Mutex::default() }), query })
    }

    /// The same level of the example against another image; `None` where that has another side.
    pub fn against<'b>(&self, query: &'b Image) -> Option<Level<'b>>
    where
        'a: 'b,
    {
        let ready = Arc::clone(&self.ready);
        (query.side == self.query.side).then_some(Level { example: self.example, picture: self.picture, ready, query })
    }

    fn image(&self, flip: Flip) -> &Image {
        let k = Flip::all(self.example.topology).iter().position(|&f| f == flip).unwrap_or(0);
        let periodic = self.example.topology.is_periodic_v();
        self.ready.flipped[k].get_or_init(|| Image::new(self.picture, flip, periodic))
    }

    /// The nodes for controls at `p`, made once.
    fn nodes(&self, p: &[Uv]) -> Arc<Nodes> {
        let find = |kept: &[Arc<Nodes>]| kept.iter().find(|nodes| nodes.p == p).cloned();
        let kept = || self.ready.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = find(&kept()) {
            return found;
        }
        let made = Arc::new(Nodes::new(self.domain(), self.query.side, p));
        let mut kept = kept();
        if kept.len() < NODES_KEPT {
            kept.push(Arc::clone(&made));
        }
        made
    }

    fn problem(&self, flip: Flip, p: &[Uv]) -> Problem<'_> {
        Problem::new(self.nodes(p), self.image(flip), self.query)
    }

    /// Least E over all translations / (var √λ₁ + var √λ₂).
    fn translation_cost(&self, flip: Flip) -> f64 {
        let image = self.image(flip);
        let least = translation_energies(image, self.query).into_iter().fold(f64::INFINITY, f64::min);
        least / (image.variance + self.query.variance).max(1e-300)
    }

    fn domain(&self) -> Domain {
        Domain { topology: self.example.topology, aspect: ASPECT }
    }
}

/// Query images at every level up to `side`, coarse to fine.
pub fn query_images(query: &Encoding, side: usize) -> Vec<Image> {
    let periodic = query.topology.is_periodic_v();
    query.pyramid.iter().filter(|p| p.side <= side).map(|p| Image::new(p, Flip::default(), periodic)).collect()
}

/// E for all translations of `side` pixels: `energies[t]` compares pixel x of the example with pixel x + t of the
/// query. *Source:* paper §5.2 ("Isometries").
///
/// Tori: `energies[row * side + t]` for translations by `row` pixels in v as well.
pub fn translation_energies(example: &Image, query: &Image) -> Vec<f64> {
    let side = example.side;
    // Rows of the query twice, so that every shift is a slice.
    let twice: Vec<f64> = (0..side).flat_map(|y| query.row(y).repeat(2)).collect();
    wide(Translations { example, twice, side })
}

struct Translations<'a> {
    example: &'a Image,
    twice: Vec<f64>,
    side: usize,
}

impl Wide for Translations<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run(self) -> Vec<f64> {
        let side = self.side;
        let rows = if self.example.is_periodic_v() { side } else { 1 };
        let mut energies = Vec::with_capacity(rows * side);
        for row in 0..rows {
            for t in 0..side {
                let mut sums = [0.0; LANES];
                for y in 0..side {
                    let at = 2 * side * ((y + row) % side) + t;
                    add_squares(&mut sums, &self.twice[at..at + side], self.example.row(y));
                }
                energies.push(sums.iter().sum::<f64>() / (side * side) as f64);
            }
        }
        energies
    }
}

/// Sums that are kept side by side: a picture's energy is added up in this order.
const LANES: usize = 8;

#[inline(always)]
fn add_squares(sums: &mut [f64; LANES], a: &[f64], b: &[f64]) {
    let (a, b) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.0.iter().zip(b.0) {
        for k in 0..LANES {
            sums[k] += (a[k] - b[k]) * (a[k] - b[k]);
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(a.1.iter().zip(b.1)) {
        *sum += (a - b) * (a - b);
    }
}

/// Registers one flip at the coarsest level: the best translation, then the solver.
pub fn coarse_flip(level: &Level, flip: Flip, solver: &dyn Solver, stop: &dyn Fn() -> bool) -> Registration {
    let energies = translation_energies(level.image(flip), level.query);
    let best = (0..energies.len()).min_by(|&a, &b| energies[a].total_cmp(&energies[b])).unwrap_or(0);
    let side = level.query.side;
    let shift = [(best % side) as f64 / side as f64, (best / side) as f64 / side as f64];
    let coarsest = level.example.features.iter().filter(|f| f.side <= side);
    let mut p: Vec<Uv> = coarsest.map(|f| flip.apply(f.uv)).collect();
    if p.is_empty() {
        p.push([0.5, 0.5]);
    }
    let q = p.iter().map(|p| [p[0] + shift[0], p[1] + shift[1]]).collect();
    let mut registration = Registration { side, energy: energies[best], ..Registration::from_controls(flip, p, q) };
    registration.solve_level(level, solver, stop);
    registration
}

impl Registration {
    /// A registration with given controls, at no level yet.
    pub fn from_controls(flip: Flip, p: Vec<Uv>, q: Vec<Uv>) -> Self {
        Self { flip, side: 0, p, q, energy: f64::INFINITY, variance: 0.0, folds: 0 }
    }

    /// Advances to the level of `level`: translation ±1 pixel, new controls, solver, fold repair.
    pub fn advance(&mut self, level: &Level, solver: &dyn Solver, stop: &dyn Fn() -> bool) {
        self.nudge(level);
        self.solve_level(level, solver, stop);
    }

    /// ψ̂ of a point of the *unmirrored* example.
    pub fn map(&self, topology: Topology, x: Uv) -> Uv {
        psi(Domain { topology, aspect: ASPECT }, &self.p, &self.q, self.flip.apply(x))
    }

    /// Mean displacement along u: the periodic translation, in 0–1.
    pub fn shift_u(&self) -> f64 {
        let sum: f64 = self.p.iter().zip(&self.q).map(|(p, q)| q[0] - p[0]).sum();
        (sum / self.p.len().max(1) as f64).rem_euclid(1.0)
    }

    /// Tries the translation one pixel to either side (tori: and up and down).
    fn nudge(&mut self, level: &Level) {
        let pixel = 1.0 / level.query.side as f64;
        let shifted =
            |d: Uv| -> Vec<Uv> { self.q.iter().map(|q| [q[0] + d[0] * pixel, q[1] + d[1] * pixel]).collect() };
        let problem = level.problem(self.flip, &self.p);
        let rows: &[f64] = if level.domain().topology.is_periodic_v() { &[0.0, -1.0, 1.0] } else { &[0.0] };
        let trials = rows.iter().flat_map(|&row| [0.0, -1.0, 1.0].map(|d| [d, row]));
        let best = trials.map(|d| (problem.energy(&shifted(d)), d)).min_by(|a, b| a.0.total_cmp(&b.0));
        self.q = shifted(best.map_or([0.0; 2], |b| b.1));
    }

    /// Registers at `level` from where the controls are: new controls, solver, fold repair.
    pub fn solve_level(&mut self, level: &Level, solver: &dyn Solver, stop: &dyn Fn() -> bool) {
        let side = level.query.side;
        let finer = side.min(FOLD_SIDE_MAX) > self.side.min(FOLD_SIDE_MAX);
        // What was free of folds still is where only a translation came in between.
        if (self.adopt(level, side) > 0 || finer) && !is_translation(&self.p, &self.q) {
            self.repair(level);
        }
        let (energy, _) = solver.solve(&level.problem(self.flip, &self.p), &mut self.q, stop);
        self.energy = energy;
        self.side = side;
        self.variance = level.image(self.flip).variance + level.query.variance;
        self.repair(level);
    }

    /// Features of this level become controls where the map already sends them; how many did.
    fn adopt(&mut self, level: &Level, side: usize) -> usize {
        let domain = level.domain();
        let fresh = |f: &&Feature| f.side <= side && f.side > self.side;
        let spacing = CONTROL_SPACING_PX / side as f64;
        let far = |x: &Uv| self.p.iter().all(|p| distance_on(domain.topology, *p, *x) >= spacing);
        let added: Vec<Uv> =
            level.example.features.iter().filter(fresh).map(|f| self.flip.apply(f.uv)).filter(far).collect();
        let to: Vec<Uv> = added.iter().map(|&x| psi(domain, &self.p, &self.q, x)).collect();
        self.p.extend(&added);
        self.q.extend(to);
        added.len()
    }

    /// Undoes folds: the control nearest a fold moves half way to where the others predict it, at last all the way.
    fn repair(&mut self, level: &Level) {
        let domain = level.domain();
        let mut moves = vec![0usize; self.p.len()];
        for _ in 0..REPAIRS_PER_CONTROL * (REPAIR_HALVINGS + 1) * self.p.len() {
            let folds = fold_cells(domain, &self.p, &self.q, level.query.side.min(FOLD_SIDE_MAX));
            self.folds = folds.len();
            let Some(fold) = folds.first() else { return };
            let open = (0..self.p.len()).filter(|&i| moves[i] <= REPAIR_HALVINGS);
            let to_fold = |i: usize| distance_on(domain.topology, self.p[i], *fold);
            let nearest = open.min_by(|&a, &b| to_fold(a).total_cmp(&to_fold(b)));
            let Some(i) = nearest else { break };
            let others =
                |all: &[Uv]| -> Vec<Uv> { all.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, x)| *x).collect() };
            let predicted = psi(domain, &others(&self.p), &others(&self.q), self.p[i]);
            let share = if moves[i] < REPAIR_HALVINGS { 0.5 } else { 1.0 };
            (0..2).for_each(|k| self.q[i][k] += share * (predicted[k] - self.q[i][k]));
            moves[i] += 1;
        }
        if self.folds > 0 {
            // Nothing folds under a translation.
            let mean = |k: usize| self.p.iter().zip(&self.q).map(|(p, q)| q[k] - p[k]).sum::<f64>();
            let shift = [0, 1].map(|k| mean(k) / self.p.len() as f64);
            let up = if domain.topology.is_periodic_v() { shift[1] } else { 0.0 };
            self.q = self.p.iter().map(|p| [p[0] + shift[0], p[1] + up]).collect();
            self.folds = 0;
        }
    }
}

/// The side of the level after `side`, if there is one.
pub fn next_side(side: usize) -> Option<usize> {
    LEVEL_SIDES.iter().copied().find(|&s| s > side)
}
