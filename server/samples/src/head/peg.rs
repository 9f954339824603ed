//! The peg that heads are drawn on, and the skull lofted over it.

use super::super::loft::{Loft, Section};
use nalgebra::Matrix2;
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::FRAC_PI_2;

/// A skull over the peg: sections at t = 0, 1, 2 … from the neck to the apex.
#[derive(Clone, Debug)]
pub(super) struct Peg {
    loft: Loft,
    /// Where the peg's tube ends and its dome begins.
    dome: f64,
}

impl Peg {
    /// A skull through `sections` whose peg has its dome from t = `dome` on.
    pub(super) fn new(sections: &[Section], dome: f64) -> Self {
        Self { loft: Loft::domed(sections), dome }
    }

    fn apex(&self) -> f64 {
        self.loft.end()
    }

    /// The peg's point at azimuth `a` (radians) and height `t`.
    pub(super) fn base(&self, a: f64, t: f64) -> Vec3 {
        let dome = self.apex() - self.dome;
        let rise = ((t - self.dome) / dome).clamp(0.0, 1.0) * FRAC_PI_2;
        let y = if t < self.dome { t } else { self.dome + dome / FRAC_PI_2 * rise.sin() };
        Vec3::new(rise.cos() * a.sin(), y, rise.cos() * a.cos())
    }

    /// Azimuth and height of a point near the peg.
    pub(super) fn chart(&self, base: &Vec3) -> [f64; 2] {
        let dome = self.apex() - self.dome;
        let radius = base.x.hypot(base.z);
        let a = if radius > 1e-9 { base.x.atan2(base.z) } else { 0.0 };
        if base.y <= self.dome {
            return [a, base.y.max(0.0)];
        }
        let rise = ((base.y - self.dome) * FRAC_PI_2 / dome).atan2(radius);
        [a, self.dome + dome * rise / FRAC_PI_2]
    }

    /// The skull's point at azimuth `a` and height `t`.
    pub(super) fn skull(&self, a: f64, t: f64) -> Vec3 {
        self.loft.at(a, t)
    }

    /// The peg's point under the skull's front point with these x and y, by Newton's method from the nearest of a
    /// coarse grid.
    pub(super) fn find(&self, x: f64, y: f64) -> Vec3 {
        let miss = |a: f64, t: f64| {
            let p = self.skull(a, t);
            nalgebra::Vector2::new(p.x - x, p.y - y)
        };
        let mut best = (f64::INFINITY, 0.0, 0.0);
        for k in 0..25 * 60 {
            let (a, t) = (-1.5 + 0.125 * (k % 25) as f64, self.apex() * 0.95 * (k / 25) as f64 / 59.0);
            let far = miss(a, t).norm();
            if far < best.0 {
                best = (far, a, t);
            }
        }
        let (_, mut a, mut t) = best;
        for _ in 0..20 {
            let e = 1e-5;
            let m = miss(a, t);
            let (da, dt) = ((miss(a + e, t) - m) / e, (miss(a, t + e) - m) / e);
            let Some(inverse) = Matrix2::from_columns(&[da, dt]).try_inverse() else { break };
            let d = inverse * m;
            (a, t) = (a - d.x.clamp(-0.1, 0.1), t - d.y.clamp(-0.5, 0.5));
        }
        self.base(a, t)
    }
}

#[cfg(test)]
pub(super) fn test_sections() -> Vec<Section> {
    (0..8)
        .map(|k| {
            let rise = k as f64 / 7.0 * FRAC_PI_2;
            let (r, y) = (rise.cos(), rise.sin());
            Section { front: [y, r], side: [r, y, 0.0], back: [y, -r], exponent: 1.0, snout: 1.0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chart_inverts_base_on_tube_and_dome() {
        let peg = Peg::new(&test_sections(), 4.0);
        for (a, t) in [(0.3, 1.0), (-2.0, 3.9), (1.5, 5.5), (3.0, 6.7)] {
            let [b, s] = peg.chart(&peg.base(a, t));
            assert!((a - b).abs() < 1e-9 && (t - s).abs() < 1e-9, "{a} {t}: {b} {s}");
        }
    }

    #[test]
    fn find_goes_back_to_the_point_in_front() {
        let peg = Peg::new(&test_sections(), 4.0);
        let [a, t] = peg.chart(&peg.find(0.3, 0.2));
        let p = peg.skull(a, t);
        assert!((p.x - 0.3).abs() < 1e-6 && (p.y - 0.2).abs() < 1e-6 && p.z > 0.8);
    }
}
