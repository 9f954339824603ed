//! The PLY writer: binary little-endian, positions in double precision.

use crate::mesh::{NONE, PolyMesh};

/// Writes a binary little-endian PLY file with polygons as they are; UVs go to the corners as `texcoord`, segments to the
/// faces, colours to the vertices. Groups, materials and normals have no place in it.
pub(in crate::mesh) fn write(mesh: &PolyMesh) -> Vec<u8> {
    let attributes = &mesh.attributes;
    let corners = mesh.faces.corners().len();
    let is_full = |indices: &[u32]| indices.len() == corners && !indices.contains(&NONE);
    let uvs = attributes.uvs.as_ref().filter(|layer| is_full(&layer.corners));
    let segments = attributes.segments.as_ref().filter(|s| s.iter().all(|s| i32::try_from(*s).is_ok()));
    let degree = mesh.faces.iter().map(<[u32]>::len).max().unwrap_or(0);
    let wide = degree > 127;
    let mut out = header(mesh, wide, uvs.is_some(), segments.is_some()).into_bytes();
    for (v, position) in mesh.positions.iter().enumerate() {
        position.iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
        if let Some(color) = attributes.colors.as_ref().and_then(|colors| colors.get(v)) {
            color.iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
        }
    }
    let count = |n: usize, out: &mut Vec<u8>| {
        if wide {
            out.extend_from_slice(&(n as u32).to_le_bytes());
        } else {
            out.push(n as u8);
        }
    };
    for (f, face) in mesh.faces.iter().enumerate() {
        count(face.len(), &mut out);
        face.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        if let Some(layer) = uvs {
            count(2 * face.len(), &mut out);
            let start = mesh.faces.start(f);
            for uv in layer.corners.get(start..start + face.len()).unwrap_or_default() {
                let [u, v] = layer.values.get(*uv as usize).copied().unwrap_or_default();
                out.extend_from_slice(&u.to_le_bytes());
                out.extend_from_slice(&v.to_le_bytes());
            }
        }
        if let Some(segments) = segments {
            let segment = segments.get(f).copied().unwrap_or_default();
            out.extend_from_slice(&(segment as i32).to_le_bytes());
        }
    }
    out
}

fn header(mesh: &PolyMesh, wide: bool, uvs: bool, segments: bool) -> String {
    let count = if wide { "uint" } else { "uchar" };
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n",
        mesh.positions.len()
    );
    if mesh.attributes.colors.is_some() {
        for channel in ["red", "green", "blue", "alpha"] {
            text += &format!("property float {channel}\n");
        }
    }
    text += &format!("element face {}\nproperty list {count} uint vertex_indices\n", mesh.faces.len());
    if uvs {
        text += &format!("property list {count} double texcoord\n");
    }
    if segments {
        text += "property int segment\n";
    }
    text + "end_header\n"
}
