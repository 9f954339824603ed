//! Ranking: the score E′ of a registration.
//!
//! E′ = r_max/(r + r_max) · (1 + 4·(log m₁/m₂)²) · E/(var √λ₁ + var √λ₂).
//! *Source:* paper Eq. 8. *Ours, not the paper's:* E is divided by the variances, since plain E favours flat
//! pictures, and the modulus takes the place of k (METHOD §6).

pub mod coarse;

/// Highest relevance. *Source:* paper §5.1.
pub const RELEVANCE_MAX: f64 = 5.0;
/// Weight of the moduli's difference.
const MODULUS_WEIGHT: f64 = 4.0;
/// E′, the lower the better. `cost` is E / (var √λ₁ + var √λ₂).
pub fn score(cost: f64, example_modulus: f64, query_modulus: f64, relevance: f64) -> f64 {
    let ratio = (example_modulus / query_modulus).ln();
    let penalty = if ratio.is_finite() { 1.0 + MODULUS_WEIGHT * ratio * ratio } else { 1.0 };
    RELEVANCE_MAX / (relevance.clamp(0.0, RELEVANCE_MAX) + RELEVANCE_MAX) * penalty * cost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relevance_halves_at_most_and_a_wrong_modulus_costs() {
        assert_eq!(score(0.2, 0.4, 0.4, 0.0), 0.2);
        assert_eq!(score(0.2, 0.4, 0.4, 5.0), 0.1);
        assert!(score(0.2, 0.4, 0.8, 0.0) > 0.5);
        assert_eq!(score(0.2, 0.4, 0.8, 1.0), score(0.2, 0.8, 0.4, 1.0));
    }
}
