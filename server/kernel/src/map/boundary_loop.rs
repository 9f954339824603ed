//! A boundary loop by its arc length.

use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;

/// A boundary loop of a mesh.
pub(super) struct BoundaryLoop {
    /// Its halfedges in order.
    pub(super) halfedges: Vec<u32>,
    /// Arc length at each halfedge's tail.
    pub(super) starts: Vec<f64>,
    /// Length of the whole.
    pub(super) length: f64,
}

impl BoundaryLoop {
    /// The loop of these halfedges.
    pub(super) fn new(mesh: &TriMesh, halfedges: Vec<u32>) -> Self {
        let (mut starts, mut length) = (Vec::with_capacity(halfedges.len()), 0.0);
        for &h in &halfedges {
            starts.push(length);
            length += edge(mesh, h);
        }
        Self { halfedges, starts, length }
    }

    /// The point at an arc length.
    pub(super) fn at(&self, mesh: &TriMesh, s: f64) -> Vec3 {
        let (h, share) = self.place(s);
        mesh.point_on(h, share)
    }

    /// The halfedge at an arc length, and the share of it.
    fn place(&self, s: f64) -> (u32, f64) {
        let s = s.rem_euclid(self.length.max(f64::MIN_POSITIVE));
        let k = self.starts.partition_point(|start| *start <= s).saturating_sub(1);
        let end = self.starts.get(k + 1).copied().unwrap_or(self.length);
        let share = ((s - self.starts[k]) / (end - self.starts[k]).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (self.halfedges[k], share)
    }

    /// The place at an arc length.
    pub(super) fn location(&self, s: f64) -> Location {
        let (h, share) = self.place(s);
        Location::on_edge(h, share)
    }

    /// The arc length of the loop's point nearest to `x`, and how far that is.
    pub(super) fn nearest(&self, mesh: &TriMesh, x: Vec3) -> (f64, f64) {
        let mut best = (0.0, f64::INFINITY);
        for (&h, start) in self.halfedges.iter().zip(&self.starts) {
            let share = mesh.nearest_share(h, x);
            let away = (mesh.point_on(h, share) - x).norm_squared();
            if away < best.1 {
                best = (start + share * edge(mesh, h), away);
            }
        }
        (best.0, best.1.sqrt())
    }
}

fn edge(mesh: &TriMesh, h: u32) -> f64 {
    (mesh.positions[mesh.head(h) as usize] - mesh.positions[mesh.tail(h) as usize]).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn places_and_arc_lengths_of_a_square_are_each_others_inverse() {
        let mesh = grid(4, 4, false, false);
        let ring = BoundaryLoop::new(&mesh, mesh.boundary_loops().remove(0));
        assert!((ring.length - 4.0).abs() < 1e-12);
        for s in [0.0, 0.3, 1.0, 2.9, 3.99] {
            let (back, away) = ring.nearest(&mesh, ring.at(&mesh, s));
            assert!((back - s).abs() < 1e-9 && away < 1e-12, "{s} {back} {away}");
            assert!((ring.at(&mesh, s + 4.0) - ring.at(&mesh, s)).norm() < 1e-9);
        }
        assert!((ring.nearest(&mesh, Vec3::new(0.5, -0.2, 0.0)).1 - 0.2).abs() < 1e-12);
    }
}
