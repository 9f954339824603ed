//! How many vertices a regular layout has on each arc, and where they stand: as its neighbour's do.
//!
//! An example's vertices on an arc are given; a regular layout on the other side takes as many, in the same places. Where
//! both sides are regular, or the arc is part of the true boundary, the wanted length of edges tells. A layout of quads
//! has an even number of boundary edges (2E = 4F + B): odd segments are paired along arcs of which the counts are free,
//! and both sides of these get one edge more; where no such path leads out, one edge more stands against an example's, for
//! the seam to resolve. *Ours, not the paper's.*

use super::layout::{Arc, Layout, Occurrence};
use super::rim::Rim;
use crate::numerics::stop;
use std::collections::VecDeque;

/// What a regular segment asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wish {
    /// Length of its edges.
    pub edge: f64,
    /// Fewest edges on an arc: more keep narrow places apart.
    pub edges_min: usize,
    /// Most edges on an arc of the true boundary.
    pub edges_max: usize,
}

/// Most edges on an arc.
pub const EDGES_MAX: usize = 1200;

/// Places on a run: from its start on, both ends included where it is open.
pub type Places = Vec<f64>;

/// The boundary of a segment: an example's, which is given, or that of a regular layout to be made.
#[derive(Clone, Copy, Debug)]
pub enum SegmentBoundary<'a> {
    /// A part's boundary loops, on the segment's curves.
    Given(&'a [Rim]),
    /// A regular layout.
    Free(Wish),
}

/// For each regular segment, loop and run, where its vertices stand; nothing for the others.
pub fn plan(layout: &Layout, sides: &[SegmentBoundary<'_>]) -> Vec<Vec<Vec<Places>>> {
    stop::ask();
    let mut planner = Planner { layout, sides, counts: vec![[0, 0]; layout.arcs.len()] };
    for a in 0..layout.arcs.len() {
        planner.counts[a] = planner.wanted(a);
    }
    planner.pair_odd_segments();
    (0..sides.len())
        .map(|s| match sides[s] {
            SegmentBoundary::Given(_) => Vec::new(),
            SegmentBoundary::Free(_) => layout.curves[s]
                .iter()
                .enumerate()
                .map(|(l, curve)| {
                    (0..curve.runs.len()).map(|r| planner.places([s as u32, l as u32, r as u32])).collect()
                })
                .collect(),
        })
        .collect()
}

struct Planner<'a> {
    layout: &'a Layout,
    sides: &'a [SegmentBoundary<'a>],
    /// Edges on each side of each arc.
    counts: Vec<[usize; 2]>,
}

