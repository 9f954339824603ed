//! The table of hard input: real time, processor time and memory of each file, sent to a fresh server and composed.
//!
//! `bounds [--families all|NAME,…] [--doublings 1] [--hostile DIR] [--file FILE]… [--as scan|example] [--quads N]
//! [--limit 60]`. Each family is measured at its size and at twice that; `--quads` is a head of so many quads.

use quadmuse_tests::{
    bounds::{self, BoundsError, Sent, families::FAMILIES},
    scale::process,
    shapes::{self, Faces},
};
use std::{path::PathBuf, process::ExitCode, time::Duration};

/// What the command line asks for.
struct Options {
    families: String,
    doublings: u32,
    hostile: Option<PathBuf>,
    files: Vec<PathBuf>,
    sent: Sent,
    quads: Option<u32>,
    limit: Duration,
}

fn options() -> Result<Options, String> {
    let mut options = Options {
        families: String::new(),
        doublings: 1,
        hostile: None,
        files: Vec::new(),
        sent: Sent::Scan,
        quads: None,
        limit: Duration::from_secs(60),
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("expected a value after {word}"))?;
        let number = || value.parse::<u32>().map_err(|_| format!("expected a number after {word}, found `{value}`"));
        match word.as_str() {
            "--families" => options.families = value,
            "--doublings" => options.doublings = number()?.min(8),
            "--limit" => options.limit = Duration::from_secs(number()?.into()),
            "--hostile" => options.hostile = Some(value.into()),
            "--file" => options.files.push(value.into()),
            "--quads" => options.quads = Some(number()?),
            "--as" => {
                options.sent = match value.as_str() {
                    "scan" => Sent::Scan,
                    "example" => Sent::Example,
                    other => return Err(format!("expected scan or example after --as, found `{other}`")),
                };
            }
            other => {
                return Err(format!(
                    "expected --families, --doublings, --hostile, --file, --as, --quads or --limit, found `{other}`"
                ));
            }
        }
    }
    Ok(options)
}

fn main() -> ExitCode {
    let done = options().and_then(|options| run(&options).map_err(|error| error.to_string()));
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(options: &Options) -> Result<(), BoundsError> {
    let folder = tempfile::tempdir()?;
    let store = folder.path().join("store");
    bounds::corpus(folder.path(), &store)?;
    println!("load {}\n", process::load());
    println!(
        "| input | exit | s | s of processor | s waited for a core | MiB | words |\n|---|---|---|---|---|---|---|"
    );
    for family in
        FAMILIES.iter().filter(|f| options.families == "all" || options.families.split(',').any(|n| n == f.name))
    {
        let mut last = None;
        for doubling in 0..=options.doublings {
            let size = family.size << doubling;
            let file = folder.path().join(format!("{}.obj", family.name));
            std::fs::write(&file, (family.make)(size))?;
            let cost = bounds::cost(&store, &file, options.sent, options.limit)?;
            let growth = last.replace(cost.clone()).map_or(String::new(), |before: bounds::Cost| {
                let [time, memory] = [cost.cpu_s / before.cpu_s, cost.peak as f64 / before.peak as f64];
                format!(" (× {time:.1} time, × {memory:.1} memory)")
            });
            println!("{}", bounds::row(&format!("{} of {size} {}{growth}", family.name, family.counts), &cost));
        }
    }
    if let Some(quads) = options.quads {
        let file = folder.path().join("quads.obj");
        std::fs::write(&file, shapes::head(9, f64::from(quads).sqrt().ceil() as u32, Faces::Quads))?;
        let cost = bounds::cost(&store, &file, options.sent, options.limit)?;
        println!("{}", bounds::row(&format!("a head of {quads} quads"), &cost));
    }
    let hostile = options.hostile.as_deref().map(bounds::files).transpose()?.unwrap_or_default();
    for file in hostile.iter().chain(&options.files) {
        let cost = bounds::cost(&store, file, options.sent, options.limit)?;
        println!("{}", bounds::row(&file.file_name().unwrap_or_default().to_string_lossy(), &cost));
    }
    println!("\nload at the end {}", process::load());
    Ok(())
}
