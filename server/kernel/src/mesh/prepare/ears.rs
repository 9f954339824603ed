//! Cutting a polygon into triangles by its ears, the best-shaped first; of a polygon of many corners those with the shortest
//! diagonal first. On a circle the best-shaped ear lies beside the last one, and a fan of slivers as long as the polygon is
//! wide comes of it, whose boxes all overlap; the shortest diagonals halve the ring again and again.
//!
//! *Ours, not the paper's:* the ears wait in a heap by shape, blocking corners lie in a grid, and the work is bounded, so
//! that a polygon with 20,000 corners costs milliseconds.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A point of the plane.
pub(super) type Point = [f64; 2];

/// A polygon with more corners than this has many.
const MANY_CORNERS: usize = 64;

/// Corners looked at, a corner of the polygon, before the search gives up.
const TESTS_PER_CORNER_MAX: usize = 2_000;

/// Triangles over the corners of a counter-clockwise polygon (`3 × (corners − 2)` indices), or `None` where no
/// triangulation was found. `allowed` tells whether two corners may be joined by a diagonal; it is asked again and may
/// change its answer after `taken`.
pub(super) fn cut(
    points: &[Point],
    mut allowed: impl FnMut(usize, usize) -> bool,
    mut taken: impl FnMut(usize, usize),
) -> Option<Vec<[usize; 3]>> {
    let mut ring = RemainingPolygon::new(points);
    let mut triangles = Vec::with_capacity(points.len().saturating_sub(2));
    // Ears with an area; then flat ones; then any, where the polygon crosses itself.
    for strictness in [Strictness::Proper, Strictness::Flat, Strictness::Any] {
        let mut heap: BinaryHeap<Ear> = ring.live().map(|corner| ring.ear(corner)).collect();
        while ring.left > 3 {
            let Some(ear) = heap.pop() else { break };
            if !ring.is_current(&ear) || !ring.is_ear(ear.corner, strictness) {
                continue;
            }
            let (before, after) = (ring.before[ear.corner], ring.after[ear.corner]);
            if !allowed(before, after) {
                continue;
            }
            taken(before, after);
            triangles.push([before, ear.corner, after]);
            ring.remove(ear.corner);
            heap.push(ring.ear(before));
            heap.push(ring.ear(after));
        }
        if ring.left == 3 {
            let last = ring.live().next()?;
            triangles.push([ring.before[last], last, ring.after[last]]);
            return Some(triangles);
        }
    }
    None
}

#[derive(Clone, Copy, PartialEq)]
enum Strictness {
    Proper,
    Flat,
    Any,
}

/// A candidate: a corner with the shape of its triangle when it was queued.
#[derive(PartialEq)]
struct Ear {
    shape: f64,
    corner: usize,
    version: u32,
}

impl Eq for Ear {}

impl Ord for Ear {
    fn cmp(&self, other: &Self) -> Ordering {
        self.shape.total_cmp(&other.shape).then(other.corner.cmp(&self.corner)).then(self.version.cmp(&other.version))
    }
}

impl PartialOrd for Ear {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// What is left of the polygon.
struct RemainingPolygon<'p> {
    points: &'p [Point],
    before: Vec<usize>,
    after: Vec<usize>,
    version: Vec<u32>,
    gone: Vec<bool>,
    left: usize,
    grid: Grid,
    tests_left: usize,
}

impl<'p> RemainingPolygon<'p> {
    fn new(points: &'p [Point]) -> Self {
        let n = points.len();
        let (before, after): (Vec<usize>, Vec<usize>) = (0..n).map(|k| ((k + n - 1) % n, (k + 1) % n)).unzip();
        let reflex = (0..n).filter(|k| twice_area(points[before[*k]], points[*k], points[after[*k]]) <= 0.0).collect();
        Self {
            points,
            before,
            after,
            version: vec![0; n],
            gone: vec![false; n],
            left: n,
            grid: Grid::new(points, reflex),
            tests_left: TESTS_PER_CORNER_MAX * n,
        }
    }

