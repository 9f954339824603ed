//! A soak: the service at full load for half an hour, with memory, latency and errors as a table and a picture.
//!
//! `soak [--minutes 30] [--interval 10] [--clients 4] [--watchers 200] [--side 60] [--out DIR]` writes `soak.csv` and `soak.svg`.
//! Clients send queries one after the other, watchers poll and stream, somebody drags a point, examples come and go.

use quadmuse_tests::{
    bounds::{self, BoundsError},
    load,
    scale::{ScaleError, process},
    shapes::{self, Faces},
    soak::{self, Plan, picture},
};
use std::{path::PathBuf, process::ExitCode, time::Duration};

/// What the command line asks for.
struct Options {
    plan: Plan,
    side: u32,
    out: PathBuf,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
enum SoakError {
    #[error(transparent)]
    Bounds(#[from] BoundsError),
    #[error(transparent)]
    Scale(#[from] ScaleError),
    #[error("expected files, found that the system refuses: {0}")]
    Io(#[from] std::io::Error),
}

fn options() -> Result<Options, String> {
    let (minutes, interval) = (|n: u64| Duration::from_secs(60 * n), Duration::from_secs);
    let plan = Plan { time: minutes(30), interval: interval(10), clients: 4, watchers: 200 };
    let mut options = Options { plan, side: 60, out: ".".into() };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("expected a value after {word}"))?;
        let number = || value.parse::<u32>().map_err(|_| format!("expected a number after {word}, found `{value}`"));
        match word.as_str() {
            "--minutes" => options.plan.time = minutes(number()?.into()),
            "--interval" => options.plan.interval = interval(number()?.max(1).into()),
            "--clients" => options.plan.clients = number()? as usize,
            "--watchers" => options.plan.watchers = number()? as usize,
            "--side" => options.side = number()?,
            "--out" => options.out = value.into(),
            other => {
                let known = "--minutes, --interval, --clients, --watchers, --side or --out";
                return Err(format!("expected {known}, found `{other}`"));
            }
        }
    }
    Ok(options)
}

fn main() -> ExitCode {
    match options().and_then(|options| run(&options).map_err(|error| error.to_string())) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), SoakError> {
    let folder = tempfile::tempdir()?;
    let data = folder.path().join("data");
    bounds::corpus(folder.path(), &data)?;
    let mesh = shapes::head(9, options.side, Faces::Triangles).into_bytes();
    println!("load {}; a head of {} triangles", process::load(), 2 * options.side * options.side);
    let mut server = load::server(&data)?;
    let rows = soak::measure(&server, &mesh, options.plan, &mut |row| {
        let ([_, p99, _], [_, edit]) = (row.health_ms, row.edit_ms);
        println!(
            "{:.0} s: {:.0} MiB, health p99 {p99:.1} ms, edit p95 {edit:.1} ms, {} queries, {} errors",
            row.at_s, row.resident_mib, row.ended, row.errors
        );
    })?;
    std::fs::create_dir_all(&options.out)?;
    std::fs::write(options.out.join("soak.csv"), soak::csv(&rows))?;
    std::fs::write(options.out.join("soak.svg"), picture::svg(&rows))?;
    let [_, peak] = process::resident(server.id());
    let (queries, errors): (usize, usize) =
        rows.iter().fold((0, 0), |sum, row| (sum.0 + row.ended, sum.1 + row.errors));
    let lives = if server.is_alive() { "lives" } else { "has ended" };
    println!("{queries} queries, {errors} errors, {} MiB at most; the server {lives}", peak >> 20);
    println!("load at the end {}", process::load());
    Ok(())
}
