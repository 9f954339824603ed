//! A pair of eyes: their loops of quads and their relief.

use super::super::brush::{bump, step};
use super::super::cage::{Cage, Face};
use super::loops::{Feature, Oval, Sheet};
use super::peg::Peg;

/// A pair of eyes in the front view; lengths in half head widths.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eyes {
    /// x (of the left eye) and y of the centre.
    pub(super) centre: [f64; 2],
    /// Half width of the open eye.
    pub(super) wide: f64,
    /// Half height of the open eye.
    pub(super) high: f64,
    /// How high the outer corners stand over the inner ones.
    pub(super) slant: f64,
    /// Depth of the socket.
    pub(super) socket: f64,
    /// Thickness of the lids.
    pub(super) lid: f64,
    /// How far the eyeball stands out.
    pub(super) ball: f64,
    /// Exponent of the opening: 1 an ellipse, above pointed corners.
    pub(super) almond: f64,
}

impl Eyes {
    fn oval(&self, side: f64) -> Oval {
        let [x, y] = self.centre;
        let almond = self.almond;
        Oval { centre: [side * x, y], wide: self.wide, up: self.high * 1.08, down: self.high * 0.86, almond }
    }

    /// Lays six loops around one eye (`side` 1 is the left, −1 the right one); returns the pinned vertices.
    pub(super) fn lay(&self, cage: &mut Cage, peg: &Peg, region: Vec<Face>, side: f64, group: &str) -> Vec<u32> {
        let (eye, sheet) = (self.oval(side), Sheet::Front(peg));
        let slim = (self.wide / self.high / 2.2).clamp(0.6, 1.0);
        let mut feature = Feature::on(cage, sheet, region, &eye.grown(1.36, 1.0 + 1.3 * slim));
        feature.ring(cage, sheet, &eye.grown(1.2, 1.0 + 0.7 * slim), "face");
        feature.ring(cage, sheet, &eye.grown(1.08, 1.0 + 0.28 * slim), group);
        feature.ring(cage, sheet, &eye, group);
        feature.ring(cage, sheet, &eye.grown(0.92, 0.86), group);
        feature.ring(cage, sheet, &Oval { almond: 1.1, ..eye.grown(0.52, 0.6) }, group);
        cage.name(&feature.region, group);
        feature.inside(cage, sheet, |_| eye.centre);
        feature.pinned
    }

    /// How far sockets, lids and eyeballs stand out at a point of the front view.
    pub(super) fn relief(&self, x: f64, y: f64) -> f64 {
        let side = if x >= 0.0 { 1.0 } else { -1.0 };
        let eye = self.oval(side);
        let [ex, ey] = self.centre;
        let y = y - self.slant * (x.abs() - ex) / self.wide;
        let (dx, dy) = (x.abs() - ex, y - ey);
        let socket = -self.socket * bump([dx, dy - 0.01], [1.5 * self.wide, self.high + 0.10]);
        let inner = -0.43 * self.socket * bump([dx + 1.24 * self.wide, dy], [0.07, 0.10]);
        let r = eye.radius(x, y);
        let across = (dx / self.wide).powi(2);
        let ball = (1.0 - 0.55 * across - 0.11 * (dy / self.high).powi(2)).max(0.0).sqrt();
        let lid = self.lid * (1.0 - 0.45 * across).max(0.0) * step(1.75, 1.05, r);
        let open = step(1.0, 0.86, r);
        let crease = -0.028 * (-((r - 1.75) / 0.22).powi(2)).exp() * step(-0.02, 0.06, dy);
        let iris = -0.012 * step(0.06, 0.03, dx.hypot(dy));
        socket + inner + lid * (1.0 - open) + open * (self.ball * ball - 0.035 + iris) + crease
    }
}
