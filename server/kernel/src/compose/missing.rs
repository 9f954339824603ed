//! Segments that are made finer since the whole misses its input there: a mesh that misses it a little is not subdivided
//! everywhere, at four times the quads, for a few places. *Ours, not the paper's.*

use super::fit::Fit;
use super::following::NearMesh;
use super::site::{LayoutKind, Site};
use super::stitching::{MISS_MAX, Stitching};
use crate::numerics::stage::Stage;

/// Share of the distance that is allowed down to which it is expected to come.
const EXPECTED: f64 = 0.9;

/// Share of what is expected that has to come of it.
const WORTH: f64 = 0.25;

/// What a segment would gain.
struct Gain {
    segment: usize,
    /// Distance that is expected to go, of the mean over the whole.
    less: f64,
    /// The same for each quad more.
    each: f64,
}

impl Stitching<'_> {
    /// The segments that are made finer next: for the quads that it takes, what helps most first, until enough is expected
    /// of it; none where the whole follows the input, or one example stands on all of it.
    pub(super) fn missing(&self, sites: &[Site<'_>], near: &NearMesh) -> Vec<usize> {
        let (now, most) = (&near.laid, MISS_MAX * self.scale.diagonal);
        let is_one_part = matches!(sites, [site] if site.stands != LayoutKind::Regular);
        if !Stage::Refine.is_on() || !near.is_missed || is_one_part || now.fit.worst() <= most {
            return Vec::new();
        }
        let [out, back] = self.measured.distances(&now.mesh);
        let distances = if now.fit.out > now.fit.back { out } else { back };
        let mut missed = vec![0.0; sites.len()];
        for &(p, distance) in distances.iter().filter(|d| d.1.is_finite()) {
            if let Some(missed) = self.segment_at(p).and_then(|s| missed.get_mut(s)) {
                *missed += distance / distances.len() as f64;
            }
        }
        let gain = |(segment, site): (usize, &Site<'_>)| {
            let finer = site.finer()?;
            let less = finer.less * missed[segment];
            Some(Gain { segment, less, each: less / finer.quads.max(1.0) })
        };
        let mut gains: Vec<Gain> = sites.iter().enumerate().filter_map(gain).collect();
        gains.sort_by(|a, b| b.each.total_cmp(&a.each));
        let mut left = now.fit.worst() - EXPECTED * most;
        let needed = |gain: Gain| {
            let is_needed = left > 0.0;
            left -= gain.less;
            is_needed.then_some(gain.segment)
        };
        gains.into_iter().map_while(needed).collect()
    }

    /// Whether what was made finer comes near enough to what was expected of it; on a rough scan it does not.
    pub(super) fn is_worth_while(&self, before: Fit, after: Fit) -> bool {
        let expected = before.worst() - EXPECTED * MISS_MAX * self.scale.diagonal;
        before.worst() - after.worst() >= WORTH * expected
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::{Input, Options, apart};
    use crate::topology::tests::grid;

    #[test]
    fn what_comes_to_a_tenth_of_what_was_expected_is_not_worth_while() {
        let surface = grid(8, 8, false, false);
        let owner = vec![0; surface.triangles.len()];
        let input = Input { surface: &surface, owner: &owner, count: 1 };
        let stitching = Stitching::new(input, Options::default(), apart::scale(&surface), u64::MAX);
        let fit = |times: f64| {
            let miss = times * MISS_MAX * stitching.scale.diagonal;
            Fit { out: miss, back: 0.5 * miss }
        };
        let is_worth_while = |before: f64, after: f64| stitching.is_worth_while(fit(before), fit(after));
        assert!(!is_worth_while(10.0, 9.1) && is_worth_while(10.0, 5.0));
        // Near to what is allowed a little is all that is asked.
        assert!(is_worth_while(1.05, 1.0) && !is_worth_while(1.05, 1.05));
    }
}
