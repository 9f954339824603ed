//! Retopologies: quads for all of a scan in one go, as an artist wants them who drops a file.
//!
//! The scan is laid out as it was ranked. Where examples make up little of that, and nobody said how to cut it, it is cut and
//! ranked anew: parted at its waist, as a figure from its base, and where that helps little, into its protrusions. Of all that
//! was made, the result is that of which examples make up most. Queries that came to nothing are freed.

mod outcome;
mod recut;

use super::composing::{self, INSPIRED_LEAST};
use super::engine::AS_MAPPED;
use super::kept::KeptQueries;
use super::laying::AT_A_TIME;
use super::making::{self, Making};
use super::mapping::LiveMap;
use super::query::{LiveQuery, ms_since};
use super::worth::tries;
use super::{REQUEST_TIME_MAX, Work, WorkError, laying};
use crate::pool::StopReason;
use futures_util::{Stream, StreamExt, stream};
use outcome::{MapOrComposition, Outcome};
use quadmuse_proto::{
    CompositionPart, NewComposition, NewRetopo, Parts, Product, QueryState, Retopo, RetopoId, Verdict,
};
use recut::{QuerySource, Recut, score, score_when_compared};
use std::cmp::Reverse;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::OnceCell;

/// Most retopologies a query.
pub const RETOPOS_MAX: usize = 64;

/// A mesh with more small holes is a scan full of gaps, and is not cut where nobody asked for it.
const HOLES_CUT_MAX: u32 = 8;

/// After so long a query is tried again for which there was no place.
const QUERIES_FULL_RETRY: Duration = Duration::from_secs(2);

/// Shares of the progress at which the whole has its map, at which it is laid out, and at which the sides of its waist are.
const MAPPED: f64 = 0.3;
const LAID_OUT: f64 = 0.5;
const PARTED: f64 = 0.75;

