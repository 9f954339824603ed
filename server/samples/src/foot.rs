//! A human foot: a disc, open at the ankle, toes forward.

use super::brush::blob;
use super::cage::Cage;
use super::limb::finish;
use super::loft::{Hoop, Loft, Section};
use quadmuse_kernel::mesh::Vec3;

/// Azimuth of the corners between top and sole, in radians.
const CORNER: f64 = 1.15;
const TOES: usize = 5;
const COLUMNS: usize = 2 * TOES + 4;
const ROWS: [f64; 12] = [0.0, 0.8, 1.5, 2.2, 2.9, 3.6, 4.2, 4.9, 5.6, 6.3, 6.9, 7.4];

/// What tells one foot from another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    /// Width against the usual.
    pub(super) wide: f64,
    /// Height of the arch.
    pub(super) arch: f64,
    /// Length of the toes.
    pub(super) toes: f64,
}

impl Foot {
    fn loft(&self) -> Loft {
        let w = -self.wide;
        let a = 0.10 * self.arch;
        // front: instep y, z | side x, y, z | back: heel and sole y, z. The loft runs down and forward.
        Loft::open(&[
            Section::of([1.55, 0.20, 0.265 * w, 1.55, -0.08, 1.55, -0.36, 0.95]),
            Section::of([1.15, 0.24, 0.255 * w, 1.12, -0.08, 1.10, -0.36, 0.95]),
            Section::of([0.86, 0.34, 0.30 * w, 0.74, -0.07, 0.62, -0.40, 0.92]),
            Section::of([0.74, 0.50, 0.325 * w, 0.46, -0.02, 0.22, -0.46, 0.88]),
            Section::of([0.67, 0.66, 0.34 * w, 0.30, 0.12, 0.00, -0.26, 0.80]),
            Section::of([0.58, 0.90, 0.36 * w, 0.24, 0.48, a * 0.7, 0.16, 0.76]),
            Section::of([0.48, 1.18, 0.41 * w, 0.20, 0.90, a, 0.66, 0.74]),
            Section::of([0.33, 1.50, 0.47 * w, 0.16, 1.34, 0.00, 1.16, 0.74]),
            Section::of([0.22, 1.80, 0.49 * w, 0.12, 1.70, 0.00, 1.62, 0.78]),
        ])
    }

    /// A left foot after `levels` subdivisions: the big toe at −x.
    pub(super) fn build(&self, levels: usize) -> (Cage, Vec<Vec3>) {
        let loft = self.loft();
        let azimuth = |c: usize| {
            let half = TOES + 2;
            let across = -CORNER + 2.0 * CORNER * (c % half) as f64 / TOES as f64;
            let turn = if c % half <= TOES { across } else { std::f64::consts::FRAC_PI_2 };
            if c < half { turn } else { turn + std::f64::consts::PI }
        };
        let slant = |p: Vec3| {
            // The toes' line falls back towards the little toe (+x).
            let front = ((p.z - 0.6) / 1.1).clamp(0.0, 1.0);
            p + Vec3::new(0.05 * front, 0.0, -0.42 * front * (p.x + 0.15).max(-0.3))
        };
        let mut cage = Cage::tube(ROWS.len(), COLUMNS, "sole", |r, c| slant(loft.at(azimuth(c), ROWS[r])));
        let faces = |rows: std::ops::Range<usize>| (rows.start * COLUMNS..rows.end * COLUMNS).collect::<Vec<_>>();
        cage.name(&faces(0..3), "ankle");
        cage.name(&faces(3..6), "heel");
        for r in 3..11 {
            cage.name(&(0..=TOES).map(|c| r * COLUMNS + c % COLUMNS).collect::<Vec<_>>(), "instep");
        }
        let rim: Vec<u32> = (0..COLUMNS).map(|c| ((ROWS.len() - 1) * COLUMNS + c) as u32).collect();
        let roots = cage.cap(&rim, TOES, "toes");
        for i in 0..TOES {
            let region = [roots[i], roots[TOES + i]];
            let root = cage.centre(&cage.vertices(&region));
            // Column 0 is at +x where the width is negative: the little toe comes first.
            let big = [0.0, 0.05, 0.12, 0.22, 1.0][i];
            let (radius, length) = (0.078 + 0.058 * big, self.toes * (0.27 + 0.05 * i as f64 + 0.08 * big));
            let spread = 0.10 * (root.x + 0.1);
            cage.grow(&region, &toe(root, radius * self.wide, length, spread), &format!("toe_{}", TOES - i));
        }
        finish(cage, levels, |p| {
            let outer = 0.075 * blob(p, [0.28, 0.80, -0.10], [0.13, 0.14, 0.16]);
            let inner = -0.075 * blob(p, [-0.28, 0.88, -0.03], [0.13, 0.14, 0.16]);
            let ball = -0.05 * blob(p, [-0.46, 0.14, 1.42], [0.15, 0.16, 0.24]);
            let hollow = 0.09 * blob(p, [-0.38, 0.10, 0.62], [0.18, 0.20, 0.36]);
            let tendon = -0.05 * blob(p, [0.0, 0.95, -0.42], [0.10, 0.35, 0.12]);
            Vec3::new(outer + inner + ball + hollow, 0.0, tendon)
        })
    }
}

fn toe(root: Vec3, radius: f64, length: f64, spread: f64) -> Vec<Hoop> {
    let stations = [
        (0.10, 0.92, 0.0),
        (0.35, 0.88, 0.03),
        (0.55, 0.98, 0.03),
        (0.75, 1.10, 0.0),
        (0.92, 0.95, -0.02),
        (1.0, 0.5, -0.03),
    ];
    stations
        .iter()
        .map(|&(s, round, rise)| {
            let r = 1.18 * radius * round;
            Hoop {
                centre: root + Vec3::new(spread * s, rise - 0.05 * s, length * s),
                u: Vec3::x() * r,
                v: Vec3::y() * (r * 1.02),
            }
        })
        .collect()
}
