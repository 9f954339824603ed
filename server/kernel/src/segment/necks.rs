//! Necks: where a protrusion is cut off.
//!
//! A tip stands out when it is high for its girth. It is cut off at the level set that is short for the area that it
//! bounds, the minimum of girth / area^0.8 along its stretch of the merge tree; and once more wherever the girth has a
//! pronounced minimum (wrists, ankles).

use super::centrality::centrality;
use super::distance::neighbours;
use super::tree::{LEVELS, Profile, Scale, Tree};
use crate::mesh::tri::TriMesh;

/// Tips whose height over their saddle is less (in √area) are noise.
const PERSISTENCE_MIN: f64 = 0.012;
/// A protrusion has at least this share of the area.
const AREA_MIN: f64 = 0.0012;

/// What stands out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prominence {
    /// Least height of a protrusion, in √area.
    height_min: f64,
    /// Least height of a protrusion for its girth.
    slenderness_min: f64,
    /// How far below its upper end a stretch between saddles is cut, in girths.
    stretch_min: f64,
}

impl Prominence {
    /// Limbs, fingers, ears: what one chart would squeeze.
    pub(super) const LIMBS: Self = Self { height_min: 0.035, slenderness_min: 0.30, stretch_min: 0.25 };
    /// Stubs as well, for a number of parts that is asked for.
    pub(super) const STUBS: Self = Self { height_min: 0.025, slenderness_min: 0.12, stretch_min: 0.15 };
}

/// Cuts keep this far from the saddle below, in √area, or a quarter of the stretch where that is less.
const MARGIN: f64 = 0.02;
/// Power of the area in what a neck minimises: with 1/2, a cone would be cut anywhere; with more, at its root.
const AREA_POWER: f64 = 0.8;
/// How much wider the surface is on both sides of a narrow place.
const NARROW: f64 = 1.3;
/// Rounds in which tips are dropped.
const ROUNDS_MAX: usize = 64;

/// A cut along a level set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Neck {
    /// The arc that it crosses.
    pub(super) arc: u32,
    /// The level.
    pub(super) level: f64,
    /// How much it is worth: the height of what it cuts off, in √area, or less where the neck is weak.
    pub(super) worth: f64,
}

/// A surface's protrusions.
#[derive(Debug)]
pub(super) struct Necks {
    f: Vec<f64>,
    tree: Tree,
    /// The cuts, most worth first.
    pub(super) found: Vec<Neck>,
}

impl Necks {
    /// The necks of a connected surface.
    pub(super) fn of(mesh: &TriMesh, least: Prominence) -> Self {
        let f = centrality(mesh);
        let (neighbours, scale) = (neighbours(mesh), Scale::of(&f));
        let mut dropped = vec![false; f.len()];
        for round in 0.. {
            let tree = Tree::new(&f, &neighbours, &dropped, PERSISTENCE_MIN);
            let profiles = tree.profiles(mesh, &f, &scale);
            let weak = weak_tips(&tree, &profiles, &scale, least);
            if weak.is_empty() || round == ROUNDS_MAX {
                let found = necks(&tree, &profiles, &scale, least);
                return Self { f, tree, found };
            }
            weak.into_iter().for_each(|tip| dropped[tip as usize] = true);
        }
        Self { tree: Tree::new(&f, &neighbours, &dropped, PERSISTENCE_MIN), f, found: Vec::new() }
    }

    /// For each vertex 1 + the number of the innermost of the first `count` cuts that it lies beyond; 0 for none.
    pub(super) fn labels(&self, count: usize) -> Vec<u32> {
        let mut on_arc: Vec<Vec<(f64, u32)>> = vec![Vec::new(); self.tree.arcs.len()];
        for (k, neck) in self.found.iter().take(count).enumerate() {
            on_arc[neck.arc as usize].push((neck.level, 1 + k as u32));
        }
        on_arc.iter_mut().for_each(|cuts| cuts.sort_by(|a, b| b.0.total_cmp(&a.0)));
        let innermost = |v: usize| {
            let (mut a, mut level) = (self.tree.arc_of[v], self.f[v]);
            loop {
                if let Some(cut) = on_arc[a as usize].iter().find(|cut| cut.0 <= level) {
                    return cut.1;
                }
                let arc = &self.tree.arcs[a as usize];
                match arc.below {
                    crate::mesh::NONE => return 0,
                    below => (a, level) = (below, level.min(arc.low)),
                }
            }
        };
        (0..self.f.len()).map(innermost).collect()
    }
}

/// The levels at which an arc may be cut, lowest first.
fn levels_of(tree: &Tree, scale: &Scale, a: u32) -> std::ops::Range<usize> {
    let arc = &tree.arcs[a as usize];
    let low = arc.low.max(scale.level(0));
    let margin = MARGIN.min(0.25 * (arc.high - low));
    let first = scale.below(low + margin) + 1;
    first..(scale.below(arc.high) + 1).max(first).min(LEVELS)
}