    fn live(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.points.len()).filter(|k| !self.gone[*k])
    }

    fn corners(&self, k: usize) -> [Point; 3] {
        [self.points[self.before[k]], self.points[k], self.points[self.after[k]]]
    }

    /// The candidate at a corner: twice the area over the squared sides, so that flat and slender ears come last; of many
    /// corners the squared diagonal, the shortest first.
    fn ear(&self, corner: usize) -> Ear {
        let [a, b, c] = self.corners(corner);
        let sides = distance_squared(a, b) + distance_squared(b, c) + distance_squared(c, a);
        let shape = match sides > 0.0 {
            _ if self.points.len() > MANY_CORNERS => -distance_squared(c, a),
            true => twice_area(a, b, c) / sides,
            false => 0.0,
        };
        Ear { shape, corner, version: self.version[corner] }
    }

    fn is_current(&self, ear: &Ear) -> bool {
        !self.gone[ear.corner] && self.version[ear.corner] == ear.version
    }

    fn remove(&mut self, k: usize) {
        let (before, after) = (self.before[k], self.after[k]);
        self.gone[k] = true;
        self.after[before] = after;
        self.before[after] = before;
        self.version[before] += 1;
        self.version[after] += 1;
        self.left -= 1;
    }

    fn is_ear(&mut self, k: usize, strictness: Strictness) -> bool {
        let [a, b, c] = self.corners(k);
        let area = twice_area(a, b, c);
        match strictness {
            Strictness::Any => return true,
            Strictness::Proper if area <= 0.0 => return false,
            Strictness::Flat if area < 0.0 => return false,
            _ => {}
        }
        let (gone, points, before, after) = (&self.gone, self.points, &self.before, &self.after);
        let role = |q: usize| match points[q] {
            _ if gone[q] || twice_area(points[before[q]], points[q], points[after[q]]) > 0.0 => Role::Done,
            p if p != a && p != b && p != c && contains([a, b, c], p) => Role::Blocks,
            _ => Role::Aside,
        };
        self.grid.none_in([a, b, c], &mut self.tests_left, role)
    }
}

/// Twice the signed area of a triangle.
fn twice_area(a: Point, b: Point, c: Point) -> f64 {
    let coord = |p: Point| robust::Coord { x: p[0], y: p[1] };
    robust::orient2d(coord(a), coord(b), coord(c))
}

fn distance_squared(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

/// Whether a counter-clockwise triangle or its border contains a point.
fn contains([a, b, c]: [Point; 3], p: Point) -> bool {
    twice_area(a, b, p) >= 0.0 && twice_area(b, c, p) >= 0.0 && twice_area(c, a, p) >= 0.0
}

/// The reflex corners (only they can lie in an ear), by cells.
struct Grid {
    low: Point,
    cells_per_unit: Point,
    side: usize,
    starts: Vec<usize>,
    /// Members of each cell; they are taken out when they are found to block no more.
    counts: Vec<usize>,
    members: Vec<usize>,
}

impl Grid {
    fn new(points: &[Point], reflex: Vec<usize>) -> Self {
        let fold = |axis: usize, f: fn(f64, f64) -> f64, start| points.iter().map(|p| p[axis]).fold(start, f);
        let low = [fold(0, f64::min, f64::INFINITY), fold(1, f64::min, f64::INFINITY)];
        let high = [fold(0, f64::max, f64::NEG_INFINITY), fold(1, f64::max, f64::NEG_INFINITY)];
        let side = ((reflex.len() as f64).sqrt() as usize).max(1);
        let per_unit = |axis: usize| {
            let extent = high[axis] - low[axis];
            if extent > 0.0 { side as f64 / extent } else { 0.0 }
        };
        let mut grid = Self {
            low,
            cells_per_unit: [per_unit(0), per_unit(1)],
            side,
            starts: Vec::new(),
            counts: Vec::new(),
            members: reflex,
        };
        let mut keyed: Vec<(usize, usize)> = grid.members.iter().map(|k| (grid.cell(points[*k]), *k)).collect();
        keyed.sort_unstable();
        grid.starts = vec![0; side * side + 1];
        keyed.iter().for_each(|(cell, _)| grid.starts[cell + 1] += 1);
        grid.counts = grid.starts[1..].to_vec();
        (0..side * side).for_each(|cell| grid.starts[cell + 1] += grid.starts[cell]);
        grid.members = keyed.into_iter().map(|(_, k)| k).collect();
        grid
    }

    fn along(&self, axis: usize, x: f64) -> usize {
        (((x - self.low[axis]) * self.cells_per_unit[axis]) as usize).min(self.side - 1)
    }

    fn cell(&self, p: Point) -> usize {
        self.along(1, p[1]) * self.side + self.along(0, p[0])
    }

    /// Whether no member in the triangle's box blocks; false as well when no tests are left.
    fn none_in(&mut self, [a, b, c]: [Point; 3], tests_left: &mut usize, role: impl Fn(usize) -> Role) -> bool {
        let range = |grid: &Self, axis: usize| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            grid.along(axis, low)..=grid.along(axis, high)
        };
        for row in range(self, 1) {
            for column in range(self, 0) {
                let cell = row * self.side + column;
                let Some(left) = tests_left.checked_sub(self.counts[cell] + 1) else { return false };
                *tests_left = left;
                let start = self.starts[cell];
                let mut k = start;
                while k < start + self.counts[cell] {
                    match role(self.members[k]) {
                        Role::Blocks => return false,
                        Role::Aside => k += 1,
                        Role::Done => {
                            self.counts[cell] -= 1;
                            self.members[k] = self.members[start + self.counts[cell]];
                        }
                    }
                }
            }
        }
        true
    }
}

