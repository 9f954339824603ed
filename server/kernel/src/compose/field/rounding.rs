//! Whole numbers near the least of a quadratic form.
//!
//! E(x) = ½ xᵀSx − gᵀx. One number after another, always that which the conditional least ⟨x⟩ puts nearest to a whole
//! one, is set to that, and ⟨x⟩ and the covariance S⁻¹ are conditioned on it; then single steps by ±1 are taken as long as
//! one lowers E. *Source:* the order of rounding is that of Bommes, Zimmer, Kobbelt, *Mixed-integer quadrangulation* (2009),
//! §4. *Ours, not the paper's:* on the Schur complement, so that no step solves for the surface again; and the steps by ±1.

use crate::numerics::stop;

/// This is added to the diagonal, as a share of its largest: directions in which all may be shifted alike have no least.
const DAMPING: f64 = 1e-10;
/// Steps by ±1 at most, for each number: *untuned*, some one in ten numbers takes one.
const STEPS_PER_NUMBER: usize = 4;

/// A quadratic form with its least.
pub(super) struct Quadratic {
    s: Vec<f64>,
    covariance: Vec<f64>,
    /// Where it is least.
    pub(super) mean: Vec<f64>,
}

impl Quadratic {
    /// Of a symmetric positive semidefinite `n × n` matrix S and g; `None` where it is not even that.
    pub(super) fn new(s: Vec<f64>, g: &[f64]) -> Option<Self> {
        let n = g.len();
        let covariance = inverse(&s, n)?;
        let mean = (0..n).map(|i| (0..n).map(|j| covariance[i * n + j] * g[j]).sum()).collect();
        Some(Self { s, covariance, mean })
    }
}

/// Whole numbers for a form whose g is `scale` times as large.
pub(super) fn rounded(form: &Quadratic, g: &[f64], scale: f64) -> Option<Vec<i64>> {
    let n = g.len();
    let (s, mut covariance) = (&form.s, form.covariance.clone());
    let mut mean: Vec<f64> = form.mean.iter().map(|x| x * scale).collect();
    let g: Vec<f64> = g.iter().map(|x| x * scale).collect();
    let mut whole: Vec<Option<f64>> = vec![None; n];
    for _ in 0..n {
        stop::ask();
        let open = (0..n).filter(|&k| whole[k].is_none());
        let off = |k: usize| (mean[k] - mean[k].round()).abs();
        let k = open.min_by(|&a, &b| off(a).total_cmp(&off(b)))?;
        let value = mean[k].round();
        if value.is_nan() || value.abs() > 1e9 {
            return None;
        }
        whole[k] = Some(value);
        let variance = covariance[k * n + k];
        if variance <= 0.0 {
            mean[k] = value;
            continue;
        }
        let column: Vec<f64> = (0..n).map(|i| covariance[i * n + k]).collect();
        let step = (value - mean[k]) / variance;
        (0..n).for_each(|i| mean[i] += column[i] * step);
        for i in (0..n).filter(|&i| column[i] != 0.0) {
            let share = column[i] / variance;
            let row = &mut covariance[i * n..(i + 1) * n];
            row.iter_mut().zip(&column).for_each(|(c, x)| *c -= share * x);
        }
    }
    let mut x: Vec<f64> = whole.into_iter().map(|x| x.unwrap_or_default()).collect();
    descend(s, &g, &mut x);
    Some(x.into_iter().map(|x| x as i64).collect())
}

fn descend(s: &[f64], g: &[f64], x: &mut [f64]) {
    let n = g.len();
    let mut slope: Vec<f64> = (0..n).map(|i| (0..n).map(|j| s[i * n + j] * x[j]).sum::<f64>() - g[i]).collect();
    for _ in 0..STEPS_PER_NUMBER * n {
        stop::pass(n);
        let gain = |k: usize| 0.5 * s[k * n + k] - slope[k].abs();
        let Some(k) = (0..n).min_by(|&a, &b| gain(a).total_cmp(&gain(b))) else { return };
        if gain(k) >= -1e-9 * s[k * n + k] {
            return;
        }
        let step = -slope[k].signum();
        x[k] += step;
        (0..n).for_each(|i| slope[i] += step * s[k * n + i]);
    }
}