fn is_leaf(tree: &Tree, a: u32) -> bool {
    tree.arcs[a as usize].above.is_empty()
}

/// Whether a cut at a level cuts off enough.
fn is_enough(tree: &Tree, profile: &Profile, scale: &Scale, least: Prominence, a: u32, j: usize) -> bool {
    let height = tree.arcs[a as usize].high - scale.level(j);
    let (girth, area) = (profile.girth[j], profile.area[j]);
    let slender = if is_leaf(tree, a) { least.slenderness_min } else { least.stretch_min };
    girth > 0.0
        && height >= least.height_min
        && height >= slender * girth
        && (AREA_MIN..=1.0 - AREA_MIN).contains(&area)
}

/// Tips that do not stand out; of those that meet at a saddle only the lowest.
fn weak_tips(tree: &Tree, profiles: &[Profile], scale: &Scale, least: Prominence) -> Vec<u32> {
    let is_weak = |a: &u32| {
        let mut levels = levels_of(tree, scale, *a);
        is_leaf(tree, *a) && !levels.any(|j| is_enough(tree, &profiles[*a as usize], scale, least, *a, j))
    };
    let mut weak = Vec::new();
    for below in (0..tree.arcs.len() as u32).filter(|&a| tree.is_live(a)) {
        let above = tree.arcs[below as usize].above.iter().copied().filter(is_weak);
        let high = |a: u32| tree.arcs[a as usize].high;
        if let Some(lowest) = above.min_by(|&a, &b| high(a).total_cmp(&high(b)).then(a.cmp(&b))) {
            weak.push(tree.arcs[lowest as usize].tip);
        }
    }
    weak
}

fn necks(tree: &Tree, profiles: &[Profile], scale: &Scale, least: Prominence) -> Vec<Neck> {
    let mut found = Vec::new();
    for a in
        (0..tree.arcs.len() as u32).filter(|&a| tree.is_live(a) && tree.arcs[a as usize].below != crate::mesh::NONE)
    {
        let profile = &profiles[a as usize];
        let levels: Vec<usize> =
            levels_of(tree, scale, a).filter(|&j| is_enough(tree, profile, scale, least, a, j)).collect();
        let tightness = |j: usize| profile.girth[j] / profile.area[j].min(1.0 - profile.area[j]).powf(AREA_POWER);
        let Some(best) = levels.iter().copied().min_by(|&i, &j| tightness(i).total_cmp(&tightness(j))) else {
            continue;
        };
        let top = top_of(tree, a);
        found.push(Neck { arc: a, level: scale.level(best), worth: top - scale.level(best) });
        for j in narrow_places(profile, &levels, best) {
            let height = tree.arcs[a as usize].high - scale.level(j);
            found.push(Neck { arc: a, level: scale.level(j), worth: 0.5 * height });
        }
    }
    found.sort_by(|x, y| y.worth.total_cmp(&x.worth).then(x.arc.cmp(&y.arc)).then(x.level.total_cmp(&y.level)));
    found
}

/// Height of the highest tip above an arc.
fn top_of(tree: &Tree, a: u32) -> f64 {
    let arc = &tree.arcs[a as usize];
    arc.above.iter().map(|&b| top_of(tree, b)).fold(arc.high, f64::max)
}

/// Pronounced minima of the girth away from `best`.
fn narrow_places(profile: &Profile, levels: &[usize], best: usize) -> Vec<usize> {
    let girth = |j: usize| profile.girth[j];
    let widest = |range: std::ops::Range<usize>| range.map(girth).fold(0.0, f64::max);
    let (Some(&first), Some(&last)) = (levels.first(), levels.last()) else { return Vec::new() };
    let end = (last..LEVELS).find(|&j| girth(j) <= 0.0).unwrap_or(LEVELS);
    let mut found: Vec<usize> = Vec::new();
    let mut taken: Vec<usize> = vec![best];
    let mut by_girth = levels.to_vec();
    by_girth.sort_by(|&i, &j| girth(i).total_cmp(&girth(j)).then(i.cmp(&j)));
    for j in by_girth {
        let wall = |range: std::ops::Range<usize>| widest(range) >= NARROW * girth(j);
        // Between this place and each cut there is already, and at both ends, the surface is wider.
        let below = taken.iter().copied().filter(|&t| t <= j).max().unwrap_or(first);
        let above = taken.iter().copied().filter(|&t| t > j).min().unwrap_or(end);
        if below < j && wall(below..j) && wall(j..above) {
            found.push(j);
            taken.push(j);
        }
    }
    found
}
