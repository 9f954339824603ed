//! Candidates, their order, and which of them go on: plain functions, no clock and no threads.
//!
//! *Source:* paper §5.2 and Eq. 8; METHOD §6. *Ours, not the paper's:* scores of different levels can't be compared,
//! so a candidate that is passed over keeps its place below all that went on: its score is lifted with all others that
//! were passed over, by the same amount, until the best of them is not better than the worst that went on.
//! Where the pictures leave it open who is best, those that lie on the query best in a rough pose come first, with the
//! scores of the places they come to.
//! A near-duplicate that was passed over for a better one stands behind that one, though not among the best `top`, which
//! are as many choices: it would rank like it, if it were registered as finely.

use super::catalogue::{LEVEL_COARSEST, Resident};
use super::engine::{Registration, RoughPlacement};
use quadmuse_kernel::rank::bends;
use quadmuse_kernel::settle::Likeness;
use quadmuse_proto::query::LEVELS;
use quadmuse_proto::{Entry, EntryState, ExampleId, Flip, Topology};
use std::cmp::Ordering;
use std::collections::HashMap;
use std::sync::Arc;

/// A corpus segment while it is ranked.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The corpus segment.
    pub resident: Arc<Resident>,
    /// Its registration, at the finest level it has reached.
    pub registration: Arc<Registration>,
    /// E′, lifted where it was passed over.
    pub score: f64,
    /// Whether it goes on.
    pub state: EntryState,
    /// How it came by its registration.
    pub depth: Depth,
    /// How well the surface itself lies on the query's, where that was asked.
    pub likeness: Option<Likeness>,
    /// How it lies on the query when it is laid roughly, where that was tried.
    pub rough: Option<RoughPlacement>,
    /// An example that lies on the query and on a part of this one: it tells where this one belongs.
    pub lead: Option<(ExampleId, u32)>,
    /// A better candidate that it nearly duplicates: only that one goes on.
    pub similar_to: Option<(ExampleId, u32)>,
}

/// How a candidate was registered at its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// By the best translation of the coarsest level.
    Translated,
    /// With its features moved.
    Registered,
}

impl Candidate {
    /// What names it.
    pub fn key(&self) -> (ExampleId, u32) {
        (self.resident.example.id, self.resident.segment)
    }
}

/// The levels to rank at, coarsest first, up to `resolution`.
pub fn levels_up_to(resolution: u32) -> impl Iterator<Item = u32> {
    LEVELS.into_iter().filter(move |level| *level <= resolution)
}

/// Candidates of a corpus that are ranked one by one; of a larger one the best by translation alone.
pub const RANKED_MAX: usize = 512;

/// Candidates whose features are moved at the coarsest level. *Ours, not the paper's*, which moves those of all: in a
/// large corpus the best by translation hold the best by registration (tests/records).
pub const REGISTERED_MAX: usize = 128;
/// The same of a small part of a scan, which gets one map, if a rough fit speaks for it; more where more are to be shown.
const REGISTERED_OF_PART: usize = 24;

/// How many of `count` candidates of a small part of a scan count at all.
pub fn counted_of_part(count: usize, top: usize) -> usize {
    count.min(REGISTERED_OF_PART.max(top))
}

/// How many of `count` candidates go on to `level`: half at each level, never fewer than `top`.
pub fn survivors(count: usize, top: usize, level: u32) -> usize {
    let halvings = (level / LEVEL_COARSEST).max(1).ilog2();
    count.min(REGISTERED_MAX).div_ceil(1 << halvings).max(top).min(count)
}

/// Candidates registered at the last level, if `top` are fewer: the best ten by the level before hold .94 of the best ten by
/// the last, and in the best four one is often another; of what was missed with sixteen the last stood at 22
/// (tests/records). *Ours, not the paper's.*
const LAST_MIN: usize = 24;

