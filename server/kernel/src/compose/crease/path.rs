//! The path of a net's edges that is to lie on a line.
//!
//! Among the paths within [`TUBE`]·h of the line that is sought for which the sum over edges u → v,
//! |uv|·(1 + [`AWAY`]·(d/h)²) + max(0, |uv| − Δs), is least, d their distance from the line and Δs what they gain along
//! it, and [`TURN`]·h more where two edges in a row belong to one face: that face's corner would be drawn straight.
//! *Ours, not the paper's.*

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use super::super::net::Net;
use super::lines::{Line, NearestOnLine};

/// How far a path may be from its line, in h.
const TUBE: f64 = 1.7;
/// Weight of the distance from the line.
const AWAY: f64 = 3.0;
/// What two edges of one face in a row cost, in h.
const TURN: f64 = 1.5;
/// A path's edges are within this factor of h on average.
const EDGE_RANGE: [f64; 2] = [0.35, 3.0];

/// Tells whether a path may pass a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupancy {
    /// It is free.
    Free,
    /// It lies on a corner or another line, or has to stay.
    Taken,
}

/// A state of the search: the last edge, and what led to it.
struct State {
    cost: f64,
    edge: [u32; 2],
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for State {}

impl PartialOrd for State {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for State {
    // The cheapest first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.edge.cmp(&self.edge))
    }
}

/// A path between two vertices, or around a closed line from a vertex to itself (then the vertex stands at both ends).
pub fn path(net: &Net, line: &Line, [from, to]: [u32; 2], taken: &[Occupancy]) -> Option<Vec<u32>> {
    let tube = tube(net, line, from);
    tube.get(&to)?;
    let search = Search { net, line, tube, ends: [from, to], taken };
    let path = search.run()?;
    let mean = line.length() / (path.len() - 1).max(1) as f64;
    let fits = mean >= EDGE_RANGE[0] * line.edge && mean <= EDGE_RANGE[1] * line.edge;
    fits.then_some(path)
}

/// The vertices near a line that can be reached from one without leaving it, with their nearest points.
fn tube(net: &Net, line: &Line, from: u32) -> BTreeMap<u32, NearestOnLine> {
    let near = |v: u32| line.nearest(net.positions[v as usize]);
    let mut found = BTreeMap::from([(from, near(from))]);
    let mut front = vec![from];
    while let Some(v) = front.pop() {
        for w in net.neighbours(v) {
            if found.contains_key(&w) {
                continue;
            }
            let at = near(w);
            if at.distance <= TUBE * line.edge.max(edge_at(net, w)) {
                found.insert(w, at);
                front.push(w);
            }
        }
    }
    found
}

/// Mean length of the edges at a vertex.
fn edge_at(net: &Net, v: u32) -> f64 {
    let beside = net.neighbours(v);
    let length = |w: &u32| (net.positions[*w as usize] - net.positions[v as usize]).norm();
    beside.iter().map(length).sum::<f64>() / beside.len().max(1) as f64
}

struct Search<'a> {
    net: &'a Net,
    line: &'a Line,
    tube: BTreeMap<u32, NearestOnLine>,
    ends: [u32; 2],
    taken: &'a [Occupancy],
}

