//! The last word on a ranking: how well the surfaces themselves lie on each other.
//!
//! A picture tells little of a scan that is full of holes, or that ends where no example does: its rim is laid on theirs. So
//! where the pictures leave it open who is best, the first few examples are laid on the query in rough rigid poses, either as
//! a part of the other, and those that lie best come first. *Ours, not the paper's.*

use super::{SegmentSearch, caught_up};
use crate::pool::{Lane, Stop};
use crate::work::WorkError;
use crate::work::engine::Opaque;
use crate::work::ingest;
use crate::work::query::ms_since;
use crate::work::ranking::{Candidate, by_likeness};
use crate::work::worth::FACES_CHOSEN_MIN;
use futures_util::{StreamExt, stream};
use quadmuse_kernel::settle::Likeness;
use quadmuse_proto::{EntryState, LevelTiming, Topology};
use std::sync::Arc;
use std::time::Instant;

/// From this score on the best picture is not sure: right ones have up to some 0.2, and wrong ones of whole scans 0.2 and more.
const UNSURE: f64 = 0.15;
/// Nor is it of a scan with more holes.
const HOLES_SURE: u32 = 8;
/// Examples with a rim that are laid, and as many that are parts of examples.
const LAID_MAX: usize = 32;
/// Closed examples that are laid on what is closed, too.
const CLOSED_MAX: usize = 16;
/// A segment with less of the query's faces is not worth it; nor is one of few faces, which lies on anything.
const SHARE_MIN: f64 = 0.25;

impl SegmentSearch<'_> {
    /// Lets the shapes decide, where the pictures leave it open.
    pub(super) async fn by_likeness(&self) -> Result<(), WorkError> {
        let start = Instant::now();
        let newest = self.live.board().rankings.get(self.segment).cloned().unwrap_or_default();
        if !self.is_open(&newest.candidates) {
            return Ok(());
        }
        let (engine, model, segment) =
            (Arc::clone(&self.work.engine), Arc::clone(&self.live.model), self.segment as u32);
        let posed = self.work.pool.run(&self.live.job, Lane::Fine, move |_| engine.posed(&model, segment)).await??;
        let Some(own) = posed else { return Ok(()) };
        let (mut laid, passed_over) = self.chosen(&newest.candidates);
        let tasks: Vec<_> = laid.iter().map(|candidate| self.likeness(candidate, &own)).collect();
        let found: Vec<Result<Likeness, WorkError>> = stream::iter(tasks).buffered(self.window()).collect().await;
        for (candidate, likeness) in laid.iter_mut().zip(found) {
            candidate.likeness = Some(likeness?);
        }
        self.published(by_likeness(laid, passed_over), start).await
    }

    /// How well an example, which is read again and let go of, lies on the query; not at all where it can't be read or compared.
    async fn likeness(&self, candidate: &Candidate, own: &Opaque) -> Result<Likeness, WorkError> {
        let (example, segment) = (&candidate.resident.example, candidate.resident.segment);
        let model = match ingest::model(self.work, &self.live.job, Lane::Fine, example).await {
            Ok(model) => model,
            Err(error) if error.stop_reason().is_some() => return Err(error),
            Err(error) => {
                tracing::warn!(query = %self.live.id, example = %example.id, %error, "not laid");
                return Ok(Likeness::default());
            }
        };
        let (engine, own) = (Arc::clone(&self.work.engine), own.clone());
        let quantum = move |stop: &Stop| match engine.posed(&model, segment)? {
            Some(posed) => engine.likeness(&posed, &own, stop),
            None => Ok(Likeness::default()),
        };
        Ok(self.work.pool.run(&self.live.job, Lane::Fine, quantum).await??)
    }

    /// Whether the pictures leave it open who is best.
    fn is_open(&self, candidates: &[Candidate]) -> bool {
        let segments = &self.live.model.segments;
        let (Some(own), Some(first)) = (segments.get(self.segment), candidates.first()) else { return false };
        let faces: u64 = segments.iter().map(|s| s.faces).sum();
        let is_worth_it = own.faces >= FACES_CHOSEN_MIN && own.faces as f64 >= SHARE_MIN * faces as f64;
        let is_unsure = first.score > UNSURE || own.holes > HOLES_SURE;
        let has_caps = |topology| matches!(topology, Topology::Disc | Topology::Sphere);
        is_worth_it && is_unsure && has_caps(first.resident.facts.topology)
    }

    /// The first few candidates of either topology that are no near-duplicates, and all others, each in order.
    fn chosen(&self, candidates: &[Candidate]) -> (Vec<Candidate>, Vec<Candidate>) {
        let (mut with_rim, mut parts, mut closed) = (0, 0, 0);
        candidates.iter().cloned().partition(|c| {
            let (count, most) = match c.resident.facts.topology {
                Topology::Disc if c.resident.is_part() => (&mut parts, LAID_MAX),
                Topology::Disc => (&mut with_rim, LAID_MAX),
                Topology::Sphere => (&mut closed, CLOSED_MAX),
                _ => return false,
            };
            let is_chosen = *count < most && c.similar_to.is_none();
            *count += usize::from(is_chosen);
            is_chosen
        })
    }

    /// Finishes those that came to the top, and publishes the ranking.
    async fn published(&self, mut candidates: Vec<Candidate>, start: Instant) -> Result<(), WorkError> {
        let (top, level) = (self.live.options.top as usize, self.live.options.resolution);
        let laid = candidates.iter().filter(|candidate| candidate.likeness.is_some()).count();
        for (place, candidate) in candidates.iter_mut().enumerate() {
            if place >= top.min(laid) {
                candidate.state = EntryState::Locked;
                continue;
            }
            let (score, likeness) = (candidate.score, candidate.likeness);
            let from = candidate.clone();
            let done = caught_up(self.work, &self.live.job, Lane::Fine, from, &self.query, level).await?;
            *candidate = Candidate { score, likeness, state: EntryState::Done, ..done };
        }
        let timing = LevelTiming { segment: self.segment as u32, level, entries: laid as u64, ms: ms_since(start) };
        self.live.publish(self.segment, level, candidates, timing);
        Ok(())
    }
}
