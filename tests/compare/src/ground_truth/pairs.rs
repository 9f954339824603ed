//! The pairs, and their meshes.

use quadmuse_kernel::mesh::{self, Limits, NONE, PolyMesh, Prepared, Vec3};
use quadmuse_kernel::topology::{Patch, whole};
use quadmuse_tests::shared::{column, csv};
use std::path::{Path, PathBuf};

/// A pair.
#[derive(Clone, Debug)]
pub struct Pair {
    /// `head`, `hand`, `mirrored`, `body`, `pose`, `animal`.
    pub kind: String,
    /// The quads.
    pub example: PathBuf,
    /// The scan.
    pub input: PathBuf,
    /// The example's vertices where they belong on the scan.
    pub truth: PathBuf,
}

impl Pair {
    /// A name for people: the input's.
    pub fn name(&self) -> String {
        let stem = self.input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        stem.trim_start_matches("input_").to_owned()
    }
}

/// Pairs of a shared folder, of some kinds (all, if none is named).
///
/// # Errors
/// The list can't be read; a sentence.
pub fn pairs(shared: &Path, kinds: &[String]) -> Result<Vec<Pair>, String> {
    let folder = shared.join("meshes/groundtruth");
    let list = folder.join("pairs.csv");
    let text = std::fs::read_to_string(&list).map_err(|e| format!("{}: {e}", list.display()))?;
    let pair = |row: &Vec<(String, String)>| Pair {
        kind: column(row, "kind").to_owned(),
        example: folder.join(column(row, "example")),
        input: folder.join(column(row, "input")),
        truth: folder.join(column(row, "truth")),
    };
    let all = csv(&text).iter().map(pair).collect::<Vec<_>>();
    Ok(all.into_iter().filter(|p| kinds.is_empty() || kinds.contains(&p.kind)).collect())
}

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
