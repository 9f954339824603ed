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

use super::mls::{Domain, ROTATION_MIN, for_each_image};
use crate::unfold::Uv;

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
    let size = m[0].hypot(m[1]);
    let e = if size > ROTATION_MIN { [m[0] / size, m[1] / size] } else { [1.0, 0.0] };
    let r = [-(mean[0] * e[0] - mean[1] * e[1]), -(mean[0] * e[1] + mean[1] * e[0])];
    [x[0] + (star[0] + r[0]) / domain.aspect, x[1] + star[1] + r[1]]
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
            for (p_i, q_i) in p.iter().zip(&q) {
                let y = psi(domain, &p, &q, *p_i);
                assert!((y[0] - q_i[0]).abs() < 1e-8 && (y[1] - q_i[1]).abs() < 1e-8);
            }
        }
    }
}
