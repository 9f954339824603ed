//! Examples laid on segments where nobody chooses them: the entries of a ranking in their turns, until one is good enough.

use super::mapping::{self, LiveMap};
use super::query::LiveQuery;
use super::ranking::turns;
use super::worth::tries;
use super::{Work, WorkError};
use crate::pool::StopReason;
use futures_util::{Stream, StreamExt, stream};
use quadmuse_proto::{Beyond, ExampleId, NewMap};
use std::sync::Arc;

/// Examples that are laid on a segment, and segments that are laid on, at a time.
pub(super) const AT_A_TIME: usize = 2;

/// The entries of a segment's ranking that are laid in turn, of as many `tries`. Waits until the ranking will not change any more:
/// only then it tells the best.
pub async fn in_turn(live: &LiveQuery, segment: u32, tries: usize) -> Vec<(ExampleId, u32)> {
    if tries == 0 {
        return Vec::new();
    }
    let board = live.wait_for(|_| false).await;
    board.rankings.get(segment as usize).map_or(Vec::new(), |ranking| turns(&ranking.candidates, tries))
}

/// Lays the entries of a segment's ranking in their turns until a map is good enough, and finds the map that is worth most, of
/// equals the first. Maps that are there are not made again. `None` where there is no entry.
///
/// # Errors
/// As [`mapping::create`] has them. A deadline is none where a map was laid before it.
pub async fn best_map(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    (segment, tries): (u32, usize),
    beyond: Beyond,
) -> Result<Option<Arc<LiveMap>>, WorkError> {
    let entries = in_turn(live, segment, tries).await;
    let one = |(example, example_segment)| async move {
        let there = mapping::find(live, segment, (example, example_segment)).filter(|map| map.beyond == beyond);
        let new = NewMap { beyond, ..NewMap::new(segment, example, example_segment) };
        match there {
            Some(map) => Ok(map),
            None => mapping::create(work, live, new).await,
        }
    };
    // The first is mostly good enough. Where it is not, two at a time are laid, and looked at in order.
    let (first, others) = entries.split_at(entries.len().min(1));
    let first = stream::iter(first.iter().copied()).then(one);
    let others = stream::iter(others.iter().copied()).map(one).buffered(AT_A_TIME);
    let mut found = std::pin::pin!(first.chain(others).enumerate());
    let mut best: Option<Arc<LiveMap>> = None;
    while let Some((tried, found)) = found.next().await {
        let map = match found {
            Ok(map) => map,
            // Another would take as long.
            Err(error) if best.is_some() && is_late(&error) => break,
            Err(error) => return Err(error),
        };
        let worth = |map: &LiveMap| map.newest().summary.worth();
        let best = match &mut best {
            Some(best) if worth(&map) <= worth(best) => best,
            best => best.insert(map),
        };
        if tries <= 1 || best.newest().summary.is_enough(tried + 1, tries) {
            break;
        }
    }
    Ok(best)
}

/// Tells whether a computation took too long: a regular layout is there at once.
pub fn is_late(error: &WorkError) -> bool {
    error.stop_reason() == Some(StopReason::Deadline)
}

/// Lays the best example on each of some segments, if it is worth one, two at a time. The answers come in order.
pub fn best_maps<'a>(
    work: &'a Arc<Work>,
    live: &'a Arc<LiveQuery>,
    segments: &'a [u32],
    beyond: Beyond,
) -> impl Stream<Item = Result<Option<Arc<LiveMap>>, WorkError>> + Send + 'a {
    let one = move |&segment: &'a u32| {
        let tries = tries(&live.model.segments, segment as usize);
        best_map(work, live, (segment, tries), beyond)
    };
    stream::iter(segments).map(one).buffered(AT_A_TIME)
}
