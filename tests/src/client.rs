//! The real client: its own process, its answers as JSON.

use crate::binaries::{BinaryError, program};
use serde_json::Value;
use std::{
    ffi::OsStr,
    io,
    process::{Command, Stdio},
};

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The program is missing.
    #[error(transparent)]
    Binary(#[from] BinaryError),
    /// The system refuses.
    #[error("expected to run the client, found that the system refuses: {0}")]
    Io(#[from] io::Error),
    /// It failed.
    #[error("expected `quadmuse {line}` to succeed, found exit code {code:?}: {message}")]
    Failed {
        /// What was asked for.
        line: String,
        /// The exit code.
        code: Option<i32>,
        /// What it said on standard error.
        message: String,
    },
}

/// What a command answered.
#[derive(Clone, Debug)]
pub struct Ran {
    /// The command line.
    pub line: String,
    /// The exit code; `None` if it was killed.
    pub code: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub notes: String,
}

impl Ran {
    /// The JSON values on standard output.
    ///
    /// # Errors
    /// A line is no JSON: the line.
    pub fn values(&self) -> Result<Vec<Value>, String> {
        self.out.lines().map(|line| serde_json::from_str(line).map_err(|_| line.to_owned())).collect()
    }

    /// The answer, if the command succeeded.
    ///
    /// # Errors
    /// [`ClientError::Failed`].
    pub fn ok(self) -> Result<Self, ClientError> {
        if self.code == Some(0) {
            return Ok(self);
        }
        Err(ClientError::Failed { line: self.line, code: self.code, message: self.notes.trim().to_owned() })
    }

    /// The last JSON value on standard output; `null` if there is none.
    pub fn last_value(&self) -> Value {
        self.out.lines().next_back().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default()
    }
}

/// A client of one server.
#[derive(Clone, Debug)]
pub struct Client {
    url: String,
}

impl Client {
    /// A client of the server at `url`.
    pub fn new(url: impl Into<String>) -> Self {
        Self { url: url.into() }
    }

    /// The command, not yet run.
    ///
    /// # Errors
    /// The program is missing.
    pub fn command<S: AsRef<OsStr>>(&self, words: impl IntoIterator<Item = S>) -> Result<Command, ClientError> {
        let mut command = Command::new(program("quadmuse")?);
        command.env("QUADMUSE_SERVER", &self.url).env_remove("QUADMUSE_TOKEN").args(words).stdin(Stdio::null());
        // What it remembers is none of the user's.
        command.env("QUADMUSE_STATE", std::env::temp_dir().join("quadmuse-tests-state"));
        Ok(command)
    }

    /// Runs a command line.
    ///
    /// # Errors
    /// The program is missing, or the system refuses. That it fails is no error: see [`Ran::ok`].
    pub fn run<S: AsRef<OsStr>>(&self, words: impl IntoIterator<Item = S>) -> Result<Ran, ClientError> {
        let mut command = self.command(words)?;
        let line = command.get_args().map(OsStr::to_string_lossy).collect::<Vec<_>>().join(" ");
        let output = command.output()?;
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Ok(Ran { line, code: output.status.code(), out: text(output.stdout), notes: text(output.stderr) })
    }
}
