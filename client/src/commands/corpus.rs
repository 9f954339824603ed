//! `list`, `show`, `remove`, `rate`, `tag`: the corpus and its annotations.

use crate::{
    api::{Api, ExampleFilter},
    args::ListArgs,
    error::ClientError,
    names,
    spec::{Name, TagEdit},
    table,
    ui::Ui,
};
use quadmuse_proto::{Example, ExampleId, ExamplePatch};
use serde::Serialize;

/// What programs get for each example that was removed.
#[derive(Serialize)]
struct Removed {
    id: ExampleId,
    removed: bool,
}

pub(super) async fn list(args: ListArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let examples = api.examples(&ExampleFilter { tags: args.tags, topology: args.topology }).await?;
    ui.value(&examples)?;
    ui.text(&table::examples(&examples, ui.room()))
}

pub(super) async fn show(id: ExampleId, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    print(&api.example(id).await?, ui)
}

fn print(example: &Example, ui: &mut Ui) -> Result<(), ClientError> {
    ui.value(example)?;
    ui.text(&table::example(example, ui.room()))
}

pub(super) async fn remove(ids: &[Name], api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    // Names first: with one that is not clear nothing is removed.
    let mut found = Vec::with_capacity(ids.len());
    for id in ids {
        found.push(names::example(id, api).await?);
    }
    let mut failed = 0;
    for &id in &found {
        match api.remove_example(id).await {
            Ok(()) => {
                ui.value(&Removed { id, removed: true })?;
                ui.text(&format!("{id}  removed"))?;
            }
            Err(error @ ClientError::Refused(_)) if ids.len() > 1 => {
                failed += 1;
                ui.value(&Removed { id, removed: false })?;
                ui.complain(&format!("{id}: {}", error.message()));
            }
            Err(error) => return Err(error),
        }
    }
    if failed == 0 { Ok(()) } else { Err(ClientError::SomeFailed { failed, total: ids.len() }) }
}

pub(super) async fn rate(id: ExampleId, relevance: f64, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let patch = ExamplePatch { relevance: Some(relevance), ..ExamplePatch::default() };
    let example = api.patch_example(id, &patch).await?;
    ui.value(&example)?;
    ui.text(&format!("{id}  relevance {}", example.relevance))
}

pub(super) async fn tag(id: ExampleId, edits: &[TagEdit], api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let mut example = api.example(id).await?;
    let tags = TagEdit::apply(edits, &example.tags);
    if tags != example.tags {
        example = api.patch_example(id, &ExamplePatch { tags: Some(tags), ..ExamplePatch::default() }).await?;
    }
    ui.value(&example)?;
    let tags = if example.tags.is_empty() { "no tags".to_owned() } else { example.tags.join(" ") };
    ui.text(&format!("{id}  {}", crate::error::printable(&tags)))
}
