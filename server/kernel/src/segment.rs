//! Segmentation: a surface of any genus, with any boundaries and components, cut into parts that are primitives.
//!
//! Every part is a disc or an annulus, save components that are spheres or tori and were left whole. Cuts run freely
//! through triangles: the triangles that a cut crosses are split, and keep the number of the triangle and of the polygon
//! that they were cut from, so that a polygon across a cut can be put together again.
//! *Source:* paper §4.1 and §6 (phantom edges); the paper's own cuts were made by hand (its reference \[26\]).
//! *Ours, not the paper's:* everything that finds the cuts; see the parts.

mod seams;

use crate::mesh::tri::TriMesh;
use crate::topology::{self, Patch, TopologyError};

pub use seams::{Seam, SeamShape};

/// A surface cut into parts.
///
/// The parts' [`Patch::vertex_of`] and [`Patch::triangle_of`] point into [`Self::mesh`], and so do all other numbers
/// here. `mesh` without the cuts is the surface that was given: its first vertices are the surface's, in their order; the
/// rest lie on the surface's edges or in its triangles.
#[derive(Clone, Debug)]
pub struct Segmented {
    /// The surface, refined so that every cut runs along edges. An edge that does not lie on one of the surface's
    /// polygon edges is phantom.
    pub mesh: TriMesh,
    /// How many vertices the surface had before it was refined.
    pub surface_vertices: usize,
    /// Part of each triangle of `mesh`.
    pub part_of: Vec<u32>,
    /// Triangle of the given surface in which each triangle of `mesh` lies.
    pub source_of: Vec<u32>,
    /// The parts, each ready to be unfolded.
    pub parts: Vec<Patch>,
    /// Where parts border on each other, in order of their parts.
    pub seams: Vec<Seam>,
}

impl Segmented {
    /// One part, the whole surface.
    ///
    /// # Errors
    /// [`TopologyError`] for a surface that is no primitive.
    pub fn whole(surface: &TriMesh) -> Result<Self, TopologyError> {
        let part = topology::whole(surface)?;
        Ok(Self::uncut(surface, vec![part]))
    }

    /// One part a label, in order of label; `labels` holds one a polygon, so every cut runs along polygon edges.
    ///
    /// # Errors
    /// See [`topology::by_labels`].
    pub fn by_labels(surface: &TriMesh, labels: &[i64]) -> Result<Self, TopologyError> {
        let parts = topology::by_labels(surface, labels)?;
        Ok(Self::uncut(surface, parts))
    }

    /// Parts that are cut along edges of the surface as it is.
    fn uncut(surface: &TriMesh, parts: Vec<Patch>) -> Self {
        let mut part_of = vec![0; surface.triangles.len()];
        for (number, part) in parts.iter().enumerate() {
            part.triangle_of.iter().for_each(|&t| part_of[t as usize] = number as u32);
        }
        let source_of = (0..surface.triangles.len() as u32).collect();
        let seams = seams::between(surface, &part_of);
        Self { mesh: surface.clone(), surface_vertices: surface.positions.len(), part_of, source_of, parts, seams }
    }

    /// The parts that border on part `part`, in order, each once.
    pub fn neighbours(&self, part: u32) -> Vec<u32> {
        let other = |s: &Seam| match s.parts {
            [a, b] if a == part => Some(b),
            [a, b] if b == part => Some(a),
            _ => None,
        };
        let mut found: Vec<u32> = self.seams.iter().filter_map(other).collect();
        found.sort_unstable();
        found.dedup();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn labels_along_polygon_edges_refine_nothing() {
        let mesh = grid(8, 6, true, false);
        let labels: Vec<i64> = (0..mesh.triangles.len() as i64).map(|t| t / 32).collect();
        let cut = Segmented::by_labels(&mesh, &labels).expect("three rings");
        assert_eq!(cut.mesh, mesh);
        assert_eq!(cut.parts.len(), 3);
        assert_eq!(cut.neighbours(1), [0, 2]);
        assert_eq!(cut.neighbours(2), [1]);
    }
}