/// How many of `count` candidates are registered at `level`, of which `resolution` is the last.
pub fn registered_at(count: usize, top: usize, level: u32, resolution: u32) -> usize {
    match level == resolution && level != LEVEL_COARSEST {
        true => survivors(count, top, level).min(top.max(LAST_MIN)),
        false => survivors(count, top, level),
    }
}

fn by_score(a: &Candidate, b: &Candidate) -> Ordering {
    a.score.total_cmp(&b.score).then_with(|| a.resident.tie_break().cmp(&b.resident.tie_break()))
}

/// Puts candidates in order after a level: those that were registered at it (the first `fresh`) before those that were
/// passed over (the rest, which are in order already), near-duplicates behind those they duplicate.
pub fn order(candidates: &mut Vec<Candidate>, fresh: usize, top: usize) {
    let mut went_on: Vec<Candidate> = std::mem::take(candidates);
    let passed_over = went_on.split_off(fresh.min(went_on.len()));
    let (duplicates, mut passed_over): (Vec<_>, Vec<_>) = passed_over.into_iter().partition(|c| c.similar_to.is_some());
    went_on.sort_by(by_score);
    if let (Some(worst), Some(best)) = (went_on.last(), passed_over.first()) {
        let lift = (worst.score - best.score).max(0.0);
        passed_over.iter_mut().for_each(|candidate| candidate.score += lift);
    }
    let mut behind: HashMap<Option<(ExampleId, u32)>, Vec<Candidate>> = HashMap::new();
    for duplicate in duplicates {
        behind.entry(duplicate.similar_to).or_default().push(duplicate);
    }
    let mut waiting: Vec<Candidate> = Vec::new();
    for (place, candidate) in (1..).zip(went_on.into_iter().chain(passed_over)) {
        waiting.extend(behind.remove(&Some(candidate.key())).into_iter().flatten());
        let score = candidate.score;
        candidates.push(candidate);
        if place >= top {
            candidates.extend(waiting.drain(..).map(|duplicate| Candidate { score, ..duplicate }));
        }
    }
    let last = candidates.last().map_or(f64::MAX, |last| last.score);
    // Where there are fewer than `top`; and of whom nothing stands above.
    let mut rest: Vec<Candidate> = behind.into_values().flatten().collect();
    rest.sort_by(by_score);
    candidates.extend(waiting.into_iter().chain(rest).map(|duplicate| Candidate { score: last, ..duplicate }));
}

/// Marks which candidates go on: the first `next` that duplicate no better one (`None`: the last level is ranked, and
/// the first `top` of those at it are done).
pub fn mark(candidates: &mut [Candidate], level: u32, next: Option<usize>, top: usize) {
    let (mut going, mut done) = (0, 0);
    for candidate in candidates {
        candidate.state = match next {
            Some(next) if going < next && candidate.similar_to.is_none() => {
                going += 1;
                EntryState::Refining
            }
            None if done < top && candidate.registration.level == level && candidate.depth == Depth::Registered => {
                done += 1;
                EntryState::Done
            }
            _ => EntryState::Locked,
        };
    }
}

/// Another's likeness overturns that of the first if it is so many times as large: poses are rough.
const OVERTURNS: f64 = 1.3;
/// That of one with a rim overturns that of closed ones if it is so many times as large: limbs make rigid poses of these far
/// poorer than maps of them are. *Untuned.*
const OVERTURNS_CLOSED: f64 = 2.0;

