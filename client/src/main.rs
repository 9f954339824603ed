//! The `quadmuse` command: reads the command line, and hands it to the library.

use quadmuse_client::{args::Cli, run};
use std::process::ExitCode;

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    match Cli::read(std::env::args_os()) {
        Ok(cli) => ExitCode::from(run(cli).await),
        Err(error) => error.exit(),
    }
}
