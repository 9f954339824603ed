//! `add`: uploads files in parallel, and goes on past a bad one.

use crate::{
    api::{Added, Api, ExampleUpload, Gain},
    args::AddArgs,
    error::ClientError,
    ui::Ui,
};
use futures_util::StreamExt;
use quadmuse_proto::{Example, Problem};
use serde::Serialize;
use std::path::Path;

/// Uploads under way at a time.
const PARALLEL_UPLOADS: usize = 4;

/// What programs get for each file: the example, or the problem.
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

/// Repairs of a file that are told when it was added; `show` tells all.
const REPAIRS_TOLD: usize = 3;

pub(super) async fn add(args: &AddArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let upload = ExampleUpload { tags: args.tags.clone(), relevance: args.relevance, segments: args.segments.clone() };
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
            Ok(added) => bar.suspend(|| tell_added(file, &added, ui))?,
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

fn tell_added(file: &Path, added: &Added, ui: &mut Ui) -> Result<(), ClientError> {
    let example = &added.example;
    ui.value(&FileAnswer::Added { file: file.display().to_string(), example })?;
    let how = match added.how {
        Gain::New => "added",
        Gain::AlreadyThere => "already there",
    };
    let segments = match example.segments.as_slice() {
        [one] => one.topology.to_string(),
        several => format!("{} segments", several.len()),
    };
    ui.text(&format!("{}  {how}: {} ({segments}, {} faces)", example.id, file.display(), example.counts.faces))?;
    for repair in example.repairs.iter().take(REPAIRS_TOLD) {
        ui.note(&format!("{}: {repair}", file.display()));
    }
    if let more @ 1.. = example.repairs.len().saturating_sub(REPAIRS_TOLD) {
        ui.note(&format!("{}: … and {more} more, see `quadmuse show {}`", file.display(), example.id));
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
