//! The verbs, one function each: ask the service, print the answer.

mod add;
mod annotate;
mod batch;
mod choose;
mod compose;
mod corpus;
mod deliver;
mod gauge;
mod making;
mod manual;
mod map;
mod naming;
mod open;
mod rank;
mod screen;

use crate::{api::Api, args::Command, error::ClientError, names, state::State, ui::Ui};

/// Carries out a verb.
///
/// # Errors
/// Whatever it ran into; it has not been printed yet.
pub async fn dispatch(command: Command, api: &Api, state: &State, ui: &mut Ui) -> Result<(), ClientError> {
    match command {
        Command::Add(args) => add::add(&args, api, ui).await,
        Command::List(args) => corpus::list(args, api, ui).await,
        Command::Show { id } => corpus::show(names::example(&id, api).await?, api, ui).await,
        Command::Remove(args) => corpus::remove(&args, api, ui).await,
        Command::Rate { id, relevance } => corpus::rate(names::example(&id, api).await?, relevance, api, ui).await,
        Command::Tag { id, edits } => corpus::tag(names::example(&id, api).await?, &edits, api, ui).await,
        Command::Annotate(args) => annotate::annotate(&args, api, ui).await,
        Command::Query(args) => rank::query(&args, api, state, ui).await,
        Command::Ranking(args) => rank::ranking(&args, api, state, ui).await,
        Command::Name { query, names } => naming::name(&query, &names, api, state, ui).await,
        Command::Map(args) => map::map(&args, api, state, ui).await,
        Command::Constrain(args) => map::constrain(args, api, state, ui).await,
        Command::Compose(args) => compose::compose(&args, api, state, ui).await,
        Command::Retopo(args) => compose::retopo(&args, api, state, ui).await,
        Command::Batch(args) => batch::batch(&args, api, state, ui).await,
        Command::Open { query } => open::open(&query, api, state, ui).await,
        offline @ (Command::Completions { .. } | Command::Man { .. }) => without_server(&offline, ui).map(|_| ()),
    }
}

/// Carries out a verb that needs no server; answers with `false` where it needs one.
///
/// # Errors
/// [`ClientError`]; it has not been printed yet.
pub fn without_server(command: &Command, ui: &mut Ui) -> Result<bool, ClientError> {
    match command {
        Command::Completions { shell } => manual::completions(*shell, ui)?,
        Command::Man { command, dir: None } => manual::page(command.as_deref(), ui)?,
        Command::Man { dir: Some(dir), .. } => manual::pages(dir, ui)?,
        _ => return Ok(false),
    }
    Ok(true)
}
