use super::{read, write};
use crate::mesh::obj;
use crate::mesh::{CornerLayer, Limits, MeshError, PolyMesh};

fn parse(bytes: &[u8]) -> Result<PolyMesh, MeshError> {
    read(bytes, &Limits::default())
}

const HEADER: &str = "ply\nformat ascii 1.0\ncomment made by hand\nobj_info x\nelement vertex 4\nproperty float x\n\
    property list uchar int tags\nproperty float32 y\nproperty double z\nproperty uchar red\nproperty uchar green\n\
    property uchar blue\nproperty float s\nproperty float t\nelement material 1\nproperty list int float ka\n\
    element face 2\nproperty uchar flags\nproperty list uchar uint vertex_index\nproperty short segment\nend_header\n";
const BODY: &str = "0 0 0 0 255 0 51 0 0\n1 2 7 8 0 0 0 0 0 1 0\n\n1 0 1 0 0 0 0 1 1\n 0 0 1 0 0 0 0 0 1\n2 0.5 0.5\n\
    9 4 0 1 2 3 -3\n9 3 0 1 2 5\n";

#[test]
fn ascii_files_with_more_than_is_kept_are_read() {
    let mesh = parse(format!("{HEADER}{BODY}").as_bytes()).expect("readable");
    assert_eq!(mesh.positions[1].as_slice(), [1.0, 0.0, 0.0]);
    assert_eq!(mesh.faces.iter().collect::<Vec<_>>(), [[0, 1, 2, 3].as_slice(), &[0, 1, 2]]);
    assert_eq!(mesh.attributes.segments, Some(vec![-3, 5]));
    assert_eq!(mesh.attributes.colors.expect("colours")[0], [1.0, 0.0, 0.2, 1.0]);
    let uvs = mesh.attributes.uvs.expect("uvs");
    assert_eq!((uvs.values[2], uvs.corners), ([1.0, 1.0], vec![0, 1, 2, 3, 0, 1, 2]));
}

/// The same small mesh in both binary encodings.
fn binary(big_endian: bool) -> Vec<u8> {
    let name = if big_endian { "big" } else { "little" };
    let mut out = format!(
        "ply\r\nformat binary_{name}_endian 1.0\r\nelement vertex 3\r\nproperty double x\r\nproperty float y\r\nproperty short z\r\n\
         element face 1\r\nproperty list ushort int vertex_indices\r\nproperty list uchar float texcoord\r\nend_header\r\n"
    )
    .into_bytes();
    let mut put = |bytes: &[u8]| {
        if big_endian {
            out.extend(bytes.iter().rev());
        } else {
            out.extend(bytes);
        }
    };
    for (x, y, z) in [(0.5f64, 0f32, -300i16), (1.0, 0.25, 0), (0.0, 1.0, 7)] {
        put(&x.to_le_bytes());
        put(&y.to_le_bytes());
        put(&z.to_le_bytes());
    }
    put(&3u16.to_le_bytes());
    (0..3).for_each(|v: i32| put(&v.to_le_bytes()));
    put(&[6]);
    (0..6).for_each(|k| put(&(k as f32).to_le_bytes()));
    out
}

#[test]
fn both_binary_encodings_are_read() {
    let little = parse(&binary(false)).expect("little");
    assert_eq!(little.positions[0].as_slice(), [0.5, 0.0, -300.0]);
    assert_eq!(
        little.attributes.uvs,
        Some(CornerLayer { values: vec![[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]], corners: vec![0, 1, 2] })
    );
    assert_eq!(parse(&binary(true)), Ok(little));
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let text = format!("{HEADER}{}", BODY.trim_end());
    for cut in 0..text.len() - 1 {
        // The last number may lose digits without anybody noticing.
        assert!(parse(&text.as_bytes()[..cut]).is_err(), "ascii cut at {cut}");
    }
    let bytes = binary(false);
    for cut in 0..bytes.len() {
        assert!(parse(&bytes[..cut]).is_err(), "binary cut at {cut}");
    }
}

