//! The smooth functions that shapes are sculpted with.

use quadmuse_kernel::mesh::Vec3;

/// exp(−r²) of an ellipse: 1 at its centre, 0.37 on its outline.
pub(super) fn bump(d: [f64; 2], radii: [f64; 2]) -> f64 {
    (-(d[0] / radii[0]).powi(2) - (d[1] / radii[1]).powi(2)).exp()
}

/// exp(−r²) of an ellipsoid around `centre`.
pub(super) fn blob(p: &Vec3, centre: [f64; 3], radii: [f64; 3]) -> f64 {
    let r: f64 = (0..3).map(|k| ((p[k] - centre[k]) / radii[k]).powi(2)).sum();
    (-r).exp()
}

/// 0 below `low`, 1 above `high`, smooth between; `low` > `high` turns it round.
pub(super) fn step(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The uniform Catmull–Rom spline through `keys` at 0, 1, 2…; `before` and `after` are the ghosts at −1 and n.
pub(super) fn spline<const N: usize>(keys: &[[f64; N]], before: [f64; N], after: [f64; N], t: f64) -> [f64; N] {
    let k = (t.floor().max(0.0) as usize).min(keys.len().saturating_sub(2));
    let s = t - k as f64;
    let key = |i: usize| if i == 0 { before } else { keys.get(i - 1).copied().unwrap_or(after) };
    let (p, q, r, u) = (key(k), key(k + 1), key(k + 2), key(k + 3));
    std::array::from_fn(|i| {
        let (a, b, c, d) = (p[i], q[i], r[i], u[i]);
        b + 0.5 * s * (c - a + s * (2.0 * a - 5.0 * b + 4.0 * c - d + s * (3.0 * (b - c) + d - a)))
    })
}

/// The spline with its ends continued straight.
pub(super) fn curve<const N: usize>(keys: &[[f64; N]], t: f64) -> [f64; N] {
    let n = keys.len();
    let ghost = |end: usize, next: usize| std::array::from_fn(|i| 2.0 * keys[end][i] - keys[next][i]);
    spline(keys, ghost(0, 1), ghost(n - 1, n - 2), t.clamp(0.0, (n - 1) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_passes_its_keys_and_is_straight_between_equal_steps() {
        let keys = [[0.0], [1.0], [2.0], [3.0]];
        for t in [0.0, 0.3, 1.0, 2.7, 3.0] {
            assert!((curve(&keys, t)[0] - t).abs() < 1e-12);
        }
        let bent = [[0.0], [5.0], [1.0]];
        assert_eq!(curve(&bent, 1.0), [5.0]);
    }

    #[test]
    fn a_step_goes_both_ways() {
        assert_eq!((step(0.0, 1.0, 0.5), step(1.0, 0.0, 0.0), step(1.0, 0.0, 2.0)), (0.5, 1.0, 0.0));
    }
}
