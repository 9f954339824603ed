//! glTF 2.0, binary (`.glb`) and JSON with embedded buffers (`.gltf`).
//!
//! Only the crate's JSON types are used: buffers and accessors are read here with checked arithmetic, so that no file can
//! lead to a panic, and references to other files are refused without being looked at. Polygons survive by the community
//! extension `FB_ngon_encoding` (consecutive triangles with the same first vertex are one polygon).

mod accessor;
mod container;
mod scene;
mod write;

pub(super) use scene::read;
pub(super) use write::write;

use super::Format;
use super::error::{FileLocation, MeshError};

/// Name of the extension by which polygons are kept.
const NGON_EXTENSION: &str = "FB_ngon_encoding";

/// An error without a line.
fn malformed(place: FileLocation, expected: &'static str, found: String) -> MeshError {
    let remedy = "the file is damaged: export it again";
    MeshError::Malformed { format: Format::Glb, place, expected: expected.into(), found, remedy }
}

#[cfg(test)]
mod tests;
