//! Queries: an input mesh is cut, encoded and ranked against one snapshot of the corpus, level by level.
//!
//! *Source:* paper §5.2; METHOD §5–6. Every segment is ranked at the coarsest level against the entire corpus first, by
//! translations alone ([`coarse`]); then the best are registered at it, and a level at a time the better half is refined,
//! until the best `top` reach the resolution asked for. Near-duplicates of a better one don't go on. Each level of each
//! segment publishes a whole ranking. The result doesn't depend on the number of threads: each registration is a
//! sequential computation of its own, and the results are combined in the order of the candidates.
//! At last the shapes themselves decide where the pictures leave it open ([`likened`]).
//! A query with a deadline gives each level at most half of the time that is left, the most promising first; `top` are
//! registered at each level in any case. Of a ragged scan only some segments go on to be registered ([`worth`](super::worth)).

mod clusters;
mod coarse;
mod likened;
pub mod scattered;
mod siblings;

use super::catalogue::{LEVEL_COARSEST, Resident, Stock};
use super::engine::{Cut, Encoding, Engine, Model, ModelSegment, Registration};
use super::ingest::{self, Upload, encode, normal_tags};
use super::query::{LiveQuery, QueryOptions, ms_since};
use super::ranking::{Candidate, Depth, counted_of_part, levels_up_to, mark, order, registered_at};
use super::worth::{choices, is_much_of_scan, is_small_part, is_worth_an_example};
use super::{Caller, REQUEST_TIME_MAX, Work, WorkError};
use crate::pool::{Job, Lane, PoolError, Stop, StopReason};
use crate::telemetry::traces;
use coarse::Selection;
use futures_util::{StreamExt, stream};
use quadmuse_proto::query::{DEADLINE_MS_MAX, LEVELS, TOP_MAX};
use quadmuse_proto::{EntryState, ExampleId, LevelTiming, QueryId, QueryState, Segmentation, Topology};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tracing::Instrument;

/// Share of the time left that one level may take of a query with a deadline.
const LEVEL_SHARE: f64 = 0.5;

/// Quanta that a query has in the pool at a time, for each thread.
const WINDOW_PER_THREAD: usize = 4;

/// What examples may be.
const TOPOLOGIES: [Topology; 4] = [Topology::Disc, Topology::Annulus, Topology::Sphere, Topology::Torus];

/// Longest time a query without a deadline may take.
const QUERY_TIME_MAX: Duration = Duration::from_secs(3600);

/// Starts a query: reads and cuts the mesh, then ranks it in the background.
///
/// # Errors
/// Refusals of the mesh, of the options and of the pool; [`WorkError::CorpusEmpty`].
pub async fn start(
    work: &Arc<Work>,
    caller: Caller,
    upload: Upload,
    options: QueryOptions,
) -> Result<Arc<LiveQuery>, WorkError> {
    let started = Instant::now();
    let options = checked(options)?;
    let estimate = work.engine.memory_estimate(upload.bytes.len() as u64);
    let reading = work.admit(caller.user, estimate, REQUEST_TIME_MAX)?;
    let model = read(work, &reading, &upload, options.like).await?;
    let time = options.deadline.unwrap_or(QUERY_TIME_MAX).saturating_sub(started.elapsed());
    let job = match ingest::memory_of(work, upload.bytes.len() as u64, &model) {
        more if more > estimate => {
            drop(reading);
            work.admit(caller.user, more, time)?
        }
        _ => reading.renew(Some(time)),
    };
    let snapshot = work.catalogue.snapshot();
    let select =
        |topologies: &[Topology], stocks: &[Stock]| Selection::new(&snapshot, topologies, stocks, &options.tags);
    let against = |(k, s): (usize, &ModelSegment)| {
        let topologies = work.engine.ranked_against(s.topology, is_much_of_scan(&model.segments, k));
        // What is whole has the wholes for it, as has a figure that was parted from its base, and a body beside its eyes; a part of
        // an example has less to tell it by.
        let is_whole = model.segments.len() == 1 || model.is_waist || s.is_main;
        select(&topologies, if is_whole { &[Stock::Wholes] } else { &ALL_STOCK })
    };
    let corpus: Vec<Selection> = model.segments.iter().enumerate().map(against).collect();
    // A segment for which there is no example takes a regular layout; a corpus without any is a mistake to be told.
    if select(&TOPOLOGIES, &ALL_STOCK).size == 0 {
        let mut wanted: Vec<&str> = model.segments.iter().map(|s| s.topology.as_str()).collect();
        wanted.sort_unstable();
        wanted.dedup();
        let tags = if options.tags.is_empty() { String::new() } else { format!(" and tags {:?}", options.tags) };
        return Err(WorkError::CorpusEmpty { wanted: format!("of topology {}{tags}", wanted.join(" or ")) });
    }
    let live = Arc::new(LiveQuery::new(QueryId::generate_on(work.server), caller, options, model, job, started));
    live.set_corpus_sizes(&corpus.iter().map(|c| c.size as u64).collect::<Vec<_>>());
    work.queries.insert(Arc::clone(&live))?;
    let traced = traces::behind("ranking", &live.id.to_string());
    work.background.spawn(run(Arc::clone(work), Arc::clone(&live), corpus, 0).instrument(traced));
    Ok(live)
}

