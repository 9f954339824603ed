//! Surfaces lofted through closed sections, and spines with frames.

use super::brush::{curve, spline};
use quadmuse_kernel::mesh::Vec3;

/// A closed curve through a front, two side and a back point; y is up, z forward, x to the model's left. A negative
/// side x turns the curve the other way round, for lofts that run forward or down instead of up.
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
    /// A section from front y, z, side x, y, z, back y, z and the exponent.
    pub(super) fn of(n: [f64; 8]) -> Self {
        Self { front: [n[0], n[1]], side: [n[2], n[3], n[4]], back: [n[5], n[6]], exponent: n[7], snout: n[7] }
    }

    /// The section that stands across the apex: front and back exchanged.
    fn across(&self) -> Self {
        let [x, y, z] = self.side;
        Self { front: self.back, side: [-x, y, z], back: self.front, ..*self }
    }

    fn numbers(&self) -> [f64; 9] {
        let (f, s, b) = (self.front, self.side, self.back);
        [f[0], f[1], s[0], s[1], s[2], b[0], b[1], self.exponent, self.snout]
    }
}

/// A surface through sections at t = 0, 1, 2 …
#[derive(Clone, Debug)]
pub(super) struct Loft {
    keys: Vec<[f64; 9]>,
    below: [f64; 9],
    above: [f64; 9],
}

impl Loft {
    /// An open loft: both ends run out straight.
    pub(super) fn open(sections: &[Section]) -> Self {
        let keys: Vec<[f64; 9]> = sections.iter().map(Section::numbers).collect();
        let n = keys.len();
        let ghost = |end: usize, next: usize| std::array::from_fn(|i| 2.0 * keys[end][i] - keys[next][i]);
        let (below, above) = (ghost(0, 1), ghost(n - 1, n - 2));
        Self { keys, below, above }
    }

    /// A loft whose last section is a point: the surface runs smoothly across it.
    pub(super) fn domed(sections: &[Section]) -> Self {
        let above = sections[sections.len() - 2].across().numbers();
        Self { above, ..Self::open(sections) }
    }

    /// The largest t.
    pub(super) fn end(&self) -> f64 {
        (self.keys.len() - 1) as f64
    }

    /// The point at azimuth `a` (radians; 0 in front, π/2 at the left side) and height `t`.
    pub(super) fn at(&self, a: f64, t: f64) -> Vec3 {
        let n = spline(&self.keys, self.below, self.above, t.clamp(0.0, self.end()));
        let c = a.cos();
        let side = a.sin().signum() * a.sin().abs().powf(n[7]);
        let (y, z, bend) = if c >= 0.0 { (n[0], n[1], n[8]) } else { (n[5], n[6], n[7]) };
        // c² for the height: front and back meet at the sides without a crease.
        Vec3::new(n[2] * side, n[3] + (y - n[3]) * c * c, n[4] + (z - n[4]) * c.abs().powf(bend))
    }
}

/// An ellipse in space: centre and two half axes, counter-clockwise from `u` to `v` seen from outside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hoop {
    pub(super) centre: Vec3,
    pub(super) u: Vec3,
    pub(super) v: Vec3,
}

impl Hoop {
    /// The point at angle `a`, in radians from `u`.
    pub(super) fn at(&self, a: f64) -> Vec3 {
        self.centre + self.u * a.cos() + self.v * a.sin()
    }
}

/// Hoops along a curve: `keys` are x, y, z, half axis across, half axis in depth, at t = 0, 1, 2 …; `first` is the
/// direction of `u` at the start, carried along without twist.
pub(super) fn hoops(keys: &[[f64; 5]], first: Vec3, ts: &[f64]) -> Vec<Hoop> {
    let place = |t: f64| {
        let [x, y, z, ..] = curve(keys, t);
        Vec3::new(x, y, z)
    };
    let end = (keys.len() - 1) as f64;
    let mut across = first;
    ts.iter()
        .map(|&t| {
            let axis = (place((t + 0.05).min(end)) - place((t - 0.05).max(0.0))).normalize();
            across = (across - axis * axis.dot(&across)).normalize();
            let [.., wide, deep] = curve(keys, t);
            Hoop { centre: place(t), u: across * wide, v: axis.cross(&across) * deep }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loft_passes_the_four_points_of_its_sections() {
        let sections: Vec<Section> =
            (0..4).map(|k| Section::of([k as f64, 1.0, 0.5, k as f64 - 0.2, 0.1, k as f64, -0.7, 0.9])).collect();
        let loft = Loft::open(&sections);
        assert!((loft.at(0.0, 2.0) - Vec3::new(0.0, 2.0, 1.0)).norm() < 1e-12);
        assert!((loft.at(-std::f64::consts::FRAC_PI_2, 2.0) - Vec3::new(-0.5, 1.8, 0.1)).norm() < 1e-9);
        assert!((loft.at(std::f64::consts::PI, 1.0) - Vec3::new(0.0, 1.0, -0.7)).norm() < 1e-9);
    }

    #[test]
    fn hoops_stand_across_their_curve_and_turn_outwards() {
        let keys = [[0.0, 0.0, 0.0, 0.3, 0.2], [0.0, 1.0, 0.0, 0.3, 0.2], [0.0, 1.5, 0.8, 0.3, 0.2]];
        for hoop in hoops(&keys, Vec3::x(), &[0.0, 0.5, 1.0, 1.7, 2.0]) {
            assert!(hoop.u.dot(&hoop.v).abs() < 1e-12);
            assert!(hoop.u.cross(&hoop.v).dot(&Vec3::new(0.0, 1.0, 0.4)) > 0.0);
            assert!((hoop.u.norm() - 0.3).abs() < 1e-12 && (hoop.v.norm() - 0.2).abs() < 1e-12);
        }
    }
}
