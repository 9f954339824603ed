//! The GLB writer: triangles in single precision, with polygons kept by `FB_ngon_encoding`.

use super::NGON_EXTENSION;
use crate::mesh::error::MeshError;
use crate::mesh::{NONE, PolyMesh, Vec3};
use std::collections::HashMap;
use std::fmt::Write;

/// Writes a `.glb` with one primitive a material, faces in their order within each. Vertices are split where their UVs
/// differ. Importers that know `FB_ngon_encoding` get the polygons back; the primitive's `extras` count them.
///
/// # Errors
/// [`MeshError::TooLarge`] beyond 4 GB; [`MeshError::NotFinite`] for positions that single precision cannot hold.
pub(in crate::mesh) fn write(mesh: &PolyMesh) -> Result<Vec<u8>, MeshError> {
    let split = Split::new(mesh)?;
    let materials = by_material(mesh);
    let mut binary = Vec::new();
    let mut json = Json::default();
    let position = json.accessor(split.positions.len(), "VEC3", FLOAT, &split.bounds(), &mut binary, |out| {
        split.positions.iter().flatten().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
    });
    let uv = (!split.uvs.is_empty()).then(|| {
        json.accessor(split.uvs.len(), "VEC2", FLOAT, "", &mut binary, |out| {
            split.uvs.iter().flatten().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
        })
    });
    let mut primitives = Vec::new();
    for (k, (material, faces)) in materials.iter().enumerate() {
        let triangles = fans(mesh, faces, &split.vertex_of);
        let indices = json.accessor(3 * triangles.len(), "SCALAR", UNSIGNED_INT, "", &mut binary, |out| {
            triangles.iter().flatten().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        });
        let uv = uv.map(|uv| format!(",\"TEXCOORD_0\":{uv}")).unwrap_or_default();
        let material = if *material == NONE { String::new() } else { format!(",\"material\":{k}") };
        let quads = faces.iter().filter(|f| mesh.faces.face(**f as usize).len() == 4).count();
        primitives.push(format!(
            "{{\"attributes\":{{\"POSITION\":{position}{uv}}},\"indices\":{indices}{material},\"extensions\":\
             {{\"{NGON_EXTENSION}\":{{}}}},\"extras\":{{\"polygons\":{},\"quads\":{quads}}}}}",
            faces.len()
        ));
    }
    let names: Vec<String> = materials
        .iter()
        .map(|(material, _)| {
            let labels = mesh.attributes.materials.as_ref();
            let name = labels.and_then(|labels| labels.names.get(*material as usize));
            format!("{{\"name\":{}}}", json_string(name.map_or("none", String::as_str)))
        })
        .collect();
    container(&json.finish(&primitives, &names, binary.len()), &binary)
}

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// Vertices with one UV each.
struct Split {
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    /// The split vertex of each corner.
    vertex_of: Vec<u32>,
}

impl Split {
    fn new(mesh: &PolyMesh) -> Result<Self, MeshError> {
        let layer = mesh.attributes.uvs.as_ref();
        let (mut number_of, mut split) =
            (HashMap::new(), Self { positions: Vec::new(), uvs: Vec::new(), vertex_of: Vec::new() });
        for (c, vertex) in mesh.faces.corners().iter().enumerate() {
            let uv = layer.and_then(|layer| layer.corners.get(c).copied()).unwrap_or(NONE);
            let next = split.positions.len() as u32;
            let number = *number_of.entry((*vertex, uv)).or_insert(next);
            split.vertex_of.push(number);
            if number < next {
                continue;
            }
            let position: Vec3 = mesh.positions[*vertex as usize];
            let single: [f32; 3] = position.map(|x| x as f32).into();
            if single.iter().any(|x| !x.is_finite()) {
                return Err(MeshError::NotFinite { vertex: *vertex as usize, position });
            }
            split.positions.push(single);
            if let Some(layer) = layer {
                let [u, v] = layer.values.get(uv as usize).copied().unwrap_or_default();
                split.uvs.push([u as f32, (1.0 - v) as f32]);
            }
        }
        Ok(split)
    }

    /// `min` and `max` of the positions, as the format demands.
    fn bounds(&self) -> String {
        let fold = |f: fn(f32, f32) -> f32| {
            let first = self.positions.first().copied().unwrap_or_default();
            self.positions.iter().fold(first, |sum, p| [f(sum[0], p[0]), f(sum[1], p[1]), f(sum[2], p[2])])
        };
        format!(",\"min\":{:?},\"max\":{:?}", fold(f32::min), fold(f32::max))
    }
}

