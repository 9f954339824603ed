//! The `quadmuse` command: reads the command line, and hands it to the library.

use clap::Parser;
use quadmuse_client::{args::Cli, run};
use std::process::ExitCode;

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    ExitCode::from(run(Cli::parse()).await)
}
