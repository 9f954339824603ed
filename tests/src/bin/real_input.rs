//! Runs the whole path on real meshes, judges it from outside, and fails if a claim doesn't hold.
//!
//! `real_input [--subset] [--record] [--keep DIR]`; the meshes stand at `../shared` or `QUADMUSE_SHARED`.

use quadmuse_tests::{
    client::Client,
    judge::Judge,
    real_input::{Extent, RunError, claims, corpus, pairs, record, scans, table},
    server::Server,
    tool,
};
use std::{
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

/// What the command line asks for.
struct Options {
    extent: Extent,
    record: bool,
    keep: Option<PathBuf>,
}

fn options() -> Result<Options, String> {
    let mut options = Options { extent: Extent::All, record: false, keep: None };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match (word.as_str(), &mut options) {
            ("--subset", options) => options.extent = Extent::Subset,
            ("--record", options) => options.record = true,
            ("--keep", options) => options.keep = Some(words.next().ok_or("expected a folder after --keep")?.into()),
            (other, _) => return Err(format!("expected --subset, --record or --keep DIR, found `{other}`")),
        }
    }
    Ok(options)
}

fn main() -> ExitCode {
    const WHAT: &str = "the run on real meshes";
    tool::run(options(), WHAT, |options, shared| {
        let Some(judge) = Judge::find_or_say(shared, WHAT) else { return Ok(ExitCode::SUCCESS) };
        let broken = run(options, shared, &judge)?;
        if broken.is_empty() {
            println!("every claim holds");
            return Ok(ExitCode::SUCCESS);
        }
        println!("{} claims don't hold:\n- {}", broken.len(), broken.join("\n- "));
        Ok::<_, RunError>(ExitCode::FAILURE)
    })
}

/// Runs everything, prints the tables; answers with the claims that don't hold.
fn run(options: &Options, shared: &Path, judge: &Judge) -> Result<Vec<String>, RunError> {
    let begun = Instant::now();
    let at = |path: &Path| {
        let path = path.to_owned();
        move |source| RunError::File { path, source }
    };
    let work = tempfile::tempdir().map_err(at(Path::new("a temporary folder")))?;
    let out = options.keep.clone().unwrap_or_else(|| work.path().join("out"));
    std::fs::create_dir_all(&out).map_err(at(&out))?;
    let server = Server::start(&work.path().join("data"))?;
    let client = Client::new(server.url());

    let wanted = pairs::pairs(shared, options.extent)?;
    let filling = Instant::now();
    let corpus = corpus::fill(&client, shared, &wanted, options.extent)?;
    let filled = format!("{} examples added in {:.1} s", corpus.ids.len(), filling.elapsed().as_secs_f64());
    eprintln!("{filled}");
    let refused: Vec<String> =
        corpus.refused.iter().map(|(file, why)| format!("{file}: expected to be added, found: {why}")).collect();

    let judged_pairs = pairs::run(&client, judge, &corpus, &wanted, &out);
    let judged_scans = scans::run(&client, judge, shared, options.extent, &out)?;
    let broken: Vec<String> = refused.into_iter().chain(claims::broken(&judged_pairs, &judged_scans)).collect();

    let text = format!(
        "# Real input\n\n{}; {filled}; all of it {:.0} s.\n\n{}\n{}\n{}",
        record::circumstances(),
        begun.elapsed().as_secs_f64(),
        table::pairs(&judged_pairs),
        table::scans(&judged_scans),
        if broken.is_empty() {
            "Every claim holds.\n".to_owned()
        } else {
            format!("Broken claims:\n\n- {}\n", broken.join("\n- "))
        },
    );
    println!("{text}");
    if options.record {
        println!("written to {}", record::write(&text)?.display());
    }
    Ok(broken)
}
