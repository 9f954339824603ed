use super::{Prepared, prepare, prepare_scan};
use crate::mesh::{MeshError, MeshErrorKind, NONE, PolyMesh, RepairKind, Vec3, validate};

fn poly(positions: &[[f64; 3]], faces: &[&[u32]]) -> PolyMesh {
    let positions = positions.iter().map(|p| Vec3::from(*p)).collect();
    PolyMesh { positions, faces: faces.iter().copied().collect(), ..PolyMesh::default() }
}

fn prepared(positions: &[[f64; 3]], faces: &[&[u32]]) -> Prepared {
    let prepared = prepare(&poly(positions, faces)).expect("can be prepared");
    assert_eq!(validate(&prepared.mesh), Ok(()));
    prepared
}

fn repairs(prepared: &Prepared) -> Vec<(RepairKind, u64)> {
    prepared.repairs.iter().map(|repair| (repair.kind, repair.count)).collect()
}

const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

/// The corners of a cube: 4 z + 2 y + x.
fn cube_corners() -> Vec<[f64; 3]> {
    (0..8).map(|k| [f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)]).collect()
}

const CUBE: [&[u32]; 6] = [&[0, 2, 3, 1], &[4, 5, 7, 6], &[0, 1, 5, 4], &[2, 6, 7, 3], &[0, 4, 6, 2], &[1, 3, 7, 5]];

#[test]
fn a_sound_mesh_is_only_cut() {
    let prepared = prepared(&cube_corners(), &CUBE);
    assert!(prepared.repairs.is_empty() && !prepared.reversed.contains(&true));
    assert_eq!(prepared.vertex_of, [0, 1, 2, 3, 4, 5, 6, 7]);
    let mesh = &prepared.mesh;
    assert_eq!((mesh.positions.len(), mesh.triangles.len(), mesh.boundary_loops().len()), (8, 12, 0));
    assert_eq!(mesh.phantom.iter().filter(|p| **p).count(), 12, "one diagonal a quad, from both sides");
    assert_eq!(mesh.polygon_of, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]);
}

#[test]
fn concave_quads_are_cut_through_their_dent() {
    let arrow = [[0.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.5, 1.0, 0.0], [0.0, 3.0, 0.0]];
    for turn in 0..4 {
        let face: Vec<u32> = (0..4).map(|k| (k + turn) % 4).collect();
        let mesh = prepared(&arrow, &[&face]).mesh;
        assert!(mesh.triangles.iter().all(|t| t.contains(&0) && t.contains(&2)), "{:?}", mesh.triangles);
    }
}

#[test]
fn two_polygons_that_share_two_vertices_do_not_share_a_diagonal() {
    let positions = [[0.0, 0.0, 0.0], [3.0, -1.0, 0.0], [0.5, 1.0, 0.0], [0.2, 0.5, 0.0], [-3.0, 1.0, 0.0]];
    let mesh = prepared(&positions, &[&[0, 1, 2, 3], &[0, 3, 2, 4]]).mesh;
    assert_eq!(mesh.triangles.len(), 4);
}

#[test]
fn polygons_whose_every_diagonal_is_an_edge_are_cut_from_their_centre() {
    let positions: Vec<[f64; 3]> =
        (0..5).map(|k| [f64::from(k * k % 5), f64::from(k * k * k % 5), f64::from(k)]).collect();
    let faces: Vec<[u32; 4]> = (0..5).map(|i| [i, (i + 1) % 5, (i + 3) % 5, (i + 2) % 5]).collect();
    let faces: Vec<&[u32]> = faces.iter().map(<[u32; 4]>::as_slice).collect();
    let prepared = prepared(&positions, &faces);
    assert_eq!(repairs(&prepared), [(RepairKind::CentredFaces, 5)], "the complete graph of 5 vertices on a torus");
    let (vertices, triangles) = (prepared.mesh.positions.len(), prepared.mesh.triangles.len());
    assert_eq!((vertices, triangles), (10, 20), "Euler characteristic 0");
}

#[test]
fn a_polygon_with_a_hole_by_a_bridge_is_an_annulus() {
    let mut positions: Vec<[f64; 3]> = SQUARE.map(|p| p.map(|x| 3.0 * x)).into();
    positions.extend(SQUARE.map(|p| [p[0] + 1.0, p[1] + 1.0, 0.0]));
    let mesh = prepared(&positions, &[&[0, 1, 2, 3, 0, 4, 7, 6, 5, 4]]).mesh;
    assert_eq!((mesh.triangles.len(), mesh.boundary_loops().len()), (8, 2));
    assert!((mesh.total_area() - 8.0).abs() < 1e-12);
}

