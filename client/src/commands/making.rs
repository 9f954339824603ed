//! Telling how far the service is with a map, a composition or a retopology while its answer is awaited.

use crate::{
    api::Api,
    ui::{Ui, tell_share},
};
use quadmuse_proto::{Making, Product, Query, QueryId};
use std::{convert::Infallible, time::Duration};

/// How often the service is asked how far it is.
const ASK_PAUSE: Duration = Duration::from_millis(500);

/// Names what is awaited.
#[derive(Clone, Copy, Debug)]
pub(super) struct Awaited {
    /// The query.
    pub(super) query: QueryId,
    /// What is made of it.
    pub(super) product: Product,
    /// Its name for people, until the service says which stage it is at.
    pub(super) what: &'static str,
}

/// Awaits an answer, and shows meanwhile how far what it waits for is.
///
/// The service holds the answer until all is done, and so stops when this program ends; it is asked beside that, and only
/// where somebody sees what it says. That it doesn't say is no failure: the answer tells what is wrong.
pub(super) async fn awaited<T>(wanted: Awaited, answer: impl Future<Output = T>, api: &Api, ui: &Ui) -> T {
    if !ui.shows_bars() {
        return answer.await;
    }
    let spinner = ui.spinner(wanted.what);
    let telling = async {
        loop {
            tokio::time::sleep(ASK_PAUSE).await;
            let query = api.query(wanted.query).await;
            if let Some(making) = query.as_ref().ok().and_then(|query| current(query, wanted.product)) {
                tell_share(&spinner, &making.stage, making.progress);
            }
        }
    };
    let answer = tokio::select! {
        biased;
        answer = answer => answer,
        never = telling => { let never: Infallible = never; match never {} }
    };
    spinner.finish_and_clear();
    answer
}

/// The one that the program waits for: of several that are made at a time, the first that was asked for.
fn current(query: &Query, product: Product) -> Option<&Making> {
    let open = query.making.iter().filter(|making| making.product == product && !making.state.is_final());
    // Ids sort by time.
    open.min_by(|a, b| a.id.cmp(&b.id))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::query;
    use quadmuse_proto::MakingState;

    #[test]
    fn of_what_is_made_the_oldest_of_its_kind_that_is_open_is_told() {
        let making = |id: &str, product, state| Making {
            id: id.into(),
            product,
            query: query(1).id,
            state,
            progress: 0.5,
            stage: String::new(),
            created: String::new(),
            problem: None,
        };
        let all = [
            making("1", Product::Map, MakingState::Failed),
            making("2", Product::Composition, MakingState::Running),
            making("4", Product::Map, MakingState::Queued),
            making("3", Product::Map, MakingState::Running),
        ];
        let query = Query { making: all.to_vec(), ..query(1) };
        assert_eq!(current(&query, Product::Map).map(|making| making.id.as_str()), Some("3"));
        assert_eq!(current(&query, Product::Composition).map(|making| making.id.as_str()), Some("2"));
        let query = Query { making: all[..1].to_vec(), ..query };
        assert_eq!(current(&query, Product::Map), None);
    }
}
