//! A part's boundary loop laid along the curve of its segment, and its vertices chosen to stand at the junctions.
//!
//! The map puts boundary on boundary, so that a loop's vertices lie on the curve in order; where they don't, order is
//! enforced. Every junction takes the place of one vertex of each loop that passes it. Which one is a matter of a
//! neighbour more or less: it is chosen so that the two sides of an arc have like numbers of edges, of like parity.
//! *Ours, not the paper's.*

use super::layout::{Curve, Layout};
use super::net::Net;

/// Weight of each edge that one side of an arc has more than the other, of an odd number of them, and of a vertex moved
/// by one edge.
const COUNT_WEIGHT: f64 = 3.0;
const ODD_WEIGHT: f64 = 4.0;
const MOVE_WEIGHT: f64 = 1.5;
/// Rounds of choosing.
const ROUNDS: usize = 4;
/// Offsets tried where a loop's vertices don't lie on the curve in order.
const OFFSETS: usize = 96;

/// A boundary loop of a part on a curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Rim {
    /// The vertices, with the part on the left.
    pub vertices: Vec<u32>,
    /// Length from the curve's start to each vertex; increasing, over less than the curve's length in all.
    pub at: Vec<f64>,
    /// For each run of the curve the place in `vertices` of the vertex at its start; empty for a closed arc.
    pub starts: Vec<usize>,
}

/// Which way a loop runs along its curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopDirection {
    /// As it should.
    Along,
    /// Against it: the part's faces are turned over.
    Against,
}

/// Which curve each loop belongs to: those nearest to each other, each once. `None` if their numbers differ.
pub fn pair_loops(net: &Net, loops: &[Vec<u32>], curves: &[Curve]) -> Option<Vec<usize>> {
    if loops.len() != curves.len() {
        return None;
    }
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (i, ring) in loops.iter().enumerate() {
        for (j, curve) in curves.iter().enumerate() {
            let step = ring.len().div_ceil(24).max(1);
            let sample: Vec<f64> =
                ring.iter().step_by(step).map(|&v| curve.nearest(net.positions[v as usize]).1).collect();
            pairs.push((sample.iter().sum::<f64>() / sample.len().max(1) as f64, i, j));
        }
    }
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut curve_of = vec![usize::MAX; loops.len()];
    for (_, i, j) in pairs {
        if curve_of[i] == usize::MAX && !curve_of.contains(&j) {
            curve_of[i] = j;
        }
    }
    Some(curve_of)
}

/// Which way most of the loop's vertices follow the curve.
pub fn way(net: &Net, ring: &[u32], curve: &Curve) -> LoopDirection {
    let at: Vec<f64> = ring.iter().map(|&v| curve.nearest(net.positions[v as usize]).0).collect();
    if turns(&at, curve.length()) < 0.0 { LoopDirection::Against } else { LoopDirection::Along }
}

fn wrapped(d: f64, length: f64) -> f64 {
    d - length * (d / length).round()
}

fn turns(at: &[f64], length: f64) -> f64 {
    (0..at.len()).map(|k| wrapped(at[(k + 1) % at.len()] - at[k], length)).sum::<f64>() / length
}

/// Lays a loop along its curve.
pub fn lay(net: &Net, ring: &[u32], curve: &Curve) -> Rim {
    let length = curve.length().max(f64::MIN_POSITIVE);
    let n = ring.len();
    let nearest: Vec<f64> = ring.iter().map(|&v| curve.nearest(net.positions[v as usize]).0).collect();
    // Where the curve comes near itself a vertex may be put on its wrong side: those in order are believed.
    let starts = [0, n / 4, n / 2, 3 * n / 4];
    let chains = starts.map(|start| (start, longest_chain(&nearest, start, length)));
    let (start, chain) = chains.into_iter().max_by_key(|(start, c)| (c.len(), n - start)).unwrap_or_default();
    let at =
        if 2 * chain.len() > n { between(&nearest, start, &chain, length) } else { proportional(net, ring, curve) };
    let (first, least) = (at[0], 1e-6 * length / n as f64);
    let mut ordered = at;
    for k in 1..n {
        let most = first + length - least * (n - k) as f64;
        ordered[k] = ordered[k].clamp((ordered[k - 1] + least).min(most), most);
    }
    Rim { vertices: ring.to_vec(), at: ordered, starts: Vec::new() }
}

