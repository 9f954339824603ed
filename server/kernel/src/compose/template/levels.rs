//! A chart's level sets as a regular layout needs them: how high each lies, how long it is, where its length is halved.
//!
//! The level sets of v are traced through the triangles. With C(v) the length of one and A(v) the area below it,
//! dH = dA/C is its mean height above the one before. Rings at even H, columns at even lengths along them, reach what rings
//! of equal area and columns at even u pass over: the tip of a thin protrusion, and protrusions beside the pole, which
//! take next to no room in (u, v). *Ours, not the paper's.*

use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::numerics::stop;
use crate::topology::Topology;
use crate::unfold::{Chart, Uv};

/// Levels that are traced, and at least.
const LEVELS: usize = 128;
const LEVELS_MIN: usize = 8;
/// A needle from the rim to the pole crosses every level, so that a fan of 100,000 held 700 MiB of pieces, and sorted them
/// (`service-2026-11-26`). So many crossings in all are usual, and a triangle: of an even mesh of n triangles a level crosses
/// about 2√n. Where there are more, fewer levels are traced. *Untuned.*
const USUAL_CROSSINGS: usize = 1 << 20;
const USUAL_CROSSINGS_EACH: usize = 16;
/// How far inside the domain its first and last levels are traced.
const INSIDE: f64 = 1e-6;
/// Halvings in which a place on a level is found.
const HALVINGS: usize = 36;

/// The traced level sets.
#[derive(Clone, Debug)]
pub struct Levels {
    v: Vec<f64>,
    height: Vec<f64>,
    around: Vec<f64>,
    /// For each level pairs of u and the share of its length up to there, both from 0 to 1.
    share: Vec<Vec<[f64; 2]>>,
}

/// A height between two levels: the lower one, and how far it is to the next.
type LevelPosition = (usize, f64);

/// A level within a triangle: from u to u, of a length.
type LevelPiece = [f64; 3];

