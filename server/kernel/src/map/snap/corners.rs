//! Where the corners of the example's boundary go on the input's.
//!
//! The turning of a boundary loop over a window of arc length, κ_i = ∠(x(s) − x(s−w), x(s+w) − x(s)), is large at a
//! corner and small elsewhere. On a ragged boundary it is large everywhere, and there are no corners. Corners are matched
//! to the nearest of the same sign along the mapped loop, each the other's nearest, in cyclic order; between them the
//! boundary's vertices are shifted linearly in arc length.

use super::super::boundary_loop::BoundaryLoop;
use super::{CrossMap, Targets};
use crate::mesh::tri::TriMesh;
use crate::unfold::Chart;

/// w, as a share of the loop's length.
const WINDOW: f64 = 0.03;
/// w in edges at least.
const WINDOW_EDGES: f64 = 2.0;
/// Turning that makes a corner, in degrees.
const TURN_DEG: f64 = 40.0;
/// How many times the turning that three quarters of the loop stay below.
const OVER_NOISE: f64 = 2.5;
/// A loop with more corners has none.
const CORNERS_MAX: usize = 12;
/// Farthest that a corner is moved, as a share of the loop's length.
const REACH: f64 = 0.06;

/// Says where boundary vertices go, and which of them go to a corner.
#[derive(Clone, Debug, Default)]
pub struct CornerTargets {
    /// Where boundary vertices go.
    pub targets: Targets,
    /// Those that go to a corner.
    pub corners: Vec<u32>,
}

/// Places for the boundary vertices of every loop of which corners are matched.
pub fn targets(mesh: &TriMesh, cross: &CrossMap, input: &Chart) -> CornerTargets {
    let there: Vec<BoundaryLoop> = rings(&input.mesh);
    let mut matched = CornerTargets::default();
    for own in rings(mesh) {
        let corners = own.corners(mesh);
        let Some(ring) = nearest_ring(&own, &there, mesh, cross, input) else { continue };
        let at: Vec<f64> = own
            .halfedges
            .iter()
            .map(|&h| ring.nearest(&input.mesh, cross.positions[mesh.tail(h) as usize]).0)
            .collect();
        let pairs = matches(&corners, &at, &ring.corners(&input.mesh), ring);
        if pairs.is_empty() {
            continue;
        }
        for (k, &h) in own.halfedges.iter().enumerate() {
            let shift = shift_at(at[k], &pairs, ring.length);
            if shift != 0.0 {
                matched.targets.insert(mesh.tail(h), ring.location(at[k] + shift));
            }
        }
        matched.corners.extend(pairs.iter().map(|p| mesh.tail(own.halfedges[p.own])));
        matched.targets.extend(pairs.iter().map(|p| (mesh.tail(own.halfedges[p.own]), ring.location(p.to))));
    }
    matched
}

/// A corner of a loop: the number of its halfedge, and the angle by which the loop turns there to the surface's side.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Corner {
    number: usize,
    turn_deg: f64,
}

fn rings(mesh: &TriMesh) -> Vec<BoundaryLoop> {
    let all = mesh.boundary_loops().into_iter().map(|halfedges| BoundaryLoop::new(mesh, halfedges));
    all.filter(|r| r.length > 0.0 && r.halfedges.len() > 3).collect()
}

impl BoundaryLoop {
    /// How far the loop turns at each vertex over ±`window`, in degrees, positive to the surface's side.
    fn turning(&self, mesh: &TriMesh, window: f64) -> Vec<f64> {
        let turn = |(&h, &s): (&u32, &f64)| {
            let x = mesh.positions[mesh.tail(h) as usize];
            let (before, after) = (x - self.at(mesh, s - window), self.at(mesh, s + window) - x);
            let side = mesh.area_vector(h as usize / 3).dot(&before.cross(&after));
            super::lines::bend(before, after).copysign(side)
        };
        self.halfedges.iter().zip(&self.starts).map(turn).collect()
    }

