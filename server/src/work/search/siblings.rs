//! Segments of one example of which only the best is listed: its whole and its parts, and its parts among each other.
//!
//! They would stand in a ranking as so many choices, and be registered and laid as so many, though whoever chooses one of them
//! chooses the one example.

use super::coarse::RankedSegment;
use quadmuse_kernel::rank::coarse::{self, Bounds};
use quadmuse_proto::ExampleId;
use std::collections::{HashMap, HashSet};

/// The places, ascending, of all whose segments could be among the best `kept` where an example counts once: `owner` tells the
/// example of a place that has siblings.
pub(super) fn could_be_kept(bounds: &[Bounds], kept: usize, owner: impl Fn(usize) -> Option<ExampleId>) -> Vec<usize> {
    let mut least: HashMap<ExampleId, f32> = HashMap::new();
    let mut highs = Vec::new();
    for (place, bound) in bounds.iter().enumerate().filter(|(_, bound)| bound.high.is_finite()) {
        match owner(place) {
            Some(example) => {
                least.entry(example).and_modify(|high| *high = high.min(bound.high)).or_insert(bound.high);
            }
            None => highs.push(bound.high),
        }
    }
    if least.is_empty() {
        return coarse::could_be_kept(bounds, kept);
    }
    highs.extend(least.values());
    if kept == 0 {
        return Vec::new();
    }
    let at = kept.min(highs.len()) - 1;
    let limit = *highs.select_nth_unstable_by(at, f32::total_cmp).1;
    let is_best = |place: usize| {
        let best = owner(place).and_then(|example| least.get(&example).copied());
        best.is_none_or(|best| bounds[place].low <= best)
    };
    (0..bounds.len()).filter(|&place| bounds[place].low <= limit && is_best(place)).collect()
}

/// Leaves the first of each example's segments that have siblings.
pub(super) fn best_of_each(ranked: &mut Vec<RankedSegment>) {
    let mut seen = HashSet::new();
    ranked.retain(|one| !one.resident.has_siblings() || seen.insert(one.resident.example.id));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_example_counts_once_among_the_best_and_its_worse_segments_are_left_out() {
        let bound = |low, high| Bounds { low, high };
        let (one, two) = (ExampleId::generate(), ExampleId::generate());
        let owners = [Some(one), Some(one), Some(one), None, Some(two), None, Some(two)];
        let bounds = [
            bound(0.1, 0.2),
            bound(0.15, 0.25),
            bound(0.3, 0.4),
            bound(0.5, 0.6),
            bound(0.55, 0.7),
            bound(0.8, 0.9),
            Bounds::NONE,
        ];
        let kept = |most| could_be_kept(&bounds, most, |place| owners[place]);
        assert_eq!(kept(1), [0, 1]);
        // Counted by segments, the first two would be two, and the limit .25.
        assert_eq!(kept(2), [0, 1, 3, 4]);
        assert_eq!(kept(3), [0, 1, 3, 4]);
        assert_eq!(kept(9), [0, 1, 3, 4, 5]);
        assert_eq!(kept(0), Vec::<usize>::new());
        let alone = could_be_kept(&bounds, 2, |_| None);
        assert_eq!(alone, coarse::could_be_kept(&bounds, 2));
    }
}
