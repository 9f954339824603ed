//! Animal heads: a round skull with a snout, and ears that stand up.

use super::super::brush::{bump, step};
use super::super::cage::{Cage, Face};
use super::super::loft::Section;
use super::eyes::Eyes;
use super::loops::{Feature, Oval, Sheet, relax};
use super::peg::Peg;
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::TAU;

/// What tells one animal's head from another's; lengths in half head widths.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Beast {
    /// How far the snout stands out.
    pub(in super::super) snout: f64,
    /// How narrow the snout is: 1 as wide as the head, 3 slim.
    pub(in super::super) narrow: f64,
    /// How far the snout's tip hangs below the eyes' line.
    pub(in super::super) droop: f64,
    /// How far the forehead rises over the snout.
    pub(in super::super) stop: f64,
    /// x, y of the left eye, its half width and half height.
    pub(in super::super) eye: [f64; 4],
    /// Size of the nose pad.
    pub(in super::super) pad: f64,
    /// Fullness of the cheeks.
    pub(in super::super) cheek: f64,
    /// Height, half width and outward lean of the ears.
    pub(in super::super) ear: [f64; 3],
    /// How pointed the ears are: 0 round, 1 pointed.
    pub(in super::super) point: f64,
    /// How far left and right differ.
    pub(in super::super) askew: f64,
}

/// Azimuths of the columns from the front to the back, in degrees; the other side mirrors them.
const AZIMUTHS: [f64; 13] = [0.0, 9.0, 22.0, 38.0, 55.0, 72.0, 90.0, 106.0, 121.0, 136.0, 151.0, 166.0, 180.0];
const COLUMNS: usize = 24;
const ROWS: [f64; 19] =
    [0.0, 0.8, 1.6, 2.4, 3.0, 3.5, 4.0, 5.0, 6.0, 6.5, 7.0, 7.5, 8.0, 8.5, 9.2, 10.0, 10.7, 11.3, 11.9];
const DOME: f64 = 9.6;
/// Height of the mouth on the peg, and its half width in radians.
const MOUTH: f64 = 5.0;
const MOUTH_WIDE: f64 = 0.58;

impl Beast {
    fn eyes(&self) -> Eyes {
        let [x, y, wide, high] = self.eye;
        Eyes { centre: [x, y], wide, high, slant: 0.05, socket: 0.07, lid: 0.075, ball: 0.10, almond: 1.2 }
    }

    fn peg(&self) -> Peg {
        // front y, z | side x, y, z | back y, z | part of the snout
        let table = [
            [-1.38, -0.02, 0.60, -1.36, -0.50, -1.22, -1.05, 0.0],
            [-1.02, 0.08, 0.52, -0.98, -0.38, -0.80, -0.92, 0.0],
            [-0.80, 0.26, 0.56, -0.72, -0.25, -0.42, -0.88, 0.02],
            [-0.70, 0.58, 0.66, -0.50, -0.15, -0.18, -0.88, 0.48],
            [-0.56, 0.78, 0.76, -0.35, -0.10, 0.00, -0.86, 0.86],
            [-0.42, 0.84, 0.82, -0.24, -0.06, 0.11, -0.84, 0.95],
            [-0.28, 0.87, 0.845, -0.14, -0.03, 0.19, -0.81, 1.02],
            [-0.10, 0.85, 0.855, -0.04, 0.00, 0.28, -0.78, 0.97],
            [0.04, 0.82, 0.855, 0.07, 0.00, 0.36, -0.74, 0.46],
            [0.24, 0.82, 0.845, 0.20, -0.02, 0.46, -0.68, 0.06],
            [0.44, 0.77, 0.80, 0.36, -0.05, 0.57, -0.60, 0.0],
            [0.63, 0.60, 0.70, 0.54, -0.08, 0.68, -0.49, 0.0],
            [0.77, 0.33, 0.50, 0.70, -0.10, 0.77, -0.34, 0.0],
            [0.815, -0.08, 0.0, 0.815, -0.08, 0.815, -0.08, 0.0],
        ];
        let sections: Vec<Section> = table
            .iter()
            .enumerate()
            .map(|(k, r)| {
                let out = r[7];
                let rise = if (9..12).contains(&k) { 0.10 * self.stop } else { 0.0 };
                Section {
                    front: [r[0] - self.droop * out, r[1] + self.snout * out + rise],
                    side: [r[2], r[3], r[4]],
                    back: [r[5], r[6]],
                    exponent: 0.95,
                    snout: 0.95 + (self.narrow - 1.0) * out,
                }
            })
            .collect();
        Peg::new(&sections, DOME)
    }

