//! Extents: how much of an example belongs on how much of an input.
//!
//! Two surfaces of a kind seldom end at the same place: a bust goes on below the head's neck, a mask ends before the ears.
//! Their sub-discs about poles are compared as pictures: all pairs coarsely by translation, the best registered, and the
//! best of these moved until they register best. *Source:* METHOD §9. *Ours, not the paper's:* all of it.

use crate::encode::{Encoding, LEVEL_SIDES};
use crate::mesh::tri::TriMesh;
use crate::numerics::stop::Stop;
use crate::numerics::{in_halves, side_by_side};
use crate::rank::{Shape, score};
use crate::register::entry::MIRROR_MARGIN;
use crate::register::image::Image;
use crate::register::pole_search::Surroundings;
use crate::register::query::{Query, SEARCH_SIDE};
use crate::register::view::View;
use crate::register::{Flip, Level, Registration, Solver, coarse_flip, query_images, translation_energies};
use crate::topology::Topology;

/// A part of a surface: the sub-disc about a pole that holds a share of its area, or all of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Crop {
    /// The poles of the chart; the sub-disc is the one about the last.
    pub poles: Vec<u32>,
    /// Share of the surface's area, in 0–1; 1 is all of a disc.
    pub share: f64,
}

impl Crop {
    /// Whether it leaves nothing out.
    pub fn is_whole(&self) -> bool {
        self.share >= 1.0
    }
}

/// How much of an example belongs on how much of an input, as far as their pictures tell.
#[derive(Clone, Debug)]
pub struct Extent {
    /// The part of the example.
    pub one: Crop,
    /// The part of the input.
    pub two: Crop,
    /// How the pictures of the parts register.
    pub registration: Registration,
    /// E′ of that, with the mirror's handicap.
    pub score: f64,
}

/// Shares of the area that are tried, each this much of the one before.
const SHARE_STEP: f64 = 0.88;
/// Least share of the area that is tried.
const SHARE_MIN: f64 = 0.06;
/// Poles that are tried beside a surface's own, spread over it.
const POLES_SPREAD: usize = 32;
/// The same where both surfaces are cropped, and how many steps apart their shares are.
const POLES_SPREAD_BOTH: usize = 12;
const SHARES_APART_BOTH: usize = 3;
/// Pairs of parts that are registered, and of those how many are moved about.
const REGISTERED: usize = 12;
const MOVED: usize = 4;
/// Radii of the search, in √area of the part, with the step of the share's logarithm that goes with each.
const RADII: [(f64, f64); 3] = [(0.15, 0.12), (0.075, 0.06), (0.0375, 0.03)];
/// Rounds at one radius at most.
const ROUNDS_MAX: usize = 4;
/// A move must lower the score by this share.
const GAIN_MIN: f64 = 0.005;
/// Pixels a side of a view.
const VIEW_SIDE: usize = 256;

/// A picture of a part, ready to be compared.
struct Shot {
    /// Which view, and which share.
    view: usize,
    share: f64,
    modulus: f64,
    image: Image,
    /// The same mirrored, where it is an example's.
    mirrored: Option<Image>,
}

/// One surface with its views.
struct Subject<'a> {
    query: &'a Query,
    views: Vec<View>,
}

impl<'a> Subject<'a> {
    /// The surface's own poles first, then those spread over it.
    fn new(query: &'a Query, spread: usize) -> Self {
        let mesh = query.unfolder().mesh();
        let closed = query.encoding().topology == Topology::Sphere;
        let mut sets: Vec<Vec<u32>> = query.pole_sets().to_vec();
        if closed {
            let turned: Vec<Vec<u32>> = sets.iter().map(|poles| poles.iter().rev().copied().collect()).collect();
            sets.extend(turned);
        }
        sets.extend(
            spread_over(mesh, spread).into_iter().map(|p| if closed { vec![far_from(mesh, p), p] } else { vec![p] }),
        );
        Self { query, views: sets.iter().filter_map(|poles| query.view(poles, VIEW_SIDE)).collect() }
    }

    fn own(&self) -> usize {
        let sets = self.query.pole_sets().len();
        if self.query.encoding().topology == Topology::Sphere { 2 * sets } else { sets }
    }

    /// Pictures of the parts about some views.
    fn shots(&self, views: usize, shares: &[f64], mirrored: bool) -> Vec<Shot> {
        let mut shots = Vec::new();
        for (view, from) in self.views.iter().enumerate().take(views) {
            for &share in shares {
                let picture = from.crop(share, LEVEL_SIDES[0]);
                let flipped = Flip { u: true, v: false };
                shots.push(Shot {
                    view,
                    share,
                    modulus: from.modulus(share),
                    image: Image::new(&picture, Flip::default(), false),
                    mirrored: mirrored.then(|| Image::new(&picture, flipped, false)),
                });
            }
        }
        shots
    }

    fn is_closed(&self) -> bool {
        self.query.encoding().topology == Topology::Sphere
    }
}

