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

/// Triangles for formats that know nothing else: quads along their better diagonal, larger polygons as fans.
pub(super) fn fans(mesh: &PolyMesh) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(mesh.faces.corners().len());
    for face in mesh.faces.iter() {
        let turn = usize::from(face.len() == 4 && second_diagonal_is_better(mesh, face));
        let at = |k: usize| face[(k + turn) % face.len()];
        triangles.extend((1..face.len().saturating_sub(1)).map(|k| [at(0), at(k), at(k + 1)]));
    }
    triangles
}

/// Whether the triangles at the diagonal from the second corner of a quad agree better about where its front is.
pub(super) fn second_diagonal_is_better(mesh: &PolyMesh, quad: &[u32]) -> bool {
    let at = |k: usize| mesh.positions[quad[k % 4] as usize];
    let agreement = |k: usize| {
        let normal = |a: usize, b: usize, c: usize| (at(b) - at(a)).cross(&(at(c) - at(a)));
        let (first, second) = (normal(k, k + 1, k + 2), normal(k, k + 2, k + 3));
        let lengths = first.norm() * second.norm();
        if lengths > 0.0 { first.dot(&second) / lengths } else { -1.0 }
    };
    agreement(1) > agreement(0) + 1e-9
}
