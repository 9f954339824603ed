//! Theorems first: what is laid on itself comes back; where either ends, each ends at its own place.

use super::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A bumpy sheet over [−x, x] × [−1, 1]; `lift` moves it.
fn sheet(columns: usize, rows: usize, [from, to]: [f64; 2]) -> TriMesh {
    let height = |x: f64, y: f64| 0.25 * (2.3 * x + 0.4).sin() * (1.9 * y).cos() + 0.15 * (3.1 * y + x).sin();
    let at = |i: usize, j: usize| {
        let (x, y) = (from + (to - from) * i as f64 / (columns - 1) as f64, -1.0 + 2.0 * j as f64 / (rows - 1) as f64);
        Vec3::new(x, y, height(x, y))
    };
    let positions = (0..columns * rows).map(|k| at(k % columns, k / columns)).collect();
    let number = |i: usize, j: usize| (j * columns + i) as u32;
    let mut triangles = Vec::new();
    for j in 0..rows - 1 {
        for i in 0..columns - 1 {
            let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::from_triangles(positions, triangles).expect("a sheet")
}

/// Turned, grown, moved and warped.
fn disturbed(mesh: &TriMesh) -> Vec<Vec3> {
    let (sin, cos) = 0.2f64.sin_cos();
    let warp = |p: &Vec3| Vec3::new((2.0 * p.y).sin(), (1.5 * p.x).cos(), (p.x + p.y).sin()) * 0.06;
    (mesh.positions.iter())
        .map(|p| {
            Vec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z) * 1.1 + Vec3::new(0.08, -0.05, 0.1) + warp(p)
        })
        .collect()
}

fn go() -> bool {
    false
}

/// Mean and greatest distance of kept vertices from where they are in their mesh.
fn off(mesh: &TriMesh, settled: &Settled) -> (f64, f64) {
    let kept = (0..mesh.positions.len()).filter(|v| !settled.lost[*v]);
    let d: Vec<f64> = kept.map(|v| (settled.positions[v] - mesh.positions[v]).norm()).collect();
    (d.iter().sum::<f64>() / d.len().max(1) as f64, d.iter().copied().fold(0.0, f64::max))
}

#[test]
fn a_surface_settled_on_itself_from_a_disturbed_start_comes_back() {
    let (example, input) = (sheet(31, 25, [-1.2, 1.2]), sheet(91, 75, [-1.2, 1.2]));
    let before = disturbed(&example).iter().zip(&example.positions).map(|(a, b)| (a - b).norm()).sum::<f64>();
    let settled = settle(&example, &input, &disturbed(&example), 1.0, &Options::default(), &go).expect("to be settled");
    let (mean, most) = off(&example, &settled);
    assert!(before / 775.0 > 0.1 && mean < 0.01 && most < 0.06, "{mean} {most}");
    assert!(settled.evidence.relief > 0.95 && settled.evidence.residual < 0.005, "{:?}", settled.evidence);
}

#[test]
fn a_coarse_example_is_settled_by_what_lies_between_its_vertices_too() {
    let (example, input) = (sheet(11, 9, [-1.2, 1.2]), sheet(91, 75, [-1.2, 1.2]));
    let settled = settle(&example, &input, &disturbed(&example), 1.0, &Options::default(), &go).expect("to be settled");
    let (mean, most) = off(&example, &settled);
    assert!(
        [settled.places.len(), settled.lost.len(), settled.off.len()] == [99; 3] && mean < 0.05 && most < 0.15,
        "{mean} {most}"
    );
}

#[test]
fn an_example_that_is_half_of_the_input_ends_at_its_own_place() {
    let (example, input) = (sheet(21, 25, [-0.8, 0.6]), sheet(121, 75, [-2.0, 2.0]));
    let settled = settle(&example, &input, &disturbed(&example), 1.0, &Options::default(), &go).expect("to be settled");
    let (mean, most) = off(&example, &settled);
    assert!(mean < 0.02 && most < 0.1, "{mean} {most}");
}

#[test]
fn what_reaches_beyond_an_open_input_is_lost_and_nothing_else() {
    let (example, input) = (sheet(41, 25, [-1.6, 1.6]), sheet(75, 75, [-1.6, 0.83]));
    let settled = settle(&example, &input, &disturbed(&example), 1.0, &Options::default(), &go).expect("to be settled");
    let wrong = (0..example.positions.len()).filter(|v| {
        let x = example.positions[*v].x;
        // A row of vertices on either side of the input's end may go either way.
        (x - 0.83).abs() > 0.12 && example.positions[*v].y.abs() < 0.95 && x > -1.5 && settled.lost[*v] != (x > 0.83)
    });
    assert_eq!(wrong.count(), 0, "{:?}", off(&example, &settled));
}

#[test]
fn the_back_of_what_is_seen_from_the_front_is_lost() {
    // A sheet rolled to a tube of radius 0.5, and the front half of it.
    let rolled = |mesh: TriMesh| {
        let at = |p: &Vec3| Vec3::new((2.0 * p.x).sin(), 2.0 * p.y, (2.0 * p.x).cos()) * (0.5 + 0.5 * p.z);
        TriMesh::from_triangles(mesh.positions.iter().map(at).collect(), mesh.triangles).expect("a tube")
    };
    let (flat, input) = (sheet(61, 25, [-1.5, 1.5]), rolled(sheet(81, 75, [-0.8, 0.8])));
    let example = rolled(flat.clone());
    let settled = settle(&example, &input, &example.positions, 1.0, &Options::default(), &go).expect("to be settled");
    let is_wrong = |v: &usize| {
        let p = &flat.positions[*v];
        (p.x.abs() - 0.8).abs() > 0.12 && p.y.abs() < 0.9 && settled.lost[*v] != (p.x.abs() > 0.8)
    };
    let wrong: Vec<usize> = (0..flat.positions.len()).filter(is_wrong).collect();
    assert_eq!(wrong.len(), 0, "{:?}", wrong.iter().map(|v| flat.positions[*v]).take(9).collect::<Vec<_>>());
}

#[test]
fn a_mirrored_example_settles_without_mirroring() {
    let (example, input) = (sheet(31, 25, [-1.2, 1.2]), sheet(91, 75, [-1.2, 1.2]));
    let turned = example.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    let flip = |p: &Vec3| Vec3::new(-p.x, p.y, p.z);
    let mirrored = TriMesh::from_triangles(example.positions.iter().map(flip).collect(), turned).expect("a sheet");
    let start = disturbed(&example);
    let settled = settle(&mirrored, &input, &start, -1.0, &Options::default(), &go).expect("to be settled");
    assert!(off(&example, &settled).0 < 0.01, "{:?}", off(&example, &settled));
}

#[test]
fn following_comes_back_too_and_either_takes_the_better() {
    let (example, input) = (sheet(31, 25, [-1.2, 1.2]), sheet(91, 75, [-1.2, 1.2]));
    let near: Vec<Vec3> = disturbed(&example).iter().zip(&example.positions).map(|(a, b)| b + (a - b) * 0.15).collect();
    let run = |manner| {
        let options = Options { manner, ..Options::default() };
        settle(&example, &input, &near, 1.0, &options, &go).expect("to be settled")
    };
    let (whole, following, either) = (run(Manner::Whole), run(Manner::Following), run(Manner::Either));
    let before = near.iter().zip(&example.positions).map(|(a, b)| (a - b).norm()).sum::<f64>() / near.len() as f64;
    assert!(off(&example, &following).0 < before, "{:?} {before}", off(&example, &following));
    let best = whole.evidence.relief.max(following.evidence.relief);
    assert!(either.evidence.relief == best && either.manner != Manner::Either);
}

#[test]
fn the_right_start_aligns_better_than_one_upside_down_and_twice_is_the_same() {
    let (example, input) = (sheet(31, 25, [-1.2, 1.2]), sheet(91, 75, [-1.2, 1.2]));
    let settler = Settler::new(&example, &input, 1.0, &Options::default()).expect("has area");
    let right = settler.align(&disturbed(&example), &go).expect("to be aligned");
    let over: Vec<Vec3> = disturbed(&example).iter().map(|p| Vec3::new(p.x, -p.y, -p.z)).collect();
    let wrong = settler.align(&over, &go).expect("to be aligned");
    assert!(settler.are_one(&right, &right) && !settler.are_one(&right, &wrong));
    let sure = |from: &Aligned| settler.halfway(from, &go).expect("to bend").evidence.confidence();
    assert!(sure(&right) > 0.5 && sure(&wrong) < sure(&right) - 0.2, "{} {}", sure(&right), sure(&wrong));
    let at = right.similarity().apply(&settler.rest_position(390).expect("a vertex"));
    assert!((at - example.positions[390]).norm() < 0.05, "{}", (at - example.positions[390]).norm());
    let twice = [0, 1].map(|_| settler.settle(&disturbed(&example), &go).expect("to be settled"));
    assert_eq!(twice[0].positions, twice[1].positions);
    assert_eq!((&twice[0].lost, twice[0].evidence), (&twice[1].lost, twice[1].evidence));
}

#[test]
fn a_coarser_set_of_nodes_carries_the_same_map() {
    let (example, input) = (sheet(61, 49, [-1.2, 1.2]), sheet(91, 75, [-1.2, 1.2]));
    let options = Options { nodes: [200, 400, 800], ..Options::default() };
    let settled = settle(&example, &input, &disturbed(&example), 1.0, &options, &go).expect("to be settled");
    assert!(off(&example, &settled).0 < 0.01, "{:?}", off(&example, &settled));
}

#[test]
fn what_cannot_be_settled_is_refused_and_a_stop_is_heard() {
    let (example, input) = (sheet(11, 9, [-1.0, 1.0]), sheet(31, 25, [-1.0, 1.0]));
    let run = |e: &TriMesh, i: &TriMesh, s: &[Vec3], stop: Stop<'_>| {
        settle(e, i, s, 1.0, &Options::default(), stop).is_some()
    };
    let start = example.positions.clone();
    assert!(run(&example, &input, &start, &go));
    assert!(!run(&example, &input, &start[1..], &go));
    assert!(!run(&example, &input, &vec![Vec3::zeros(); start.len()], &go));
    assert!(!run(&example, &input, &vec![Vec3::repeat(f64::NAN); start.len()], &go));
    assert!(!run(&TriMesh::default(), &input, &[], &go));
    assert!(!run(&example, &TriMesh::default(), &start, &go));
    let asked = AtomicUsize::new(0);
    let stop = || asked.fetch_add(1, Ordering::Relaxed) >= 3;
    assert!(!run(&example, &input, &start, &stop) && asked.into_inner() == 4);
}

