//! The long-running corpus search service of Quadmuse: reads the command line and dispatches.

use clap::Parser;
use quadmuse_server::{commands, config::Cli, telemetry};
use std::error::Error;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // Held to the end: its last lines are written then.
    let started = cli.collector().map_err(|error| error.to_string());
    let started = started.and_then(|collector| telemetry::start(collector.as_ref()).map_err(|error| error.to_string()));
    let _telemetry = match started {
        Ok(telemetry) => telemetry,
        Err(error) => {
            eprintln!("quadmuse-server: {error}");
            return ExitCode::from(2);
        }
    };
    match commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("quadmuse-server: {error}");
            let mut source = error.source();
            while let Some(cause) = source {
                eprintln!("  because: {cause}");
                source = cause.source();
            }
            ExitCode::FAILURE
        }
    }
}