type Teller = Arc<dyn Fn(&'static str, f64) + Send + Sync>;

/// Makes quads for all of a query's scan, on a task of its own; the id of what comes of it.
///
/// # Errors
/// [`WorkError::TooMany`], [`WorkError::MakingsFull`]; what goes wrong later, its making tells.
pub fn start(
    work: &Arc<Work>,
    (kept, largest): (&Arc<KeptQueries>, u64),
    live: &Arc<LiveQuery>,
    wanted: NewRetopo,
) -> Result<(RetopoId, Arc<Making>), WorkError> {
    composing::check_options(wanted.smoothing, wanted.density.unwrap_or_default())?;
    if live.retopos().len() >= RETOPOS_MAX {
        return Err(WorkError::TooMany { of: "retopologies", limit: RETOPOS_MAX });
    }
    let id = RetopoId::generate_on(work.server);
    let (work_of, live_of, kept) = (Arc::clone(work), Arc::clone(live), Arc::clone(kept));
    let make = move |tell: Teller| async move {
        let begun = Instant::now();
        let again = QuerySource { work: Arc::clone(&work_of), kept, largest, upload: OnceCell::new() };
        let notes = Mutex::default();
        let retopology = Retopology { work: work_of, live: live_of, wanted, again, tell, notes };
        let outcome = retopology.made().await?;
        let live = Arc::clone(&retopology.live);
        let notes = retopology.notes.into_inner().unwrap_or_else(PoisonError::into_inner);
        let summary = Retopo { total_ms: ms_since(begun), ..outcome.to_wire(id, live.id, notes) };
        outcome.keep();
        live.retopos().insert(id, Arc::new(summary));
        Ok(())
    };
    Ok((id, making::start(work, live, (Product::Retopo, id.to_string()), make)?))
}

/// A retopology of a query.
///
/// # Errors
/// [`WorkError::NoSuchRetopo`], [`WorkError::NotMade`].
pub fn find(live: &LiveQuery, id: RetopoId) -> Result<Arc<Retopo>, WorkError> {
    let there = live.retopos().get(&id).cloned();
    there.ok_or_else(|| live.makings.missing(Product::Retopo, &id).unwrap_or(WorkError::NoSuchRetopo(id)))
}

/// Forgets a retopology, but not the map or composition that it came to; one that is made is cancelled.
///
/// # Errors
/// [`WorkError::NoSuchRetopo`].
pub fn remove(live: &LiveQuery, id: RetopoId) -> Result<(), WorkError> {
    let is_gone = live.makings.remove(Product::Retopo, &id) || live.retopos().remove(&id).is_some();
    is_gone.then_some(()).ok_or(WorkError::NoSuchRetopo(id))
}

/// A retopology on its way.
struct Retopology {
    work: Arc<Work>,
    live: Arc<LiveQuery>,
    wanted: NewRetopo,
    again: QuerySource,
    tell: Teller,
    notes: Mutex<Vec<String>>,
}

/// A scan parted at its waist.
struct Figure {
    made: Outcome,
    /// True where examples make up most of the side that they are on: there is no need to look further.
    is_enough: bool,
}

impl Retopology {
    fn note(&self, note: impl Into<String>) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(note.into());
    }

    /// Logs what a way of cutting the scan came to.
    fn log(&self, cut: &'static str, live: &LiveQuery, made: Option<&Outcome>) {
        let share = made.map_or(0.0, Outcome::share);
        tracing::debug!(query = %live.id, cut, share, "tried");
    }

    async fn made(&self) -> Result<Outcome, WorkError> {
        (self.tell)("waiting for the ranking", 0.0);
        let live = Arc::clone(&self.live);
        let board = live.wait_for(|_| false).await;
        match (board.state, board.failure) {
            (QueryState::Failed, Some(failure)) => return Err(WorkError::Query(failure)),
            (state @ (QueryState::Failed | QueryState::Cancelled), _) => {
                return Err(WorkError::QueryEnded { state: state.as_str() });
            }
            _ => {}
        }
        let (all, worth_it) = (live.model.segments.len(), segments_worth_it(&live).len());
        if worth_it < all {
            let few = all - worth_it;
            self.note(format!("{few} of {all} segments have too few faces for an example; they take regular layouts"));
        }
        match (live.model.segments.len(), self.wanted.density, tries_of(&live, 0)) {
            (1, None, 0) => self.composed(&live, &[], [0.0, 1.0]).await,
            (1, None, tries) => self.of_one(&live, tries).await,
            _ => self.of_several(&live).await,
        }
    }

    /// The result for a scan that is ranked in one piece.
    async fn of_one(&self, live: &Arc<LiveQuery>, tries: usize) -> Result<Outcome, WorkError> {
        (self.tell)("laying examples on the scan", 0.05);
        let best = match self.best(live, 0).await {
            Err(error) if laying::is_late(&error) => {
                self.note(error.to_string());
                return self.composed(live, &[], [MAPPED, 1.0]).await;
            }
            best => best?,
        };
        match &best {
            None => self.note("no example lies well on all of it"),
            Some(map) if is_poor(map) => {
                self.note(format!("the best example, {}, fits poorly as a whole", name(&self.work, map)))
            }
            Some(_) => {}
        }
        // A regular layout of the whole is wanted only where its parts have nothing better.
        let whole = match best.filter(|map| !is_poor(map)) {
            Some(map) => Some(self.settled(live, map).await?),
            None => None,
        };
        let is_enough = whole.as_ref().is_some_and(Outcome::is_most);
        self.log("whole", live, whole.as_ref());
        // What is worth one try alone has too few faces to be cut.
        let parts = match !is_enough && tries > 1 && self.may_be_cut(live).await? {
            true => self.in_parts(live).await?,
            false => None,
        };
        match (whole, parts) {
            (Some(whole), Some(parts)) => Ok(whole.or_better(parts)),
            (Some(whole), None) => Ok(whole),
            (None, Some(parts)) if parts.share() > 0.0 => Ok(parts),
            // What the parts came to is broken, or nobody's quads: those of the whole have no seams.
            (None, _) => self.composed(live, &[], [MAPPED, 1.0]).await,
        }
    }

    /// The result for a scan that is ranked in several pieces, or that is to be denser.
    async fn of_several(&self, live: &Arc<LiveQuery>) -> Result<Outcome, WorkError> {
        let made = self.composed(live, &[], [0.0, LAID_OUT]).await?;
        if made.is_most() || !self.may_be_cut(live).await? {
            return Ok(made);
        }
        let figure = self.at_waist(live).await;
        Ok(match self.tried(figure)? {
            Some(figure) => made.or_better(figure.made),
            None => made,
        })
    }

    /// The result for the best map of a single segment, which is not poor: the map itself, with the example's own vertex order, faces,
    /// UVs and groups, where it follows the input; else what is composed of it.
    async fn settled(&self, live: &Arc<LiveQuery>, map: Arc<LiveMap>) -> Result<Outcome, WorkError> {
        let composed = self.composed(live, std::slice::from_ref(&map), [MAPPED, LAID_OUT]).await;
        let made = match composed {
            Err(error) if laying::is_late(&error) && map.newest().summary.verdict == Verdict::Broken => {
                self.note(error.to_string());
                return self.composed(live, &[], [MAPPED, LAID_OUT]).await;
            }
            Err(error) if laying::is_late(&error) => {
                self.note(format!("it is as it was mapped: {error}"));
                return Ok(Outcome::of(live, MapOrComposition::Map(map)));
            }
            made => made?,
        };
        // What the composition says against the whole mesh, the map does not know.
        let is_as_mapped = made.notes().iter().any(|note| note == AS_MAPPED);
        let is_map = is_as_mapped && made.verdict() <= map.newest().summary.verdict;
        Ok(if is_map { Outcome::of(live, MapOrComposition::Map(map)) } else { made })
    }

    /// Stitches some maps, and the best for the other segments, between two shares of the progress.
    async fn composed(
        &self,
        live: &Arc<LiveQuery>,
        maps: &[Arc<LiveMap>],
        [from, to]: [f64; 2],
    ) -> Result<Outcome, WorkError> {
        let wanted = NewComposition {
            parts: maps.iter().map(|map| CompositionPart { segment: map.segment, map: map.id }).collect(),
            smoothing: self.wanted.smoothing,
            density: self.wanted.density.unwrap_or_default(),
            keep: Vec::new(),
            beyond: self.wanted.beyond,
        };
        let tell = |stage, share| (self.tell)(stage, from + (to - from) * share);
        let made = when_there_is_room(|| composing::create(&self.work, live, wanted.clone(), &tell)).await?;
        Ok(Outcome::of(live, MapOrComposition::Composition(made)))
    }

    /// Tells whether a scan may be cut where nobody asked for it: one full of holes is not, since cuts would run from hole to hole,
    /// nor one that was cut as somebody asked.
    async fn may_be_cut(&self, live: &LiveQuery) -> Result<bool, WorkError> {
        let holes = live.model.segments.iter().map(|segment| segment.holes).max().unwrap_or(0);
        if holes > HOLES_CUT_MAX {
            self.note(format!("with {holes} holes the mesh is not cut into parts"));
            return Ok(false);
        }
        let is_uncut = self.again.is_uncut(live).await;
        let is_uncut = self.tried(is_uncut)?;
        if is_uncut.is_none() {
            self.note("the mesh that was sent is no longer kept, so that it is not cut into parts");
        }
        Ok(is_uncut == Some(true))
    }

    /// The result of laying examples on the parts of a scan: the sides of its waist, or its protrusions. `None` where it has no
    /// parts.
    async fn in_parts(&self, whole: &Arc<LiveQuery>) -> Result<Option<Outcome>, WorkError> {
        let figure = self.at_waist(whole).await;
        self.log("waist", whole, figure.as_ref().ok().and_then(Option::as_ref).map(|figure| &figure.made));
        let figure = match self.tried(figure)? {
            Some(Figure { made, is_enough: true }) => return Ok(Some(made)),
            figure => figure.map(|figure| figure.made),
        };
        self.note("cutting the mesh into parts");
        (self.tell)("cutting the mesh into parts", PARTED);
        let parts = self.in_protrusions(whole).await;
        self.log("protrusions", whole, parts.as_ref().ok().and_then(Option::as_ref));
        Ok(match (self.tried(parts)?, figure) {
            (Some(parts), Some(figure)) => Some(parts.or_better(figure)),
            (one, other) => one.or(other),
        })
    }

    /// A scan parted at its waist, such as a figure from its base, with the example that fits one side of it best and what lies around
    /// that; `None` where it has no waist, or no example fits a side, or is more like it than like the `whole`.
    async fn at_waist(&self, whole: &Arc<LiveQuery>) -> Result<Option<Figure>, WorkError> {
        // Parts of a scan are liker to parts of examples than a side is to a whole: those scores don't compare.
        let as_whole = if whole.model.segments.len() == 1 { score(&whole.board(), 0) } else { f64::INFINITY };
        (self.tell)("parting the mesh at its waist", LAID_OUT);
        let Some(recut) = self.again.cut(whole, Parts::Waist).await?.filter(|cut| cut.live.model.is_waist) else {
            return Ok(None);
        };
        let live = Arc::clone(&recut.live);
        let sides: Vec<u32> = segments_worth_it(&live);
        // It is ranked to the end only where the pictures of a side are more like an example than that of the whole.
        if as_whole < f64::INFINITY && score_when_compared(&live, &sides).await >= as_whole {
            return Ok(None);
        }
        live.wait_for(|_| false).await;
        let mut sides: Vec<(f64, u32)> = sides.into_iter().map(|side| (score(&live.board(), side), side)).collect();
        // A figure is more like an example than with its base, and more than its base is.
        sides.retain(|(score, _)| *score < as_whole);
        sides.sort_by(|a, b| a.0.total_cmp(&b.0));
        if sides.is_empty() {
            return Ok(None);
        }
        self.note("parting it at its waist, as a figure from its base");
        let mut best: Option<(f64, MapOrComposition, bool)> = None;
        for (_, side) in sides {
            let map = match self.best(&live, side).await {
                Err(error) if laying::is_late(&error) => continue,
                found => found?.filter(|map| !is_poor(map)),
            };
            let Some(map) = map else { continue };
            let made = self.composed(&live, &[map], [LAID_OUT, PARTED]).await?;
            let share = made.share();
            let is_enough = share >= outcome::MOST * live.model.share_of(side);
            if share > best.as_ref().map_or(0.0, |best| best.0) {
                best = Some((share, made.made, is_enough));
            }
            if best.as_ref().is_some_and(|best| best.2) {
                break;
            }
        }
        Ok(best.map(|(_, made, is_enough)| Figure { made: Outcome::of_recut(recut, made), is_enough }))
    }

    /// A scan cut into its protrusions, with what examples make of them; `None` where it has none, or examples may make up too
    /// little.
    async fn in_protrusions(&self, whole: &Arc<LiveQuery>) -> Result<Option<Outcome>, WorkError> {
        let cut: Option<Recut> = self.again.cut(whole, Parts::Auto).await?;
        let Some(recut) = cut.filter(|cut| cut.live.model.segments.len() > 1) else {
            self.note("no parts were found");
            return Ok(None);
        };
        let live = Arc::clone(&recut.live);
        let mut in_reach = 0.0;
        for segment in segments_worth_it(&live) {
            let is_in_reach = !laying::in_turn(&live, segment, tries_of(&live, segment)).await.is_empty();
            in_reach += if is_in_reach { live.model.share_of(segment) } else { 0.0 };
        }
        if in_reach >= INSPIRED_LEAST {
            let maps = self.maps_of(&live, INSPIRED_LEAST).await?;
            if maps.iter().map(|map| map.share_of(&live.model)).sum::<f64>() >= INSPIRED_LEAST {
                let made = self.composed(&live, &maps, [PARTED, 1.0]).await?.made;
                return Ok(Some(Outcome::of_recut(recut, made)));
            }
        }
        self.note("no example fits enough of its parts");
        Ok(None)
    }

    /// The best maps of all segments, but for those that are poor, in their order. Ends early where less than a share `least` of the
    /// scan can still come to have an example's quads.
    async fn maps_of(&self, live: &Arc<LiveQuery>, least: f64) -> Result<Vec<Arc<LiveMap>>, WorkError> {
        let mut segments = segments_worth_it(live);
        segments.sort_by_key(|&segment| Reverse(live.model.segments.get(segment as usize).map(|s| s.faces)));
        let mut each = self.each_best(live, &segments);
        let mut in_reach: f64 = segments.iter().map(|&segment| live.model.share_of(segment)).sum();
        let mut maps: Vec<Arc<LiveMap>> = Vec::new();
        for &segment in &segments {
            if in_reach < least {
                break;
            }
            (self.tell)("laying examples on the parts", PARTED);
            let Some(found) = each.next().await else { break };
            in_reach -= live.model.share_of(segment);
            match found {
                Ok(Some(map)) if !is_poor(&map) => {
                    in_reach += map.share_of(&live.model);
                    maps.push(map);
                }
                Ok(_) => {}
                Err(error) if laying::is_late(&error) => self.note(error.to_string()),
                Err(error) => return Err(error),
            }
        }
        maps.sort_by_key(|map| map.segment);
        Ok(maps)
    }

    /// The best map of a segment, if there is one.
    async fn best(&self, live: &Arc<LiveQuery>, segment: u32) -> Result<Option<Arc<LiveMap>>, WorkError> {
        let segment = (segment, tries_of(live, segment));
        when_there_is_room(|| laying::best_map(&self.work, live, segment, self.wanted.beyond)).await
    }

    /// The same of several, two at a time, in their order.
    fn each_best<'a>(
        &'a self,
        live: &'a Arc<LiveQuery>,
        segments: &'a [u32],
    ) -> impl Stream<Item = Result<Option<Arc<LiveMap>>, WorkError>> + Send + 'a {
        let one = move |&segment: &'a u32| self.best(live, segment);
        stream::iter(segments).map(one).buffered(AT_A_TIME)
    }

    /// The result of one of several tries; nothing where it was refused, since there are others to fall back on.
    fn tried<T>(&self, found: Result<Option<T>, WorkError>) -> Result<Option<T>, WorkError> {
        match found {
            Err(error) if error.stop_reason() != Some(StopReason::Cancelled) => {
                self.note(error.to_string());
                Ok(None)
            }
            found => found,
        }
    }
}