#[test]
fn a_seam_is_welded_and_leads_back_to_one_vertex() {
    let mut positions: Vec<[f64; 3]> = SQUARE.into();
    positions.extend([[1.0, 0.0, -0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    let prepared = prepared(&positions, &[&[0, 1, 2, 3], &[4, 5, 6, 7]]);
    assert_eq!(repairs(&prepared), [(RepairKind::WeldedVertices, 2)]);
    assert_eq!(prepared.vertex_of, [0, 1, 2, 3, 1, 4, 5, 2]);
    assert_eq!(prepared.mesh.boundary_loops().len(), 1);
}

#[test]
fn nearly_equal_seams_are_welded_at_any_scale() {
    for scale in [1e-9, 1.0, 1e9] {
        let mut positions: Vec<[f64; 3]> = SQUARE.into();
        positions.extend([[1.0 + 1e-7, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0 - 1e-7, 0.0]]);
        let positions: Vec<_> = positions.iter().map(|p| p.map(|x| scale * x)).collect();
        let prepared = prepared(&positions, &[&[0, 1, 2, 3], &[4, 5, 6, 7]]);
        assert_eq!(repairs(&prepared), [(RepairKind::NearlyWeldedVertices, 2)], "scale {scale}");
    }
}

#[test]
fn seams_are_left_open_where_welding_would_break_the_surface() {
    let mut positions: Vec<[f64; 3]> = SQUARE[..3].into();
    positions.extend_from_slice(&SQUARE[..3]);
    let prepared = prepared(&positions, &[&[0, 1, 2], &[5, 4, 3]]);
    assert!(prepared.repairs.is_empty(), "two triangles back to back stay apart");
    assert_eq!(prepared.mesh.positions.len(), 6);
}

#[test]
fn boxes_that_touch_along_an_edge_are_welded_each_for_itself() {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for shift in [0.0, 1.0] {
        for face in CUBE {
            let first = positions.len() as u32;
            positions.extend(face.iter().map(|v| {
                let [x, y, z] = cube_corners()[*v as usize];
                [x + shift, y + shift, z]
            }));
            faces.push([first, first + 1, first + 2, first + 3]);
        }
    }
    let faces: Vec<&[u32]> = faces.iter().map(<[u32; 4]>::as_slice).collect();
    let mesh = prepared(&positions, &faces).mesh;
    assert_eq!((mesh.positions.len(), mesh.boundary_loops().len()), (16, 0));
}

#[test]
fn the_fewer_faces_are_turned_and_told() {
    let mut faces = CUBE;
    faces[3] = &[3, 7, 6, 2];
    let turned = prepared(&cube_corners(), &faces);
    assert_eq!(repairs(&turned), [(RepairKind::TurnedFaces, 1)]);
    assert_eq!(turned.repairs[0].first, 3);
    assert_eq!(turned.reversed, [false, false, false, true, false, false]);
}

#[test]
fn closed_surfaces_are_turned_outwards_and_open_ones_are_left() {
    let inward: Vec<Vec<u32>> = CUBE.iter().map(|f| f.iter().rev().copied().collect()).collect();
    let inward: Vec<&[u32]> = inward.iter().map(Vec::as_slice).collect();
    let closed = prepared(&cube_corners(), &inward);
    assert_eq!(repairs(&closed), [(RepairKind::InsideOutFaces, 6)]);
    assert_eq!(closed.reversed, [true; 6]);
    assert!(prepared(&cube_corners(), &inward[1..]).repairs.is_empty(), "an open box may be seen from inside");
}

#[test]
fn copies_repeats_strays_and_pinches_are_repaired_and_told() {
    let mut positions: Vec<[f64; 3]> = SQUARE.into();
    positions.extend([[-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0], [f64::NAN; 3]]);
    let faces: [&[u32]; 5] = [&[0, 1, 2, 3], &[1, 2, 3, 0], &[0, 4, 4, 5], &[2, 2, 3], &[3, 2, 3]];
    let prepared = prepared(&positions, &faces);
    let expected = [
        (RepairKind::IsolatedVertices, 1),
        (RepairKind::RepeatedCorners, 1),
        (RepairKind::CollapsedFaces, 2),
        (RepairKind::DuplicateFaces, 1),
        (RepairKind::PinchedVertices, 1),
    ];
    assert_eq!(repairs(&prepared), expected);
    assert_eq!(prepared.vertex_of, [0, 2, 3, 4, 5, 6, NONE]);
    assert_eq!(prepared.mesh.positions[1], Vec3::zeros(), "the copy stands where the vertex stood");
}

#[test]
fn edges_without_length_are_collapsed_where_that_is_safe() {
    // A fan around a centre that is there twice.
    let mut positions: Vec<[f64; 3]> = SQUARE.into();
    positions.extend([[0.5, 0.5, 0.0], [0.5, 0.5, 0.0]]);
    let faces: [&[u32]; 6] = [&[0, 1, 4], &[1, 2, 5], &[1, 5, 4], &[2, 3, 5], &[3, 0, 4], &[3, 4, 5]];
    let fan = prepared(&positions, &faces);
    assert_eq!(repairs(&fan), [(RepairKind::CollapsedEdges, 1)]);
    assert_eq!((fan.vertex_of[4], fan.vertex_of[5], fan.mesh.triangles.len()), (4, 4, 4));
    // A square hole of which two opposite corners coincide: joining them would pinch it.
    let mut positions: Vec<[f64; 3]> = SQUARE.into();
    positions[2] = positions[0];
    let tent = [[0.0, 0.0, 1.0]];
    positions.extend(tent);
    let strip = prepared(&positions, &[&[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]]);
    assert!(!repairs(&strip).iter().any(|(kind, _)| *kind == RepairKind::CollapsedEdges));
}

#[test]
fn a_triangle_without_area_is_kept_and_told() {
    let mut positions: Vec<[f64; 3]> = SQUARE.into();
    positions.push([0.5, 0.0, 0.0]);
    let prepared = prepared(&positions, &[&[0, 4, 1], &[0, 1, 2, 3]]);
    assert_eq!(repairs(&prepared), [(RepairKind::FlatTriangles, 1)]);
    assert_eq!(prepared.mesh.triangles.len(), 3);
}

#[test]
fn what_is_not_safe_is_refused_with_its_number() {
    let refusal = |positions: &[[f64; 3]], faces: &[&[u32]]| prepare(&poly(positions, faces)).expect_err("refused");
    let mut positions: Vec<[f64; 3]> = SQUARE.into();
    positions.extend((0..40).map(|k| [0.5, 0.5, 1.0 + f64::from(k)]));
    let pages: Vec<[u32; 3]> = (4..44).map(|k| [0, 1, k]).collect();
    let book = refusal(&positions, &pages.iter().map(<[u32; 3]>::as_slice).collect::<Vec<_>>());
    assert!(
        book.to_string().contains("faces 1, 2, 3, 4, 5") && book.to_string().contains("vertices 1 and 2"),
        "{book}"
    );
    let (strip, moebius) = moebius();
    let one_sided = refusal(&strip, &moebius);
    assert_eq!(one_sided.code(), MeshErrorKind::TopologyUnsupported);
    assert!(matches!(one_sided, MeshError::OneSided { .. }));
    assert_eq!(refusal(&[[1.0; 3]; 4], &[&[0, 1, 2]]).code(), MeshErrorKind::Empty);
    assert_eq!(refusal(&SQUARE, &[&[0, 1, 0, 1]]).code(), MeshErrorKind::Empty);
    assert_eq!(refusal(&SQUARE, &[]).code(), MeshErrorKind::Empty);
    assert!(matches!(refusal(&SQUARE, &[&[0, 1, 9]]), MeshError::FaceInvalid { face: 0, .. }));
    assert!(matches!(refusal(&SQUARE, &[&[0, 1]]), MeshError::FaceInvalid { face: 0, .. }));
    assert!(matches!(
        refusal(&[[0.0; 3], [1e61, 0.0, 0.0], [0.0; 3]], &[&[0, 1, 2]]),
        MeshError::NotFinite { vertex: 1, .. }
    ));
}

/// A Möbius strip of five quads.
fn moebius() -> (Vec<[f64; 3]>, [&'static [u32]; 5]) {
    let strip = (0..10).map(|k| [f64::from(k / 2), f64::from(k % 2), f64::from(k * k)]).collect();
    (strip, [&[0, 1, 3, 2], &[2, 3, 5, 4], &[4, 5, 7, 6], &[6, 7, 9, 8], &[8, 9, 0, 1]])
}

#[test]
fn a_scan_with_one_side_is_cut_once_across() {
    let (strip, faces) = moebius();
    let prepared = prepare_scan(&poly(&strip, &faces)).expect("cut");
    assert_eq!(repairs(&prepared)[0], (RepairKind::CutEdges, 1));
    assert_eq!((prepared.mesh.positions.len(), prepared.mesh.boundary_loops().len()), (12, 1), "a disc");
}

#[test]
fn a_scan_of_a_book_of_six_pages_is_bound_two_by_two() {
    let mut positions = vec![[0.0; 3], [1.0, 0.0, 0.0]];
    positions.extend((0..6).map(|k| [0.5, f64::from(k).cos(), f64::from(k).sin()]));
    let pages: Vec<[u32; 3]> = (2..8).map(|k| [0, 1, k]).collect();
    let book = poly(&positions, &pages.iter().map(<[u32; 3]>::as_slice).collect::<Vec<_>>());
    assert!(matches!(prepare(&book), Err(MeshError::EdgeShared { count: 6, .. })), "an artist can mend an example");
    let prepared = prepare_scan(&book).expect("bound");
    assert_eq!(repairs(&prepared)[0], (RepairKind::SharedEdges, 1));
    let mesh = &prepared.mesh;
    assert_eq!((mesh.triangles.len(), mesh.boundary_loops().len()), (6, 3));
}

#[test]
fn a_sheet_that_stands_on_a_body_comes_off_and_the_body_stays_closed() {
    // A cube with a wing at one of its edges, and a wall of two triangles across its inside.
    let mut positions = cube_corners();
    positions.extend([[2.0, -1.0, 0.0], [2.0, -1.0, 1.0]]);
    let mut faces = CUBE.to_vec();
    faces.extend([&[1, 5, 9, 8][..], &[0, 3, 7], &[0, 7, 4]]);
    let prepared = prepared(&positions, &faces);
    assert_eq!(repairs(&prepared)[0], (RepairKind::SharedEdges, 3));
    let mesh = &prepared.mesh;
    let open = |polygon: u32| {
        (0..mesh.twins.len()).filter(|&h| mesh.polygon_of[h / 3] == polygon && mesh.twins[h] == NONE).count()
    };
    assert_eq!((0..6).map(open).sum::<usize>(), 0, "the body is closed");
    assert_eq!((6..9).map(open).collect::<Vec<_>>(), [4, 2, 2], "what stood on it has a boundary of its own");
    assert_eq!((mesh.triangles.len(), mesh.boundary_loops().len()), (16, 2));
}

#[test]
fn a_small_sheet_that_stands_on_a_body_is_left_out() {
    let mut positions = cube_corners();
    positions.push([1.0, 1.05, 0.5]);
    let mut faces = CUBE.to_vec();
    faces.push(&[3, 7, 8]);
    let prepared = prepared(&positions, &faces);
    assert_eq!(repairs(&prepared), [(RepairKind::SharedEdges, 1), (RepairKind::StandingFaces, 1)]);
    assert_eq!((prepared.mesh.triangles.len(), prepared.mesh.boundary_loops().len()), (12, 0));
    assert_eq!(prepared.vertex_of[8], NONE);
}

#[test]
fn bodies_that_touch_along_an_edge_are_two_and_of_three_leaves_the_largest_two_are_one() {
    let mut positions = cube_corners();
    positions.extend(cube_corners().iter().map(|p| [p[0] + 1.0, p[1] + 1.0, p[2]]));
    // The second cube's edge above (1, 1) is the first one's.
    let number = |v: u32| [3, 9, 10, 11, 7, 13, 14, 15][v as usize];
    let second: Vec<Vec<u32>> = CUBE.iter().map(|f| f.iter().map(|&v| number(v)).collect()).collect();
    let faces: Vec<&[u32]> = CUBE.into_iter().chain(second.iter().map(Vec::as_slice)).collect();
    let two = prepared(&positions, &faces);
    assert_eq!((two.mesh.positions.len(), two.mesh.boundary_loops().len()), (16, 0));
    // A book of three leaves, the middle one the smallest.
    let leaves = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 2.0, 0.0], [0.5, 0.0, 0.3], [0.5, -2.0, 0.0]];
    let book = prepared(&leaves, &[&[0, 1, 2], &[0, 1, 3], &[1, 0, 4]]);
    let apart: Vec<bool> = book.mesh.twins.chunks(3).map(|t| t.iter().all(|&twin| twin == NONE)).collect();
    assert_eq!(apart, [false, true, false]);
}