/// The inverse of a symmetric matrix, damped, by Cholesky.
fn inverse(s: &[f64], n: usize) -> Option<Vec<f64>> {
    let largest = (0..n).map(|k| s[k * n + k]).fold(0.0, f64::max);
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        stop::pass(n * i);
        for j in 0..=i {
            let dot: f64 = l[i * n..i * n + j].iter().zip(&l[j * n..j * n + j]).map(|(a, b)| a * b).sum();
            let rest = s[i * n + j] - dot;
            if i == j {
                l[i * n + i] = (rest + DAMPING * largest).max(DAMPING * largest).sqrt();
            } else {
                l[i * n + j] = rest / l[j * n + j];
            }
        }
    }
    if l.iter().any(|x| !x.is_finite()) || largest <= 0.0 {
        return None;
    }
    // The rows of L⁻ᵀ, column by column of L⁻¹.
    let mut lower = vec![0.0; n * n];
    for c in 0..n {
        stop::pass(n * n / 2);
        for i in c..n {
            let dot: f64 = (c..i).map(|k| l[i * n + k] * lower[c * n + k]).sum();
            lower[c * n + i] = (f64::from(u8::from(i == c)) - dot) / l[i * n + i];
        }
    }
    let mut inverse = vec![0.0; n * n];
    for i in 0..n {
        stop::pass(n * (n - i) / 2);
        for j in i..n {
            let dot: f64 =
                lower[i * n + j..(i + 1) * n].iter().zip(&lower[j * n + j..(j + 1) * n]).map(|(a, b)| a * b).sum();
            inverse[i * n + j] = dot;
            inverse[j * n + i] = dot;
        }
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_is_one() {
        let (n, s) = (3, [4.0, 1.0, 0.5, 1.0, 3.0, -1.0, 0.5, -1.0, 2.0]);
        let inverse = inverse(&s, n).expect("positive definite");
        for i in 0..n {
            for j in 0..n {
                let sum: f64 = (0..n).map(|k| s[i * n + k] * inverse[k * n + j]).sum();
                assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-6, "{i} {j} {sum}");
            }
        }
    }

    #[test]
    fn a_pair_that_holds_each_other_is_rounded_together() {
        // x₁ ≈ x₀ + 1 strongly; both near .6 and 1.4: rounding each alone gives 1 and 1.
        let (strong, at) = (100.0, [0.6, 1.4]);
        let s = [1.0 + strong, -strong, -strong, 1.0 + strong];
        let g = [at[0] - strong, at[1] + strong];
        let x = rounded(&Quadratic::new(s.to_vec(), &g).expect("finite"), &g, 1.0).expect("finite");
        assert_eq!(x[1] - x[0], 1);
    }

    #[test]
    fn no_step_by_one_makes_it_better() {
        let n = 12;
        let noise = |k: usize| ((k as f64 * 12.9898).sin() * 43758.5453).fract();
        let a: Vec<f64> = (0..n * n).map(noise).collect();
        let s: Vec<f64> =
            (0..n * n).map(|e| (0..n).map(|k| a[e / n * n + k] * a[e % n * n + k]).sum::<f64>()).collect();
        let g: Vec<f64> = (0..n).map(|k| 5.0 * noise(1000 + k)).collect();
        let x: Vec<f64> = {
            let form = Quadratic::new(s.clone(), &g).expect("finite");
            rounded(&form, &g, 1.0).expect("finite").into_iter().map(|x| x as f64).collect()
        };
        let energy = |x: &[f64]| -> f64 {
            (0..n).map(|i| x[i] * (0.5 * (0..n).map(|j| s[i * n + j] * x[j]).sum::<f64>() - g[i])).sum()
        };
        for k in 0..n {
            for step in [-1.0, 1.0] {
                let mut other = x.clone();
                other[k] += step;
                assert!(energy(&other) >= energy(&x) - 1e-6);
            }
        }
    }
}
