//! The verbs, one function each: ask the service, print the answer.

mod add;
mod choose;
mod compose;
mod corpus;
mod map;
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
        Command::Remove { ids } => corpus::remove(&ids, api, ui).await,
        Command::Rate { id, relevance } => corpus::rate(names::example(&id, api).await?, relevance, api, ui).await,
        Command::Tag { id, edits } => corpus::tag(names::example(&id, api).await?, &edits, api, ui).await,
        Command::Query(args) => rank::query(&args, api, state, ui).await,
        Command::Ranking(args) => rank::ranking(&args, api, state, ui).await,
        Command::Map(args) => map::map(&args, api, state, ui).await,
        Command::Constrain(args) => map::constrain(args, api, state, ui).await,
        Command::Compose(args) => compose::compose(&args, api, state, ui).await,
        Command::Retopo(args) => compose::retopo(&args, api, state, ui).await,
    }
}
