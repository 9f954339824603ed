//! Sends whole bodies, animals and objects through `retopo` against the real corpus, and judges them from outside.
//!
//! `retopo_judged [--only NAME]… [--keep DIR] [--record FILE]`; the meshes stand at `../shared` or `QUADMUSE_SHARED`.
//! Ends with 1 if a result is not sound: quads only, manifold, oriented, of the input's topology, without doublets.

use quadmuse_tests::{
    client::Client,
    judge::Judge,
    real_input::{RunError, record},
    retopo_judged::{
        Bench,
        bodies::{BODIES, Body},
        fill,
        table::{notes, table},
    },
    server::Server,
    tool,
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

/// What the command line asks for.
#[derive(Default)]
struct Options {
    only: Vec<String>,
    keep: Option<PathBuf>,
    record: Option<PathBuf>,
}

fn options() -> Result<Options, String> {
    let mut options = Options::default();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("expected a value after {word}"));
        match word.as_str() {
            "--only" => options.only.push(value()?),
            "--keep" => options.keep = Some(value()?.into()),
            "--record" => options.record = Some(value()?.into()),
            other => return Err(format!("expected --only NAME, --keep DIR or --record FILE, found `{other}`")),
        }
    }
    Ok(options)
}

fn main() -> ExitCode {
    const WHAT: &str = "judged retopo";
    tool::run(options(), WHAT, |options, shared| {
        let Some(judge) = Judge::find_or_say(shared, WHAT) else { return Ok(ExitCode::SUCCESS) };
        let unsound = run(options, shared, &judge)?;
        if unsound == 0 {
            return Ok(ExitCode::SUCCESS);
        }
        println!("{unsound} results are not sound");
        Ok::<_, RunError>(ExitCode::FAILURE)
    })
}

/// Runs everything, prints the table; answers with how many results are not sound.
fn run(options: &Options, shared: &Path, judge: &Judge) -> Result<usize, RunError> {
    let at = |path: &Path| {
        let path = path.to_owned();
        move |source| RunError::File { path, source }
    };
    let work = tempfile::tempdir().map_err(at(Path::new("a temporary folder")))?;
    let out = options.keep.clone().unwrap_or_else(|| work.path().join("out"));
    std::fs::create_dir_all(&out).map_err(at(&out))?;
    let server = Server::start(&work.path().join("data"))?;
    let client = Client::new(server.url());
    let begun = Instant::now();
    let corpus = fill(&client, shared)?;
    let filled = format!("{} examples in {:.0} s", corpus.files.len(), begun.elapsed().as_secs_f64());
    eprintln!("{filled}");
    for (file, why) in &corpus.refused {
        eprintln!("{file}: {why}");
    }
    let mut bench = Bench { server: &server, client, judge, corpus, out: &out, deviation: BTreeMap::new() };
    let wanted = |body: &&Body| options.only.is_empty() || options.only.iter().any(|name| body.file.contains(name));
    let mut judged = Vec::new();
    for body in BODIES.iter().filter(wanted) {
        let one = bench.run(*body, shared)?;
        eprintln!("{}", table(std::slice::from_ref(&one)).lines().last().unwrap_or_default());
        judged.push(one);
    }
    let text = format!("{}; corpus: {filled}.\n\n{}\n{}", record::circumstances(), table(&judged), notes(&judged));
    println!("{text}");
    if let Some(path) = &options.record {
        std::fs::write(path, format!("# Judged retopo\n\n{text}")).map_err(at(path))?;
    }
    let is_unsound = |broken: &Vec<&str>| broken.iter().any(|what| !["distance", "angles"].contains(what));
    Ok(judged.iter().map(|one| one.broken()).filter(is_unsound).count())
}
