//! Question: where does the time of a query go, and what does the schedule miss of the exhaustive ranking?
//!
//! `query_stages INPUT.obj EXAMPLE.obj…`, on one thread, in milliseconds of processor time (Linux), so that other work
//! on the machine shows less. Every example is registered up to 128²; the schedule's choice is then told from that.

use quadmuse_kernel::encode::{Encoding, encode};
use quadmuse_kernel::mesh::{self, Limits};
use quadmuse_kernel::rank::{SegmentShape, score};
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::segment::Segmented;
use quadmuse_kernel::topology::{Components, Patch, Topology};
use quadmuse_kernel::unfold::{UnfoldOptions, unfold};

/// Entries that are finished.
const TOP: usize = 4;
/// The best that the schedule shall find.
const WANTED: usize = 10;

struct Ranked {
    name: String,
    encoding: Encoding,
    entry: Entry,
    /// E′ at 32², 64², 128².
    scores: [f64; 3],
}

/// Milliseconds of processor time of this thread; 0 where the system doesn't tell.
fn cpu_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) / 1e6
}

fn patch_of(file: &str) -> Option<Patch> {
    let mesh = mesh::read(&std::fs::read(file).ok()?, None, &Limits::default()).ok()?;
    let prepared = mesh::prepare(&mesh).ok()?;
    let segmented = Segmented::primitive(&prepared.mesh, Components::SmallLeftOut).ok()?;
    segmented.parts.into_iter().next().filter(|patch| patch.topology == Topology::Disc)
}

fn score_of(entry: &Entry, example: &Encoding) -> f64 {
    let best = entry.best();
    let shape = |modulus| SegmentShape { modulus, bending: None };
    score(best.cost(), shape(example.modulus), shape(best.unfolded.encoding.modulus), 3.0)
}

fn main() {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let Some((input, examples)) = files.split_first() else {
        eprintln!("expected INPUT EXAMPLE…");
        return;
    };
    let (solver, go_on) = (LevenbergMarquardt::default(), || false);
    let encoded = |file: &String| {
        let chart = unfold(&patch_of(file)?, &UnfoldOptions::default()).ok()?;
        let name = file.rsplit('/').next().unwrap_or(file).to_owned();
        Some((name, encode(&chart)))
    };
    let examples: Vec<(String, Encoding)> = examples.iter().filter_map(encoded).collect();
    let begun = cpu_ms();
    let query = Query::new(&patch_of(input).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
    let read = cpu_ms();
    let poles = query.candidates().len();
    println!("read and encoded {:.0} ms, {poles} poles prepared {:.0} ms", read - begun, cpu_ms() - read);
    let begun = cpu_ms();
    let count = examples.len();
    let mut ranked: Vec<Ranked> = examples
        .into_iter()
        .filter_map(|(name, encoding)| {
            let entry = Entry::coarse(&query, &encoding, &solver, &go_on)?;
            let scores = [score_of(&entry, &encoding), 0.0, 0.0];
            Some(Ranked { name, encoding, entry, scores })
        })
        .collect();
    println!("32²: {count} in {:.0} ms", cpu_ms() - begun);
    for (level, side) in [(1, "64²"), (2, "128²")] {
        let begun = cpu_ms();
        for one in &mut ranked {
            one.entry.advance(&query, &one.encoding, &solver, &go_on).expect("unfoldable");
            one.scores[level] = score_of(&one.entry, &one.encoding);
        }
        println!("{side}: {count} in {:.0} ms", cpu_ms() - begun);
    }
    ranked.sort_by(|a, b| a.scores[2].total_cmp(&b.scores[2]));
    missed(&ranked);
    let begun = cpu_ms();
    for one in ranked.iter_mut().take(TOP) {
        let (before, start) = (one.entry.best().cost(), cpu_ms());
        one.entry.refine_poles(&query, &one.encoding, &solver, &go_on).expect("unfoldable");
        let after = one.entry.best();
        println!(
            "  {:40} {before:.6} → {:.6} at {:?}, {:.0} ms",
            one.name,
            after.cost(),
            after.unfolded.poles,
            cpu_ms() - start
        );
    }
    println!("finished {TOP} in {:.0} ms", cpu_ms() - begun);
}

/// Tells the places at 32² and 64² of the best at 128².
fn missed(ranked: &[Ranked]) {
    let place = |level: usize, of: &Ranked| ranked.iter().filter(|r| r.scores[level] < of.scores[level]).count();
    for one in ranked.iter().take(WANTED) {
        let [a, b, c] = one.scores;
        println!("  {:40} {a:.4} (place {}) {b:.4} ({}) {c:.4}", one.name, place(0, one), place(1, one));
    }
}
