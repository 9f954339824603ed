//! Tests of rough poses.

use super::*;
use crate::topology::tests::grid;

/// A ball with two bumps, open below `z`.
fn bust(n: u32, z: f64, wide: f64) -> TriMesh {
    let flat = grid(n, n, false, false);
    let size = flat.positions.iter().fold(0.0f64, |most, p| most.max(p.x).max(p.y));
    let place = |p: &Vec3| {
        let (x, y) = (2.0 * p.x / size - 1.0, 2.0 * p.y / size - 1.0);
        // The square onto the disc, and the disc onto the cap above `z`.
        let (x, y) = (x * (1.0 - 0.5 * y * y).sqrt(), y * (1.0 - 0.5 * x * x).sqrt());
        let radius = (x * x + y * y).sqrt().min(1.0);
        let (polar, around) = (radius * z.acos(), y.atan2(x));
        let on = Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
        let bump = |to: Vec3, high: f64| high * (-(on - to.normalize()).norm_squared() / 0.05).exp();
        on * (1.0 + bump(Vec3::new(1.0, 0.1, 0.2), 0.35) + bump(Vec3::new(0.7, -0.7, 0.5), 0.2))
            + Vec3::z() * wide * (1.0 - on.z)
    };
    let positions = flat.positions.iter().map(place).collect();
    TriMesh::from_triangles(positions, flat.triangles.clone()).expect("a bust")
}

#[test]
fn what_is_bulky_is_laid_by_what_is_about_some_of_its_points() {
    let ground = bust(40, -0.8, 0.0);
    let small = Small::new(&InputSurface::new(&ground), &FULL);
    assert_eq!(small.anchors.len(), 17);
    let sheet = grid(24, 24, false, false);
    assert_eq!(Small::new(&InputSurface::new(&sheet), &FULL).anchors.len(), 1);
    for anchor in &small.anchors {
        assert!((anchor.upright * anchor.upright.transpose() - Matrix3::identity()).norm() < 1e-9);
    }
    // Turned and moved, and longer below: the bumps tell where it belongs.
    let turn = axes(Vec3::new(0.3, -0.8, 0.5).normalize()) * turned(5, 12);
    let mut input = bust(56, -0.95, -0.4);
    input.positions.iter_mut().for_each(|x| *x = turn * *x + Vec3::new(3.0, 1.0, -2.0));
    let found = poses(&ground, &input, [true, true], Sought::Thoroughly, &|| false);
    let (score, best) = &found[0];
    let off = Vec3::new(1.3, 0.13, 0.26);
    let there = turn * off + Vec3::new(3.0, 1.0, -2.0);
    assert!((best.apply(&off) - there).norm() < 0.4, "{score} {}", (best.apply(&off) - there).norm());
}

#[test]
fn sifting_drops_early_none_of_the_poses_that_go_on() {
    let mut mesh = grid(24, 24, false, false);
    mesh.positions.iter_mut().for_each(|p| p.z = 0.2 * (5.0 * p.x + 0.4).sin() * (3.9 * p.y).cos());
    let ground = InputSurface::new(&mesh);
    let (small, large) = (Small::new(&ground, &QUICK), Large::new(&ground, 1.0, QUICK.large));
    let pose = |k: usize| {
        let shift = large.seen.samples.points[37 * k % large.seen.samples.points.len()] * 0.5;
        Motion { rotation: axes(direction(k % 60, 60)) * turned(k % 12, 12), shift }
    };
    let sifted = |kept: usize| {
        let mut found = Sifted { kept, ..Sifted::new(&QUICK, 1) };
        (0..720).for_each(|k| small.sift(&large, pose(k), &mut found));
        let tried = found.poses.len();
        let mut nearest: Vec<u64> = found.poses.iter().map(|(nearness, _)| nearness.to_bits()).collect();
        nearest.sort_unstable_by_key(|bits| Reverse(*bits));
        nearest.truncate(48);
        (nearest, tried)
    };
    let (all, few) = (sifted(usize::MAX), sifted(48));
    assert_eq!(all.0, few.0);
    assert!(all.1 == 720 && few.1 < 600, "{} of {} were summed to the end", few.1, all.1);
}