/// Does a step, and waits where there is no room for it: what was done before is not to be done again.
async fn when_there_is_room<T, F>(step: impl Fn() -> F) -> Result<T, WorkError>
where
    F: Future<Output = Result<T, WorkError>>,
{
    let begun = Instant::now();
    loop {
        let refused = match step().await {
            Err(error) => error,
            done => return done,
        };
        let after = match &refused {
            WorkError::Pool(refusal) => refusal.retry_after(),
            WorkError::QueriesFull { .. } => Some(QUERIES_FULL_RETRY),
            _ => None,
        };
        match after.filter(|after| begun.elapsed() + *after < REQUEST_TIME_MAX) {
            Some(after) => tokio::time::sleep(after).await,
            None => return Err(refused),
        }
    }
}

/// The segments that are worth an example which nobody asked for.
fn segments_worth_it(live: &LiveQuery) -> Vec<u32> {
    let all = 0..live.model.segments.len();
    all.map(|segment| segment as u32).filter(|&segment| tries_of(live, segment) > 0).collect()
}

/// How many examples a segment is worth.
fn tries_of(live: &LiveQuery, segment: u32) -> usize {
    tries(&live.model.segments, segment as usize)
}

fn is_poor(map: &LiveMap) -> bool {
    map.newest().mapped.is_poor_stitched()
}

