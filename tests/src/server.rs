//! A real server: its own process, a free port, a store of its own.

use crate::{
    binaries::{BinaryError, program},
    http,
};
use std::{
    fs::File,
    io,
    net::{SocketAddr, TcpListener},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    time::{Duration, Instant},
};

/// How long a server may take until it is ready.
const READY_TIME_MAX: Duration = Duration::from_secs(300);
/// Pause between two looks.
const PAUSE: Duration = Duration::from_millis(20);

/// Why there is no server.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The program is missing.
    #[error(transparent)]
    Binary(#[from] BinaryError),
    /// The system refuses.
    #[error("expected to start a server, found that the system refuses: {0}")]
    Io(#[from] io::Error),
    /// It ended, or was never ready.
    #[error("expected the server to be ready, found that {what}; its log:\n{log}")]
    NotReady {
        /// What was found.
        what: String,
        /// The end of its log.
        log: String,
    },
}

/// A running server; it is killed when dropped.
#[derive(Debug)]
pub struct Server {
    process: Child,
    address: SocketAddr,
    log: PathBuf,
}

impl Server {
    /// Starts a server on the store in `data`, and waits until it is ready. Its log goes to a file beside the store.
    ///
    /// # Errors
    /// [`ServerError`].
    pub fn start(data: &Path) -> Result<Self, ServerError> {
        Self::start_under(&[], data)
    }

    /// The same by way of another command, which is to run what follows its words: one that sets a limit, say.
    ///
    /// # Errors
    /// [`ServerError`].
    pub fn start_under(words: &[&str], data: &Path) -> Result<Self, ServerError> {
        Self::start_program(&program("quadmuse-server")?, words, data)
    }

    /// The same with another program: that of another release, say.
    ///
    /// # Errors
    /// [`ServerError`].
    pub fn start_program(program: &Path, words: &[&str], data: &Path) -> Result<Self, ServerError> {
        let address = TcpListener::bind("127.0.0.1:0")?.local_addr()?;
        let log = data.with_extension("log");
        let output = File::options().create(true).append(true).open(&log)?;
        let mut command = match words {
            [] => Command::new(program),
            [first, rest @ ..] => {
                let mut command = Command::new(first);
                command.args(rest).arg(program);
                command
            }
        };
        let process = command
            .args(["serve", "--listen", &address.to_string(), "--data"])
            .arg(data)
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(output.try_clone()?)
            .stderr(output)
            .spawn()?;
        let mut server = Self { process, address, log };
        server.wait_until_ready()?;
        Ok(server)
    }

    fn wait_until_ready(&mut self) -> Result<(), ServerError> {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.process.try_wait()? {
                return Err(self.not_ready(format!("it ended with {status}")));
            }
            if http::get(self.address, "/readyz").is_ok_and(|answer| answer.status == 200) {
                return Ok(());
            }
            if begun.elapsed() > READY_TIME_MAX {
                return Err(self.not_ready(format!("it was not within {READY_TIME_MAX:?}")));
            }
            std::thread::sleep(PAUSE);
        }
    }

    fn not_ready(&self, what: String) -> ServerError {
        ServerError::NotReady { what, log: self.end_of_log() }
    }

    fn end_of_log(&self) -> String {
        let log = self.log();
        let lines: Vec<&str> = log.lines().collect();
        lines[lines.len().saturating_sub(30)..].join("\n")
    }

    /// Its process.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Its address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Its address as clients are told.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// What it has logged so far.
    pub fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Ends it at once, as a power cut of the process would (SIGKILL).
    ///
    /// # Errors
    /// The system refuses.
    pub fn kill(mut self) -> io::Result<ExitStatus> {
        self.process.kill()?;
        self.process.wait()
    }

    /// Asks it to end (SIGTERM), and waits for so long at most; `None` if it still runs.
    ///
    /// # Errors
    /// The system refuses.
    pub fn terminate(&mut self, time_max: Duration) -> io::Result<Option<ExitStatus>> {
        let id = self.process.id().to_string();
        Command::new("kill").args(["-TERM", &id]).status()?;
        let begun = Instant::now();
        while begun.elapsed() < time_max {
            if let Some(status) = self.process.try_wait()? {
                return Ok(Some(status));
            }
            std::thread::sleep(PAUSE);
        }
        Ok(None)
    }

    /// Whether its process runs.
    pub fn is_alive(&mut self) -> bool {
        matches!(self.process.try_wait(), Ok(None))
    }

    /// How it ended, if it did so by itself.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.process.try_wait().ok().flatten()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        if std::thread::panicking() {
            // The folder with the log goes with the test.
            eprintln!("the server at {} logged last:\n{}", self.address, self.end_of_log());
        }
    }
}