impl Planner<'_> {
    fn arc(&self, [s, l, r]: Occurrence) -> usize {
        self.layout.curves[s as usize][l as usize].runs[r as usize].arc as usize
    }

    fn length(&self, [s, l, r]: Occurrence) -> f64 {
        self.layout.curves[s as usize][l as usize].runs[r as usize].length
    }

    /// The length that tells how many vertices stand on a free arc: on the true boundary that without its jags.
    fn planned_length(&self, arc: &Arc, at: Occurrence) -> f64 {
        let curve = &self.layout.curves[at[0] as usize][at[1] as usize];
        if arc.sides.len() == 1 { curve.smooth_length(&curve.runs[at[2] as usize]) } else { self.length(at) }
    }

    fn is_closed(&self, [s, l, _]: Occurrence) -> bool {
        self.layout.curves[s as usize][l as usize].runs.first().is_none_or(|r| r.junction == u32::MAX)
    }

    fn wish(&self, [s, ..]: Occurrence) -> Option<Wish> {
        match self.sides[s as usize] {
            SegmentBoundary::Free(wish) => Some(wish),
            SegmentBoundary::Given(_) => None,
        }
    }

    fn given(&self, [s, l, r]: Occurrence) -> Option<usize> {
        match self.sides[s as usize] {
            SegmentBoundary::Given(rims) => rims.get(l as usize).map(|rim| rim.run_edges(r as usize)),
            SegmentBoundary::Free(_) => None,
        }
    }

    /// Whether the count of an arc is nobody's but regular layouts'.
    fn is_free(&self, arc: &Arc) -> bool {
        arc.sides.iter().all(|&side| self.wish(side).is_some())
    }

    fn wanted(&self, a: usize) -> [usize; 2] {
        let arc = &self.layout.arcs[a];
        let wishes: Vec<Wish> = arc.sides.iter().filter_map(|&s| self.wish(s)).collect();
        let Some(&first) = arc.sides.first() else { return [0, 0] };
        let closed = self.is_closed(first);
        let least = wishes.iter().map(|w| w.edges_min).max().unwrap_or(1).max(if closed { 4 } else { 1 });
        if self.is_free(arc) {
            let edge = wishes.iter().map(|w| w.edge).fold(f64::INFINITY, f64::min);
            let most = if let ([wish], 1) = (&wishes[..], arc.sides.len()) { wish.edges_max } else { EDGES_MAX };
            let n = ((self.planned_length(arc, first) / edge).round() as usize).min(most).max(least);
            return [n, n];
        }
        let given = arc.sides.iter().find_map(|&s| self.given(s)).unwrap_or(least);
        [0, 1].map(|k| match arc.sides.get(k) {
            Some(&side) if self.wish(side).is_some() => {
                // Times an odd number, so that no triangle is needed.
                let mut n = given.max(1);
                while n < least {
                    n = 3 * given.max(1) * (n / given.max(1));
                }
                n
            }
            _ => given,
        })
    }

    /// Edges that a regular segment has on all its loops.
    fn total(&self, s: usize) -> usize {
        let runs = self.layout.curves[s].iter().flat_map(|curve| &curve.runs);
        runs.map(|run| {
            let arc = run.arc as usize;
            let k = self.layout.arcs[arc].sides.iter().position(|side| side[0] as usize == s).unwrap_or(0);
            self.counts[arc][k]
        })
        .sum()
    }

    fn pair_odd_segments(&mut self) {
        let regular: Vec<usize> =
            (0..self.sides.len()).filter(|&s| matches!(self.sides[s], SegmentBoundary::Free(_))).collect();
        for &s in &regular {
            if self.total(s).is_multiple_of(2) {
                continue;
            }
            match self.way_out(s) {
                Some(path) => path.into_iter().for_each(|a| self.counts[a] = self.counts[a].map(|n| n + 1)),
                None => self.add_one(s),
            }
        }
    }

    /// Free arcs from an odd segment to another, or to the true boundary: the fewest.
    fn way_out(&self, start: usize) -> Option<Vec<usize>> {
        let mut came: Vec<Option<(usize, usize)>> = vec![None; self.sides.len()];
        let mut queue = VecDeque::from([start]);
        let trace = |came: &[Option<(usize, usize)>], mut s: usize, mut path: Vec<usize>| {
            while let Some((arc, before)) = came[s] {
                path.push(arc);
                s = before;
                if s == start {
                    break;
                }
            }
            path
        };
        while let Some(s) = queue.pop_front() {
            for run in self.layout.curves[s].iter().flat_map(|curve| &curve.runs) {
                let arc = &self.layout.arcs[run.arc as usize];
                if !self.is_free(arc) {
                    continue;
                }
                let other = arc.sides.iter().map(|side| side[0] as usize).find(|&x| x != s);
                match other {
                    None if arc.sides.len() == 1 => return Some(trace(&came, s, vec![run.arc as usize])),
                    Some(x) if x != start && came[x].is_none() => {
                        came[x] = Some((run.arc as usize, s));
                        if self.total(x) % 2 == 1 {
                            return Some(trace(&came, x, Vec::new()));
                        }
                        queue.push_back(x);
                    }
                    _ => {}
                }
            }
        }
        None
    }

    /// One edge more on a segment's arc with the most edges.
    fn add_one(&mut self, s: usize) {
        let mut own: Vec<(usize, usize, usize)> = Vec::new();
        for run in self.layout.curves[s].iter().flat_map(|curve| &curve.runs) {
            let a = run.arc as usize;
            let sides = &self.layout.arcs[a].sides;
            let Some(k) = sides.iter().position(|side| side[0] as usize == s) else { continue };
            if sides.iter().any(|side| side[0] as usize != s) {
                own.push((self.counts[a][k], a, k));
            }
        }
        if let Some(&(_, a, k)) = own.iter().max() {
            self.counts[a][k] += 1;
        }
    }

    fn places(&self, at: Occurrence) -> Places {
        let a = self.arc(at);
        let arc = &self.layout.arcs[a];
        let k = arc.sides.iter().position(|side| *side == at).unwrap_or(0);
        if arc.sides.len() == 1 {
            let curve = &self.layout.curves[at[0] as usize][at[1] as usize];
            let mut places = curve.even_places(&curve.runs[at[2] as usize], self.counts[a][k]);
            places.truncate(self.counts[a][k] + usize::from(!self.is_closed(at)));
            return places;
        }
        let (n, length, closed) = (self.counts[a][k], self.length(at), self.is_closed(at));
        let other = arc.sides.iter().find(|side| **side != at);
        let known = other.and_then(|&[s, l, r]| match self.sides[s as usize] {
            SegmentBoundary::Given(rims) => {
                let curve = self.layout.curves[s as usize].get(l as usize)?;
                Some((rims.get(l as usize)?.run(curve, r as usize).1, curve.runs.get(r as usize)?.length))
            }
            SegmentBoundary::Free(_) => None,
        });
        let even = |k: usize| length * k as f64 / n as f64;
        let Some((theirs, of)) = known.filter(|(p, _)| p.len() > 1) else {
            return (0..n + usize::from(!closed)).map(even).collect();
        };
        // Theirs, from our end.
        let scale = length / of.max(f64::MIN_POSITIVE);
        let mut back: Vec<f64> = theirs.iter().rev().map(|t| (of - t) * scale).collect();
        if closed {
            back.iter_mut().for_each(|t| *t = t.rem_euclid(length));
            back.sort_by(f64::total_cmp);
            back.push(back[0] + length);
        }
        let edges = back.len() - 1;
        let between = |x: f64| {
            let i = (x.floor() as usize).min(edges - 1);
            back[i] + (back[i + 1] - back[i]) * (x - i as f64)
        };
        (0..n + usize::from(!closed)).map(|k| between(k as f64 * edges as f64 / n as f64)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::layout::layout;
    use crate::topology::tests::grid;

    fn totals(places: &[Vec<Vec<Places>>], s: usize) -> usize {
        places[s].iter().flatten().map(|run| run.len() - 1).sum()
    }

    #[test]
    fn free_segments_agree_on_their_arcs_and_have_even_loops() {
        let mesh = grid(12, 12, false, false);
        let owner: Vec<u32> = (0..288u32)
            .map(|t| {
                let (i, j) = ((t / 2) % 12, (t / 2) / 12);
                if i < 5 { 0 } else { 1 + u32::from(j >= 7) }
            })
            .collect();
        let found = layout(&mesh, &owner, 3);
        for edge in [0.31, 0.21, 0.17, 0.13, 0.11, 0.09] {
            let sides = [SegmentBoundary::Free(Wish { edge, edges_min: 1, edges_max: EDGES_MAX }); 3];
            let places = plan(&found, &sides);
            for s in 0..3 {
                assert_eq!(totals(&places, s) % 2, 0, "segment {s}, edge {edge}");
            }
            for arc in found.arcs.iter().filter(|a| a.sides.len() == 2) {
                let [x, y] = [0, 1].map(|k| &places[arc.sides[k][0] as usize][0][arc.sides[k][2] as usize]);
                assert_eq!(x.len(), y.len());
                let length = x[x.len() - 1];
                assert!(x.iter().zip(y.iter().rev()).all(|(a, b)| (a + b - length).abs() < 1e-9));
            }
        }
    }

    #[test]
    fn a_layout_takes_the_places_of_the_example_beside_it() {
        let mesh = grid(8, 6, true, false);
        let owner: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| t / 48).collect();
        let found = layout(&mesh, &owner, 2);
        let rims: Vec<Rim> = found.curves[0]
            .iter()
            .map(|curve| Rim {
                vertices: (0..10).collect(),
                at: (0..10).map(|k| 0.01 + curve.length() * f64::from(k) / 10.0).collect(),
                starts: Vec::new(),
            })
            .collect();
        let places = plan(
            &found,
            &[
                SegmentBoundary::Given(&rims),
                SegmentBoundary::Free(Wish { edge: 1.0, edges_min: 1, edges_max: EDGES_MAX }),
            ],
        );
        let shared =
            (0..2).find(|&l| found.arcs[found.curves[1][l].runs[0].arc as usize].sides.len() == 2).expect("one");
        let length = found.curves[1][shared].length();
        let here = &places[1][shared][0];
        assert_eq!(here.len(), 10);
        for k in 0..10 {
            let theirs = length - (0.01 + length * f64::from(k) / 10.0);
            assert!(here.iter().any(|x| (x - theirs).abs() < 1e-9), "{theirs} in {here:?}");
        }
    }
}