/// A part of a scan is ranked against wholes and parts.
const ALL_STOCK: [Stock; 2] = [Stock::Wholes, Stock::Parts];

/// Of what a map leaves of a scan so many parts, those of most faces, are ranked.
const RANKED_OF_REST: usize = 4;
/// A part with less of the scan's faces is not.
const RANKED_SHARE_MIN: f64 = 0.03;

/// Ranks what a map leaves of a scan: the largest of the first `new` segments of `cut`, but for the very first, which the map covers.
/// Nobody sees that query.
///
/// # Errors
/// Refusals of the pool. How the ranking ended is told on its board.
pub(super) async fn of_rest(
    work: &Arc<Work>,
    live: &LiveQuery,
    cut: &Arc<Model>,
    new: usize,
) -> Result<Arc<LiveQuery>, WorkError> {
    let job = work.admit(live.caller.user, work.engine.memory_of_segments(cut.segments.len()), REQUEST_TIME_MAX)?;
    let snapshot = work.catalogue.snapshot();
    let all: u64 = cut.segments.iter().map(|s| s.faces).sum();
    let mut ranked: Vec<usize> = (1..new).collect();
    ranked.sort_by_key(|&segment| std::cmp::Reverse(cut.segments[segment].faces));
    ranked.truncate(RANKED_OF_REST);
    ranked.retain(|&segment| cut.segments[segment].faces as f64 >= RANKED_SHARE_MIN * all as f64);
    let select = |segment: usize| {
        let against = work.engine.ranked_against(cut.segments[segment].topology, false);
        match ranked.contains(&segment) {
            true => Selection::new(&snapshot, &against, &ALL_STOCK, &live.options.tags),
            false => Selection::default(),
        }
    };
    let corpus: Vec<Selection> = (0..cut.segments.len()).map(select).collect();
    // One try each: what finishes the others is for those who choose.
    let options = QueryOptions { top: 1, ..live.options.clone() };
    let id = QueryId::generate();
    let rest = Arc::new(LiveQuery::new(id, live.caller, options, Arc::clone(cut), job, Instant::now()));
    rest.set_corpus_sizes(&corpus.iter().map(|c| c.size as u64).collect::<Vec<_>>());
    run(Arc::clone(work), Arc::clone(&rest), corpus, 1).await;
    Ok(rest)
}

/// Reads an upload and cuts it: as `like` is, if an example is named.
async fn read(work: &Arc<Work>, job: &Job, upload: &Upload, like: Option<ExampleId>) -> Result<Arc<Model>, WorkError> {
    let Some(id) = like else { return ingest::read(work, job, Lane::Coarse, upload).await };
    if upload.cut.is_asked_for() {
        let expected = "only without `segments`, `parts` and labels: the example tells how to cut";
        return Err(WorkError::parameter("like", expected, id));
    }
    let example = work.catalogue.example(id)?;
    let like = ingest::model(work, job, Lane::Coarse, &example).await?;
    let upload = Upload { cut: Cut { way: Segmentation::Whole, ..upload.cut.clone() }, ..upload.clone() };
    let whole = ingest::read(work, job, Lane::Coarse, &upload).await?;
    let engine = Arc::clone(&work.engine);
    let mut cut = work.pool.run(job, Lane::Coarse, move |stop| engine.alike(&whole, &like, stop)).await??;
    cut.repairs.push(format!("cut into {} segments as the example {} is", cut.segments.len(), example.name));
    Ok(Arc::new(cut))
}

