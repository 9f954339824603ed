//! The table of search at scale: for each size of corpus the time to each ranking, memory, disk, start, cancelling.
//!
//! `search_at_scale --corpora DIR [--sizes 45,1000,10000,100000] [--times 3] [--sweep]`. Corpora are grown in DIR, where they are
//! not (100,000 segments take some 10 GB and 20 minutes). `--sweep` adds the coarsest level alone at 1,000,000 segments
//! from the rows of the largest. Meshes stand at `../shared` or `QUADMUSE_SHARED`.

use quadmuse_tests::{
    real_input::record,
    scale::{self, ScaleError, process},
    tool, walls,
};
use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

/// Heads with 50,000 and 24,000 triangles.
const INPUTS: [&str; 2] = ["input_mhhead_dev_08__mhhead_dev_04.obj", "input_mhhead_dev_27__mhhead_dev_10.obj"];
/// Segments of the sweep.
const SWEPT: &str = "1000000";

/// What the command line asks for.
struct Options {
    corpora: PathBuf,
    sizes: Vec<usize>,
    times: usize,
    sweep: bool,
}

fn options() -> Result<Options, String> {
    let mut options =
        Options { corpora: PathBuf::new(), sizes: vec![45, 1000, 10_000, 100_000], times: 3, sweep: false };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("expected a value after {word}"));
        match word.as_str() {
            "--corpora" => options.corpora = value()?.into(),
            "--sizes" => {
                let sizes = value()?;
                let sizes: Result<_, _> = sizes.split(',').map(str::parse).collect();
                options.sizes = sizes.map_err(|_| "expected numbers with commas after --sizes".to_owned())?;
            }
            "--times" => options.times = value()?.parse().map_err(|_| "expected a number after --times".to_owned())?,
            "--sweep" => options.sweep = true,
            other => return Err(format!("expected --corpora, --sizes, --times or --sweep, found `{other}`")),
        }
    }
    if options.corpora.as_os_str().is_empty() { Err("expected --corpora DIR".into()) } else { Ok(options) }
}

fn main() -> ExitCode {
    tool::run(options(), "search at scale", |options, shared| run(options, shared).map(|()| ExitCode::SUCCESS))
}

fn run(options: &Options, shared: &Path) -> Result<(), ScaleError> {
    let inputs = INPUTS.map(|name| shared.join("meshes/groundtruth").join(name));
    println!("{}, load {}\n", record::circumstances(), process::load());
    let mut measured = Vec::new();
    let mut largest = None;
    for &count in &options.sizes {
        let data = scale::grown(&options.corpora, count, &shared.join("meshes/quads"))?;
        measured.push(scale::measure(&data, count, &inputs, options.times)?);
        eprintln!("{count} segments measured, load {}", process::load());
        largest = Some(data);
    }
    println!("{}", scale::table(&measured));
    println!("\nload at the end {}", process::load());
    if let Some(data) = largest.filter(|_| options.sweep) {
        let status = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
            .current_dir(walls::tree::root())
            .args(["run", "--release", "--quiet", "-p", "quadmuse-server", "--example", "sweep", "--"])
            .arg(data)
            .args([inputs[0].as_os_str(), SWEPT.as_ref()])
            .status();
        status.map_err(|source| ScaleError::Io { doing: "run the sweep".into(), source })?;
    }
    Ok(())
}
