//! An example, an input and the truth, in memory.

use super::loaded::Loaded;
use quadmuse_kernel::mesh::{self, PolyMesh, Vec3};
use quadmuse_tests::real_input::pairs::Pair;
use std::path::Path;

/// What is mapped, and where it belongs.
#[derive(Clone, Debug)]
pub struct Case {
    /// The quads.
    pub example: Loaded,
    /// The scan.
    pub input: Loaded,
    /// Where each vertex of the example's mesh belongs on the scan, in the order of the mesh.
    pub truth: Vec<Vec3>,
}

impl Case {
    /// Reads a pair, with another example of the same connectivity if one is given.
    ///
    /// # Errors
    /// What could not be read; a sentence.
    pub fn read(pair: &Pair, example: Option<&Path>) -> Result<Self, String> {
        let example = Loaded::read(example.unwrap_or(&pair.example))?;
        let truth = poly(&pair.truth)?;
        let [expected, found] = [&example.poly, &truth].map(|m| (m.positions.len(), m.faces.len()));
        if expected != found {
            return Err(format!("{}: expected {expected:?} vertices and faces, found {found:?}", pair.truth.display()));
        }
        Ok(Self { example, input: Loaded::read(&pair.input)?, truth: truth.positions })
    }
}

/// A mesh as it stands in a file.
///
/// # Errors
/// A sentence.
pub fn poly(path: &Path) -> Result<PolyMesh, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    mesh::read(&bytes, None, &Default::default()).map_err(|e| format!("{}: {e}", path.display()))
}
