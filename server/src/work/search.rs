//! Queries: an input mesh is cut, encoded and ranked against one snapshot of the corpus, level by level.
//!
//! *Source:* paper §5.2; METHOD §5–6. Every segment is ranked at the coarsest level against the entire corpus first;
//! then, a level at a time, the best half is refined, until the best `top` reach the resolution asked for. Each level
//! of each segment publishes a whole ranking. The result doesn't depend on the number of threads: each registration is
//! a sequential computation of its own, and the results are combined in the order of the candidates.

use super::catalogue::{LEVEL_COARSEST, Resident};
use super::engine::{Encoding, Engine, Registration};
use super::ingest::{self, Upload, encode, normal_tags};
use super::query::{LiveQuery, QueryOptions, ms_since};
use super::ranking::{Candidate, levels_up_to, mark, order, registered_at};
use super::{Caller, REQUEST_TIME_MAX, Work, WorkError};
use crate::pool::{Job, Lane, PoolError, Stop, StopReason};
use futures_util::{StreamExt, stream};
use quadmuse_proto::query::{DEADLINE_MS_MAX, LEVELS, TOP_MAX};
use quadmuse_proto::{EntryState, LevelTiming, QueryId, QueryState, Topology};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Corpus segments a quantum of the coarse level.
const COARSE_CHUNK: usize = 128;

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
    let reading = loop {
        match work.pool.admit(caller.user, estimate, Some(REQUEST_TIME_MAX)) {
            Err(PoolError::Overloaded { .. }) if work.queries.make_room() => {}
            admitted => break admitted?,
        }
    };
    let model = ingest::read(work, &reading, Lane::Coarse, &upload).await?;
    let time = options.deadline.unwrap_or(QUERY_TIME_MAX).saturating_sub(started.elapsed());
    let job = reading.renew(Some(time));
    let snapshot = work.catalogue.snapshot();
    let corpus: Vec<Vec<Arc<Resident>>> =
        model.segments.iter().map(|s| snapshot.segments_of(s.topology, &options.tags)).collect();
    // A segment for which there is no example takes a regular layout; a corpus without any is a mistake to be told.
    let any = TOPOLOGIES.into_iter().any(|t| !snapshot.segments_of(t, &options.tags).is_empty());
    if !any {
        let mut wanted: Vec<&str> = model.segments.iter().map(|s| s.topology.as_str()).collect();
        wanted.sort_unstable();
        wanted.dedup();
        let tags = if options.tags.is_empty() { String::new() } else { format!(" and tags {:?}", options.tags) };
        return Err(WorkError::CorpusEmpty { wanted: format!("of topology {}{tags}", wanted.join(" or ")) });
    }
    let live = Arc::new(LiveQuery::new(caller, options, model, job, started));
    live.set_corpus_sizes(&corpus.iter().map(|c| c.len() as u64).collect::<Vec<_>>());
    work.queries.insert(Arc::clone(&live))?;
    work.background.spawn(run(Arc::clone(work), Arc::clone(&live), corpus));
    Ok(live)
}

