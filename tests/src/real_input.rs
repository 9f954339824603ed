//! The whole path on meshes that artists and scanners made: corpus → query → map, and retopo, judged from outside.

pub mod claims;
pub mod corpus;
pub mod pairs;
pub mod record;
pub mod scans;
pub mod table;

use crate::{client::ClientError, judge::JudgeError, server::ServerError};
use serde_json::Value;
use std::{io, path::PathBuf};

/// How much is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// All pairs and scans against the whole corpus.
    All,
    /// What three minutes on two cores allow: the heads, the mirrored hands, a few scans.
    Subset,
}

/// Why the runner can't go on.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// No server.
    #[error(transparent)]
    Server(#[from] ServerError),
    /// The client fails.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The judge fails.
    #[error(transparent)]
    Judge(#[from] JudgeError),
    /// A file fails.
    #[error("expected to read or write {}, found that it cannot be done: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// An answer is not what the interface promises.
    #[error("expected {expected} in the client's answer, found {found}")]
    Answer {
        /// What should be there.
        expected: &'static str,
        /// What is.
        found: String,
    },
}

/// Reads a file's text.
fn read(path: PathBuf) -> Result<String, RunError> {
    std::fs::read_to_string(&path).map_err(|source| RunError::File { path, source })
}

/// A text in a JSON object.
fn text_in(value: &Value, name: &'static str) -> Result<String, RunError> {
    let found = || RunError::Answer { expected: name, found: value.to_string().chars().take(200).collect() };
    value[name].as_str().map(str::to_owned).ok_or_else(found)
}

/// A number in a JSON object.
fn number_in(value: &Value, name: &'static str) -> Result<f64, RunError> {
    let found = || RunError::Answer { expected: name, found: value.to_string().chars().take(200).collect() };
    value[name].as_f64().ok_or_else(found)
}

/// Whether a map's flip turns the example into its mirror image.
fn is_mirrored(map: &Value) -> Result<bool, RunError> {
    match (map["flip"]["u"].as_bool(), map["flip"]["v"].as_bool()) {
        (Some(u), Some(v)) => Ok(u != v),
        _ => Err(RunError::Answer { expected: "flip: {u, v}", found: map["flip"].to_string() }),
    }
}
