//! What a cluster costs at scale: the first ranking through it and scattered over three shares against one server with its
//! own store, the time until a new server is ready, and memory.
//!
//! `cluster_at_scale --corpora DIR [--count 100000] [--times 5] [--pause]`: a corpus of COUNT segments that holds the coarsest level
//! alone is grown in DIR, where it is not, and imported into three nodes of a real engine on loopback. Then one server at a
//! time: on the store; on the cluster; three with a third each. With `--pause` it waits for a line before what is timed, so
//! that the machine can be made quiet. Needs `nats-server`.

#[path = "../../../server/cluster/tests/support/nodes.rs"]
mod nodes;

use nodes::Nodes;
use quadmuse_tests::{
    binaries::program,
    http,
    scale::process,
    server::Server,
    shapes::{self, Faces},
    tool,
};
use serde_json::Value;
use std::{
    error::Error,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    time::{Duration, Instant},
};

/// By then the allocator has given back what is free.
const SETTLES_AFTER: Duration = Duration::from_secs(20);
/// Longest time for a query.
const ENDS_WITHIN: Duration = Duration::from_secs(120);

fn main() -> ExitCode {
    let Some(corpora) = tool::word("--corpora").map(PathBuf::from) else {
        eprintln!("expected --corpora DIR");
        return ExitCode::FAILURE;
    };
    tool::ended(run(&corpora, tool::number("--count", 100_000), tool::number("--times", 5)).map(|()| true))
}

fn command(words: &[&str], path: &Path) -> Result<Duration, Box<dyn Error>> {
    let begun = Instant::now();
    let status =
        Command::new(program("quadmuse-server")?).args(words).arg(path).stdout(std::process::Stdio::null()).status()?;
    if status.success() { Ok(begun.elapsed()) } else { Err(format!("{words:?} ended with {status}").into()) }
}

fn run(corpora: &Path, count: usize, times: usize) -> Result<(), Box<dyn Error>> {
    let Some(nodes) = Nodes::start(3) else { return Ok(()) };
    let (dir, store) = (tempfile::tempdir()?, corpora.join(format!("coarse-{count}")));
    let count_word = count.to_string();
    command(&["bench-corpus", "--count", &count_word, "--warped", "32", "--finest", "32", "--data"], &store)?;
    let engine = nodes.addresses();
    let imported = command(&["cluster", "import", "--bucket", "studio", "--cluster", &engine, "--data"], &store)?;
    println!("{count} segments; imported in {:.0} s; load {}", imported.as_secs_f64(), process::load());
    if std::env::args().any(|word| word == "--pause") {
        std::io::stdin().read_line(&mut String::new())?;
    }
    let cluster = format!("QUADMUSE_CLUSTER={engine}");
    let start = |name: &str, more: &[&str]| -> Result<Server, Box<dyn Error>> {
        let words: Vec<&str> = ["env", "QUADMUSE_LOG=error"].iter().chain(more).copied().collect();
        let data = if more.is_empty() { store.clone() } else { dir.path().join(name.replace('/', "-")) };
        let begun = Instant::now();
        let server = Server::start_under(&words, &data)?;
        let (ready, [most, _]) = (begun.elapsed().as_secs_f64(), process::resident(server.id()));
        // The allocator gives back after a while what was needed for loading alone.
        std::thread::sleep(SETTLES_AFTER);
        let [settled, _] = process::resident(server.id());
        println!(
            "{name}: ready after {ready:.1} s, {} MiB resident then, {} MiB after {} s; load {}",
            most >> 20,
            settled >> 20,
            SETTLES_AFTER.as_secs(),
            process::load()
        );
        Ok(server)
    };
    let scan = shapes::head(1, 24, Faces::Triangles);
    let share = |number: usize| format!("QUADMUSE_SHARD={number}/3");
    let (mut local, mut whole, mut scattered) = (Vec::new(), Vec::new(), Vec::new());
    // Each alone with the machine.
    let mut one = start("own store", &[])?;
    (0..times).try_for_each(|_| timed(&one, &scan).map(|time| local.push(time)))?;
    one.terminate(ENDS_WITHIN)?;
    let mut one = start("cluster", &[&cluster, "QUADMUSE_BUCKET=studio"])?;
    (0..times).try_for_each(|_| timed(&one, &scan).map(|time| whole.push(time)))?;
    one.terminate(ENDS_WITHIN)?;
    let mut shares = Vec::new();
    for number in 1..=3 {
        shares.push(start(&format!("share {number}/3"), &[&cluster, "QUADMUSE_BUCKET=studio", &share(number)])?);
    }
    for turn in 0..times {
        scattered.push(timed(&shares[turn % 3], &scan)?);
    }
    println!(
        "| first ranking | coarse level, ms: least, median | upload to first ranking, ms: least, median | ratio of the least |"
    );
    println!("|---|---|---|---|");
    for (name, all) in [("own store", &local), ("cluster", &whole), ("three shares", &scattered)] {
        let of = |pick: fn(&[f64; 2]) -> f64| {
            let mut all: Vec<f64> = all.iter().map(pick).collect();
            all.sort_by(f64::total_cmp);
            (all[0], all[all.len() / 2])
        };
        let (coarse, first) = (of(|t| t[0]), of(|t| t[1]));
        let least = |all: &[[f64; 2]], at: usize| all.iter().map(|t| t[at]).fold(f64::INFINITY, f64::min);
        println!(
            "| {name} | {:.0}, {:.0} | {:.0}, {:.0} | {:.2} of the coarse level, {:.2} in all |",
            coarse.0,
            coarse.1,
            first.0,
            first.1,
            coarse.0 / least(&local, 0),
            first.0 / least(&local, 1)
        );
    }
    println!("load at the end {}", process::load());
    Ok(())
}

/// A query at the coarsest level: the milliseconds of that level, and from the upload to the first ranking.
fn timed(server: &Server, scan: &str) -> Result<[f64; 2], Box<dyn Error>> {
    let posted = http::post(server.address(), "/v1/queries?resolution=32", "model/obj", scan.as_bytes())?;
    let path = posted.header("location").ok_or_else(|| posted.text())?.to_owned();
    let begun = Instant::now();
    while begun.elapsed() < ENDS_WITHIN {
        let query: Value = serde_json::from_slice(&http::get(server.address(), &path)?.body)?;
        if query["state"] == "done" {
            if query.get("incomplete").is_some() {
                return Err(format!("incomplete: {query}").into());
            }
            let timings = &query["timings"];
            let numbers = [&timings["levels"][0]["ms"], &timings["first_ranking_ms"]].map(Value::as_f64);
            let [Some(coarse), Some(first)] = numbers else { return Err(format!("no timings: {query}").into()) };
            return Ok([coarse, first]);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Err("no end of a query".into())
}
