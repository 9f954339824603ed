//! ψ at one point in one pass over the controls: what editing a map evaluates ten thousand times.
//!
//! With d = p − x and W, D, Q, C = Σw, Σw·d, Σw·(q − x), Σw·conj(d)·(q − x) over the images of the controls:
//!
//! ```text
//! q* = x + Q/W     z = −D/W     M = Σw·conj(p̂)·q = C − conj(D/W)·Q
//! ```
//!
//! since Σw·p̂ = 0 lets any constant be taken from q. *Source:* [`super::mls`], whose [`mls::psi`](super::mls::psi) is
//! the plain twin that this is tested against.

use super::mls::{Domain, ROTATION_MIN, TINY, for_each_image, length, orbit_v};
use crate::unfold::Uv;

/// Points of a row that are evaluated side by side.
const LANES: usize = 16;

/// ψ at `x`. With no control near, the identity.
pub fn psi(domain: Domain, p: &[Uv], q: &[Uv], x: Uv) -> Uv {
    let (mut w_sum, mut d_sum, mut q_sum, mut c) = (0.0, [0.0; 2], [0.0; 2], [0.0; 2]);
    for_each_image(domain, p, x, |i, w, d, period, [sign, offset]| {
        let to = [domain.aspect * (q[i][0] + period - x[0]), sign * q[i][1] + offset - x[1]];
        w_sum += w;
        d_sum[0] += w * d[0];
        d_sum[1] += w * d[1];
        q_sum[0] += w * to[0];
        q_sum[1] += w * to[1];
        c[0] += w * (d[0] * to[0] + d[1] * to[1]);
        c[1] += w * (d[0] * to[1] - d[1] * to[0]);
    });
    if w_sum <= 0.0 {
        return x;
    }
    let (mean, star) = (d_sum.map(|s| s / w_sum), q_sum.map(|s| s / w_sum));
    let m = [c[0] - (mean[0] * q_sum[0] + mean[1] * q_sum[1]), c[1] - (mean[0] * q_sum[1] - mean[1] * q_sum[0])];
    let size = length(m);
    let e = if size > ROTATION_MIN { [m[0] / size, m[1] / size] } else { [1.0, 0.0] };
    let r = [-(mean[0] * e[0] - mean[1] * e[1]), -(mean[0] * e[1] + mean[1] * e[0])];
    [x[0] + (star[0] + r[0]) / domain.aspect, x[1] + star[1] + r[1]]
}

/// ψ(x) − x in f32 at the nodes of row `row` of a grid of `side` nodes a row: what looking for folds starts with. Only
/// what is inlined into a [`Wide`](crate::numerics::wide::Wide) computation has wide vectors.
#[inline(always)]
pub(super) fn roughly_moved(domain: Domain, p: &[Uv], q: &[Uv], side: usize, row: usize) -> Vec<[f32; 2]> {
    let mut all = Vec::with_capacity(side + 1);
    for from in (0..side).step_by(LANES) {
        let mut u = [0.0f32; LANES];
        for k in 0..LANES {
            u[k] = (from + k) as f32 / side as f32;
        }
        let sums = RoughDisplacements::of(domain, p, q, &u, row as f32 / side as f32);
        for k in 0..LANES.min(side - from) {
            all.push([sums.0[0][k], sums.0[1][k]]);
        }
    }
    all
}

/// Displacements at points side by side, from W, D, Q and C there.
struct RoughDisplacements([[f32; LANES]; 2]);

