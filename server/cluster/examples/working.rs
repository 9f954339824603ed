//! What sharing work gains: adds a second with one, two and three servers, where encoding has a cost of its own.
//!
//! `cargo run -p quadmuse-cluster --example working -- COUNT MS`: COUNT jobs on three nodes of a real engine, done by servers of
//! one thread each, which wait MS milliseconds in place of encoding, add a small example, and say that the job is done. The
//! machine's cores are so not what binds: the queue and the corpus are. Needs `nats-server`.

#[path = "../tests/support/nodes.rs"]
mod nodes;
#[path = "../../store/tests/support/sample.rs"]
mod sample;

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quadmuse_cluster::{ClusterOptions, JetStream, SharedCorpus, SharedOptions};
use quadmuse_store::Backend;
use sample::{Sample, segment_of};

/// Longest wait for a job.
const WAIT: Duration = Duration::from_millis(500);

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1).map(|word| word.parse::<u64>());
    let (count, cost) = (words.next().unwrap_or(Ok(60))?, Duration::from_millis(words.next().unwrap_or(Ok(250))?));
    let Some(nodes) = nodes::Nodes::start(3) else { return Ok(()) };
    let dir = tempfile::tempdir()?;
    let mut alone = None;
    for servers in 1..=3u64 {
        let join = |number: u64| -> Result<SharedCorpus, Box<dyn Error>> {
            let options = ClusterOptions::new(&nodes.addresses(), &format!("working-{servers}"));
            let cache = dir.path().join(format!("{servers}-{number}"));
            Ok(SharedCorpus::open(Arc::new(JetStream::connect(&options)?), &SharedOptions::caching_in(&cache))?)
        };
        let joined = (0..servers).map(join).collect::<Result<Vec<_>, _>>()?;
        for number in 0..count {
            joined[0].add_job("v1", &number.to_string(), &number.to_le_bytes())?;
        }
        let begun = Instant::now();
        let each: Vec<(u64, Duration)> = std::thread::scope(|scope| {
            let all: Vec<_> = joined.iter().map(|server| scope.spawn(|| work(server, cost, begun))).collect();
            all.into_iter().filter_map(|one| one.join().ok()).collect()
        });
        let done: u64 = each.iter().map(|(done, _)| done).sum();
        let took = each.iter().map(|(_, last)| last.as_secs_f64()).fold(0.0, f64::max);
        let rate = done as f64 / took;
        let alone = *alone.get_or_insert(rate);
        let (examples, left) = (joined[0].snapshot().examples.len(), joined[0].jobs()?);
        println!(
            "{servers} servers: {done} jobs of {} ms in {took:.1} s, {rate:.2} a second, {:.2} of {servers} times one; {examples} examples, {left} jobs left",
            cost.as_millis(),
            rate / alone / servers as f64
        );
    }
    Ok(())
}

/// Does jobs until there are none; how many, and when the last was done.
fn work(server: &SharedCorpus, cost: Duration, begun: Instant) -> (u64, Duration) {
    let encoding = segment_of(1, &[32], 4);
    let (mut done, mut last) = (0, Duration::ZERO);
    loop {
        let Ok(Some(job)) = server.take_job("v1", WAIT) else {
            // At first nobody may lead the takers yet.
            if server.jobs().is_ok_and(|left| left == 0) {
                return (done, last);
            }
            continue;
        };
        std::thread::sleep(cost);
        let mut sample = Sample::with(1, vec![encoding.clone()]);
        sample.mesh = job.payload().to_vec();
        if server.add(&sample.example(), &[]).is_ok() && job.done().is_ok() {
            (done, last) = (done + 1, begun.elapsed());
        }
    }
}
