//! The nearest of many points in a space of D dimensions: a balanced tree of boxes, eight to a node.
//!
//! Ranges are split at the median along the widest axis, down to leaves of one depth. Each node keeps the boxes of its
//! eight children, and each leaf its points, coordinate by coordinate, so that eight distances are computed at once.
//! Points of a surface fill little of the space around it: boxes rule out far more than the planes that split them.
//! Nearer boxes are looked into first. *Sources:* Bentley 1975; Omohundro 1989 (boxes); Wald et al. 2008 (wide nodes).
//! Ties go to the point with the lowest number, so that the answer depends neither on the tree nor on where the search
//! begins.

use crate::numerics::stop;
use crate::numerics::wide::{LANES, Lanes, Wide, wide};

/// Points in a leaf at most.
const LEAF_SIZE: usize = 16;
/// Boxes that wait to be looked into at most: seven a level, at 8¹¹ leaves and fewer.
const WAITING_MAX: usize = 80;

/// A balanced tree over points.
#[derive(Clone, Debug, Default)]
pub(super) struct KdTree<const D: usize> {
    /// Lows and highs of the children of each inner node; those of node k are 8 k + 1 to 8 k + 8.
    boxes: Vec<[[Lanes; D]; 2]>,
    /// The points of the leaves, a leaf the same number of blocks; what is left over is infinitely far.
    blocks: Vec<PointBlock<D>>,
    /// Blocks of a leaf.
    in_leaf: usize,
    /// In which lane of all blocks the point of each number is.
    places: Vec<u32>,
}

/// A block of points side by side, with their numbers.
#[derive(Clone, Copy, Debug)]
struct PointBlock<const D: usize> {
    points: [Lanes; D],
    numbers: [u32; LANES],
}

impl<const D: usize> PointBlock<D> {
    const EMPTY: Self = Self { points: [[f64::INFINITY; LANES]; D], numbers: [u32::MAX; LANES] };
}

impl<const D: usize> KdTree<D> {
    /// Builds the tree; coordinates are finite.
    pub(super) fn new(points: impl Iterator<Item = [f64; D]>) -> Self {
        let mut points: Vec<([f64; D], u32)> = points.zip(0u32..).collect();
        let count = points.len();
        if count == 0 {
            return Self::default();
        }
        let mut leaves = 1;
        while leaves * LEAF_SIZE < count {
            leaves *= LANES;
        }
        let in_leaf = count.div_ceil(leaves).div_ceil(LANES);
        let mut tree = Self {
            boxes: Vec::new(),
            blocks: vec![PointBlock::EMPTY; leaves * in_leaf],
            in_leaf,
            places: vec![0; count],
        };
        // Level by level, as the nodes are numbered.
        let mut level = vec![(0, count)];
        while level.len() < leaves {
            let mut next = Vec::with_capacity(LANES * level.len());
            for range in level {
                next.extend(tree.add(&mut points, range));
            }
            level = next;
        }
        for (leaf, (start, end)) in level.into_iter().enumerate() {
            for (k, (point, number)) in points[start..end].iter().enumerate() {
                let place = leaf * in_leaf * LANES + k;
                let (block, lane) = (&mut tree.blocks[place / LANES], place % LANES);
                (0..D).for_each(|d| block.points[d][lane] = point[d]);
                block.numbers[lane] = *number;
                tree.places[*number as usize] = place as u32;
            }
        }
        tree
    }

    /// Adds the node of a range, whose points it sorts into [`LANES`] ranges, which it returns.
    fn add(&mut self, points: &mut [([f64; D], u32)], range: (usize, usize)) -> [(usize, usize); LANES] {
        let mut ranges = [range; LANES];
        let mut parts = 1;
        while parts < LANES {
            for k in (0..parts).rev() {
                let (start, end) = ranges[k];
                let middle = halve(&mut points[start..end]) + start;
                (ranges[2 * k], ranges[2 * k + 1]) = ((start, middle), (middle, end));
            }
            parts *= 2;
        }
        let mut boxes = [[[0.0; LANES]; D]; 2];
        for (lane, (start, end)) in ranges.iter().enumerate() {
            let [low, high] = bounds(&points[*start..*end]);
            (0..D).for_each(|d| (boxes[0][d][lane], boxes[1][d][lane]) = (low[d], high[d]));
        }
        self.boxes.push(boxes);
        ranges
    }

    /// The number of the nearest point and its squared distance; `None` for a tree without points.
    pub(super) fn nearest(&self, point: &[f64; D]) -> Option<(u32, f64)> {
        self.nearest_from(point, u32::MAX)
    }

    /// The same, where the point with the number `near` is probably near: the answer does not depend on it.
    pub(super) fn nearest_from(&self, point: &[f64; D], near: u32) -> Option<(u32, f64)> {
        self.near(point, near, (0.0, f64::INFINITY))
    }

    /// A point that is at most 1 + `slack` times as far as the nearest, and its squared distance; `None` where none is
    /// within the squared distance `reach`. Where a query is far from all points, which are then nearly as far as each
    /// other, this looks at a small share of them. *Source:* Arya et al. 1998.
    pub(super) fn near(&self, point: &[f64; D], near: u32, (slack, reach): (f64, f64)) -> Option<(u32, f64)> {
        stop::poll();
        if self.blocks.is_empty() {
            return None;
        }
        let strictness = (1.0 + slack) * (1.0 + slack);
        let best = wide(Search { tree: self, point, strictness, from: near, best: (reach, u32::MAX) });
        (best.1 != u32::MAX).then_some((best.1, best.0))
    }
}

