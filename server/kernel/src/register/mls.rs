//! Rigid moving least squares on the unfolded domain, exactly periodic and exact on the boundaries, with its analytic
//! gradient.
//!
//! For controls p_i → q_i and a point x (complex numbers), w_i = f(p_i − x)/|p_i − x|², W = Σw_i:
//!
//! ```text
//! p* = Σ w_i p_i / W     q* = Σ w_i q_i / W     z = x − p*
//! M  = Σ w_i conj(p_i − p*) q_i
//! ψ(x)  = q* + z·M/|M|
//! δψ    = (w_i/W) δq_i + (i·z·e^{iθ}/|M|)·Im(e^{−iθ} w_i conj(p_i − p*) δq_i),   e^{iθ} = M/|M|
//! ```
//!
//! Each control acts through its images under u → u + 1 and v → −v, v → 2 − v (tori: v → v + 1), so that
//! ψ(u + 1, v) = ψ(u, v) + 1 and v = 0, v = 1 map onto themselves. f = (1 − du²)²(1 − dv²)² lets images come and go
//! smoothly.
//! *Source:* paper §5.2 and appendix; Schaefer, McPhail, Warren 2006. *Ours, not the paper's:* the orbit images, the
//! cut-off f, and a metric on the domain (`aspect`), METHOD §4.

use crate::topology::Topology;
use crate::unfold::Uv;

/// Added to squared distances, so that a control's own weight dominates instead of dividing by zero.
pub(super) const TINY: f64 = 1e-20;
/// |M| below which no rotation is fitted.
pub(super) const ROTATION_MIN: f64 = 1e-12;

/// Images of a control along v: sign and offset of each, `v → sign·v + offset`.
pub(super) fn orbit_v(topology: Topology) -> [[f64; 2]; 3] {
    match topology {
        Topology::Torus => [[1.0, 0.0], [1.0, 1.0], [1.0, -1.0]],
        _ => [[1.0, 0.0], [-1.0, 0.0], [-1.0, 2.0]],
    }
}

/// How one control acts at one point: ψ is affine in q inside q* and M.
#[derive(Clone, Copy, Debug, Default)]
struct Influence {
    /// q* = Σ (share_u·q_u, share_v·q_v) + …
    share: [f64; 2],
    /// M = Σ q_u·by_u + q_v·by_v + … (complex)
    by_u: [f64; 2],
    by_v: [f64; 2],
}

/// All that ψ at one point needs, whatever the q_i: prepared once, evaluated often.
#[derive(Clone, Debug)]
pub struct MlsTerms {
    influences: Vec<Influence>,
    /// Constant parts of q* and M (from the images' offsets).
    base: [f64; 2],
    turn: [f64; 2],
    /// z = x − p*, in the metric of the domain.
    z: [f64; 2],
}

/// The domain on which the map lives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Domain {
    /// Decides the images.
    pub topology: Topology,
    /// Length of one unit of u in units of v: rotations are rotations of (aspect·u, v).
    pub aspect: f64,
}

impl MlsTerms {
    /// Prepares the point `x` for controls at `p`.
    #[inline(always)]
    pub fn new(domain: Domain, p: &[Uv], x: Uv) -> Self {
        let aspect = domain.aspect;
        let mut influences = vec![Influence::default(); p.len()];
        let (mut weight, mut p_sum) = (0.0, [0.0; 2]);
        for_each_image(
            domain,
            p,
            x,
            #[inline(always)]
            |_, w, d, _, _| {
                weight += w;
                p_sum[0] += w * d[0];
                p_sum[1] += w * d[1];
            },
        );
        if weight <= 0.0 {
            return Self { influences, base: x, turn: [0.0; 2], z: [0.0; 2] };
        }
        // Coordinates relative to x: z = x − p* = −mean of the offsets.
        let mean = [p_sum[0] / weight, p_sum[1] / weight];
        let (mut base, mut turn) = ([0.0; 2], [0.0; 2]);
        for_each_image(
            domain,
            p,
            x,
            #[inline(always)]
            |i, w, d, period, [sign, offset]| {
                let hat = [d[0] - mean[0], d[1] - mean[1]];
                // m = w·conj(p̂); q's image is (aspect·(q_u + period), sign·q_v + offset).
                let m = [w * hat[0], -w * hat[1]];
                let one = &mut influences[i];
                one.share[0] += w / weight;
                one.share[1] += sign * w / weight;
                one.by_u[0] += aspect * m[0];
                one.by_u[1] += aspect * m[1];
                one.by_v[0] -= sign * m[1];
                one.by_v[1] += sign * m[0];
                base[0] += period * w / weight;
                base[1] += offset * w / weight;
                turn[0] += m[0] * aspect * period - m[1] * offset;
                turn[1] += m[1] * aspect * period + m[0] * offset;
            },
        );
        Self { influences, base, turn, z: [-mean[0], -mean[1]] }
    }