/// How far beyond the vertex `start` the vertex `start + k` lies on a curve of `length`.
fn beyond(at: &[f64], start: usize, k: usize, length: f64) -> f64 {
    (at[(start + k) % at.len()] - at[start]).rem_euclid(length)
}

/// The most vertices, counted from `start` on, that follow each other along the curve within one turn.
fn longest_chain(at: &[f64], start: usize, length: f64) -> Vec<usize> {
    // tails[l]: the last of the chain of l + 1 vertices that ends lowest.
    let (mut tails, mut before): (Vec<usize>, Vec<usize>) = (Vec::new(), vec![usize::MAX; at.len()]);
    for k in 0..at.len() {
        let x = beyond(at, start, k, length);
        let l = tails.partition_point(|&t| beyond(at, start, t, length) < x);
        before[k] = if l > 0 { tails[l - 1] } else { usize::MAX };
        if l == tails.len() { tails.push(k) } else { tails[l] = k }
    }
    let mut chain = Vec::new();
    let mut k = tails.last().copied().unwrap_or(usize::MAX);
    while k != usize::MAX {
        chain.push(k);
        k = before[k];
    }
    chain.reverse();
    chain
}

/// Lengths of all vertices from the first on, those outside the chain spaced evenly between their neighbours in it.
fn between(at: &[f64], start: usize, chain: &[usize], length: f64) -> Vec<f64> {
    let n = at.len();
    let mut all = vec![0.0; n];
    for (c, &k) in chain.iter().enumerate() {
        let x = beyond(at, start, k, length);
        let (next, y) = match chain.get(c + 1) {
            Some(&m) => (m, beyond(at, start, m, length)),
            None => (n + chain[0], length + beyond(at, start, chain[0], length)),
        };
        for m in k..next {
            let s = x + (y - x) * (m - k) as f64 / (next - k) as f64;
            // The turn begins at vertex 0, wherever the chain does.
            let turn = ((start + m) / n) as f64;
            all[(start + m) % n] = at[start] + s - length * turn;
        }
    }
    all
}

/// By the loop's own lengths, at the offset at which it comes nearest to the curve.
fn proportional(net: &Net, ring: &[u32], curve: &Curve) -> Vec<f64> {
    let p = |k: usize| net.positions[ring[k % ring.len()] as usize];
    let mut own = vec![0.0];
    for k in 0..ring.len() {
        own.push(own[k] + (p(k + 1) - p(k)).norm());
    }
    let scale = curve.length() / own[ring.len()].max(f64::MIN_POSITIVE);
    let misfit = |offset: f64| -> f64 {
        (0..ring.len()).map(|k| (curve.point(offset + own[k] * scale) - p(k)).norm_squared()).sum()
    };
    let offsets = (0..OFFSETS).map(|k| curve.length() * k as f64 / OFFSETS as f64);
    let best = offsets.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap_or(0.0);
    (0..ring.len()).map(|k| best + own[k] * scale).collect()
}

