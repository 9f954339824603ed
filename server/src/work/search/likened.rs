//! The last word on a ranking: how well the surfaces themselves lie on each other.
//!
//! A picture tells little of a scan that is full of holes, or that ends where no example does: its rim is laid on theirs. So
//! where the pictures leave it open who is best, the first few examples are laid on the query in rough rigid poses, either as
//! a part of the other, and those that lie best come first. *Ours, not the paper's.*

use super::{SegmentSearch, caught_up};
use crate::pool::{Lane, Stop};
use crate::work::WorkError;
use crate::work::engine::Model;
use crate::work::ingest;
use crate::work::query::ms_since;
use crate::work::ranking::{Candidate, by_likeness};
use futures_util::{StreamExt, stream};
use quadmuse_proto::{EntryState, ExampleId, LevelTiming, Topology};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

/// From this score on the best picture is not sure: right ones have up to some 0.2, and wrong ones of whole scans 0.2 and more.
const UNSURE: f64 = 0.15;
/// Nor is it of a scan with more holes.
const HOLES_SURE: u32 = 8;
/// Examples that are laid.
const LAID_MAX: usize = 32;
/// A segment with less of the query's faces is not worth it.
const SHARE_MIN: f64 = 0.25;

impl SegmentSearch<'_> {
    /// Lets the shapes decide, where the pictures leave it open.
    pub(super) async fn by_likeness(&self) -> Result<(), WorkError> {
        let start = Instant::now();
        let newest = self.live.board().rankings.get(self.segment).cloned().unwrap_or_default();
        if !self.is_open(&newest.candidates) {
            return Ok(());
        }
        let (engine, model, segment) = (&self.work.engine, Arc::clone(&self.live.model), self.segment as u32);
        let posed = {
            let engine = Arc::clone(engine);
            self.work.pool.run(&self.live.job, Lane::Fine, move |_| engine.posed(&model, segment)).await??
        };
        let Some(own) = posed else { return Ok(()) };
        let (mut laid, passed_over): (Vec<Candidate>, Vec<Candidate>) = self.chosen(&newest.candidates);
        let models = self.models(&laid).await;
        let one = |candidate: &Candidate| {
            let (engine, own) = (Arc::clone(engine), own.clone());
            let (example, segment) = candidate.key();
            let model = models.get(&example).cloned();
            async move {
                let Some(model) = model else { return Ok(None) };
                let quantum = move |stop: &Stop| match engine.posed(&model, segment)? {
                    Some(posed) => engine.likeness(&posed, &own, stop).map(Some),
                    None => Ok(None),
                };
                Ok::<_, WorkError>(self.work.pool.run(&self.live.job, Lane::Fine, quantum).await??)
            }
        };
        let tasks: Vec<_> = laid.iter().map(one).collect();
        let found: Vec<Result<Option<f64>, WorkError>> = stream::iter(tasks).buffered(self.window()).collect().await;
        for (candidate, likeness) in laid.iter_mut().zip(found) {
            candidate.likeness = Some(likeness?.unwrap_or(0.0));
        }
        if by_likeness(&mut laid) {
            self.published(laid, passed_over, start).await?;
        }
        Ok(())
    }

    /// Whether the pictures leave it open who is best. What is closed lies on closed examples as a whole, which poses of parts
    /// say nothing of.
    fn is_open(&self, candidates: &[Candidate]) -> bool {
        let segments = &self.live.model.segments;
        let (Some(own), Some(first)) = (segments.get(self.segment), candidates.first()) else { return false };
        let faces: u64 = segments.iter().map(|s| s.faces).sum();
        let is_worth_it = own.faces as f64 >= SHARE_MIN * faces as f64;
        let is_unsure = first.score > UNSURE || own.holes > HOLES_SURE;
        is_worth_it && is_unsure && first.resident.facts.topology == Topology::Disc
    }

    /// The first few candidates with a rim that are no near-duplicates, and all others, each in order.
    fn chosen(&self, candidates: &[Candidate]) -> (Vec<Candidate>, Vec<Candidate>) {
        let mut count = 0;
        candidates.iter().cloned().partition(|c| {
            let is_chosen = count < LAID_MAX && c.similar_to.is_none() && c.resident.facts.topology == Topology::Disc;
            count += usize::from(is_chosen);
            is_chosen
        })
    }

    /// The examples, read again; what can't be read is left out.
    async fn models(&self, candidates: &[Candidate]) -> HashMap<ExampleId, Arc<Model>> {
        let mut models = HashMap::new();
        for candidate in candidates {
            let example = &candidate.resident.example;
            if models.contains_key(&example.id) {
                continue;
            }
            match ingest::model(self.work, &self.live.job, Lane::Fine, example).await {
                Ok(model) => {
                    models.insert(example.id, model);
                }
                Err(error) => tracing::warn!(query = %self.live.id, example = %example.id, %error, "not laid"),
            }
        }
        models
    }

    /// Finishes those that came to the top, and publishes the ranking.
    async fn published(
        &self,
        mut laid: Vec<Candidate>,
        passed_over: Vec<Candidate>,
        start: Instant,
    ) -> Result<(), WorkError> {
        let options = &self.live.options;
        for candidate in laid.iter_mut().take(options.top as usize) {
            let (score, likeness) = (candidate.score, candidate.likeness);
            let from = candidate.clone();
            let done = caught_up(self.work, &self.live.job, Lane::Fine, from, &self.query, options.resolution).await?;
            *candidate = Candidate { score, likeness, state: EntryState::Done, ..done };
        }
        let top = (options.top as usize).min(laid.len());
        let (level, entries) = (options.resolution, laid.len() as u64);
        let mut candidates = laid;
        candidates.extend(passed_over);
        candidates.iter_mut().skip(top).for_each(|candidate| candidate.state = EntryState::Locked);
        let mut scores: Vec<f64> = candidates.iter().map(|candidate| candidate.score).collect();
        scores.sort_by(f64::total_cmp);
        candidates.iter_mut().zip(scores).for_each(|(candidate, score)| candidate.score = score);
        let timing = LevelTiming { segment: self.segment as u32, level, entries, ms: ms_since(start) };
        self.live.publish(self.segment, level, candidates, timing);
        Ok(())
    }
}