/// Cancels a query and frees it.
///
/// # Errors
/// [`WorkError::NoSuchQuery`].
pub fn cancel(work: &Work, id: QueryId) -> Result<(), WorkError> {
    let live = work.queries.remove(id)?;
    live.stop().cancel();
    live.makings.cancel_all();
    live.end(QueryState::Cancelled, false, None);
    Ok(())
}

fn checked(options: QueryOptions) -> Result<QueryOptions, WorkError> {
    if !(1..=TOP_MAX).contains(&options.top) {
        return Err(WorkError::parameter("top", format!("from 1 to {TOP_MAX}"), options.top));
    }
    if !LEVELS.contains(&options.resolution) {
        return Err(WorkError::parameter("resolution", "one of 32, 64, 128, 256, 512", options.resolution));
    }
    let longest = Duration::from_millis(DEADLINE_MS_MAX);
    if let Some(time) = options.deadline
        && (time.is_zero() || time > longest)
    {
        let expected = format!("from 1 to {DEADLINE_MS_MAX}");
        return Err(WorkError::parameter("deadline_ms", expected, time.as_millis()));
    }
    Ok(QueryOptions { tags: normal_tags(options.tags)?, ..options })
}

/// Ranks a query's segments from `first` on, the others being nobody's concern, and writes how it ended on its board.
async fn run(work: Arc<Work>, live: Arc<LiveQuery>, corpus: Vec<Selection>, first: usize) {
    match rank_all(&work, &live, corpus, first).await {
        Ok(()) => live.end(QueryState::Done, false, None),
        Err(error) => match error.stop_reason() {
            Some(StopReason::Cancelled) => live.end(QueryState::Cancelled, false, None),
            Some(StopReason::Deadline) => live.end(QueryState::Done, true, None),
            Some(StopReason::Memory) | None => {
                tracing::warn!(query = %live.id, %error, "query failed");
                live.end(QueryState::Failed, false, Some(error));
            }
        },
    }
    tracing::info!(query = %live.id, state = live.board().state.as_str(), ms = live.elapsed_ms(), "query ended");
}

async fn rank_all(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    corpus: Vec<Selection>,
    first: usize,
) -> Result<(), WorkError> {
    encode_segments(work, live, first).await?;
    let resolution = live.options.resolution;
    let mut searches: Vec<SegmentSearch<'_>> = Vec::new();
    for (segment, corpus) in corpus.into_iter().enumerate().skip(first) {
        let query = live.encoded(segment as u32).await?;
        let search = SegmentSearch { work, live, segment, query: Arc::new(query.encoding.clone()) };
        let candidates = search.coarse(corpus).await?;
        let is_worth_it = is_worth_an_example(&live.model.segments, segment);
        search.publish(LEVEL_COARSEST, is_worth_it.then_some(LEVEL_COARSEST), candidates);
        if is_worth_it {
            searches.push(search);
        }
    }
    for level in levels_up_to(resolution) {
        let next = LEVELS.into_iter().find(|next| *next > level && *next <= resolution);
        for search in &mut searches {
            let start = Instant::now();
            let registered = match level {
                LEVEL_COARSEST => tokio::join!(search.each(Step::Refine, level), search.ready()).0,
                _ => search.each(Step::Refine, level).await,
            };
            let (candidates, fresh) = registered?;
            search.publish(level, next, (candidates, fresh, ms_since(start)));
        }
    }
    for search in &mut searches {
        let start = Instant::now();
        let (candidates, fresh) = search.each(Step::Finish, resolution).await?;
        search.publish(resolution, None, (candidates, fresh, ms_since(start)));
    }
    for search in &mut searches {
        search.by_likeness().await?;
    }
    Ok(())
}

