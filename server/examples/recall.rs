//! Question: how many of the best ten of an exhaustive ranking, every segment registered to the last level, are among the
//! best ten of a search with defaults?
//!
//! `cargo run --release -p quadmuse-server --example recall -- STORE INPUT…`; the store is one of `bench-corpus` or a
//! server's own, which must not run. A near-duplicate of a better entry counts as found with that one, since both are
//! one choice. Told are also the places of those that were missed, and whether the best is the same.

use futures_util::{StreamExt, stream};
use quadmuse_proto::{ExampleId, QueryState};
use quadmuse_server::pool::{Admission, Lane, Pool, Stop};
use quadmuse_server::work::catalogue::{Resident, Stock};
use quadmuse_server::work::corpus::stored::StoredCorpus;
use quadmuse_server::work::engine::Cut;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::ingest::Upload;
use quadmuse_server::work::query::{LiveQuery, QueryOptions};
use quadmuse_server::work::ranking::levels_up_to;
use quadmuse_server::work::{Caller, Work, search};
use quadmuse_store::OpenOptions;
use std::path::Path;
use std::sync::Arc;

/// Entries looked at.
const WANTED: usize = 10;
/// Defaults of a query.
const TOP: u32 = 4;
const RESOLUTION: u32 = 128;
const THREADS: usize = 2;

type Key = (ExampleId, u32);

/// E′ of a segment registered to the last level; NaN where that fails.
fn exhaustive(work: &Work, live: &LiveQuery, resident: &Resident, stop: &Stop) -> f64 {
    let query = &live.encoded[0].get().expect("an encoded segment").encoding;
    let encoding = |level| work.catalogue.encoding(resident.example.id, resident.segment, level).ok();
    let mut levels = levels_up_to(RESOLUTION);
    let first = levels.next().and_then(encoding).and_then(|example| work.engine.coarse(&example, query, stop).ok());
    let last = levels.try_fold(first, |from, level| {
        let refined = work.engine.refine(from.as_ref()?, &encoding(level)?, query, stop).ok()?;
        Some(Some(refined))
    });
    let score = |r| work.engine.score(&r, &resident.facts, query, resident.example.relevance);
    last.flatten().map_or(f64::NAN, score)
}

async fn one(work: &Arc<Work>, input: &str) {
    let upload = Upload { bytes: std::fs::read(input).expect("an input").into(), format: None, cut: Cut::default() };
    let options = QueryOptions { top: TOP, resolution: RESOLUTION, deadline: None, tags: Vec::new(), like: None };
    let live = search::start(work, Caller::default(), upload, options).await.expect("a query");
    let board = live.wait_for(|_| false).await;
    assert_eq!(board.state, QueryState::Done);
    let ranking = &board.rankings[0];
    let leader = |c: &quadmuse_server::work::ranking::Candidate| c.similar_to.unwrap_or_else(|| c.key());
    let snapshot = work.catalogue.snapshot();
    let topology = live.model.segments[0].topology;
    let chunks = snapshot.row_blocks(topology, Stock::Wholes).expect("segments of this topology").chunks().iter();
    let residents: Vec<Arc<Resident>> = chunks.flat_map(|chunk| chunk.residents().iter().flatten().cloned()).collect();
    let scored = residents.iter().map(|resident| {
        let (this, query, resident) = (Arc::clone(work), Arc::clone(&live), Arc::clone(resident));
        let quantum =
            move |stop: &Stop| (exhaustive(&this, &query, &resident, stop), (resident.example.id, resident.segment));
        work.pool.run(&live.job, Lane::Fine, quantum)
    });
    let mut all: Vec<(f64, Key)> =
        stream::iter(scored).buffered(4 * THREADS).map(|r| r.expect("registered")).collect().await;
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    // One choice each: the leaders of the best, in their order.
    let choice = |key: Key| ranking.candidates.iter().find(|c| c.key() == key).map_or(key, leader);
    let mut choices: Vec<Key> = Vec::new();
    for (_, key) in &all {
        let choice = choice(*key);
        if choices.len() < WANTED && !choices.contains(&choice) {
            choices.push(choice);
        }
    }
    let listed: Vec<Key> = ranking.candidates.iter().filter(|c| c.similar_to.is_none()).map(|c| c.key()).collect();
    let places = choices.iter().map(|key| listed.iter().position(|other| other == key));
    let places: Vec<usize> = places.map(|place| place.map_or(usize::MAX, |p| p + 1)).collect();
    let found = places.iter().filter(|place| **place <= WANTED).count();
    let missed: Vec<String> = (1..)
        .zip(&places)
        .filter(|(_, place)| **place > WANTED)
        .map(
            |(rank, place)| {
                if *place == usize::MAX { format!("{rank} → not listed") } else { format!("{rank} → {place}") }
            },
        )
        .collect();
    let four =
        choices.iter().take(TOP as usize).filter(|key| listed.iter().take(TOP as usize).any(|k| k == *key)).count();
    let name = Path::new(input).file_stem().unwrap_or_default().to_string_lossy();
    println!(
        "| {name} | {} | {found} of {} | {four} of {TOP} | {} |",
        residents.len(),
        choices.len(),
        missed.join(", ")
    );
}

#[tokio::main]
async fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some((store, inputs)) = words.split_first() else {
        eprintln!("expected STORE INPUT…");
        return;
    };
    let pool = Pool::new(THREADS, Admission::new(4 << 30, 64)).expect("threads");
    let (corpus, _) = StoredCorpus::open(Path::new(store), &OpenOptions::default()).expect("a store");
    let work = Work::new(pool, Arc::new(KernelEngine::default()), Arc::new(corpus));
    work.load();
    println!(
        "| input | segments | best {WANTED} found | best {TOP} found | missed: exhaustive place → its place |\n|---|---|---|---|---|"
    );
    for input in inputs {
        one(&work, input).await;
    }
}
