//! A query while it is ranked, and after: what is known of it, and the board on which its newest ranking stands.
//!
//! The board is a `watch` channel: whoever computes writes the newest state over the older one and waits for nobody;
//! whoever reads sees the newest, and is woken when it changes.

use super::composing::LiveComposition;
use super::corpus::CorpusError;
use super::engine::{Encoded, Model};
use super::ingest::counts_of;
use super::making::Makings;
use super::mapping::LiveMap;
use super::naming::Names;
use super::ranking::{Candidate, entries, levels_up_to, template_entry, turns};
use super::worth::tries;
use super::{Caller, WorkError};
use crate::pool::{Job, Stop};
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::{
    Begin, CompositionId, End, EndState, Entry, EntryState, ExampleId, LevelTiming, MapId, MeshCounts, Progress, Query,
    QueryId, QuerySegment, QueryState, QueryTimings, Ranking, Retopo, RetopoId, Share,
};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant, UNIX_EPOCH};
use tokio::sync::watch;

/// Most maps a query.
pub const MAPS_MAX: usize = 256;

/// What a caller asks of a query.
#[derive(Clone, Debug)]
pub struct QueryOptions {
    /// Entries a segment that go on to the full resolution.
    pub top: u32,
    /// The finest level, in pixels a side.
    pub resolution: u32,
    /// When it must end, counted from the upload.
    pub deadline: Option<Duration>,
    /// Only examples with all these tags are ranked.
    pub tags: Vec<String>,
    /// The input is cut as this example is.
    pub like: Option<ExampleId>,
}

/// A query.
pub struct LiveQuery {
    /// Its id.
    pub id: QueryId,
    /// Who posted it.
    pub caller: Caller,
    /// What was asked.
    pub options: QueryOptions,
    /// The input.
    pub model: Arc<Model>,
    /// Its segments, each once it is encoded.
    pub encoded: Vec<OnceLock<Arc<Encoded>>>,
    /// Its maps.
    pub maps: Mutex<BTreeMap<MapId, Arc<LiveMap>>>,
    /// What its segments are called.
    pub names: Names,
    /// What is made of it.
    pub makings: Makings,
    /// Its compositions.
    pub compositions: Mutex<BTreeMap<CompositionId, Arc<LiveComposition>>>,
    /// Its retopologies.
    pub retopos: Mutex<BTreeMap<RetopoId, Arc<Retopo>>>,
    /// Its computation: dropped with it, which stops what is under way.
    pub job: Job,
    counts: MeshCounts,
    started: Instant,
    board: watch::Sender<Board>,
    end_was_streamed: AtomicBool,
}

/// Where a query stands; cheap to clone.
#[derive(Clone, Debug)]
pub struct Board {
    /// Its state.
    pub state: QueryState,
    /// Whether its deadline ended it.
    pub deadline_reached: bool,
    /// The revision of its newest ranking.
    pub revision: u64,
    /// The newest ranking of each segment.
    pub rankings: Vec<Arc<SegmentRanking>>,
    /// Where its time went.
    pub timings: QueryTimings,
    /// Why it failed.
    pub failure: Option<Arc<WorkError>>,
}

/// The newest ranking of a segment; revision and level are 0 before the first.
#[derive(Clone, Debug, Default)]
pub struct SegmentRanking {
    /// Its revision.
    pub revision: u64,
    /// The level just ranked, in pixels a side.
    pub level: u32,
    /// The best candidates, best first: all of a small corpus.
    pub candidates: Vec<Candidate>,
    /// Corpus segments it is ranked against.
    pub corpus_size: u64,
    /// Shares of the corpus that no server answered for.
    pub incomplete: Vec<Share>,
}

impl LiveQuery {
    /// A query that was read and cut. `read_ms` is the time that took; `started` when the upload was there.
    pub fn new(
        id: QueryId,
        caller: Caller,
        options: QueryOptions,
        model: Arc<Model>,
        job: Job,
        started: Instant,
    ) -> Self {
        let (count, counts) = (model.segments.len(), counts_of(&model.mesh));
        let timings = QueryTimings { read_ms: ms_since(started), ..QueryTimings::default() };
        let board = Board {
            state: QueryState::Queued,
            deadline_reached: false,
            revision: 0,
            rankings: vec![Arc::default(); count],
            timings,
            failure: None,
        };
        Self {
            id,
            caller,
            options,
            model,
            encoded: (0..count).map(|_| OnceLock::new()).collect(),
            maps: Mutex::default(),
            names: Names::default(),
            makings: Makings::default(),
            compositions: Mutex::default(),
            retopos: Mutex::default(),
            job,
            counts,
            started,
            board: watch::Sender::new(board),
            end_was_streamed: AtomicBool::new(false),
        }
    }