    /// ψ for controls moved to `q`.
    #[inline(always)]
    pub fn at(&self, domain: Domain, q: &[Uv]) -> Uv {
        let (star, m) = self.sums(q);
        let rotation = unit(m);
        let r = multiply(self.z, rotation);
        [star[0] + r[0] / domain.aspect, star[1] + r[1]]
    }

    /// ψ, and into `gradient` for each control the 2 × 2 matrix ∂ψ/∂q as `[∂ψ_u/∂q_u, ∂ψ_v/∂q_u, ∂ψ_u/∂q_v, ∂ψ_v/∂q_v]`.
    #[inline(always)]
    pub fn with_gradient(&self, domain: Domain, q: &[Uv], gradient: &mut [[f64; 4]]) -> Uv {
        let (star, m) = self.sums(q);
        let size = length(m);
        let e = unit(m);
        let r = multiply(self.z, e);
        // i·r/|M|
        let spin = if size > ROTATION_MIN { [-r[1] / size, r[0] / size] } else { [0.0; 2] };
        for (one, g) in self.influences.iter().zip(gradient) {
            let turn_u = e[0] * one.by_u[1] - e[1] * one.by_u[0];
            let turn_v = e[0] * one.by_v[1] - e[1] * one.by_v[0];
            g[0] = one.share[0] + spin[0] * turn_u / domain.aspect;
            g[1] = spin[1] * turn_u;
            g[2] = spin[0] * turn_v / domain.aspect;
            g[3] = one.share[1] + spin[1] * turn_v;
        }
        [star[0] + r[0] / domain.aspect, star[1] + r[1]]
    }

    /// q* (in the domain's units) and M.
    #[inline(always)]
    fn sums(&self, q: &[Uv]) -> (Uv, [f64; 2]) {
        let (mut star, mut m) = (self.base, self.turn);
        for (one, q) in self.influences.iter().zip(q) {
            star[0] += one.share[0] * q[0];
            star[1] += one.share[1] * q[1];
            m[0] += one.by_u[0] * q[0] + one.by_v[0] * q[1];
            m[1] += one.by_u[1] * q[0] + one.by_v[1] * q[1];
        }
        (star, m)
    }
}

/// ψ at one point, straight from the definition. With no control, the identity.
pub fn psi(domain: Domain, p: &[Uv], q: &[Uv], x: Uv) -> Uv {
    MlsTerms::new(domain, p, x).at(domain, q)
}

/// Calls `visit(control, weight, offset from x in the metric, period, [sign, offset] of v)` for each image near x.
#[inline(always)]
pub(super) fn for_each_image(
    domain: Domain,
    p: &[Uv],
    x: Uv,
    mut visit: impl FnMut(usize, f64, [f64; 2], f64, [f64; 2]),
) {
    let orbit = orbit_v(domain.topology);
    for (i, p) in p.iter().enumerate() {
        for image @ [sign, offset] in orbit {
            let dv = sign * p[1] + offset - x[1];
            let fade_v = 1.0 - dv * dv;
            if fade_v <= 0.0 {
                continue;
            }
            // The images with |du| < 1 are those on either side of x.
            let below = (p[0] - x[0]).floor();
            for period in [-below, -below - 1.0] {
                let du = p[0] - x[0] + period;
                let fade_u = 1.0 - du * du;
                if fade_u > 0.0 {
                    let d = [domain.aspect * du, dv];
                    let fade = fade_u * fade_v;
                    visit(i, fade * fade / (d[0] * d[0] + d[1] * d[1] + TINY), d, period, image);
                }
            }
        }
    }
}

