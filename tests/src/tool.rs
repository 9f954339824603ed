//! How the tools here read their command line, begin and end.

use crate::shared;
use std::{fmt::Display, path::Path, process::ExitCode, str::FromStr};

/// The word of the command line behind `name`.
pub fn word(name: &str) -> Option<String> {
    std::env::args().skip_while(|word| word != name).nth(1)
}

/// The number of the command line behind `name`; `default` where there is none.
pub fn number<N: FromStr>(name: &str, default: N) -> N {
    word(name).and_then(|word| word.parse().ok()).unwrap_or(default)
}

/// The end of a tool by whether it found all as it should be; an error is printed.
pub fn ended<E: Display>(result: Result<bool, E>) -> ExitCode {
    match result {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Does `work`, named `what`, with what the command line asks for and the folder of shared meshes. Wrong words end with 2,
/// failed work with 1, and without the shared meshes there is nothing to do.
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
