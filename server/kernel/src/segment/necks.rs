//! Necks: where a protrusion is cut off.
//!
//! A tip stands out when it is high for its girth. It is cut off at the level set that is short for the area that it
//! bounds, where girth / area^0.8 is least along its stretch of the merge tree: at the mean of the levels there, weighed by
//! how near they are to the least, since of two places about as good a trifle would choose one; and once more wherever
//! the girth has a pronounced minimum (wrists, ankles).

use super::centrality::centrality;
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
    /// Least share of the area.
    area_min: f64,
}

impl Prominence {
    /// Limbs, fingers, ears: what one chart would squeeze.
    pub(super) const LIMBS: Self =
        Self { height_min: 0.035, slenderness_min: 0.30, stretch_min: 0.25, area_min: AREA_MIN };
    /// Stubs as well, for a number of parts that is asked for.
    pub(super) const STUBS: Self =
        Self { height_min: 0.025, slenderness_min: 0.12, stretch_min: 0.15, area_min: AREA_MIN };

    /// So many times as much asked of a protrusion.
    fn times(self, factor: f64) -> Self {
        Self {
            height_min: factor * self.height_min,
            slenderness_min: factor * self.slenderness_min,
            area_min: factor * self.area_min,
            ..self
        }
    }
}

/// Cuts keep this far from the saddle below, in √area, or a quarter of the stretch where that is less.
const MARGIN: f64 = 0.02;
/// Power of the area in what a neck minimises: with 1/2, a cone would be cut anywhere; with more, at its root.
const AREA_POWER: f64 = 0.8;
/// How much worse than the best, as a share, a level is that counts 1/e.
const TEMPERATURE: f64 = 0.05;
/// How much wider the surface is on both sides of a narrow place.
const NARROW: f64 = 1.3;
/// What is asked of a protrusion is this many times [`Prominence`], wherever between the two the surface's own
/// protrusions leave the widest gap: a finger is not one while its neighbours, a little shorter, are none.
const ASKED: [f64; 2] = [0.65, 1.0];
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
        let (neighbours, scale) = (mesh.neighbours(), Scale::of(&f));
        let surface = SurfaceFunction { mesh, f: &f, neighbours: &neighbours, scale: &scale };
        let (tree, profiles) = surface.standing_out(least.times(ASKED[0]));
        let strength = |a| strength(&tree, &profiles[a as usize], &scale, least, a);
        let strengths = (0..tree.arcs.len() as u32).filter(|&a| tree.is_live(a) && is_leaf(&tree, a)).map(strength);
        let least = least.times(widest_gap(strengths.collect(), ASKED));
        let (tree, profiles) = surface.standing_out(least);
        let found = necks(&tree, &profiles, &scale, least);
        Self { f, tree, found }
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

/// A function on a surface.
struct SurfaceFunction<'a> {
    mesh: &'a TriMesh,
    f: &'a [f64],
    neighbours: &'a [Vec<u32>],
    scale: &'a Scale,
}

impl SurfaceFunction<'_> {
    /// The tree of the tips that stand out, and what is measured of its arcs.
    fn standing_out(&self, least: Prominence) -> (Tree, Vec<Profile>) {
        let mut dropped = vec![false; self.f.len()];
        let mut round = 0;
        loop {
            let tree = Tree::new(self.f, self.neighbours, &dropped, PERSISTENCE_MIN);
            let profiles = tree.profiles(self.mesh, self.f, self.scale);
            let weak = weak_tips(&tree, &profiles, self.scale, least);
            if weak.is_empty() || round == ROUNDS_MAX {
                return (tree, profiles);
            }
            weak.into_iter().for_each(|tip| dropped[tip as usize] = true);
            round += 1;
        }
    }
}

/// How many times over a tip's arc is what is asked, where it is so most.
fn strength(tree: &Tree, profile: &Profile, scale: &Scale, asked: Prominence, a: u32) -> f64 {
    let at = |j: usize| {
        let height = tree.arcs[a as usize].high - scale.level(j);
        let (girth, area) = (profile.girth[j], profile.area[j]);
        let times =
            (height / asked.height_min).min(height / (asked.slenderness_min * girth)).min(area / asked.area_min);
        if girth > 0.0 && area <= 1.0 - AREA_MIN { times } else { 0.0 }
    };
    levels_of(tree, scale, a).map(at).fold(0.0, f64::max)
}

/// The middle of the widest gap that values leave within a range, by their ratio.
fn widest_gap(mut values: Vec<f64>, [low, high]: [f64; 2]) -> f64 {
    values.retain(|x| (low..=high).contains(x));
    values.extend([low, high]);
    values.sort_by(f64::total_cmp);
    let gaps = values.windows(2).map(|w| (w[1] / w[0], (w[0] * w[1]).sqrt()));
    gaps.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(high, |gap| gap.1)
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
        && (least.area_min..=1.0 - AREA_MIN).contains(&area)
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
        let Some(level) = neck_level(profile, scale, &levels) else { continue };
        found.push(Neck { arc: a, level, worth: top_of(tree, a) - level });
        let best = scale.below(level);
        for j in narrow_places(profile, &levels, best) {
            let height = tree.arcs[a as usize].high - scale.level(j);
            found.push(Neck { arc: a, level: scale.level(j), worth: 0.5 * height });
        }
    }
    found.sort_by(|x, y| y.worth.total_cmp(&x.worth).then(x.arc.cmp(&y.arc)).then(x.level.total_cmp(&y.level)));
    found
}

/// The mean of the levels, weighed by how tight the surface is there.
fn neck_level(profile: &Profile, scale: &Scale, levels: &[usize]) -> Option<f64> {
    let tightness = |j: &usize| profile.girth[*j] / profile.area[*j].min(1.0 - profile.area[*j]).powf(AREA_POWER);
    let least = levels.iter().map(tightness).min_by(f64::total_cmp)?;
    let weight = |j: &usize| (-(tightness(j) / least - 1.0) / TEMPERATURE).exp();
    let sum: f64 = levels.iter().map(weight).sum();
    Some(levels.iter().map(|j| weight(j) * scale.level(*j)).sum::<f64>() / sum)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_gap_is_told_by_ratios_and_within_the_range() {
        assert_eq!(widest_gap(vec![], [0.5, 2.0]), 1.0);
        let gap = widest_gap(vec![0.1, 0.55, 0.6, 0.9, 0.95, 1.1, 9.0], [0.5, 1.2]);
        assert!((gap - (0.6f64 * 0.9).sqrt()).abs() < 1e-12, "{gap}");
    }

    #[test]
    fn between_two_places_about_as_tight_the_neck_does_not_jump() {
        // A long tube whose girth has two minima, the one or the other a trifle tighter.
        let level = |trifle: f64| {
            let scale = Scale::of(&[0.0, 1.0]);
            let dip = |x: f64, at: f64| 0.3 * (-((x - at) / 0.06).powi(2)).exp();
            let girth = |j: usize| {
                let x = scale.level(j);
                1.0 - (1.0 + trifle) * dip(x, 0.4) - (1.0 - trifle) * dip(x, 0.6)
            };
            let profile = Profile { girth: (0..LEVELS).map(girth).collect(), area: vec![0.3; LEVELS] };
            neck_level(&profile, &scale, &(50..300).collect::<Vec<usize>>()).expect("levels")
        };
        assert!((level(0.01) - level(-0.01)).abs() < 0.05, "{} {}", level(0.01), level(-0.01));
        assert!((level(0.3) - 0.4).abs() < 0.02, "{}", level(0.3));
    }
}