    fn cage(&self, peg: &Peg) -> Cage {
        let azimuth = |c: usize| {
            if c <= 12 { AZIMUTHS[c].to_radians() } else { -AZIMUTHS[COLUMNS - c].to_radians() }
        };
        let mut cage = Cage::tube(ROWS.len(), COLUMNS, "skull", |r, c| peg.base(azimuth(c), ROWS[r]));
        let rim: Vec<u32> = (0..COLUMNS).map(|c| ((ROWS.len() - 1) * COLUMNS + (c + 21) % COLUMNS) as u32).collect();
        cage.cap(&rim, 6, "skull");
        let block = |rows: std::ops::Range<usize>, columns: std::ops::Range<isize>| -> Vec<Face> {
            rows.flat_map(|r| columns.clone().map(move |c| r * COLUMNS + c.rem_euclid(COLUMNS as isize) as usize))
                .collect()
        };
        cage.name(&block(0..3, 0..24), "neck");
        cage.name(&block(3..15, -4..4), "face");
        cage.name(&block(4..12, -3..3), "snout");
        cage.name(&block(9..11, -1..1), "nose");
        let mut pinned = Vec::new();
        for (side, columns, group) in [(1.0, 1..3, "eye_l"), (-1.0, -3..-1, "eye_r")] {
            pinned.extend(self.eyes().lay(&mut cage, peg, block(13..15, columns), side, group));
        }
        pinned.extend(mouth_rings(&mut cage, peg, block(6..8, -3..3)));
        relax(&mut cage, peg, &pinned, 2);
        for (side, columns, group) in [(1.0, 4..7, "ear_l"), (-1.0, -7..-4, "ear_r")] {
            self.grow_ear(&mut cage, peg, &block(15..17, columns), side, group);
        }
        cage
    }

    /// Extrudes an ear along its axis: a flattened cone with a hollow front.
    fn grow_ear(&self, cage: &mut Cage, peg: &Peg, region: &[Face], side: f64, group: &str) {
        let place = |cage: &Cage, v: u32| {
            let [a, t] = peg.chart(&cage.bases[v as usize]);
            peg.skull(a, t)
        };
        let root = cage.vertices(region);
        let centre = root.iter().map(|&v| place(cage, v)).sum::<Vec3>() / root.len() as f64;
        let [high, wide, lean] = self.ear;
        let axis = Vec3::new(side * lean, 1.0, -0.12).normalize();
        let front = Vec3::new(side * 0.30, 0.0, 1.0);
        let front = (front - axis * axis.dot(&front)).normalize();
        let across = axis.cross(&front);
        cage.name(region, group);
        for (h, round, thick, dent) in [
            (0.06, 1.05, 0.85, 0.0),
            (0.20, 1.06, 0.62, 0.35),
            (0.42, 1.00, 0.50, 0.75),
            (0.64, 0.86, 0.42, 0.70),
            (0.84, 0.60, 0.32, 0.40),
            (0.97, 0.30, 0.20, 0.10),
        ] {
            cage.extrude(region, group);
            let rim = cage.outline(region);
            let n = rim.len() as f64;
            let seen = |v: u32| {
                let q = place(cage, v) - centre;
                q.dot(&front).atan2(-q.dot(&across))
            };
            let (mut s, mut c) = (0.0, 0.0);
            for (k, &v) in rim.iter().enumerate() {
                let turn = seen(v) - TAU * k as f64 / n;
                (s, c) = (s + turn.sin(), c + turn.cos());
            }
            let start = s.atan2(c);
            let taper = round * (1.0 - self.point * h) + (1.0 - self.point) * 0.15 * h;
            for v in cage.vertices(region) {
                let at = place(cage, v);
                let (x, z) = match rim.iter().position(|&r| r == v) {
                    Some(k) => {
                        let (sin, cos) = (start + TAU * k as f64 / n).sin_cos();
                        (-cos, sin)
                    }
                    None => (0.35 * ((at - centre).dot(&across)).signum(), 0.0),
                };
                let hollow = dent * step(0.95, 0.1, x.abs()) * step(-0.4, 0.6, z);
                let target = centre
                    + axis * (high * h - 0.03)
                    + across * (wide * taper * x)
                    + front * (0.55 * wide * thick * taper.max(0.3) * z - 0.5 * wide * hollow);
                cage.offsets[v as usize] = target - at;
            }
        }
    }

