//! Which tip is which: pairs of tips whose distances along the two surfaces agree.
//!
//! min Σ over pairs of matched pairs of min(|ln d₁(a, b)/d₂(x, y)|, c), a quadratic assignment; a tip left out costs as
//! if it disagreed with all. Distances along a surface hardly change with its pose. Greedy growth from every way to
//! place a few seeds, then exchanges until none helps. *Ours, not the paper's.* A surface and its mirror image agree
//! in all distances: whoever asks has to tell those two apart.

/// A disagreement counts no more than this: a factor of two.
const DISAGREEMENT_MAX: f64 = std::f64::consts::LN_2;
/// What a tip left out costs, as a share of disagreeing with all others.
const LEFT_OUT: f64 = 0.5;
/// Pairs of the first surface's tips from which matches are grown.
const SEEDS_MAX: usize = 3;
/// Grown matches that are improved by exchanges.
const GROWN_MAX: usize = 96;
/// Exchanges at most.
const EXCHANGES_MAX: usize = 200;
/// Distances are not trusted below this (in √area): it is added to both.
const DISTANCE_MIN: f64 = 0.02;

/// Two matched pairs.
type Seed = [(usize, usize); 2];

/// A match of tips.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Assignment {
    /// Pairs of tips, by the first.
    pub(super) pairs: Vec<(usize, usize)>,
    /// Mean disagreement of distances, 0 for an isometry, tips left out included.
    pub(super) distortion: f64,
}

/// Matches of the tips of two surfaces by their distances.
#[derive(Debug)]
pub(super) struct Assignments<'a> {
    between: [&'a [Vec<f64>]; 2],
    /// Disagreement of (a, b) with (x, y), at [a][b][x][y].
    disagreements: Vec<f32>,
    /// Tips that can be chosen, on each surface.
    free: [usize; 2],
    anchors: usize,
}

