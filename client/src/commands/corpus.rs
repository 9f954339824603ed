//! `list`, `show`, `remove`, `rate`, `tag`: the corpus and its annotations.

use crate::{
    api::{Api, ExampleFilter},
    args::{ListArgs, RemoveArgs},
    error::ClientError,
    names,
    spec::{Name, TagEdit},
    table,
    ui::Ui,
};
use quadmuse_proto::{Example, ExampleId, ExamplePatch};
use serde::Serialize;

/// The JSON output for each example that was removed.
#[derive(Serialize)]
struct Removed {
    id: ExampleId,
    removed: bool,
}

pub(super) async fn list(args: ListArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let sought = table::sought(&args.tags, args.topology);
    let examples = api.examples(&ExampleFilter { tags: args.tags, topology: args.topology }).await?;
    ui.value(&examples)?;
    ui.text(&table::examples(&examples, &sought, ui.room()))
}

pub(super) async fn show(id: ExampleId, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    print(&api.example(id).await?, ui)
}

pub(super) fn print(example: &Example, ui: &mut Ui) -> Result<(), ClientError> {
    ui.value(example)?;
    ui.text(&table::example(example, ui.room()))
}

/// Names of examples that are told before they are removed.
const NAMES_LISTED: usize = 8;

pub(super) async fn remove(args: &RemoveArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    let found = if args.tags.is_empty() { named(&args.ids, api).await? } else { tagged(&args.tags, api).await? };
    if !args.yes {
        confirm(&found, args, api, ui).await?;
    }
    let (mut failed, total) = (0, found.len());
    for id in found {
        match api.remove_example(id).await {
            Ok(()) => {
                ui.value(&Removed { id, removed: true })?;
                ui.text(&format!("{id}  removed"))?;
            }
            Err(error @ ClientError::Refused(_)) if total > 1 => {
                failed += 1;
                ui.value(&Removed { id, removed: false })?;
                ui.complain(&format!("{id}: {}", error.message()));
            }
            Err(error) => return Err(error),
        }
    }
    if failed == 0 { Ok(()) } else { Err(ClientError::SomeFailed { failed, total }) }
}

/// Names first: with one that is not clear nothing is removed.
async fn named(names: &[Name], api: &Api) -> Result<Vec<ExampleId>, ClientError> {
    let mut found = Vec::with_capacity(names.len());
    for name in names {
        found.push(names::example(name, api).await?);
    }
    Ok(found)
}

async fn tagged(tags: &[String], api: &Api) -> Result<Vec<ExampleId>, ClientError> {
    let all = api.examples(&ExampleFilter { tags: tags.to_vec(), topology: None }).await?;
    match all.is_empty() {
        true => Err(ClientError::NoneTagged { tags: table::sought(tags, None) }),
        false => Ok(all.into_iter().map(|example| example.id).collect()),
    }
}

/// Asks at a terminal. Elsewhere ids are taken at their word, as scripts give them; what a tag takes with it is not.
async fn confirm(found: &[ExampleId], args: &RemoveArgs, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    if !ui.is_dialogue() {
        let count = found.len();
        return if args.tags.is_empty() { Ok(()) } else { Err(ClientError::NotAsked { count }) };
    }
    let mut names = Vec::new();
    for &id in found.iter().take(NAMES_LISTED) {
        let name = api.example(id).await?.name;
        names.push(if name.is_empty() { id.to_string() } else { name });
    }
    let more = found.len().saturating_sub(NAMES_LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    match ui.ask(&format!("remove {}{more} for good?", names.join(", ")))? {
        Some(false) => Err(ClientError::Declined { done: "removed" }),
        _ => Ok(()),
    }
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
