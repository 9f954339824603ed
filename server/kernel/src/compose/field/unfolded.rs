//! The triangles of a surface in the plane of an integer-grid map, each in a frame of its own, and the nearest grid point
//! of each corner.
//!
//! Frames of neighbours differ by a turn of quarters and a shift by whole numbers, so that a vertex has one nearest grid
//! point, whichever triangle tells it. Singular triangles are split at their grid point, and edges until the grid points at
//! their ends are equal, or neighbours in a row, a column or a diagonal: each triangle then is a point, a side, or half
//! of a quad. *Ours, not the paper's.*

use super::editable::EditableMesh;
use super::grid_map::GridMap;
use super::jumps::{applied, quarter_turn};
use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh, next, prev};
use crate::numerics::stop;
use std::collections::BTreeMap;

/// Passes in which edges are split: each halves what is too long, of any length that a surface of a million triangles has.
const PASSES_MAX: usize = 24;
/// From this pass on the longest edge of a triangle is split first. Where all three lie in a line, splitting a shorter one moves the
/// longest to a new triangle, pass for pass; other triangles need some four passes in any order. *Untuned.*
const LONGEST_FROM: usize = 8;

/// A corner's place in its triangle's frame, and the grid point nearest to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct UnfoldedCorner {
    pub(super) at: [f64; 2],
    pub(super) point: [i64; 2],
}

/// The triangles.
pub(super) struct UnfoldedTriangles {
    pub(super) mesh: EditableMesh,
    /// Of each halfedge the corner at its tail.
    pub(super) corners: Vec<UnfoldedCorner>,
    /// The quarters by which a vector turns from a halfedge's triangle to that of its twin.
    turn: Vec<u8>,
    /// Vertices at singular points.
    pub(super) singular: Vec<u32>,
}

fn turned(k: u8, x: [f64; 2]) -> [f64; 2] {
    let [a, b, c, d] = quarter_turn(k).map(f64::from);
    [a * x[0] + b * x[1], c * x[0] + d * x[1]]
}

