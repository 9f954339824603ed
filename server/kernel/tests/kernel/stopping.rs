//! Whatever stage is under way, a computation asks often whether to go on, and ends where it is told to.

use quadmuse_kernel::compose::{self, Options, Piece, surface::ComposedSurface};
use quadmuse_kernel::mesh::{self, PolyMesh, Vec3};
use quadmuse_kernel::numerics::stop;
use quadmuse_kernel::register::Query;
use quadmuse_kernel::segment::{PartCount, segment};
use quadmuse_kernel::unfold::UnfoldOptions;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Moments at which it is stopped.
const STOPS: u64 = 12;

/// Threads that may ask before each has heard that it is to stop.
const THREADS: u64 = 4;

/// Two bumpy sheets apart, of `side`² squares each.
fn sheets(side: u32) -> PolyMesh {
    let mut poly = PolyMesh::default();
    for k in 0..2u32 {
        let first = poly.positions.len() as u32;
        for n in 0..(side + 1) * (side + 1) {
            let (x, y) = (f64::from(n % (side + 1)) / f64::from(side), f64::from(n / (side + 1)) / f64::from(side));
            poly.positions.push(Vec3::new(x + 2.0 * f64::from(k), y, 0.2 * (5.0 * x).sin() * (4.0 * y).cos()));
        }
        for n in 0..side * side {
            let a = first + n / side * (side + 1) + n % side;
            poly.faces.push(&[a, a + 1, a + side + 2, a + side + 1]);
        }
    }
    poly
}

/// All of the way from polygons to a composition; calls `entered` at each stage.
fn way(poly: &PolyMesh, entered: &dyn Fn(&'static str)) -> usize {
    entered("prepare");
    let surface = mesh::prepare(poly).expect("sheets").mesh;
    entered("segment");
    let cut = segment(&surface, PartCount::AsNeeded).expect("two parts");
    entered("unfold and encode");
    let queries: Vec<Query> =
        cut.parts.iter().map(|patch| Query::new(patch, &UnfoldOptions::default()).expect("a disc")).collect();
    entered("compose");
    let ground = ComposedSurface::of(&cut);
    let pieces: Vec<Piece<'_>> = queries.iter().map(|query| Piece::Regular(&query.chart, query.index())).collect();
    let made = compose::compose(ground.input(), &pieces, Options::default(), &|| false).expect("regular layouts");
    made.mesh.faces.len()
}

/// Runs it until it has asked so many times; returns how often it asked, by stage, and whether it ended by itself.
fn asked_until(poly: &PolyMesh, most: u64) -> (Vec<(&'static str, u64)>, bool) {
    let stages = RefCell::new(Vec::new());
    let count = Arc::new(AtomicU64::new(0));
    let by_ask = Arc::clone(&count);
    let ask = move || {
        let asked = by_ask.fetch_add(1, Ordering::Relaxed) + 1;
        assert!(asked < most.saturating_add(THREADS), "it went on after it was stopped");
        if asked >= most {
            resume_unwind(Box::new("stopped"));
        }
    };
    let asked = || count.load(Ordering::Relaxed).min(most);
    let entered = |name| stages.borrow_mut().push((name, asked()));
    let run = || stop::within(Arc::new(ask), || way(poly, &entered));
    let is_ended = catch_unwind(AssertUnwindSafe(run)).is_ok();
    let mut begun = stages.take();
    begun.push(("end", asked()));
    (begun.windows(2).map(|pair| (pair[0].0, pair[1].1 - pair[0].1)).collect(), is_ended)
}

#[test]
fn every_stage_asks_in_proportion_to_its_work_and_ends_where_it_is_told_to() {
    let poly = sheets(60);
    let (all, is_ended) = asked_until(&poly, u64::MAX);
    println!("{all:?}");
    assert!(is_ended);
    let triangles = 2 * 2 * 60 * 60;
    for (stage, asks) in &all {
        assert!(*asks > triangles / 4096, "{stage}: {asks} for {triangles} triangles");
    }
    let total: u64 = all.iter().map(|stage| stage.1).sum();
    for k in 0..STOPS {
        let most = 1 + k * (total - 1) / STOPS;
        let (stopped, is_ended) = asked_until(&poly, most);
        assert!(!is_ended, "it came to its end after {most} of {total}");
        assert_eq!(stopped.iter().map(|stage| stage.1).sum::<u64>(), most);
    }
}

#[test]
fn a_ribbon_is_unfolded_however_long_it_is() {
    for columns in [100u32, 3000, 20_000] {
        let mut poly = PolyMesh::default();
        for k in 0..columns {
            let x = 0.1 * f64::from(k);
            poly.positions.extend([Vec3::new(x, x.sin(), 0.0), Vec3::new(x, x.sin(), 1.0)]);
            if k > 0 {
                let a = 2 * k - 2;
                poly.faces.push(&[a, a + 2, a + 3, a + 1]);
            }
        }
        let surface = mesh::prepare(&poly).expect("a ribbon").mesh;
        let patch = quadmuse_kernel::topology::whole(&surface).expect("a disc");
        let query = Query::new(&patch, &UnfoldOptions::default()).expect("unfolded");
        assert!(query.chart.corners.iter().flatten().flatten().all(|x| x.is_finite()), "{columns} columns");
    }
}