/// Points of the half sheet held on the same points of the large one, three on a line but one.
fn landmarks(half: &TriMesh, large: &TriMesh) -> Vec<VertexLandmark> {
    let tree = Bvh::new(large);
    let near = |x: f64, y: f64| {
        let away = |v: &usize| (half.positions[*v].xy() - nalgebra::Vector2::new(x, y)).norm();
        (0..half.positions.len()).min_by(|a, b| away(a).total_cmp(&away(b))).expect("vertices")
    };
    let held = |v: usize| VertexLandmark {
        corners: [(v as u32, 1.0), (v as u32, 0.0), (v as u32, 0.0)],
        to: tree.closest(half.positions[v]),
    };
    [(-0.6, -0.6), (0.4, -0.6), (0.4, 0.7), (-0.5, 0.6)].map(|(x, y)| held(near(x, y))).to_vec()
}

#[test]
fn landmarks_carry_the_example_and_are_met() {
    let (half, large) = (sheet(21, 25, [-0.8, 0.6]), sheet(121, 75, [-2.0, 2.0]));
    let landmarks = landmarks(&half, &large);
    let settler = Settler::new(&half, &large, 1.0, &Options::default()).expect("areas").holding(&landmarks);
    let (start, missed) = settler.carried().expect("spread out");
    assert!(missed < 0.02, "{missed}");
    let settled = settler.settle(&start, &go).expect("to be settled");
    let (mean, most) = off(&half, &settled);
    assert!(mean < 0.01 && most < 0.06, "{mean} {most}");
    for landmark in &landmarks {
        let at = settled.positions[landmark.corners[0].0 as usize];
        assert!((at - landmark.to.point).norm() < 0.01, "{at} {}", landmark.to.point);
    }
    // Mirrored, they can't all be met; two are no pose.
    let mirrored = Settler::new(&half, &large, -1.0, &Options::default()).expect("areas").holding(&landmarks);
    assert!(mirrored.carried().expect("spread out").1 > 3.0 * missed.max(0.05));
    assert_eq!(settler.holding(&landmarks[..2]).carried(), None);
}

