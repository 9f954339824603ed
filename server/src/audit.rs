//! The audit log: who changed what, and when; `audit.jsonl` beside the store, one JSON object a line.
//!
//! Every request that is no mere read leaves a line when it was answered, also one that was refused; so do the commands that
//! change tokens. A thread of its own writes and syncs. Requests never wait for it: where more lines wait than
//! [`WAITING_MAX`], the rest are counted, and the log says how many it lacks. At [`BYTES_MAX`] the file becomes
//! `audit.jsonl.1`, in place of the one before.

use crate::work::query::rfc3339;
use serde::Serialize;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

/// The file's name.
pub const FILE: &str = "audit.jsonl";

/// Lines that may wait to be written.
const WAITING_MAX: usize = 4096;

/// Length at which a file is put aside, in bytes.
const BYTES_MAX: u64 = 64 << 20;

/// One change, or the attempt at one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Line {
    /// When it was answered, RFC 3339, UTC.
    pub time: String,
    /// The request's id; empty for a command.
    pub request: String,
    /// The token's id; `open` on an open service, `none` without a valid token, `console` for a command.
    pub user: String,
    /// The token's name.
    pub name: String,
    /// The token's role.
    pub role: String,
    /// The address of the other end.
    pub peer: String,
    /// The method, or the command.
    pub action: String,
    /// The path without its query, or what the command was about.
    pub on: String,
    /// The status answered; 0 for a command.
    pub status: u16,
    /// The address of what was made, if anything was.
    pub made: String,
}

/// A log being written. Dropping it writes what waits.
pub struct Audit {
    sender: Mutex<Option<SyncSender<Box<Line>>>>,
    lost: Arc<AtomicU64>,
    writer: Mutex<Option<JoinHandle<()>>>,
}

impl Audit {
    /// A log beside the store in `data`. A file that can't be written is told in the service's own log.
    pub fn beside(data: &Path) -> Self {
        let (sender, receiver) = sync_channel(WAITING_MAX);
        let (path, lost) = (data.join(FILE), Arc::<AtomicU64>::default());
        let counter = Arc::clone(&lost);
        let run = move || write_all(&path, &receiver, &counter);
        let writer = std::thread::Builder::new().name("audit".into()).spawn(run);
        if let Err(error) = &writer {
            tracing::error!(%error, "no audit log is written");
        }
        Self { sender: Mutex::new(Some(sender)), lost, writer: Mutex::new(writer.ok()) }
    }

    /// Notes a change. Never waits.
    pub fn note(&self, line: Line) {
        let line = Box::new(Line { time: now(), ..line });
        let sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
        match sender.as_ref().map(|sender| sender.try_send(line)) {
            Some(Ok(())) => {}
            Some(Err(TrySendError::Full(_) | TrySendError::Disconnected(_))) | None => {
                self.lost.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

impl Drop for Audit {
    fn drop(&mut self) {
        drop(self.sender.get_mut().unwrap_or_else(PoisonError::into_inner).take());
        if let Some(writer) = self.writer.get_mut().unwrap_or_else(PoisonError::into_inner).take() {
            // What it panicked with was logged.
            let _ = writer.join();
        }
    }
}

/// Notes what a command did, at once.
///
/// # Errors
/// When the file can't be written.
pub fn note_command(data: &Path, action: &str, on: &str) -> std::io::Result<()> {
    let line = Line { time: now(), user: "console".into(), action: action.into(), on: on.into(), ..Line::default() };
    let mut file = opened(&data.join(FILE))?;
    file.write_all(&bytes_of(&line))?;
    file.sync_data()
}

fn now() -> String {
    let time = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    rfc3339(u64::try_from(time.as_millis()).unwrap_or(u64::MAX))
}

fn opened(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().create(true).append(true).mode(0o600).open(path)
}

/// JSON escapes whatever a client wrote.
fn bytes_of(line: &Line) -> Vec<u8> {
    let mut bytes = serde_json::to_vec(line).unwrap_or_default();
    bytes.push(b'\n');
    bytes
}

fn write_all(path: &Path, lines: &Receiver<Box<Line>>, lost: &AtomicU64) {
    let mut healthy = true;
    while let Ok(first) = lines.recv() {
        let mut bytes = bytes_of(&first);
        lines.try_iter().take(WAITING_MAX).for_each(|line| bytes.extend(bytes_of(&line)));
        let missing = lost.swap(0, Ordering::Relaxed);
        if missing > 0 {
            let action = "lines of this log were lost: too many waited".to_owned();
            bytes.extend(bytes_of(&Line { time: now(), action, on: missing.to_string(), ..Line::default() }));
        }
        match append(path, &bytes) {
            Ok(()) => healthy = true,
            // Once for each time that it stops working, not for each line.
            Err(error) if healthy => {
                healthy = false;
                tracing::error!(%error, path = %path.display(), "the audit log can't be written");
            }
            Err(_) => {}
        }
    }
}

fn append(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = opened(path)?;
    if file.metadata()?.len() >= BYTES_MAX {
        std::fs::rename(path, aside(path))?;
        file = opened(path)?;
    }
    file.write_all(bytes)?;
    file.sync_data()
}

fn aside(path: &Path) -> PathBuf {
    path.with_added_extension("1")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(dir: &Path) -> Vec<serde_json::Value> {
        let text = std::fs::read_to_string(dir.join(FILE)).expect("a file");
        text.lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect()
    }

    #[test]
    fn every_line_is_written_and_nothing_a_client_wrote_breaks_one() {
        let dir = tempfile::tempdir().expect("a directory");
        let audit = Audit::beside(dir.path());
        for n in 0..1000 {
            audit.note(Line { on: format!("/v1/examples/{n}\n{{\"user\": \"forged\"}}\u{1b}"), ..Line::default() });
        }
        drop(audit);
        note_command(dir.path(), "token create", "ada").expect("noted");
        let lines = lines(dir.path());
        assert_eq!(lines.len(), 1001);
        assert!(lines[999]["on"].as_str().is_some_and(|on| on.starts_with("/v1/examples/999\n")));
        assert_eq!((&lines[1000]["user"], &lines[1000]["action"]), (&"console".into(), &"token create".into()));
    }

    #[test]
    fn a_long_file_is_put_aside() {
        let dir = tempfile::tempdir().expect("a directory");
        let path = dir.path().join(FILE);
        File::create(&path).and_then(|file| file.set_len(BYTES_MAX)).expect("a long file");
        append(&path, b"next\n").expect("appended");
        assert_eq!(std::fs::read(&path).expect("a file"), b"next\n");
        assert_eq!(std::fs::metadata(aside(&path)).expect("the one before").len(), BYTES_MAX);
    }
}