impl RoughDisplacements {
    #[inline(always)]
    fn of(domain: Domain, p: &[Uv], q: &[Uv], u: &[f32; LANES], v: f32) -> Self {
        let (aspect, last) = (domain.aspect as f32, u[LANES - 1]);
        let mut sums = [[0.0f32; LANES]; 7];
        for (p, q) in p.iter().zip(q) {
            for [sign, offset] in orbit_v(domain.topology) {
                let dv = (sign * p[1] + offset) as f32 - v;
                let fade_v = 1.0 - dv * dv;
                if fade_v <= 0.0 {
                    continue;
                }
                let to_v = (sign * q[1] + offset) as f32 - v;
                // 0 ≤ u < 1: of the images one period apart these may be near.
                let home = -p[0].floor();
                for period in [home - 1.0, home, home + 1.0] {
                    let (from, to) = ((p[0] + period) as f32, (q[0] + period) as f32);
                    if from - last >= 1.0 || u[0] - from >= 1.0 {
                        continue;
                    }
                    for k in 0..LANES {
                        let du = from - u[k];
                        let fade = (1.0 - du * du).max(0.0) * fade_v;
                        let (d, to_u) = (aspect * du, aspect * (to - u[k]));
                        let w = fade * fade / (d * d + dv * dv + TINY as f32);
                        let (wd, wv) = (w * d, w * dv);
                        sums[0][k] += w;
                        sums[1][k] += wd;
                        sums[2][k] += wv;
                        sums[3][k] += w * to_u;
                        sums[4][k] += w * to_v;
                        sums[5][k] += wd * to_u + wv * to_v;
                        sums[6][k] += wd * to_v - wv * to_u;
                    }
                }
            }
        }
        let mut moved = [[0.0f32; LANES]; 2];
        for k in 0..LANES {
            let over = if sums[0][k] > 0.0 { 1.0 / sums[0][k] } else { 0.0 };
            let [d0, d1, q0, q1] = [1, 2, 3, 4].map(|c| sums[c][k]);
            let (mean, star) = ([d0 * over, d1 * over], [q0 * over, q1 * over]);
            let m = [sums[5][k] - (mean[0] * q0 + mean[1] * q1), sums[6][k] - (mean[0] * q1 - mean[1] * q0)];
            let size = (m[0] * m[0] + m[1] * m[1]).sqrt();
            let turns = size > ROTATION_MIN as f32;
            let over = 1.0 / if turns { size } else { 1.0 };
            let e = if turns { [m[0] * over, m[1] * over] } else { [1.0, 0.0] };
            moved[0][k] = (star[0] - (mean[0] * e[0] - mean[1] * e[1])) / aspect;
            moved[1][k] = star[1] - (mean[0] * e[1] + mean[1] * e[0]);
        }
        Self(moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::mls;
    use crate::topology::Topology;

    #[test]
    fn one_pass_gives_what_the_plain_definition_gives() {
        let p = [[0.1, 0.2], [0.45, 0.7], [0.8, 0.35], [0.97, 0.9]];
        let q = [[0.17, 0.24], [0.43, 0.64], [0.86, 0.3], [1.02, 0.93]];
        for (topology, aspect) in [(Topology::Disc, 1.0), (Topology::Annulus, 2.3), (Topology::Torus, 0.7)] {
            let domain = Domain { topology, aspect };
            for k in 0..400 {
                let x = [f64::from(k % 20) / 20.0 + 0.01, f64::from(k / 20) / 20.0];
                let (fast, plain) = (psi(domain, &p, &q, x), mls::psi(domain, &p, &q, x));
                assert!((fast[0] - plain[0]).abs() < 1e-11 && (fast[1] - plain[1]).abs() < 1e-11, "{fast:?} {plain:?}");
            }
            for row in 0..=20 {
                for (k, moved) in roughly_moved(domain, &p, &q, 20, row).into_iter().enumerate() {
                    let x = [k as f64 * 0.05, row as f64 * 0.05];
                    let plain = mls::psi(domain, &p, &q, x);
                    let apart = [0, 1].map(|c| x[c] + f64::from(moved[c]) - plain[c]);
                    assert!(apart.iter().all(|a| a.abs() < 1e-5), "{x:?}: {apart:?}");
                }
            }
            for (p_i, q_i) in p.iter().zip(&q) {
                let y = psi(domain, &p, &q, *p_i);
                assert!((y[0] - q_i[0]).abs() < 1e-8 && (y[1] - q_i[1]).abs() < 1e-8);
            }
        }
    }
}