#[test]
fn a_landmark_pulls_the_example_from_where_it_would_rest() {
    let mesh = sheet(31, 25, [-1.2, 1.2]);
    let tree = Bvh::new(&mesh);
    let v = 12 * 31 + 15;
    let to = tree.closest(mesh.positions[v] + Vec3::new(0.15, 0.0, 0.0));
    let held = VertexLandmark { corners: [(v as u32, 1.0), (v as u32, 0.0), (v as u32, 0.0)], to };
    let plain = Settler::new(&mesh, &mesh, 1.0, &Options::default()).expect("areas");
    let free = plain.settle(&mesh.positions, &go).expect("to be settled");
    let pulled = plain.holding(&[held]).settle(&mesh.positions, &go).expect("to be settled");
    let missed = |s: &Settled| (s.positions[v] - to.point).norm();
    assert!(missed(&free) > 0.12 && missed(&pulled) < 0.02, "{} {}", missed(&free), missed(&pulled));
}

#[test]
fn tips_lead_the_example_and_let_go_of_it() {
    let (half, large) = (sheet(21, 25, [-0.8, 0.6]), sheet(121, 75, [-2.0, 2.0]));
    let mut tips = landmarks(&half, &large);
    let tree = Bvh::new(&large);
    tips[0].to = tree.closest(tips[0].to.point + Vec3::new(0.1, 0.0, 0.0));
    let settler = Settler::new(&half, &large, 1.0, &Options::default()).expect("areas");
    let (_, rough) = settler.led_roughly(&tips, &[], &go).expect("to be laid");
    let settled = settler.fine_from(&rough, &go).expect("to be settled").0;
    let (mean, most) = off(&half, &settled);
    assert!(mean < 0.02 && most < 0.1, "{mean} {most}");
    assert!(settled.evidence.confidence() > 0.8 && settled.evidence.covered < 0.5, "{:?}", settled.evidence);
}