async fn encode_segments(work: &Arc<Work>, live: &Arc<LiveQuery>, first: usize) -> Result<(), WorkError> {
    let queued_ms = live.elapsed_ms();
    let start = Instant::now();
    live.update(|board| {
        board.state = QueryState::Encoding;
        board.timings.queued_ms = (queued_ms - board.timings.read_ms).max(0.0);
    });
    let one = async |segment: usize| -> Result<(), WorkError> {
        let encoded = encode(work, &live.job, Lane::Coarse, &live.model, segment as u32).await?;
        if let Some(slot) = live.encoded.get(segment) {
            let _ = slot.set(Arc::new(encoded));
        }
        // Wakes those who wait for this segment.
        live.update(|board| board.timings.encode_ms = ms_since(start));
        Ok(())
    };
    futures_util::future::try_join_all((first..live.encoded.len()).map(one)).await?;
    live.update(|board| board.state = QueryState::Ranking);
    Ok(())
}

/// What a level gave: the candidates in order, how many of them were registered at it, and the milliseconds it took.
type Level = (Vec<Candidate>, usize, f64);

/// One segment of a query against its share of the corpus.
struct SegmentSearch<'a> {
    work: &'a Arc<Work>,
    live: &'a Arc<LiveQuery>,
    segment: usize,
    query: Arc<Encoding>,
}

impl SegmentSearch<'_> {
    fn window(&self) -> usize {
        WINDOW_PER_THREAD * self.work.pool.threads()
    }

    /// Makes what finishing needs beside the first registrations. Where that fails, finishing does it itself.
    async fn ready(&self) {
        let (engine, query) = (Arc::clone(&self.work.engine), Arc::clone(&self.query));
        let _ = self.work.pool.run(&self.live.job, Lane::Fine, move |_| engine.ready(&query)).await;
    }

    /// Takes a step with the best of the newest ranking; the rest stay as they are.
    async fn each(&self, step: Step, level: u32) -> Result<(Vec<Candidate>, usize), WorkError> {
        let newest = self.live.board().rankings.get(self.segment).cloned().unwrap_or_default();
        let top = self.live.options.top as usize;
        let choices = choices(&self.live.model.segments, self.segment, top);
        let mut finished = 0;
        let goes_on = |candidate: &Candidate| match step {
            Step::Refine => candidate.state == EntryState::Refining,
            Step::Finish => {
                let goes = candidate.state == EntryState::Done && finished < choices;
                finished += usize::from(goes);
                goes
            }
        };
        let (going, passed_over): (Vec<Candidate>, Vec<Candidate>) =
            newest.candidates.iter().cloned().partition(goes_on);
        let late = self.late_after();
        let run = |(place, candidate): (usize, Candidate)| {
            let query = Arc::clone(&self.query);
            let late = &late;
            async move {
                if step == Step::Refine && place >= top && late() {
                    return (candidate, None);
                }
                let (work, job) = (self.work, &self.live.job);
                let (candidate, result) = advanced(work, job, Lane::Fine, candidate, query, step, level).await;
                (candidate, Some(result))
            }
        };
        let mut results = stream::iter(going.into_iter().enumerate().map(run)).buffered(self.window());
        let (mut fresh, mut left) = (Vec::new(), Vec::new());
        while let Some((candidate, result)) = results.next().await {
            match result {
                Some(Ok(refined)) => fresh.push(refined),
                Some(Err(error)) if error.stop_reason().is_some() => return Err(error),
                Some(Err(error)) => {
                    self.live.passed_over(candidate.resident.example.id, &error);
                    left.push(candidate);
                }
                None => left.push(candidate),
            }
        }
        let count = fresh.len();
        let mut all = fresh;
        all.extend(left);
        all.extend(passed_over);
        order(&mut all, count, top);
        Ok((all, count))
    }

    /// Tells when a level has had its share of the time; never, if the caller set no deadline.
    fn late_after(&self) -> impl Fn() -> bool + use<> {
        let left = self.live.options.deadline.map(|time| time.saturating_sub(self.live.elapsed()));
        let until = left.map(|left| Instant::now() + left.mul_f64(LEVEL_SHARE));
        move || until.is_some_and(|until| Instant::now() > until)
    }

    /// Marks who goes on to `next`, and publishes.
    fn publish(&self, level: u32, next: Option<u32>, (mut candidates, fresh, ms): Level) {
        let (options, top) = (&self.live.options, self.live.options.top as usize);
        let count = match is_small_part(&self.live.model.segments, self.segment) {
            true => counted_of_part(candidates.len(), top),
            false => candidates.len(),
        };
        let on = next.map(|next| registered_at(count, top, next, options.resolution).min(fresh));
        mark(&mut candidates, level, on, top);
        let timing = LevelTiming { segment: self.segment as u32, level, entries: fresh as u64, ms };
        self.live.publish(self.segment, level, candidates, timing);
    }

    fn stopped(&self) -> Result<(), WorkError> {
        self.live.stop().reason().map_or(Ok(()), |reason| Err(PoolError::Stopped(reason).into()))
    }
}

