//! Question: how much does a bound of a few numbers a segment leave to be swept, if it is computed before the sweep?
//!
//! Of frequency 0 of the row spectra, the means of the 32 rows, no shift changes anything; of the others Cauchy and Schwarz
//! bound what any shift can gain. With a_r the means, |A_f|² = Σ_r w_f |A_r(f)|² and R² = Σ_{f>0} |A_f|², in units of 1/n³,
//!
//! ```text
//! E ≥ gap² + Σ_r (a_r − b_r)²                              means
//!   …      + (R_A − R_B)²                                  means and rest
//!   …      + Σ_{f>0} (|A_f| − |B_f|)²                      means and frequencies
//!   …      + Σ_{f>0} Σ_r w_f (|A_r(f)| − |B_r(f)|)²        magnitudes
//! ```
//!
//! The rows of a store are ranked exactly, and the bound is compared with the score of the last of the best K: what is not
//! above it would be left. `cargo run --release -p quadmuse-server --example means -- STORE INPUT.obj…`

use quadmuse_kernel::rank::coarse::{CoarseQuery, RowFacts};
use quadmuse_kernel::rank::{SegmentShape, score};
use quadmuse_kernel::register::Flip;
use quadmuse_kernel::register::spectra::{Row, SIDE, Spectrum, VALUES};
use quadmuse_kernel::topology::Topology as Shaped;
use quadmuse_proto::Topology;
use quadmuse_server::pool::Stop;
use quadmuse_server::work::catalogue::{Catalogue, Stock};
use quadmuse_server::work::corpus::stored::StoredCorpus;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::engine::{Cut, Engine};
use quadmuse_store::OpenOptions;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// As if each had been marked as relevant.
const RELEVANCE: f64 = 3.0;
/// Numbers of segments that are kept, and sizes of the corpus.
const KEPT: [usize; 3] = [24, 128, 512];
const SIZES: [usize; 3] = [1_000, 10_000, 100_000];
const BOUNDS: [&str; 4] = ["means", "means and rest", "means and frequencies", "magnitudes"];
/// Frequencies above 0.
const WAVES: usize = SIDE / 2;
const NORM: f64 = 1.0 / (SIDE * SIDE * SIDE) as f64;

/// The few numbers of a picture that the bounds use.
struct Few {
    mean: f64,
    variance: f64,
    means: [f64; SIDE],
    frequencies: [f64; WAVES],
    rest: f64,
    magnitudes: Box<[f64]>,
}

impl Few {
    fn new(value: impl Fn(usize) -> f64, mean: f64, variance: f64) -> Self {
        let means = std::array::from_fn(|row| NORM.sqrt() * value(row));
        let mut frequencies = [0.0; WAVES];
        let mut magnitudes = vec![0.0; WAVES * SIDE].into_boxed_slice();
        for f in 1..=WAVES {
            for row in 0..SIDE {
                let magnitude = if f == WAVES {
                    NORM.sqrt() * value(SIDE + row).abs()
                } else {
                    let at = 2 * SIDE * f + 2 * row;
                    (2.0 * NORM).sqrt() * value(at).hypot(value(at + 1))
                };
                magnitudes[(f - 1) * SIDE + row] = magnitude;
                frequencies[f - 1] += magnitude * magnitude;
            }
        }
        let rest = frequencies.iter().sum::<f64>().sqrt();
        Self { mean, variance, means, frequencies: frequencies.map(f64::sqrt), rest, magnitudes }
    }

    fn of_row(row: &Row) -> Self {
        let value = |k: usize| f64::from(row.codes[k]) * f64::from(row.scale);
        Self::new(value, f64::from(row.mean), row.variance)
    }

    fn of_query(spectrum: &Spectrum) -> Self {
        assert_eq!(spectrum.values().len(), VALUES);
        Self::new(|k| spectrum.values()[k], spectrum.mean, spectrum.variance)
    }

    /// Lower bounds of the cost, in the order of [`BOUNDS`].
    fn costs(&self, query: &Self) -> [f64; 4] {
        let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let gap = self.mean - query.mean;
        let first = gap * gap + apart(&self.means, &query.means);
        let more = [
            0.0,
            (self.rest - query.rest) * (self.rest - query.rest),
            apart(&self.frequencies, &query.frequencies),
            apart(&self.magnitudes, &query.magnitudes),
        ];
        more.map(|more| (first + more) / (self.variance + query.variance))
    }
}

/// The sides of a query, as it is and with its rows reversed.
fn sides(query: &CoarseQuery) -> Vec<(Few, SegmentShape)> {
    let flips: &[bool] = if query.topology() == Shaped::Disc { &[false] } else { &[false, true] };
    let both = |(spectrum, shape): (&Spectrum, SegmentShape)| -> Vec<(Few, SegmentShape)> {
        flips.iter().map(|&v| (Few::of_query(&spectrum.turned(Flip { u: false, v })), shape)).collect()
    };
    query.spectra().flat_map(both).collect()
}

