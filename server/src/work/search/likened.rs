//! The last word on a ranking: how well the surfaces themselves lie on each other.
//!
//! A picture tells little of a scan that is full of holes, or that ends where no example does: its rim is laid on theirs. So
//! where the pictures leave it open who is best, the first few examples are laid on the query in rough rigid poses, either as
//! a part of the other, and those that lie best come first. *Ours, not the paper's.*

use super::clusters::{Clusters, Key, Kind};
use super::{SegmentSearch, caught_up};
use crate::pool::{Lane, Stop};
use crate::work::WorkError;
use crate::work::engine::{Encoded, LimbDistances, Model, Opaque, RoughLead, RoughPlacement, SegmentFacts, Stage};
use crate::work::ingest;
use crate::work::query::ms_since;
use crate::work::ranking::{Candidate, SURE_FROM, by_fit, by_likeness, is_worth_a_map};
use crate::work::worth::{FACES_CHOSEN_MIN, choices, is_small_part};
use futures_util::{StreamExt, stream};
use quadmuse_kernel::settle::Likeness;
use quadmuse_proto::{EntryState, LevelTiming, Topology};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

/// From this score on the best picture is not sure: right ones have up to some 0.2, and wrong ones of whole scans 0.2 and more.
const UNSURE: f64 = 0.15;
/// Nor is it of a scan with more holes.
const HOLES_SURE: u32 = 8;
/// Examples with a rim that are laid, as many that are closed, and as many that are parts of examples. With 32 a hand that was scanned
/// from one side found none among 91 examples (tests/records/outside-2026-11-29.md).
const LAID_MAX: usize = 64;
/// Of so many that are most alike all that they represent are laid, too, at most so many. *Untuned.*
const CLUSTERS_LAID: usize = 4;
const REPRESENTED_MAX: usize = 24;
/// Examples that are laid roughly: the first, of those with a rim those that explain most, of closed ones those that are most alike, and
/// of either those that lie best.
/// *Untuned.*
const ROUGH_FIRST: usize = 4;
const ROUGH_ALIKE: usize = 6;
/// So many closed ones whose limbs are most like the query's are laid roughly, too: no rigid pose brings a standing animal onto a sitting
/// one. *Untuned.*
const ROUGH_BY_LIMBS: usize = 4;
/// So many at a time, until as many as are tried explain so much of the query: the best of them is mapped first, and if that fails there
/// are others. *Untuned:* of wrong fits it is below .1.
const ROUGH_AT_A_TIME: usize = 2;
const ROUGH_ENOUGH: f64 = 0.15;
const ROUGH_WANTED: usize = 3;
/// Up to this score the best picture is sure: those of the same part of another scan have up to .01. *Untuned.*
const SURE: f64 = 0.04;
/// Examples that are laid roughly on a small part of a scan, or where the pictures leave less open: the first that are finished.
const ROUGH_OF_FIRST: usize = 2;
/// An example that explains less of the query than this, and is sure, may lead others. *Untuned.*
const LEADS_BELOW: f64 = 0.5;
/// An example that is led there and is less sure does not follow: what it has beyond the part is too unlike the query.
const FOLLOWS_FROM: f64 = 0.0;
/// Examples that follow one: their maps decide whether they are worth more than the part alone.
const FOLLOWERS: usize = 2;
/// Examples that one may lead: the most alike, then the first. Most are found to hold no such part at once.
const LED_MAX: usize = 24;

