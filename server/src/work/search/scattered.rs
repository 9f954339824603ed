//! The coarse ranking over several servers, each of which holds a share of the pictures in memory.
//!
//! Whoever ranks a query asks one holder of each other share for the best of it, and merges them with its own: since an
//! example is of one share with all its segments, the best of all are the best of what each share gives, bit for bit as if
//! one server held everything. The spectra of the query go there as they are, in f64. What nobody answers for is told.

use super::SegmentSearch;
use super::coarse::{Queries, RankedSegment, Selection, Sweeping};
use crate::pool::{PoolError, User};
use crate::work::catalogue::{Snapshot, Stock};
use crate::work::engine::kernel::topology_in;
use crate::work::ranking::REGISTERED_MAX;
use crate::work::{REQUEST_TIME_MAX, Work, WorkError};
use bytes::Bytes;
use futures_util::future::join_all;
use quadmuse_kernel::rank::SegmentShape;
use quadmuse_kernel::rank::coarse::{CoarseQuery, Translation};
use quadmuse_kernel::register::Flip;
use quadmuse_kernel::register::spectra::{Row, Spectrum, VALUES};
use quadmuse_proto::{ExampleId, Share, Topology};
use serde::{Deserialize, Serialize};
use serde_bytes::ByteBuf;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// Longest wait for changes that the asking server knows of and this one does not yet.
const CATCH_UP_MAX: Duration = Duration::from_secs(2);

/// Most choices of poles in a question; a query has some ten.
const PICTURES_MAX: usize = 256;

/// Memory of an answer beside the sweep's own, in bytes: the best with their rows, twice.
const ANSWER_BYTES: u64 = 4 << 20;

/// The part of a selection that other servers hold.
#[derive(Clone, Debug)]
pub(super) struct RemoteSelection {
    /// The corpus as the query sees it.
    pub(super) snapshot: Arc<Snapshot>,
    pub(super) stocks: Vec<Stock>,
    pub(super) tags: Vec<String>,
    /// The shares of which anything is wanted.
    pub(super) shares: BTreeSet<Share>,
}

/// A question for the best of a share.
#[derive(Serialize, Deserialize)]
struct Question {
    share: Share,
    /// What the asking server knows of the corpus; the answer knows as much.
    position: u64,
    /// Whose turn it is counted as.
    user: u64,
    tags: Vec<String>,
    with_parts: bool,
    queries: Vec<PreparedQuery>,
}

/// A query, prepared for examples of a topology.
#[derive(Serialize, Deserialize)]
struct PreparedQuery {
    examples: Topology,
    topology: Topology,
    pictures: Vec<Picture>,
}

#[derive(Serialize, Deserialize)]
struct Picture {
    /// Coefficients, f64, little-endian.
    values: ByteBuf,
    mean: f64,
    variance: f64,
    modulus: f64,
    bending: Option<f32>,
}

/// A segment among the best of a share.
#[derive(Serialize, Deserialize)]
struct FoundSegment {
    example: ExampleId,
    segment: u32,
    row: Option<FoundRow>,
    score: f64,
    energy: f64,
    cost: f64,
    flip: (bool, bool),
    shift: usize,
    pole: usize,
}

#[derive(Serialize, Deserialize)]
struct FoundRow {
    /// i16, little-endian.
    codes: ByteBuf,
    scale: f32,
    mean: f32,
    variance: f64,
    symmetric: bool,
}