struct Known {
    row: Row,
    facts: RowFacts,
    few: Few,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [store, inputs @ ..] = &words[..] else {
        eprintln!("expected STORE INPUT…");
        return;
    };
    let engine: Arc<dyn Engine> = Arc::new(KernelEngine::default());
    let (corpus, _) = StoredCorpus::open(Path::new(store), &OpenOptions::default()).expect("a store");
    let catalogue = Catalogue::new(Arc::new(corpus), Arc::clone(&engine));
    catalogue.load();
    let snapshot = catalogue.snapshot();
    let rows = |topology| -> Vec<Known> {
        let Some(blocks) = snapshot.row_blocks(topology, Stock::Wholes) else { return Vec::new() };
        let rows = blocks.chunks().iter().flat_map(|chunk| (0..16).filter_map(|lane| chunk.row(lane)));
        rows.map(|(row, resident)| {
            let facts = RowFacts::of(&row, resident.facts.shape());
            Known { few: Few::of_row(&row), row: row.clone(), facts }
        })
        .collect()
    };
    let discs = rows(Topology::Disc);
    println!("{} discs", discs.len());
    println!("| input | corpus | kept | {} |", BOUNDS.map(|name| format!("{name}: left, %")).join(" | "));
    println!("|---|---|---|---|---|---|---|");
    let mut sums = vec![[0.0; 4]; SIZES.len() * KEPT.len()];
    let mut asked = 0.0;
    for input in inputs {
        let Some(query) = asked_for(&*engine, input) else {
            eprintln!("{input}: passed over, it is no disc");
            continue;
        };
        asked += 1.0;
        for (table, (size, kept, left)) in sums.iter_mut().zip(measured(&discs, &query)) {
            println!(
                "| {input} | {size} | {kept} | {} |",
                left.map(|share| format!("{:.2}", 100.0 * share)).join(" | ")
            );
            table.iter_mut().zip(left).for_each(|(sum, share)| *sum += share);
        }
    }
    for (sum, (size, kept)) in sums.iter().zip(SIZES.iter().flat_map(|size| KEPT.map(|kept| (size, kept)))) {
        let size = (*size).min(discs.len());
        let mean = sum.map(|sum| format!("{:.2}", 100.0 * sum / asked));
        println!("| mean of {asked} | {size} | {kept} | {} |", mean.join(" | "));
    }
    cost(&discs);
}

fn asked_for(engine: &dyn Engine, input: &str) -> Option<CoarseQuery> {
    let stop = Stop::new(None);
    let model = engine.read(&std::fs::read(input).ok()?, None, &Cut::default(), &stop).ok()?;
    let encoded = engine.encode(&model, 0, &stop).ok()?;
    let topology = encoded.encoding.facts.topology;
    if topology == Topology::Disc { engine.coarse_query(&encoded.encoding, topology).ok() } else { None }
}

/// For each size and number kept what each bound leaves, as a share.
fn measured(all: &[Known], query: &CoarseQuery) -> Vec<(usize, usize, [f64; 4])> {
    let sides = sides(query);
    let judged: Vec<(f64, [f64; 4])> = all
        .iter()
        .filter_map(|known| {
            let exact = query.translation(&known.row, known.facts.shape, RELEVANCE)?.score;
            let mut least = [f64::INFINITY; 4];
            for (few, shape) in &sides {
                let costs = known.few.costs(few);
                for (least, cost) in least.iter_mut().zip(costs) {
                    *least = least.min(score(cost, known.facts.shape, *shape, RELEVANCE));
                }
            }
            assert!(
                least.iter().all(|bound| *bound <= exact * (1.0 + 1e-9) + 1e-12),
                "{least:?} are no bounds of {exact}"
            );
            Some((exact, least))
        })
        .collect();
    let mut measured = Vec::new();
    for size in SIZES.map(|size| size.min(judged.len())) {
        // Every so-manieth, so that all families are in each.
        let some: Vec<_> = (0..size).map(|k| judged[k * judged.len() / size]).collect();
        let mut scores: Vec<f64> = some.iter().map(|(exact, _)| *exact).collect();
        scores.sort_by(f64::total_cmp);
        for kept in KEPT {
            let limit = scores[kept.min(size) - 1];
            let left =
                |bound: usize| some.iter().filter(|(_, bounds)| bounds[bound] <= limit).count() as f64 / size as f64;
            measured.push((size, kept, std::array::from_fn(left)));
        }
    }
    measured
}

/// Prints the time of a pass over the means on one thread, as 16-bit integers of 64 bytes a segment.
fn cost(all: &[Known]) {
    let codes: Vec<[i16; SIDE]> =
        (0..1_000_000).map(|k| std::array::from_fn(|row| all[k % all.len()].row.codes[row])).collect();
    let query: [f32; SIDE] = std::array::from_fn(|row| f32::from(codes[0][row]));
    for _ in 0..3 {
        let begun = Instant::now();
        let apart = |means: &[i16; SIDE]| -> f32 {
            means.iter().zip(&query).map(|(a, b)| (f32::from(*a) - b) * (f32::from(*a) - b)).sum()
        };
        let least = codes.iter().map(apart).filter(|apart| *apart > 0.0).fold(f32::INFINITY, f32::min);
        println!(
            "means of 10⁶ segments: {:.1} ms on one thread (least {least:.0})",
            begun.elapsed().as_secs_f64() * 1e3
        );
    }
}
