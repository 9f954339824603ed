//! The manifold meshes at hand.

use quadmuse_kernel::mesh::{self, Limits, TriMesh};
use quadmuse_tests::shared::{column, csv};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Folders that tell of their meshes in a manifest.
const WITH_MANIFEST: [&str; 3] = ["scans", "quads", "shapes"];

/// The files under `meshes` that are said to be manifold: those of manifests, and the examples and inputs of the pairs.
///
/// # Errors
/// A manifest can't be read; a sentence.
pub fn manifold(meshes: &Path) -> Result<Vec<PathBuf>, String> {
    let rows = |path: PathBuf| {
        std::fs::read_to_string(&path).map(|text| csv(&text)).map_err(|e| format!("{}: {e}", path.display()))
    };
    let mut files = Vec::new();
    for folder in WITH_MANIFEST.map(|name| meshes.join(name)) {
        let is_manifold = |row: &Vec<(String, String)>| {
            let none = |name| matches!(column(row, name), "" | "0");
            none("nonmanifold_edges") && none("nonmanifold_vertices") && column(row, "orientable") != "False"
        };
        let listed = rows(folder.join("manifest.csv"))?;
        files.extend(listed.iter().filter(|r| is_manifold(r)).map(|r| folder.join(column(r, "file"))));
    }
    let folder = meshes.join("groundtruth");
    for row in rows(folder.join("pairs.csv"))? {
        files.extend(["example", "input"].map(|name| folder.join(column(&row, name))));
    }
    files.retain(|f| f.extension().is_some_and(|e| e != "csv" && e != "json"));
    files.sort();
    files.dedup();
    Ok(files)
}

/// The surface in a file.
///
/// # Errors
/// What is wrong with it; a sentence.
pub fn surface(path: &Path) -> Result<Arc<TriMesh>, String> {
    let said = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let bytes = std::fs::read(path).map_err(|e| said(&e))?;
    let poly = mesh::read(&bytes, None, &Limits::default()).map_err(|e| said(&e))?;
    Ok(mesh::prepare(&poly).map_err(|e| said(&e))?.mesh)
}
