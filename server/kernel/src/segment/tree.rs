//! The merge tree of a function: how the parts of the surface above a level join as the level sinks.
//!
//! A part is born at a maximum (a tip) and two become one at a saddle. An arc of the tree is a family of level sets that
//! grow into each other: a stretch of a limb. What does not stand out is a
//! twig: it flows into its elder somewhere along it, and ends no arc.
//! *Source:* Carr, Snoeyink and Axen (2003), the join tree; Edelsbrunner, Letscher and Zomorodian (2002), persistence.

use super::centrality::vertex_areas;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;

/// Levels at which girths are measured.
pub(super) const LEVELS: usize = 384;

/// A stretch of the surface between a tip or saddle above and a saddle below.
#[derive(Clone, Debug)]
pub(super) struct TreeArc {
    /// f at its upper end.
    pub(super) high: f64,
    /// f at its lower end.
    pub(super) low: f64,
    /// The tip that gave birth to it, the highest where several did.
    pub(super) tip: u32,
    /// The arc that it flows into; [`NONE`] at the root.
    pub(super) below: u32,
    /// The arcs that flow into it; none for a tip's.
    pub(super) above: Vec<u32>,
}

/// The tree, and the arc on which each vertex lies.
#[derive(Debug)]
pub(super) struct Tree {
    pub(super) arcs: Vec<TreeArc>,
    pub(super) arc_of: Vec<u32>,
    /// Whether each arc stands out, rather than flowing into an elder somewhere along it.
    live: Vec<bool>,
}

/// What is measured of an arc at each of [`LEVELS`] levels; empty for a twig.
#[derive(Clone, Debug)]
pub(super) struct Profile {
    /// Length of the level set; 0 beyond the arc.
    pub(super) girth: Vec<f64>,
    /// Area above it.
    pub(super) area: Vec<f64>,
}

/// Union–find over vertices, each root with its component's arc and tip.
struct Sweep<'a> {
    f: &'a [f64],
    dropped: &'a [bool],
    persistence_min: f64,
    leader: Vec<u32>,
    arc: Vec<u32>,
    arcs: Vec<TreeArc>,
    /// Arcs that do not stand out: they flow into an elder somewhere along it.
    twig: Vec<bool>,
}

impl Tree {
    /// Sweeps from the top. Tips whose part joins an older one less than `persistence_min` below them are absorbed, and
    /// so are the `dropped` ones.
    pub(super) fn new(f: &[f64], neighbours: &[Vec<u32>], dropped: &[bool], persistence_min: f64) -> Self {
        let mut order: Vec<u32> = (0..f.len() as u32).collect();
        order.sort_by(|&a, &b| f[b as usize].total_cmp(&f[a as usize]).then(a.cmp(&b)));
        let n = f.len();
        let (leader, arc) = (vec![NONE; n], vec![NONE; n]);
        let mut sweep = Sweep { f, dropped, persistence_min, leader, arc, arcs: Vec::new(), twig: Vec::new() };
        for &v in &order {
            stop::pass(1);
            let mut met: Vec<u32> = Vec::new();
            for &w in &neighbours[v as usize] {
                if sweep.leader[w as usize] != NONE {
                    let root = sweep.find(w);
                    if !met.contains(&root) {
                        met.push(root);
                    }
                }
            }
            sweep.add(v, &met);
        }
        let arc_of = sweep.arc;
        let live: Vec<bool> = sweep.twig.iter().map(|twig| !twig).collect();
        let mut arcs = sweep.arcs;
        for a in 0..arcs.len() as u32 {
            let below = arcs[a as usize].below;
            if below != NONE && live[a as usize] {
                arcs[below as usize].above.push(a);
            }
        }
        Self { arcs, arc_of, live }
    }

    /// Whether an arc stands out.
    pub(super) fn is_live(&self, a: u32) -> bool {
        self.live[a as usize]
    }

    /// The arc that the level set at `level` around arc `a` belongs to.
    pub(super) fn at_level(&self, mut a: u32, level: f64) -> u32 {
        while self.arcs[a as usize].low > level && self.arcs[a as usize].below != NONE {
            a = self.arcs[a as usize].below;
        }
        a
    }

