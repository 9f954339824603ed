//! The kernel from outside.
//!
//! Real meshes lie outside of the project, in `../shared/meshes` or where `QUADMUSE_SHARED` says.

mod boundary;
mod hostile_meshes;
mod mesh_fuzz;
mod mesh_growth;
mod stopping;
mod tori;
mod unfolding;
mod validity;

use std::path::{Path, PathBuf};

/// The folder of a kind of meshes, or `None` (and a note) where there is none.
fn folder(kind: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let shared = std::env::var_os("QUADMUSE_SHARED").map_or(beside, PathBuf::from);
    let folder = shared.join("meshes").join(kind);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("{} is absent: nothing tested", folder.display());
    None
}