impl Search<'_> {
    fn run(&self) -> Option<Vec<u32>> {
        let [from, to] = self.ends;
        let mut best: BTreeMap<[u32; 2], (f64, u32)> = BTreeMap::new();
        let mut heap = BinaryHeap::new();
        for w in self.net.neighbours(from) {
            if let Some(cost) = self.cost(from, w) {
                best.insert([from, w], (cost, u32::MAX));
                heap.push(State { cost, edge: [from, w] });
            }
        }
        while let Some(State { cost, edge: [u, v] }) = heap.pop() {
            if best.get(&[u, v]).is_none_or(|b| b.0 < cost) {
                continue;
            }
            if v == to {
                return self.traced(&best, [u, v]);
            }
            for w in self.net.neighbours(v) {
                if w == u {
                    continue;
                }
                let Some(edge) = self.cost(v, w) else { continue };
                let shares = self.net.at(v).iter().any(|&f| {
                    let c = self.net.face(f);
                    c.contains(&u) && c.contains(&w)
                });
                let next = cost + edge + if shares { TURN * self.line.edge } else { 0.0 };
                if best.get(&[v, w]).is_none_or(|b| next < b.0) {
                    best.insert([v, w], (next, u));
                    heap.push(State { cost: next, edge: [v, w] });
                }
            }
        }
        None
    }

    /// What an edge costs; `None` for one that can't be taken.
    fn cost(&self, v: u32, w: u32) -> Option<f64> {
        let [from, to] = self.ends;
        let (a, b) = (self.tube.get(&v)?, self.tube.get(&w)?);
        let is_free = |x: u32| x == to || self.taken.get(x as usize) == Some(&Occupancy::Free);
        if !is_free(w) || (w == from && from != to) {
            return None;
        }
        let length = self.line.length();
        let (start, mut end) = (if v == from { 0.0 } else { a.at }, if w == to { length } else { b.at });
        if from == to {
            // Around once: from its start into the first half, and back to it from the second.
            if v == from && b.at > 0.5 * length {
                return None;
            }
            if w == to && a.at < 0.5 * length {
                return None;
            }
            if v != from && w != to && (b.at - a.at).abs() > 0.5 * length {
                return None;
            }
            if w != to {
                end = b.at;
            }
        }
        let edge = (self.net.positions[w as usize] - self.net.positions[v as usize]).norm();
        let away = |x: u32, at: &NearestOnLine| if x == from || x == to { 0.0 } else { at.distance };
        let d = 0.5 * (away(v, a) + away(w, b)) / self.line.edge.max(edge);
        Some(edge * (1.0 + AWAY * d * d) + (edge - (end - start)).max(0.0))
    }

    /// The way back from the last edge; `None` if it passes a vertex twice.
    fn traced(&self, best: &BTreeMap<[u32; 2], (f64, u32)>, last: [u32; 2]) -> Option<Vec<u32>> {
        let mut path = vec![last[1], last[0]];
        let mut edge = last;
        while let Some(&(_, before)) = best.get(&edge).filter(|b| b.1 != u32::MAX) {
            path.push(before);
            edge = [before, edge[0]];
        }
        path.reverse();
        let mut inner: Vec<u32> = path[1..].to_vec();
        inner.sort_unstable();
        inner.windows(2).all(|pair| pair[0] != pair[1]).then_some(path)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lines::tests::folded;
    use super::*;
    use crate::mesh::Vec3;

    const SIDE: u32 = 12;

    /// The fold of a sheet along x = 1/2, and a net over it whose rows run a little aslant of the fold.
    fn fold() -> (Net, Line) {
        let (_, net, mut lines) = folded(SIDE, |p| p + Vec3::new(0.04 * (p.y - 0.5) + 0.01, 0.0, 0.0));
        let line = lines.lines.remove(0);
        (net, line)
    }

    fn column(x: u32) -> Vec<u32> {
        (0..=SIDE).map(|y| y * (SIDE + 1) + x).collect()
    }

    #[test]
    fn a_path_follows_the_column_beside_its_line() {
        let (net, line) = fold();
        let free = vec![Occupancy::Free; net.positions.len()];
        let middle = column(SIDE / 2);
        let ends = if line.nearest(net.positions[middle[0] as usize]).at < 0.5 { [0, 12] } else { [12, 0] };
        let mut wanted = middle.clone();
        if ends[0] == 12 {
            wanted.reverse();
        }
        assert_eq!(path(&net, &line, ends.map(|k| middle[k]), &free), Some(wanted));
    }

    #[test]
    fn a_path_goes_around_what_is_taken_and_is_none_where_all_is() {
        let (net, line) = fold();
        let mut taken = vec![Occupancy::Free; net.positions.len()];
        let middle = column(SIDE / 2);
        taken[middle[6] as usize] = Occupancy::Taken;
        let ends = [middle[0], middle[12]];
        let ends = if line.nearest(net.positions[ends[0] as usize]).at < 0.5 { ends } else { [ends[1], ends[0]] };
        let around = path(&net, &line, ends, &taken).expect("a way beside");
        assert!(!around.contains(&middle[6]) && around.len() > 13, "{around:?}");
        assert!(around.windows(2).all(|pair| net.joined(pair[0], pair[1])));
        (0..=SIDE).for_each(|x| taken[column(x)[6] as usize] = Occupancy::Taken);
        assert_eq!(path(&net, &line, ends, &taken), None);
    }
}
