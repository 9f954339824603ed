//! The long run: `fuzz [--target NAME,…] [--seconds 60] [--from SEED] [--one]`.
//!
//! Every target gets its share of the time, and tries seeds from `--from` on. A find ends the run with its target and seed, by
//! which it is run again (`--from SEED --one`) and kept in `tests/finds.rs`.

use quadmuse_fuzz::{TARGETS, Target, target};
use std::panic::catch_unwind;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// What the command line asks for.
struct Options {
    targets: Vec<Target>,
    time: Duration,
    from: u64,
    is_one: bool,
}

fn options() -> Result<Options, String> {
    let mut options = Options { targets: TARGETS.into(), time: Duration::from_secs(60), from: 0, is_one: false };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        if word == "--one" {
            options.is_one = true;
            continue;
        }
        let value = words.next().ok_or(format!("expected a value after {word}"))?;
        let number = || value.parse::<u64>().map_err(|_| format!("expected a number after {word}, found `{value}`"));
        match word.as_str() {
            "--target" => options.targets = value.split(',').map(named).collect::<Result<_, _>>()?,
            "--seconds" => options.time = Duration::from_secs(number()?),
            "--from" => options.from = number()?,
            other => return Err(format!("expected --target, --seconds, --from or --one, found `{other}`")),
        }
    }
    Ok(options)
}

fn named(name: &str) -> Result<Target, String> {
    let known = TARGETS.map(|target| target.name).join(", ");
    target(name).ok_or(format!("expected one of {known}, found `{name}`"))
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(options) => options,
        Err(message) => {
            eprintln!("error: {message}");
            return ExitCode::from(2);
        }
    };
    let each = options.time / options.targets.len().max(1) as u32;
    let mut finds = 0;
    for target in &options.targets {
        let (begun, mut seed, mut taken) = (Instant::now(), options.from, 0u64);
        loop {
            match catch_unwind(|| (target.run)(seed)) {
                Ok(is_taken) => taken += u64::from(is_taken),
                Err(_) => {
                    println!("FIND: {} of seed {seed} ({})", target.name, target.promise);
                    finds += 1;
                }
            }
            seed += 1;
            if options.is_one || begun.elapsed() > each {
                break;
            }
        }
        println!("{}: {} seeds from {} on, {taken} taken", target.name, seed - options.from, options.from);
    }
    if finds == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