/// All candidates: those of `laid` first that lie on the query best, if one of them does so far better than the first, each with
/// the score of the place it comes to; else as they stood, in increasing score.
///
/// Where some are closed, as the query is, limbs lie as they like, and pictures tell more than rigid poses: closed ones stand in
/// their order, before those with a rim, unless one of these lies far better than all of them.
pub fn by_likeness(laid: Vec<Candidate>, passed_over: Vec<Candidate>, query: Topology) -> Vec<Candidate> {
    let of = |c: &Candidate| c.likeness.map_or(0.0, |likeness| likeness.weighed);
    let best = |all: &[Candidate]| all.iter().map(of).fold(0.0, f64::max);
    let as_closed = |c: &Candidate| query == Topology::Sphere && c.resident.facts.topology == query;
    let (closed, mut with_rim): (Vec<Candidate>, Vec<Candidate>) = laid.into_iter().partition(as_closed);
    let bar = match closed.is_empty() {
        true => OVERTURNS * with_rim.first().map_or(0.0, of),
        false => OVERTURNS_CLOSED * best(&closed),
    };
    let overturned = best(&with_rim) > bar;
    let reordered = overturned || !closed.is_empty();
    if reordered {
        with_rim.sort_by(|a, b| of(b).total_cmp(&of(a)));
    }
    let (one, two) = if overturned { (with_rim, closed) } else { (closed, with_rim) };
    let mut laid: Vec<Candidate> = one.into_iter().chain(two).chain(passed_over).collect();
    if reordered {
        with_scores_of_places(&mut laid);
    } else {
        laid.sort_by(|a, b| a.score.total_cmp(&b.score));
    }
    laid
}

/// All candidates: those first that lie on the query when they are laid roughly, by how much of it they explain, each with the
/// score of the place it comes to. Of near equals the one comes first that lies better without being bent. Those that another
/// leads come before it: they have all that it has, and more.
pub fn by_fit(all: Vec<Candidate>) -> Vec<Candidate> {
    let alike = |c: &Candidate| c.likeness.map_or(0.0, |likeness| likeness.weighed);
    let worth = |c: &Candidate| c.rough.as_ref().map_or(0.0, RoughPlacement::worth) * (1.0 + alike(c));
    let fits = |c: &Candidate| c.lead.is_some() || worth(c) > 0.0;
    let (mut fitting, others): (Vec<Candidate>, Vec<Candidate>) = all.into_iter().partition(fits);
    if fitting.is_empty() {
        return others;
    }
    fitting.sort_by(|a, b| b.lead.is_some().cmp(&a.lead.is_some()).then(worth(b).total_cmp(&worth(a))));
    fitting.extend(others);
    with_scores_of_places(&mut fitting);
    fitting
}

fn with_scores_of_places(candidates: &mut [Candidate]) {
    let mut scores: Vec<f64> = candidates.iter().map(|c| c.score).collect();
    scores.sort_by(f64::total_cmp);
    candidates.iter_mut().zip(scores).for_each(|(c, score)| c.score = score);
}

/// Puts a candidate that was resumed into its place among those of its level; where the shapes gave the order, it keeps the
/// place and the score that it had.
pub fn resume(candidates: &mut Vec<Candidate>, resumed: Candidate, top: usize) {
    if candidates.iter().any(|c| c.likeness.is_some()) {
        if let Some(own) = candidates.iter_mut().find(|c| c.key() == resumed.key()) {
            *own = Candidate {
                registration: resumed.registration,
                state: resumed.state,
                depth: resumed.depth,
                ..own.clone()
            };
        }
        return;
    }
    candidates.retain(|c| c.key() != resumed.key());
    let level = resumed.registration.level;
    candidates.push(resumed);
    candidates.sort_by_key(|c| c.registration.level != level);
    let fresh = candidates.partition_point(|c| c.registration.level == level);
    order(candidates, fresh, top);
}

/// A rough fit that explains less of the query, and is not sure, is not worth a map that nobody asked for: of 81 such maps
/// of the judged scans one was not poor, and that one was wrong (tests/records/turns-2026-11-27.md).
const WORTH_FROM: f64 = 0.05;
/// From this [sureness](RoughPlacement::sureness) on a rough fit is sure, on however little of the query.
pub const SURE_FROM: f64 = 0.25;
/// A segment that gets one try, as a small part of a scan does, is laid with an example whose rough fit is so sure: of 45
/// maps of those that agreed less two were not poor, and both were wrong (tests/records/parts-2026-11-27.md).
const ONE_TRY_FROM: f64 = 0.2;