    /// Girth and area of every arc at the levels of `scale`; lengths in units of √`area`, areas of `area`.
    pub(super) fn profiles(&self, mesh: &TriMesh, f: &[f64], scale: &Scale) -> Vec<Profile> {
        let total = mesh.total_area();
        let unit = total.sqrt().max(1e-300);
        let levels = |live: &bool| if *live { vec![0.0; LEVELS] } else { Vec::new() };
        let mut profiles: Vec<Profile> =
            self.live.iter().map(|live| Profile { girth: levels(live), area: levels(live) }).collect();
        for corners in &mesh.triangles {
            stop::pass(8);
            self.measure(mesh, f, scale, *corners, unit, &mut profiles);
        }
        for (v, mass) in vertex_areas(mesh).into_iter().enumerate() {
            stop::pass(8);
            let mut a = self.arc_of[v];
            for j in (0..=scale.below(f[v])).rev() {
                a = self.at_level(a, scale.level(j));
                if let Some(area) = profiles[a as usize].area.get_mut(j) {
                    *area += mass / total;
                }
            }
        }
        for profile in &mut profiles {
            profile.girth = smoothed(&profile.girth);
        }
        profiles
    }

    /// Adds the level sets within one triangle.
    fn measure(&self, mesh: &TriMesh, f: &[f64], scale: &Scale, corners: [u32; 3], unit: f64, into: &mut [Profile]) {
        let mut v = corners;
        v.sort_by(|&a, &b| f[b as usize].total_cmp(&f[a as usize]).then(a.cmp(&b)));
        let [high, middle, low] = v.map(|x| f[x as usize]);
        let [p, q, r] = v.map(|x| mesh.positions[x as usize]);
        let mut a = self.arc_of[v[0] as usize];
        for j in (0..=scale.below(high)).rev() {
            let level = scale.level(j);
            if level < low {
                break;
            }
            let along = |from: f64, to: f64| (from - level) / (from - to).max(1e-300);
            let on_long = p + (r - p) * along(high, low).clamp(0.0, 1.0);
            let other = match level >= middle {
                true => p + (q - p) * along(high, middle).clamp(0.0, 1.0),
                false => q + (r - q) * along(middle, low).clamp(0.0, 1.0),
            };
            a = self.at_level(a, level);
            if let Some(girth) = into[a as usize].girth.get_mut(j) {
                *girth += (on_long - other).norm() / unit;
            }
        }
    }
}

/// The levels: evenly spread over the values of f.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    low: f64,
    step: f64,
}

impl Scale {
    pub(super) fn of(f: &[f64]) -> Self {
        let low = f.iter().copied().fold(f64::INFINITY, f64::min);
        let high = f.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self { low, step: ((high - low) / LEVELS as f64).max(1e-300) }
    }

    pub(super) fn level(&self, j: usize) -> f64 {
        self.low + (j as f64 + 0.5) * self.step
    }

    /// The highest level not above `x`; 0 where there is none.
    pub(super) fn below(&self, x: f64) -> usize {
        (((x - self.low) / self.step - 0.5).max(0.0) as usize).min(LEVELS - 1)
    }
}

/// Mean over five levels, of those that are not 0.
fn smoothed(x: &[f64]) -> Vec<f64> {
    let mean = |j: usize| {
        if x[j] <= 0.0 {
            return 0.0;
        }
        let near = x[j.saturating_sub(2)..(j + 3).min(x.len())].iter().filter(|x| **x > 0.0);
        let (sum, count) = near.fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
        sum / count
    };
    (0..x.len()).map(mean).collect()
}

