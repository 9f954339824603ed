//! Rectangles of whole sides, and rectangular holes in them, with the vertices of their boundaries counted around.
//!
//! *Ours, not the paper's.*

/// Turns of a hole that are tried at most.
const TURNS_MAX: usize = 64;

/// A rectangle: the place of its first corner among the boundary's vertices, and its sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corners {
    /// Place of the corner at (0, 0).
    pub first: usize,
    /// Edges along x.
    pub a: usize,
    /// Edges along y.
    pub b: usize,
}

impl Corners {
    /// Of a boundary of 2m vertices, with a first side of a edges.
    pub fn new(first: usize, a: usize, m: usize) -> Option<Self> {
        (a >= 1 && a < m).then(|| Self { first: first % (2 * m), a, b: m - a })
    }

    /// Where on the rectangle a place on the boundary lies.
    pub fn at(self, place: f64) -> [f64; 2] {
        let (a, b) = (self.a as f64, self.b as f64);
        let t = (place - self.first as f64).rem_euclid(2.0 * (a + b));
        if t <= a {
            [t, 0.0]
        } else if t <= a + b {
            [a, t - a]
        } else if t <= 2.0 * a + b {
            [2.0 * a + b - t, b]
        } else {
            [0.0, 2.0 * (a + b) - t]
        }
    }

    /// The place of the vertex (i, j) on the boundary; `None` for inner ones.
    fn place_of(self, i: usize, j: usize) -> Option<usize> {
        let (a, b) = (self.a, self.b);
        let around = match (i, j) {
            (_, 0) => Some(i),
            _ if i == a => Some(a + j),
            _ if j == b => Some(2 * a + b - i),
            (0, _) => Some(2 * (a + b) - j),
            _ => None,
        };
        around.map(|k| (self.first + k) % (2 * (a + b)))
    }

    /// Those with a corner or a side moved by some edges.
    pub fn moved(self, step: usize) -> [Option<Self>; 6] {
        let (m, f, a) = (self.a + self.b, self.first + 2 * (self.a + self.b), self.a);
        let less = a.saturating_sub(step);
        let back = f - step.min(m);
        [(f + step, a), (back, a), (f, a + step), (f, less), (f + step, less), (back, a + step)]
            .map(|(f, a)| Self::new(f, a, m))
    }
}

/// A rectangular hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hole {
    /// Its sides, and the place of its first corner.
    pub corners: Corners,
    /// Where its first corner lies.
    pub at: [usize; 2],
}

impl Hole {
    fn new(corners: Corners, at: [usize; 2], outer: Corners) -> Option<Self> {
        let fits = |at: usize, side: usize, of: usize| at >= 1 && at + side < of;
        (fits(at[0], corners.a, outer.a) && fits(at[1], corners.b, outer.b)).then_some(Self { corners, at })
    }