fn mixed(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// The least and the greatest v of a triangle.
fn reach(corners: &[Uv; 3]) -> [f64; 2] {
    let v = || corners.iter().map(|c| c[1]);
    [v().fold(f64::INFINITY, f64::min), v().fold(f64::NEG_INFINITY, f64::max)]
}

/// The levels within a reach: the first, and the first beyond it.
fn crossed(v: &[f64], [low, high]: [f64; 2]) -> (usize, usize) {
    (v.partition_point(|&x| x < low), v.partition_point(|&x| x <= high))
}

/// The v of the levels that are traced.
fn levels_of(chart: &Chart) -> Vec<f64> {
    // A pole's area is even in v, its distance in √v: levels are as far apart as the surface is.
    let level = |x: f64| match chart.topology {
        Topology::Disc => 1.0 - (1.0 - x) * (1.0 - x),
        Topology::Sphere => 0.5 - 0.5 * (std::f64::consts::PI * x).cos(),
        Topology::Annulus | Topology::Torus => x,
    };
    let usual = USUAL_CROSSINGS.max(USUAL_CROSSINGS_EACH * chart.corners.len());
    let mut count = LEVELS;
    loop {
        let v: Vec<f64> = (0..=count).map(|l| level(l as f64 / count as f64)).collect();
        let crossings = |corners: &[Uv; 3]| {
            let (from, to) = crossed(&v, reach(corners));
            to - from
        };
        stop::pass(chart.corners.len());
        if count <= LEVELS_MIN || chart.corners.iter().map(crossings).sum::<usize>() <= usual {
            return v;
        }
        count /= 2;
    }
}

impl Levels {
    /// Traces a chart's.
    pub fn new(chart: &Chart) -> Self {
        let v = levels_of(chart);
        let count = v.len() - 1;
        let mut pieces: Vec<Vec<LevelPiece>> = vec![Vec::new(); count + 1];
        let mut bands = vec![0.0; count];
        for (t, corners) in chart.corners.iter().enumerate() {
            let [low, high] = reach(corners);
            let (from, to) = crossed(&v, [low, high]);
            stop::pass(1 + to - from);
            for l in from.saturating_sub(1)..(to + 1).min(count + 1) {
                let x = v[l].clamp(INSIDE, 1.0 - INSIDE);
                pieces[l].extend(crossing(&chart.mesh, t, corners, x));
                if let Some(&next) = v.get(l + 1) {
                    let overlap = high.min(next) - low.max(v[l]);
                    let share = if high > low { (overlap / (high - low)).max(0.0) } else { 0.0 };
                    bands[l] += chart.mesh.area(t) * share;
                }
            }
        }
        let (around, share): (Vec<f64>, Vec<_>) = pieces.into_iter().map(shares).unzip();
        let mut height = vec![0.0];
        for l in 0..count {
            let mean = 0.5 * (around[l] + around[l + 1]);
            height.push(height[l] + if mean > 0.0 { bands[l] / mean } else { 0.0 });
        }
        Self { v, height, around, share }
    }

    /// Height of the last level above the first.
    pub fn height(&self) -> f64 {
        self.height[self.height.len() - 1]
    }

    fn place(&self, height: f64) -> LevelPosition {
        let l = self.height.partition_point(|&x| x <= height).clamp(1, self.height.len() - 1) - 1;
        let step = self.height[l + 1] - self.height[l];
        (l, if step > 0.0 { ((height - self.height[l]) / step).clamp(0.0, 1.0) } else { 0.0 })
    }

    /// The v of a height.
    pub fn v(&self, height: f64) -> f64 {
        let (l, t) = self.place(height);
        mixed(self.v[l], self.v[l + 1], t)
    }

    /// Length of the level at a height.
    pub fn around(&self, height: f64) -> f64 {
        let (l, t) = self.place(height);
        mixed(self.around[l], self.around[l + 1], t)
    }

    /// The share of the level's length up to u; a period of u is one of the share.
    fn share(&self, (l, t): LevelPosition, u: f64) -> f64 {
        let turn = u.floor();
        turn + mixed(up_to(&self.share[l], u - turn), up_to(&self.share[l + 1], u - turn), t)
    }

    /// The u up to which a share of the level's length lies.
    fn u(&self, place: LevelPosition, share: f64) -> f64 {
        let turn = share.floor();
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.share(place, middle) <= share - turn { low = middle } else { high = middle }
        }
        turn + 0.5 * (low + high)
    }

    /// Moves columns of a ring, increasing over one period, by `weight` of the way to where they are evenly spaced along
    /// the level, turned so that they move least.
    pub fn even_out(&self, height: f64, columns: &mut [f64], weight: f64) {
        let place = self.place(height);
        let n = columns.len() as f64;
        let shares: Vec<f64> = columns.iter().map(|&u| self.share(place, u)).collect();
        let turn = shares.iter().enumerate().map(|(i, s)| s - i as f64 / n).sum::<f64>() / n;
        for (i, u) in columns.iter_mut().enumerate() {
            *u = self.u(place, mixed(shares[i], turn + i as f64 / n, weight));
        }
    }
}

/// The share up to u, of pairs in order.
fn up_to(pairs: &[[f64; 2]], u: f64) -> f64 {
    let k = pairs.partition_point(|p| p[0] <= u).clamp(1, pairs.len() - 1);
    let ([a, s], [b, t]) = (pairs[k - 1], pairs[k]);
    if b > a { mixed(s, t, ((u - a) / (b - a)).clamp(0.0, 1.0)) } else { s }
}

/// Where a level crosses a triangle, within one period: one piece, or two where it goes over the end of the period.
fn crossing(mesh: &TriMesh, t: usize, corners: &[Uv; 3], v: f64) -> Vec<LevelPiece> {
    let p = mesh.triangles[t].map(|v| mesh.positions[v as usize]);
    let mut ends: Vec<(f64, Vec3)> = Vec::with_capacity(2);
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        if (a[1] < v) != (b[1] < v) {
            let x = (v - a[1]) / (b[1] - a[1]);
            ends.push((mixed(a[0], b[0], x), p[k] + (p[(k + 1) % 3] - p[k]) * x));
        }
    }
    let &[(a, x), (b, y)] = &ends[..] else { return Vec::new() };
    let (low, high, length) = (a.min(b), a.max(b), (y - x).norm());
    let (low, high) = (low - low.floor(), high - low.floor());
    if high <= 1.0 {
        return vec![[low, high, length]];
    }
    let before = length * (1.0 - low) / (high - low);
    vec![[low, 1.0, before], [0.0, (high - 1.0).min(1.0), length - before]]
}

