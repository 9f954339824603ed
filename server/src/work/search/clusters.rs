//! Clusters of candidates whose pictures are alike, of which one represents the others.
//!
//! A studio has many variants of few characters. The best by their pictures may all be variants of one thing that is not the
//! query's, and only so many candidates can be laid on the query. So they are clustered, as loosely as it takes until every
//! cluster can send one. A corpus that is small enough is left as it is. *Ours, not the paper's.*

use super::SegmentSearch;
use super::coarse::SIMILAR_COST;
use crate::pool::{Lane, Stop};
use crate::work::catalogue::LEVEL_COARSEST;
use crate::work::ranking::Candidate;
use crate::work::{Work, WorkError};
use quadmuse_kernel::register::spectra::{Row, Spectrum};
use quadmuse_proto::{ExampleId, Topology};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// The example and the segment name a candidate.
pub(super) type Key = (ExampleId, u32);

/// The cost up to which two are in one cluster is at first that of near-duplicates ([`SIMILAR_COST`]), then ever more. *Untuned.*
const COST_STEP: f64 = 1.25;
/// Independent pictures have 1.
const COST_MAX: f64 = 1.0;

/// Which candidate represents which others.
#[derive(Debug, Default)]
pub(super) struct Clusters {
    representatives: HashMap<Key, Key>,
}

impl Clusters {
    /// The candidate that represents this one: itself, unless a better one does.
    pub(super) fn representative(&self, of: Key) -> Key {
        self.representatives.get(&of).copied().unwrap_or(of)
    }

    /// Clusters of pairs: a candidate, and the one that represents it.
    #[cfg(test)]
    pub(super) fn of(pairs: impl IntoIterator<Item = (Key, Key)>) -> Self {
        Self { representatives: pairs.into_iter().collect() }
    }

    /// Keeps the first of each cluster, of candidates by their places.
    pub(super) fn first_of_each(
        &self,
        places: impl IntoIterator<Item = usize>,
        candidates: &[Candidate],
    ) -> Vec<usize> {
        let mut seen: HashSet<Key> = HashSet::new();
        places.into_iter().filter(|&at| seen.insert(self.representative(candidates[at].key()))).collect()
    }

    /// Tells whether a candidate represents itself.
    pub(super) fn is_representative(&self, key: Key) -> bool {
        self.representative(key) == key
    }
}

/// Candidates are compared with their like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    /// Whole examples with a rim.
    WithRim,
    /// Parts of examples, with a rim.
    Part,
    /// Closed ones.
    Closed,
}

impl Kind {
    /// The kind of a candidate; `None` of rings, which are not laid in rigid poses.
    pub(super) fn of(candidate: &Candidate) -> Option<Self> {
        match candidate.resident.facts.topology {
            Topology::Disc if candidate.resident.is_part() => Some(Self::Part),
            Topology::Disc => Some(Self::WithRim),
            Topology::Sphere => Some(Self::Closed),
            _ => None,
        }
    }
}

impl SegmentSearch<'_> {
    /// Clusters candidates, best first, so that of each kind at most `most` represent all.
    pub(super) async fn clusters(&self, candidates: &[Candidate], most: usize) -> Result<Clusters, WorkError> {
        let mut kinds: HashMap<Kind, Vec<Key>> = HashMap::new();
        for candidate in candidates.iter().filter(|c| c.similar_to.is_none()) {
            if let Some(kind) = Kind::of(candidate) {
                kinds.entry(kind).or_default().push(candidate.key());
            }
        }
        let mut clusters = Clusters::default();
        for keys in kinds.into_values().filter(|keys| keys.len() > most) {
            let work = Arc::clone(self.work);
            let cluster = move |stop: &Stop| {
                let live = keys.iter().take_while(|_| stop.reason().is_none());
                let rows: Vec<Option<Row>> = live.map(|key| row(&work, *key)).collect();
                let representatives = representatives(&rows, most, stop);
                keys.iter().zip(representatives).map(|(&key, other)| (key, keys[other])).collect::<Vec<_>>()
            };
            clusters.representatives.extend(self.work.pool.run(&self.live.job, Lane::Fine, cluster).await?);
        }
        Ok(clusters)
    }
}