#[test]
fn a_part_is_found_on_a_larger_surface_whatever_its_pose_and_size() {
    let (part, whole) = (sheet(21, 21, [-0.2, 1.4]), sheet(121, 75, [-2.0, 2.0]));
    let (sin, cos) = 2.1f64.sin_cos();
    let turn = nalgebra::Matrix3::new(cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos);
    let moved = part.positions.iter().map(|x| turn * x * 3.0 + Vec3::new(5.0, -1.0, 2.0)).collect();
    let moved = TriMesh::from_triangles(moved, part.triangles.clone()).expect("a sheet");
    let off = |pose: &Similarity, from: &TriMesh, to: &TriMesh| {
        let d = from.positions.iter().zip(&to.positions).map(|(a, b)| (pose.apply(a) - b).norm());
        d.sum::<f64>() / from.positions.len() as f64
    };
    let found = poses(&moved, &whole, [true, false], Thoroughness::Thoroughly, &go);
    assert!(off(&found[0].1, &moved, &part) < 0.15, "{}", off(&found[0].1, &moved, &part));
    // The same with the roles changed: the scan shows a part of the example.
    let found = poses(&whole, &moved, [false, true], Thoroughness::Thoroughly, &go);
    let back = found[0].1;
    let undone: f64 = part.positions.iter().zip(&moved.positions).map(|(a, b)| (back.apply(a) - b).norm()).sum();
    assert!(undone / (3.0 * part.positions.len() as f64) < 0.15, "{undone}");
    assert!(poses(&moved, &whole, [true, false], Thoroughness::Quickly, &|| true).is_empty());
}