/// Chooses the vertices at the junctions: distinct, in order, least moved. False if there are too few vertices.
pub fn place_junctions(rim: &mut Rim, curve: &Curve) -> bool {
    let targets: Vec<f64> = curve.runs.iter().filter(|r| r.junction != u32::MAX).map(|r| r.start).collect();
    let (n, q) = (rim.vertices.len(), targets.len());
    if q == 0 {
        return true;
    }
    if n < q {
        return false;
    }
    let length = curve.length();
    let moved = |i: usize, k: usize| wrapped(rim.at[i % n] - targets[k], length).powi(2);
    let nearest = (0..n).min_by(|&i, &j| moved(i, 0).total_cmp(&moved(j, 0))).unwrap_or(0);
    let mut best: Option<(f64, Vec<usize>)> = None;
    for first in [0, 1, n - 1, 2 % n, (2 * n - 2) % n].map(|d| (nearest + d) % n) {
        // cost[k][d]: junctions up to k placed, the last at `first + d` or before.
        let mut cost = vec![vec![f64::INFINITY; n]; q];
        let mut choice = vec![vec![0; n]; q];
        cost[0].fill(moved(first, 0));
        for k in 1..q {
            for d in k..n {
                let here = cost[k - 1][d - 1] + moved(first + d, k);
                let before = cost[k][d - 1];
                (cost[k][d], choice[k][d]) = if here < before { (here, d) } else { (before, choice[k][d - 1]) };
            }
        }
        let total = cost[q - 1][n - 1];
        if total.is_finite() && best.as_ref().is_none_or(|b| total < b.0) {
            let mut places = vec![0; q];
            let mut d = n - 1;
            for k in (1..q).rev() {
                places[k] = choice[k][d];
                d = places[k].saturating_sub(1);
            }
            best = Some((total, places.into_iter().map(|d| (first + d) % n).collect()));
        }
    }
    rim.starts = best.map(|b| b.1).unwrap_or_default();
    rim.starts.len() == q
}

/// Edges between two places of a rim, going forward.
fn edges_between(n: usize, from: usize, to: usize) -> usize {
    let d = (to + n - from) % n;
    if d == 0 { n } else { d }
}

impl Rim {
    /// The vertices of a run, both ends included, with their lengths from the run's start. For a closed arc, those of the
    /// whole loop, without a last one.
    pub fn run(&self, curve: &Curve, run: usize) -> (Vec<u32>, Vec<f64>) {
        let n = self.vertices.len();
        if self.starts.is_empty() {
            return (self.vertices.clone(), self.at.clone());
        }
        let (from, to) = (self.starts[run], self.starts[(run + 1) % self.starts.len()]);
        let count = edges_between(n, from, to);
        let places = (0..=count).map(|d| (from + d) % n);
        let Some(arc) = curve.runs.get(run) else { return Default::default() };
        let mut at: Vec<f64> = places
            .clone()
            .map(|i| {
                let s = wrapped(self.at[i] - arc.start - 0.5 * arc.length, curve.length()) + 0.5 * arc.length;
                s.clamp(0.0, arc.length)
            })
            .collect();
        at[0] = 0.0;
        at[count] = arc.length;
        (places.map(|i| self.vertices[i]).collect(), at)
    }

    /// Edges of a run.
    pub fn run_edges(&self, run: usize) -> usize {
        let n = self.vertices.len();
        match self.starts.len() {
            0 => n,
            q => edges_between(n, self.starts[run], self.starts[(run + 1) % q]),
        }
    }
}

/// Moves junctions by a vertex or two where that makes the two sides of the arcs alike. `rims[s][l]` lies on
/// `layout.curves[s][l]`; segments that are yet to be laid out have none.
pub fn even_out(rims: &mut [Vec<Rim>], layout: &Layout) {
    for _ in 0..ROUNDS {
        let mut changed = 0;
        for s in 0..rims.len() {
            for l in 0..rims[s].len() {
                for k in 0..rims[s][l].starts.len() {
                    changed += usize::from(move_one(rims, layout, [s, l, k]));
                }
            }
        }
        if changed == 0 {
            break;
        }
    }
}

fn move_one(rims: &mut [Vec<Rim>], layout: &Layout, [s, l, k]: [usize; 3]) -> bool {
    let (n, q, old) = (rims[s][l].vertices.len(), rims[s][l].starts.len(), rims[s][l].starts[k]);
    let before = (k + q - 1) % q;
    let mut best = (badness(rims, layout, [s, l, k]), old);
    for d in [1, n - 1, 2, (2 * n - 2) % n] {
        let place = (old + d) % n;
        // It must stay strictly between its neighbours.
        let ahead = edges_between(n, old, rims[s][l].starts[(k + 1) % q]);
        let behind = edges_between(n, rims[s][l].starts[before], old);
        let fits = if d <= 2 { d < ahead } else { n - d < behind };
        if !fits || place == old {
            continue;
        }
        rims[s][l].starts[k] = place;
        let found = badness(rims, layout, [s, l, k]);
        rims[s][l].starts[k] = old;
        if found + 1e-9 < best.0 {
            best = (found, place);
        }
    }
    rims[s][l].starts[k] = best.1;
    best.1 != old
}