    /// The hole of n vertices that lies nearest to where its boundary fell: (place, point) pairs.
    pub fn nearest(outer: Corners, n: usize, fallen: &[(f64, [f64; 2])]) -> Option<Self> {
        let count = fallen.len().max(1) as f64;
        let centre = [0, 1].map(|k| fallen.iter().map(|f| f.1[k]).sum::<f64>() / count);
        let mut best: Option<(f64, Self)> = None;
        for a in 1..n / 2 {
            for first in (0..n).step_by(n.div_ceil(TURNS_MAX)) {
                let Some(corners) = Corners::new(first, a, n / 2) else { continue };
                let low = |k: usize, side: usize, of: usize| {
                    let most = of.saturating_sub(side + 1).max(1);
                    (centre[k] - 0.5 * side as f64).round().clamp(1.0, most as f64) as usize
                };
                let at = [low(0, corners.a, outer.a), low(1, corners.b, outer.b)];
                let Some(hole) = Self::new(corners, at, outer) else { continue };
                let off: f64 = fallen.iter().map(|(t, p)| hole.misses(*t, *p, centre)).sum();
                if best.is_none_or(|b| off < b.0) {
                    best = Some((off, hole));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// How far the direction in which a place of its boundary lies from its middle is from that of a point from `centre`.
    fn misses(self, place: f64, p: [f64; 2], centre: [f64; 2]) -> f64 {
        let q = self.corners.at(place);
        let one = [q[0] - 0.5 * self.corners.a as f64, q[1] - 0.5 * self.corners.b as f64];
        let two = [p[0] - centre[0], p[1] - centre[1]];
        let norms = one[0].hypot(one[1]) * two[0].hypot(two[1]);
        if norms > 0.0 { 1.0 - (one[0] * two[0] + one[1] * two[1]) / norms } else { 1.0 }
    }

    /// Those moved, turned or made longer by one.
    pub fn moved(self, outer: Corners) -> Vec<Self> {
        let [x, y] = self.at;
        let shifts = [[x + 1, y], [x.wrapping_sub(1), y], [x, y + 1], [x, y.wrapping_sub(1)]];
        let shifted = shifts.into_iter().filter(|at| at.iter().all(|x| *x < usize::MAX / 2));
        let all = shifted.map(|at| (Some(self.corners), at)).chain(self.corners.moved(1).map(|c| (c, self.at)));
        all.filter_map(|(corners, at)| Self::new(corners?, at, outer)).collect()
    }
}

/// A rectangle, with or without a hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The rectangle.
    pub outer: Corners,
    /// The hole in it.
    pub hole: Option<Hole>,
}

/// The vertices of a frame, numbered: those of the outer boundary, those of the hole, the others.
#[derive(Clone, Debug)]
pub struct Grid {
    numbers: Vec<u32>,
    frame: Frame,
    /// How many there are.
    pub vertices: usize,
}

impl Frame {
    /// Numbers its vertices.
    pub fn grid(self) -> Grid {
        let (a, b) = (self.outer.a, self.outer.b);
        let n = 2 * (a + b);
        let mut next = n + self.hole.map_or(0, |h| 2 * (h.corners.a + h.corners.b));
        let mut numbers = vec![u32::MAX; (a + 1) * (b + 1)];
        for j in 0..=b {
            for i in 0..=a {
                let in_hole = self.hole.and_then(|h| {
                    let (x, y) = (i.checked_sub(h.at[0])?, j.checked_sub(h.at[1])?);
                    (x <= h.corners.a && y <= h.corners.b).then(|| h.corners.place_of(x, y))
                });
                numbers[j * (a + 1) + i] = match (self.outer.place_of(i, j), in_hole) {
                    (Some(k), _) => k as u32,
                    (None, Some(Some(k))) => (n + k) as u32,
                    (None, Some(None)) => u32::MAX,
                    (None, None) => {
                        next += 1;
                        next as u32 - 1
                    }
                };
            }
        }
        Grid { numbers, frame: self, vertices: next }
    }
}

impl Grid {
    /// The number of a vertex; [`u32::MAX`] inside the hole.
    pub fn number(&self, i: usize, j: usize) -> u32 {
        self.numbers[j * (self.frame.outer.a + 1) + i]
    }

    /// Its quads, counter-clockwise.
    pub fn quads(&self) -> Vec<Vec<u32>> {
        let (a, b) = (self.frame.outer.a, self.frame.outer.b);
        let in_hole = |i: usize, j: usize| {
            self.frame.hole.is_some_and(|h| {
                (h.at[0]..h.at[0] + h.corners.a).contains(&i) && (h.at[1]..h.at[1] + h.corners.b).contains(&j)
            })
        };
        let cells = (0..b).flat_map(|j| (0..a).map(move |i| (i, j))).filter(|&(i, j)| !in_hole(i, j));
        cells
            .map(|(i, j)| [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| self.number(i, j)).to_vec())
            .collect()
    }
}

/// Where a length lies among columns, in columns: lengths along a closed curve of `whole`, increasing over one turn.
pub fn place(columns: &[f64], length: f64, whole: f64) -> f64 {
    let (n, first) = (columns.len(), columns[0]);
    let x = first + (length - first).rem_euclid(whole);
    let k = columns.partition_point(|&c| c <= x).clamp(1, n) - 1;
    let next = if k + 1 < n { columns[k + 1] } else { first + whole };
    let step = next - columns[k];
    k as f64 + if step > 0.0 { ((x - columns[k]) / step).clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check_structure};
    use crate::compose::net::Net;
    use crate::mesh::Vec3;

    #[test]
    fn the_corners_of_a_rectangle_go_around_its_boundary() {
        let corners = Corners::new(3, 4, 6).expect("4 by 2");
        for k in 0..12 {
            let [x, y] = corners.at(f64::from(k));
            assert_eq!(corners.place_of(x as usize, y as usize), Some(k as usize));
        }
    }

    #[test]
    fn a_rectangle_with_a_hole_is_an_annulus_whose_boundaries_come_first() {
        let outer = Corners::new(5, 7, 12).expect("7 by 5");
        let hole = Hole::new(Corners::new(1, 3, 5).expect("3 by 2"), [2, 1], outer).expect("it fits");
        let grid = Frame { outer, hole: Some(hole) }.grid();
        let net = Net::new(vec![Vec3::zeros(); grid.vertices], grid.quads());
        let annulus = TopologyCounts { components: 1, boundary_loops: 2, euler: 0 };
        assert_eq!(check_structure(&net.clone().into_mesh().0, annulus), Ok(()));
        let loops = net.loops().expect("two");
        assert_eq!(loops[0], (0..24).collect::<Vec<u32>>());
        // The hole's runs clockwise, with the surface on its left.
        assert_eq!(loops[1], std::iter::once(24).chain((25..34).rev()).collect::<Vec<u32>>());
    }

    #[test]
    fn a_hole_is_put_where_its_boundary_fell() {
        let outer = Corners::new(0, 12, 22).expect("12 by 10");
        let fallen: Vec<(f64, [f64; 2])> = (0..10)
            .map(|k| {
                let angle = std::f64::consts::TAU * (f64::from(k) + 0.5) / 10.0;
                (f64::from(k), [7.0 + angle.cos(), 4.0 + angle.sin()])
            })
            .collect();
        let hole = Hole::nearest(outer, 10, &fallen).expect("room");
        let middle = [0, 1].map(|k| hole.at[k] as f64 + 0.5 * [hole.corners.a, hole.corners.b][k] as f64);
        assert!((middle[0] - 7.0).abs() <= 0.5 && (middle[1] - 4.0).abs() <= 0.5, "{hole:?}");
        let [x, y] = hole.corners.at(0.0);
        assert!(x >= 0.5 * hole.corners.a as f64 && y >= 0.0, "place 0 lies to the right: {hole:?}");
    }
}
