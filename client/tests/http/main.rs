//! The verbs against a server that answers as it is told to.

mod batch;
mod corpus;
mod fake;
mod gone;
mod interrupt;
mod messages;
mod names;
mod output;
mod progress;
mod queries;
mod uploads;

use quadmuse_client::{
    args::Cli,
    carry_out,
    error::ClientError,
    ui::{Audience, Ui},
};
use std::{
    io::{self, Write},
    path::Path,
    sync::{Arc, Mutex},
};

/// A writer whose text can be read afterwards.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Shared {
    fn text(&self) -> String {
        String::from_utf8(self.0.lock().expect("no panic").clone()).expect("text")
    }
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().expect("no panic").extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What a command printed, and how it ended.
struct Ran {
    out: String,
    notes: String,
    end: Result<(), ClientError>,
}

impl Ran {
    fn code(&self) -> u8 {
        self.end.as_ref().map_or_else(ClientError::exit_code, |()| 0)
    }

    fn json_lines(&self) -> Vec<serde_json::Value> {
        self.out.lines().map(|line| serde_json::from_str(line).expect(line)).collect()
    }
}

/// Runs a command line (split at blanks) against a server; nothing is remembered of it.
async fn run(server: &str, line: &str) -> Ran {
    let state = tempfile::tempdir().expect("a folder");
    run_with(server, state.path(), line).await
}

/// The same with a folder for what is remembered.
async fn run_with(server: &str, state: &Path, line: &str) -> Ran {
    run_before(server, state, line, None).await
}

/// The same before somebody at a terminal who answers questions, a line each.
async fn run_answering(server: &str, line: &str, answers: &'static str) -> Ran {
    let state = tempfile::tempdir().expect("a folder");
    run_before(server, state.path(), line, Some(answers)).await
}

async fn run_before(server: &str, state: &Path, line: &str, answers: Option<&'static str>) -> Ran {
    let words = ["quadmuse", "--server", server].into_iter().chain(line.split_whitespace()).map(Into::into);
    let cli = Cli { state: Some(state.to_owned()), ..Cli::read(words).expect(line) };
    let audience = if cli.json { Audience::Programs } else { Audience::People };
    let (out, notes) = (Shared::default(), Shared::default());
    let mut ui = Ui::new(audience, None, out.clone(), notes.clone());
    if let Some(answers) = answers {
        ui = ui.answering(io::Cursor::new(answers));
    }
    let end = carry_out(cli, &mut ui).await;
    if let Err(error) = &end {
        ui.report(error);
    }
    Ran { out: out.text(), notes: notes.text(), end }
}
