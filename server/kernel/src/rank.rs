//! Ranking: the score E′ of a registration.
//!
//! E′ = r_max/(r + r_max) · (1 + 4·(log m₁/m₂)² + 2·(log H₁/H₂)²) · E/(var √λ₁ + var √λ₂).
//! *Source:* paper Eq. 8. *Ours, not the paper's:* E is divided by the variances, since plain E favours flat
//! pictures; the modulus takes the place of k (METHOD §6); H, how the surface bends ([`bending`]), stands beside it.

pub mod bending;
pub mod coarse;

/// Highest relevance. *Source:* paper §5.1.
pub const RELEVANCE_MAX: f64 = 5.0;
/// Weight of the moduli's difference.
const MODULUS_WEIGHT: f64 = 4.0;
/// Weight of the difference in bending: of 0, ¼, ½, 1, 2, 4, 8 on the labelled meshes, where 1 to 8 are much the same on either half of
/// the identities (tests/records).
const BENDING_WEIGHT: f64 = 2.0;
/// Less bending than this, a tenth of a sphere's, is none: a surface that bends inward as much as outward.
const BENDING_MIN: f64 = 0.354;

/// Tells whether a surface with such a [`bending`](bending::bending) bends to one side: a flat one does not.
pub fn bends(bending: f32) -> bool {
    f64::from(bending).abs() >= BENDING_MIN
}

/// What is compared of two segments beside their pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SegmentShape {
    /// The modulus.
    pub modulus: f64,
    /// How it bends ([`bending::bending`]); `None` where it isn't known: then it isn't compared.
    pub bending: Option<f32>,
}

/// E′, the lower the better. `cost` is E / (var √λ₁ + var √λ₂).
pub fn score(cost: f64, example: SegmentShape, query: SegmentShape, relevance: f64) -> f64 {
    let squared = |ratio: f64| if ratio.is_finite() { ratio * ratio } else { 0.0 };
    let moduli = squared((example.modulus / query.modulus).ln());
    let bending = match (example.bending, query.bending) {
        (Some(one), Some(two)) => squared((f64::from(one).max(BENDING_MIN) / f64::from(two).max(BENDING_MIN)).ln()),
        _ => 0.0,
    };
    let penalty = 1.0 + MODULUS_WEIGHT * moduli + BENDING_WEIGHT * bending;
    RELEVANCE_MAX / (relevance.clamp(0.0, RELEVANCE_MAX) + RELEVANCE_MAX) * penalty * cost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relevance_halves_at_most_and_another_shape_costs() {
        let of = |modulus, bending| SegmentShape { modulus, bending };
        let plain = |one, two, relevance| score(0.2, of(one, None), of(two, Some(3.0)), relevance);
        assert_eq!(plain(0.4, 0.4, 0.0), 0.2);
        assert_eq!(plain(0.4, 0.4, 5.0), 0.1);
        assert!(plain(0.4, 0.8, 0.0) > 0.5);
        assert_eq!(plain(0.4, 0.8, 1.0), plain(0.8, 0.4, 1.0));
        let bent = |one, two| score(0.2, of(0.4, Some(one)), of(0.4, Some(two)), 0.0);
        assert_eq!(bent(3.0, 3.0), 0.2);
        assert!(bent(3.0, 7.0) > 0.4 && (bent(3.0, 7.0) - bent(7.0, 3.0)).abs() < 1e-12);
        assert_eq!(bent(-3.0, 3.0), bent(0.1, 3.0));
    }
}
