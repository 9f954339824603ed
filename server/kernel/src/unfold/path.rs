//! Shortest edge paths, and the integer jumps across them that give u its period.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use crate::mesh::tri::{NONE, TriMesh, prev};
use crate::numerics::stop;

/// Distances along edges from the sources, and the halfedge by which each vertex was reached ([`NONE`] for sources
/// and for what cannot be reached).
pub fn distances(mesh: &TriMesh, sources: &[u32]) -> (Vec<f64>, Vec<u32>) {
    let mut distance = vec![f64::INFINITY; mesh.positions.len()];
    let mut reached_by = vec![NONE; mesh.positions.len()];
    let out = mesh.outgoing();
    // Positive finite floats order like their bits, so the heap needs no float wrapper.
    let mut heap = BinaryHeap::new();
    for &s in sources {
        distance[s as usize] = 0.0;
        heap.push(Reverse((0u64, s)));
    }
    while let Some(Reverse((key, v))) = heap.pop() {
        stop::pass(1);
        let d = f64::from_bits(key);
        if d > distance[v as usize] {
            continue;
        }
        for_each_spoke(mesh, out[v as usize], |h, w| {
            let step = (mesh.positions[w as usize] - mesh.positions[v as usize]).norm();
            if d + step < distance[w as usize] {
                distance[w as usize] = d + step;
                reached_by[w as usize] = h;
                heap.push(Reverse(((d + step).to_bits(), w)));
            }
        });
    }
    (distance, reached_by)
}

/// Vertices no further than `radius` from `centre` along edges, by number, with their distances: a part of what
/// [`distances`] finds, at the cost of that part. `outgoing` is [`TriMesh::outgoing`].
pub fn within(mesh: &TriMesh, outgoing: &[u32], centre: u32, radius: f64) -> BTreeMap<u32, f64> {
    let mut settled = BTreeMap::new();
    let mut heap = BinaryHeap::from([Reverse((0u64, centre))]);
    while let Some(Reverse((key, v))) = heap.pop() {
        stop::pass(1);
        let d = f64::from_bits(key);
        if d > radius {
            break;
        }
        if settled.contains_key(&v) {
            continue;
        }
        settled.insert(v, d);
        for_each_spoke(mesh, outgoing[v as usize], |_, w| {
            let step = (mesh.positions[w as usize] - mesh.positions[v as usize]).norm();
            heap.push(Reverse(((d + step).to_bits(), w)));
        });
    }
    settled
}

/// Calls `visit(halfedge, neighbour)` for each edge at the tail of `start`, counter-clockwise. The last boundary edge
/// has only its incoming halfedge, which is then given.
pub fn for_each_spoke(mesh: &TriMesh, start: u32, mut visit: impl FnMut(u32, u32)) {
    let mut h = start;
    while h != NONE {
        visit(h, mesh.head(h));
        let back = prev(h);
        h = mesh.twin(back);
        if h == NONE {
            visit(back, mesh.tail(back));
        } else if h == start {
            return;
        }
    }
}

/// The vertices from a source to `target`, by the halfedges of [`distances`].
pub fn trace(mesh: &TriMesh, reached_by: &[u32], target: u32) -> Vec<u32> {
    let mut path = vec![target];
    let mut v = target;
    while reached_by[v as usize] != NONE && path.len() <= mesh.positions.len() {
        let h = reached_by[v as usize];
        v = if mesh.head(h) == v { mesh.tail(h) } else { mesh.head(h) };
        path.push(v);
    }
    path.reverse();
    path
}

/// Jumps across a path: for an edge that leaves it to its left s = −1 (its reverse +1), else 0, so that u grows by 1
/// counter-clockwise around the path's first vertex. Edges of the vertices in `skip` (poles) are left at 0.
///
/// Length: one a halfedge of `mesh`.
pub fn jumps(mesh: &TriMesh, path: &[u32], skip: &[u32]) -> Vec<i32> {
    let mut s = vec![0; mesh.twins.len()];
    let out = mesh.outgoing();
    for (k, &v) in path.iter().enumerate() {
        if skip.contains(&v) {
            continue;
        }
        let mut spokes = Vec::new();
        for_each_spoke(mesh, out[v as usize], |h, w| spokes.push((h, w)));
        let at = |w: u32| spokes.iter().position(|&(_, x)| x == w);
        // Left is counter-clockwise from the edge ahead to the edge behind; on a boundary the missing one is the gap.
        let ahead = path.get(k + 1).and_then(|&w| at(w));
        let behind = k.checked_sub(1).and_then(|j| at(path[j]));
        let n = spokes.len();
        let (first, count) = match (ahead, behind) {
            (Some(a), Some(b)) => (a + 1, (b + n - a - 1) % n),
            (Some(a), None) => (a + 1, n - a - 1),
            (None, Some(b)) => (0, b),
            (None, None) => (0, 0),
        };
        for (h, _) in (0..count).map(|j| spokes[(first + j) % n]) {
            let (leaving, entering) = if mesh.tail(h) == v { (h, mesh.twin(h)) } else { (NONE, h) };
            if leaving != NONE {
                s[leaving as usize] -= 1;
            }
            if entering != NONE {
                s[entering as usize] += 1;
            }
        }
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn what_lies_within_a_radius_is_what_is_no_further() {
        let mesh = grid(9, 7, false, false);
        let (all, _) = distances(&mesh, &[31]);
        let near = within(&mesh, &mesh.outgoing(), 31, 0.4);
        let expected = (0..all.len() as u32).filter(|&v| all[v as usize] <= 0.4).map(|v| (v, all[v as usize]));
        assert!(near.len() > 5 && near.len() < all.len());
        assert_eq!(near, expected.collect());
    }

    #[test]
    fn jumps_close_around_every_triangle_but_wind_once_around_an_annulus() {
        let mesh = grid(9, 5, true, false);
        let bottom = 0;
        let (_, by) = distances(&mesh, &[bottom]);
        let path = trace(&mesh, &by, 45);
        let s = jumps(&mesh, &path, &[]);
        for t in 0..mesh.triangles.len() {
            assert_eq!(s[3 * t] + s[3 * t + 1] + s[3 * t + 2], 0, "triangle {t}");
        }
        let around = mesh.boundary_loops()[0].iter().map(|&h| s[h as usize]).sum::<i32>();
        assert_eq!(around.abs(), 1);
    }

    #[test]
    fn a_path_runs_from_source_to_target() {
        let mesh = grid(6, 6, false, false);
        let (distance, by) = distances(&mesh, &[0]);
        let path = trace(&mesh, &by, 48);
        assert_eq!((path[0], path[path.len() - 1]), (0, 48));
        assert!((distance[48] - 2f64.sqrt()).abs() < 1e-12);
    }
}
