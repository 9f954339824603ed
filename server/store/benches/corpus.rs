//! Question: how long does it take to add an example durably, to read one level, and to open the store again, and how many bytes does a segment
//! need on disk, with whole pyramids (512²) and as many examples as the argument says? Rival: the same bytes in one file an
//! example, written, synced and renamed.
//!
//! `cargo bench -p quadmuse-store --bench corpus -- 1000`
#![allow(clippy::unwrap_used, reason = "a benchmark")]

use std::fs;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use quadmuse_store::{DerivedSegment, Level, OpenOptions, Store};

#[path = "../tests/support/sample.rs"]
mod sample;
use sample::{Sample, random, segment_of};

const THREADS: u64 = 4;

/// A segment with a picture like λ of a head, with the noise of a real mesh, and its pyramid.
fn segment(seed: u64) -> DerivedSegment {
    let mut segment = segment_of(seed, &[512], 2000);
    let Some(finest) = segment.levels.pop() else { return segment };
    let noise = |i: usize| 1.0 + 0.005 * (random(seed, i as u64) as f32 - 0.5);
    let lambda = finest.lambda.iter().enumerate().map(|(i, value)| value * noise(i)).collect();
    segment.levels = vec![Level { side: 512, lambda }];
    while let Some(last) = segment.levels.last().filter(|level| level.side > 32) {
        let (n, half) = (last.side as usize, last.side as usize / 2);
        let at = |x: usize, y: usize| last.lambda[y * n + x];
        let mean = |i: usize| {
            let (x, y) = (2 * (i % half), 2 * (i / half));
            (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) / 4.0
        };
        let lambda = (0..half * half).map(mean).collect();
        segment.levels.push(Level { side: last.side / 2, lambda });
    }
    segment
}

fn resident_mib() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0 kB");
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap_or(0.0) / 1024.0
}

fn size(dir: &Path) -> u64 {
    let entries = fs::read_dir(dir).into_iter().flatten().flatten();
    entries
        .map(
            |entry| {
                if entry.path().is_dir() {
                    size(&entry.path())
                } else {
                    entry.metadata().map_or(0, |facts| facts.len())
                }
            },
        )
        .sum()
}

fn ms(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

fn main() {
    let count: u64 = std::env::args().find_map(|arg| arg.parse().ok()).unwrap_or(200);
    let dir = tempfile::tempdir().unwrap();
    let pictures: Vec<DerivedSegment> = (0..16).map(segment).collect();
    let sample = |seed: u64| Sample::with(seed, vec![pictures[seed as usize % pictures.len()].clone()]);
    let options = OpenOptions::default();

    let (store, _) = Store::open(dir.path(), &options).unwrap();
    let begun = Instant::now();
    let mut waits: Vec<f64> = std::thread::scope(|scope| {
        let add = |thread: u64| {
            let (store, sample) = (&store, &sample);
            scope.spawn(move || {
                (thread..count)
                    .step_by(THREADS as usize)
                    .map(|seed| {
                        let sample = sample(seed);
                        let begun = Instant::now();
                        store.add(&sample.example()).unwrap();
                        ms(begun)
                    })
                    .collect::<Vec<_>>()
            })
        };
        let threads: Vec<_> = (0..THREADS).map(add).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    let total = ms(begun);
    waits.sort_by(f64::total_cmp);
    let at = |q: f64| waits[((waits.len() - 1) as f64 * q) as usize];
    println!(
        "add, {THREADS} threads: {:.1} ms an example; p50 {:.1}, p99 {:.1} ms; resident {:.0} MiB",
        total / count as f64,
        at(0.5),
        at(0.99),
        resident_mib()
    );
    let stats = store.stats();
    println!(
        "bytes a segment: {}; index on disk {:.2} × that; blobs {}",
        stats.derived_bytes / count,
        stats.index_bytes as f64 / stats.derived_bytes as f64,
        stats.blobs
    );
    drop(store);

    for name in ["first", "second"] {
        let begun = Instant::now();
        let (_store, _) = Store::open(dir.path(), &options).unwrap();
        println!("{name} opening after adding: {:.0} ms", ms(begun));
    }
    let (store, _) = Store::open(dir.path(), &options).unwrap();
    let examples = store.snapshot().examples.clone();
    for side in [32, 128, 512] {
        let begun = Instant::now();
        examples.iter().for_each(|record| drop(store.level(record.id, 0, side).unwrap()));
        println!("read one level of {side}²: {:.3} ms; resident {:.0} MiB", ms(begun) / count as f64, resident_mib());
    }
    let begun = Instant::now();
    examples.iter().for_each(|record| drop(store.coarse(record.id, 0).unwrap()));
    println!("read what a search keeps: {:.3} ms", ms(begun) / count as f64);
    let begun = Instant::now();
    let report = store.check(&mut |_| ()).unwrap();
    println!("check: {:.3} ms an example, {} problems", ms(begun) / count as f64, report.problems.len());
    println!("directory: {:.1} MiB", size(dir.path()) as f64 / (1 << 20) as f64);

    let rival = tempfile::tempdir().unwrap();
    let bytes = vec![7u8; (stats.derived_bytes / count) as usize];
    let begun = Instant::now();
    for i in 0..count.min(100) {
        let temporary = rival.path().join("tmp");
        let mut file = fs::File::create(&temporary).unwrap();
        file.write_all(&bytes).unwrap();
        file.sync_all().unwrap();
        fs::rename(temporary, rival.path().join(i.to_string())).unwrap();
        fs::File::open(rival.path()).unwrap().sync_all().unwrap();
    }
    println!("rival, one file an example, one thread: {:.1} ms", ms(begun) / count.min(100) as f64);
}
