//! Compares the limbs of two closed surfaces, whatever poses they are in: a sitting cat is like a standing one.

use super::TIPS_MIN;
use super::assignment::Assignments;
use crate::register::Query;
use crate::topology::Topology;
use crate::unfold::pole::Breadth;

/// Distances along a closed surface between the tips of its limbs, in √area.
#[derive(Clone, Debug)]
pub struct LimbDistances {
    between: Vec<Vec<f64>>,
}

impl LimbDistances {
    /// Measures a surface; `None` where it is not closed or has too few limbs.
    pub fn of(surface: &Query) -> Option<Self> {
        if surface.encoding().topology != Topology::Sphere {
            return None;
        }
        let tips = surface.matched_by(Breadth::Limbs);
        (tips.vertices.len() >= TIPS_MIN).then(|| Self { between: tips.between.clone() })
    }

    /// Returns the mean disagreement with the distances of another surface once tips are matched best, unmatched tips included: 0 for an
    /// isometry, ln 2 at most.
    pub fn disagreement(&self, other: &Self) -> f64 {
        let likely = Assignments::new([&self.between, &other.between], 0).likely();
        likely.first().map_or(std::f64::consts::LN_2, |best| best.distortion)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tips at the ends of paths of these lengths from one point.
    fn star(lengths: &[f64]) -> LimbDistances {
        let between = |a: usize| {
            let one = |b: usize| if a == b { 0.0 } else { lengths[a] + lengths[b] };
            (0..lengths.len()).map(one).collect()
        };
        LimbDistances { between: (0..lengths.len()).map(between).collect() }
    }

    #[test]
    fn limbs_as_long_agree_in_any_order_and_others_do_not() {
        let cat = star(&[0.5, 0.5, 0.6, 0.6, 0.9, 0.3]);
        let sitting = star(&[0.3, 0.6, 0.5, 0.9, 0.6, 0.5]);
        let starfish = star(&[0.9, 0.9, 0.9, 0.9, 0.9]);
        assert!(cat.disagreement(&sitting) < 1e-6);
        assert!(cat.disagreement(&starfish) > 0.1 && starfish.disagreement(&cat) > 0.1);
    }
}