/// A candidate with its score. NaN scores, which should not be, go last.
fn scored(engine: &dyn Engine, from: Candidate, registration: Registration, query: &Encoding) -> Candidate {
    let score = engine.score(&registration, &from.resident.facts, query, from.resident.example.relevance);
    let score = if score.is_finite() { score } else { f64::MAX };
    let (registration, state) = (Arc::new(registration), EntryState::Refining);
    Candidate { registration, score, state, depth: Depth::Registered, ..from }
}

/// Registers an example at the coarsest level.
fn registered(work: &Work, resident: &Resident, query: &Encoding, stop: &Stop) -> Result<Registration, WorkError> {
    let example = work.catalogue.encoding(resident.example.id, resident.segment, LEVEL_COARSEST)?;
    Ok(work.engine.coarse(&example, query, stop)?)
}

/// What is done with a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Its registration is refined at a level.
    Refine,
    /// Its registration, which has reached the level, is finished.
    Finish,
}

/// Takes a step with one candidate, in a quantum of its own; hands the candidate back for the case that it fails.
pub(super) async fn advanced(
    work: &Arc<Work>,
    job: &Job,
    lane: Lane,
    candidate: Candidate,
    query: Arc<Encoding>,
    step: Step,
    level: u32,
) -> (Candidate, Result<Candidate, WorkError>) {
    let (this, from) = (Arc::clone(work), candidate.clone());
    let quantum = move |stop: &Stop| -> Result<Candidate, WorkError> {
        let (id, segment) = from.key();
        let start = match from.depth {
            Depth::Registered => Arc::clone(&from.registration),
            Depth::Translated => Arc::new(registered(&this, &from.resident, &query, stop)?),
        };
        let registration = match step {
            Step::Refine if level == LEVEL_COARSEST => (*start).clone(),
            Step::Refine => {
                let example = this.catalogue.encoding(id, segment, level)?;
                this.engine.refine(&start, &example, &query, stop)?
            }
            Step::Finish => {
                let example = this.catalogue.pyramid(id, segment, level)?;
                this.engine.finish(&start, &example, &query, stop)?
            }
        };
        Ok(scored(&*this.engine, from, registration, &query))
    };
    let result = work.pool.run(job, lane, quantum).await;
    (candidate, result.map_err(WorkError::from).and_then(|advanced| advanced))
}

/// A candidate registered at every level up to `resolution` and finished; what is so already costs nothing.
pub(super) async fn caught_up(
    work: &Arc<Work>,
    job: &Job,
    lane: Lane,
    mut candidate: Candidate,
    query: &Arc<Encoding>,
    resolution: u32,
) -> Result<Candidate, WorkError> {
    let missed: Vec<u32> = levels_up_to(resolution).filter(|level| *level > candidate.registration.level).collect();
    for level in missed {
        candidate = advanced(work, job, lane, candidate, Arc::clone(query), Step::Refine, level).await.1?;
    }
    advanced(work, job, lane, candidate, Arc::clone(query), Step::Finish, resolution).await.1
}

/// A candidate that the ranking doesn't hold (added meanwhile): registered at the coarsest level.
pub(super) async fn newcomer(
    work: &Arc<Work>,
    job: &Job,
    resident: Arc<Resident>,
    query: Arc<Encoding>,
) -> Result<Candidate, WorkError> {
    let this = Arc::clone(work);
    let quantum = move |stop: &Stop| -> Result<Candidate, WorkError> {
        let registration = registered(&this, &resident, &query, stop)?;
        let from = Candidate {
            resident,
            registration: Arc::new(registration.clone()),
            score: f64::MAX,
            state: EntryState::Refining,
            depth: Depth::Registered,
            likeness: None,
            rough: None,
            lead: None,
            similar_to: None,
        };
        Ok(scored(&*this.engine, from, registration, &query))
    };
    work.pool.run(job, Lane::Lay, quantum).await?
}