    /// The finished head after `levels` subdivisions.
    pub(in super::super) fn build(&self, levels: usize) -> (Cage, Vec<Vec3>) {
        let peg = self.peg();
        let mut cage = self.cage(&peg);
        for _ in 0..levels {
            cage = cage.subdivided();
        }
        let place = |(base, offset): (&Vec3, &Vec3)| {
            let [a, t] = peg.chart(base);
            let p = peg.skull(a, t);
            let p = p + self.relief(&p, a, t) + offset;
            let s = self.askew;
            p + Vec3::new(s * (1.9 * p.y + 0.4).sin() + 0.5 * s * p.z, 0.5 * s * (2.3 * p.x + 0.3).sin(), 0.0)
        };
        let positions = cage.bases.iter().zip(&cage.offsets).map(place).collect();
        (cage, positions)
    }

    fn relief(&self, p: &Vec3, a: f64, t: f64) -> Vec3 {
        let front = step(0.05, 0.45, a.cos());
        let eyes = self.eyes().relief(p.x, p.y) * step(0.2, 0.5, self.eye[0] - (p.x.abs() - self.eye[0]).abs() + 0.3);
        let [x, y, wide, high] = self.eye;
        let brow = 0.05 * bump([p.x.abs() - x, p.y - y - 2.2 * high], [1.3 * wide, high]);
        let cheek = 0.10 * self.cheek * bump([a.abs() - 1.15, (t - 6.0) / 2.5], [0.45, 1.0]);
        let sideways = p.x.signum() * cheek;
        Vec3::new(sideways, 0.0, (eyes + brow) * front + self.muzzle(a, t) * front)
    }

    /// Nose pad, lips, whisker pads and the mouth's slit, drawn on the peg.
    fn muzzle(&self, a: f64, t: f64) -> f64 {
        let pad = 0.085 * self.pad * bump([a, (t - 6.95) / 0.62], [0.20, 1.0]);
        let nostril = -0.06 * self.pad * bump([a.abs() - 0.115, (t - 6.75) / 0.32], [0.06, 1.0]);
        let groove = -0.035 * bump([a, (t - 5.7) / 0.55], [0.05, 1.0]);
        let whiskers = 0.055 * bump([a.abs() - 0.25, (t - 5.75) / 0.55], [0.17, 1.0]);
        let line = MOUTH + 0.35 * (a / MOUTH_WIDE).powi(2);
        let slit = -0.085 * (-((t - line) / 0.16).powi(2)).exp() * step(1.1, 0.9, a.abs() / MOUTH_WIDE);
        let lip = 0.035 * bump([a, (t - 4.45) / 0.45], [0.32, 1.0]);
        pad + nostril + groove + whiskers + slit + lip
    }
}

fn mouth_rings(cage: &mut Cage, peg: &Peg, region: Vec<Face>) -> Vec<u32> {
    let sheet = Sheet::Chart(peg);
    let mouth = Oval { centre: [0.0, MOUTH + 0.05], wide: MOUTH_WIDE, up: 0.42, down: 0.42, almond: 1.2 };
    let mut feature = Feature::on(cage, sheet, region, &mouth.grown(1.22, 2.1));
    feature.ring(cage, sheet, &mouth.grown(1.10, 1.4), "snout");
    feature.ring(cage, sheet, &mouth.grown(1.0, 0.75), "mouth");
    feature.ring(cage, sheet, &mouth.grown(0.96, 0.28), "mouth");
    cage.name(&feature.region, "mouth");
    feature.inside(cage, sheet, |[a, _]| [a.clamp(-0.42, 0.42), MOUTH + 0.35 * (a / MOUTH_WIDE).powi(2)]);
    feature.pinned
}