/// How unlike the sides of the two arcs at a junction are, and how far its vertex has to move.
fn badness(rims: &[Vec<Rim>], layout: &Layout, [s, l, k]: [usize; 3]) -> f64 {
    let (rim, curve) = (&rims[s][l], &layout.curves[s][l]);
    let q = rim.starts.len();
    let mean = curve.length() / rim.vertices.len() as f64;
    let moved = wrapped(rim.at[rim.starts[k]] - curve.runs[k].start, curve.length()) / mean;
    let mut sum = MOVE_WEIGHT * moved * moved;
    for run in [k, (k + q - 1) % q] {
        let arc = &layout.arcs[curve.runs[run].arc as usize];
        if let [a, b] = arc.sides[..] {
            let edges = |[s, l, r]: [u32; 3]| Some(rims[s as usize].get(l as usize)?.run_edges(r as usize));
            // A regular layout beside it takes what comes.
            let (Some(x), Some(y)) = (edges(a), edges(b)) else { continue };
            let difference = x.abs_diff(y);
            sum += COUNT_WEIGHT * difference as f64 + ODD_WEIGHT * (difference % 2) as f64;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::layout::layout;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    fn square(n: u32) -> (Net, Curve) {
        let mesh = grid(7, 7, false, false);
        let curve = layout(&mesh, &[0; 98], 1).curves[0].remove(0);
        let mut net = sheet(n, n);
        net.positions.iter_mut().for_each(|p| *p /= f64::from(n));
        (net, curve)
    }

    #[test]
    fn a_loop_lies_along_its_curve_in_order() {
        let (net, curve) = square(5);
        let ring = net.loops().expect("one").remove(0);
        assert_eq!(way(&net, &ring, &curve), LoopDirection::Along);
        let rim = lay(&net, &ring, &curve);
        assert!(rim.at.windows(2).all(|w| w[0] < w[1]));
        assert!((rim.at[19] - rim.at[0] - 3.8).abs() < 1e-9);
        let back: Vec<u32> = ring.iter().rev().copied().collect();
        assert_eq!(way(&net, &back, &curve), LoopDirection::Against);
    }

    #[test]
    fn a_vertex_on_the_wrong_side_of_a_narrow_place_is_put_back_in_order() {
        let true_at: Vec<f64> = (0..40).map(|k| 0.1 + f64::from(k) * 0.25).collect();
        for wrong in [0, 1, 13, 39] {
            let mut at = true_at.clone();
            at[wrong] = (at[wrong] + 4.3) % 10.0;
            for start in [0, 10, 20, 30] {
                if start == wrong {
                    continue;
                }
                let chain = longest_chain(&at, start, 10.0);
                assert!(chain.len() >= 39, "{wrong} {start} {}", chain.len());
                let found = between(&at, start, &chain, 10.0);
                for k in 0..39 {
                    let step = found[k + 1] - found[k];
                    assert!((step - 0.25).abs() < 1e-9, "{wrong} {start} {k}: {step}");
                }
            }
        }
    }

    #[test]
    fn junctions_take_distinct_vertices_in_order() {
        let (net, mut curve) = square(3);
        let ring = net.loops().expect("one").remove(0);
        let mut rim = lay(&net, &ring, &curve);
        curve.runs = [0.0, 0.05, 0.1, 2.0]
            .iter()
            .enumerate()
            .map(|(k, &start)| super::super::layout::Run { arc: 0, start, length: 1.0, junction: k as u32 })
            .collect();
        assert!(place_junctions(&mut rim, &curve));
        let mut distinct = rim.starts.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), 4);
        let total: usize = (0..4).map(|r| rim.run_edges(r)).sum();
        assert_eq!(total, 12);
    }
}
