//! Hands and paws: discs, open at the wrist, the palm in front and the fingers up.

use super::brush::{blob, step};
use super::cage::Cage;
use super::limb::finish;
use super::loft::{Hoop, Loft, Section};
use quadmuse_kernel::mesh::Vec3;

/// A finger, toe or thumb.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finger {
    /// Length; the palm is about 1 long.
    pub(super) length: f64,
    /// Radius at the root.
    pub(super) radius: f64,
    /// Angle to the middle finger, in radians, positive to +x.
    pub(super) spread: f64,
    /// How far it curls towards the palm, in radians from root to tip.
    pub(super) curl: f64,
    /// How much thinner the tip is.
    pub(super) taper: f64,
}

/// What tells one hand from another.
#[derive(Clone, Debug)]
pub(super) struct Hand {
    /// Fingers from −x to +x.
    pub(super) fingers: Vec<Finger>,
    /// The thumb at +x, if there is one.
    pub(super) thumb: Option<Finger>,
    /// Half width of the palm at the knuckles.
    pub(super) wide: f64,
    /// Half thickness of the palm.
    pub(super) thick: f64,
    /// Height of the palm.
    pub(super) high: f64,
    /// Half width of the wrist.
    pub(super) wrist: f64,
    /// Height of the pads on palm and finger tips.
    pub(super) pads: f64,
}

/// Azimuth of the palm's front corners, in radians.
const CORNER: f64 = 1.12;
const ROWS: [f64; 9] = [0.0, 0.8, 1.5, 2.1, 2.7, 3.4, 4.1, 4.7, 5.0];

impl Hand {
    fn loft(&self) -> Loft {
        let (w, d, h, r) = (self.wide, self.thick, self.high, self.wrist);
        let ring = |y: f64, wide: f64, front: f64, back: f64, tilt: f64| {
            Section::of([y, front, wide, y - tilt, 0.0, y, -back, 0.82])
        };
        Loft::open(&[
            ring(-0.75, r * 1.10, r * 0.72, r * 0.72, 0.0),
            ring(-0.35, r * 1.00, r * 0.66, r * 0.66, 0.0),
            ring(0.02 * h, r * 1.06, d * 1.05, d * 0.95, 0.0),
            ring(0.33 * h, 0.5 * (r + w) * 1.02, d * 1.25, d * 1.05, 0.0),
            ring(0.68 * h, w * 0.98, d * 1.12, d * 1.05, 0.0),
            ring(h, w, d * 0.88, d * 0.92, 0.10 * h),
        ])
    }

