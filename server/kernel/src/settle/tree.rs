//! The nearest of many points in a space of D dimensions: a k-d tree.
//!
//! Split at the median along the widest axis; a node is the middle entry of its range, so nothing but the points and an
//! axis each is kept. Bounds grow by one axis at a time. *Source:* Bentley 1975; Arya and Mount 1993 (incremental
//! distance). Ties go to the point with the lowest number, so that the answer does not depend on the tree.

use crate::numerics::stop;

/// Points in a leaf.
const LEAF_SIZE: usize = 8;

/// A balanced tree over points.
#[derive(Clone, Debug, Default)]
pub(super) struct KdTree<const D: usize> {
    points: Vec<([f64; D], u32)>,
    /// The axis along which the range around this middle is split.
    axes: Vec<u8>,
}

struct Query<'a, const D: usize> {
    tree: &'a KdTree<D>,
    point: &'a [f64; D],
    best: (f64, u32),
}

impl<const D: usize> KdTree<D> {
    /// Builds the tree; coordinates are finite.
    pub(super) fn new(points: impl Iterator<Item = [f64; D]>) -> Self {
        let mut points: Vec<([f64; D], u32)> = points.zip(0u32..).collect();
        let mut axes = vec![0u8; points.len()];
        let mut todo = vec![(0, points.len())];
        while let Some((start, end)) = todo.pop() {
            if end - start <= LEAF_SIZE {
                continue;
            }
            let axis = widest(&points[start..end]);
            let half = (end - start) / 2;
            points[start..end].select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
            axes[start + half] = axis as u8;
            todo.push((start, start + half));
            todo.push((start + half + 1, end));
        }
        Self { points, axes }
    }

    /// The number of the nearest point and its squared distance; `None` for a tree without points.
    pub(super) fn nearest(&self, point: &[f64; D]) -> Option<(u32, f64)> {
        stop::poll();
        let mut query = Query { tree: self, point, best: (f64::INFINITY, u32::MAX) };
        query.visit(0, self.points.len(), [0.0; D], 0.0);
        (query.best.1 != u32::MAX).then_some((query.best.1, query.best.0))
    }
}

impl<const D: usize> Query<'_, D> {
    /// Looks through a range, `offsets` away from the query along each axis and `bound` (squared) in all.
    fn visit(&mut self, start: usize, end: usize, mut offsets: [f64; D], bound: f64) {
        if end - start <= LEAF_SIZE {
            (start..end).for_each(|k| self.compare(k));
            return;
        }
        let middle = start + (end - start) / 2;
        let axis = self.tree.axes[middle] as usize;
        let beyond = self.point[axis] - self.tree.points[middle].0[axis];
        let (near, far) =
            if beyond < 0.0 { ((start, middle), (middle + 1, end)) } else { ((middle + 1, end), (start, middle)) };
        self.visit(near.0, near.1, offsets, bound);
        self.compare(middle);
        let bound = bound - offsets[axis] * offsets[axis] + beyond * beyond;
        if bound <= self.best.0 {
            offsets[axis] = beyond;
            self.visit(far.0, far.1, offsets, bound);
        }
    }

    #[inline]
    fn compare(&mut self, at: usize) {
        let (point, number) = &self.tree.points[at];
        let mut squared = 0.0;
        for k in 0..D {
            let d = point[k] - self.point[k];
            squared += d * d;
        }
        if squared < self.best.0 || (squared == self.best.0 && *number < self.best.1) {
            self.best = (squared, *number);
        }
    }
}

fn widest<const D: usize>(points: &[([f64; D], u32)]) -> usize {
    let (mut low, mut high) = ([f64::INFINITY; D], [f64::NEG_INFINITY; D]);
    for (p, _) in points {
        for k in 0..D {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    let extent = |k: usize| high[k] - low[k];
    (1..D).fold(0, |best, k| if extent(k) > extent(best) { k } else { best })
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
            assert_eq!(tree.nearest(&query), Some((all.1 as u32, all.0)));
        }
        assert_eq!(KdTree::<6>::default().nearest(&[0.0; 6]), None);
    }
}