    /// A stream told somebody of its end.
    pub fn end_was_streamed(&self) -> bool {
        self.end_was_streamed.load(Ordering::Relaxed)
    }

    /// Its stop flag.
    pub fn stop(&self) -> &Stop {
        self.job.stop()
    }

    /// The input mesh.
    pub fn mesh(&self) -> &Arc<PolyMesh> {
        &self.model.mesh
    }

    /// Time since the upload.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Milliseconds since the upload.
    pub fn elapsed_ms(&self) -> f64 {
        ms_since(self.started)
    }

    /// Logs why the query goes on without an example. That it was removed meanwhile is nothing to look into.
    pub fn passed_over(&self, example: ExampleId, error: &WorkError) {
        match error {
            WorkError::Corpus(CorpusError::NotFound(_)) => {
                tracing::debug!(query = %self.id, %example, %error, "passed over")
            }
            _ => tracing::error!(query = %self.id, %example, %error, "passed over"),
        }
    }

    /// The board, to be read and waited for.
    pub fn watch(&self) -> watch::Receiver<Board> {
        self.board.subscribe()
    }

    /// The board as it stands.
    pub fn board(&self) -> Board {
        self.board.borrow().clone()
    }

    /// Whether nothing more will change by itself.
    pub fn is_final(&self) -> bool {
        self.board.borrow().state.is_final()
    }

    /// Time since its end; `None` while it goes on.
    pub fn ended_since(&self) -> Option<Duration> {
        let board = self.board.borrow();
        let total = Duration::try_from_secs_f64(board.timings.total_ms / 1e3).unwrap_or_default();
        board.state.is_final().then(|| self.elapsed().saturating_sub(total))
    }

    /// Writes on the board, unless the query has ended.
    pub fn update(&self, change: impl FnOnce(&mut Board)) {
        self.board.send_if_modified(|board| {
            let open = !board.state.is_final();
            if open {
                change(board);
            }
            open
        });
    }

    /// Sets corpus sizes before the first ranking.
    pub fn set_corpus_sizes(&self, sizes: &[u64]) {
        self.update(|board| {
            for (ranking, &corpus_size) in board.rankings.iter_mut().zip(sizes) {
                *ranking = Arc::new(SegmentRanking { corpus_size, ..SegmentRanking::default() });
            }
        });
    }

    /// Notes which shares of the corpus a segment's ranking is without, before its first one.
    pub fn lacks(&self, segment: usize, incomplete: Vec<Share>) {
        if incomplete.is_empty() {
            return;
        }
        self.update(|board| {
            if let Some(slot) = board.rankings.get_mut(segment) {
                *slot = Arc::new(SegmentRanking { incomplete, ..SegmentRanking::clone(slot) });
            }
        });
    }

    /// Publishes a segment's ranking at a level.
    pub fn publish(&self, segment: usize, level: u32, candidates: Vec<Candidate>, timing: LevelTiming) {
        let first = self.elapsed_ms();
        self.update(|board| {
            board.timings.first_ranking_ms.get_or_insert(first);
            board.timings.levels.push(timing);
            board.put_ranking(segment, level, candidates);
        });
    }

    /// Puts a resumed candidate into a segment's ranking, also after the end.
    pub fn publish_resumed(&self, segment: usize, resumed: Candidate) {
        self.board.send_modify(|board| {
            if let Some(old) = board.rankings.get(segment) {
                let (level, mut candidates) = (old.level, old.candidates.clone());
                super::ranking::resume(&mut candidates, resumed, self.options.top as usize);
                board.put_ranking(segment, level, candidates);
            }
        });
    }

    /// Ends the query.
    pub fn end(&self, state: QueryState, deadline_reached: bool, failure: Option<WorkError>) {
        let total_ms = self.elapsed_ms();
        self.update(|board| {
            board.state = state;
            board.deadline_reached = deadline_reached;
            board.failure = failure.map(Arc::new);
            board.timings.total_ms = total_ms;
        });
        self.job.rest();
    }

