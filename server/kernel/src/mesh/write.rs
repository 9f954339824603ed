//! Writing a mesh in any format.

use super::error::MeshError;
use super::{Format, PolyMesh, gltf, obj, off, ply, stl};

/// Writes a mesh. OBJ keeps everything that a [`PolyMesh`] holds but segments; PLY keeps polygons, UVs, colours and
/// segments; OFF polygons; STL triangles; GLB triangles, UVs and (as `FB_ngon_encoding`) polygons.
///
/// # Errors
/// [`MeshError::TooLarge`] where the format cannot count so far; [`MeshError::FaceInvalid`] for a mesh with faces that name
/// missing vertices.
pub fn write(mesh: &PolyMesh, format: Format) -> Result<Vec<u8>, MeshError> {
    let vertices = mesh.positions.len();
    for (face, corners) in mesh.faces.iter().enumerate() {
        if let Some(v) = corners.iter().find(|v| **v as usize >= vertices) {
            return Err(MeshError::FaceInvalid { face, vertices, found: format!("vertex {}", u64::from(*v) + 1) });
        }
    }
    match format {
        Format::Obj => Ok(obj::write(mesh)),
        Format::Ply => Ok(ply::write(mesh)),
        Format::Stl => stl::write(mesh),
        Format::Off => Ok(off::write(mesh)),
        Format::Glb => gltf::write(mesh),
    }
}