impl<'a> Assignments<'a> {
    /// `between[s][a][b]` is the distance of tips a and b on surface s, in √area. Of the last `anchors` rows the k-th
    /// of one surface belongs to the k-th of the other (a boundary, say); they are matched and not returned.
    pub(super) fn new(between: [&'a [Vec<f64>]; 2], anchors: usize) -> Self {
        let free = between.map(|b| b.len().saturating_sub(anchors));
        let of = |s: usize| between[s].iter().flatten().copied();
        let off = |one: f64, two: f64| {
            let off = ((one + DISTANCE_MIN) / (two + DISTANCE_MIN)).ln().abs();
            (if off < DISAGREEMENT_MAX { off } else { DISAGREEMENT_MAX }) as f32
        };
        let disagreements = of(0).flat_map(|one| of(1).map(move |two| off(one, two))).collect();
        Self { between, disagreements, free, anchors }
    }

    /// The best different matches, best first.
    pub(super) fn likely(&self) -> Vec<Assignment> {
        let order =
            |a: &Assignment, b: &Assignment| a.distortion.total_cmp(&b.distortion).then_with(|| a.pairs.cmp(&b.pairs));
        let mut grown: Vec<Assignment> = self.seeds().into_iter().map(|seed| self.measured(self.grown(seed))).collect();
        grown.sort_by(order);
        grown.dedup();
        grown.truncate(GROWN_MAX);
        for found in &mut grown {
            *found = self.exchanged(found.pairs.clone(), &|_| 0.0);
        }
        grown.sort_by(order);
        grown.dedup();
        grown
    }

    /// A match made better by swapping partners, taking other partners, adding and dropping pairs, the best change
    /// first, until none helps. `more` of a match is added to its distortion.
    pub(super) fn exchanged(
        &self,
        mut pairs: Vec<(usize, usize)>,
        more: &dyn Fn(&[(usize, usize)]) -> f64,
    ) -> Assignment {
        let cost = |pairs: &[(usize, usize)]| self.distortion(pairs) + more(pairs);
        let mut lowest = cost(&pairs);
        for _ in 0..EXCHANGES_MAX {
            let better = self.changes(&pairs).into_iter().map(|p| (cost(&p), p));
            match better.min_by(|p, q| p.0.total_cmp(&q.0)) {
                Some((lower, changed)) if lower < lowest - 1e-9 => (lowest, pairs) = (lower, changed),
                _ => break,
            }
        }
        self.measured(pairs)
    }

    fn measured(&self, mut pairs: Vec<(usize, usize)>) -> Assignment {
        pairs.sort_unstable();
        Assignment { distortion: self.distortion(&pairs), pairs }
    }

    /// How much the distances within two matched pairs disagree.
    fn disagreement(&self, (a, x): (usize, usize), (b, y): (usize, usize)) -> f64 {
        let [n, m] = self.between.map(<[_]>::len);
        f64::from(self.disagreements[(a * n + b) * m * m + x * m + y])
    }

    fn anchor(&self, k: usize) -> (usize, usize) {
        (self.free[0] + k, self.free[1] + k)
    }

    /// Disagreement of a pair with all others of a match, and with the anchors.
    fn with_all(&self, pair: (usize, usize), pairs: &[(usize, usize)]) -> f64 {
        let tips = pairs.iter().filter(|p| **p != pair).map(|p| self.disagreement(pair, *p)).sum::<f64>();
        tips + (0..self.anchors).map(|k| self.disagreement(pair, self.anchor(k))).sum::<f64>()
    }

    fn possible(&self) -> usize {
        self.free[0].min(self.free[1])
    }

    /// Σ of disagreements, those of tips left out included.
    fn cost(&self, pairs: &[(usize, usize)]) -> f64 {
        let mut sum = 0.0;
        for (i, p) in pairs.iter().enumerate() {
            sum += self.with_all(*p, &pairs[..i]);
        }
        let partners = (self.possible() + self.anchors).saturating_sub(1) as f64;
        sum + self.possible().saturating_sub(pairs.len()) as f64 * partners * DISAGREEMENT_MAX * LEFT_OUT
    }

    fn distortion(&self, pairs: &[(usize, usize)]) -> f64 {
        let n = self.possible();
        self.cost(pairs) / (n * n.saturating_sub(1) / 2 + n * self.anchors).max(1) as f64
    }

    /// Ways to place the first two tips: the farthest pairs of the first surface on every pair of the second.
    fn seeds(&self) -> Vec<Seed> {
        let mut pairs: Vec<(usize, usize)> = (0..self.free[0]).flat_map(|a| (0..a).map(move |b| (b, a))).collect();
        pairs.sort_by(|p, q| self.between[0][q.0][q.1].total_cmp(&self.between[0][p.0][p.1]).then(p.cmp(q)));
        let mut seeds = Vec::new();
        for &(a, b) in pairs.iter().take(SEEDS_MAX) {
            for x in 0..self.free[1] {
                for y in (0..self.free[1]).filter(|&y| y != x) {
                    if self.disagreement((a, x), (b, y)) < DISAGREEMENT_MAX {
                        seeds.push([(a, x), (b, y)]);
                    }
                }
            }
        }
        seeds
    }

    /// Adds the pair that agrees best until none agrees better than being left out.
    fn grown(&self, seed: Seed) -> Vec<(usize, usize)> {
        let mut pairs = seed.to_vec();
        while pairs.len() < self.possible() {
            let mean = |pair| self.with_all(pair, &pairs) / (pairs.len() + self.anchors) as f64;
            let open = self.open(&pairs).into_iter().map(|pair| (mean(pair), pair));
            match open.min_by(|p, q| p.0.total_cmp(&q.0).then(p.1.cmp(&q.1))) {
                Some((off, pair)) if off < DISAGREEMENT_MAX * LEFT_OUT => pairs.push(pair),
                _ => break,
            }
        }
        pairs
    }

    /// Pairs of tips that are both still free.
    fn open(&self, pairs: &[(usize, usize)]) -> Vec<(usize, usize)> {
        let free = |s: usize, of: fn(&(usize, usize)) -> usize| -> Vec<usize> {
            (0..self.free[s]).filter(|&t| pairs.iter().all(|p| of(p) != t)).collect()
        };
        let (one, two) = (free(0, |p| p.0), free(1, |p| p.1));
        one.iter().flat_map(|&a| two.iter().map(move |&x| (a, x))).collect()
    }

    fn changes(&self, pairs: &[(usize, usize)]) -> Vec<Vec<(usize, usize)>> {
        let mut all = Vec::new();
        for i in 0..pairs.len() {
            for j in 0..i {
                let mut swapped = pairs.to_vec();
                (swapped[i].1, swapped[j].1) = (pairs[j].1, pairs[i].1);
                all.push(swapped);
            }
            let mut dropped = pairs.to_vec();
            let (a, x) = dropped.remove(i);
            for (b, y) in self.open(&dropped) {
                // One end of the pair stays.
                if (a == b) != (x == y) {
                    let mut replaced = dropped.clone();
                    replaced.push((b, y));
                    all.push(replaced);
                }
            }
            all.push(dropped);
        }
        for pair in self.open(pairs) {
            let mut added = pairs.to_vec();
            added.push(pair);
            all.push(added);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distances of points in space, rounded a little differently on the second surface.
    fn between(points: &[[f64; 3]], order: &[usize], stretch: f64) -> Vec<Vec<f64>> {
        let d = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>().sqrt();
        let wobble = |a: usize, b: usize| 1.0 + stretch * (((a * 7 + b * 7) % 5) as f64 - 2.0);
        order.iter().map(|&a| order.iter().map(|&b| d(points[a], points[b]) * wobble(a, b)).collect()).collect()
    }

    const POINTS: [[f64; 3]; 7] = [
        [0.0, 0.0, 0.0],
        [2.0, 0.1, 0.0],
        [0.3, 1.4, 0.2],
        [1.1, 0.5, 0.9],
        [1.2, 0.7, 0.8],
        [0.1, 0.4, 1.9],
        [1.7, 1.5, 0.4],
    ];

    #[test]
    fn shuffled_and_stretched_tips_find_their_partners() {
        let order = [4, 2, 6, 0, 5, 1, 3];
        let (one, two) = (between(&POINTS, &[0, 1, 2, 3, 4, 5, 6], 0.0), between(&POINTS, &order, 0.01));
        let best = &Assignments::new([&one, &two], 0).likely()[0];
        assert!(best.pairs.iter().all(|&(a, x)| order[x] == a) && best.pairs.len() == 7, "{best:?}");
        assert!(best.distortion < 0.03);
    }

    #[test]
    fn a_tip_without_a_partner_is_left_out() {
        // Tip 5 of the first surface is far from all; the second lacks it, and has one far elsewhere.
        let far = [&POINTS[..5], &[[9.0, 0.0, 0.0], [0.0, 4.0, 0.0]]].concat();
        let order = [6, 3, 1, 0, 4, 2];
        let (one, two) = (between(&far, &[0, 1, 2, 3, 4, 5], 0.0), between(&far, &order, 0.01));
        let best = &Assignments::new([&one, &two], 0).likely()[0];
        assert!(best.pairs.len() == 5 && best.pairs.iter().all(|&(a, x)| order[x] == a), "{best:?}");
    }

    #[test]
    fn anchors_tell_ends_apart() {
        // Three tips in a row look alike from both ends; the last row is a boundary near the first.
        let line = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [-0.5, 0.0, 0.0]];
        let (one, two) = (between(&line, &[0, 1, 2, 3], 0.0), between(&line, &[2, 1, 0, 3], 0.0));
        assert_eq!(Assignments::new([&one, &two], 1).likely()[0].pairs, vec![(0, 2), (1, 1), (2, 0)]);
    }
}
