//! Vertices on lines and those around come to rest.
//!
//! A vertex on a line slides along it: half of the way to the mean of its neighbours, as far as it is seen along the line,
//! and half of the way to the middle between the two beside it on the line, and never past them. What is around follows,
//! x_v ← π(x_v + w_v·((1 − e)·(mean of its neighbours' moves − its own) + e·(mean of its neighbours − x_v))), w_v less
//! with each edge of distance: for e = 0 the layout is only bent, for e = 1 it is smoothed, and shrinks.
//! *Ours, not the paper's.*

use super::super::net::Net;
use super::super::smooth::Target;
use super::lines::Line;
use crate::mesh::Vec3;

/// Edges around lines within which vertices follow, and how much those beside them do.
const REACH: usize = 5;
const STEP: f64 = 0.8;
/// Share of the mean of the neighbours in that; the rest is the mean of their moves.
const EVEN: f64 = 0.25;
/// Least distance of vertices on a line, as a share of their mean distance.
const GAP: f64 = 0.4;
/// Share of the way that a vertex slides in a round.
const SLIDE: f64 = 0.4;

/// A line with the vertices that lie on it.
#[derive(Clone, Debug)]
pub struct LaidLine {
    /// The line.
    pub line: Line,
    /// Vertices in order; on a closed line the first stands last, too.
    pub path: Vec<u32>,
    /// Their arc lengths.
    pub at: Vec<f64>,
}

impl LaidLine {
    /// A path on a line, its vertices at their nearest points as far as they are in order.
    pub fn new(net: &Net, line: Line, path: Vec<u32>) -> Self {
        let mut at: Vec<f64> = path.iter().map(|&v| line.nearest(net.positions[v as usize]).at).collect();
        if let Some(first) = at.first_mut() {
            *first = 0.0;
        }
        if let Some(last) = at.last_mut() {
            *last = line.length();
        }
        let mut met = Self { line, path, at };
        met.keep_order();
        met
    }

    fn gap(&self) -> f64 {
        GAP * self.line.length() / (self.path.len() - 1).max(1) as f64
    }

    /// Holds the vertices in order, with room between them.
    fn keep_order(&mut self) {
        let (n, gap) = (self.at.len(), self.gap());
        for k in 1..n.saturating_sub(1) {
            let left = (n - 1 - k) as f64;
            let most = self.line.length() - left * gap;
            self.at[k] = self.at[k].clamp(0.0, most.max(0.0)).max(self.at[k - 1] + gap);
        }
        for k in (1..n.saturating_sub(1)).rev() {
            self.at[k] = self.at[k].min(self.at[k + 1] - gap);
        }
    }

    /// Puts its vertices onto the line.
    pub fn place(&self, net: &mut Net) {
        for (&v, &at) in self.path.iter().zip(&self.at) {
            net.positions[v as usize] = self.line.point(at);
        }
    }

    fn slide(&mut self, net: &Net) {
        let n = self.path.len();
        let before = self.at.clone();
        for k in 1..n.saturating_sub(1) {
            let v = self.path[k];
            let x = self.line.point(before[k]);
            let along = self.line.point(before[k + 1]) - self.line.point(before[k - 1]);
            let along = along.try_normalize(0.0).unwrap_or_default();
            let beside = net.neighbours(v);
            let mean = beside.iter().map(|&w| net.positions[w as usize]).sum::<Vec3>() / beside.len().max(1) as f64;
            let even = 0.5 * (before[k - 1] + before[k + 1]) - before[k];
            self.at[k] += SLIDE * 0.5 * ((mean - x).dot(&along) + even);
        }
        self.keep_order();
    }
}

/// Vertices around some, with the weight by which they follow; without those that stay and those on the boundary.
fn around(net: &Net, from: &[u32], stays: &dyn Fn(u32) -> bool) -> Vec<(u32, f64, Vec<u32>)> {
    let rings = net.rings(from, REACH).into_iter().enumerate();
    let mut depth: Vec<(u32, usize)> = rings.flat_map(|(d, ring)| ring.into_iter().map(move |v| (v, d))).collect();
    depth.sort_unstable();
    let weight = |d: usize| STEP * (1.0 - d.saturating_sub(1) as f64 / REACH as f64);
    let follows = depth.into_iter().filter(|&(v, _)| !stays(v) && !net.on_boundary(v));
    follows.map(|(v, d)| (v, weight(d), net.neighbours(v))).collect()
}

/// Goes `rounds` rounds around the lines and `others`; gives the vertices that may have moved.
pub fn settle(
    net: &mut Net,
    met: &mut [LaidLine],
    others: &[u32],
    stays: &dyn Fn(u32) -> bool,
    target: &Target,
    rounds: usize,
) -> Vec<u32> {
    let mut from: Vec<u32> = met.iter().flat_map(|m| m.path.iter().copied()).chain(others.iter().copied()).collect();
    from.sort_unstable();
    from.dedup();
    let following = around(net, &from, stays);
    let laid = net.positions.clone();
    for _ in 0..rounds {
        for m in met.iter_mut() {
            m.slide(net);
            m.place(net);
        }
        for (v, weight, beside) in &following {
            let share = 1.0 / beside.len().max(1) as f64;
            let (mut mean, mut shift) = (Vec3::zeros(), Vec3::zeros());
            for &w in beside {
                mean += net.positions[w as usize] * share;
                shift += (net.positions[w as usize] - laid[w as usize]) * share;
            }
            let here = net.positions[*v as usize];
            let along = shift - (here - laid[*v as usize]);
            let step = along * (1.0 - EVEN) + (mean - here) * EVEN;
            net.positions[*v as usize] = target.onto_surface(here + step * *weight);
        }
    }
    let mut moved: Vec<u32> = following.into_iter().map(|f| f.0).chain(from).collect();
    moved.sort_unstable();
    moved.dedup();
    moved
}

#[cfg(test)]
mod tests {
    use super::super::lines::tests::folded;
    use super::*;

    const SIDE: u32 = 12;

    #[test]
    fn vertices_on_a_line_stay_in_order_and_those_beside_follow() {
        let (surface, mut net, mut lines) = folded(SIDE, |p| p - Vec3::new(0.03, 0.0, 0.0));
        let (target, line) = (Target::new(&surface), lines.lines.remove(0));
        let mut path: Vec<u32> = (0..=SIDE).map(|y| y * (SIDE + 1) + SIDE / 2).collect();
        if line.nearest(net.positions[path[0] as usize]).at > 0.5 {
            path.reverse();
        }
        let before = net.positions.clone();
        let mut met = vec![LaidLine::new(&net, line, path.clone())];
        let moved = settle(&mut net, &mut met, &[], &|v| path.contains(&v), &target, 12);
        assert!(path.iter().all(|v| moved.contains(v)));
        assert!(path.iter().all(|&v| (net.positions[v as usize].x - 0.5).abs() < 1e-12));
        assert!(met[0].at.windows(2).all(|pair| pair[1] - pair[0] > 0.4 / f64::from(SIDE)), "{:?}", met[0].at);
        // The columns beside are moved along, the nearer the more; the boundary stays.
        let shift = |v: u32| (net.positions[v as usize] - before[v as usize]).norm();
        let row = 6 * (SIDE + 1);
        let shifts: Vec<f64> = (1..SIDE / 2).map(|x| shift(row + x)).collect();
        assert!(shifts.windows(2).all(|pair| pair[1] >= pair[0]) && shifts[4] > 0.01, "{shifts:?}");
        assert_eq!(shift(row), 0.0);
    }
}
