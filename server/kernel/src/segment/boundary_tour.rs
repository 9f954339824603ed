//! A surface of genus 0 with several boundary loops, cut into two discs.
//!
//! A closed tour visits every boundary loop once, by arcs that do not cross; the surface falls into the disc on its left
//! and the disc on its right. The order of the loops is that of [`super::order`]; each arc is a shortest path that keeps off
//! the loops and the arcs before it. The shortest arc comes first, so that it does not matter which loop is the first.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

use super::order::order;
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;
use crate::topology::{self, Topology};

/// Beyond so many loops the surface is better halved first.
const LOOPS_MAX: usize = 40;
/// Arcs leave a loop this part of its length away from where the arc before arrived, where that can be.
const APART: f64 = 0.2;

/// For each triangle the side of the boundary tour on which it lies; `None` if no tour was found.
pub(super) fn halves(mesh: &TriMesh) -> Option<Vec<u32>> {
    let loops: Vec<Vec<u32>> =
        mesh.boundary_loops().iter().map(|ring| ring.iter().map(|&h| mesh.tail(h)).collect()).collect();
    if !(2..=LOOPS_MAX).contains(&loops.len()) {
        return None;
    }
    let marcher = Marcher::new(mesh);
    let between: Vec<Vec<f64>> = loops
        .iter()
        .map(|from| {
            let d = marcher.distances(from);
            loops.iter().map(|to| to.iter().map(|&v| d[v as usize]).fold(f64::INFINITY, f64::min)).collect()
        })
        .collect();
    let along: Vec<Vec<f64>> = loops.iter().map(|ring| along(mesh, ring)).collect();
    let girths: Vec<f64> = along.iter().map(|a| a.last().copied().unwrap_or(0.0)).collect();
    let tour = BoundaryTour { order: order(&between, &girths), loops, along, between };
    [APART, 0.0].into_iter().find_map(|apart| {
        let walls = tour.arcs(mesh, apart)?;
        let sides = flood(mesh, &walls);
        let disc = |side: u32| {
            let triangles: Vec<u32> = (0..sides.len() as u32).filter(|&t| sides[t as usize] == side).collect();
            topology::classify(&topology::submesh(mesh, &triangles).0) == Ok(Topology::Disc)
        };
        let two = sides.iter().all(|&s| s < 2) && disc(0) && disc(1);
        two.then_some(sides)
    })
}

/// The loops in the order of their tour.
struct BoundaryTour {
    loops: Vec<Vec<u32>>,
    /// Length of each loop up to each of its vertices, and in all.
    along: Vec<Vec<f64>>,
    /// Distances between the loops.
    between: Vec<Vec<f64>>,
    order: Vec<usize>,
}

impl BoundaryTour {
    /// The edges of the arcs, lower vertex first.
    fn arcs(&self, mesh: &TriMesh, apart: f64) -> Option<HashSet<[u32; 2]>> {
        let neighbours = mesh.neighbours();
        let mut loop_of = vec![NONE; mesh.positions.len()];
        for (k, ring) in self.loops.iter().enumerate() {
            ring.iter().for_each(|&v| loop_of[v as usize] = k as u32);
        }
        let mut used = vec![false; mesh.positions.len()];
        let mut touched: Vec<Vec<usize>> = vec![Vec::new(); self.loops.len()];
        let mut walls = HashSet::new();
        for [from, to] in self.shortest_first() {
            let open = [from, to].map(|of| self.open(of, &touched[of], apart));
            let path = path(mesh, &neighbours, &loop_of, &used, &open[0], &open[1])?;
            for pair in path.windows(2) {
                walls.insert([pair[0].min(pair[1]), pair[0].max(pair[1])]);
            }
            path.iter().for_each(|&v| used[v as usize] = true);
            for (of, v) in [(from, path.first()), (to, path.last())] {
                touched[of].extend(self.loops[of].iter().position(|x| Some(x) == v));
            }
        }
        Some(walls)
    }

    /// The loops that each arc joins.
    fn shortest_first(&self) -> Vec<[usize; 2]> {
        let n = self.order.len();
        let mut arcs: Vec<[usize; 2]> = (0..n).map(|k| [self.order[k], self.order[(k + 1) % n]]).collect();
        let length = |&[a, b]: &[usize; 2]| self.between[a][b];
        arcs.sort_by(|x, y| length(x).total_cmp(&length(y)));
        arcs
    }