/// The name of a map's example, or its id where it has none.
fn name(work: &Work, map: &LiveMap) -> String {
    let id = map.example_id();
    let name = work.catalogue.example(id).map(|example| example.name.clone()).unwrap_or_default();
    if name.is_empty() { id.to_string() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pool::PoolError;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[tokio::test]
    async fn a_step_waits_for_room_and_for_nothing_else() {
        let tried = AtomicU32::new(0);
        let refused = |retry_after| WorkError::Pool(PoolError::Overloaded { waiting: 1, retry_after });
        let step = async || match tried.fetch_add(1, Ordering::Relaxed) {
            0 | 1 => Err(refused(Duration::from_millis(1))),
            _ => Ok(()),
        };
        assert!(when_there_is_room(step).await.is_ok());
        assert_eq!(tried.load(Ordering::Relaxed), 3);
        // Whoever is to come back after all of its time is told so, and a mistake stays one.
        let late = when_there_is_room(async || Err::<(), _>(refused(REQUEST_TIME_MAX))).await;
        assert!(matches!(late, Err(WorkError::Pool(PoolError::Overloaded { .. }))));
        let wrong = when_there_is_room(async || Err::<(), _>(WorkError::QueryEnded { state: "cancelled" })).await;
        assert!(matches!(wrong, Err(WorkError::QueryEnded { .. })));
    }
}