/// Tells whether an example lies so well when it is laid roughly that it is worth a map that nobody asked for.
pub fn is_worth_a_map(rough: &RoughPlacement) -> bool {
    rough.worth() >= WORTH_FROM || rough.sureness() >= SURE_FROM
}

/// The candidates that are laid where nobody chooses, in turn until one fits: the first `tries` that are no near-duplicates of one
/// above. Where some were laid roughly, these are what the query is like, or nothing is: those that fitted, and those that another
/// leads; if none of them lies all over the query, the last turn is left to one that does. Else as many more follow, those that lie on
/// the input best. On what is flat nothing is laid that bends: such a map is poor.
pub fn turns(candidates: &[Candidate], tries: usize, is_flat: bool) -> Vec<(ExampleId, u32)> {
    let places = places(candidates);
    let is_above = |key, place: usize| places.get(&key).is_some_and(|&at| at < place);
    let is_own = |(place, c): &(usize, &Candidate)| c.similar_to.is_none_or(|key| !is_above(key, *place));
    let may_fit = |c: &&Candidate| !(is_flat && c.resident.facts.bending.is_some_and(bends));
    let own = candidates.iter().enumerate().filter(is_own).map(|(_, c)| c);
    let mut own: Vec<&Candidate> = own.filter(may_fit).collect();
    if candidates.iter().any(|c| c.rough.is_some()) {
        let is_enough = |rough: &RoughPlacement| match tries {
            0 | 1 => rough.sureness() >= ONE_TRY_FROM,
            _ => is_worth_a_map(rough),
        };
        let fits = |c: &&Candidate| c.rough.as_ref().is_some_and(|rough| c.lead.is_some() || is_enough(rough));
        let mut chosen: Vec<&Candidate> = own.iter().copied().filter(fits).take(tries).collect();
        let all_over = |c: &Candidate| c.rough.as_ref().and_then(RoughPlacement::all_over);
        if tries > 1 && chosen.iter().all(|c| all_over(c).is_none()) {
            let likely = own.into_iter().filter_map(|c| Some((all_over(c)?, c)));
            if let Some((_, likeliest)) = likely.max_by(|a, b| a.0.total_cmp(&b.0)) {
                chosen.truncate(tries - 1);
                chosen.push(likeliest);
            }
        }
        return chosen.into_iter().map(Candidate::key).collect();
    }
    let score = |c: &Candidate| c.likeness.map_or(0.0, |likeness| likeness.score);
    let mut others = own.split_off(tries.min(own.len()));
    others.retain(|c| c.likeness.is_some());
    others.sort_by(|a, b| score(b).total_cmp(&score(a)));
    own.into_iter().chain(others.into_iter().take(tries)).map(Candidate::key).collect()
}

/// The place of each candidate, from 0.
fn places(candidates: &[Candidate]) -> HashMap<(ExampleId, u32), usize> {
    candidates.iter().map(Candidate::key).zip(0..).collect()
}

/// The first `limit` candidates as they go over the wire, with those that are laid in [`turns`].
pub fn entries(candidates: &[Candidate], limit: usize, turns: &[(ExampleId, u32)]) -> Vec<Entry> {
    let turn = |key| turns.iter().zip(1u32..).find(|(turn, _)| **turn == key).map(|(_, turn)| turn);
    let shown = &candidates[..limit.min(candidates.len())];
    let places = places(shown);
    let rank_above = |key, place: usize| places.get(&key).filter(|&&at| at < place).map(|&at| at as u32 + 1);
    let describe = |(place, c): (usize, &Candidate)| Entry {
        rank: place as u32 + 1,
        example: c.resident.example.id,
        example_segment: c.resident.segment,
        name: c.resident.example.name.clone(),
        score: c.score,
        energy: c.registration.energy,
        k: c.resident.facts.k,
        relevance: c.resident.example.relevance,
        flip: c.registration.flip,
        shift_u: c.registration.shift_u,
        resolution: c.registration.level,
        state: c.state,
        likeness: c.likeness.map(|likeness| likeness.score),
        agreement: c.rough.as_ref().map(|rough| rough.agreement),
        similar_to: c.similar_to.and_then(|key| rank_above(key, place)),
        template: c.resident.example.template.clone(),
        turn: turn(c.key()),
    };
    shown.iter().enumerate().map(describe).collect()
}

