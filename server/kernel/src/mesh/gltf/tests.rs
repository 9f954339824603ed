use super::{read, write};
use crate::mesh::obj;
use crate::mesh::{Limits, MeshError, PolyMesh, Vec3};

const CUBE: &str = "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nvt 0 0.25\nvt 1 0\nvt 1 1\n\
    usemtl a \"b\"\nf 1/1 4/2 3/3 2/2\nf 5/1 6/2 7/3 8/1\nf 1/1 2/2 6/3 5/1\nusemtl c\nf 3/1 4/2 8/3 7/1\nf 1/1 5/2 8/3\nf 1/1 8/3 4/1\nf 2/1 3/2 7/3 6/1\n";

fn cube() -> PolyMesh {
    obj::read(CUBE.as_bytes(), &Limits::default()).expect("a cube")
}

fn parse(bytes: &[u8]) -> Result<PolyMesh, MeshError> {
    read(bytes, &Limits::default())
}

/// The JSON of a glTF with two triangles over four points in an embedded buffer, and more JSON put in.
fn document(nodes: &str, mode: u32, indices: &[u8]) -> String {
    let mut bytes = Vec::new();
    for x in [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0] {
        bytes.extend_from_slice(&x.to_le_bytes());
    }
    bytes.extend_from_slice(indices);
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{nodes}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1,\"mode\":{mode}}}]}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}},\
         {{\"bufferView\":0,\"byteOffset\":48,\"componentType\":5121,\"count\":{},\"type\":\"SCALAR\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":{}}}],\
         \"buffers\":[{{\"byteLength\":{},\"uri\":\"data:application/octet-stream;base64,{}\"}}]}}",
        indices.len(),
        bytes.len(),
        bytes.len(),
        base64(&bytes)
    )
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digit = |chunk: &[u8], k: usize| {
        let word = chunk.iter().chain(&[0, 0]).take(3).fold(0u32, |word, b| (word << 8) | u32::from(*b));
        char::from(DIGITS[(word >> (18 - 6 * k)) as usize & 63])
    };
    bytes.chunks(3).flat_map(|chunk| (0..=chunk.len()).map(move |k| digit(chunk, k))).collect()
}

fn sorted(face: &[u32]) -> Vec<u32> {
    let start = (0..face.len()).min_by_key(|k| face[*k]).expect("a corner");
    face.iter().cycle().skip(start).take(face.len()).copied().collect()
}

#[test]
fn polygons_uvs_and_materials_survive() {
    let (mesh, again) = (cube(), parse(&write(&cube()).expect("writable")).expect("readable"));
    let faces = |mesh: &PolyMesh| -> Vec<Vec<[f64; 3]>> {
        mesh.faces.iter().map(|f| sorted(f).iter().map(|v| mesh.positions[*v as usize].into()).collect()).collect()
    };
    let rings = |mesh: &PolyMesh| -> Vec<Vec<[f64; 3]>> {
        let by_key = |p: &[f64; 3]| p.map(|x| (x * 8.0) as i64);
        faces(mesh)
            .into_iter()
            .map(|ring| {
                let start = (0..ring.len()).min_by_key(|k| by_key(&ring[*k])).expect("a corner");
                ring.iter().cycle().skip(start).take(ring.len()).copied().collect()
            })
            .collect()
    };
    assert_eq!(again.positions.len(), 8);
    assert_eq!(rings(&again), rings(&mesh));
    assert_eq!(again.attributes.materials, mesh.attributes.materials);
    let uv_at = |mesh: &PolyMesh, f: usize, vertex: Vec3| {
        let k = mesh.faces.face(f).iter().position(|v| mesh.positions[*v as usize] == vertex).expect("a corner");
        let layer = mesh.attributes.uvs.as_ref().expect("uvs");
        layer.values[layer.corners[mesh.faces.start(f) + k] as usize]
    };
    for f in 0..mesh.faces.len() {
        let vertex = mesh.positions[mesh.faces.face(f)[1] as usize];
        assert_eq!(uv_at(&mesh, f, vertex), uv_at(&again, f, vertex), "face {f}");
    }
}

#[test]
fn nodes_place_and_mirror_meshes() {
    let nodes = r#"{"children":[1],"translation":[10,0,0]},{"mesh":0,"scale":[-2,1,1],"children":[0]}"#;
    let mesh = parse(document(nodes, 4, &[0, 1, 2]).as_bytes()).expect("one triangle");
    let face: Vec<[f64; 3]> = mesh.faces.face(0).iter().map(|v| mesh.positions[*v as usize].into()).collect();
    assert_eq!(face, [[10.0, 1.0, 0.0], [8.0, 0.0, 0.0], [10.0, 0.0, 0.0]], "mirrored: the winding is reversed");
}

#[test]
fn strips_and_fans_are_read() {
    let node = r#"{"mesh":0}"#;
    let strip = parse(document(node, 5, &[0, 1, 2, 2, 2, 3, 1]).as_bytes()).expect("a strip");
    assert_eq!(strip.faces.iter().map(sorted).collect::<Vec<_>>(), [[0, 1, 2], [1, 2, 3]].map(|t| t.to_vec()));
    let fan = parse(document(node, 6, &[0, 1, 3, 2]).as_bytes()).expect("a fan");
    assert_eq!(fan.faces.iter().map(sorted).collect::<Vec<_>>(), [[0, 1, 3], [0, 3, 2]].map(|t| t.to_vec()));
    assert!(parse(document(node, 0, &[0, 1, 2]).as_bytes()).expect("points").faces.is_empty());
}

#[test]
fn mistakes_are_named() {
    let good = document(r#"{"mesh":0}"#, 4, &[0, 1, 2]);
    let embedded = good.split("\"uri\":\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a uri");
    for (bad, said) in [
        (good.replace(embedded, "../../etc/passwd"), "embed the buffers"),
        (good.replace(embedded, "data:;base64,A*=="), "base64"),
        (good.replace("\"count\":4", "\"count\":4000000000"), "found 4000000000"),
        (good.replace("\"count\":4", "\"count\":40"), "fit into the buffer view"),
        (good.replace("\"byteLength\":51", "\"byteLength\":99999"), "inside its buffer"),
        (document(r#"{"mesh":0}"#, 4, &[0, 1, 9]), "9 of 4"),
        (document(r#"{"mesh":7}"#, 4, &[0, 1, 2]), "mesh 7 of 1"),
        (good.replace("\"scene\":0", "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]"), "KHR_draco"),
        (good.replace("\"mesh\":0", &format!("\"extras\":{}", "[".repeat(100))), "levels of nested JSON"),
        (good.replace("\"mode\"", "mode"), "JSON as glTF"),
    ] {
        let error = parse(bad.as_bytes()).expect_err(said).to_string();
        assert!(error.contains(said), "{said}: {error}");
    }
}
