use super::*;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::topology::{tests::grid, whole};
use crate::unfold::{UnfoldOptions, unfold};

/// `mesh` laid on the chart of `input`, its vertices where `moved` takes them.
fn laid(mesh: &TriMesh, input: &TriMesh, moved: impl Fn(Vec3) -> Vec3) -> (Chart, CrossMap) {
    let chart = unfold(&whole(input).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
    let bvh = Bvh::new(&chart.mesh);
    let place = |p: &Vec3| {
        let c = bvh.closest(moved(*p));
        (Location::from(c), c.point)
    };
    let (locations, positions) = mesh.positions.iter().map(place).unzip();
    (chart, CrossMap { locations, positions })
}

#[test]
fn a_fold_that_was_missed_by_half_a_face_is_hit() {
    let (mesh, input) = (lines::tests::folded(16, 0.0), lines::tests::folded(36, 0.0));
    // Laid too far to the left, across the fold.
    let missed = |p: Vec3| {
        let along = if p.z > 0.0 { 0.5 + p.z } else { p.x };
        let shift = 0.03 * (std::f64::consts::PI * along).sin() * (std::f64::consts::PI * p.y).sin();
        let along = along - shift;
        if along > 0.5 { Vec3::new(0.5, p.y, along - 0.5) } else { Vec3::new(along, p.y, 0.0) }
    };
    let (chart, mut cross) = laid(&mesh, &input, missed);
    let off = |cross: &CrossMap| {
        let on_fold = |v: &usize| (mesh.positions[*v].x - 0.5).abs() + mesh.positions[*v].z < 1e-9;
        let inner = (0..mesh.positions.len()).filter(on_fold).filter(|&v| (0.1..0.9).contains(&mesh.positions[v].y));
        inner.map(|v| (cross.positions[v].x - 0.5).abs() + cross.positions[v].z.abs()).fold(0.0, f64::max)
    };
    assert!(off(&cross) > 0.02);
    let before = cross.clone();
    assert_eq!(snap(&mesh, &[], &mut cross, &chart, 1.0, Snap::Off), SnapCounts::default());
    assert_eq!(cross, before);
    let snapped = snap(&mesh, &[], &mut cross, &chart, 1.0, Snap::Creases);
    assert!(snapped.creased >= 12 && snapped.refused == 0, "{snapped:?}");
    assert!(off(&cross) < 1e-9, "{}", off(&cross));
    assert!(inward(&mesh, &cross, &chart, 1.0).is_empty());
    // What is around came along.
    let error =
        |cross: &CrossMap| -> f64 { cross.positions.iter().zip(&mesh.positions).map(|(a, b)| (a - b).norm()).sum() };
    assert!(error(&cross) < error(&before), "{} became {}", error(&before), error(&cross));
}

#[test]
fn corners_of_a_sheet_go_to_corners_and_the_boundary_follows_on_the_boundary() {
    let (mesh, input) = (grid(14, 14, false, false), grid(33, 33, false, false));
    // Turned along the boundary a little.
    let missed = |p: Vec3| {
        let from = p - Vec3::new(0.5, 0.5, 0.0);
        let r = from.x.abs().max(from.y.abs());
        let (sin, cos) = (0.06 * (r / 0.5).powi(4)).sin_cos();
        let to = Vec3::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y, 0.0);
        let size = to.x.abs().max(to.y.abs());
        Vec3::new(0.5, 0.5, 0.0) + if size > 0.0 { to * (r / size) } else { to }
    };
    let (chart, mut cross) = laid(&mesh, &input, missed);
    let off = |cross: &CrossMap| {
        [0, 14, 15 * 14, 15 * 15 - 1]
            .map(|v: usize| (cross.positions[v] - mesh.positions[v]).norm())
            .into_iter()
            .fold(0.0, f64::max)
    };
    assert!(off(&cross) > 0.02, "{}", off(&cross));
    let snapped = snap(&mesh, &[], &mut cross, &chart, 1.0, Snap::Corners);
    assert_eq!((snapped.corners, snapped.refused), (4, 0));
    assert!(off(&cross) < 1e-9, "{}", off(&cross));
    for (p, on) in cross.positions.iter().zip(mesh.boundary_vertices()) {
        assert!(!on || p.x.min(1.0 - p.x).min(p.y).min(1.0 - p.y) < 1e-9);
    }
    assert!(inward(&mesh, &cross, &chart, 1.0).is_empty());
}

#[test]
fn what_would_turn_a_face_over_is_left_as_it_is() {
    let (mesh, input) = (lines::tests::folded(16, 0.0), lines::tests::folded(36, 0.0));
    let (chart, mut cross) = laid(&mesh, &input, |p| p);
    let before = cross.clone();
    // A vertex in the middle of the sheet, sent far away over its neighbours.
    let far = cross.locations[17 * 8 + 2];
    let (done, refused) = moved(&mesh, &mut cross, &chart, 1.0, Targets::from([(17 * 8 + 13, far)]), |_| ());
    assert!(done.is_empty() && refused == 1);
    assert_eq!(cross, before);
}

#[test]
fn a_ragged_or_round_boundary_has_no_corners() {
    let mut mesh = grid(30, 30, false, false);
    let middle = Vec3::new(0.5, 0.5, 0.0);
    for (v, on) in mesh.boundary_vertices().into_iter().enumerate() {
        let from = mesh.positions[v] - middle;
        let size = from.x.abs().max(from.y.abs());
        let round = if from.norm() > 0.0 { from * (size / from.norm()) } else { from };
        let ragged = if on { 1.0 + 0.06 * ((v * 7919 % 101) as f64 / 101.0 - 0.5) } else { 1.0 };
        mesh.positions[v] = middle + round * ragged;
    }
    let (chart, cross) = laid(&mesh, &mesh, |p| p);
    assert!(corners::targets(&mesh, &cross, &chart).corners.is_empty());
}