/// The last entry of every ranking: a regular layout, which fits any segment of its topology, and is laid where there is no other.
pub fn template_entry(entries: &[Entry], topology: Topology) -> Entry {
    Entry {
        rank: entries.len() as u32 + 1,
        example: ExampleId::TEMPLATE,
        example_segment: 0,
        name: format!("regular {topology}"),
        // Not compared with anything: it stands below all that was.
        score: entries.last().map_or(1.0, |last| last.score + 1.0),
        energy: 0.0,
        k: 0.0,
        relevance: 0.0,
        flip: Flip::default(),
        shift_u: 0.0,
        resolution: 0,
        state: EntryState::Done,
        likeness: None,
        agreement: None,
        similar_to: None,
        template: Some(topology.as_str().to_owned()),
        turn: entries.is_empty().then_some(1),
    }
}

#[cfg(test)]
pub(in crate::work) mod tests {
    use super::*;
    use crate::work::catalogue::row_blocks::Slot;
    use crate::work::engine::{Opaque, SegmentFacts};
    use quadmuse_proto::{Example, MeshCounts};

    /// A disc without a picture.
    pub(in crate::work) fn candidate(hash: &str, score: f64) -> Candidate {
        let example = Example {
            id: ExampleId::generate(),
            revision: 1,
            name: String::new(),
            tags: Vec::new(),
            relevance: 3.0,
            author: String::new(),
            licence: String::new(),
            notes: String::new(),
            landmarks: Vec::new(),
            hash: hash.into(),
            format: "obj".into(),
            bytes: 0,
            counts: MeshCounts::default(),
            segments: Vec::new(),
            repairs: Vec::new(),
            doubts: Vec::new(),
            created: String::new(),
            template: None,
        };
        let facts = SegmentFacts { topology: Topology::Disc, k: 1.0, faces: 0, features: 0, bending: None };
        let registration =
            Registration { level: 32, energy: score, flip: Flip::default(), shift_u: 0.0, inner: Opaque::new(()) };
        Candidate {
            resident: Arc::new(Resident { example: Arc::new(example), segment: 0, facts, place: Slot::default() }),
            registration: Arc::new(registration),
            score,
            state: EntryState::Refining,
            depth: Depth::Registered,
            likeness: None,
            rough: None,
            lead: None,
            similar_to: None,
        }
    }

    fn hashes(candidates: &[Candidate]) -> String {
        candidates.iter().map(|c| c.resident.example.hash.as_str()).collect()
    }

    #[test]
    fn half_goes_on_at_each_level_and_never_fewer_than_top() {
        assert_eq!([32, 64, 128, 256, 512].map(|level| survivors(100, 4, level)), [100, 50, 25, 13, 7]);
        assert_eq!([32, 64, 128, 256, 512].map(|level| survivors(10, 4, level)), [10, 5, 4, 4, 4]);
        assert_eq!([32, 64, 128].map(|level| survivors(2, 4, level)), [2, 2, 2]);
        assert_eq!([32, 64, 128].map(|level| survivors(100_000, 4, level)), [128, 64, 32]);
        assert_eq!([32, 64, 128].map(|level| survivors(512, 64, level)), [128, 64, 64]);
        assert_eq!([32, 64, 128].map(|level| registered_at(100, 4, level, 128)), [100, 50, 24]);
        assert_eq!(
            [(1000, 30), (40, 4), (10, 4), (3, 4)].map(|(count, top)| registered_at(count, top, 128, 128)),
            [30, 10, 4, 3]
        );
        assert_eq!(registered_at(100, 4, 32, 32), 100);
        assert_eq!([(100, 4), (100, 64), (10, 4)].map(|(count, top)| counted_of_part(count, top)), [24, 64, 10]);
    }

