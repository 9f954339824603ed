//! `add`: uploads files in parallel, and goes on past a bad one.

use crate::{
    api::{Added, Api, ExampleUpload, Gain},
    args::{AddArgs, SegmentsArg},
    error::ClientError,
    table,
    ui::Ui,
};
use futures_util::StreamExt;
use quadmuse_proto::{Example, Parts, Problem};
use serde::Serialize;
use std::path::Path;

/// Uploads under way at a time.
const PARALLEL_UPLOADS: usize = 4;

/// The JSON output for each file: the example, or the problem.
#[derive(Serialize)]
#[serde(untagged)]
enum FileAnswer<'a> {
    Added {
        file: String,
        #[serde(flatten)]
        example: &'a Example,
    },
    Refused {
        file: String,
        #[serde(flatten)]
        problem: &'a Problem,
    },
    Failed {
        file: String,
        detail: String,
    },
}

/// Decides how much `add` prints for a file that was added.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Detail {
    /// A line.
    Line,
    /// A line, and a line for each repair.
    Repairs,
}

pub(super) async fn add(args: &AddArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    if args.name.is_some() && args.files.len() > 1 {
        return Err(ClientError::OneNameForMany { files: args.files.len() });
    }
    let upload = ExampleUpload {
        name: args.name.clone(),
        tags: args.tags.clone(),
        relevance: args.relevance,
        segments: match args.whole_only {
            true => SegmentsArg { parts: Some(Parts::None), ..args.segments.clone() },
            false => args.segments.clone(),
        },
    };
    let detail = if args.verbose { Detail::Repairs } else { Detail::Line };
    let bar = ui.bar(args.files.len() as u64, "adding");
    let uploads = args.files.iter().map(|file| {
        let (upload, bar) = (&upload, &bar);
        async move {
            let answer = api.add_example(file, upload).await;
            bar.inc(1);
            (file, answer)
        }
    });
    // In the order of the files, whichever is done first.
    let mut answers = futures_util::stream::iter(uploads).buffered(PARALLEL_UPLOADS);
    let mut failed = 0;
    while let Some((file, answer)) = answers.next().await {
        match answer {
            Ok(added) => bar.suspend(|| tell_added(file, &added, detail, ui))?,
            // Without a server every other file would fail alike.
            Err(error @ ClientError::Unreachable { .. }) => {
                bar.finish_and_clear();
                return Err(error);
            }
            Err(error) => {
                failed += 1;
                bar.suspend(|| tell_failed(file, &error, ui))?;
            }
        }
    }
    bar.finish_and_clear();
    match failed {
        0 => Ok(()),
        _ => Err(ClientError::SomeFailed { failed, total: args.files.len() }),
    }
}

/// A line a file; with its repairs below it where they are wanted.
fn tell_added(file: &Path, added: &Added, detail: Detail, ui: &mut Ui) -> Result<(), ClientError> {
    let Example { id, counts, segments, repairs, doubts, .. } = &added.example;
    ui.value(&FileAnswer::Added { file: file.display().to_string(), example: &added.example })?;
    let how = match added.how {
        Gain::New => "added",
        Gain::AlreadyThere => "already there",
    };
    let segments = match (segments.as_slice(), table::parts(segments)) {
        ([whole, ..], parts) if parts > 0 => format!("{} and {parts} parts of it", whole.topology),
        ([one], _) => one.topology.to_string(),
        (several, _) => format!("{} segments", several.len()),
    };
    let repaired = match repairs.len() {
        0 => String::new(),
        1 => ", 1 repair".into(),
        n => format!(", {n} repairs"),
    };
    ui.text(&format!("{id}  {how}: {} ({segments}, {} faces{repaired})", file.display(), counts.faces))?;
    for doubt in doubts {
        ui.warn(&format!("{}: {doubt}; if it is none, `quadmuse remove {id}` takes it out", file.display()));
    }
    if detail == Detail::Repairs {
        repairs.iter().for_each(|repair| ui.note(&format!("  {repair}")));
    }
    Ok(())
}

fn tell_failed(file: &Path, error: &ClientError, ui: &mut Ui) -> Result<(), ClientError> {
    let name = file.display().to_string();
    let message = error.message();
    ui.complain(&format!("{name}: {message}"));
    match error.problem() {
        Some(problem) => ui.value(&FileAnswer::Refused { file: name, problem }),
        None => ui.value(&FileAnswer::Failed { file: name, detail: message }),
    }
}