impl SegmentSearch<'_> {
    /// The best of what other servers hold, best first in each share, and the shares that nobody answered for.
    pub(super) async fn gathered(
        &self,
        elsewhere: Option<RemoteSelection>,
        query: &Queries,
    ) -> Result<(Vec<RankedSegment>, Vec<Share>), WorkError> {
        let Some(elsewhere) = elsewhere else { return Ok((Vec::new(), Vec::new())) };
        let position = self.work.corpus.reached();
        let asked = elsewhere.shares.iter().map(|&share| {
            let question = Question {
                share,
                position,
                user: self.live.caller.user.0,
                tags: elsewhere.tags.clone(),
                with_parts: elsewhere.stocks.contains(&Stock::Parts),
                queries: query.iter().map(|(&examples, query)| PreparedQuery::of(examples, query)).collect(),
            };
            self.best_of(question, &elsewhere)
        });
        let answers = tokio::select! {
            answers = join_all(asked) => answers,
            reason = self.live.stop().stopped() => return Err(PoolError::from(reason).into()),
        };
        let (mut found, mut missing) = (Vec::new(), Vec::new());
        for (&share, answer) in elsewhere.shares.iter().zip(answers) {
            metrics::counter!("quadmuse_shares_asked_total", "outcome" => if answer.is_some() { "answered" } else { "missing" })
                .increment(1);
            match answer {
                Some(some) => found.extend(some),
                None => {
                    tracing::error!(query = %self.live.id, %share, "no server answers for a share of the corpus; it is left out");
                    missing.push(share);
                }
            }
        }
        Ok((found, missing))
    }

    async fn best_of(&self, question: Question, elsewhere: &RemoteSelection) -> Option<Vec<RankedSegment>> {
        let share = question.share;
        let asked = rmp_serde::to_vec_named(&question).ok()?;
        let answer = self.work.shares.ask(share, asked.into()).await?;
        let found: Vec<FoundSegment> = rmp_serde::from_slice(&answer).ok()?;
        // What the query's snapshot doesn't hold was added since, or changed since.
        let ranked = found.into_iter().filter_map(|found| {
            let resident = elsewhere.snapshot.segment(found.example, found.segment)?;
            let is_wanted = share.holds(found.example) && resident.has_tags(&elsewhere.tags);
            is_wanted.then(|| found.ranked(Arc::clone(resident)))
        });
        Some(ranked.collect())
    }
}

/// Answers a question of another server.
///
/// # Errors
/// [`WorkError::Parameter`] if it can't be read, or is for a share that is not in memory here; refusals of the pool.
pub async fn answer(work: &Arc<Work>, question: Bytes) -> Result<Vec<u8>, WorkError> {
    let unreadable = || WorkError::parameter("question", "one of this release", "another");
    let question: Question = rmp_serde::from_slice(&question).map_err(|_| unreadable())?;
    let share = question.share;
    if let Some(own) = work.catalogue.share().filter(|own| *own != share) {
        return Err(WorkError::parameter("share", format!("{own}, which is in memory here"), share));
    }
    let mut queries = Queries::new();
    for prepared in question.queries {
        queries.insert(prepared.examples, prepared.query().ok_or_else(unreadable)?);
    }
    let position = question.position;
    let caught_up = work.blocking(move |work| {
        work.corpus.wait_for(position, CATCH_UP_MAX);
        work.catalogue.follow();
        Ok(())
    });
    caught_up.await?;
    let job = work.admit(User(question.user), ANSWER_BYTES, REQUEST_TIME_MAX)?;
    let snapshot = work.catalogue.snapshot();
    let topologies: Vec<Topology> = queries.keys().copied().collect();
    let stocks: &[Stock] = if question.with_parts { &[Stock::Wholes, Stock::Parts] } else { &[Stock::Wholes] };
    let selection = Selection::here(&snapshot, &topologies, stocks, |resident| {
        share.holds(resident.example.id) && resident.has_tags(&question.tags)
    });
    let label = format!("of another server, share {share}");
    let sweeping = Sweeping { work, job: &job, label: &label };
    let best = sweeping.best(selection.chunks, &Arc::new(queries)).await?;
    let found: Vec<FoundSegment> = (0..).zip(&best).map(|(place, ranked)| FoundSegment::of(place, ranked)).collect();
    rmp_serde::to_vec_named(&found).map_err(|_| WorkError::Lost)
}

impl PreparedQuery {
    fn of(examples: Topology, query: &CoarseQuery) -> Self {
        const ALL: [Topology; 4] = [Topology::Disc, Topology::Annulus, Topology::Sphere, Topology::Torus];
        let topology = ALL.into_iter().find(|topology| topology_in(*topology) == query.topology());
        let picture = |(spectrum, shape): (&Spectrum, SegmentShape)| Picture {
            values: spectrum.values().iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>().into(),
            mean: spectrum.mean,
            variance: spectrum.variance,
            modulus: shape.modulus,
            bending: shape.bending,
        };
        Self { examples, topology: topology.unwrap_or(examples), pictures: query.spectra().map(picture).collect() }
    }