    #[test]
    fn equal_scores_are_ordered_by_content() {
        let mut all = vec![candidate("b", 1.0), candidate("a", 1.0), candidate("c", 0.5)];
        order(&mut all, 3, 4);
        assert_eq!(hashes(&all), "cab");
    }

    #[test]
    fn scores_increase_and_what_was_passed_over_stays_below_in_its_order() {
        let mut all = vec![candidate("a", 1.0), candidate("b", 2.0), candidate("c", 2.5), candidate("d", 3.0)];
        all[0].score = 5.0;
        all[1].score = 4.0;
        order(&mut all, 2, 4);
        assert_eq!(hashes(&all), "bacd");
        let scores: Vec<f64> = all.iter().map(|c| c.score).collect();
        assert_eq!(scores, [4.0, 5.0, 5.0, 5.5]);
    }

    #[test]
    fn near_duplicates_leave_their_places_to_others_and_name_whom_they_duplicate() {
        let mut all = vec![candidate("a", 1.0), candidate("b", 2.0), candidate("c", 2.5), candidate("d", 3.0)];
        all[1].similar_to = Some(all[0].key());
        mark(&mut all, 32, Some(2), 4);
        use EntryState::{Locked, Refining};
        assert_eq!(all.iter().map(|c| c.state).collect::<Vec<_>>(), [Refining, Locked, Refining, Locked]);
        let similar_to =
            |limit| entries(&all, limit, &turns(&all, 1, false)).iter().map(|e| e.similar_to).collect::<Vec<_>>();
        assert_eq!(similar_to(9), [None, Some(1), None, None]);
        all.swap(0, 1);
        assert_eq!(entries(&all, 9, &turns(&all, 1, false))[0].similar_to, None);
    }

    #[test]
    fn a_near_duplicate_stands_behind_the_one_it_duplicates_and_not_among_the_best() {
        let mut all: Vec<Candidate> =
            [("a", 1.0), ("b", 2.0), ("c", 3.0), ("d", 0.9), ("e", 1.5)].map(|(hash, s)| candidate(hash, s)).into();
        all[3].similar_to = Some(all[0].key());
        all[4].similar_to = Some(all[2].key());
        let ordered = |top| {
            let mut all = all.clone();
            order(&mut all, 3, top);
            assert!(all.is_sorted_by(|a, b| a.score <= b.score));
            hashes(&all)
        };
        assert_eq!([1, 2, 3, 9].map(ordered), ["adbce", "abdce", "abcde", "abcde"]);
        all.remove(0);
        order(&mut all, 2, 2);
        assert_eq!(hashes(&all), "bced");
    }

    #[test]
    fn so_many_are_done_as_were_asked_for_however_many_reached_the_last_level() {
        let mut all = vec![candidate("a", 1.0), candidate("b", 2.0), candidate("c", 2.5)];
        mark(&mut all, 32, None, 2);
        use EntryState::{Done, Locked};
        assert_eq!(all.iter().map(|c| c.state).collect::<Vec<_>>(), [Done, Done, Locked]);
    }