    /// The vertices of a loop that are far enough from where arcs touch it.
    fn open(&self, of: usize, touched: &[usize], apart: f64) -> Vec<u32> {
        let (ring, along) = (&self.loops[of], &self.along[of]);
        let total = along.last().copied().unwrap_or(0.0);
        let away = |at: usize| {
            touched.iter().all(|&other| {
                let d = (along[at] - along[other]).abs();
                d.min(total - d) > apart * total
            })
        };
        (0..ring.len()).filter(|&at| away(at)).map(|at| ring[at]).collect()
    }
}

/// Length of a loop up to each of its vertices, and in all.
fn along(mesh: &TriMesh, ring: &[u32]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut along = vec![0.0];
    for (k, &v) in ring.iter().enumerate() {
        let next = ring[(k + 1) % ring.len()];
        sum += (mesh.positions[next as usize] - mesh.positions[v as usize]).norm();
        along.push(sum);
    }
    along
}

/// The shortest path from one set to another that meets no loop and no used vertex on its way.
fn path(
    mesh: &TriMesh,
    neighbours: &[Vec<u32>],
    loop_of: &[u32],
    used: &[bool],
    from: &[u32],
    to: &[u32],
) -> Option<Vec<u32>> {
    let mut distance = vec![f64::INFINITY; mesh.positions.len()];
    let mut by = vec![NONE; mesh.positions.len()];
    let mut is_target = vec![false; mesh.positions.len()];
    to.iter().filter(|&&v| !used[v as usize]).for_each(|&v| is_target[v as usize] = true);
    let mut heap = BinaryHeap::new();
    for &v in from.iter().filter(|&&v| !used[v as usize]) {
        distance[v as usize] = 0.0;
        heap.push(Reverse((0u64, v)));
    }
    while let Some(Reverse((key, v))) = heap.pop() {
        stop::pass(1);
        let d = f64::from_bits(key);
        if d > distance[v as usize] {
            continue;
        }
        if is_target[v as usize] {
            let mut path = vec![v];
            while by[path[path.len() - 1] as usize] != NONE {
                path.push(by[path[path.len() - 1] as usize]);
            }
            path.reverse();
            return Some(path);
        }
        for &w in &neighbours[v as usize] {
            let free = !used[w as usize] && (loop_of[w as usize] == NONE || is_target[w as usize]);
            let step = d + (mesh.positions[w as usize] - mesh.positions[v as usize]).norm();
            if free && step < distance[w as usize] {
                (distance[w as usize], by[w as usize]) = (step, v);
                heap.push(Reverse((step.to_bits(), w)));
            }
        }
    }
    None
}

/// A number for each triangle, equal for those that are joined without crossing a wall.
fn flood(mesh: &TriMesh, walls: &HashSet<[u32; 2]>) -> Vec<u32> {
    let mut open = mesh.clone();
    for h in 0..mesh.twins.len() as u32 {
        let (a, b) = (mesh.tail(h), mesh.head(h));
        if walls.contains(&[a.min(b), a.max(b)]) {
            open.twins[h as usize] = NONE;
        }
    }
    topology::components(&open).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_sheet_with_holes_becomes_two_discs() {
        let mesh = grid(24, 24, false, false);
        let hole = |t: usize| {
            let (i, j) = ((t / 2) % 24, (t / 2) / 24);
            [(4, 4), (12, 18), (19, 7)].iter().any(|&(a, b): &(usize, usize)| i.abs_diff(a) < 2 && j.abs_diff(b) < 2)
        };
        let kept: Vec<u32> = (0..mesh.triangles.len()).filter(|&t| !hole(t)).map(|t| t as u32).collect();
        let (holed, _) = topology::submesh(&mesh, &kept);
        assert_eq!(topology::invariants(&holed).boundary_loops, 4);
        let sides = halves(&holed).expect("a tour");
        let left = sides.iter().filter(|&&s| s == 0).count();
        assert!(left > sides.len() / 5 && left < 4 * sides.len() / 5, "{left} of {}", sides.len());
    }
}
