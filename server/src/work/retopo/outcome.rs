//! Results of a retopology: a map or a composition, and which of two is better.

use super::recut::Recut;
use crate::work::composing::LiveComposition;
use crate::work::mapping::LiveMap;
use crate::work::query::LiveQuery;
use quadmuse_proto::{MakingState, QueryId, Retopo, RetopoId, RetopoResult, Verdict};
use std::sync::Arc;

/// Examples that make up this share of a scan are most of it.
pub(super) const MOST: f64 = 0.5;

/// A map as it is, or a composition.
pub(super) enum MapOrComposition {
    /// A map.
    Map(Arc<LiveMap>),
    /// A composition.
    Composition(Arc<LiveComposition>),
}

/// A result for a scan.
pub(super) struct Outcome {
    /// The map or composition.
    pub(super) made: MapOrComposition,
    query: QueryId,
    /// The query of it, where that was cut for it. It is freed with the outcome, unless that is kept.
    recut: Option<Recut>,
}

impl Outcome {
    /// Of the query that was asked.
    pub(super) fn of(live: &LiveQuery, made: MapOrComposition) -> Self {
        Self { made, query: live.id, recut: None }
    }

    /// Of a query of the same scan that was cut otherwise.
    pub(super) fn of_recut(recut: Recut, made: MapOrComposition) -> Self {
        Self { made, query: recut.live.id, recut: Some(recut) }
    }

    pub(super) fn verdict(&self) -> Verdict {
        match &self.made {
            MapOrComposition::Map(map) => map.newest().summary.verdict,
            MapOrComposition::Composition(made) => made.summary.verdict,
        }
    }

    /// What was done beyond plain stitching.
    pub(super) fn notes(&self) -> &[String] {
        match &self.made {
            MapOrComposition::Map(_) => &[],
            MapOrComposition::Composition(made) => &made.summary.notes,
        }
    }

    /// The share of the scan that has an example's quads; nothing that is broken is worth anything.
    pub(super) fn share(&self) -> f64 {
        let share = match &self.made {
            // Rows that continue the example beyond its rim are not counted there.
            MapOrComposition::Map(map) => map.newest().summary.covers.input,
            MapOrComposition::Composition(made) => made.summary.inspired * made.summary.covers.input,
        };
        if self.verdict() == Verdict::Broken { 0.0 } else { share }
    }

    pub(super) fn is_most(&self) -> bool {
        self.share() >= MOST
    }

    /// This one, unless examples make up more of the other.
    pub(super) fn or_better(self, other: Self) -> Self {
        if other.share() > self.share() { other } else { self }
    }

    /// As it goes over the wire.
    pub(super) fn to_wire(&self, id: RetopoId, query: QueryId, notes: Vec<String>) -> Retopo {
        let (result, verdict, inspired, reasons, covers) = match &self.made {
            MapOrComposition::Map(map) => {
                let map = map.newest().summary.clone();
                (RetopoResult::Map(map.id), map.verdict, map.inspired, map.reasons, map.covers)
            }
            MapOrComposition::Composition(made) => {
                let made = made.summary.clone();
                (RetopoResult::Composition(made.id), made.verdict, made.inspired, made.reasons, made.covers)
            }
        };
        let (state, progress, total_ms) = (MakingState::Done, 1.0, 0.0);
        let result_query = self.query;
        Retopo { id, query, state, progress, result_query, result, verdict, inspired, reasons, covers, notes, total_ms }
    }

    /// Keeps the query of it.
    pub(super) fn keep(self) {
        if let Some(recut) = self.recut {
            recut.keep();
        }
    }
}
