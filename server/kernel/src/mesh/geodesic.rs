//! Geodesic distance by fast marching.
//!
//! A front sweeps over the triangles. In the plane of a triangle a, b, c with d(a) and d(b) known, the source is put
//! where it has these distances to a and b, on the far side of ab; d(c) is its distance to c where the straight line
//! crosses ab, and the shorter way along the edges otherwise. *Source:* Kimmel and Sethian (1998), with the point source
//! of Novotni and Klein (2002).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::Vec3;
use super::tri::{NONE, TriMesh, prev};
use crate::numerics::stop;

/// Distances on one surface, from any sources.
#[derive(Debug)]
pub struct Marcher<'a> {
    mesh: &'a TriMesh,
    outgoing: Vec<u32>,
}

impl<'a> Marcher<'a> {
    /// Prepares a surface.
    pub fn new(mesh: &'a TriMesh) -> Self {
        Self { mesh, outgoing: mesh.outgoing() }
    }

    /// The surface.
    pub fn mesh(&self) -> &TriMesh {
        self.mesh
    }

    /// Distance of each vertex to the nearest source, in the mesh's units; infinite where none can be reached.
    pub fn distances(&self, sources: &[u32]) -> Vec<f64> {
        self.distances_within(sources, f64::INFINITY)
    }

    /// The same; infinite also where it is more than `most`. Costs what is within.
    pub fn distances_within(&self, sources: &[u32], most: f64) -> Vec<f64> {
        let mut distance = vec![f64::INFINITY; self.mesh.positions.len()];
        // Positive finite floats order like their bits, so the heap needs no float wrapper.
        let mut heap = BinaryHeap::new();
        for &s in sources {
            distance[s as usize] = 0.0;
            heap.push(Reverse((0u64, s)));
        }
        while let Some(Reverse((key, v))) = heap.pop() {
            stop::pass(1);
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
                    if d < distance[to as usize] && d <= most {
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
    fn bending_does_not_change_distances() {
        let flat = grid(40, 40, false, false);
        let mut bent = flat.clone();
        for p in &mut bent.positions {
            let angle = 3.0 * p.x;
            *p = Vec3::new(angle.sin() / 3.0, p.y, angle.cos() / 3.0);
        }
        let (one, two) = (Marcher::new(&flat).distances(&[5]), Marcher::new(&bent).distances(&[5]));
        let worst = one.iter().zip(&two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 0.006, "off by {worst}");
    }
}