impl SegmentSearch<'_> {
    /// Lets the shapes decide, where the pictures leave it open.
    pub(super) async fn by_likeness(&self) -> Result<(), WorkError> {
        let start = Instant::now();
        if !Stage::Rough.is_on() {
            return Ok(());
        }
        let newest = self.live.board().rankings.get(self.segment).cloned().unwrap_or_default();
        let segments = &self.live.model.segments;
        if is_small_part(segments, self.segment) || !self.is_open(&newest.candidates) {
            let agrees = self.lay_first(newest.candidates.clone(), start).await?;
            // Of a part there are others. What is all of a scan, or most of it, has this chance alone.
            let is_main = segments.get(self.segment).is_some_and(|s| s.is_main);
            if agrees || segments.len() > 1 && !is_main {
                return Ok(());
            }
        }
        let (engine, model, segment) =
            (Arc::clone(&self.work.engine), Arc::clone(&self.live.model), self.segment as u32);
        let posed = self.work.pool.run(&self.live.job, Lane::Fine, move |_| engine.posed(&model, segment)).await??;
        let Some(own) = posed else { return Ok(()) };
        let clusters = self.clusters(&newest.candidates, LAID_MAX).await?;
        let (mut laid, passed_over) = self.chosen(&newest.candidates, &clusters);
        self.lay_posed(&mut laid, &own).await?;
        let (mut represented, passed_over) = represented_by_best(&laid, passed_over, &clusters);
        self.lay_posed(&mut represented, &own).await?;
        laid.extend(represented);
        let mut ordered = by_likeness(laid, passed_over, self.query.facts.topology);
        self.fit_roughly(&mut ordered, &clusters).await?;
        self.published(by_fit(ordered), start).await
    }

    /// Lays the first few roughly, unless the first picture is sure: of a small part of a scan it tells nearly nothing
    /// (tests/records/parts-2026-11-27.md), and of a larger one less than a rough fit, which costs a tenth of a map. Tells whether the
    /// surfaces bear the pictures out: false where all of those lie elsewhere than they should.
    async fn lay_first(&self, mut candidates: Vec<Candidate>, start: Instant) -> Result<bool, WorkError> {
        let (own, first) = (self.live.model.segments.get(self.segment), candidates.first());
        let is_worth_it = own.is_some_and(|own| own.form >= FACES_CHOSEN_MIN && own.topology.has_caps());
        if !is_worth_it || first.is_none_or(|first| first.score <= SURE) {
            return Ok(true);
        }
        // A disc or a closed surface is ranked against such alone.
        let is_finished = |&at: &usize| candidates[at].state == EntryState::Done;
        let chosen: Vec<usize> = (0..candidates.len()).filter(is_finished).take(ROUGH_OF_FIRST).collect();
        let Some(ready) = self.ready_for_rough().await? else { return Ok(true) };
        let fits = self.all_rough(&candidates, (&chosen, &ready), None).await?;
        // Of what has no relief, as an eye, none can be laid roughly.
        if fits.first().is_none_or(Option::is_none) {
            return Ok(true);
        }
        let agrees = fits.iter().flatten().any(is_worth_a_map);
        chosen.iter().zip(fits).for_each(|(&at, fit)| candidates[at].rough = fit);
        self.published(by_fit(candidates), start).await?;
        Ok(agrees)
    }

    /// The query, made ready for all that are laid on it roughly.
    async fn ready_for_rough(&self) -> Result<Option<Opaque>, WorkError> {
        let (engine, model, segment) =
            (Arc::clone(&self.work.engine), Arc::clone(&self.live.model), self.segment as u32);
        let ready = move |_: &Stop| engine.ready_for_rough(&model, segment);
        Ok(self.work.pool.run(&self.live.job, Lane::Fine, ready).await??)
    }

    /// Lays the best few roughly, and lets the best of these lead others.
    async fn fit_roughly(&self, candidates: &mut [Candidate], clusters: &Clusters) -> Result<(), WorkError> {
        let worth = |c: &Candidate| c.rough.as_ref().map_or(f64::NEG_INFINITY, RoughPlacement::worth);
        let limbs = self.limb_disagreements(candidates).await?;
        let chosen = worth_laying(candidates, clusters, &limbs);
        let Some(ready) = self.ready_for_rough().await? else { return Ok(()) };
        for some in chosen.chunks(ROUGH_AT_A_TIME) {
            let fits = self.all_rough(candidates, (some, &ready), None).await?;
            some.iter().zip(fits).for_each(|(&at, fit)| candidates[at].rough = fit);
            if candidates.iter().filter(|c| worth(c) >= ROUGH_ENOUGH).count() >= ROUGH_WANTED {
                break;
            }
        }
        let best = chosen.iter().copied().max_by(|&a, &b| worth(&candidates[a]).total_cmp(&worth(&candidates[b])));
        let Some(best) = best.filter(|_| Stage::Leads.is_on()) else { return Ok(()) };
        let from = candidates[best].clone();
        let Some(rough) = from.rough.clone().filter(|r| r.sureness() >= SURE_FROM && r.covered < LEADS_BELOW) else {
            return Ok(());
        };
        let Some(model) = self.read(&from).await? else { return Ok(()) };
        let lead = RoughLead { model, segment: from.resident.segment, rough };
        let may_follow = |at: &usize| {
            let c = &candidates[*at];
            let is_open = |topology| topology != Topology::Sphere;
            let has_rim = is_open(c.resident.facts.topology) || is_open(self.query.facts.topology);
            *at != best && has_rim && !c.resident.is_part()
        };
        let mut led: Vec<usize> = (0..candidates.len()).filter(may_follow).collect();
        led.sort_by(|&a, &b| alike(&candidates[b]).total_cmp(&alike(&candidates[a])));
        led = clusters.first_of_each(led, candidates);
        led.truncate(LED_MAX);
        let fits = self.all_rough(candidates, (&led, &ready), Some(lead)).await?;
        let mut followers: Vec<(usize, RoughPlacement)> = led
            .into_iter()
            .zip(fits)
            .filter_map(|(at, fit)| Some((at, fit?)))
            .filter(|(at, fit)| fit.sureness() >= FOLLOWS_FROM && fit.worth() > worth(&candidates[*at]))
            .collect();
        followers.sort_by(|(_, a), (_, b)| b.worth().total_cmp(&a.worth()));
        for (at, fit) in followers.into_iter().take(FOLLOWERS) {
            (candidates[at].rough, candidates[at].lead) = (Some(fit), Some(from.key()));
        }
        Ok(())
    }

    /// How some of the candidates lie on the query, laid roughly.
    async fn all_rough(
        &self,
        candidates: &[Candidate],
        (chosen, ready): (&[usize], &Opaque),
        lead: Option<RoughLead>,
    ) -> Result<Vec<Option<RoughPlacement>>, WorkError> {
        let lead = lead.map(Arc::new);
        let tasks: Vec<_> = chosen.iter().map(|&at| self.rough(&candidates[at], ready.clone(), lead.clone())).collect();
        stream::iter(tasks).buffered(self.window()).collect::<Vec<_>>().await.into_iter().collect()
    }

    /// How a candidate lies on the query, which is ready for it.
    async fn rough(
        &self,
        candidate: &Candidate,
        ready: Opaque,
        lead: Option<Arc<RoughLead>>,
    ) -> Result<Option<RoughPlacement>, WorkError> {
        let Some(model) = self.read(candidate).await? else { return Ok(None) };
        let segment = candidate.resident.segment;
        let encoded = match is_closed(&candidate.resident.facts) && is_closed(&self.query.facts) {
            true => {
                let Some(encoded) = self.encoded(candidate, &model).await? else { return Ok(None) };
                Some(encoded)
            }
            false => None,
        };
        let (engine, on, own) = (Arc::clone(&self.work.engine), Arc::clone(&self.live.model), self.segment as u32);
        let (query, leading) = (Arc::clone(&self.query), lead.clone());
        let quantum = move |stop: &Stop| {
            let encodings = encoded.as_ref().map(|encoded| [&encoded.encoding, &*query]);
            engine.rough((&model, segment), (&on, own, &ready), encodings, leading.as_deref(), stop)
        };
        let is_led = lead.is_some();
        let found = self.work.pool.run(&self.live.job, Lane::Fine, quantum).await;
        let found = self.usable(candidate, WorkError::joined(found))?.flatten();
        if let Some(RoughPlacement { agreement, local_relief, covered, off, apart, start, .. }) = &found {
            let example = &candidate.resident.example.name;
            let (on, by_tips) = (self.segment, start.is_none());
            tracing::debug!(query = %self.live.id, on, %example, segment, agreement, local = local_relief, covered, off, apart, by_tips, is_led, "laid roughly");
        }
        Ok(found)
    }

    /// Compares the limbs of closed candidates whose likeness is known with the query's; by the candidates' places.
    async fn limb_disagreements(&self, candidates: &[Candidate]) -> Result<HashMap<usize, f64>, WorkError> {
        if !(is_closed(&self.query.facts) && Stage::Tips.is_on()) {
            return Ok(HashMap::new());
        }
        let (engine, query) = (Arc::clone(&self.work.engine), Arc::clone(&self.query));
        let own = self.work.pool.run(&self.live.job, Lane::Fine, move |_| engine.limbs(&query)).await??;
        let Some(own) = own.map(Arc::new) else { return Ok(HashMap::new()) };
        let may_match = |&at: &usize| candidates[at].likeness.is_some() && is_closed(&candidates[at].resident.facts);
        let places: Vec<usize> = (0..candidates.len()).filter(may_match).collect();
        let tasks: Vec<_> = places.iter().map(|&at| self.limb_disagreement(&candidates[at], &own)).collect();
        let found: Vec<Result<Option<f64>, WorkError>> = stream::iter(tasks).buffered(self.window()).collect().await;
        let found = found.into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok(places.into_iter().zip(found).filter_map(|(at, found)| Some((at, found?))).collect())
    }

    /// Compares the limbs of a closed candidate with the query's `own`; `None` where it has too few.
    async fn limb_disagreement(
        &self,
        candidate: &Candidate,
        own: &Arc<LimbDistances>,
    ) -> Result<Option<f64>, WorkError> {
        let (of, this, own) = (candidate.key(), Arc::clone(self.work), Arc::clone(own));
        let there = self.work.examples.limbs(of);
        let encoded = match &there {
            Some(_) => None,
            None => {
                let Some(model) = self.read(candidate).await? else { return Ok(None) };
                self.encoded(candidate, &model).await?
            }
        };
        let quantum = move |_: &Stop| {
            let limbs = match (there, &encoded) {
                (Some(limbs), _) => limbs,
                (None, Some(encoded)) => {
                    let limbs = this.engine.limbs(&encoded.encoding)?.map(Arc::new);
                    this.examples.put_limbs(of, &limbs);
                    limbs
                }
                (None, None) => None,
            };
            Ok(limbs.map(|limbs| limbs.disagreement(&own)))
        };
        let found = self.work.pool.run(&self.live.job, Lane::Fine, quantum).await;
        Ok(self.usable(candidate, WorkError::joined(found))?.flatten())
    }

    /// Unfolds a candidate's segment; `None` where it can't be unfolded.
    async fn encoded(&self, candidate: &Candidate, model: &Arc<Model>) -> Result<Option<Arc<Encoded>>, WorkError> {
        let of = (&*candidate.resident.example, model, candidate.resident.segment);
        self.usable(candidate, ingest::example_encoded(self.work, &self.live.job, Lane::Fine, of).await)
    }

    /// Reads an example again; `None` where it can't be read.
    async fn read(&self, candidate: &Candidate) -> Result<Option<Arc<Model>>, WorkError> {
        let example = &candidate.resident.example;
        self.usable(candidate, ingest::model(self.work, &self.live.job, Lane::Fine, example).await)
    }

    /// Passes over an example that was removed meanwhile, or is damaged: what was made with it, or `None` where that failed.
    ///
    /// # Errors
    /// Where no other example would fare better.
    fn usable<T>(&self, candidate: &Candidate, made: Result<T, WorkError>) -> Result<Option<T>, WorkError> {
        match made {
            Err(error) if error.is_of_one_example() => {
                self.live.passed_over(candidate.resident.example.id, &error);
                Ok(None)
            }
            made => made.map(Some),
        }
    }

    /// Lays candidates on the query in rigid poses.
    async fn lay_posed(&self, candidates: &mut [Candidate], own: &Opaque) -> Result<(), WorkError> {
        let tasks: Vec<_> = candidates.iter().map(|candidate| self.likeness(candidate, own)).collect();
        let found: Vec<Result<Likeness, WorkError>> = stream::iter(tasks).buffered(self.window()).collect().await;
        for (candidate, likeness) in candidates.iter_mut().zip(found) {
            candidate.likeness = Some(likeness?);
        }
        Ok(())
    }

    /// How well an example lies on the query; not at all where it can't be read or compared.
    async fn likeness(&self, candidate: &Candidate, own: &Opaque) -> Result<Likeness, WorkError> {
        let (of, there) = (candidate.key(), self.work.examples.posed(candidate.key()));
        let model = if there.is_none() { self.read(candidate).await? } else { None };
        let (engine, own, this) = (Arc::clone(&self.work.engine), own.clone(), Arc::clone(self.work));
        let quantum = move |stop: &Stop| {
            let posed = match (there, &model) {
                (Some(posed), _) => posed,
                (None, Some(model)) => {
                    let posed = engine.posed(model, of.1)?;
                    this.examples.put_posed(of, &posed);
                    posed
                }
                (None, None) => None,
            };
            posed.map_or_else(|| Ok(Likeness::default()), |posed| engine.likeness(&posed, &own, stop))
        };
        let found = self.work.pool.run(&self.live.job, Lane::Fine, quantum).await;
        Ok(self.usable(candidate, WorkError::joined(found))?.unwrap_or_default())
    }

    /// Whether the pictures leave it open who is best.
    fn is_open(&self, candidates: &[Candidate]) -> bool {
        let segments = &self.live.model.segments;
        let (Some(own), Some(first)) = (segments.get(self.segment), candidates.first()) else { return false };
        // A part of a picture tells little, and so does the picture of what was cut.
        let is_cut = first.resident.facts.topology != own.topology;
        let is_unsure = first.score > UNSURE || own.holes > HOLES_SURE || is_cut;
        own.form >= FACES_CHOSEN_MIN && is_unsure && candidates.iter().any(|c| c.resident.facts.topology.has_caps())
    }

    /// The first few candidates of either topology that represent themselves, and all others, each in order.
    fn chosen(&self, candidates: &[Candidate], clusters: &Clusters) -> (Vec<Candidate>, Vec<Candidate>) {
        let mut counts: HashMap<Kind, usize> = HashMap::new();
        candidates.iter().cloned().partition(|c| {
            let Some(kind) = Kind::of(c) else { return false };
            let count = counts.entry(kind).or_default();
            let is_chosen = *count < LAID_MAX && c.similar_to.is_none() && clusters.is_representative(c.key());
            *count += usize::from(is_chosen);
            is_chosen
        })
    }

    /// Finishes those that came to the top, and publishes the ranking.
    async fn published(&self, mut candidates: Vec<Candidate>, start: Instant) -> Result<(), WorkError> {
        let (top, level) = (self.live.options.top as usize, self.live.options.resolution);
        let top = choices(&self.live.model.segments, self.segment, top);
        let is_laid = |c: &&Candidate| c.likeness.is_some() || c.state == EntryState::Done;
        let laid = candidates.iter().filter(is_laid).count();
        for (place, candidate) in candidates.iter_mut().enumerate() {
            if place >= top.min(laid) {
                candidate.state = EntryState::Locked;
                continue;
            }
            let from = candidate.clone();
            let done = caught_up(self.work, &self.live.job, Lane::Fine, from, &self.query, level).await;
            *candidate = match self.usable(candidate, done)? {
                Some(done) => Candidate { score: candidate.score, state: EntryState::Done, ..done },
                None => Candidate { state: EntryState::Locked, rough: None, ..candidate.clone() },
            };
        }
        let timing = LevelTiming { segment: self.segment as u32, level, entries: laid as u64, ms: ms_since(start) };
        self.live.publish(self.segment, level, candidates, timing);
        Ok(())
    }
}

