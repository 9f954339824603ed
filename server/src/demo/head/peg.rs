//! The peg that heads are drawn on, and the skull lofted over it.

use super::super::brush::spline;
use nalgebra::Matrix2;
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::FRAC_PI_2;

/// One section of a skull: a closed curve through a front, two side and a back point; y is up, z forward.
#[derive(Clone, Copy, Debug)]
pub(super) struct Section {
    /// y and z of the front point (x = 0).
    pub(super) front: [f64; 2],
    /// x, y and z of the left side's outermost point; the right one is its mirror image.
    pub(super) side: [f64; 3],
    /// y and z of the back point (x = 0).
    pub(super) back: [f64; 2],
    /// Exponent of the curve: 1 an ellipse, below boxier, above more pointed.
    pub(super) exponent: f64,
    /// Exponent of the depth in front: above 1 a snout stands out of the curve.
    pub(super) snout: f64,
}

impl Section {
    fn numbers(&self) -> [f64; 9] {
        let (f, s, b) = (self.front, self.side, self.back);
        [f[0], f[1], s[0], s[1], s[2], b[0], b[1], self.exponent, self.snout]
    }

    /// The section that stands across the apex: front and back exchanged.
    fn across(&self) -> Self {
        let [x, y, z] = self.side;
        Self { front: self.back, side: [-x, y, z], back: self.front, ..*self }
    }
}

/// A skull over the peg: sections at t = 0, 1, 2 … from the neck to the apex.
#[derive(Clone, Debug)]
pub(super) struct Peg {
    sections: Vec<[f64; 9]>,
    below: [f64; 9],
    above: [f64; 9],
    /// Where the peg's tube ends and its dome begins.
    dome: f64,
}

impl Peg {
    /// A skull through `sections` whose peg has its dome from t = `dome` on.
    pub(super) fn new(sections: &[Section], dome: f64) -> Self {
        let keys: Vec<[f64; 9]> = sections.iter().map(Section::numbers).collect();
        let below = std::array::from_fn(|i| 2.0 * keys[0][i] - keys[1][i]);
        let above = sections[sections.len() - 2].across().numbers();
        Self { sections: keys, below, above, dome }
    }

    fn apex(&self) -> f64 {
        (self.sections.len() - 1) as f64
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
        let n = spline(&self.sections, self.below, self.above, t.clamp(0.0, self.apex()));
        let power = |x: f64| x.signum() * x.abs().powf(n[7]);
        let c = a.cos();
        let (y, z, bend) = if c >= 0.0 { (n[0], n[1], n[8]) } else { (n[5], n[6], n[7]) };
        // c² for the height: front and back meet at the sides without a crease.
        Vec3::new(n[2] * power(a.sin()), n[3] + (y - n[3]) * c * c, n[4] + (z - n[4]) * c.abs().powf(bend))
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