/// The length of a level, and the shares of it, from its pieces in any order. A level without length is even in u.
fn shares(mut pieces: Vec<LevelPiece>) -> (f64, Vec<[f64; 2]>) {
    pieces.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let total: f64 = pieces.iter().map(|p| p[2]).sum();
    if total <= 0.0 || !total.is_finite() {
        return (0.0, vec![[0.0, 0.0], [1.0, 1.0]]);
    }
    let mut pairs = vec![[0.0, 0.0]];
    let mut sum = 0.0;
    for [from, to, length] in pieces {
        let last = pairs[pairs.len() - 1][0];
        pairs.push([from.max(last), sum / total]);
        sum += length;
        pairs.push([to.max(from.max(last)), (sum / total).min(1.0)]);
    }
    pairs.push([1.0, 1.0]);
    (total, pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::index::PlanarIndex;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn heights_and_lengths_are_those_of_the_surface() {
        let patch = whole(&grid(32, 24, true, false)).expect("an annulus");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let levels = Levels::new(&chart);
        let loops = patch.mesh.boundary_loops();
        let p = |v: u32| patch.mesh.positions[v as usize];
        let length = |ring: &[u32]| -> f64 {
            ring.iter().map(|&h| (p(patch.mesh.head(h)) - p(patch.mesh.tail(h))).norm()).sum()
        };
        let ends = [levels.around(0.0), levels.around(levels.height())];
        for ring in &loops {
            assert!(ends.iter().any(|e| (e - length(ring)).abs() < 0.05 * length(ring)), "{ends:?}");
        }
        assert!((levels.v(0.5 * levels.height()) - 0.5).abs() < 0.1);
    }

    /// n needles about the pole of a disc.
    fn fan(n: u32) -> Chart {
        let turn = |i: u32| f64::from(i) / f64::from(n) * std::f64::consts::TAU;
        let mut positions = vec![Vec3::zeros()];
        positions.extend((0..n).map(|i| Vec3::new(turn(i).cos(), turn(i).sin(), 0.0)));
        let triangles = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
        let patch = whole(&TriMesh::from_triangles(positions, triangles).expect("a fan")).expect("a disc");
        unfold(&patch, &UnfoldOptions::default()).expect("solvable")
    }

    #[test]
    fn the_pieces_of_needles_are_no_more_than_usual_and_even_meshes_have_all_levels() {
        let of = |levels: &Levels| levels.share.iter().map(Vec::len).sum::<usize>();
        // Two pairs a crossing, and those of the ends; a needle beside the end of the period is crossed twice.
        let many = Levels::new(&fan(100_000));
        assert!(of(&many) < 4 * USUAL_CROSSINGS_EACH * 100_000, "{}", of(&many));
        let few = Levels::new(&fan(1_000));
        assert_eq!(few.share.len(), LEVELS + 1);
        // Needles taper from the rim to the pole; a band of theirs is measured as if they did not.
        assert!((many.height() - few.height()).abs() < 0.05 * few.height(), "{} {}", many.height(), few.height());
        let patch = whole(&grid(300, 300, false, false)).expect("a disc");
        let even = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        assert_eq!(Levels::new(&even).share.len(), LEVELS + 1);
    }

    #[test]
    fn columns_become_even_along_a_level() {
        let patch = whole(&grid(16, 16, false, false)).expect("a disc");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let index = PlanarIndex::new(&chart);
        let levels = Levels::new(&chart);
        let mut columns: Vec<f64> = (0..12).map(|i| 0.3 + (f64::from(i) / 12.0).powi(2)).collect();
        let height = 0.4 * levels.height();
        levels.even_out(height, &mut columns, 1.0);
        let at = |u: f64| index.locate(&chart, [u.rem_euclid(1.0), levels.v(height)]).point(&chart);
        let steps: Vec<f64> = (0..12).map(|i| (at(columns[(i + 1) % 12]) - at(columns[i])).norm()).collect();
        let mean = steps.iter().sum::<f64>() / 12.0;
        assert!(steps.iter().all(|s| (s - mean).abs() < 0.35 * mean), "{steps:?}");
    }
}
