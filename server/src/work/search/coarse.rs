//! The coarsest level: a sweep over the rows of the whole corpus, the best of them exactly, near-duplicates told.
//!
//! *Ours, not the paper's:* everything here but the flips and translations themselves. Only the best [`RANKED_MAX`] become
//! candidates; of the others nothing stays but two numbers each, until the ranking is made.

use super::scattered::RemoteSelection;
use super::siblings::{best_of_each, could_be_kept};
use super::{Level, SegmentSearch, WINDOW_PER_THREAD};
use crate::pool::{Job, Lane, PoolError, Stop};
use crate::work::catalogue::row_blocks::Chunk;
use crate::work::catalogue::{LEVEL_COARSEST, Resident, Snapshot, Stock};
use crate::work::engine::{EngineError, Opaque, Registration};
use crate::work::query::ms_since;
use crate::work::ranking::{Candidate, Depth, RANKED_MAX, REGISTERED_MAX, order};
use crate::work::{Work, WorkError};
use futures_util::{StreamExt, stream};
use quadmuse_kernel::rank::coarse::{Bounds, CoarseQuery, Translation};
use quadmuse_kernel::register::likeness::ReferencePicture;
use quadmuse_kernel::register::spectra::{LANES, Row, SIDE};
use quadmuse_proto::{EntryState, ExampleId, Flip, Share, Topology};
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;
use std::time::Instant;

/// Chunks a quantum of the sweep.
const SWEEP_CHUNKS: usize = 128;
/// Chunks between two looks at the stop flag.
const SWEEP_STEP: usize = 16;
/// Candidates a quantum of the exact ranking.
const EXACT_STEP: usize = 64;
/// Two examples that match at this cost or less, unmirrored, are near-duplicates: one choice.
pub(super) const SIMILAR_COST: f64 = 0.02;
/// Near-duplicates' moduli differ by less than this, in their logarithms.
const SIMILAR_MODULUS_LOG: f64 = 0.05;

/// Chunks with any segment that is wanted, of which topology they are, and which lanes of them are wanted.
pub(super) type Chunks = Vec<(Topology, Arc<Chunk>, u16)>;

/// The part of the corpus that a query segment is ranked against.
#[derive(Clone, Debug, Default)]
pub(super) struct Selection {
    pub(super) chunks: Chunks,
    /// What of it other servers hold in memory, if they hold any.
    elsewhere: Option<RemoteSelection>,
    /// The topologies there are among all of it.
    topologies: Vec<Topology>,
    /// Choices among all of it: segments, an example that is there whole and by its parts once.
    pub(super) size: usize,
}

impl Selection {
    /// The segments of these topologies and stocks whose examples have all the tags.
    pub(super) fn new(snapshot: &Arc<Snapshot>, topologies: &[Topology], stocks: &[Stock], tags: &[String]) -> Self {
        let mut selection = Self::here(snapshot, topologies, stocks, |resident| resident.has_tags(tags));
        let mut seen = HashSet::new();
        let mut shares: BTreeSet<Share> = BTreeSet::new();
        for &topology in topologies {
            for &stock in stocks {
                for resident in snapshot.elsewhere(topology, stock).filter(|r| r.has_tags(tags)) {
                    selection.size += usize::from(!resident.has_siblings() || seen.insert(resident.example.id));
                    shares.extend(snapshot.share().map(|own| own.of_example(resident.example.id)));
                    selection.topologies.push(topology);
                    selection.topologies.dedup();
                }
            }
        }
        if !shares.is_empty() {
            let (snapshot, stocks, tags) = (Arc::clone(snapshot), stocks.to_vec(), tags.to_vec());
            selection.elsewhere = Some(RemoteSelection { snapshot, stocks, tags, shares });
        }
        selection.topologies.sort_unstable();
        selection.topologies.dedup();
        selection
    }

    /// Of what is in memory here, the segments of these topologies and stocks that are wanted.
    pub(super) fn here(
        snapshot: &Snapshot,
        topologies: &[Topology],
        stocks: &[Stock],
        is_wanted: impl Fn(&Resident) -> bool,
    ) -> Self {
        let (mut selection, mut seen) = (Self::default(), HashSet::new());
        let kinds = topologies.iter().flat_map(|&t| stocks.iter().map(move |&stock| (t, stock)));
        let row_blocks = kinds.filter_map(|(t, stock)| Some((t, snapshot.row_blocks(t, stock)?)));
        for (topology, chunk) in row_blocks.flat_map(|(t, blocks)| blocks.chunks().iter().map(move |chunk| (t, chunk)))
        {
            let mut mask = 0u16;
            for (lane, resident) in chunk.residents().iter().enumerate() {
                let Some(resident) = resident.as_ref().filter(|resident| is_wanted(resident)) else { continue };
                mask |= 1 << lane;
                selection.size += usize::from(!resident.has_siblings() || seen.insert(resident.example.id));
            }
            if mask != 0 {
                selection.chunks.push((topology, Arc::clone(chunk), mask));
                selection.topologies.push(topology);
                selection.topologies.dedup();
            }
        }
        selection
    }
}

