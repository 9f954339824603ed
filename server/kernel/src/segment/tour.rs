//! A surface of genus 0 with several boundary loops, cut into two discs.
//!
//! A closed tour visits every boundary loop once, by arcs that do not cross; the surface falls into the disc on its left
//! and the disc on its right. The order of the loops is a short tour by their distances (insertion, then exchange of
//! pairs); each arc is a shortest path that keeps off the loops and the arcs before it.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};

use super::distance::neighbours;
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::{NONE, TriMesh};
use crate::topology::{self, Topology};

/// Beyond so many loops the surface is better halved first.
const LOOPS_MAX: usize = 40;
/// Arcs leave a loop this part of its vertices away from where the arc before arrived, where that can be.
const APART: f64 = 0.2;

/// For each triangle the side of the tour on which it lies; `None` if no tour was found.
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
    let order = order(&between);
    [APART, 0.0].into_iter().find_map(|apart| {
        let walls = arcs(mesh, &loops, &order, apart)?;
        let sides = flood(mesh, &walls);
        let disc = |side: u32| {
            let triangles: Vec<u32> = (0..sides.len() as u32).filter(|&t| sides[t as usize] == side).collect();
            topology::classify(&topology::submesh(mesh, &triangles).0) == Ok(Topology::Disc)
        };
        let two = sides.iter().all(|&s| s < 2) && disc(0) && disc(1);
        two.then_some(sides)
    })
}

/// A short closed tour.
fn order(between: &[Vec<f64>]) -> Vec<usize> {
    let n = between.len();
    let mut tour = vec![0];
    while tour.len() < n {
        // The loop that is nearest to the tour is inserted where it costs least.
        let nearest = |k: &usize| tour.iter().map(|&t| between[t][*k]).fold(f64::INFINITY, f64::min);
        let rest = (0..n).filter(|k| !tour.contains(k));
        let Some(new) = rest.min_by(|a, b| nearest(a).total_cmp(&nearest(b))) else { break };
        let cost = |at: usize| {
            let (a, b) = (tour[at], tour[(at + 1) % tour.len()]);
            between[a][new] + between[new][b] - between[a][b]
        };
        let at = (0..tour.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(0);
        tour.insert(at + 1, new);
    }
    let mut better = true;
    while std::mem::take(&mut better) {
        for i in 0..n.saturating_sub(1) {
            for j in i + 2..n {
                let (a, b, c, d) = (tour[i], tour[i + 1], tour[j], tour[(j + 1) % n]);
                let gain = between[a][b] + between[c][d] - between[a][c] - between[b][d];
                if a != d && gain > 1e-9 * between[a][b] {
                    tour[i + 1..=j].reverse();
                    better = true;
                }
            }
        }
    }
    tour
}

/// The edges of the tour's arcs, lower vertex first.
fn arcs(mesh: &TriMesh, loops: &[Vec<u32>], order: &[usize], apart: f64) -> Option<HashSet<[u32; 2]>> {
    let neighbours = neighbours(mesh);
    let mut loop_of = vec![NONE; mesh.positions.len()];
    for (k, ring) in loops.iter().enumerate() {
        ring.iter().for_each(|&v| loop_of[v as usize] = k as u32);
    }
    let mut used = vec![false; mesh.positions.len()];
    let mut touched: Vec<Option<usize>> = vec![None; loops.len()];
    let mut walls = HashSet::new();
    for k in 0..order.len() {
        let (from, to) = (order[k], order[(k + 1) % order.len()]);
        let open = |of: usize| -> Vec<u32> {
            let ring = &loops[of];
            let away = |at: usize, used: usize| {
                let d = at.abs_diff(used);
                d.min(ring.len() - d) as f64 > apart * ring.len() as f64
            };
            (0..ring.len()).filter(|&at| touched[of].is_none_or(|used| away(at, used))).map(|at| ring[at]).collect()
        };
        let path = path(mesh, &neighbours, &loop_of, &used, &open(from), &open(to))?;
        for pair in path.windows(2) {
            walls.insert([pair[0].min(pair[1]), pair[0].max(pair[1])]);
        }
        path.iter().for_each(|&v| used[v as usize] = true);
        for (of, v) in [(from, path.first()), (to, path.last())] {
            touched[of] = loops[of].iter().position(|x| Some(x) == v);
        }
    }
    Some(walls)
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
