//! How well one of two surfaces lies on the other, over all poses that were looked at.

use super::{Large, MetSample, PosedSurface, Posing, RELIEF_SCALES, Small, near};
use crate::numerics::stop::Stop;
use crate::settle::evidence::correlation;

/// How well one of two surfaces lies on the other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Likeness {
    /// The score of the best pose, at most 1; of two closed surfaces the lower of the two.
    pub score: f64,
    /// The best score times the size of the part of the other that it covers, in √area of all of it: what lies beyond that part
    /// is not known to be like anything. Where one of the two is closed, the part is of that one.
    pub weighed: f64,
    /// The share of the other's relief that a pose explains, at most 1: a face explains more of a head than the back of one does, and
    /// a piece of cloth, which lies well on much that is smooth, next to nothing.
    pub explained: f64,
}

impl Likeness {
    /// Of surfaces that lie on each other as they are.
    pub fn of(score: f64) -> Self {
        Self { score, weighed: score, explained: score }
    }

    /// The better of each.
    fn or(self, other: Self) -> Self {
        let Self { score, weighed, explained } = other;
        Self {
            score: self.score.max(score),
            weighed: self.weighed.max(weighed),
            explained: self.explained.max(explained),
        }
    }
}

/// Which of two surfaces, of which one is laid on the other, is explained.
enum Explained {
    Smaller,
    Larger,
}

impl PosedSurface {
    /// How like another it is, of which it tells what is explained; not at all where there is no pose, or when stopped.
    pub fn likeness(&self, other: &Self, stop: Stop<'_>) -> Likeness {
        match (&self.whole, &other.whole) {
            (Some(one), Some(two)) => {
                let best = |small: &Small, large: &Large| {
                    let found = small.tried_whole(large, self.effort, stop);
                    found.iter().map(|(score, _)| *score).fold(0.0, f64::max)
                };
                Likeness::of(best(&one.small, &two.large).min(best(&two.small, &one.large)))
            }
            (None, Some(_)) => self.as_part(other, &Explained::Larger, stop),
            (Some(_), None) => other.as_part(self, &Explained::Smaller, stop),
            (None, None) => {
                let one = self.as_part(other, &Explained::Larger, stop);
                let two = other.as_part(self, &Explained::Smaller, stop);
                // What covers all of it is of its size.
                one.or(Likeness { weighed: two.score, ..two })
            }
        }
    }

    /// How well it lies on another as a part of it, and what that explains of one of the two.
    fn as_part(&self, of: &Self, explains: &Explained, stop: Stop<'_>) -> Likeness {
        let Some(small) = &self.small else { return Likeness::default() };
        let mut best = Likeness::default();
        for (large, found) in of.large.iter().zip(small.tried(of, stop)) {
            for Posing { score, motion, met } in found {
                let scale = small.onto(large, &motion).scale;
                let size = (scale * (self.area / of.area).sqrt()).min(1.0);
                let explained = small.explained(large, &met, explains);
                best = best.or(Likeness { score, weighed: score * size, explained });
            }
        }
        best
    }
}

impl Small {
    /// The share of the relief of one of the two surfaces that a pose explains: the share of Σ height² that is met, times the
    /// correlation there, as in the score.
    fn explained(&self, large: &Large, met: &[MetSample], of: &Explained) -> f64 {
        let of_scale = |s: usize| {
            let value = |(k, m): (usize, &MetSample)| {
                let weight = m.facing * near(&m.at, &large.seen.samples.points[m.partner]);
                (self.relief[k][s], large.heights(m.partner)[s], weight)
            };
            let values: Vec<(f64, f64, f64)> = met.iter().enumerate().map(value).collect();
            let (met, all) = match of {
                Explained::Smaller => {
                    let own = values.iter().map(|(own, _, weight)| (own * own * weight, own * own));
                    own.fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1))
                }
                Explained::Larger => {
                    let there: f64 = values.iter().map(|(_, there, weight)| there * there * weight).sum();
                    // The smaller surface has area 1.
                    (there / values.len().max(1) as f64, large.relief_sums()[s])
                }
            };
            let share = if all > 0.0 { (met / all).min(1.0) } else { 0.0 };
            share * correlation(&values).max(0.0)
        };
        (0..RELIEF_SCALES.len()).map(of_scale).sum::<f64>() / RELIEF_SCALES.len() as f64
    }
}
