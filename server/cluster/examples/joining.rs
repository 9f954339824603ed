//! What sharing costs: adding many small examples to a corpus on three nodes of a real engine, and joining it afterwards.
//!
//! `cargo run --release -p quadmuse-cluster --example joining -- COUNT`: COUNT examples of one segment, each with a row of
//! 2,132 bytes as a search keeps it and a small encoding; the same in a store on disk beside it. Needs `nats-server`.

#[path = "../tests/support/nodes.rs"]
mod nodes;
#[path = "../../store/tests/support/sample.rs"]
mod sample;

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quadmuse_cluster::{ClusterOptions, JetStream, SharedCorpus, SharedOptions};
use quadmuse_store::{Backend, Store};
use sample::{Sample, segment_of};

/// Length of a row, in bytes.
const ROW_BYTES: usize = 2132;
/// Writers at a time, as a server has threads that encode.
const WRITERS: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let count: u64 = std::env::args().nth(1).map_or(Ok(1000), |count| count.parse())?;
    let Some(nodes) = nodes::Nodes::start(3) else { return Ok(()) };
    let dir = tempfile::tempdir()?;
    let (store, _) = Store::open(&dir.path().join("store"), &sample::options())?;
    let local: Arc<dyn Backend> = Arc::new(store);
    let shared = join(&nodes, &dir)?;
    let encoding = segment_of(1, &[32], 4);
    for (name, backend) in [("store", &local), ("three nodes", &(shared.clone() as Arc<dyn Backend>))] {
        let took = add(&**backend, count, &encoding)?;
        println!(
            "{name}: {count} adds in {:.1} s, {:.2} ms each",
            took.as_secs_f64(),
            took.as_secs_f64() * 1e3 / count as f64
        );
    }
    let begun = Instant::now();
    let joined = join(&nodes, &dir)?;
    let (examples, in_s) = (joined.snapshot().examples.len(), begun.elapsed().as_secs_f64());
    let rows = joined.rows().len();
    println!("joined in {in_s:.1} s: {examples} examples, {rows} rows; resident {} MiB", resident_mib());
    Ok(())
}

fn join(nodes: &nodes::Nodes, dir: &tempfile::TempDir) -> Result<Arc<SharedCorpus>, Box<dyn Error>> {
    let engine = JetStream::connect(&ClusterOptions::new(&nodes.addresses(), "joining"))?;
    let cache = dir.path().join("cache");
    Ok(Arc::new(SharedCorpus::open(Arc::new(engine), &SharedOptions::caching_in(&cache))?))
}

/// Adds examples by several writers; how long it took.
fn add(to: &dyn Backend, count: u64, encoding: &quadmuse_store::DerivedSegment) -> Result<Duration, Box<dyn Error>> {
    let begun = Instant::now();
    let writer = |first: u64| {
        for seed in (first..count).step_by(WRITERS) {
            let mut sample = Sample::with(1, vec![encoding.clone()]);
            sample.mesh = format!("# {seed}\n").into_bytes();
            to.add(&sample.example(), &[vec![seed as u8; ROW_BYTES]]).map_err(|error| error.to_string())?;
        }
        Ok::<_, String>(())
    };
    std::thread::scope(|scope| {
        let writers: Vec<_> = (0..WRITERS as u64).map(|first| scope.spawn(move || writer(first))).collect();
        writers.into_iter().try_for_each(|writer| writer.join().map_err(|_| "a writer panicked".to_owned())?)
    })?;
    Ok(begun.elapsed())
}

/// What this process has in memory, in MiB.
fn resident_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok()).unwrap_or(0) / 1024
}
