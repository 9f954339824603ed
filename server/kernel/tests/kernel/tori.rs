//! How exactly a torus is laid on another mesh of itself: rings, and a tube along a trefoil.
//!
//! `cargo test --release -p quadmuse-kernel --test kernel tori -- --nocapture` prints the table of tests/records.

use quadmuse_kernel::encode::encode;
use quadmuse_kernel::map::{cross_map, folded_faces};
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::topology::{Topology, whole};
use quadmuse_kernel::unfold::{UnfoldOptions, unfold};
use std::f64::consts::TAU;

type Curve = fn(f64) -> Vec3;

fn ring(t: f64) -> Vec3 {
    2.4 * Vec3::new((TAU * t).cos(), (TAU * t).sin(), 0.1 * (2.0 * TAU * t).sin())
}

fn trefoil(t: f64) -> Vec3 {
    let a = TAU * t;
    1.3 * Vec3::new(a.sin() + 2.0 * (2.0 * a).sin(), a.cos() - 2.0 * (2.0 * a).cos(), -(3.0 * a).sin())
}

/// The place `t` along a curve and `s` around it, both of period 1, on a tube with lumps.
fn place(curve: Curve, t: f64, s: f64) -> Vec3 {
    let along = (curve(t + 1e-4) - curve(t - 1e-4)).normalize();
    let x = along.cross(&Vec3::new(0.3, 0.4, 0.866)).normalize();
    let y = along.cross(&x);
    let bump = |at: f64, around: f64, height: f64| {
        height * (((TAU * (t - at)).cos() - 1.0) / 0.06 + ((TAU * (s - around)).cos() - 1.0) / 0.3).exp()
    };
    let girth = 0.5 + 0.1 * (TAU * t).sin() + bump(0.1, 0.2, 0.3) + bump(0.4, 0.7, 0.4) + bump(0.6, 0.1, 0.2);
    curve(t) + girth * ((TAU * s).cos() * x + (TAU * s).sin() * y)
}

/// A mesh of `n` by `m` cells, its vertices shifted within them by up to `shake` of a cell, and the parameters of each.
fn mesh(curve: Curve, n: u32, m: u32, start: [f64; 2], shake: f64) -> (TriMesh, Vec<[f64; 2]>) {
    // A linear congruential generator: the same shake each time.
    let mut state = 12345u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
    };
    let at = |j: u32, i: u32| (j % m) * n + i % n;
    let mut parameters = Vec::new();
    let mut triangles = Vec::new();
    for j in 0..m {
        for i in 0..n {
            let s = (f64::from(i) + shake * random()) / f64::from(n) + start[1];
            parameters.push([(f64::from(j) + shake * random()) / f64::from(m) + start[0], s]);
            let [a, b, c, d] = [at(j, i), at(j, i + 1), at(j + 1, i + 1), at(j + 1, i)];
            triangles.extend(if random() > 0.0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
        }
    }
    let positions = parameters.iter().map(|[t, s]| place(curve, *t, *s)).collect();
    (TriMesh::from_triangles(positions, triangles).expect("a torus is manifold"), parameters)
}

#[test]
fn the_same_surface_remeshed_is_met_within_a_quarter_of_a_percent() {
    println!("| tube | example | input | median | p95 | folded faces |");
    for (name, curve) in [("ring", ring as Curve), ("trefoil", trefoil)] {
        for (n, m, shake) in [(20, 110, 0.0), (26, 150, 0.5), (40, 230, 0.5)] {
            let (example, _) = mesh(curve, 24, 120, [0.0, 0.0], 0.0);
            let (input, _) = mesh(curve, n, m, [0.37, 0.21], shake);
            let example = whole(&example).expect("one component");
            assert_eq!(example.topology, Topology::Torus);
            let chart = unfold(&example, &UnfoldOptions::default()).expect("solvable");
            let encoding = encode(&chart);
            let query =
                Query::new(&whole(&input).expect("one component"), &UnfoldOptions::default()).expect("solvable");
            let (solver, never) = (LevenbergMarquardt::default(), || false);
            let mut entry = Entry::coarse(&query, &encoding, &solver, &never).expect("two tori");
            while entry.side() < 128 {
                entry.advance(&query, &encoding, &solver, &never).expect("solvable");
            }
            let registration = &entry.best().registration;
            let map = cross_map(registration, &chart, &query.chart, query.index());
            let root = input.total_area().sqrt();
            let mut errors: Vec<f64> =
                map.positions.iter().zip(&example.mesh.positions).map(|(a, b)| (a - b).norm() / root).collect();
            errors.sort_by(f64::total_cmp);
            let (median, p95) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
            let folded = folded_faces(registration, &chart, &example.mesh).len();
            let (one, two) = (example.mesh.triangles.len(), input.triangles.len());
            println!("| {name} | {one} | {two} | {:.3} % | {:.3} % | {folded} |", 100.0 * median, 100.0 * p95);
            assert!(
                median < 0.0025 && p95 < 0.009 && folded == 0,
                "{name}, {two} triangles: {median}, {p95}, {folded}"
            );
        }
    }
}
