//! Similarities x ↦ s R x + t, the one that carries points onto others best, and the small eigenproblems behind it.
//!
//! min Σ w |s R p + t − q|²: R maximises tr(Rᵀ Σ w q̄ p̄ᵀ), a quadratic form in the unit quaternion of R, so the
//! greatest eigenvector of a 4 × 4 matrix; s = tr(Rᵀ M) / Σ w |p̄|². *Source:* Horn 1987. Never mirrors.

use crate::mesh::Vec3;
use nalgebra::Matrix3;

/// x ↦ scale · rotation · x + shift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// s > 0.
    pub scale: f64,
    /// R, orthonormal, determinant 1.
    pub rotation: Matrix3<f64>,
    /// t.
    pub shift: Vec3,
}

impl Similarity {
    /// The one that moves nothing.
    pub fn identity() -> Self {
        Self { scale: 1.0, rotation: Matrix3::identity(), shift: Vec3::zeros() }
    }

    /// Where it carries a point.
    pub fn apply(&self, x: &Vec3) -> Vec3 {
        self.rotation * x * self.scale + self.shift
    }

    /// The point that it carries to `y`.
    pub fn undo(&self, y: &Vec3) -> Vec3 {
        self.rotation.tr_mul(&(y - self.shift)) / self.scale
    }

    /// First `first`, then this one.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            scale: self.scale * first.scale,
            rotation: self.rotation * first.rotation,
            shift: self.apply(&first.shift),
        }
    }

    /// The one that carries each p to its q best, by least squares with weights; `None` where the weights vanish or all
    /// p are one point.
    pub fn fit(pairs: impl Iterator<Item = (Vec3, Vec3, f64)> + Clone) -> Option<Self> {
        let (mut sum, mut p0, mut q0) = (0.0, Vec3::zeros(), Vec3::zeros());
        for (p, q, w) in pairs.clone() {
            sum += w;
            p0 += w * p;
            q0 += w * q;
        }
        let usable = |x: f64| x > 0.0 && x.is_finite();
        if !usable(sum) {
            return None;
        }
        (p0, q0) = (p0 / sum, q0 / sum);
        let (mut moment, mut spread) = (Matrix3::zeros(), 0.0);
        for (p, q, w) in pairs {
            moment += (q - q0) * (p - p0).transpose() * w;
            spread += w * (p - p0).norm_squared();
        }
        let rotation = nearest_rotation(&moment);
        let scale = rotation.dot(&moment) / spread;
        (usable(spread) && usable(scale)).then(|| Self { scale, rotation, shift: q0 - rotation * p0 * scale })
    }
}

/// The rotation R that maximises tr(Rᵀ m).
pub(super) fn nearest_rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    let k = [
        [m[(0, 0)] + m[(1, 1)] + m[(2, 2)], m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]],
        [0.0, m[(0, 0)] - m[(1, 1)] - m[(2, 2)], m[(0, 1)] + m[(1, 0)], m[(0, 2)] + m[(2, 0)]],
        [0.0, 0.0, m[(1, 1)] - m[(0, 0)] - m[(2, 2)], m[(1, 2)] + m[(2, 1)]],
        [0.0, 0.0, 0.0, m[(2, 2)] - m[(0, 0)] - m[(1, 1)]],
    ];
    let (values, vectors) = eigen(k);
    let best = (1..4).fold(0, |b, i| if values[i] > values[b] { i } else { b });
    let [w, x, y, z] = [0, 1, 2, 3].map(|i| vectors[i][best]);
    Matrix3::new(
        w * w + x * x - y * y - z * z,
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        w * w - x * x + y * y - z * z,
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        w * w - x * x - y * y + z * z,
    )
}

/// The similarity's linear part s R that is nearest to `m`.
pub(super) fn nearest_scaled_rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    let rotation = nearest_rotation(m);
    rotation * (rotation.dot(m) / 3.0)
}

/// Singular values of a 3 × 3 matrix, in no order.
pub(super) fn singular_values(m: &Matrix3<f64>) -> [f64; 3] {
    let g = m.tr_mul(m);
    let (values, _) = eigen([0, 1, 2].map(|i| [0, 1, 2].map(|j| g[(i, j)])));
    values.map(|v| v.max(0.0).sqrt())
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix of which the upper triangle is read. *Source:* Jacobi's
/// cyclic rotations.
pub(super) fn eigen<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    for i in 0..N {
        v[i][i] = 1.0;
        for j in 0..i {
            a[i][j] = a[j][i];
        }
    }
    for _ in 0..12 {
        let (mut off, mut all) = (0.0, 0.0);
        for i in 0..N {
            for j in 0..N {
                all += a[i][j] * a[i][j];
                off += if i < j { a[i][j] * a[i][j] } else { 0.0 };
            }
        }
        // A comparison that also ends for what is not finite.
        if !(off > 1e-26 * all && all.is_finite()) {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                turn(&mut a, &mut v, p, q);
            }
        }
    }
    let mut values = [0.0; N];
    (0..N).for_each(|i| values[i] = a[i][i]);
    (values, v)
}

/// One rotation, after which entry (p, q) is 0.
fn turn<const N: usize>(a: &mut [[f64; N]; N], v: &mut [[f64; N]; N], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.mul_add(theta, 1.0).sqrt());
    let c = 1.0 / t.mul_add(t, 1.0).sqrt();
    let s = t * c;
    for k in 0..N {
        let (x, y) = (a[k][p], a[k][q]);
        (a[k][p], a[k][q]) = (c * x - s * y, s * x + c * y);
    }
    for k in 0..N {
        let (x, y) = (a[p][k], a[q][k]);
        (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
        let (x, y) = (v[k][p], v[k][q]);
        (v[k][p], v[k][q]) = (c * x - s * y, s * x + c * y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similarity_is_found_again_and_undone() {
        let turn = nearest_rotation(&Matrix3::new(0.2, -0.9, 0.1, 0.8, 0.3, 0.5, -0.4, 0.1, 0.7));
        assert!((turn.tr_mul(&turn) - Matrix3::identity()).norm() < 1e-12 && turn.determinant() > 0.0);
        let truth = Similarity { scale: 1.7, rotation: turn, shift: Vec3::new(3.0, -1.0, 0.5) };
        let points: Vec<Vec3> =
            (0..9).map(|i| Vec3::new((i as f64).sin(), (2.1 * i as f64).cos(), 0.1 * i as f64)).collect();
        let found = Similarity::fit(points.iter().map(|p| (*p, truth.apply(p), 1.0))).expect("spread out");
        assert!((found.rotation - turn).norm() < 1e-12 && (found.scale - 1.7).abs() < 1e-12);
        assert!((found.undo(&found.apply(&points[3])) - points[3]).norm() < 1e-12);
        let twice = found.after(&truth);
        assert!((twice.apply(&points[2]) - found.apply(&truth.apply(&points[2]))).norm() < 1e-12);
    }

    #[test]
    fn a_mirror_image_is_fitted_without_mirroring() {
        let m = Matrix3::from_diagonal(&Vec3::new(-1.0, 2.0, 3.0));
        let r = nearest_rotation(&m);
        assert!((r - Matrix3::from_diagonal(&Vec3::new(1.0, 1.0, 1.0))).norm() < 1e-9 || r.dot(&m) >= 4.0 - 1e-9);
        let mut s = singular_values(&m);
        s.sort_by(f64::total_cmp);
        assert!((s[0] - 1.0).abs() < 1e-12 && (s[2] - 3.0).abs() < 1e-12);
    }
}