    /// The finished hand after `levels` subdivisions.
    pub(super) fn build(&self, levels: usize) -> (Cage, Vec<Vec3>) {
        let n = self.fingers.len();
        let columns = 2 * n + 4;
        let loft = self.loft();
        let azimuth = |c: usize| {
            let across = |i: usize| -CORNER + 2.0 * CORNER * i as f64 / n as f64;
            let half = n + 2;
            let turn = if c % half <= n { across(c % half) } else { std::f64::consts::FRAC_PI_2 };
            if c < half { turn } else { turn + std::f64::consts::PI }
        };
        let mut cage = Cage::tube(ROWS.len(), columns, "palm", |r, c| {
            // The knuckles stand in an arch, highest at the middle finger.
            let p = loft.at(azimuth(c), ROWS[r]);
            let arch = 0.16 * self.high * ((p.x - 0.12 * self.wide) / self.wide).powi(2);
            p - Vec3::y() * (arch * step(0.4 * self.high, self.high, p.y))
        });
        cage.name(&(0..2 * columns).collect::<Vec<_>>(), "wrist");
        let rim: Vec<u32> = (0..columns).map(|c| ((ROWS.len() - 1) * columns + c) as u32).collect();
        let roots = cage.cap(&rim, n, "palm");
        for (i, finger) in self.fingers.iter().enumerate() {
            let region = [roots[i], roots[n + i]];
            let root = cage.centre(&cage.vertices(&region));
            cage.grow(
                &region,
                &finger.hoops(root, Vec3::new(finger.spread.sin(), finger.spread.cos(), 0.0)),
                &format!("finger_{}", i + 1),
            );
        }
        if let Some(thumb) = self.thumb {
            let region: Vec<usize> = (3..5).flat_map(|r| [r * columns + n, r * columns + n + 1]).collect();
            let root = cage.centre(&cage.vertices(&region));
            let axis = Vec3::new(thumb.spread.sin(), thumb.spread.cos(), 0.34).normalize();
            cage.grow(&region, &thumb.hoops(root + Vec3::new(-0.06, 0.0, 0.02), axis), "thumb");
        }
        let (pads, w, h, d) = (self.pads, self.wide, self.high, self.thick);
        let tips: Vec<Vec3> = self.fingers.iter().zip(0..n).map(|(f, i)| f.tip(root_of(&loft, i, n))).collect();
        finish(cage, levels, move |p| {
            let front = step(-0.3 * d, 0.6 * d, p.z);
            let thenar = 0.12 * blob(p, [0.55 * w, 0.32 * h, d], [0.36 * w, 0.38 * h, d * 1.5]);
            let hypothenar = 0.09 * blob(p, [-0.62 * w, 0.30 * h, d], [0.30 * w, 0.42 * h, d * 1.5]);
            let heads = 0.05 * blob(p, [0.0, 0.92 * h, d], [0.9 * w, 0.14 * h, d]);
            let hollow = -0.10 * blob(p, [0.0, 0.56 * h, d], [0.36 * w, 0.26 * h, d * 1.5]);
            let cushion = 0.16 * pads * blob(p, [0.0, 0.48 * h, 1.1 * d], [0.62 * w, 0.32 * h, d]);
            let tip_pads: f64 =
                tips.iter().map(|t| 0.09 * pads * blob(p, [t.x, t.y, t.z + 0.15], [0.2, 0.2, 0.25])).sum();
            let knuckles: f64 = (0..n)
                .map(|i| {
                    let q = root_of(&loft, i, n);
                    -0.045 * blob(p, [q.x, q.y - 0.04, -d], [0.11 * w * 4.0 / n as f64, 0.12 * h, d])
                })
                .sum();
            let slant = 0.03 * (1.3 * p.y + 0.5).sin();
            Vec3::new(slant, 0.05 * p.x, front * (thenar + hypothenar + heads + hollow + cushion + tip_pads) + knuckles)
        })
    }
}

/// Where finger `i` of `n` grows from the palm, roughly.
fn root_of(loft: &Loft, i: usize, n: usize) -> Vec3 {
    let s = (i as f64 + 0.5) / n as f64;
    let front = loft.at(-CORNER + 2.0 * CORNER * s, loft.end());
    Vec3::new(front.x, front.y, 0.0)
}

impl Finger {
    fn tip(&self, root: Vec3) -> Vec3 {
        root + Vec3::new(self.spread.sin(), self.spread.cos(), self.curl * 0.5) * (0.85 * self.length)
    }

    /// Hoops from the root to the tip: two joints with their three loops each, then the tip.
    fn hoops(&self, root: Vec3, axis: Vec3) -> Vec<Hoop> {
        // Slim fingers show their joints; stout ones are round.
        let slim = ((self.length / self.radius - 3.5) / 3.0).clamp(0.0, 1.0);
        const STATIONS: [(f64, f64); 12] = [
            (0.05, -0.01),
            (0.20, -0.03),
            (0.36, 0.01),
            (0.42, 0.07),
            (0.48, 0.01),
            (0.60, -0.05),
            (0.68, 0.0),
            (0.73, 0.03),
            (0.78, -0.01),
            (0.88, -0.03),
            (0.965, -0.20),
            (1.0, -0.56),
        ];
        let across = (Vec3::x() - axis * axis.x).try_normalize(0.5).unwrap_or(Vec3::z());
        let palm = across.cross(&axis);
        let (mut place, mut last) = (root, 0.0);
        STATIONS
            .iter()
            .map(|&(s, round)| {
                let bend = self.curl * s;
                let along = axis * bend.cos() + palm * bend.sin();
                place += along * ((s - last) * self.length);
                last = s;
                let round = 1.0 + round * if s < 0.9 { slim } else { 1.0 };
                let r = 1.18 * self.radius * round * (1.0 - self.taper * s);
                Hoop { centre: place, u: across * r, v: along.cross(&across) * (r * 0.94) }
            })
            .collect()
    }
}
