//! Examples laid on segments where nobody chooses them: the entries of a ranking in their turns, until one is good enough.

use super::mapping::{self, LiveMap};
use super::query::LiveQuery;
use super::worth::tries;
use super::{Work, WorkError};
use crate::pool::StopReason;
use futures_util::{Stream, StreamExt, stream};
use quadmuse_proto::{Beyond, ExampleId, NewMap, Verdict};
use std::sync::Arc;

/// Examples that are laid on a segment, and segments that are laid on, at a time.
pub(super) const AT_A_TIME: usize = 2;

/// From this worth on no other example has to be tried.
const ENOUGH: f64 = 0.1;
/// Below this worth even the best does not explain the input.
const LITTLE: f64 = 0.05;
/// Worth of a map of which nothing speaks but its verdict, good or fair, for the share that it covers.
const WORTH: [f64; 2] = [0.5, 0.2];
/// A map that is not poor and less sure than this is worth about as much, for the share that it covers.
const WORTH_LEAST: f64 = 0.01;
/// A map that is broken by what it leaves bare is worth this share of what it is worth else: stitching may not reach all of that.
/// *Untuned.*
const BARE_COUNTS: f64 = 0.5;

/// Rates a map against others on the same segment: how sure it is, times the share of the input that the example covers. A poor map
/// gets less than 0.
pub fn worth(map: &LiveMap) -> f64 {
    let newest = map.newest();
    let summary = &newest.summary;
    let [good, fair] = WORTH;
    let sure = match (newest.mapped.stitched().verdict, newest.mapped.sureness) {
        (Verdict::Poor | Verdict::Broken, _) => return -1.0,
        (_, Some(sureness)) => at_least(sureness),
        (Verdict::Good, None) => good,
        (Verdict::Fair, None) => fair,
    };
    let reached = if summary.verdict == Verdict::Broken { BARE_COUNTS } else { 1.0 };
    sure * reached * summary.covers.input
}

/// How sure a map is as a worth, which is more than 0: [`WORTH_LEAST`] and less for what is less sure.
fn at_least(sureness: f64) -> f64 {
    if sureness >= WORTH_LEAST { sureness } else { WORTH_LEAST * (sureness - WORTH_LEAST).exp() }
}

/// Tells whether no more examples have to be laid once `tried` were. Up to `tries` the map has to be good, on however small a part, or
/// to explain much of the input; after them it is enough that it explains a little.
fn is_enough(map: &LiveMap, tried: usize, tries: usize) -> bool {
    let verdict = map.newest().summary.verdict;
    let is_sound = verdict < Verdict::Broken;
    verdict == Verdict::Good || is_sound && worth(map) >= if tried < tries { ENOUGH } else { LITTLE }
}

/// The entries of a segment's ranking that are laid in turn, of as many `tries`. Waits until the ranking will not change any more:
/// only then it tells the best.
pub async fn in_turn(live: &LiveQuery, segment: u32, tries: usize) -> Vec<(ExampleId, u32)> {
    if tries == 0 {
        return Vec::new();
    }
    let board = live.wait_for(|_| false).await;
    board.rankings.get(segment as usize).map_or(Vec::new(), |ranking| live.turns(segment, &ranking.candidates, tries))
}

/// Lays the entries of a segment's ranking in their turns until a map is good enough, and finds the map that is worth most, of
/// equals the first. Maps that are there are not made again; examples that were removed meanwhile, are damaged, or can't be laid are
/// passed over. `None` where there is no entry.
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
    let one = |(example, example_segment): (ExampleId, u32)| async move {
        let there = mapping::find(live, segment, (example, example_segment)).filter(|map| map.beyond == beyond);
        let new = NewMap { beyond, ..NewMap::new(segment, example, example_segment) };
        let map = match there {
            Some(map) => Ok(map),
            None => mapping::create(work, live, new).await,
        };
        (example, map)
    };
    // The first is mostly good enough. Where it is not, two at a time are laid, and looked at in order.
    let (first, others) = entries.split_at(entries.len().min(1));
    let first = stream::iter(first.iter().copied()).then(one);
    let others = stream::iter(others.iter().copied()).map(one).buffered(AT_A_TIME);
    let mut found = std::pin::pin!(first.chain(others).enumerate());
    let mut best: Option<Arc<LiveMap>> = None;
    while let Some((tried, (example, map))) = found.next().await {
        let map = match map {
            Ok(map) => map,
            // Another would take as long.
            Err(error) if best.is_some() && is_late(&error) => break,
            Err(error) if error.is_of_one_example() => {
                live.passed_over(example, &error);
                continue;
            }
            Err(error) => return Err(error),
        };
        let best = match &mut best {
            Some(best) if worth(&map) <= worth(best) => best,
            best => best.insert(map),
        };
        if tries <= 1 || is_enough(best, tried + 1, tries) {
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