    /// Waits until `is_there` finds something on the board, or the query has ended.
    pub async fn wait_for(&self, mut is_there: impl FnMut(&Board) -> bool) -> Board {
        let mut watch = self.watch();
        let found = watch.wait_for(|board| board.state.is_final() || is_there(board)).await;
        // The sender lives as long as the query does, and so do we.
        found.map(|board| board.clone()).unwrap_or_else(|_| self.board())
    }

    /// A segment, encoded: waits for it.
    ///
    /// # Errors
    /// [`WorkError::NoSuchSegment`], [`WorkError::QueryEnded`] when it will never be encoded.
    pub async fn encoded(&self, segment: u32) -> Result<Arc<Encoded>, WorkError> {
        let slot = self.slot(segment)?;
        let board = self.wait_for(|_| slot.get().is_some()).await;
        slot.get().cloned().ok_or(WorkError::QueryEnded { state: board.state.as_str() })
    }

    /// Checks that there is such a segment.
    ///
    /// # Errors
    /// [`WorkError::NoSuchSegment`].
    pub fn check_segment(&self, segment: u32) -> Result<(), WorkError> {
        self.slot(segment).map(drop)
    }

    fn slot(&self, segment: u32) -> Result<&OnceLock<Arc<Encoded>>, WorkError> {
        let (of, count) = ("the query", self.encoded.len());
        self.encoded.get(segment as usize).ok_or(WorkError::NoSuchSegment { of, count, segment })
    }

    /// The query as it goes over the wire; why it failed is left for those to say who know statuses.
    pub fn describe(&self) -> Query {
        let board = self.board();
        let mut timings = board.timings.clone();
        if !board.state.is_final() {
            timings.total_ms = self.elapsed_ms();
        }
        let segments: Vec<QuerySegment> =
            (0..self.encoded.len()).filter_map(|s| self.describe_segment(s, &board)).collect();
        let levels = levels_up_to(self.options.resolution).count() * self.encoded.len();
        let done: BTreeSet<(u32, u32)> = timings.levels.iter().map(|timing| (timing.segment, timing.level)).collect();
        let progress = Progress {
            segments_encoded: self.encoded.iter().filter(|slot| slot.get().is_some()).count() as u32,
            segments: self.encoded.len() as u32,
            // The sweep before the coarsest level and finishing the best at the last are steps more of these.
            levels_done: done.len() as u32,
            levels: levels as u32,
        };
        Query {
            id: self.id,
            state: board.state,
            deadline_reached: board.deadline_reached,
            top: self.options.top,
            resolution: self.options.resolution,
            deadline_ms: self.options.deadline.map(|time| time.as_millis() as u64),
            tags: self.options.tags.clone(),
            counts: self.counts,
            repairs: self.repairs(),
            waist: self.model.is_waist,
            segments,
            progress,
            timings,
            revision: board.revision,
            corpus_size: board.corpus_size(),
            incomplete: board.incomplete(),
            created: rfc3339(self.id.created_unix_ms()),
            problem: None,
            making: Vec::new(),
        }
    }

    /// What reading mended, and what unfolding did in the segments encoded so far.
    fn repairs(&self) -> Vec<String> {
        let unfolding = self.encoded.iter().filter_map(|slot| slot.get()).flat_map(|encoded| &encoded.repairs);
        self.model.repairs.iter().chain(unfolding).cloned().collect()
    }

    fn describe_segment(&self, segment: usize, board: &Board) -> Option<QuerySegment> {
        let (known, ranking) = (self.model.segments.get(segment)?, board.rankings.get(segment)?);
        let facts = self.encoded.get(segment)?.get().map(|encoded| encoded.encoding.facts);
        Some(QuerySegment {
            segment: segment as u32,
            name: self.names.of(segment as u32),
            topology: known.topology,
            faces: known.faces,
            holes: known.holes,
            tries: tries(&self.model.segments, segment) as u32,
            k: facts.map(|facts| facts.k),
            features: facts.map(|facts| facts.features),
            level: (ranking.level > 0).then_some(ranking.level),
            corpus_size: ranking.corpus_size,
        })
    }

