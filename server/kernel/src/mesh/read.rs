//! Reading a mesh of any format.

use super::error::{MeshError, MeshErrorKind, quoted};
use super::text::within;
use super::{Format, Limits, PolyMesh, gltf, obj, off, ply, stl};

/// Coordinates beyond this overflow when areas are squared.
const COORDINATE_MAX: f64 = 1e60;

/// Reads a mesh. Without a format, it is recognised from the bytes.
///
/// The result has at least one face; every face has at least three corners, all of them in range and finite.
///
/// # Errors
/// What breaks the format's rules, with its line or element; the limit that is exceeded; a mesh without faces.
pub fn read(bytes: &[u8], format: Option<Format>, limits: &Limits) -> Result<PolyMesh, MeshError> {
    within("bytes", bytes.len(), limits.bytes_max)?;
    let recognised = Format::sniff(bytes);
    let Some(chosen) = format.or(recognised) else {
        if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
            return Err(MeshError::Encoding { found: "UTF-16" });
        }
        return Err(MeshError::FormatUnknown { found: quoted(bytes) });
    };
    let mesh = match chosen {
        Format::Obj => obj::read(bytes, limits),
        Format::Ply => ply::read(bytes, limits),
        Format::Stl => stl::read(bytes, limits),
        Format::Off => off::read(bytes, limits),
        Format::Glb => gltf::read(bytes, limits),
    };
    let mesh = mesh.map_err(|error| match recognised {
        Some(looks_like) if looks_like != chosen && error.code() == MeshErrorKind::Unreadable => {
            MeshError::OtherFormat { declared: chosen, looks_like }
        }
        _ => error,
    })?;
    if mesh.faces.is_empty() {
        return Err(match recognised {
            Some(looks_like) if looks_like != chosen => MeshError::OtherFormat { declared: chosen, looks_like },
            _ => MeshError::NoFaces { vertices: mesh.positions.len() },
        });
    }
    check(&mesh)?;
    Ok(mesh)
}

/// Checks that faces have three corners in range and that used positions are finite; returns which vertices are used.
///
/// # Errors
/// The first face or vertex that cannot be used, or that there is no face.
pub(super) fn check(mesh: &PolyMesh) -> Result<Vec<bool>, MeshError> {
    if mesh.faces.is_empty() {
        return Err(MeshError::NoFaces { vertices: mesh.positions.len() });
    }
    let vertices = mesh.positions.len();
    // Halfedges of the triangles are counted in 32 bits.
    within("corners", mesh.faces.corners().len(), (u32::MAX / 4) as usize)?;
    let mut used = vec![false; vertices];
    for (face, corners) in mesh.faces.iter().enumerate() {
        if corners.len() < 3 {
            return Err(MeshError::FaceInvalid { face, vertices, found: format!("{} corners", corners.len()) });
        }
        for v in corners {
            match used.get_mut(*v as usize) {
                Some(used) => *used = true,
                None => {
                    let found = format!("vertex {}", u64::from(*v) + 1);
                    return Err(MeshError::FaceInvalid { face, vertices, found });
                }
            }
        }
    }
    let usable = |x: &f64| x.abs() <= COORDINATE_MAX;
    match (0..vertices).find(|v| used[*v] && !mesh.positions[*v].iter().all(usable)) {
        Some(vertex) => Err(MeshError::NotFinite { vertex, position: mesh.positions[vertex] }),
        None => Ok(used),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(bytes: &[u8], format: Option<Format>) -> MeshError {
        read(bytes, format, &Limits::default()).expect_err("not a usable mesh")
    }

    #[test]
    fn what_is_no_mesh_is_told_apart() {
        assert_eq!(refused(b"hello, world", None).code(), MeshErrorKind::FormatUnknown);
        assert_eq!(refused(b"", None).code(), MeshErrorKind::FormatUnknown);
        assert_eq!(refused(b"v 0 0 0\nv 1 0 0\n", None), MeshError::NoFaces { vertices: 2 });
        assert!(matches!(refused(b"\xff\xfev\0 \0", None), MeshError::Encoding { .. }));
    }

    #[test]
    fn a_file_under_a_wrong_name_is_recognised() {
        let error = refused(b"ply\nformat ascii 1.0\nend_header\n", Some(Format::Obj));
        assert_eq!(error, MeshError::OtherFormat { declared: Format::Obj, looks_like: Format::Ply });
        assert!(error.to_string().contains("model/ply"));
    }

    #[test]
    fn unusable_positions_matter_only_where_a_face_uses_them() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\n";
        assert!(read(text.as_bytes(), None, &Limits::default()).is_ok());
        let error = refused(text.replace("f 1 2 3", "f 1 2 4").as_bytes(), None);
        assert!(matches!(error, MeshError::NotFinite { vertex: 3, .. }), "{error}");
        assert!(error.to_string().starts_with("vertex 4 (counted from 1)"));
        assert!(matches!(refused(b"v 1e999 0 0\nf 1 1 1\n", None), MeshError::NotFinite { vertex: 0, .. }));
    }

    #[test]
    fn the_file_size_is_limited() {
        let limits = Limits { bytes_max: 3, ..Limits::default() };
        assert!(matches!(
            read(b"v 0 0 0", None, &limits),
            Err(MeshError::TooLarge { what: "bytes", found: 7, limit: 3 })
        ));
    }
}