#[test]
fn mistakes_are_named_with_their_place() {
    let text = format!("{HEADER}{BODY}");
    for (from, to, said) in [
        ("format ascii", "format utf8", "line 2: expected ascii, binary"),
        ("element vertex 4", "element vertex four", "line 5: expected a name and a whole number"),
        ("element vertex 4", "element vertex 4000000000", "found 4000000000"),
        ("element vertex 4", "element vertex 4000", "4000 rows of `vertex` announced"),
        ("property float x", "property float q", "x, y and z"),
        ("property list uchar uint", "property list float uint", "whole-number type"),
        ("list uchar uint vertex_index", "list uchar uint corners", "vertex_indices"),
        ("property uchar red", "property colour red", "line 10: expected char, uchar"),
        ("9 4 0 1 2 3 -3", "9 4 0 1 2 8 -3", "face 1 (counted from 1)"),
        ("9 4 0 1 2 3 -3", "9 4 0 1 2 -1 -3", "whole numbers from 0"),
        ("9 4 0 1 2 3 -3", "9 200 0 1 2 3 -3", "a list of 200 values"),
        ("9 4 0 1 2 3 -3", "9 2 0 1 -3", "2 corners"),
        ("end_header\n", "", "line 21: expected format, element"),
    ] {
        let error = parse(text.replacen(from, to, 1).as_bytes()).expect_err(to).to_string();
        assert!(error.contains(said), "{to} → {error}");
    }
}

#[test]
fn elements_without_properties_take_no_time() {
    let text = "ply\nformat binary_little_endian 1.0\nelement nothing 18446744073709551615\nelement vertex 0\nproperty float x\n\
        property float y\nproperty float z\nelement face 0\nend_header\n";
    assert!(parse(text.as_bytes()).expect("empty").faces.is_empty());
}

#[test]
fn a_file_written_reads_back_the_same() {
    let text =
        "v 0.1 0 0 1 0.5 0 0.25\nv 1 1e-9 0\nv 1 1 0\nv 0 1 0\nvt 0 0.3\nvt 1 0\nf 1/1 2/2 3/1 4/2\nf 1/2 2/2 3/2\n";
    let mut mesh = obj::read(text.as_bytes(), &Limits::default()).expect("readable");
    mesh.attributes.segments = Some(vec![3, -1]);
    let again = parse(&write(&mesh)).expect("written");
    assert_eq!((&again.positions, &again.faces), (&mesh.positions, &mesh.faces));
    assert_eq!(
        (&again.attributes.colors, &again.attributes.segments),
        (&mesh.attributes.colors, &mesh.attributes.segments)
    );
    let corners = |mesh: &PolyMesh| -> Vec<[f64; 2]> {
        mesh.attributes.uvs.iter().flat_map(|layer| layer.corners.iter().map(|uv| layer.values[*uv as usize])).collect()
    };
    assert_eq!(corners(&again), corners(&mesh));
    let ring: Vec<u32> = (0..300).map(|k| k % 4).collect();
    mesh.faces.push(&ring);
    mesh.attributes = Default::default();
    assert_eq!(parse(&write(&mesh)), Ok(mesh), "a list of 300");
}

#[test]
fn strips_of_triangles_are_read_as_faces() {
    let of = |rows: &str, count: u32| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
             element tristrips {count}\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n{rows}"
        );
        parse(text.as_bytes()).map(|mesh| mesh.faces.iter().map(<[u32]>::to_vec).collect::<Vec<_>>())
    };
    // All are wound the same way; a strip begins anew after -1, and a corner twice makes no triangle.
    let wound = vec![vec![0, 1, 2], vec![2, 1, 3], vec![2, 3, 4], vec![1, 3, 2]];
    assert_eq!(of("9 0 1 2 3 4 -1 1 3 2\n", 1).expect("strips"), wound);
    assert_eq!(of("5 0 1 2 3 4\n3 1 3 2\n", 2).expect("strips"), wound);
    assert_eq!(of("5 0 1 1 2 3\n", 1).expect("strips"), [vec![1, 2, 3]]);
    let error = of("3 0 1 -2\n", 1).expect_err("no vertex").to_string();
    assert!(error.contains("-2"), "{error}");
    let error = of("3 0 1 9\n", 1).expect_err("no such vertex").to_string();
    assert!(error.contains('9'), "{error}");
}