/// |m|, of numbers that are neither huge nor tiny.
#[inline(always)]
pub(super) fn length(m: [f64; 2]) -> f64 {
    (m[0] * m[0] + m[1] * m[1]).sqrt()
}

#[inline(always)]
fn multiply(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

#[inline(always)]
fn unit(m: [f64; 2]) -> [f64; 2] {
    let size = length(m);
    if size > ROTATION_MIN { [m[0] / size, m[1] / size] } else { [1.0, 0.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: [Uv; 4] = [[0.1, 0.2], [0.45, 0.7], [0.8, 0.35], [0.97, 0.9]];
    const Q: [Uv; 4] = [[0.17, 0.24], [0.43, 0.64], [0.86, 0.3], [1.02, 0.93]];

    fn domains() -> [Domain; 3] {
        [(Topology::Disc, 1.0), (Topology::Annulus, 2.3), (Topology::Torus, 0.7)]
            .map(|(topology, aspect)| Domain { topology, aspect })
    }

    #[test]
    fn u_is_periodic_also_on_the_seam() {
        for domain in domains() {
            for k in 0..50 {
                let x = [f64::from(k) / 50.0, (f64::from(k) * 0.37) % 1.0];
                let (a, b) = (psi(domain, &P, &Q, x), psi(domain, &P, &Q, [x[0] + 1.0, x[1]]));
                assert!((b[0] - a[0] - 1.0).abs() < 1e-12 && (b[1] - a[1]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn boundaries_map_onto_themselves() {
        for domain in &domains()[..2] {
            for k in 0..50 {
                for v in [0.0, 1.0] {
                    let y = psi(*domain, &P, &Q, [f64::from(k) / 50.0, v]);
                    assert!((y[1] - v).abs() < 1e-12, "{y:?}");
                }
            }
        }
    }

    #[test]
    fn a_torus_is_periodic_in_v() {
        let domain = domains()[2];
        for k in 0..20 {
            let x = [f64::from(k) / 20.0, 0.02];
            let (a, b) = (psi(domain, &P, &Q, x), psi(domain, &P, &Q, [x[0], x[1] + 1.0]));
            assert!((b[1] - a[1] - 1.0).abs() < 1e-12 && (b[0] - a[0]).abs() < 1e-12);
        }
    }

    #[test]
    fn controls_go_where_they_are_told() {
        for domain in domains() {
            for (p, q) in P.iter().zip(&Q) {
                let y = psi(domain, &P, &Q, *p);
                assert!((y[0] - q[0]).abs() < 1e-8 && (y[1] - q[1]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn a_translation_in_u_is_reproduced() {
        let moved = P.map(|p| [p[0] + 0.3, p[1]]);
        for domain in domains() {
            let y = psi(domain, &P, &moved, [0.61, 0.52]);
            assert!((y[0] - 0.91).abs() < 1e-12 && (y[1] - 0.52).abs() < 1e-12);
        }
    }

    #[test]
    fn the_analytic_gradient_is_the_central_difference() {
        for domain in domains() {
            for x in [[0.33, 0.41], [0.995, 0.05], [0.02, 0.97]] {
                let terms = MlsTerms::new(domain, &P, x);
                let mut gradient = [[0.0; 4]; 4];
                terms.with_gradient(domain, &Q, &mut gradient);
                for i in 0..4 {
                    for k in 0..2 {
                        let h = 1e-6;
                        let (mut up, mut down) = (Q, Q);
                        up[i][k] += h;
                        down[i][k] -= h;
                        let (a, b) = (psi(domain, &P, &up, x), psi(domain, &P, &down, x));
                        for c in 0..2 {
                            let difference = (a[c] - b[c]) / (2.0 * h);
                            assert!((difference - gradient[i][2 * k + c]).abs() < 1e-8);
                        }
                    }
                }
            }
        }
    }
}