/// What a reflex corner is for an ear.
enum Role {
    /// It lies in the ear.
    Blocks,
    /// It lies elsewhere.
    Aside,
    /// It is cut off or no longer reflex, and blocks no ear any more.
    Done,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn star(n: usize) -> Vec<Point> {
        let at = |k: usize| {
            let (angle, radius) =
                (std::f64::consts::TAU * k as f64 / n as f64, if k.is_multiple_of(2) { 1.0 } else { 0.3 });
            [radius * angle.cos(), radius * angle.sin()]
        };
        (0..n).map(at).collect()
    }

    fn area(points: &[Point], triangles: &[[usize; 3]]) -> (f64, f64) {
        let signed: Vec<f64> = triangles.iter().map(|t| twice_area(points[t[0]], points[t[1]], points[t[2]])).collect();
        (signed.iter().sum(), signed.iter().map(|a| a.abs()).sum())
    }

    #[test]
    fn a_star_is_covered_once_and_no_triangle_is_inverted() {
        for n in [10, 200, 20_000] {
            let points = star(n);
            let triangles = cut(&points, |_, _| true, |_, _| {}).expect("stars can be cut");
            assert_eq!(triangles.len(), n - 2);
            let (signed, absolute) = area(&points, &triangles);
            let polygon: f64 = (0..n).map(|k| twice_area([0.0; 2], points[k], points[(k + 1) % n])).sum();
            assert!((signed - polygon).abs() < 1e-9 && (absolute - signed).abs() < 1e-12, "{n}: {signed} {polygon}");
        }
    }

    #[test]
    fn a_circle_of_many_corners_is_no_fan_of_slivers() {
        let n = 4096;
        let at = |k: usize| std::f64::consts::TAU * k as f64 / n as f64;
        let points: Vec<Point> = (0..n).map(|k| [at(k).cos(), at(k).sin()]).collect();
        let triangles = cut(&points, |_, _| true, |_, _| {}).expect("a circle can be cut");
        let extent = |t: &[usize; 3], axis: usize| {
            let at = t.map(|k| points[k][axis]);
            at.iter().copied().fold(f64::MIN, f64::max) - at.iter().copied().fold(f64::MAX, f64::min)
        };
        let boxes: f64 = triangles.iter().map(|t| extent(t, 0) * extent(t, 1)).sum();
        assert!(boxes < 20.0, "boxes of {boxes}, of a circle of 3.1");
    }

    #[test]
    fn a_forbidden_diagonal_is_avoided() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        for forbidden in [[0, 2], [1, 3]] {
            let allowed = |a: usize, b: usize| ![a.min(b), a.max(b)].eq(&forbidden);
            let triangles = cut(&square, allowed, |_, _| {}).expect("the other diagonal is free");
            assert!(triangles.iter().all(|t| !(t.contains(&forbidden[0]) && t.contains(&forbidden[1]))));
        }
        assert!(cut(&square, |_, _| false, |_, _| {}).is_none());
    }

    #[test]
    fn a_polygon_that_crosses_itself_or_is_flat_is_still_cut() {
        let crossing: Vec<Point> = (0..11).map(|k| [f64::from(k * 7 % 11), f64::from(k * 5 % 11)]).collect();
        let flat: Vec<Point> = (0..9).map(|k| [f64::from(k), 0.0]).collect();
        for points in [crossing, flat, vec![[0.5, 0.5]; 8]] {
            let triangles = cut(&points, |_, _| true, |_, _| {}).expect("some triangles");
            let used: HashSet<usize> = triangles.iter().flatten().copied().collect();
            assert_eq!((triangles.len(), used.len()), (points.len() - 2, points.len()));
        }
    }
}
