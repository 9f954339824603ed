//! The service under load, as rows of a table: a crowd that watches, a flood at ten times capacity, one user beside another, edits,
//! users who want its memory.
//!
//! `load [--what crowd,flood,fair,edit,siege] [--seconds 20] [--watchers 1000] [--clients 16] [--side 90] [--drawn 100]`. Everything is
//! made by code; `--side` is that of the head that is asked for, `--drawn` of the example whose map is edited, in cells.

use quadmuse_tests::{
    bounds::{self, BoundsError},
    load::{self, crowd, fairness, flood, siege},
    scale::{ScaleError, process},
    server::Server,
    shapes::{self, Faces},
};
use std::{path::Path, process::ExitCode, time::Duration};

/// Clients with which the service does all it can.
const PEAK_CLIENTS: usize = 4;
/// How much more than its capacity a flood asks for.
const FLOOD: usize = 10;
/// Queries of one user that wait beside another's.
const WAITING: usize = 100;
/// Users who want the memory of a server that may have so many bytes, all for the same and each for another thing.
const USERS: usize = 8;
const LIMIT_BYTES: u64 = 256 << 20;
/// Edits timed.
const EDITS: usize = 60;

/// What the command line asks for.
struct Options {
    what: String,
    seconds: u64,
    watchers: usize,
    clients: usize,
    side: u32,
    drawn: u32,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
enum LoadError {
    #[error(transparent)]
    Bounds(#[from] BoundsError),
    #[error(transparent)]
    Scale(#[from] ScaleError),
    #[error("expected files and threads, found that the system refuses: {0}")]
    Io(#[from] std::io::Error),
}

fn options() -> Result<Options, String> {
    let mut options = Options {
        what: "crowd,flood,fair,edit".into(),
        seconds: 20,
        watchers: 1000,
        clients: 16,
        side: 90,
        drawn: 100,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("expected a value after {word}"))?;
        let number = || value.parse::<u32>().map_err(|_| format!("expected a number after {word}, found `{value}`"));
        match word.as_str() {
            "--what" => options.what = value,
            "--seconds" => options.seconds = number()?.into(),
            "--watchers" => options.watchers = number()? as usize,
            "--clients" => options.clients = number()? as usize,
            "--side" => options.side = number()?,
            "--drawn" => options.drawn = number()?,
            other => {
                return Err(format!(
                    "expected --what, --seconds, --watchers, --clients, --side or --drawn, found `{other}`"
                ));
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

fn run(options: &Options) -> Result<(), LoadError> {
    let folder = tempfile::tempdir()?;
    let data = folder.path().join("data");
    bounds::corpus(folder.path(), &data)?;
    let mesh = shapes::head(9, options.side, Faces::Triangles).into_bytes();
    println!("load {}; a head of {} triangles", process::load(), 2 * options.side * options.side);
    let asked = |what: &str| options.what.split(',').any(|word| word == what);
    let time = Duration::from_secs(options.seconds);
    if asked("crowd") {
        let server = load::server(&data)?;
        print_crowd(
            &crowd::measure(&server, &mesh, [options.watchers, options.watchers, options.clients], time)?,
            &server,
        );
    }
    if asked("flood") {
        let server = load::server(&data)?;
        let peak = flood::measure(&server, &mesh, PEAK_CLIENTS, time)?;
        let flood = flood::measure(&server, &mesh, FLOOD * PEAK_CLIENTS, time)?;
        println!("{PEAK_CLIENTS} clients: {:.2} queries/s, {:?} in windows of 5 s", peak.per_second(), peak.windows);
        println!("{} clients: {:.2}/s, {:?}", FLOOD * PEAK_CLIENTS, flood.per_second(), flood.windows);
        println!("  goodput {:.0} % of peak", 100.0 * flood.per_second() / peak.per_second());
        println!("  refusals: {}; {} without Retry-After", flood.did.refused.summary(), flood.did.silent);
        println!("  {} errors", flood.did.errors);
    }
    if asked("edit") {
        let server = load::server(&data)?;
        let drawn = shapes::head(9, options.drawn, Faces::Quads);
        let ([alone, loaded], faces) = fairness::edits(&server, [&mesh, drawn.as_bytes()], options.clients, EDITS)?;
        println!("edits of a map of {faces} faces: alone {}", alone.summary());
        println!("  beside {} clients: {}", options.clients, loaded.summary());
    }
    if asked("fair") {
        fair(&data, &mesh)?;
    }
    if asked("siege") {
        for way in siege::Way::ALL.map(Some).into_iter().chain([None]) {
            let siege = siege::measure(&data, LIMIT_BYTES, USERS, way, time)?;
            print_siege(&way.map_or("all of it".into(), |way| format!("{way:?}")), &siege);
        }
    }
    println!("load at the end {}", process::load());
    Ok(())
}

fn print_siege(what: &str, siege: &siege::Siege) {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    println!(
        "siege by {USERS} users, {what}: {:.0} MiB at most, {:.0} MiB 20 s later",
        mib(siege.most),
        mib(siege.after)
    );
    println!("  health: {}; {} not answered; lives: {}", siege.health.summary(), siege.unwell, siege.lives);
    let counts: Vec<String> = siege.answers.iter().map(|((way, status), n)| format!("{way} {n} × {status}")).collect();
    println!("  {}", counts.join(", "));
}

fn print_crowd(crowd: &crowd::Crowd, server: &Server) {
    println!("health: {}", crowd.health.summary());
    println!(
        "  polls: {} answered, {} not; streams: {} with their end, {} without",
        crowd.polls[0], crowd.polls[1], crowd.streams[0], crowd.streams[1]
    );
    let did = &crowd.did;
    println!("  saturated: {} queries ended, {} refused, {} errors", did.ended.len(), did.refused.0.len(), did.errors);
    let [_, peak] = process::resident(server.id());
    println!("  {:.0} MiB at most", peak as f64 / f64::from(1 << 20));
}

fn fair(data: &Path, mesh: &[u8]) -> Result<(), LoadError> {
    let tokens = [fairness::token(data, "flooder")?, fairness::token(data, "other")?];
    let server = load::server(data)?;
    let ([alone, beside], taken) =
        fairness::first_levels(&server, mesh, tokens.each_ref().map(String::as_str), WAITING)?;
    println!("first ranking of a user alone: {}", alone.summary());
    println!("  beside another with {WAITING} queries ({taken} taken): {}", beside.summary());
    println!("  median × {:.2}", beside.share(0.5) / alone.share(0.5));
    Ok(())
}