/// A query prepared for examples of each topology.
pub(super) type Queries = BTreeMap<Topology, CoarseQuery>;

/// A segment among the best, while it is being ranked.
pub(super) struct RankedSegment {
    /// Of one that another server found, only if it is among the best there.
    pub(super) row: Option<Row>,
    pub(super) resident: Arc<Resident>,
    pub(super) translation: Translation,
}

impl SegmentSearch<'_> {
    /// Ranks the selection by translations alone: what is in memory here, and what other servers hold.
    pub(super) async fn coarse(&self, selection: Selection) -> Result<Level, WorkError> {
        let start = Instant::now();
        let (engine, query) = (Arc::clone(&self.work.engine), Arc::clone(&self.query));
        let Selection { chunks, elsewhere, topologies, .. } = selection;
        let prepare = move |_: &Stop| {
            let prepared = topologies.into_iter().map(|t| Ok((t, engine.coarse_query(&query, t)?)));
            prepared.collect::<Result<Queries, EngineError>>().map(Arc::new)
        };
        let query = self.work.pool.run(&self.live.job, Lane::Coarse, prepare).await??;
        let label = self.live.id.to_string();
        let sweeping = Sweeping { work: self.work, job: &self.live.job, label: &label };
        // The others sweep meanwhile.
        let (here, there) = tokio::join!(sweeping.best(chunks, &query), self.gathered(elsewhere, &query));
        let (mut ranked, (there, missing)) = (here?, there?);
        self.live.lacks(self.segment, missing);
        let group = move |stop: &Stop| {
            if !there.is_empty() {
                ranked.extend(there);
                ranked.sort_by(by_score);
                ranked.truncate(RANKED_MAX);
            }
            let similar = grouped(&ranked, stop);
            ranked.into_iter().zip(similar).map(|(ranked, similar)| candidate(ranked, similar)).collect::<Vec<_>>()
        };
        let mut candidates = self.work.pool.run(&self.live.job, Lane::Coarse, group).await?;
        self.stopped()?;
        let fresh = candidates.len();
        order(&mut candidates, fresh, self.live.options.top as usize);
        Ok((candidates, fresh, ms_since(start)))
    }
}

fn by_score(a: &RankedSegment, b: &RankedSegment) -> Ordering {
    let by_score = a.translation.score.total_cmp(&b.translation.score);
    by_score.then_with(|| a.resident.tie_break().cmp(&b.resident.tie_break()))
}

/// A sweep over what is in memory here.
pub(super) struct Sweeping<'a> {
    pub(super) work: &'a Arc<Work>,
    pub(super) job: &'a Job,
    /// For whom, in the log.
    pub(super) label: &'a str,
}

