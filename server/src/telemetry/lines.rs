//! Log lines on their way out: a thread of their own writes them, so that nobody who answers requests waits for a disk, a pipe or
//! each other.
//!
//! At most [`LINES_MAX`] wait. Beyond that lines are lost, and the next that is written says how many.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;
use tracing_subscriber::fmt::MakeWriter;

/// Lines that wait to be written, at most.
const LINES_MAX: usize = 16 << 10;
/// Longest wait for the last lines, at the end of the process.
const LAST_TIME_MAX: Duration = Duration::from_secs(2);

/// A message to the thread that writes.
enum LogMessage {
    Line(Vec<u8>),
    /// All before this is to be written; then its sender is dropped.
    Flush(SyncSender<()>),
}

/// Where lines are handed in. Clones share it.
#[derive(Clone, Debug)]
pub struct Lines {
    sender: SyncSender<LogMessage>,
    lost: Arc<AtomicU64>,
}

/// Waits for the last lines when it is dropped.
#[derive(Debug)]
#[must_use = "lines that wait when it is dropped are written; without it they are lost at the end of the process"]
pub struct Guard(Lines);

impl Lines {
    /// Starts the thread that writes to `out`.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(out: impl Write + Send + 'static) -> io::Result<(Self, Guard)> {
        let (sender, receiver) = sync_channel(LINES_MAX);
        let lines = Self { sender, lost: Arc::default() };
        let lost = Arc::clone(&lines.lost);
        std::thread::Builder::new().name("log".into()).spawn(move || write_all(&receiver, out, &lost))?;
        Ok((lines.clone(), Guard(lines)))
    }

    /// Waits until all that was handed in is written, for a while.
    fn flush(&self) {
        let (done, written) = sync_channel(1);
        if self.sender.send(LogMessage::Flush(done)).is_ok() {
            let _ = written.recv_timeout(LAST_TIME_MAX);
        }
    }
}

fn write_all(lines: &Receiver<LogMessage>, mut out: impl Write, lost: &AtomicU64) {
    while let Ok(sent) = lines.recv() {
        // Who reads the log may be gone; there is nobody to be told.
        match sent {
            LogMessage::Line(line) => _ = out.write_all(&line),
            LogMessage::Flush(done) => {
                _ = out.flush();
                drop(done);
            }
        }
        match lost.swap(0, Ordering::Relaxed) {
            0 => {}
            count => _ = writeln!(out, "{{\"level\":\"WARN\",\"message\":\"log lines lost\",\"count\":{count}}}"),
        }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.flush();
    }
}

/// One line, written at once: whoever formats events does.
#[derive(Debug)]
pub struct Line<'a>(&'a Lines);

impl Write for Line<'_> {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if let Err(TrySendError::Full(_)) = self.0.sender.try_send(LogMessage::Line(line.to_vec())) {
            self.0.lost.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for Lines {
    type Writer = Line<'a>;

    fn make_writer(&'a self) -> Line<'a> {
        Line(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    /// Writes nothing until its gate is opened.
    struct Gated {
        gate: Option<Receiver<()>>,
        text: Arc<Mutex<Vec<u8>>>,
    }

    impl Write for Gated {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if let Some(gate) = self.gate.take() {
                let _ = gate.recv();
            }
            self.text.lock().expect("not poisoned").extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn nobody_waits_for_a_log_that_is_stuck_and_what_is_lost_is_told() {
        let (open, gate) = sync_channel(1);
        let text = Arc::new(Mutex::new(Vec::new()));
        let out = Gated { gate: Some(gate), text: Arc::clone(&text) };
        let (lines, guard) = Lines::start(out).expect("a thread");
        let many = LINES_MAX + 100;
        for number in 0..many {
            lines.make_writer().write_all(format!("line {number}\n").as_bytes()).expect("it is handed in");
        }
        assert!(text.lock().expect("not poisoned").is_empty());
        open.send(()).expect("it waits");
        drop(guard);
        let text = String::from_utf8(text.lock().expect("not poisoned").clone()).expect("text");
        let written: Vec<&str> = text.lines().filter(|line| line.starts_with("line ")).collect();
        assert!(written.len() >= LINES_MAX && written.len() < many, "{}", written.len());
        assert_eq!(written[..3], ["line 0", "line 1", "line 2"]);
        assert!(text.contains(&format!("\"count\":{}", many - written.len())), "{}", &text[text.len() - 200..]);
    }
}
