use super::{read, write};
use crate::mesh::{Crease, FileLocation, Limits, MeshError, NONE, PolyMesh};

fn parse(text: &str) -> Result<PolyMesh, MeshError> {
    read(text.as_bytes(), &Limits::default())
}

fn faces(mesh: &PolyMesh) -> Vec<&[u32]> {
    mesh.faces.iter().collect()
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn corners_are_read_in_all_four_forms() {
    let mesh = parse(&format!("{SQUARE}vt 0 0\nvt 1 1\nvn 0 0 1\nf 1 2/2 3//1 4/1/1\n")).unwrap();
    assert_eq!(faces(&mesh), [[0, 1, 2, 3]]);
    assert_eq!(mesh.attributes.uvs.unwrap().corners, [NONE, 1, NONE, 0]);
    assert_eq!(mesh.attributes.normals.unwrap().corners, [NONE, NONE, 0, 0]);
}

#[test]
fn negative_and_forward_indices_are_resolved() {
    let mesh = parse("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -2 -1\n").unwrap();
    assert_eq!(faces(&mesh), [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn continued_lines_count_as_lines() {
    let error = parse("v 0 0 0\nf 1 \\\r\n 1 \\\n1\nv x 0 0\n").unwrap_err();
    assert!(error.to_string().starts_with("OBJ, line 5:"), "{error}");
    let comment = parse(&format!("# C:\\\n{SQUARE}f 1 2 3")).unwrap();
    assert_eq!(comment.positions.len(), 4, "a comment is not continued");
}

#[test]
fn groups_win_over_objects_and_materials_are_kept() {
    let mesh =
        parse(&format!("{SQUARE}o whole\ng left arm\nusemtl skin\nf 1 2 3\ng\nusemtl\nf 1 3 4\ng left arm\nf 1 2 4\n"));
    let attributes = mesh.unwrap().attributes;
    let groups = attributes.groups.unwrap();
    assert_eq!(
        (groups.names.as_slice(), groups.of_face.as_slice()),
        (["left arm".into()].as_slice(), [0, NONE, 0].as_slice())
    );
    assert_eq!(attributes.materials.unwrap().of_face, [0, NONE, NONE]);
    let objects = parse(&format!("{SQUARE}o a\nf 1 2 3\no b\nf 1 3 4\n")).unwrap().attributes.groups.unwrap();
    assert_eq!((objects.name(0), objects.name(1)), (Some("a"), Some("b")));
}

#[test]
fn vertex_colours_and_weights_are_told_apart() {
    let mesh = parse("v 0 0 0 1\nv 1 0 0 1 0.5 0\nv 0 1 0 nan 0 0\nf 1 2 3\n").unwrap();
    assert_eq!(mesh.attributes.colors.unwrap(), [[1.0; 4], [1.0, 0.5, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]]);
    assert!(parse(&format!("{SQUARE}f 1 2 3")).unwrap().attributes.colors.is_none());
    let marked = parse("v 0 0 0 fix\nv 1 0 0 # corner\nv 0 1 0 1 0 0 fix\nf 1 2 3\n").unwrap();
    assert_eq!(marked.attributes.colors.unwrap(), [[1.0; 4], [1.0; 4], [1.0, 0.0, 0.0, 1.0]]);
}

#[test]
fn creases_are_read() {
    let mesh = parse(&format!("{SQUARE}f 1 2 3 4\nt crease 2/1/0 0 1 2.5\nt interpolateboundary 1/0/0 1\n")).unwrap();
    assert_eq!(mesh.attributes.creases, [Crease { vertices: [0, 1], sharpness: 2.5 }]);
    assert!(parse(&format!("{SQUARE}f 1 2 3 4\nt crease 2/1/0 0 9 2.5\n")).is_err());
}

#[test]
fn mistakes_are_named_with_their_line_and_the_way_out() {
    for (text, line, said) in [
        ("v 0 0 0\nv 0,5 1 2\n", 2, "not a comma"),
        ("v 0 0\n", 1, "cut short"),
        ("v 0 0 1.#IND\n", 1, "a number that is not one"),
        ("v 0 0 0\nf 1 1 0\n", 2, "found `0`"),
        ("v 0 0 0\nf 1 1 9\nf 1 1 1\n", 2, "found 9"),
        ("v 0 0 0\nf 1 1 999999999999999999999999\n", 2, "(there are 1)"),
        ("v 0 0 0\nf -2 1 1\n", 2, "found `-2`"),
        ("v 0 0 0\nf 1 1\n", 2, "2 corners"),
        ("v 0 0 0\nf 1 1 a\n", 2, "whole numbers"),
        ("v 0 0 0\nf 1 1 1/1/1/1\n", 2, "v/t/n"),
        ("v 0 0 0\nvt 0 0\nf 1/2 1 1\n", 3, "a texture coordinate"),
    ] {
        let error = parse(text).unwrap_err().to_string();
        assert!(error.contains(&format!("line {line}:")) && error.contains(said), "{text:?} → {error}");
    }
}

#[test]
fn other_encodings_are_named() {
    let utf16: Vec<u8> = "v 0 0 0\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_eq!(
        read(&utf16, &Limits::default()).unwrap_err(),
        MeshError::Encoding { found: "UTF-16 without a byte order mark" }
    );
    let binary = read(b"v 0 0 0\n\0\n", &Limits::default()).unwrap_err();
    assert!(matches!(binary, MeshError::Malformed { place: FileLocation::Byte(8), .. }));
}

#[test]
fn what_a_program_left_out_or_padded_is_no_mistake() {
    let mesh = parse(&format!("{SQUARE}f 1/7/9 2/8/9 3/9/9\n\0\0")).unwrap();
    assert_eq!((mesh.faces.len(), mesh.attributes.uvs, mesh.attributes.normals), (1, None, None));
}

#[test]
fn limits_hold() {
    let limits = Limits { vertices_max: 3, degree_max: 4, ..Limits::default() };
    assert!(matches!(
        read(SQUARE.as_bytes(), &limits),
        Err(MeshError::TooLarge { what: "vertices", found: 4, limit: 3 })
    ));
    assert!(matches!(read(b"v 0 0 0\nf 1 1 1 1 1\n", &limits), Err(MeshError::TooLarge { limit: 4, .. })));
}

#[test]
fn a_file_written_reads_back_the_same() {
    let text = format!(
        "{SQUARE}v 0.1 1e-7 123456789.125 0.25 0.5 1\nvt 0.3 0.7\nvt 1 0\nvn 0 0 1\ng a b\nusemtl m\nf 1/1 2/2 3/1\n\
         g\nf 1//1 3//1 4 5\nusemtl n\ng c\nf 3/1/1 4/1/1 5/2/1\nt crease 2/1/0 0 1 2.5\n"
    );
    let mesh = parse(&text).unwrap();
    let again = read(&write(&mesh), &Limits::default()).unwrap();
    assert_eq!(mesh, again);
}
