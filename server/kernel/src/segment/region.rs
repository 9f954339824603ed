//! Regions: sets of triangles of a surface, as meshes of their own.

use crate::mesh::tri::TriMesh;
use crate::topology::{self, Topology};

/// A set of triangles.
#[derive(Clone, Debug)]
pub(super) struct Region {
    /// Its mesh; vertices at which it only touches itself are split.
    pub(super) mesh: TriMesh,
    /// Triangle of the surface of each triangle.
    pub(super) triangle_of: Vec<u32>,
}

impl Region {
    pub(super) fn new(surface: &TriMesh, triangles: Vec<u32>) -> Self {
        let (mesh, _) = topology::submesh(surface, &triangles);
        Self { mesh, triangle_of: triangles }
    }

    /// The primitive that it is, if it is one.
    pub(super) fn primitive(&self) -> Option<Topology> {
        topology::classify(&self.mesh).ok()
    }

    /// Groups of its triangles (by one number each), as sets of triangles of the surface; each connected.
    pub(super) fn groups(&self, group_of: &[u32]) -> Vec<Vec<u32>> {
        topology::connected(&self.mesh, group_of)
            .into_iter()
            .map(|g| g.iter().map(|&t| self.triangle_of[t as usize]).collect())
            .collect()
    }
}