/// Vertices spread over a surface, each as far as can be from those before.
fn spread_over(mesh: &TriMesh, count: usize) -> Vec<u32> {
    let on_boundary = mesh.boundary_vertices();
    let mut away = vec![f64::INFINITY; mesh.positions.len()];
    let mut chosen: Vec<u32> = Vec::new();
    let mut next = on_boundary.iter().position(|b| !b).unwrap_or(0);
    for _ in 0..count {
        chosen.push(next as u32);
        let at = mesh.positions[next];
        away.iter_mut().zip(&mesh.positions).for_each(|(d, x)| *d = d.min((x - at).norm_squared()));
        let inner = (0..away.len()).filter(|&v| !on_boundary[v]);
        next = inner.max_by(|&a, &b| away[a].total_cmp(&away[b]).then(b.cmp(&a))).unwrap_or(0);
    }
    chosen
}

/// The vertex farthest from another.
fn far_from(mesh: &TriMesh, from: u32) -> u32 {
    let at = mesh.positions[from as usize];
    let away = |v: &u32| (mesh.positions[*v as usize] - at).norm_squared();
    (0..mesh.positions.len() as u32).max_by(|a, b| away(a).total_cmp(&away(b)).then(b.cmp(a))).unwrap_or(0)
}

fn shares() -> Vec<f64> {
    std::iter::successors(Some(SHARE_STEP), |share| Some(share * SHARE_STEP)).take_while(|s| *s >= SHARE_MIN).collect()
}

/// A pair of parts, compared by translation.
#[derive(Clone, Copy)]
struct Pairing {
    score: f64,
    views: [usize; 2],
    shares: [f64; 2],
    flip: Flip,
}

/// The extents at which an example and an input, both discs or spheres, register best, best first. What is whole on both
/// sides is not among them.
pub fn extents(one: &Query, two: &Query, solver: &dyn Solver, stop: Stop<'_>) -> Vec<Extent> {
    let is_fit = |q: &Query| matches!(q.encoding().topology, Topology::Disc | Topology::Sphere);
    if !is_fit(one) || !is_fit(two) {
        return Vec::new();
    }
    let (one, two) = side_by_side(|| Subject::new(one, POLES_SPREAD), || Subject::new(two, POLES_SPREAD));
    let extent = |pairing: &Pairing| if stop() { None } else { registered(&one, &two, pairing, solver, stop) };
    let mut found: Vec<Extent> = in_halves(&swept(&one, &two), extent).into_iter().flatten().collect();
    found.sort_by(|a, b| a.score.total_cmp(&b.score));
    found.truncate(MOVED);
    let search = Search { one: &one, two: &two, solver, stop };
    let mut moved = in_halves(&found, |extent| search.descend(extent.clone()));
    moved.sort_by(|a, b| a.score.total_cmp(&b.score));
    moved
}

/// The pairs of parts that match best, at most one a pair of views.
fn swept(one: &Subject, two: &Subject) -> Vec<Pairing> {
    let (all, coarse): (Vec<f64>, Vec<f64>) = (shares(), shares().into_iter().step_by(SHARES_APART_BOTH).collect());
    let mut found: Vec<Pairing> = Vec::new();
    if !one.is_closed() {
        compare(&one.shots(one.own(), &[1.0], true), &two.shots(two.views.len(), &all, false), &mut found);
    }
    if !two.is_closed() {
        compare(&one.shots(one.views.len(), &all, true), &two.shots(two.own(), &[1.0], false), &mut found);
    }
    let few = |subject: &Subject| subject.own() + POLES_SPREAD_BOTH;
    if one.is_closed() && two.is_closed() {
        compare(&one.shots(few(one), &coarse, true), &two.shots(few(two), &coarse, false), &mut found);
    }
    found.sort_by(|a, b| a.score.total_cmp(&b.score));
    let mut kept: Vec<Pairing> = Vec::new();
    for pairing in found {
        if kept.len() == REGISTERED {
            break;
        }
        if kept.iter().all(|k| k.views != pairing.views || k.flip != pairing.flip) {
            kept.push(pairing);
        }
    }
    kept
}

/// Adds the best share of every pair of views and flip.
fn compare(ones: &[Shot], twos: &[Shot], found: &mut Vec<Pairing>) {
    let mut best: std::collections::BTreeMap<([usize; 2], Flip), Pairing> = Default::default();
    for a in ones {
        for b in twos {
            let images = [(Flip::default(), Some(&a.image)), (Flip { u: true, v: false }, a.mirrored.as_ref())];
            for (flip, image) in images {
                let Some(image) = image else { continue };
                let least = translation_energies(image, &b.image).into_iter().fold(f64::INFINITY, f64::min);
                let cost = least / (image.variance + b.image.variance).max(1e-300);
                let score = scored(cost, flip, [a.modulus, b.modulus]);
                let pairing = Pairing { score, views: [a.view, b.view], shares: [a.share, b.share], flip };
                let kept = best.entry((pairing.views, flip)).or_insert(pairing);
                if score < kept.score {
                    *kept = pairing;
                }
            }
        }
    }
    found.extend(best.into_values());
}