/// Materials in order of first use, with their faces.
fn by_material(mesh: &PolyMesh) -> Vec<(u32, Vec<u32>)> {
    let labels = mesh.attributes.materials.as_ref();
    let mut groups: Vec<(u32, Vec<u32>)> = Vec::new();
    let mut group_of = HashMap::new();
    for f in 0..mesh.faces.len() {
        let material = labels.and_then(|labels| labels.of_face.get(f).copied()).unwrap_or(NONE);
        let group = *group_of.entry(material).or_insert(groups.len());
        if group == groups.len() {
            groups.push((material, Vec::new()));
        }
        groups[group].1.push(f as u32);
    }
    groups
}

/// Fans of triangles, one a face; no fan starts at the vertex at which the one before does.
fn fans(mesh: &PolyMesh, faces: &[u32], vertex_of: &[u32]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    let mut last = NONE;
    for f in faces {
        let face = mesh.faces.face(*f as usize);
        let n = face.len();
        let start = mesh.faces.start(*f as usize);
        let at = |k: usize| vertex_of[start + k % n];
        let preferred = usize::from(n == 4 && crate::mesh::write::second_diagonal_is_better(mesh, face));
        let step = if n == 4 { 2 } else { 1 };
        let from = if at(preferred) == last { preferred + step } else { preferred };
        last = at(from);
        triangles.extend((1..n.saturating_sub(1)).map(|k| [at(from), at(from + k), at(from + k + 1)]));
    }
    triangles
}

/// Accessors and views while they are written.
#[derive(Default)]
struct Json {
    accessors: Vec<String>,
    views: Vec<String>,
}

impl Json {
    fn accessor(
        &mut self,
        count: usize,
        kind: &str,
        component: u32,
        more: &str,
        binary: &mut Vec<u8>,
        fill: impl FnOnce(&mut Vec<u8>),
    ) -> usize {
        let start = binary.len();
        fill(binary);
        let view = self.views.len();
        self.views.push(format!("{{\"buffer\":0,\"byteOffset\":{start},\"byteLength\":{}}}", binary.len() - start));
        self.accessors.push(format!(
            "{{\"bufferView\":{view},\"componentType\":{component},\"count\":{count},\"type\":\"{kind}\"{more}}}"
        ));
        view
    }

    fn finish(&self, primitives: &[String], materials: &[String], bytes: usize) -> String {
        format!(
            "{{\"asset\":{{\"version\":\"2.0\",\"generator\":\"Quadmuse\"}},\"extensionsUsed\":[\"{NGON_EXTENSION}\"],\
             \"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0}}],\"meshes\":[{{\"primitives\":[{}]}}],\
             \"materials\":[{}],\"accessors\":[{}],\"bufferViews\":[{}],\"buffers\":[{{\"byteLength\":{bytes}}}]}}",
            primitives.join(","),
            materials.join(","),
            self.accessors.join(","),
            self.views.join(",")
        )
    }
}

fn json_string(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c < ' ' => _ = write!(out, "\\u{:04x}", u32::from(c)),
            c => out.push(c),
        }
    }
    out + "\""
}

fn container(json: &str, binary: &[u8]) -> Result<Vec<u8>, MeshError> {
    let (json_size, binary_size) = (json.len().next_multiple_of(4), binary.len().next_multiple_of(4));
    let total = 12 + 8 + json_size + 8 + binary_size;
    let Ok(length) = u32::try_from(total) else {
        return Err(MeshError::TooLarge { what: "bytes of a .glb", found: total as u64, limit: u64::from(u32::MAX) });
    };
    let mut out = Vec::with_capacity(total);
    let words = |out: &mut Vec<u8>, words: &[u32]| words.iter().for_each(|w| out.extend_from_slice(&w.to_le_bytes()));
    out.extend_from_slice(b"glTF");
    words(&mut out, &[2, length, json_size as u32, 0x4e4f_534a]);
    out.extend_from_slice(json.as_bytes());
    out.resize(20 + json_size, b' ');
    words(&mut out, &[binary_size as u32, 0x004e_4942]);
    out.extend_from_slice(binary);
    out.resize(total, 0);
    Ok(out)
}