    #[test]
    fn what_lies_far_better_on_the_query_comes_first_with_the_scores_of_the_places() {
        let likened = |values: [f64; 3]| -> Vec<Candidate> {
            let of = |(hash, likeness): (&str, f64)| Candidate {
                likeness: Some(Likeness::of(likeness)),
                ..candidate(hash, 1.0)
            };
            let mut all: Vec<Candidate> = ["a", "b", "c"].into_iter().zip(values).map(of).collect();
            all.iter_mut().zip([1.0, 2.0, 3.0]).for_each(|(c, score)| c.score = score);
            all
        };
        let other = || vec![Candidate { score: 1.5, ..candidate("d", 1.5) }];
        let same = by_likeness(likened([0.2, 0.25, 0.24]), other(), Topology::Disc);
        assert_eq!(hashes(&same), "adbc");
        assert_eq!(same.iter().map(|c| c.score).collect::<Vec<_>>(), [1.0, 1.5, 2.0, 3.0]);
        // Closed ones stand as the pictures have them, before those with a rim, which stand by likeness.
        let some_closed = |values| {
            let mut all = likened(values);
            for c in &mut all[..2] {
                let facts = SegmentFacts { topology: Topology::Sphere, ..c.resident.facts };
                let example = Arc::clone(&c.resident.example);
                c.resident = Arc::new(Resident { example, segment: 0, facts, place: Slot::default() });
            }
            all
        };
        assert_eq!(hashes(&by_likeness(some_closed([0.1, 0.2, 0.3]), other(), Topology::Sphere)), "abcd");
        assert_eq!(hashes(&by_likeness(some_closed([0.1, 0.2, 0.5]), other(), Topology::Sphere)), "cabd");
        let mut all = by_likeness(likened([0.2, 0.25, 0.5]), other(), Topology::Disc);
        assert_eq!(hashes(&all), "cbad");
        assert_eq!(all.iter().map(|c| c.score).collect::<Vec<_>>(), [1.0, 1.5, 2.0, 3.0]);
        // One that is resumed keeps its place, however it scores.
        let mut resumed = all[1].clone();
        (resumed.score, resumed.state) = (0.1, EntryState::Done);
        resume(&mut all, resumed, 2);
        assert_eq!((hashes(&all).as_str(), all[1].score, all[1].state), ("cbad", 1.5, EntryState::Done));
        assert!(by_likeness(Vec::new(), Vec::new(), Topology::Disc).is_empty());
    }

    #[test]
    fn what_explains_more_of_the_query_comes_first_and_what_explains_nothing_stays() {
        let rough = |sureness, covered| Some(RoughPlacement { covered, ..RoughPlacement::of(sureness) });
        let mut all: Vec<Candidate> =
            [("a", 1.0), ("b", 2.0), ("c", 3.0), ("d", 4.0)].map(|(hash, score)| candidate(hash, score)).into();
        all[0].rough = rough(-0.2, 1.0);
        all[2].rough = rough(0.6, 0.1);
        all[3].rough = rough(0.3, 0.9);
        let ordered = by_fit(all.clone());
        assert_eq!(hashes(&ordered), "dcab");
        assert_eq!(ordered.iter().map(|c| c.score).collect::<Vec<_>>(), [1.0, 2.0, 3.0, 4.0]);
        // Who is led has all that the leader has, and more.
        all[0].lead = Some(all[3].key());
        assert_eq!(hashes(&by_fit(all.clone())), "adcb");
        all[0].lead = None;
        all.iter_mut().for_each(|c| c.rough = None);
        assert_eq!(hashes(&by_fit(all)), "abcd");
    }

