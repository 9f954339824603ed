//! The client of a Quadmuse server: the command line, the requests, and what is printed of the answers.
//!
//! `main` reads the command line and hands it to [`run`]; everything else is a library, so that it can be tested
//! without a process. Data go to standard output, progress and messages to standard error.

pub mod api;
pub mod args;
pub mod commands;
pub mod error;
pub mod file;
pub mod follow;
mod interrupt;
pub mod names;
pub mod paint;
pub mod spec;
pub mod state;
pub mod stream;
pub mod table;
pub mod ui;

use api::Api;
use args::Cli;
use error::ClientError;
use state::State;
use ui::Ui;

/// Carries out the command line against standard output; answers with the exit code. Ctrl-C ends the program.
pub async fn run(cli: Cli) -> u8 {
    let mut ui = Ui::stdout(cli.json);
    let done = carry_out_with(cli, &mut ui, interrupt::watch).await;
    match done.and_then(|()| ui.finish()) {
        Ok(()) => error::EXIT_DONE,
        Err(error) => {
            ui.report(&error);
            error.exit_code()
        }
    }
}

/// Carries out the command line, printing to `ui`.
///
/// # Errors
/// Whatever the command ran into; it has not been printed yet.
pub async fn carry_out(cli: Cli, ui: &mut Ui) -> Result<(), ClientError> {
    carry_out_with(cli, ui, |_| ()).await
}

/// The same; `watch` is handed the requests before the first is sent.
async fn carry_out_with(cli: Cli, ui: &mut Ui, watch: impl FnOnce(&Api)) -> Result<(), ClientError> {
    if commands::without_server(&cli.command, ui)? {
        return Ok(());
    }
    let api = Api::new(&cli.server, cli.token.as_deref())?;
    watch(&api);
    commands::dispatch(cli.command, &api, &State::new(cli.state), ui).await
}