/// Cancels a query and frees it.
///
/// # Errors
/// [`WorkError::NoSuchQuery`].
pub fn cancel(work: &Work, id: QueryId) -> Result<(), WorkError> {
    let live = work.queries.remove(id)?;
    live.stop().cancel();
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

/// Ranks a query and writes how it ended on its board.
async fn run(work: Arc<Work>, live: Arc<LiveQuery>, corpus: Vec<Vec<Arc<Resident>>>) {
    match rank_all(&work, &live, corpus).await {
        Ok(()) => live.end(QueryState::Done, false, None),
        Err(error) => match error.stop_reason() {
            Some(StopReason::Cancelled) => live.end(QueryState::Cancelled, false, None),
            Some(StopReason::Deadline) => live.end(QueryState::Done, true, None),
            None => {
                tracing::warn!(query = %live.id, %error, "query failed");
                live.end(QueryState::Failed, false, Some(error));
            }
        },
    }
    tracing::info!(query = %live.id, state = live.board().state.as_str(), ms = live.elapsed_ms(), "query ended");
}

async fn rank_all(work: &Arc<Work>, live: &Arc<LiveQuery>, corpus: Vec<Vec<Arc<Resident>>>) -> Result<(), WorkError> {
    encode_segments(work, live).await?;
    let resolution = live.options.resolution;
    let mut searches: Vec<SegmentSearch<'_>> = Vec::new();
    for (segment, corpus) in corpus.into_iter().enumerate() {
        let query = live.encoded(segment as u32).await?;
        let search = SegmentSearch { work, live, segment, query: Arc::new(query.encoding.clone()) };
        let candidates = search.coarse(corpus).await?;
        search.publish(LEVEL_COARSEST, candidates);
        searches.push(search);
    }
    for level in levels_up_to(resolution).filter(|level| *level > LEVEL_COARSEST) {
        for search in &mut searches {
            let start = Instant::now();
            let (candidates, fresh) = search.each(Step::Refine, level).await?;
            search.publish(level, (candidates, fresh, ms_since(start)));
        }
    }
    for search in &mut searches {
        let start = Instant::now();
        let (candidates, fresh) = search.each(Step::Finish, resolution).await?;
        search.publish(resolution, (candidates, fresh, ms_since(start)));
    }
    Ok(())
}

async fn encode_segments(work: &Arc<Work>, live: &Arc<LiveQuery>) -> Result<(), WorkError> {
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
    futures_util::future::try_join_all((0..live.encoded.len()).map(one)).await?;
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

    /// Registers the whole corpus at the coarsest level.
    async fn coarse(&self, corpus: Vec<Arc<Resident>>) -> Result<Level, WorkError> {
        let start = Instant::now();
        let chunks: Vec<Vec<Arc<Resident>>> = corpus.chunks(COARSE_CHUNK).map(<[_]>::to_vec).collect();
        let run = |chunk: Vec<Arc<Resident>>| {
            let (engine, query) = (Arc::clone(&self.work.engine), Arc::clone(&self.query));
            let quantum = move |stop: &Stop| -> Vec<Candidate> {
                let register = |resident: Arc<Resident>| coarse_candidate(&*engine, resident, &query, stop);
                chunk.into_iter().filter_map(register).collect()
            };
            self.work.pool.run(&self.live.job, Lane::Coarse, quantum)
        };
        let mut results = stream::iter(chunks.into_iter().map(run)).buffered(self.window());
        let mut candidates = Vec::new();
        while let Some(chunk) = results.next().await {
            match chunk {
                Ok(chunk) => candidates.extend(chunk),
                Err(PoolError::Panicked { message }) => {
                    tracing::error!(query = %self.live.id, %message, "a coarse registration panicked; its chunk is left out");
                }
                Err(error) => return Err(error.into()),
            }
        }
        self.stopped()?;
        let fresh = candidates.len();
        order(&mut candidates, fresh);
        Ok((candidates, fresh, ms_since(start)))
    }

    /// Takes a step with the best of the newest ranking; the rest stay as they are.
    async fn each(&self, step: Step, level: u32) -> Result<(Vec<Candidate>, usize), WorkError> {
        let newest = self.live.board().rankings.get(self.segment).cloned().unwrap_or_default();
        let mut candidates = newest.candidates.clone();
        let goes_on = match step {
            Step::Refine => candidates.partition_point(|c| c.state == EntryState::Refining),
            Step::Finish => {
                let reached = candidates.partition_point(|c| c.registration.level == level);
                reached.min(self.live.options.top as usize)
            }
        };
        let run = |candidate: Candidate| {
            let query = Arc::clone(&self.query);
            advanced(self.work, &self.live.job, Lane::Fine, candidate, query, step, level)
        };
        let passed_over = candidates.split_off(goes_on);
        let mut results = stream::iter(candidates.into_iter().map(run)).buffered(self.window());
        let (mut fresh, mut left) = (Vec::new(), Vec::new());
        while let Some((candidate, result)) = results.next().await {
            match result {
                Ok(refined) => fresh.push(refined),
                Err(error) if error.stop_reason().is_some() => return Err(error),
                Err(error) => {
                    let example = candidate.resident.example.id;
                    tracing::error!(query = %self.live.id, %example, level, %error, "not refined");
                    left.push(candidate);
                }
            }
        }
        let count = fresh.len();
        let mut all = fresh;
        all.extend(left);
        all.extend(passed_over);
        order(&mut all, count);
        Ok((all, count))
    }

    /// Marks who goes on, and publishes.
    fn publish(&self, level: u32, (mut candidates, fresh, ms): Level) {
        let options = &self.live.options;
        let next = LEVELS.into_iter().find(|next| *next > level && *next <= options.resolution);
        let on =
            next.map(|next| registered_at(candidates.len(), options.top as usize, next, options.resolution).min(fresh));
        mark(&mut candidates, level, on);
        let timing = LevelTiming { segment: self.segment as u32, level, entries: fresh as u64, ms };
        self.live.publish(self.segment, level, candidates, timing);
    }

    fn stopped(&self) -> Result<(), WorkError> {
        self.live.stop().reason().map_or(Ok(()), |reason| Err(PoolError::Stopped(reason).into()))
    }
}

fn coarse_candidate(engine: &dyn Engine, resident: Arc<Resident>, query: &Encoding, stop: &Stop) -> Option<Candidate> {
    let registration = engine.coarse(&resident.coarse, query, stop);
    let registration = registration
        .inspect_err(|error| {
            if stop.reason().is_none() {
                tracing::error!(example = %resident.example.id, %error, "not ranked");
            }
        })
        .ok()?;
    Some(scored(engine, resident, registration, query))
}

/// A candidate with its score. NaN scores, which should not be, go last.
fn scored(engine: &dyn Engine, resident: Arc<Resident>, registration: Registration, query: &Encoding) -> Candidate {
    let score = engine.score(&registration, &resident.coarse, query, resident.example.relevance);
    let score = if score.is_finite() { score } else { f64::MAX };
    Candidate { resident, registration: Arc::new(registration), score, state: EntryState::Refining }
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
        let Candidate { resident, registration, .. } = from;
        let (id, segment) = (resident.example.id, resident.segment);
        let registration = match step {
            Step::Refine => {
                let example = this.catalogue.encoding(id, segment, level)?;
                this.engine.refine(&registration, &example, &query, level, stop)?
            }
            Step::Finish => {
                let example = this.catalogue.pyramid(id, segment, level)?;
                this.engine.finish(&registration, &example, &query, stop)?
            }
        };
        Ok(scored(&*this.engine, resident, registration, &query))
    };
    let result = work.pool.run(job, lane, quantum).await;
    (candidate, result.map_err(WorkError::from).and_then(|advanced| advanced))
}

/// A candidate that the ranking doesn't hold (added meanwhile): registered at the coarsest level.
pub(super) async fn newcomer(
    work: &Arc<Work>,
    job: &Job,
    resident: Arc<Resident>,
    query: Arc<Encoding>,
) -> Result<Candidate, WorkError> {
    let engine = Arc::clone(&work.engine);
    let quantum = move |stop: &Stop| -> Result<Candidate, WorkError> {
        let registration = engine.coarse(&resident.coarse, &query, stop)?;
        Ok(scored(&*engine, resident, registration, &query))
    };
    work.pool.run(job, Lane::Edit, quantum).await?
}