    #[test]
    fn what_lies_on_the_input_best_takes_its_turn_after_the_first_and_what_lay_badly_takes_none() {
        let likeness = |score| Some(Likeness::of(score));
        let mut all: Vec<Candidate> =
            ["a", "b", "c", "d", "e"].iter().zip(1u32..).map(|(hash, s)| candidate(hash, f64::from(s))).collect();
        for (c, score) in all.iter_mut().zip([0.2, 0.9, 0.1, 0.3, 0.5]) {
            c.likeness = likeness(score);
        }
        all[1].similar_to = Some(all[0].key());
        let names = |all: &[Candidate], tries| {
            let name = |key| all.iter().find(|c| c.key() == key).map_or("", |c| c.resident.example.hash.as_str());
            turns(all, tries, false).into_iter().map(name).collect::<String>()
        };
        assert_eq!([1, 2].map(|tries| names(&all, tries)), ["ae", "aced"]);
        let rough = |sureness| Some(RoughPlacement { covered: 0.5, ..RoughPlacement::of(sureness) });
        all[0].rough = rough(2.0 * WORTH_FROM - 0.01);
        assert_eq!(names(&all, 3), "");
        all[0].rough = Some(RoughPlacement { covered: 0.1, ..RoughPlacement::of(SURE_FROM + 0.01) });
        assert_eq!(names(&all, 3), "a", "a hand on an arm");
        all[0].rough = rough(0.0);
        (all[2].rough, all[4].rough) = (rough(2.0 * WORTH_FROM + 0.01), rough(0.4));
        assert_eq!([2, 3].map(|tries| names(&all, tries)), ["ce", "ce"]);
        assert_eq!(names(&all, 1), "e", "what gets one try has to be surer");
        all[4].rough = rough(ONE_TRY_FROM - 0.01);
        assert_eq!(names(&all, 1), "");
        all[4].rough = rough(0.4);
        all[0].lead = Some(all[4].key());
        assert_eq!(names(&all, 3), "ace");
        // A man in armour: hands lie on half of him, and a body all over.
        let body = RoughPlacement { covered: 0.9, are_wholes: true, ..RoughPlacement::of(-0.1) };
        all[3].rough = Some(body.clone());
        assert_eq!([1, 2, 3, 4].map(|tries| names(&all, tries)), ["a", "ad", "acd", "aced"]);
        for other in
            [RoughPlacement { agreement: -0.2, ..body.clone() }, RoughPlacement { covered: 0.5, ..body.clone() }]
        {
            all[3].rough = Some(other);
            assert_eq!(names(&all, 3), "ace");
        }
        all[3].rough = Some(RoughPlacement { are_wholes: false, ..body });
        let turns: Vec<Option<u32>> = entries(&all, 9, &turns(&all, 3, false)).iter().map(|e| e.turn).collect();
        assert_eq!(turns, [Some(1), None, Some(2), None, Some(3)]);
        assert_eq!(template_entry(&[], Topology::Disc).turn, Some(1));
    }

    #[test]
    fn on_what_is_flat_nothing_is_laid_that_bends() {
        let mut all = ["a", "b", "c"].map(|hash| candidate(hash, 1.0));
        for (c, bending) in all.iter_mut().zip([Some(3.5), Some(0.1), None]) {
            let Resident { example, segment, facts, place } = &*c.resident;
            let facts = SegmentFacts { bending, ..*facts };
            c.resident = Arc::new(Resident { example: Arc::clone(example), segment: *segment, facts, place: *place });
        }
        let names = |is_flat| {
            let name = |key| all.iter().find(|c| c.key() == key).map_or("", |c| c.resident.example.hash.as_str());
            turns(&all, 3, is_flat).into_iter().map(name).collect::<String>()
        };
        assert_eq!([false, true].map(names), ["abc", "bc"]);
    }

    #[test]
    fn a_resumed_candidate_takes_its_place_among_those_that_are_done() {
        let mut all = vec![candidate("a", 1.0), candidate("b", 2.0), candidate("c", 2.5), candidate("d", 3.0)];
        for c in &mut all[..2] {
            let mut fine = (*c.registration).clone();
            fine.level = 128;
            c.registration = Arc::new(fine);
        }
        let mut resumed = all[3].clone();
        resumed.registration = Arc::clone(&all[0].registration);
        resumed.score = 1.5;
        resume(&mut all, resumed, 2);
        assert_eq!(hashes(&all), "adbc");
    }
}