/// E′ with the mirror's handicap.
fn scored(cost: f64, flip: Flip, moduli: [f64; 2]) -> f64 {
    let [one, two] = moduli.map(|modulus| Shape { modulus, bending: None });
    score(cost, one, two, 0.0) * if flip.is_mirror() { MIRROR_MARGIN } else { 1.0 }
}

fn registered(one: &Subject, two: &Subject, p: &Pairing, solver: &dyn Solver, stop: Stop<'_>) -> Option<Extent> {
    let views = [&one.views[p.views[0]], &two.views[p.views[1]]];
    let crop = |k: usize| Crop { poles: views[k].poles.clone(), share: p.shares[k] };
    register(views, [crop(0), crop(1)], p.flip, solver, stop)
}

/// Registers the pictures of two parts.
fn register(
    views: [&View; 2],
    [one, two]: [Crop; 2],
    flip: Flip,
    solver: &dyn Solver,
    stop: Stop<'_>,
) -> Option<Extent> {
    let encodings: [Encoding; 2] =
        [views[0].encoding(one.share, SEARCH_SIDE), views[1].encoding(two.share, SEARCH_SIDE)];
    let mut registration: Option<Registration> = None;
    for image in &query_images(&encodings[1], SEARCH_SIDE) {
        let level = Level::new(&encodings[0], image)?;
        match &mut registration {
            None => registration = Some(coarse_flip(&level, flip, solver, stop)),
            Some(registration) => registration.advance(&level, solver, stop),
        }
    }
    let registration = registration?;
    let cost = registration.energy / registration.variance.max(1e-300);
    let score = scored(cost, flip, [encodings[0].modulus, encodings[1].modulus]);
    Some(Extent { one, two, registration, score })
}

/// Moves the parts about until they register best.
struct Search<'a> {
    one: &'a Subject<'a>,
    two: &'a Subject<'a>,
    solver: &'a dyn Solver,
    stop: Stop<'a>,
}

impl Search<'_> {
    fn descend(&self, start: Extent) -> Extent {
        let view = |subject: &Subject, crop: &Crop| subject.query.view(&crop.poles, VIEW_SIDE);
        let (Some(mut one), Some(mut two)) = (view(self.one, &start.one), view(self.two, &start.two)) else {
            return start;
        };
        let mut best = start;
        for (radius, step) in RADII {
            for _ in 0..ROUNDS_MAX {
                let before = best.score;
                // What is whole stays; of two wholes the input's pole moves.
                if !best.one.is_whole() {
                    self.improve(&mut best, 0, [&mut one, &mut two], radius, step);
                }
                if !best.two.is_whole() || best.one.is_whole() {
                    self.improve(&mut best, 1, [&mut one, &mut two], radius, step);
                }
                if best.score >= before || (self.stop)() {
                    break;
                }
            }
        }
        best
    }

    /// Tries other shares and poles of one side.
    fn improve(&self, best: &mut Extent, side: usize, views: [&mut View; 2], radius: f64, step: f64) {
        let subject = [self.one, self.two][side];
        let [one, two] = views;
        let crop = |extent: &Extent| if side == 0 { extent.one.clone() } else { extent.two.clone() };
        let attempt = |crop: Crop, view: Option<&View>, best: &mut Extent| -> bool {
            let pair = match (side, view) {
                (0, Some(view)) => ([view, &*two], [crop, best.two.clone()]),
                (0, None) => ([&*one, &*two], [crop, best.two.clone()]),
                (_, Some(view)) => ([&*one, view], [best.one.clone(), crop]),
                (_, None) => ([&*one, &*two], [best.one.clone(), crop]),
            };
            match register(pair.0, pair.1, best.registration.flip, self.solver, self.stop) {
                Some(trial) if trial.score < best.score * (1.0 - GAIN_MIN) => {
                    *best = trial;
                    true
                }
                _ => false,
            }
        };
        for factor in [(-step).exp(), step.exp()] {
            let now = crop(best);
            let most = if subject.is_closed() { 0.97 } else { 1.0 };
            let share = (now.share * factor).clamp(SHARE_MIN, most);
            attempt(Crop { share, ..now }, None, best);
        }
        let mesh = subject.query.unfolder().mesh();
        let surroundings = Surroundings::new(mesh);
        let now = crop(best);
        let Some(&pole) = now.poles.last() else { return };
        let scale = (now.share * mesh.total_area()).sqrt();
        let mut chosen: Option<View> = None;
        for neighbour in surroundings.around(pole, radius * scale) {
            if (self.stop)() {
                break;
            }
            let mut poles = now.poles.clone();
            if let Some(last) = poles.last_mut() {
                *last = neighbour;
            }
            if poles.len() > 1 && poles[0] == neighbour {
                continue;
            }
            let Some(view) = subject.query.view(&poles, VIEW_SIDE) else { continue };
            let share = crop(best).share;
            if attempt(Crop { poles, share }, Some(&view), best) {
                chosen = Some(view);
            }
        }
        if let Some(view) = chosen {
            *(if side == 0 { one } else { two }) = view;
        }
    }
}
