//! v′: the share of the surface's area that lies below a level of v.
//!
//! A point has no capacity, so harmonic v depends on the mesh's size near its pole; the area below a level does not.
//! v is linear on triangles, so the area is a piecewise quadratic of the level, evaluated exactly at up to 4096
//! levels. *Ours, not the paper's* (its Eq. 3 on v): METHOD §2.

use crate::mesh::tri::TriMesh;
use crate::numerics::stop;

/// Shares of the area between which a sphere's modulus looks, and below the second of which a disc's does. *Source:* METHOD §2.
pub const MODULUS_SHARES: [f64; 2] = [0.1, 0.9];

/// Levels at which the area is tabulated.
const LEVELS_MAX: usize = 4096;
/// The same for charts of poles that are only tried, which are looked at in pictures of 64².
const LEVELS_TRIED_MAX: usize = 512;

/// Area below each of increasing levels of v, as a share of the whole.
#[derive(Clone, Debug)]
pub struct AreaFraction {
    levels: Vec<f64>,
    below: Vec<f64>,
}

impl AreaFraction {
    /// Tabulates the area of `mesh` below levels of `v` (one value a vertex).
    pub fn new(mesh: &TriMesh, v: &[f64]) -> Self {
        Self::at_levels(mesh, v, LEVELS_MAX)
    }

    /// The same at fewer levels, for what is only tried.
    pub fn rough(mesh: &TriMesh, v: &[f64]) -> Self {
        Self::at_levels(mesh, v, LEVELS_TRIED_MAX)
    }

    fn at_levels(mesh: &TriMesh, v: &[f64], levels_max: usize) -> Self {
        let levels = quantiles(v, levels_max);
        let bins = levels.len() - 1;
        let mut mass = vec![0.0; bins];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|c| v[c as usize]);
            let (low, high) = (a.min(b), a.max(b));
            let x = [low.min(c), low.max(high.min(c)), high.max(c)];
            let area = mesh.area(t);
            let first = levels.partition_point(|&l| l <= x[0]).saturating_sub(1).min(bins - 1);
            stop::pass(1);
            let mut done = 0.0;
            for bin in first..bins {
                let share = if bin + 1 == bins { 1.0 } else { share_below(x, levels[bin + 1]) };
                mass[bin] += area * (share - done);
                done = share;
                if share >= 1.0 {
                    break;
                }
            }
        }
        let total: f64 = mass.iter().sum();
        let mut below = Vec::with_capacity(levels.len());
        let mut sum = 0.0;
        below.push(0.0);
        for m in mass {
            sum += m;
            below.push(sum / total);
        }
        Self { levels, below }
    }

    /// The share of the area below `v`.
    pub fn at(&self, v: f64) -> f64 {
        interpolate(&self.levels, &self.below, v)
    }

    /// The level below which a share of the area lies.
    pub fn level(&self, share: f64) -> f64 {
        interpolate(&self.below, &self.levels, share)
    }
}

/// Increasing levels from the lowest to the highest value, about as many values between any two.
fn quantiles(v: &[f64], levels_max: usize) -> Vec<f64> {
    let mut sorted = v.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let steps = sorted.len().clamp(2, levels_max);
    let mut levels: Vec<f64> = (0..=steps).map(|k| sorted[(k * (sorted.len() - 1)) / steps]).collect();
    levels.dedup();
    if levels.len() < 2 {
        levels.push(levels[0] + 1.0);
    }
    levels
}

/// Share of a triangle with corner values x₀ ≤ x₁ ≤ x₂ that lies below `level`.
fn share_below(x: [f64; 3], level: f64) -> f64 {
    // Far out on a ribbon v has decayed so far that products of it are none.
    let share = |part: f64, p: f64, q: f64| match p * q {
        product if product >= f64::MIN_POSITIVE => part * part / product,
        _ => (part / p) * (part / q),
    };
    if level >= x[2] {
        1.0
    } else if level <= x[0] {
        0.0
    } else if level <= x[1] {
        share(level - x[0], x[1] - x[0], x[2] - x[0])
    } else {
        1.0 - share(x[2] - level, x[2] - x[1], x[2] - x[0])
    }
}

fn interpolate(xs: &[f64], ys: &[f64], x: f64) -> f64 {
    let k = xs.partition_point(|&l| l <= x).clamp(1, xs.len() - 1);
    let (x0, x1) = (xs[k - 1], xs[k]);
    let f = if x1 > x0 { ((x - x0) / (x1 - x0)).clamp(0.0, 1.0) } else { 0.0 };
    ys[k - 1] + f * (ys[k] - ys[k - 1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_linear_function_on_a_square_has_its_own_value_as_area_fraction() {
        let mesh = grid(13, 11, false, false);
        let v: Vec<f64> = mesh.positions.iter().map(|p| p.x).collect();
        let fraction = AreaFraction::new(&mesh, &v);
        for &x in &v {
            assert!((fraction.at(x) - x).abs() < 1e-12);
        }
        assert!((fraction.level(0.9) - 0.9).abs() < 1e-9);
    }

    #[test]
    fn what_has_decayed_far_is_shared_out_as_what_has_not() {
        let shares = [1.0, 1e-200, 1e-300].map(|unit| share_below([0.0, unit, 3.0 * unit], 2.0 * unit));
        assert!(shares.iter().all(|share| (share - 5.0 / 6.0).abs() < 1e-9), "{shares:?}");
    }

    #[test]
    fn a_constant_function_does_no_harm() {
        let mesh = grid(2, 2, false, false);
        let fraction = AreaFraction::new(&mesh, &vec![0.5; mesh.positions.len()]);
        assert!(fraction.at(0.5).is_finite());
    }
}
