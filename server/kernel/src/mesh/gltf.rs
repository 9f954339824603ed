//! gltf (to come).
use super::error::MeshError;
use super::{Limits, PolyMesh};
pub(super) fn read(_bytes: &[u8], _limits: &Limits) -> Result<PolyMesh, MeshError> {
    Err(MeshError::Encoding { found: "a format not read yet" })
}
pub(super) fn write(_mesh: &PolyMesh) -> Result<Vec<u8>, MeshError> {
    Ok(Vec::new())
}