    fn query(self) -> Option<CoarseQuery> {
        let picture = |picture: Picture| {
            let (eights, rest) = picture.values.as_chunks::<8>();
            let values: Vec<f64> = eights.iter().map(|&eight| f64::from_le_bytes(eight)).collect();
            let is_sound = rest.is_empty() && values.iter().all(|value| value.is_finite());
            let values: Box<[f64; VALUES]> = values.try_into().ok().filter(|_| is_sound)?;
            let shape = SegmentShape { modulus: picture.modulus, bending: picture.bending };
            Some((Spectrum::from_values(values, picture.mean, picture.variance), shape))
        };
        if self.pictures.len() > PICTURES_MAX {
            return None;
        }
        let spectra = self.pictures.into_iter().map(picture).collect::<Option<Vec<_>>>()?;
        Some(CoarseQuery::from_spectra(topology_in(self.topology), spectra))
    }
}

impl FoundSegment {
    /// Rows go along with those that could go on after the first ranking: near-duplicates are told by them.
    fn of(place: usize, ranked: &RankedSegment) -> Self {
        let row = ranked.row.as_ref().filter(|_| place < REGISTERED_MAX).map(|row| FoundRow {
            codes: row.codes.iter().flat_map(|code| code.to_le_bytes()).collect::<Vec<u8>>().into(),
            scale: row.scale,
            mean: row.mean,
            variance: row.variance,
            symmetric: row.symmetric,
        });
        let Translation { score, energy, cost, flip, shift, pole } = ranked.translation;
        let (example, segment) = (ranked.resident.example.id, ranked.resident.segment);
        Self { example, segment, row, score, energy, cost, flip: (flip.u, flip.v), shift, pole }
    }

    fn ranked(self, resident: Arc<crate::work::catalogue::Resident>) -> RankedSegment {
        let row = self.row.and_then(|row| {
            let (pairs, _) = row.codes.as_chunks::<2>();
            let codes: Vec<i16> = pairs.iter().map(|&pair| i16::from_le_bytes(pair)).collect();
            let FoundRow { scale, mean, variance, symmetric, .. } = row;
            Some(Row { codes: codes.try_into().ok()?, scale, mean, variance, symmetric })
        });
        let Self { score, energy, cost, flip: (u, v), shift, pole, .. } = self;
        RankedSegment {
            row,
            resident,
            translation: Translation { score, energy, cost, flip: Flip { u, v }, shift, pole },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query(topology: Topology) -> CoarseQuery {
        let values = |seed: f64| Box::new(std::array::from_fn(|k| (k as f64 * seed).sin() / 3.0));
        let spectra = [(0.7, 0.4), (1.3, 0.9)].map(|(seed, modulus)| {
            (Spectrum::from_values(values(seed), seed / 7.0, 0.1 / 3.0), SegmentShape { modulus, bending: Some(1.5) })
        });
        CoarseQuery::from_spectra(topology_in(topology), spectra.into())
    }

    #[test]
    fn a_query_arrives_bit_for_bit_with_its_poles_in_order() {
        for topology in [Topology::Disc, Topology::Annulus] {
            let own = query(topology);
            let bytes = rmp_serde::to_vec_named(&PreparedQuery::of(topology, &own)).expect("serialises");
            let read: PreparedQuery = rmp_serde::from_slice(&bytes).expect("reads");
            let there = read.query().expect("a query");
            assert_eq!(there.topology(), own.topology());
            let (one, other): (Vec<_>, Vec<_>) = (own.spectra().collect(), there.spectra().collect());
            assert_eq!((one.len(), other.len()), (2, 2));
            for ((a, shape), (b, its)) in one.into_iter().zip(other) {
                assert_eq!((a.values(), a.mean, a.variance, shape), (b.values(), b.mean, b.variance, its));
            }
        }
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        let mut prepared = PreparedQuery::of(Topology::Disc, &query(Topology::Disc));
        prepared.pictures[0].values.truncate(8);
        assert!(prepared.query().is_none());
        let mut prepared = PreparedQuery::of(Topology::Disc, &query(Topology::Disc));
        prepared.pictures[0].values[..8].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(prepared.query().is_none());
    }
}