/// Sorts points into two halves along their widest axis; returns where the second begins.
fn halve<const D: usize>(points: &mut [([f64; D], u32)]) -> usize {
    let half = points.len() / 2;
    let [low, high] = bounds(points);
    let axis = (1..D).fold(0, |best, k| if high[k] - low[k] > high[best] - low[best] { k } else { best });
    if half > 0 {
        points.select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    }
    half
}

/// Low and high of points; of none a box that is infinitely far.
fn bounds<const D: usize>(points: &[([f64; D], u32)]) -> [[f64; D]; 2] {
    let (mut low, mut high) = ([f64::INFINITY; D], [f64::NEG_INFINITY; D]);
    for (p, _) in points {
        for k in 0..D {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    [low, high]
}

/// A search: boxes whose squared distance, times `strictness`, is more than the best are left out.
struct Search<'a, const D: usize> {
    tree: &'a KdTree<D>,
    point: &'a [f64; D],
    strictness: f64,
    /// The number of a point to begin with.
    from: u32,
    best: (f64, u32),
}

impl<const D: usize> Wide for Search<'_, D> {
    type Output = (f64, u32);

    #[inline(always)]
    fn run(mut self) -> (f64, u32) {
        let tree = self.tree;
        if let Some(place) = tree.places.get(self.from as usize) {
            self.compare(*place as usize / LANES);
        }
        let inner = tree.boxes.len();
        // Boxes that wait: their squared distances, and the nodes that they are of.
        let (mut aways, mut nodes) = ([0.0; WAITING_MAX], [0u32; WAITING_MAX]);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            if aways[count] > self.best.0 {
                continue;
            }
            let node = nodes[count] as usize;
            if node >= inner {
                let first = (node - inner) * tree.in_leaf;
                for block in first..first + tree.in_leaf {
                    self.compare(block);
                }
                continue;
            }
            let away = self.away(&tree.boxes[node]);
            let first = count;
            for (lane, away) in away.into_iter().enumerate() {
                if away <= self.best.0 {
                    // The nearest comes last, and so is looked into first.
                    let mut at = count;
                    while at > first && aways[at - 1] < away {
                        (aways[at], nodes[at]) = (aways[at - 1], nodes[at - 1]);
                        at -= 1;
                    }
                    (aways[at], nodes[at]) = (away, (LANES * node + 1 + lane) as u32);
                    count += 1;
                }
            }
        }
        self.best
    }
}

impl<const D: usize> Search<'_, D> {
    /// The squared distances to eight boxes, times the strictness.
    #[inline(always)]
    fn away(&self, [low, high]: &[[Lanes; D]; 2]) -> Lanes {
        let mut squared = [0.0; LANES];
        for d in 0..D {
            let x = self.point[d];
            let mut beyond = [0.0; LANES];
            // Simple comparisons, in short loops, compile to one wide instruction each.
            for lane in 0..LANES {
                let (below, above) = (low[d][lane] - x, x - high[d][lane]);
                beyond[lane] = if below > above { below } else { above };
            }
            for lane in 0..LANES {
                beyond[lane] = if beyond[lane] > 0.0 { beyond[lane] } else { 0.0 };
            }
            for lane in 0..LANES {
                squared[lane] += beyond[lane] * beyond[lane];
            }
        }
        for squared in &mut squared {
            *squared *= self.strictness;
        }
        squared
    }

    /// Compares the points of a block.
    #[inline(always)]
    fn compare(&mut self, block: usize) {
        let block = &self.tree.blocks[block];
        let mut squared = [0.0; LANES];
        for d in 0..D {
            let x = self.point[d];
            for lane in 0..LANES {
                let way = block.points[d][lane] - x;
                squared[lane] += way * way;
            }
        }
        let mut least = f64::INFINITY;
        for squared in squared {
            least = if squared < least { squared } else { least };
        }
        if least > self.best.0 {
            return;
        }
        for lane in 0..LANES {
            let (squared, number) = (squared[lane], block.numbers[lane]);
            if squared < self.best.0 || (squared == self.best.0 && number < self.best.1) {
                self.best = (squared, number);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_finds_what_a_search_through_all_finds() {
        let at = |i: usize, k: usize| ((i * 7 + 3) as f64 * (k as f64 + 1.37)).sin();
        let points: Vec<[f64; 6]> =
            (0..700).map(|i| [0, 1, 2, 3, 4, 5].map(|k| (at(i % 600, k) * 8.0).round())).collect();
        let tree = KdTree::new(points.iter().copied());
        for i in 0..300 {
            let query = [0, 1, 2, 3, 4, 5].map(|k| 8.0 * at(i + 1000, k));
            let squared = |p: &[f64; 6]| (0..6).fold(0.0, |s, k| s + (p[k] - query[k]) * (p[k] - query[k]));
            let all = (0..700)
                .fold((f64::INFINITY, 0), |b, j| if squared(&points[j]) < b.0 { (squared(&points[j]), j) } else { b });
            let expected = Some((all.1 as u32, all.0));
            assert_eq!(tree.nearest(&query), expected);
            assert_eq!(tree.nearest_from(&query, i as u32), expected);
            assert_eq!(tree.near(&query, u32::MAX, (0.0, 200.0)), expected.filter(|_| all.0 <= 200.0));
            let near = tree.near(&query, 7, (0.2, f64::INFINITY)).expect("points");
            assert!(near.1 <= 1.44 * all.0 && near.1 == squared(&points[near.0 as usize]));
        }
        for count in [1, 8, 9, 17, 33] {
            let tree = KdTree::new(points.iter().take(count).copied());
            assert_eq!(tree.nearest(&points[count - 1]).map(|found| found.1), Some(0.0));
        }
        assert_eq!(KdTree::<6>::default().nearest_from(&[0.0; 6], 3), None);
    }
}