fn is_closed(facts: &SegmentFacts) -> bool {
    facts.topology == Topology::Sphere
}

fn alike(candidate: &Candidate) -> f64 {
    candidate.likeness.map_or(0.0, |likeness| likeness.weighed)
}

/// Returns what the most alike of the laid ones represent, and all others, each in order.
fn represented_by_best(
    laid: &[Candidate],
    others: Vec<Candidate>,
    clusters: &Clusters,
) -> (Vec<Candidate>, Vec<Candidate>) {
    let mut order: Vec<&Candidate> = laid.iter().collect();
    order.sort_by(|a, b| alike(b).total_cmp(&alike(a)));
    let best: Vec<Key> = order.into_iter().take(CLUSTERS_LAID).map(Candidate::key).collect();
    let mut count = 0;
    others.into_iter().partition(|c| {
        let by = clusters.representative(c.key());
        let is_chosen = count < REPRESENTED_MAX && by != c.key() && best.contains(&by);
        count += usize::from(is_chosen);
        is_chosen
    })
}

/// The places of the candidates that are worth laying roughly, of those whose likeness is known: the first, and of those with a rim
/// and of closed ones those that are most alike, or explain most, or differ least by `limbs`, in turn; of each cluster one.
fn worth_laying(candidates: &[Candidate], clusters: &Clusters, limbs: &HashMap<usize, f64>) -> Vec<usize> {
    let known: Vec<usize> = (0..candidates.len()).filter(|&at| candidates[at].likeness.is_some()).collect();
    let score = |c: &Candidate| c.likeness.map_or(0.0, |likeness| likeness.score);
    let explained = |c: &Candidate| c.likeness.map_or(0.0, |likeness| likeness.explained);
    let first_of_each = |order: &[usize], most: usize| -> Vec<usize> {
        let mut first = clusters.first_of_each(order.iter().copied(), candidates);
        first.truncate(most);
        first
    };
    let mut orders: Vec<Vec<usize>> = vec![first_of_each(&known, ROUGH_FIRST)];
    for closed in [false, true] {
        let bys: [&dyn Fn(&Candidate) -> f64; 2] = [if closed { &alike } else { &explained }, &score];
        for by in bys {
            let is_one = |at: &usize| (candidates[*at].resident.facts.topology == Topology::Sphere) == closed;
            let mut most: Vec<usize> = known.iter().copied().filter(is_one).collect();
            most.sort_by(|&a, &b| by(&candidates[b]).total_cmp(&by(&candidates[a])));
            orders.push(first_of_each(&most, ROUGH_ALIKE));
        }
    }
    let mut by_limbs: Vec<usize> = known.iter().copied().filter(|at| limbs.contains_key(at)).collect();
    by_limbs.sort_by(|a, b| limbs[a].total_cmp(&limbs[b]));
    orders.push(first_of_each(&by_limbs, ROUGH_BY_LIMBS));
    let in_turn = (0..ROUGH_FIRST.max(ROUGH_ALIKE)).flat_map(|turn| orders.iter().filter_map(move |o| o.get(turn)));
    clusters.first_of_each(in_turn.copied(), candidates)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::ranking::tests::candidate;

    fn laid(hash: &str, likeness: f64) -> Candidate {
        Candidate { likeness: Some(Likeness::of(likeness)), ..candidate(hash, 0.5) }
    }

    #[test]
    fn what_the_most_alike_represent_is_laid_too_and_one_of_a_cluster_roughly() {
        let all = [laid("head", 0.5), laid("hand", 0.3), candidate("other head", 0.6), candidate("tongue", 0.7)];
        let [head, hand, other_head, tongue] = all;
        let clusters = Clusters::of([(other_head.key(), head.key())]);
        let (one, two) = (vec![head.clone(), hand.clone()], vec![other_head.clone(), tongue.clone()]);
        let (represented, others) = represented_by_best(&one, two, &clusters);
        let keys = |all: &[Candidate]| all.iter().map(Candidate::key).collect::<Vec<_>>();
        assert_eq!((keys(&represented), keys(&others)), (vec![other_head.key()], vec![tongue.key()]));

        let other_head = Candidate { likeness: Some(Likeness::of(0.4)), ..other_head };
        let known = [head, other_head, hand, tongue];
        assert_eq!(
            worth_laying(&known, &clusters, &HashMap::new()),
            [0, 2],
            "one of two heads, and none whose likeness is not known"
        );
        assert_eq!(worth_laying(&known, &Clusters::default(), &HashMap::new()), [0, 1, 2]);
    }

    #[test]
    fn what_has_the_limbs_of_the_query_is_laid_however_it_is_posed() {
        let all: Vec<Candidate> = (0..12).map(|at| laid("animal", 0.5 - 0.01 * f64::from(at))).collect();
        let is_laid = |limbs| worth_laying(&all, &Clusters::default(), &limbs).contains(&11);
        assert!(is_laid(HashMap::from([(11, 0.1), (3, 0.4)])));
        assert!(!is_laid(HashMap::new()));
    }

    #[test]
    fn what_explains_most_of_the_relief_is_laid_however_little_of_it_it_covers() {
        let cloth = |k: usize| {
            let likeness = Likeness { score: 0.4 - 0.01 * k as f64, weighed: 0.4, explained: 0.1 };
            Candidate { likeness: Some(likeness), ..candidate("cloth", 0.1) }
        };
        let face = Candidate {
            likeness: Some(Likeness { score: 0.2, weighed: 0.1, explained: 0.3 }),
            ..candidate("face", 0.9)
        };
        let all: Vec<Candidate> = (0..12).map(cloth).chain([face]).collect();
        assert!(worth_laying(&all, &Clusters::default(), &HashMap::new()).contains(&12));
    }
}
