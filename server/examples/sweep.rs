//! Question: how long does the coarse ranking of N segments take, for one query on two threads, and would a bound by
//! Fourier magnitudes before it save anything?
//!
//! The rows of a store (see `quadmuse-server bench-corpus`) are repeated until there are N of them.
//! `cargo run --release -p quadmuse-server --example sweep -- STORE INPUT.obj N`

use quadmuse_kernel::rank::coarse::{Bounds, CoarseQuery, RowFacts, could_be_kept};
use quadmuse_kernel::register::spectra::{Block, LANES, Row, SIDE, VALUES};
use quadmuse_proto::Topology;
use quadmuse_server::pool::Stop;
use quadmuse_server::work::catalogue::{Catalogue, Stock};
use quadmuse_server::work::corpus::stored::StoredCorpus;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::engine::{Cut, Engine};
use quadmuse_server::work::ranking::RANKED_MAX;
use quadmuse_store::OpenOptions;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const THREADS: usize = 2;

struct Lanes {
    block: Block,
    facts: [Option<RowFacts>; LANES],
}

fn resident_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0 kB");
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap_or(0.0) / 1024.0
}

/// Σ_rows Σ_f w_f (|A_f| − |B_f|)²/n³: what no translation can undercut, and what a k-NN index would work on.
fn magnitudes(row: &Row) -> Vec<f64> {
    let value = |k: usize| f64::from(row.codes[k]) * f64::from(row.scale);
    let norm = 1.0 / (SIDE as f64).powi(3);
    let singles = (0..2 * SIDE).map(|k| norm.sqrt() * value(k).abs());
    let pairs = (2 * SIDE..VALUES).step_by(2).map(|k| (2.0 * norm).sqrt() * value(k).hypot(value(k + 1)));
    singles.chain(pairs).collect()
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [store, input, count] = &words[..] else {
        eprintln!("expected STORE INPUT N");
        return;
    };
    let count: usize = count.parse().expect("a number");
    let engine: Arc<dyn Engine> = Arc::new(KernelEngine::default());
    let stop = Stop::new(None);
    let model = engine.read(&std::fs::read(input).expect("an input"), None, &Cut::default(), &stop).expect("a mesh");
    let encoded = engine.encode(&model, 0, &stop).expect("an encoding");
    let begun = Instant::now();
    let query = engine.coarse_query(&encoded.encoding, encoded.encoding.facts.topology).expect("a query");
    println!("preparing the query, rival poles included: {:.1} ms", begun.elapsed().as_secs_f64() * 1e3);

    let begun = Instant::now();
    let (corpus, _) = StoredCorpus::open(Path::new(store), &OpenOptions::default()).expect("a store");
    let opened = begun.elapsed().as_secs_f64();
    let catalogue = Catalogue::new(Arc::new(corpus), Arc::clone(&engine));
    let made = catalogue.load();
    println!(
        "store opened in {opened:.2} s, loaded in {:.2} s, {made} rows made",
        begun.elapsed().as_secs_f64() - opened
    );
    let snapshot = catalogue.snapshot();
    let blocks = snapshot.row_blocks(Topology::Disc, Stock::Wholes).expect("discs");
    let chunks = blocks.chunks().iter();
    let known: Vec<(Row, RowFacts)> = chunks
        .flat_map(|chunk| (0..LANES).filter_map(|lane| chunk.row(lane)))
        .map(|(row, resident)| (row.clone(), RowFacts::of(&row, resident.facts.shape())))
        .collect();
    let before = resident_mib();
    let mut corpus: Vec<Lanes> = Vec::with_capacity(count.div_ceil(LANES));
    for from in (0..count).step_by(LANES) {
        let mut lanes = Lanes { block: Block::default(), facts: [None; LANES] };
        for lane in 0..LANES.min(count - from) {
            // Another order each time round, so that no two blocks are alike.
            let k = (from + lane) * 7919 + (from + lane) / known.len();
            let (row, facts) = &known[k % known.len()];
            lanes.block.put(lane, row);
            lanes.facts[lane] = Some(*facts);
        }
        corpus.push(lanes);
    }
    println!("{count} rows: {:.0} MiB", resident_mib() - before);
    for _ in 0..3 {
        time(&corpus, &query, &known);
    }
    bound(&known, &query);
}

fn time(corpus: &[Lanes], query: &CoarseQuery, known: &[(Row, RowFacts)]) {
    let begun = Instant::now();
    let parts = std::thread::scope(|scope| {
        let sweep = |part: &[Lanes]| -> Vec<Bounds> {
            part.iter().flat_map(|l| query.sweep(&l.block, &l.facts, &[3.0; LANES])).collect()
        };
        let threads: Vec<_> =
            corpus.chunks(corpus.len().div_ceil(THREADS)).map(|p| scope.spawn(move || sweep(p))).collect();
        threads.into_iter().map(|thread| thread.join().expect("swept")).collect::<Vec<_>>()
    });
    let bounds = parts.concat();
    let swept = begun.elapsed().as_secs_f64() * 1e3;
    let places = could_be_kept(&bounds, RANKED_MAX);
    let selected = begun.elapsed().as_secs_f64() * 1e3;
    let exact = places.iter().take(RANKED_MAX).filter_map(|k| {
        let (row, facts) = &known[k % known.len()];
        query.translation(row, facts.shape, 3.0)
    });
    let sum: f64 = exact.map(|t| t.score).sum();
    println!(
        "sweep {swept:.1} ms, selection {:.1} ms ({} could be among the best {RANKED_MAX}), exact {:.1} ms on one thread (sum {sum:.3})",
        selected - swept,
        places.len(),
        begun.elapsed().as_secs_f64() * 1e3 - selected
    );
}

/// How many rows, and how many whole blocks, the bound alone would spare, if the best were known beforehand.
fn bound(known: &[(Row, RowFacts)], query: &CoarseQuery) {
    let mut scores: Vec<f64> =
        known.iter().filter_map(|(row, facts)| Some(query.translation(row, facts.shape, 3.0)?.score)).collect();
    scores.sort_by(f64::total_cmp);
    // The nearest example stands for the query: the bound needs pictures, and a query's are not told.
    let exact = |(row, facts): &(Row, RowFacts)| query.translation(row, facts.shape, 3.0).map_or(f64::MAX, |t| t.score);
    let nearest = known.iter().min_by(|a, b| exact(a).total_cmp(&exact(b))).expect("a row");
    let own = magnitudes(&nearest.0);
    let bounds: Vec<f64> = known
        .iter()
        .map(|(row, facts)| {
            let apart: f64 = magnitudes(row).iter().zip(&own).map(|(a, b)| (a - b) * (a - b)).sum();
            let cost = apart / (row.variance + nearest.0.variance);
            quadmuse_kernel::rank::score(cost, facts.shape, nearest.1.shape, 3.0)
        })
        .collect();
    for kept in [4, RANKED_MAX.min(known.len()) / 4, RANKED_MAX.min(known.len())] {
        let limit = scores[kept - 1];
        let spared = bounds.iter().filter(|b| **b > limit).count();
        let blocks = bounds.chunks(LANES).filter(|b| b.iter().all(|b| *b > limit)).count();
        println!(
            "bound against the best {kept}: spares {:.0} % of rows, {:.0} % of whole blocks",
            100.0 * spared as f64 / bounds.len() as f64,
            100.0 * blocks as f64 / bounds.len().div_ceil(LANES) as f64
        );
    }
}