    /// The corners in order; none of a loop that turns everywhere.
    fn corners(&self, mesh: &TriMesh) -> Vec<Corner> {
        let window = (WINDOW * self.length).max(WINDOW_EDGES * self.length / self.halfedges.len() as f64);
        let turning = self.turning(mesh, window);
        let mut sizes: Vec<f64> = turning.iter().map(|t| t.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let noise = sizes.get(sizes.len() * 3 / 4).copied().unwrap_or(0.0);
        let least = TURN_DEG.max(OVER_NOISE * noise);
        let near = |a: usize, b: usize| {
            let d = (self.starts[a] - self.starts[b]).abs();
            d.min(self.length - d) <= window
        };
        let is_top = |k: &usize| {
            let own = turning[*k].abs();
            let higher = |j: usize| turning[j].abs() > own || (turning[j].abs() == own && j < *k);
            own >= least && !(0..turning.len()).any(|j| j != *k && near(j, *k) && higher(j))
        };
        let found: Vec<Corner> =
            (0..turning.len()).filter(is_top).map(|number| Corner { number, turn_deg: turning[number] }).collect();
        if found.len() > CORNERS_MAX { Vec::new() } else { found }
    }
}

/// The input's loop on which the mapped loop lies.
fn nearest_ring<'a>(
    own: &BoundaryLoop,
    there: &'a [BoundaryLoop],
    mesh: &TriMesh,
    cross: &CrossMap,
    input: &Chart,
) -> Option<&'a BoundaryLoop> {
    let away = |ring: &BoundaryLoop| {
        let far = |&h: &u32| {
            let x = cross.positions[mesh.tail(h) as usize];
            ring.nearest(&input.mesh, x).1
        };
        own.halfedges.iter().step_by(own.halfedges.len().div_ceil(16)).map(far).fold(0.0, f64::max)
    };
    let nearest = there.iter().map(|r| (away(r), r)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Only loops that lie on it.
    (nearest.0 <= 1e-6 * nearest.1.length).then_some(nearest.1)
}

/// A corner of the example, where it is on the input's loop, and where it goes.
struct Pair {
    own: usize,
    from: f64,
    to: f64,
}

/// The difference b − a along a loop, in ±half of it.
fn difference(a: f64, b: f64, length: f64) -> f64 {
    (b - a + 0.5 * length).rem_euclid(length) - 0.5 * length
}

/// Pairs of corners, in the order of `from`; none if they don't follow each other in the same order.
fn matches(own: &[Corner], at: &[f64], there: &[Corner], ring: &BoundaryLoop) -> Vec<Pair> {
    let place = |c: &Corner| ring.starts[c.number];
    let nearest = |from: f64, turn: f64| {
        let fits = |c: &&Corner| (c.turn_deg > 0.0) == (turn > 0.0);
        let away = |c: &Corner| difference(from, place(c), ring.length).abs();
        there.iter().filter(fits).min_by(|a, b| away(a).total_cmp(&away(b)))
    };
    let mut pairs: Vec<Pair> = Vec::new();
    for c in own {
        let from = at[c.number];
        let Some(to) = nearest(from, c.turn_deg).map(place) else { continue };
        let away = difference(from, to, ring.length).abs();
        let is_its_nearest = own
            .iter()
            .filter(|o| (o.turn_deg > 0.0) == (c.turn_deg > 0.0))
            .all(|o| difference(at[o.number], to, ring.length).abs() >= away);
        if away <= REACH * ring.length && is_its_nearest {
            pairs.push(Pair { own: c.number, from, to: from + difference(from, to, ring.length) });
        }
    }
    pairs.sort_by(|a, b| a.from.total_cmp(&b.from));
    let n = pairs.len();
    let in_order = (0..n).all(|k| {
        let (a, b) = (&pairs[k], &pairs[(k + 1) % n]);
        let turn = if k + 1 == n { ring.length } else { 0.0 };
        b.to + turn > a.to
    });
    if in_order { pairs } else { Vec::new() }
}

/// By how much the boundary is shifted at an arc length: linear between the pairs around it.
fn shift_at(s: f64, pairs: &[Pair], length: f64) -> f64 {
    let n = pairs.len();
    let k = pairs.partition_point(|p| p.from <= s);
    let (before, after) = (&pairs[(k + n - 1) % n], &pairs[k % n]);
    let shift = |p: &Pair| p.to - p.from;
    let span = if n == 1 { length } else { (after.from - before.from).rem_euclid(length) };
    let share = if span > 0.0 { ((s - before.from).rem_euclid(length) / span).clamp(0.0, 1.0) } else { 0.0 };
    if n == 1 {
        // To nothing on the other side of the loop.
        return shift(before) * (1.0 - 2.0 * share).abs();
    }
    shift(before) + share * (shift(after) - shift(before))
}
