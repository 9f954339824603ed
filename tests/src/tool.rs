//! How every tool here begins and ends: wrong words end with 2, failed work with 1, and without the shared meshes there is
//! nothing to do.

use crate::shared;
use std::{fmt::Display, path::Path, process::ExitCode};

/// Does `work`, named `what`, with what the command line asks for and the folder of shared meshes.
pub fn run<O, E: Display>(
    options: Result<O, String>,
    what: &str,
    work: impl FnOnce(&O, &Path) -> Result<ExitCode, E>,
) -> ExitCode {
    let options = match options {
        Ok(options) => options,
        Err(message) => {
            eprintln!("error: {message}");
            return ExitCode::from(2);
        }
    };
    let Some(shared) = shared::folder_or_say(what) else { return ExitCode::SUCCESS };
    work(&options, &shared).unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ExitCode::FAILURE
    })
}
