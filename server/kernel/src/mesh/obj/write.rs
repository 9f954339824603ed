//! The OBJ writer.

use crate::mesh::text::{push_integer, push_number, push_number_f32};
use crate::mesh::{CornerLayer, FaceLabels, NONE, PolyMesh};

/// Writes an OBJ file: every position, UV and normal in its order, every face with its group and material.
pub(in crate::mesh) fn write(mesh: &PolyMesh) -> Vec<u8> {
    let mut out = Vec::with_capacity(32 * mesh.positions.len() + 16 * mesh.faces.corners().len());
    positions(mesh, &mut out);
    let attributes = &mesh.attributes;
    pool(b"vt", attributes.uvs.as_ref(), &mut out);
    pool(b"vn", attributes.normals.as_ref(), &mut out);
    let (mut group, mut material) = (NONE, NONE);
    for (f, face) in mesh.faces.iter().enumerate() {
        label(b"g", attributes.groups.as_ref(), f, &mut group, &mut out);
        label(b"usemtl", attributes.materials.as_ref(), f, &mut material, &mut out);
        out.push(b'f');
        for (k, vertex) in face.iter().enumerate() {
            corner(mesh, *vertex, mesh.faces.start(f) + k, &mut out);
        }
        out.push(b'\n');
    }
    for crease in &attributes.creases {
        out.extend_from_slice(b"t crease 2/1/0");
        for vertex in crease.vertices {
            out.push(b' ');
            push_integer(&mut out, vertex.into());
        }
        out.push(b' ');
        push_number_f32(&mut out, crease.sharpness);
        out.push(b'\n');
    }
    out
}

fn positions(mesh: &PolyMesh, out: &mut Vec<u8>) {
    let opaque = mesh.attributes.colors.iter().flatten().all(|color| color[3] == 1.0);
    let channels = if opaque { 3 } else { 4 };
    for (v, position) in mesh.positions.iter().enumerate() {
        numbers(b"v", position.as_slice(), out);
        if let Some(color) = mesh.attributes.colors.as_ref().and_then(|colors| colors.get(v)) {
            for channel in &color[..channels] {
                out.push(b' ');
                push_number_f32(out, *channel);
            }
        }
        out.push(b'\n');
    }
}

fn pool<const N: usize>(keyword: &[u8], layer: Option<&CornerLayer<[f64; N]>>, out: &mut Vec<u8>) {
    for value in layer.iter().flat_map(|layer| &layer.values) {
        numbers(keyword, value, out);
        out.push(b'\n');
    }
}

fn numbers(keyword: &[u8], values: &[f64], out: &mut Vec<u8>) {
    out.extend_from_slice(keyword);
    for value in values {
        out.push(b' ');
        push_number(out, *value);
    }
}

/// Writes a statement where the label of face `f` differs from the one before.
fn label(keyword: &[u8], labels: Option<&FaceLabels>, f: usize, current: &mut u32, out: &mut Vec<u8>) {
    let Some(labels) = labels else { return };
    let index = labels.of_face.get(f).copied().unwrap_or(NONE);
    if index == *current {
        return;
    }
    *current = index;
    out.extend_from_slice(keyword);
    if let Some(name) = labels.name(f) {
        out.push(b' ');
        out.extend(name.bytes().map(|b| if matches!(b, b'\n' | b'\r') { b' ' } else { b }));
    }
    out.push(b'\n');
}

fn corner(mesh: &PolyMesh, vertex: u32, c: usize, out: &mut Vec<u8>) {
    let index = |corners: Option<&Vec<u32>>| corners.and_then(|corners| corners.get(c).copied()).filter(|i| *i != NONE);
    let uv = index(mesh.attributes.uvs.as_ref().map(|layer| &layer.corners));
    let normal = index(mesh.attributes.normals.as_ref().map(|layer| &layer.corners));
    out.push(b' ');
    push_integer(out, u64::from(vertex) + 1);
    if uv.is_some() || normal.is_some() {
        out.push(b'/');
    }
    if let Some(uv) = uv {
        push_integer(out, u64::from(uv) + 1);
    }
    if let Some(normal) = normal {
        out.push(b'/');
        push_integer(out, u64::from(normal) + 1);
    }
}