    /// A segment's ranking as it goes over the wire.
    ///
    /// # Errors
    /// [`WorkError::NoSuchSegment`].
    pub fn ranking(&self, board: &Board, segment: u32, limit: usize) -> Result<Ranking, WorkError> {
        let (of, count) = ("the query", board.rankings.len());
        let ranking = board.rankings.get(segment as usize).ok_or(WorkError::NoSuchSegment { of, count, segment })?;
        let mut shown = self.entries(board, segment, &ranking.candidates, limit);
        // Nobody goes away empty-handed: the regular layout stands last, once there is a ranking, where all are shown.
        if ranking.revision > 0 && shown.len() == ranking.candidates.len() && shown.len() < limit {
            let topology = self.model.segments.get(segment as usize).map(|s| s.topology);
            shown.extend(topology.map(|topology| template_entry(&shown, topology)));
        }
        Ok(Ranking {
            query: self.id,
            segment,
            segment_name: self.names.of(segment),
            revision: ranking.revision,
            level: ranking.level,
            resolution: self.options.resolution,
            state: board.state,
            entries: shown,
            corpus_size: ranking.corpus_size,
            incomplete: ranking.incomplete.clone(),
        })
    }

    /// The candidates of a segment that are laid where nobody chooses, in turn until one fits.
    pub fn turns(&self, segment: u32, candidates: &[Candidate], tries: usize) -> Vec<(ExampleId, u32)> {
        let is_flat = self.model.segments.get(segment as usize).is_some_and(|s| s.is_flat);
        turns(candidates, tries, is_flat)
    }

    /// Entries as they go over the wire: once the query has ended nothing goes on by itself any more.
    fn entries(&self, board: &Board, segment: u32, candidates: &[Candidate], limit: usize) -> Vec<Entry> {
        let turns = self.turns(segment, candidates, tries(&self.model.segments, segment as usize));
        let mut entries = entries(candidates, limit, &turns);
        if board.state.is_final() {
            let going = entries.iter_mut().filter(|entry| entry.state == EntryState::Refining);
            going.for_each(|entry| entry.state = EntryState::Locked);
        }
        entries
    }

    /// The first event of its stream.
    pub fn begin(&self) -> Begin {
        let (segments, resolution) = (self.encoded.len() as u32, self.options.resolution);
        Begin { query: self.id, segments, resolution, corpus_size: self.board.borrow().corpus_size() }
    }

    /// The last event of its stream; `None` while it goes on.
    pub fn ending(&self, board: &Board) -> Option<End> {
        let state = match (board.state, board.deadline_reached) {
            (QueryState::Done, true) => EndState::Deadline,
            (QueryState::Done, false) => EndState::Done,
            (QueryState::Cancelled, _) => EndState::Cancelled,
            (QueryState::Failed, _) => EndState::Failed,
            (QueryState::Queued | QueryState::Encoding | QueryState::Ranking, _) => return None,
        };
        self.end_was_streamed.store(true, Ordering::Relaxed);
        Some(End { query: self.id, state, revision: board.revision, summary: self.describe() })
    }

    /// Its maps, locked.
    pub fn maps(&self) -> MutexGuard<'_, BTreeMap<MapId, Arc<LiveMap>>> {
        self.maps.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Its retopologies, locked.
    pub fn retopos(&self) -> MutexGuard<'_, BTreeMap<RetopoId, Arc<Retopo>>> {
        self.retopos.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Its compositions, locked.
    pub fn compositions(&self) -> MutexGuard<'_, BTreeMap<CompositionId, Arc<LiveComposition>>> {
        self.compositions.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Board {
    /// Corpus segments, all the query's segments together.
    pub fn corpus_size(&self) -> u64 {
        self.rankings.iter().map(|ranking| ranking.corpus_size).sum()
    }

    /// Shares of the corpus that the ranking of one segment at least is without.
    fn incomplete(&self) -> Vec<Share> {
        let all: BTreeSet<Share> =
            self.rankings.iter().flat_map(|ranking| ranking.incomplete.iter().copied()).collect();
        all.into_iter().collect()
    }

    fn put_ranking(&mut self, segment: usize, level: u32, candidates: Vec<Candidate>) {
        if let Some(slot) = self.rankings.get_mut(segment) {
            self.revision += 1;
            let (revision, corpus_size, incomplete) = (self.revision, slot.corpus_size, slot.incomplete.clone());
            *slot = Arc::new(SegmentRanking { revision, level, candidates, corpus_size, incomplete });
        }
    }
}

/// Milliseconds since `start`.
pub fn ms_since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// A time in milliseconds since 1970 as RFC 3339, UTC.
pub fn rfc3339(unix_ms: u64) -> String {
    humantime::format_rfc3339_millis(UNIX_EPOCH + Duration::from_millis(unix_ms)).to_string()
}