impl Sweeping<'_> {
    /// The best of these chunks, best first, of each example with siblings one.
    pub(super) async fn best(&self, chunks: Chunks, query: &Arc<Queries>) -> Result<Vec<RankedSegment>, WorkError> {
        let chunks = Arc::new(chunks);
        let bounds = self.swept(&chunks, query).await?;
        let select = {
            let chunks = Arc::clone(&chunks);
            let owner = move |place: usize| {
                let resident = chunks.get(place / LANES)?.1.residents()[place % LANES].as_ref()?;
                resident.has_siblings().then_some(resident.example.id)
            };
            move |_: &Stop| could_be_kept(&bounds, RANKED_MAX, owner)
        };
        let places = self.work.pool.run(self.job, Lane::Coarse, select).await?;
        let mut ranked = self.exact(&chunks, places, query).await?;
        let sort = move |_: &Stop| {
            ranked.sort_by(by_score);
            best_of_each(&mut ranked);
            ranked.truncate(RANKED_MAX);
            ranked
        };
        Ok(self.work.pool.run(self.job, Lane::Coarse, sort).await?)
    }

    fn window(&self) -> usize {
        WINDOW_PER_THREAD * self.work.pool.threads()
    }

    fn stopped(&self) -> Result<(), WorkError> {
        self.job.stop().reason().map_or(Ok(()), |reason| Err(PoolError::Stopped(reason).into()))
    }

    /// Bounds for every lane of every chunk.
    async fn swept(&self, chunks: &Arc<Chunks>, query: &Arc<Queries>) -> Result<Vec<Bounds>, WorkError> {
        let run = |from: usize| {
            let (chunks, query) = (Arc::clone(chunks), Arc::clone(query));
            let to = (from + SWEEP_CHUNKS).min(chunks.len());
            let quantum = move |stop: &Stop| -> Vec<Bounds> {
                let steps = chunks[from..to].chunks(SWEEP_STEP).take_while(|_| stop.reason().is_none());
                steps.flatten().flat_map(|(topology, chunk, mask)| sweep(chunk, *mask, query.get(topology))).collect()
            };
            self.work.pool.run(self.job, Lane::Coarse, quantum)
        };
        let starts = (0..chunks.len()).step_by(SWEEP_CHUNKS);
        let mut results = stream::iter(starts.clone().map(run)).buffered(self.window());
        let mut bounds = Vec::with_capacity(chunks.len() * LANES);
        for from in starts {
            match results.next().await {
                Some(Ok(swept)) => bounds.extend(swept),
                Some(Err(PoolError::Panicked { message })) => {
                    tracing::error!(query = self.label, %message, "a sweep panicked; its chunks are left out");
                }
                Some(Err(error)) => return Err(error.into()),
                None => {}
            }
            bounds.resize((from + SWEEP_CHUNKS).min(chunks.len()) * LANES, Bounds::NONE);
        }
        self.stopped()?;
        Ok(bounds)
    }

    /// The exact scores of those places.
    async fn exact(
        &self,
        chunks: &Arc<Chunks>,
        places: Vec<usize>,
        query: &Arc<Queries>,
    ) -> Result<Vec<RankedSegment>, WorkError> {
        let run = |places: Vec<usize>| {
            let (chunks, query) = (Arc::clone(chunks), Arc::clone(query));
            let quantum = move |stop: &Stop| -> Vec<RankedSegment> {
                let places = places.into_iter().take_while(|_| stop.reason().is_none());
                let one = |place: usize| {
                    let (topology, chunk, _) = chunks.get(place / LANES)?;
                    let (row, resident) = chunk.row(place % LANES)?;
                    let translation =
                        query.get(topology)?.translation(&row, resident.facts.shape(), resident.example.relevance)?;
                    Some(RankedSegment { row: Some(row), resident: Arc::clone(resident), translation })
                };
                places.filter_map(one).collect()
            };
            self.work.pool.run(self.job, Lane::Coarse, quantum)
        };
        let quanta: Vec<Vec<usize>> = places.chunks(EXACT_STEP).map(<[usize]>::to_vec).collect();
        let mut results = stream::iter(quanta.into_iter().map(run)).buffered(self.window());
        let mut ranked = Vec::with_capacity(places.len());
        while let Some(quantum) = results.next().await {
            ranked.extend(quantum?);
        }
        self.stopped()?;
        Ok(ranked)
    }
}

fn sweep(chunk: &Chunk, mask: u16, query: Option<&CoarseQuery>) -> [Bounds; LANES] {
    let Some(query) = query else { return [Bounds::NONE; LANES] };
    let (mut facts, mut relevance) = (*chunk.facts(), [0.0; LANES]);
    for (lane, resident) in chunk.residents().iter().enumerate() {
        match resident {
            Some(resident) if mask >> lane & 1 == 1 => relevance[lane] = resident.example.relevance,
            _ => facts[lane] = None,
        }
    }
    query.sweep(chunk.block(), &facts, &relevance)
}

/// For each of the best that could go on, a better one that it nearly duplicates; those above themselves are none.
fn grouped(ranked: &[RankedSegment], stop: &Stop) -> Vec<Option<(ExampleId, u32)>> {
    let mut similar = vec![None; ranked.len()];
    let mut choices: Vec<usize> = Vec::new();
    // Whoever is among the best of all is among the best of its share, and has its row.
    let rows: Vec<&Row> = ranked.iter().take(REGISTERED_MAX).map_while(|r| r.row.as_ref()).collect();
    let all: Vec<ReferencePicture> = rows.iter().map(|row| ReferencePicture::new(row)).collect();
    for k in 0..all.len() {
        if stop.reason().is_some() {
            break;
        }
        let is_like = |&&other: &&usize| {
            let (a, b) = (&ranked[k], &ranked[other]);
            let ratio = (a.resident.facts.k / b.resident.facts.k).ln().abs();
            (ratio < SIMILAR_MODULUS_LOG || ratio.is_nan()) && all[k].matches(rows[other], &all[other], SIMILAR_COST)
        };
        match choices.iter().find(is_like) {
            Some(&other) => similar[k] = Some((ranked[other].resident.example.id, ranked[other].resident.segment)),
            None => choices.push(k),
        }
    }
    similar
}

fn candidate(ranked: RankedSegment, similar_to: Option<(ExampleId, u32)>) -> Candidate {
    let RankedSegment { resident, translation, .. } = ranked;
    let registration = Registration {
        level: LEVEL_COARSEST,
        energy: translation.energy,
        flip: Flip { u: translation.flip.u, v: translation.flip.v },
        shift_u: translation.shift as f64 / SIDE as f64,
        inner: Opaque::new(translation),
    };
    // NaN scores, which should not be, go last.
    let score = if translation.score.is_finite() { translation.score } else { f64::MAX };
    let (registration, state) = (Arc::new(registration), EntryState::Refining);
    Candidate {
        resident,
        registration,
        score,
        state,
        depth: Depth::Translated,
        likeness: None,
        rough: None,
        lead: None,
        similar_to,
    }
}
