//! Tests of rough poses.

use super::*;
use crate::topology::tests::{ball, grid};

/// A ball with two bumps, open below `z`.
fn bust(n: u32, z: f64) -> TriMesh {
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
    };
    let positions = flat.positions.iter().map(place).collect();
    TriMesh::from_triangles(positions, flat.triangles.clone()).expect("a bust")
}

#[test]
fn what_is_bulky_is_laid_by_what_is_about_some_of_its_points() {
    let ground = bust(40, -0.8);
    let small = Small::new(&InputSurface::new(&ground), &FULL);
    assert_eq!(small.anchors.len(), 17);
    let sheet = grid(24, 24, false, false);
    assert_eq!(Small::new(&InputSurface::new(&sheet), &FULL).anchors.len(), 1);
    for anchor in &small.anchors {
        assert!((anchor.upright * anchor.upright.transpose() - Matrix3::identity()).norm() < 1e-9);
    }
    // Turned and moved, and cut lower: the bumps tell where it belongs.
    let turn = axes(Vec3::new(0.3, -0.8, 0.5).normalize()) * turned(5, 12);
    let mut input = bust(56, -0.95);
    input.positions.iter_mut().for_each(|x| *x = turn * *x + Vec3::new(3.0, 1.0, -2.0));
    let found = poses(&ground, &input, [true, true], Thoroughness::Thoroughly, &|| false);
    let (score, best) = &found[0];
    let off = Vec3::new(1.3, 0.13, 0.26);
    let there = turn * off + Vec3::new(3.0, 1.0, -2.0);
    assert!((best.apply(&off) - there).norm() < 0.2, "{score} {}", (best.apply(&off) - there).norm());
}

#[test]
fn a_part_with_relief_explains_more_than_a_smooth_one_of_its_size() {
    // The larger is a square with bumps in one corner.
    let bumps = |p: &Vec3| 0.15 * (9.0 * p.x).sin() * (7.0 * p.y).cos() * (-(p.x * p.x + p.y * p.y) / 0.08).exp();
    let sheet = |n: u32, corner: f64, side: f64| {
        let mut mesh = grid(n, n, false, false);
        let size = mesh.positions.iter().fold(0.0f64, |most, p| most.max(p.x).max(p.y));
        mesh.positions
            .iter_mut()
            .for_each(|p| *p = Vec3::new(corner + side * p.x / size, corner + side * p.y / size, 0.0));
        // Slightly bent everywhere.
        mesh.positions.iter_mut().for_each(|p| p.z = bumps(p) + 0.1 * p.x * p.x);
        mesh
    };
    let whole = PosedSurface::quick(&sheet(60, 0.0, 1.0), true);
    let explained = |corner: f64| {
        let part = PosedSurface::quick(&sheet(30, corner, 0.5), true);
        let [on_whole, by_whole] = [part.likeness(&whole, &|| false), whole.likeness(&part, &|| false)];
        // The part is all of itself, whichever of the two is the other.
        assert!(by_whole.explained >= on_whole.explained, "{by_whole:?} {on_whole:?}");
        on_whole.explained
    };
    let [bumpy, smooth] = [explained(0.0), explained(0.5)];
    assert!(bumpy > 0.5 && smooth < 0.5 * bumpy, "{bumpy} {smooth}");
}

#[test]
fn a_surface_is_nearest_to_itself_where_it_lies() {
    let mut mesh = grid(24, 24, false, false);
    mesh.positions.iter_mut().for_each(|p| p.z = 0.2 * (5.0 * p.x + 0.4).sin() * (3.9 * p.y).cos());
    let ground = InputSurface::new(&mesh);
    let (small, large) = (Small::new(&ground, &QUICK), Large::new(&ground, 1.0, QUICK.large));
    let nearness = |turn: usize, shift: f64| {
        let motion = Motion { rotation: turned(turn, 12), shift: Vec3::x() * shift };
        small.nearness(&large, &motion, QUICK.sifted_by)
    };
    let there = nearness(0, 0.0);
    assert!(there > 0.7, "{there}");
    // Farther off, or turned farther, it falls: what a pose misses by half a step tells still.
    assert!([(0, 0.13), (0, 0.3), (1, 0.0), (3, 0.0)].iter().all(|(turn, shift)| nearness(*turn, *shift) < there));
    assert!(nearness(0, 0.13) > 0.4 && nearness(0, 1.5) < 0.05, "{} {}", nearness(0, 0.13), nearness(0, 1.5));
}

#[test]
fn what_is_flat_is_like_what_is_flat_and_like_nothing_else() {
    let sheet = |n: u32, bump: f64| {
        let mut mesh = grid(n, n, false, false);
        mesh.positions.iter_mut().for_each(|p| p.z = bump * (5.0 * p.x + 0.4).sin() * (3.9 * p.y).cos());
        mesh
    };
    assert_eq!([0.0, 0.001, 0.2].map(|bump| sheet(24, bump).is_flat()), [true, true, false]);
    let like = |one: f64, two: f64| {
        let [one, two] = [sheet(24, one), sheet(40, two)].map(|mesh| PosedSurface::quick(&mesh, true));
        one.likeness(&two, &|| false).score
    };
    assert!(like(0.0, 0.0) > 0.6, "{}", like(0.0, 0.0));
    assert_eq!([like(0.0, 0.2), like(0.2, 0.0)], [0.0; 2]);
}

/// A closed ball with three bumps, like nothing turned.
fn bumpy(n: u32) -> TriMesh {
    let mut mesh = ball(n);
    let bumps = [(Vec3::x(), 0.6), (Vec3::new(0.2, 1.0, 0.1), 0.4), (Vec3::new(-0.3, -0.4, 0.8), 0.5)];
    for p in &mut mesh.positions {
        let high = |(to, high): &(Vec3, f64)| high * (-(*p - to.normalize()).norm_squared() / 0.1).exp();
        let high: f64 = bumps.iter().map(high).sum();
        *p *= 1.0 + high;
    }
    mesh
}

#[test]
fn of_two_closed_surfaces_one_is_laid_on_the_other_as_a_whole() {
    let (example, mut input) = (bumpy(24), bumpy(32));
    let turn = axes(Vec3::new(0.3, -0.8, 0.5).normalize()) * turned(5, 12);
    let there = |x: &Vec3| turn * x * 2.0 + Vec3::new(3.0, 1.0, -2.0);
    input.positions.iter_mut().for_each(|x| *x = there(x));
    for sought in [Thoroughness::Thoroughly, Thoroughness::Roughly] {
        let found = poses(&example, &input, [false, false], sought, &|| false);
        let (score, best) = &found[0];
        let off = example.positions.iter().map(|x| (best.apply(x) - there(x)).norm()).fold(0.0, f64::max);
        assert!(off < 0.2, "{sought:?} {score} {off}");
    }
    assert!(poses(&example, &input, [false, false], Thoroughness::Roughly, &|| true).is_empty());
}
