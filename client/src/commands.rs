//! The verbs, one function each: ask the service, print the answer.

mod add;
mod choose;
mod compose;
mod corpus;
mod map;
mod rank;
mod screen;

use crate::{api::Api, args::Command, error::ClientError, ui::Ui};

/// Carries out a verb.
///
/// # Errors
/// Whatever it ran into; it has not been printed yet.
pub async fn dispatch(command: Command, api: &Api, ui: &mut Ui) -> Result<(), ClientError> {
    match command {
        Command::Add(args) => add::add(&args, api, ui).await,
        Command::List(args) => corpus::list(args, api, ui).await,
        Command::Show { id } => corpus::show(id, api, ui).await,
        Command::Remove { ids } => corpus::remove(&ids, api, ui).await,
        Command::Rate { id, relevance } => corpus::rate(id, relevance, api, ui).await,
        Command::Tag { id, edits } => corpus::tag(id, &edits, api, ui).await,
        Command::Query(args) => rank::query(&args, api, ui).await,
        Command::Ranking(args) => rank::ranking(&args, api, ui).await,
        Command::Map(args) => map::map(&args, api, ui).await,
        Command::Constrain(args) => map::constrain(args, api, ui).await,
        Command::Compose(args) => compose::compose(&args, api, ui).await,
        Command::Retopo(args) => compose::retopo(&args, api, ui).await,
    }
}
