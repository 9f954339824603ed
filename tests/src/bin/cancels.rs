//! How long the service computes on after queries, maps, compositions and retopologies of scans are cancelled at random moments.
//!
//! `cancels [--times 25] [--what query,map,composition,retopo] FILE…`. Processor time, so that a busy machine changes little. Whatever
//! waited for more than 50 ms is told with what was under way; a server with `RUST_LOG=debug` logs where it was.

use quadmuse_tests::{
    bounds,
    load::{
        self, Caller, Times,
        cancel::{self, Kind},
    },
    scale::process,
    tool,
};
use std::{error::Error, path::PathBuf, process::ExitCode};

/// Waits of more are told one by one, in milliseconds.
const SHOWN_MS: f64 = 50.0;

fn main() -> ExitCode {
    tool::ended(run())
}

fn run() -> Result<bool, Box<dyn Error>> {
    let times: usize = tool::number("--times", 25);
    let what = tool::word("--what").unwrap_or("query,map,composition,retopo".into());
    let files: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).filter(|path| path.is_file()).collect();
    let folder = tempfile::tempdir()?;
    let data = folder.path().join("data");
    bounds::corpus(folder.path(), &data)?;
    let server = load::server(&data)?;
    let caller = Caller { server: &server, token: None };
    println!("load {}\n", process::load());
    println!("| scan | what | whole, s | cancelled | p50 | p95 | p99 | most, ms |\n|---|---|---|---|---|---|---|---|");
    let mut all = Times::default();
    for file in &files {
        let mesh = std::fs::read(file)?;
        let extension = file.extension().unwrap_or_default().to_string_lossy();
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        for kind in Kind::ALL.into_iter().filter(|kind| what.split(',').any(|word| word == kind.name())) {
            let Some(made) = cancel::measure(&caller, kind, (&format!("model/{extension}"), &mesh), times)? else {
                continue;
            };
            let waits = made.times();
            println!("| {name} | {} | {:.1} | {} |", kind.name(), made.whole_ms / 1000.0, row(&waits));
            for held in made.held.iter().filter(|held| held.ms > SHOWN_MS) {
                eprintln!("{name}, {}: {:.0} ms at {:.2}, {}", kind.name(), held.ms, held.at, held.stage);
            }
            all.0.extend(waits.0);
        }
    }
    println!("| all | | | {} |\n\nload at the end {}", row(&all), process::load());
    let log = server.log();
    let late: Vec<&str> = log.lines().filter(|line| line.contains("went on after it was cancelled")).collect();
    late.iter().for_each(|line| eprintln!("{line}"));
    Ok(all.share(0.99) <= SHOWN_MS)
}

fn row(waits: &Times) -> String {
    let [p50, p95, p99, most] = [0.5, 0.95, 0.99, 1.0].map(|share| waits.share(share));
    format!("{} | {p50:.1} | {p95:.1} | {p99:.1} | {most:.1}", waits.0.len())
}