fn minus(a: [i64; 2], b: [i64; 2]) -> [i64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// From the chart of a halfedge's head to that of its tail.
struct Step {
    turn: u8,
    shift: [i64; 2],
}

impl Step {
    fn on(&self, c: UnfoldedCorner) -> UnfoldedCorner {
        let (at, point) = (turned(self.turn, c.at), applied(quarter_turn(self.turn), c.point));
        let [x, y] = self.shift;
        UnfoldedCorner { at: [at[0] + x as f64, at[1] + y as f64], point: [point[0] + x, point[1] + y] }
    }

    fn back(&self) -> Self {
        let turn = (4 - self.turn) % 4;
        Self { turn, shift: applied(quarter_turn(turn), self.shift).map(|x| -x) }
    }
}

impl UnfoldedTriangles {
    /// Of a map; `None` where its triangles would become more than `triangles_max`.
    pub(super) fn new(mesh: &TriMesh, sharp: &[u32], map: &GridMap, triangles_max: usize) -> Option<Self> {
        let own: Vec<UnfoldedCorner> =
            map.at.iter().map(|&at| UnfoldedCorner { at, point: at.map(|x| x.round() as i64) }).collect();
        let step = |h: u32| Step { turn: map.jumps.turn[h as usize], shift: map.jumps.shift_at(h, &map.pairs) };
        let corner = |v: u32| own[v as usize];
        let mut corners = Vec::with_capacity(3 * mesh.triangles.len());
        // The quarters from a corner's own frame to that of its triangle.
        let mut quarters = Vec::with_capacity(3 * mesh.triangles.len());
        for (t, &[a, b, c]) in (0u32..).zip(&mesh.triangles) {
            stop::pass(3);
            let (to_b, to_c) = (step(3 * t), step(3 * t + 2).back());
            corners.extend([corner(a), to_b.on(corner(b)), to_c.on(corner(c))]);
            quarters.extend([0, to_b.turn, to_c.turn]);
        }
        let turn = (0..mesh.twins.len())
            .map(|h| match mesh.twins[h] {
                NONE => 0,
                g => (quarters[next(g) as usize] + 4 - quarters[h]) % 4,
            })
            .collect();
        let mut unfolded = Self { mesh: EditableMesh::new(mesh, sharp), corners, turn, singular: Vec::new() };
        let mut outer = BTreeMap::new();
        for &(h, pair) in &map.jumps.singular {
            let around = [h, next(h), prev(h)].map(step);
            let point = match pair {
                Some(pair) => map.pairs[pair as usize],
                None => fixed_point(&around)?,
            };
            unfolded.split_singular(h, point, (&around, &own), &mut outer);
        }
        for (&e, &k) in &outer {
            match unfolded.mesh.twin(e) {
                NONE => {}
                g if outer.contains_key(&g) => unfolded.turn[e as usize] = (4 - k) % 4,
                g => {
                    let quarters = quarters[next(g) as usize];
                    unfolded.turn[e as usize] = quarters;
                    unfolded.turn[g as usize] = (4 - quarters) % 4;
                }
            }
        }
        unfolded.split_long(triangles_max).then_some(unfolded)
    }

    /// Splits the triangle of a halfedge a → b at a singular point, as a sees it: into three, each in the frame of the
    /// corner at which its outer halfedge starts. Notes these halfedges, with the turn from their head's frame.
    fn split_singular(
        &mut self,
        h: u32,
        point: [i64; 2],
        (around, own): (&[Step; 3], &[UnfoldedCorner]),
        outer: &mut BTreeMap<u32, u8>,
    ) {
        let (t, rotated) = (h / 3, (h % 3) as usize);
        let vertices = [h, next(h), prev(h)].map(|e| self.mesh.tail(e));
        let p = vertices.iter().map(|&v| self.mesh.at(v)).sum::<Vec3>() / 3.0;
        let m = self.mesh.split_triangle(t, p);
        self.singular.push(m);
        let first = self.mesh.triangles.len() as u32 - 2;
        self.corners.resize(3 * self.mesh.triangles.len(), UnfoldedCorner::default());
        self.turn.resize(3 * self.mesh.triangles.len(), 0);
        let seen = singular_seen(around, point);
        for (corner, new) in [(0, t), (1, first), (2, first + 1)] {
            let k = (corner + 3 - rotated) % 3;
            let (a, b) = (own[vertices[k] as usize], own[vertices[(k + 1) % 3] as usize]);
            let centre = UnfoldedCorner { at: seen[k].map(|x| x as f64), point: seen[k] };
            let at = 3 * new as usize;
            self.corners[at..at + 3].copy_from_slice(&[a, around[k].on(b), centre]);
            outer.insert(3 * new, around[k].turn);
            self.turn[at + 1] = (4 - around[k].turn) % 4;
            self.turn[at + 2] = around[(k + 2) % 3].turn;
        }
    }

    /// Splits edges whose ends' grid points are no neighbours; false where that makes too many triangles.
    fn split_long(&mut self, triangles_max: usize) -> bool {
        for pass in 0..PASSES_MAX {
            let mut long = 0;
            for h in 0..self.mesh.twins.len() as u32 {
                stop::pass(1);
                let g = self.mesh.twin(h);
                if (g == NONE || h < g) && self.is_long(h) {
                    if pass < LONGEST_FROM || self.is_longest(h) {
                        self.split(h);
                    }
                    long += 1;
                }
            }
            if long == 0 {
                return true;
            }
            if self.mesh.triangles.len() > triangles_max {
                return false;
            }
        }
        false
    }

    /// True where the grid points at the ends of a halfedge are no neighbours.
    fn is_long(&self, h: u32) -> bool {
        self.span(h).iter().any(|d| d.abs() > 1)
    }

    /// True where no edge beside a halfedge, in its triangle and its twin's, is longer and to be split.
    fn is_longest(&self, h: u32) -> bool {
        let length = |e: u32| {
            let [a, b] = [self.corners[e as usize].at, self.corners[next(e) as usize].at];
            (b[0] - a[0]).powi(2) + (b[1] - a[1]).powi(2)
        };
        let own = length(h);
        let is_shorter = |e: u32| length(e) <= own || !self.is_long(e);
        let sides = [h, self.mesh.twin(h)];
        sides.into_iter().filter(|&side| side != NONE).all(|e| is_shorter(next(e)) && is_shorter(prev(e)))
    }

    /// The way between the grid points at the ends of a halfedge.
    pub(super) fn span(&self, h: u32) -> [i64; 2] {
        minus(self.corners[next(h) as usize].point, self.corners[h as usize].point)
    }

    fn split(&mut self, h: u32) {
        let g = self.mesh.twin(h);
        let [a, b] = [self.corners[h as usize], self.corners[next(h) as usize]];
        let at = [0, 1].map(|k| 0.5 * (a.at[k] + b.at[k]));
        let middle = UnfoldedCorner { at, point: at.map(|x| x.round() as i64) };
        let across = (g != NONE).then(|| {
            // By the turn, and the grid point of the vertex that both have.
            let k = self.turn[h as usize];
            let there = self.corners[next(g) as usize];
            let way = applied(quarter_turn(k), minus(middle.point, a.point));
            let at = turned(k, [0, 1].map(|k| middle.at[k] - a.at[k]));
            UnfoldedCorner {
                at: [there.at[0] + at[0], there.at[1] + at[1]],
                point: [there.point[0] + way[0], there.point[1] + way[1]],
            }
        });
        let p = (self.mesh.at(self.mesh.tail(h)) + self.mesh.at(self.mesh.head(h))) / 2.0;
        self.mesh.split(h, p);
        self.split_side(h, b, middle);
        if let Some(across) = across {
            self.split_side(g, self.corners[next(g) as usize], across);
        }
    }

    /// Brings corners and turns up to date where the triangle of a halfedge was split at its middle.
    fn split_side(&mut self, h: u32, head: UnfoldedCorner, middle: UnfoldedCorner) {
        let (apex, outer) = (self.corners[prev(h) as usize], self.turn[next(h) as usize]);
        // The new triangle is (middle, head, apex), in the same frame.
        self.corners.extend([middle, head, apex]);
        self.turn.extend([self.turn[h as usize], outer, 0]);
        self.corners[next(h) as usize] = middle;
        self.turn[next(h) as usize] = 0;
    }
}

/// The singular point as each corner of its triangle sees it.
fn singular_seen(around: &[Step; 3], point: [i64; 2]) -> [[i64; 2]; 3] {
    let in_b = around[0].back().on(UnfoldedCorner { point, ..UnfoldedCorner::default() }).point;
    // From a by the last step, which goes from c to a.
    let in_c = around[2].on(UnfoldedCorner { point, ..UnfoldedCorner::default() }).point;
    [point, in_b, in_c]
}

/// The point that the turn around a triangle leaves where it is; `None` where it is no grid point.
fn fixed_point(around: &[Step; 3]) -> Option<[i64; 2]> {
    let zero = UnfoldedCorner::default();
    let [x, y] = around[0].on(around[1].on(around[2].on(zero))).point;
    let twice = match (around[0].turn + around[1].turn + around[2].turn) % 4 {
        1 => [x - y, x + y],
        2 => [x, y],
        3 => [x + y, y - x],
        _ => return Some([0, 0]),
    };
    twice.iter().all(|x| x % 2 == 0).then(|| twice.map(|x| x / 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From a scanned body, seen from one side: four triangles whose corners are a third of the way from A to B apart.
    #[test]
    fn edges_of_triangles_whose_corners_lie_in_a_line_are_not_split_for_ever() {
        let (from, to) = ([9.470_543, 5.847_543], [12.0, 7.0]);
        let thirds = [0.0, 3.0, 1.0, 2.0, 1.0, 2.0].map(|k: f64| k / 3.0);
        let (a, b, one, two, beside_one, beside_two) = (0, 1, 2, 3, 4, 5);
        let triangles = vec![[two, a, b], [two, one, a], [beside_one, b, a], [beside_one, beside_two, b]];
        let off = [0.0, 0.0, 0.2, 0.1, -0.1, -0.2];
        let positions = thirds.iter().zip(off).map(|(&k, off)| Vec3::new(k, off, 0.0)).collect();
        let mesh = TriMesh::from_triangles(positions, triangles.clone()).expect("a strip");
        let corner = |v: u32| {
            let at = [0, 1].map(|k| from[k] + thirds[v as usize] * (to[k] - from[k]));
            UnfoldedCorner { at, point: at.map(|x| x.round() as i64) }
        };
        let mut unfolded = UnfoldedTriangles {
            mesh: EditableMesh::new(&mesh, &[]),
            corners: triangles.iter().flatten().map(|&v| corner(v)).collect(),
            turn: vec![0; 3 * triangles.len()],
            singular: Vec::new(),
        };
        assert!(unfolded.split_long(100));
        assert!((0..unfolded.corners.len() as u32).all(|h| !unfolded.is_long(h)));
    }
}
