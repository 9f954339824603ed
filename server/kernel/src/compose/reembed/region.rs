//! The part of a surface that a closed polygon near it bounds.
//!
//! The corners of the polygon are put on the nearest vertices of the surface, and joined by shortest paths along its edges.
//! An edge that is run both ways counts for nothing. What can be reached from the triangles on the left of the path
//! without crossing it is the region. *Ours, not the paper's.*

use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh, prev};
use crate::numerics::stop;
use crate::topology::{Topology, classify, submesh};
use std::cell::Cell;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

/// A path between the vertices next to two points may be so many times as long as the way over these points. *Untuned.*
const DETOUR_MAX: f64 = 4.0;
/// A region may have this share of the surface's triangles, and this many times the share of the faces that are to lie there:
/// what was dragged over an ear are few faces. *Untuned.*
const REGION_LEAST: f64 = 0.1;
const REGION_MAX: f64 = 4.0;
/// All regions together may have so many times the triangles of the surface: solving for each takes about as long as it is
/// large. *Untuned.*
const SURFACES_MAX: usize = 6;
/// All paths together may look at so many vertices for each triangle of the surface: those of scans look at 1 to 25, on a polygon of
/// needles each looks at most of them. *Untuned.*
const LOOKS_MAX: usize = 32;

/// A surface on which regions are sought.
pub(super) struct Surroundings<'a> {
    surface: &'a TriMesh,
    tree: &'a Bvh,
    outgoing: Vec<u32>,
    /// Triangles that may still be looked at, and vertices.
    left: Cell<usize>,
    looks_left: Cell<usize>,
}

impl<'a> Surroundings<'a> {
    pub(super) fn new(surface: &'a TriMesh, tree: &'a Bvh) -> Self {
        let left = Cell::new(SURFACES_MAX * surface.triangles.len());
        let looks_left = Cell::new(LOOKS_MAX * surface.triangles.len());
        Self { surface, tree, outgoing: surface.outgoing(), left, looks_left }
    }

    /// The disc on the left of a closed polygon, for that share of some faces; `None` where there is none, or a far larger one.
    pub(super) fn left_of(&self, polygon: &[Vec3], share: f64) -> Option<TriMesh> {
        let surface = self.surface;
        let corners: Vec<(u32, f64)> = polygon.iter().map(|&p| self.nearest_vertex(p)).collect::<Option<_>>()?;
        let mut path: BTreeSet<u32> = BTreeSet::new();
        for k in 0..corners.len() {
            let next = (k + 1) % corners.len();
            let ((from, off), (to, off_too)) = (corners[k], corners[next]);
            let way = off + (polygon[next] - polygon[k]).norm() + off_too;
            for h in self.path(from, to, DETOUR_MAX * way)? {
                let twin = surface.twin(h);
                if twin == NONE || !path.remove(&twin) {
                    path.insert(h);
                }
            }
        }
        let right: BTreeSet<u32> =
            path.iter().map(|&h| surface.twin(h)).filter(|&h| h != NONE).map(|h| h / 3).collect();
        let most = (REGION_LEAST + REGION_MAX * share) * surface.triangles.len() as f64;
        let mut found: BTreeSet<u32> = path.iter().map(|h| h / 3).collect();
        let mut front: Vec<u32> = found.iter().copied().collect();
        let mut is_bounded = found.is_disjoint(&right);
        while let Some(t) = front.pop().filter(|_| is_bounded) {
            stop::pass(1);
            for h in 3 * t..3 * t + 3 {
                let twin = surface.twin(h);
                if twin != NONE && !path.contains(&h) && !path.contains(&twin) && found.insert(twin / 3) {
                    is_bounded &= !right.contains(&(twin / 3));
                    front.push(twin / 3);
                }
            }
            is_bounded &= found.len() as f64 <= most && found.len() <= self.left.get();
        }
        self.left.set(self.left.get().saturating_sub(found.len()));
        if !is_bounded {
            return None;
        }
        let triangles: Vec<u32> = found.into_iter().collect();
        let (region, _) = submesh(surface, &triangles);
        (classify(&region).ok()? == Topology::Disc).then_some(region)
    }

    /// The nearest corner of the nearest triangle, and how far it is.
    fn nearest_vertex(&self, p: Vec3) -> Option<(u32, f64)> {
        let corners = self.surface.triangles.get(self.tree.closest(p).triangle as usize)?;
        let off = |v: u32| (self.surface.positions[v as usize] - p).norm();
        corners.iter().map(|&v| (v, off(v))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The halfedges of the shortest path along edges between two vertices; `None` where that is longer than `most`, or no more
    /// vertices may be looked at.
    fn path(&self, from: u32, to: u32, most: f64) -> Option<Vec<u32>> {
        let at = |v: u32| self.surface.positions[v as usize];
        let mut reached: BTreeMap<u32, (f64, u32)> = BTreeMap::from([(from, (0.0, NONE))]);
        // Positive finite floats order like their bits.
        let mut heap = BinaryHeap::from([Reverse((0u64, from))]);
        while let Some(Reverse((key, v))) = heap.pop() {
            stop::pass(1);
            self.looks_left.set(self.looks_left.get().checked_sub(1)?);
            let d = f64::from_bits(key);
            if v == to {
                break;
            }
            if reached.get(&v).is_some_and(|r| d > r.0) {
                continue;
            }
            self.for_each_spoke(v, |h, w| {
                let next = d + (at(w) - at(v)).norm();
                if next <= most && reached.get(&w).is_none_or(|r| next < r.0) {
                    reached.insert(w, (next, h));
                    heap.push(Reverse((next.to_bits(), w)));
                }
            });
        }
        let mut path = Vec::new();
        let mut v = to;
        while v != from {
            let h = reached.get(&v)?.1;
            path.push(h);
            v = self.surface.tail(h);
        }
        path.reverse();
        Some(path)
    }

    /// Calls `visit` with each halfedge that leaves a vertex, and its head.
    fn for_each_spoke(&self, v: u32, mut visit: impl FnMut(u32, u32)) {
        let start = self.outgoing[v as usize];
        let mut h = start;
        while h != NONE {
            visit(h, self.surface.head(h));
            h = self.surface.twin(prev(h));
            if h == start {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_polygon_bounds_what_lies_on_its_left() {
        let surface = grid(20, 20, false, false);
        let tree = Bvh::new(&surface);
        let surroundings = Surroundings::new(&surface, &tree);
        let mut square = [[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]].map(|[x, y]| Vec3::new(x, y, 0.01));
        let region = surroundings.left_of(&square, 0.16).expect("a disc");
        assert!((region.total_area() - 0.16).abs() < 0.02, "{}", region.total_area());
        square.reverse();
        assert!(surroundings.left_of(&square, 0.16).is_none(), "the other side is the larger");
    }
}