/// The coarsest picture of a candidate; `None` where it can't be read, as where the example was removed meanwhile.
fn row(work: &Work, (id, segment): Key) -> Option<Row> {
    let encoding = work.catalogue.encoding(id, segment, LEVEL_COARSEST).ok()?;
    work.engine.row(&encoding).ok()
}

/// For each picture the place of the one that represents it: the most alike of those before it, at the least cost at which at most
/// `most` represent all. One whose picture is not known represents itself.
fn representatives(rows: &[Option<Row>], most: usize, stop: &Stop) -> Vec<usize> {
    let spectra: Vec<Option<Spectrum>> = rows.iter().map(|row| row.as_ref().map(Row::spectrum)).collect();
    let cost = |one: usize, two: usize| match (&rows[one], &spectra[two]) {
        (Some(row), Some(spectrum)) => row.unmirrored_cost(spectrum),
        _ => f64::INFINITY,
    };
    let live = (0..rows.len()).take_while(|_| stop.reason().is_none());
    let costs: Vec<Vec<f64>> = live.map(|one| (0..one).map(|two| cost(one, two)).collect()).collect();
    let mut bar = SIMILAR_COST;
    loop {
        let found = representatives_within(&costs, bar);
        let count = found.iter().enumerate().filter(|&(place, &other)| place == other).count();
        if count <= most || bar >= COST_MAX || stop.reason().is_some() {
            return found;
        }
        bar *= COST_STEP;
    }
}

/// The same for one cost; `costs[one][two]` for each `two` before `one`.
fn representatives_within(costs: &[Vec<f64>], bar: f64) -> Vec<usize> {
    let mut found: Vec<usize> = Vec::new();
    for (place, costs) in costs.iter().enumerate() {
        let others = (0..place).filter(|&other| found[other] == other && costs[other] <= bar);
        let nearest = others.min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        found.push(nearest.unwrap_or(place));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_kernel::encode::Picture;
    use quadmuse_kernel::register::Flip;
    use quadmuse_kernel::register::image::Image;
    use quadmuse_kernel::register::spectra::SIDE;
    use std::f64::consts::TAU;

    /// Waves of a family, with a little of another on it.
    fn row(family: usize, variant: usize) -> Row {
        let wave = |k: usize, times: usize| (TAU * (times * (k % SIDE) + k / SIDE) as f64 / SIDE as f64).sin();
        let value = |k: usize| (2.0 + wave(k, family) + 0.05 * variant as f64 * wave(k, 9)) as f32;
        let picture = Picture { side: SIDE, values: (0..SIDE * SIDE).map(value).collect() };
        let image = Image::new(&picture, Flip::default(), false);
        Row::new(&image, quadmuse_kernel::topology::Topology::Disc).expect("of 32²")
    }

    #[test]
    fn the_best_of_each_family_represents_it() {
        let rows = [(1, 0), (1, 3), (2, 0), (1, 5), (2, 3), (3, 0)].map(|(f, v)| Some(row(f, v)));
        let stop = Stop::new(None);
        assert_eq!(representatives(&rows, 3, &stop), [0, 0, 2, 0, 2, 5]);
        assert_eq!(representatives(&rows, 6, &stop), [0, 0, 2, 3, 2, 5], "near-duplicates alone, where all may come");
        let [one, other, ..] = rows;
        let unknown = [one, None, other];
        assert_eq!(representatives(&unknown, 2, &stop), [0, 1, 0]);
    }

    #[test]
    fn variants_that_merge_into_each_other_are_not_all_one() {
        // 0 and 3 are far apart, each next to its neighbour.
        let costs = [vec![], vec![0.3], vec![0.6, 0.3], vec![0.9, 0.6, 0.3]];
        assert_eq!(representatives_within(&costs, 0.3), [0, 0, 2, 2]);
    }
}
