//! Geodesic distance by fast marching.
//!
//! A front sweeps over the triangles. In the plane of a triangle a, b, c with d(a) and d(b) known, the source is put
//! where it has these distances to a and b, on the far side of ab; d(c) is its distance to c where the straight line
//! crosses ab, and the shorter way along the edges otherwise. *Source:* Kimmel and Sethian (1998), with the point source
//! of Novotni and Klein (2002).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh, prev};

/// Distances on one surface, from any sources.
#[derive(Debug)]
pub(super) struct Marcher<'a> {
    mesh: &'a TriMesh,
    outgoing: Vec<u32>,
}

impl<'a> Marcher<'a> {
    pub(super) fn new(mesh: &'a TriMesh) -> Self {
        Self { mesh, outgoing: mesh.outgoing() }
    }

    /// Distance of each vertex to the nearest source, in the mesh's units; infinite where none can be reached.
    pub(super) fn distances(&self, sources: &[u32]) -> Vec<f64> {
        let mut distance = vec![f64::INFINITY; self.mesh.positions.len()];
        // Positive finite floats order like their bits, so the heap needs no float wrapper.
        let mut heap = BinaryHeap::new();
        for &s in sources {
            distance[s as usize] = 0.0;
            heap.push(Reverse((0u64, s)));
        }
        while let Some(Reverse((key, v))) = heap.pop() {
            if f64::from_bits(key) > distance[v as usize] {
                continue;
            }
            self.for_each_face(v, |x, y| {
                for (from, to) in [(x, y), (y, x)] {
                    // What the front has passed already stays as it is.
                    if distance[to as usize] <= distance[v as usize] {
                        continue;
                    }
                    let d = self.across(&distance, v, from, to);
                    if d < distance[to as usize] {
                        distance[to as usize] = d;
                        heap.push(Reverse((d.to_bits(), to)));
                    }
                }
            });
        }
        distance
    }

    /// Calls `visit` with the other two vertices of each triangle at `v`, counter-clockwise.
    fn for_each_face(&self, v: u32, mut visit: impl FnMut(u32, u32)) {
        let start = self.outgoing[v as usize];
        let mut h = start;
        while h != NONE {
            visit(self.mesh.head(h), self.mesh.tail(prev(h)));
            h = self.mesh.twin(prev(h));
            if h == start {
                return;
            }
        }
    }

    /// The distance of `c` by way of the edge from `a` to `b`.
    fn across(&self, distance: &[f64], a: u32, b: u32, c: u32) -> f64 {
        let [pa, pb, pc] = [a, b, c].map(|v| self.mesh.positions[v as usize]);
        let [da, db] = [distance[a as usize], distance[b as usize]];
        let along = (da + (pc - pa).norm()).min(db + (pc - pb).norm());
        if db.is_finite() { straight([pa, pb, pc], [da, db]).map_or(along, |d| d.min(along)) } else { along }
    }
}

/// Distance of c to the source with distances `d` to a and b, if the line to it crosses ab.
fn straight([a, b, c]: [Vec3; 3], d: [f64; 2]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let length = ab.norm();
    if length <= 0.0 {
        return None;
    }
    let cx = ac.dot(&ab) / length;
    let cy = (ac.norm_squared() - cx * cx).max(0.0).sqrt();
    let sx = (d[0] * d[0] - d[1] * d[1] + length * length) / (2.0 * length);
    let sy = (d[0] * d[0] - sx * sx).max(0.0).sqrt();
    let crossing = if cy + sy > 0.0 { sx + (cx - sx) * sy / (cy + sy) } else { return None };
    (0.0..=length).contains(&crossing).then(|| ((cx - sx).powi(2) + (cy + sy).powi(2)).sqrt())
}

/// `count` vertices, each the furthest from those before it; the first is the furthest from the first vertex. Beside
/// each, its distances.
pub(super) fn spread(marcher: &Marcher<'_>, count: usize) -> Vec<(u32, Vec<f64>)> {
    let farthest = |d: &[f64]| {
        let finite = (0..d.len()).filter(|&v| d[v].is_finite());
        finite.max_by(|&a, &b| d[a].total_cmp(&d[b]).then(b.cmp(&a))).unwrap_or(0) as u32
    };
    let mut found: Vec<(u32, Vec<f64>)> = Vec::new();
    let mut nearest = marcher.distances(&[0]);
    for k in 0..count {
        let v = farthest(&nearest);
        if k > 0 && nearest[v as usize] <= 0.0 {
            break;
        }
        let d = marcher.distances(&[v]);
        match k {
            0 => nearest.clone_from(&d),
            _ => nearest.iter_mut().zip(&d).for_each(|(n, d)| *n = n.min(*d)),
        }
        found.push((v, d));
    }
    found
}

/// The vertices that share an edge with each vertex.
pub(super) fn neighbours(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut of: Vec<Vec<u32>> = vec![Vec::new(); mesh.positions.len()];
    for h in 0..mesh.twins.len() as u32 {
        of[mesh.tail(h) as usize].push(mesh.head(h));
        if mesh.twin(h) == NONE {
            of[mesh.head(h) as usize].push(mesh.tail(h));
        }
    }
    of
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn on_a_flat_sheet_distance_is_straight_in_every_direction() {
        let mesh = grid(20, 20, false, false);
        let d = Marcher::new(&mesh).distances(&[0]);
        for (v, p) in mesh.positions.iter().enumerate() {
            assert!((d[v] - p.norm()).abs() < 1e-9, "vertex {v} at {p}: {}", d[v]);
        }
    }

    #[test]
    fn spread_vertices_lie_far_apart() {
        let mesh = grid(10, 10, false, false);
        let found = spread(&Marcher::new(&mesh), 4);
        let mut corners: Vec<u32> = found.iter().map(|f| f.0).collect();
        corners.sort_unstable();
        assert_eq!(corners, [0, 10, 110, 120]);
    }
}
