//! How long does each step take, beside the paper's Table 1 (four cores; here one thread a computation)?
//!
//! `cargo bench -p quadmuse-kernel --bench figures`; the results are kept in tests/records.

use divan::Bencher;
use quadmuse_kernel::encode::encode;
use quadmuse_kernel::map::{cross_map, edit};
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::topology::{Patch, whole};
use quadmuse_kernel::unfold::{UnfoldOptions, unfold};
use std::f64::consts::TAU;

fn main() {
    divan::main();
}

/// A head-like disc of about `triangles` triangles: a globe with bumps, open at its foot; `kind` varies it.
fn head(triangles: usize, kind: u32) -> Patch {
    let around = ((triangles as f64 / 2.0).sqrt() * 1.4) as u32;
    let up = (triangles as f64 / 2.0 / f64::from(around)) as u32;
    let vary = |n: u32| f64::from((kind * 7 + n * 13) % 11) / 11.0;
    let bumps = [
        (0.3 + 0.2 * vary(1), [0.0, -1.0, 0.1], 0.22),
        (0.2 + 0.1 * vary(2), [1.0, 0.1, 0.1], 0.25),
        (0.2 + 0.1 * vary(2), [-1.0, 0.1, 0.1], 0.25),
        (0.1 + 0.3 * vary(3), [0.5, 0.8, 0.4], 0.35),
        (0.2 * vary(4), [0.2, -0.5, 0.8], 0.3),
    ];
    let place = |a: f64, b: f64| {
        let d = Vec3::new(b.sin() * a.cos(), b.sin() * a.sin(), b.cos());
        let bump = |(height, at, width): &(f64, [f64; 3], f64)| {
            let angle = d.dot(&Vec3::from(*at).normalize()).clamp(-1.0, 1.0).acos();
            height * (-(angle / width).powi(2)).exp()
        };
        d * (1.0 + bumps.iter().map(bump).sum::<f64>())
    };
    let mut positions = vec![place(0.0, 0.0)];
    for j in 1..=up {
        for i in 0..around {
            positions.push(place(TAU * f64::from(i) / f64::from(around), 2.6 * f64::from(j) / f64::from(up)));
        }
    }
    let at = |j: u32, i: u32| 1 + (j - 1) * around + i % around;
    let mut corners: Vec<[u32; 3]> = (0..around).map(|i| [0, at(1, i), at(1, i + 1)]).collect();
    for j in 1..up {
        for i in 0..around {
            let [a, b, c, d] = [at(j, i), at(j + 1, i), at(j + 1, i + 1), at(j, i + 1)];
            corners.extend([[a, b, c], [a, c, d]]);
        }
    }
    whole(&TriMesh::from_triangles(positions, corners).expect("a disc is manifold")).expect("a disc")
}

/// Targets: 40 ms, 60 ms, 0.4 s, 3 s; the paper unfolds 7k in 0.6–0.7 s and 12k in 1.06 s.
#[divan::bench(args = [7_000, 12_000, 92_000, 500_000, 1_000_000], sample_count = 3, sample_size = 1)]
fn unfold_and_encode(bencher: Bencher, triangles: usize) {
    let patch = head(triangles, 0);
    bencher.bench_local(|| encode(&unfold(&patch, &UnfoldOptions::default()).expect("solvable")));
}

/// The corpus of the paper's size, encoded, and a query.
fn corpus() -> (Vec<quadmuse_kernel::encode::Encoding>, Query) {
    let encoded = |kind| encode(&unfold(&head(6_000, kind), &UnfoldOptions::default()).expect("solvable"));
    let query = Query::new(&head(12_000, 2), &UnfoldOptions::default()).expect("solvable");
    query.candidates();
    ((0..45).map(encoded).collect(), query)
}

/// To `side`: at each level the better half goes on, the best four always.
fn ranked(corpus: &[quadmuse_kernel::encode::Encoding], query: &Query, side: usize) -> Vec<(usize, Entry)> {
    let (solver, never) = (LevenbergMarquardt::default(), || false);
    let coarse = |(k, example)| Some((k, Entry::coarse(query, example, &solver, &never)?));
    let mut entries: Vec<(usize, Entry)> = corpus.iter().enumerate().filter_map(coarse).collect();
    while entries[0].1.side() < side {
        entries.sort_by(|a, b| a.1.best().cost().total_cmp(&b.1.best().cost()));
        entries.truncate((entries.len() / 2).max(4));
        for (k, entry) in &mut entries {
            entry.advance(query, &corpus[*k], &solver, &never).expect("solvable");
        }
    }
    entries
}

/// Targets: 0.35 s to 128², 1 s to 512² (two cores; this is one thread).
#[divan::bench(args = [128, 512], sample_count = 3, sample_size = 1)]
fn register_45_segments(bencher: Bencher, side: usize) {
    let (corpus, query) = corpus();
    bencher.bench_local(|| ranked(&corpus, &query, side));
}

/// Target: 1 s more for the top four.
#[divan::bench(sample_count = 3, sample_size = 1)]
fn refine_poles_of_the_top_4(bencher: Bencher) {
    let (corpus, query) = corpus();
    let mut top = ranked(&corpus, &query, 128);
    top.truncate(4);
    let (solver, never) = (LevenbergMarquardt::default(), || false);
    bencher.bench_local(|| {
        for (k, entry) in &top {
            entry.clone().refine_poles(&query, &corpus[*k], &solver, &never).expect("solvable");
        }
    });
}

/// Target: 10 ms for an example of 10,000 quads: a constraint added, folds looked for, every vertex mapped.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn edit_a_constraint_of_10k_quads(bencher: Bencher) {
    let chart = unfold(&head(20_000, 2), &UnfoldOptions::default()).expect("solvable");
    let query = Query::new(&head(12_000, 2), &UnfoldOptions::default()).expect("solvable");
    let (solver, never) = (LevenbergMarquardt::default(), || false);
    let encoding = encode(&chart);
    let mut entry = Entry::coarse(&query, &encoding, &solver, &never).expect("a disc too");
    while entry.side() < 128 {
        entry.advance(&query, &encoding, &solver, &never).expect("solvable");
    }
    let before = entry.best().registration.clone();
    query.index();
    bencher.bench_local(|| {
        let mut registration = before.clone();
        let to = registration.map(chart.topology, [0.31, 0.47]);
        let on_input = [to[0] + 0.003, to[1] + 0.003];
        edit::set(&mut registration, chart.topology, None, [0.31, 0.47], on_input).expect("room");
        edit::check_folds(&registration, chart.topology).expect("no fold");
        cross_map(&registration, &chart, &query.chart, query.index())
    });
}
