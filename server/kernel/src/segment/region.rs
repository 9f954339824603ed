//! Regions: sets of triangles of a surface, as meshes of their own.

use crate::mesh::tri::{NONE, TriMesh};
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
        connected(&self.mesh, group_of)
            .into_iter()
            .map(|g| g.iter().map(|&t| self.triangle_of[t as usize]).collect())
            .collect()
    }
}

/// The connected sets of triangles of one label, each in order, in order of their lowest triangle.
pub(super) fn connected(mesh: &TriMesh, label_of: &[u32]) -> Vec<Vec<u32>> {
    let mut seen = vec![false; mesh.triangles.len()];
    let mut sets = Vec::new();
    for seed in 0..mesh.triangles.len() as u32 {
        if std::mem::replace(&mut seen[seed as usize], true) {
            continue;
        }
        let (mut set, mut next) = (vec![seed], 0);
        while let Some(&t) = set.get(next) {
            next += 1;
            for k in 0..3 {
                let g = mesh.twin(3 * t + k);
                if g == NONE || seen[g as usize / 3] || label_of[g as usize / 3] != label_of[seed as usize] {
                    continue;
                }
                seen[g as usize / 3] = true;
                set.push(g / 3);
            }
        }
        set.sort_unstable();
        sets.push(set);
    }
    sets
}

/// A number for each triangle: that of its set.
pub(super) fn numbers(sets: &[Vec<u32>], triangles: usize) -> Vec<u32> {
    let mut of = vec![0; triangles];
    for (k, set) in sets.iter().enumerate() {
        set.iter().for_each(|&t| of[t as usize] = k as u32);
    }
    of
}