impl Sweep<'_> {
    fn find(&mut self, v: u32) -> u32 {
        let mut root = v;
        while self.leader[root as usize] != root {
            root = self.leader[root as usize];
        }
        let mut x = v;
        while self.leader[x as usize] != root {
            x = std::mem::replace(&mut self.leader[x as usize], root);
        }
        root
    }

    fn new_arc(&mut self, high: f64, tip: u32) -> u32 {
        let arc = self.arcs.len() as u32;
        self.arcs.push(TreeArc { high, low: f64::NEG_INFINITY, tip, below: NONE, above: Vec::new() });
        self.twig.push(false);
        arc
    }

    /// Adds the next vertex, at which the components with the given roots meet. `arc` of a root is its current arc.
    fn add(&mut self, v: u32, met: &[u32]) {
        let level = self.f[v as usize];
        let arcs_met: Vec<u32> = met.iter().map(|&r| self.arc[r as usize]).collect();
        let tip_of = |s: &Self, a: u32| s.arcs[a as usize].tip;
        let elder = arcs_met.iter().copied().min_by(|&a, &b| {
            let (x, y) = (tip_of(self, a), tip_of(self, b));
            let dropped = self.dropped[x as usize].cmp(&self.dropped[y as usize]);
            dropped.then(self.f[y as usize].total_cmp(&self.f[x as usize])).then(x.cmp(&y))
        });
        let Some(elder) = elder else {
            self.leader[v as usize] = v;
            self.arc[v as usize] = self.new_arc(level, v);
            return;
        };
        let stands_out = |s: &Self, a: u32| {
            let tip = tip_of(s, a) as usize;
            !s.dropped[tip] && s.f[tip] - level >= s.persistence_min
        };
        let tip = tip_of(self, elder);
        let grown: Vec<u32> = arcs_met.iter().copied().filter(|&a| a != elder && stands_out(self, a)).collect();
        let current = match grown.is_empty() {
            true => elder,
            false => {
                let arc = self.new_arc(level, tip);
                for a in grown.iter().copied().chain([elder]) {
                    (self.arcs[a as usize].low, self.arcs[a as usize].below) = (level, arc);
                }
                arc
            }
        };
        for &a in arcs_met.iter().filter(|&&a| a != elder && !grown.contains(&a)) {
            (self.arcs[a as usize].low, self.arcs[a as usize].below) = (level, current);
            self.twig[a as usize] = true;
        }
        // The root keeps its own vertex's arc, so a fresh root is made of the new vertex.
        self.leader[v as usize] = v;
        self.arc[v as usize] = current;
        met.iter().for_each(|&r| self.leader[r as usize] = v);
        self.arcs[current as usize].low = f64::NEG_INFINITY;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A sheet with three bumps of heights 1, 0.8 and 0.05.
    fn bumps() -> (TriMesh, Vec<f64>) {
        let mesh = grid(40, 40, false, false);
        let bump =
            |p: &crate::mesh::Vec3, x: f64, y: f64, h: f64| h * (-60.0 * ((p.x - x).powi(2) + (p.y - y).powi(2))).exp();
        let f =
            mesh.positions.iter().map(|p| bump(p, 0.2, 0.2, 1.0) + bump(p, 0.8, 0.5, 0.8) + bump(p, 0.2, 0.8, 0.05));
        let f = f.collect();
        (mesh, f)
    }

    #[test]
    fn two_tips_stand_out_and_the_third_is_absorbed() {
        let (mesh, f) = bumps();
        let tree = Tree::new(&f, &mesh.neighbours(), &vec![false; f.len()], 0.1);
        let leaves: Vec<&TreeArc> = (0..tree.arcs.len() as u32)
            .filter(|&a| tree.is_live(a))
            .map(|a| &tree.arcs[a as usize])
            .filter(|a| a.above.is_empty())
            .collect();
        let mut heights: Vec<f64> = leaves.iter().map(|a| a.high).collect();
        heights.sort_by(f64::total_cmp);
        assert_eq!(heights.len(), 2);
        assert!((heights[0] - 0.8).abs() < 0.01 && (heights[1] - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_dropped_tip_leaves_no_arc() {
        let (mesh, f) = bumps();
        let mut dropped = vec![false; f.len()];
        let top = (0..f.len()).max_by(|&a, &b| f[a].total_cmp(&f[b])).unwrap_or(0);
        dropped[top] = true;
        let tree = Tree::new(&f, &mesh.neighbours(), &dropped, 0.1);
        assert_eq!((0..tree.arcs.len() as u32).filter(|&a| tree.is_live(a)).count(), 1);
    }

    #[test]
    fn girth_of_a_cone_is_its_circle() {
        let (mesh, _) = bumps();
        let f: Vec<f64> = mesh.positions.iter().map(|p| 1.0 - (p.x - 0.5).hypot(p.y - 0.5)).collect();
        let tree = Tree::new(&f, &mesh.neighbours(), &vec![false; f.len()], 0.1);
        let scale = Scale::of(&f);
        let profile = &tree.profiles(&mesh, &f, &scale)[tree.arc_of[0] as usize];
        let j = scale.below(0.7);
        assert!((profile.girth[j] - std::f64::consts::TAU * 0.3).abs() < 0.03, "{}", profile.girth[j]);
        assert!((profile.area[j] - std::f64::consts::PI * 0.09).abs() < 0.02, "{}", profile.area[j]);
    }
}
