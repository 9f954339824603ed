//! The meshes of a pair.

use quadmuse_kernel::mesh::{self, Limits, NONE, PolyMesh, Prepared, Vec3};
use quadmuse_kernel::topology::{Components, Patch, primitive, whole};
use std::path::Path;

/// A mesh with its surface.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// As in the file.
    pub poly: PolyMesh,
    /// As it can be computed with.
    pub prepared: Prepared,
    /// The whole of it.
    pub patch: Patch,
}

impl Loaded {
    /// Reads a mesh that is one primitive.
    ///
    /// # Errors
    /// What is wrong with it; a sentence.
    pub fn read(path: &Path) -> Result<Self, String> {
        let said = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
        let bytes = std::fs::read(path).map_err(|e| said(&e))?;
        let poly = mesh::read(&bytes, None, &Limits::default()).map_err(|e| said(&e))?;
        let prepared = mesh::prepare(&poly).map_err(|e| said(&e))?;
        let patch = whole(&prepared.mesh).map_err(|e| said(&e))?;
        Ok(Self { poly, prepared, patch })
    }

    /// A mesh that was cut from another; small components of the cut are left out.
    ///
    /// # Errors
    /// What is wrong with it; a sentence.
    pub fn cut(poly: PolyMesh) -> Result<Self, String> {
        let prepared = mesh::prepare(&poly).map_err(|e| e.to_string())?;
        let patch = primitive(&prepared.mesh, Components::SmallLeftOut).map_err(|e| e.to_string())?;
        Ok(Self { poly, prepared, patch })
    }

    /// For each vertex of the patch a place of a mesh with the same vertex order as the file's.
    pub fn in_order_of(&self, truth: &[Vec3]) -> Vec<Vec3> {
        let mut of_surface = vec![Vec3::zeros(); self.prepared.mesh.positions.len()];
        for (place, &v) in truth.iter().zip(&self.prepared.vertex_of) {
            if v != NONE {
                of_surface[v as usize] = *place;
            }
        }
        self.patch.vertex_of.iter().map(|&v| of_surface[v as usize]).collect()
    }
}
