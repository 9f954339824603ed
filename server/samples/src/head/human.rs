//! Human heads.

use super::super::brush::{bump, step};
use super::super::cage::{Cage, Face};
use super::super::loft::Section;
use super::eyes::Eyes;
use super::loops::{Feature, Oval, Sheet, relax};
use super::peg::Peg;
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::TAU;

/// What tells one human head from another; lengths in half head widths (about 8 cm).
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct Human {
    /// Width of the skull against its height.
    pub(in super::super) wide: f64,
    /// Width of the jaw against the skull's.
    pub(in super::super) jaw: f64,
    /// How far the chin stands out.
    pub(in super::super) chin: f64,
    /// Height of the face below the eyes against an adult's.
    pub(in super::super) face: f64,
    /// How far the nose stands out, its width, and how far its tip hangs.
    pub(in super::super) nose: [f64; 3],
    /// Height of the bridge's hump.
    pub(in super::super) hump: f64,
    /// How far the brow stands out.
    pub(in super::super) brow: f64,
    /// Half width and half height of the open eye.
    pub(in super::super) eye: [f64; 2],
    /// How high the eyes' outer corners stand over the inner ones.
    pub(in super::super) slant: f64,
    /// Half width of the mouth and fullness of the lips.
    pub(in super::super) mouth: [f64; 2],
    /// Fullness of the cheeks.
    pub(in super::super) cheek: f64,
    /// Width of the neck.
    pub(in super::super) neck: f64,
    /// Size of the ears and how far they stand off.
    pub(in super::super) ear: [f64; 2],
    /// How far the ears' tips are drawn up and out.
    pub(in super::super) point: f64,
    /// How far left and right differ.
    pub(in super::super) askew: f64,
}

impl Default for Human {
    fn default() -> Self {
        Self {
            wide: 1.0,
            jaw: 1.0,
            chin: 1.0,
            face: 1.0,
            nose: [0.27, 1.0, 0.0],
            hump: 0.0,
            brow: 1.0,
            eye: [0.165, 0.075],
            slant: 0.012,
            mouth: [0.27, 1.0],
            cheek: 1.0,
            neck: 1.0,
            ear: [1.0, 1.0],
            point: 0.0,
            askew: 0.012,
        }
    }
}

/// Azimuths of the columns from the front to the back, in degrees; the other side mirrors them.
const AZIMUTHS: [f64; 13] = [0.0, 10.0, 25.0, 42.0, 58.0, 74.0, 90.0, 105.0, 120.0, 135.0, 150.0, 165.0, 180.0];
const COLUMNS: usize = 24;
/// Heights of the rows.
const ROWS: [f64; 20] =
    [0.0, 0.8, 1.6, 2.5, 3.2, 4.0, 5.0, 6.0, 7.0, 8.0, 8.45, 8.9, 9.5, 10.2, 11.0, 12.0, 12.8, 13.6, 14.3, 15.0];
const DOME: f64 = 12.0;

/// A ring of an ear: half height, half depth, how far out at the back edge, how far back.
struct EarRing {
    high: f64,
    deep: f64,
    out: f64,
    back: f64,
}

const fn ear_ring(high: f64, deep: f64, out: f64, back: f64) -> EarRing {
    EarRing { high, deep, out, back }
}

/// Root, back, rim, inner rim, the groove, the inner fold, and the hollow.
const EAR: [EarRing; 7] = [
    ear_ring(0.22, 0.11, 0.02, 0.0),
    ear_ring(0.27, 0.14, 0.11, 0.05),
    ear_ring(0.37, 0.22, 0.19, 0.09),
    ear_ring(0.34, 0.195, 0.225, 0.09),
    ear_ring(0.29, 0.155, 0.165, 0.075),
    ear_ring(0.22, 0.115, 0.175, 0.055),
    ear_ring(0.14, 0.065, 0.09, 0.03),
];

impl Human {
    fn eyes(&self) -> Eyes {
        let [wide, high] = self.eye;
        let centre = [0.335 * self.wide, 0.11];
        Eyes { centre, wide, high, slant: self.slant, socket: 0.115, lid: 0.085, ball: 0.095, almond: 1.25 }
    }

    /// y of a point of the face that lies at `y` in an adult: below the eyes the face is scaled.
    fn low(&self, y: f64) -> f64 {
        if y < 0.1 { 0.1 + (y - 0.1) * self.face } else { y }
    }

    fn mouth_y(&self) -> f64 {
        self.low(-0.68)
    }

    fn mouth_oval(&self) -> Oval {
        let [wide, full] = self.mouth;
        Oval { centre: [0.0, self.mouth_y()], wide, up: 0.085 * full, down: 0.10 * full, almond: 1.3 }
    }

    fn peg(&self) -> Peg {
        // front y, z | side x, y, z | back y, z | exponent
        let neck = 0.56 * self.neck;
        let jaw = |x: f64| x * (1.0 + (self.jaw - 1.0) * 0.9);
        let c = 0.10 * (self.chin - 1.0);
        let table = [
            [-2.05, 0.22, neck * 1.22, -1.95, -0.18, -1.78, -0.78, 0.95],
            [-1.72, 0.15, neck, -1.62, -0.20, -1.42, -0.66, 0.97],
            [-1.45, 0.20, neck * 1.0, -1.32, -0.20, -1.08, -0.66, 0.97],
            [-1.37, 0.46, jaw(0.565), -1.10, -0.14, -0.80, -0.74, 0.94],
            [-1.30, 0.74 + c, jaw(0.665), -0.92, -0.08, -0.58, -0.84, 0.97],
            [-1.08, 0.90 + c, jaw(0.69), -0.72, -0.03, -0.40, -0.92, 1.04],
            [-0.86, 0.88 + 0.4 * c, jaw(0.715), -0.58, 0.00, -0.26, -0.98, 1.02],
            [-0.68, 0.93, 0.5 * (jaw(0.735) + 0.735), -0.46, 0.00, -0.14, -1.02, 0.99],
            [-0.48, 0.93, 0.75, -0.34, 0.00, -0.03, -1.05, 0.97],
            [-0.30, 0.935, 0.765, -0.22, 0.00, 0.07, -1.065, 0.95],
            [-0.08, 0.925, 0.78, -0.06, 0.00, 0.18, -1.07, 0.93],
            [0.12, 0.925, 0.79, 0.10, 0.00, 0.30, -1.06, 0.91],
            [0.33, 0.965, 0.795, 0.28, -0.01, 0.44, -1.03, 0.90],
            [0.60, 0.955, 0.795, 0.48, -0.04, 0.60, -0.97, 0.90],
            [0.86, 0.82, 0.745, 0.69, -0.08, 0.78, -0.85, 0.92],
            [1.065, 0.585, 0.60, 0.89, -0.11, 0.97, -0.68, 0.95],
            [1.165, 0.26, 0.345, 1.065, -0.13, 1.10, -0.43, 0.98],
            [1.185, -0.10, 0.0, 1.185, -0.10, 1.185, -0.10, 1.0],
        ];
        let sections: Vec<Section> = table
            .iter()
            .map(|r| Section {
                front: [self.low(r[0]), r[1]],
                side: [r[2] * self.wide, self.low(r[3]), r[4]],
                back: [self.low(r[5]), r[6]],
                exponent: r[7],
                snout: r[7],
            })
            .collect();
        Peg::new(&sections, DOME)
    }

    /// The control cage on the peg, ears grown out.
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
        cage.name(&block(3..6, -7..7), "jaw");
        cage.name(&block(6..15, -5..5), "face");
        cage.name(&block(9..14, -1..1), "nose");
        let mut pinned = Vec::new();
        for side in [1.0, -1.0] {
            let (columns, group) = if side > 0.0 { (1..3, "eye_l") } else { (-3..-1, "eye_r") };
            let region = block(13..15, columns);
            pinned.extend(self.eyes().lay(&mut cage, peg, region, side, group));
        }
        pinned.extend(self.mouth_rings(&mut cage, peg, block(7..9, -2..2)));
        relax(&mut cage, peg, &pinned, 3);
        for side in [1.0, -1.0] {
            let (columns, group) = if side > 0.0 { (6..8, "ear_l") } else { (-8..-6, "ear_r") };
            self.grow_ear(&mut cage, peg, &block(10..14, columns), side, group);
        }
        cage
    }

    fn mouth_rings(&self, cage: &mut Cage, peg: &Peg, region: Vec<Face>) -> Vec<u32> {
        let mouth = self.mouth_oval();
        let sheet = Sheet::Front(peg);
        let mut feature = Feature::on(cage, sheet, region, &mouth.grown(1.38, 2.25));
        feature.ring(cage, sheet, &mouth.grown(1.16, 1.45), "face");
        feature.ring(cage, sheet, &mouth, "mouth");
        feature.ring(cage, sheet, &mouth.grown(0.95, 0.62), "mouth");
        feature.ring(cage, sheet, &Oval { almond: 1.1, ..mouth.grown(0.88, 0.18) }, "mouth");
        cage.name(&feature.region, "mouth");
        let (y, wide) = (self.mouth_y(), self.mouth[0]);
        feature.inside(cage, sheet, |[x, _]| [x.clamp(-0.45 * wide, 0.45 * wide), y]);
        feature.pinned
    }

    /// Extrudes an ear: root, back, rim, inner rim, and a hollow.
    fn grow_ear(&self, cage: &mut Cage, peg: &Peg, region: &[Face], side: f64, group: &str) {
        let place = |cage: &Cage, v: u32| {
            let [a, t] = peg.chart(&cage.bases[v as usize]);
            peg.skull(a, t)
        };
        let root = cage.vertices(region);
        let centre = root.iter().map(|&v| place(cage, v)).sum::<Vec3>() / root.len() as f64 + Vec3::new(0.0, 0.0, 0.05);
        let (size, off) = (self.ear[0], self.ear[1]);
        cage.name(region, group);
        for ring in EAR {
            cage.extrude(region, group);
            let rim = cage.outline(region);
            let n = rim.len() as f64;
            let seen = |v: u32| {
                let q = place(cage, v) - centre;
                (q.y / 0.30).atan2(-q.z * side / 0.20)
            };
            let (mut s, mut c) = (0.0, 0.0);
            for (k, &v) in rim.iter().enumerate() {
                let turn = seen(v) - TAU * k as f64 / n;
                (s, c) = (s + turn.sin(), c + turn.cos());
            }
            let start = s.atan2(c);
            for v in cage.vertices(region) {
                let at = place(cage, v);
                let (back, up) = match rim.iter().position(|&r| r == v) {
                    Some(k) => {
                        let (sin, cos) = (start + TAU * k as f64 / n).sin_cos();
                        (side * cos, sin)
                    }
                    None => (0.0, (at.y - centre.y) / 0.30),
                };
                // Narrow at the lobe, wide above; the front edge lies on the head.
                let lean = 0.16 + 0.84 * step(-1.15, 0.85, back);
                let tip = self.point * step(0.2, 1.0, up) * (0.3 + 3.0 * ring.out);
                let deep = ring.deep * back * (0.80 + 0.30 * up) - 0.10 * ring.high * up;
                let target = centre
                    + Vec3::new(
                        side * (ring.out * lean * off + 0.3 * tip + 0.02),
                        size * (ring.high * up + 0.04) + 0.5 * tip,
                        -size * (deep + ring.back) - 0.25 * tip,
                    );
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
        let positions = cage
            .bases
            .iter()
            .zip(&cage.offsets)
            .map(|(base, offset)| {
                let [a, t] = peg.chart(base);
                let p = peg.skull(a, t);
                self.askew(p + self.relief(&p, a) + offset)
            })
            .collect();
        (cage, positions)
    }

    fn askew(&self, p: Vec3) -> Vec3 {
        let s = self.askew;
        p + Vec3::new(
            s * (1.9 * p.y + 0.4).sin() + 0.4 * s * p.z,
            0.5 * s * (2.3 * p.x + 0.3).sin(),
            0.6 * s * (1.7 * p.x + p.y).sin(),
        )
    }

    /// What the features add to the skull at `p`.
    fn relief(&self, p: &Vec3, azimuth: f64) -> Vec3 {
        let front = step(0.05, 0.45, azimuth.cos());
        let (x, y) = (p.x, p.y);
        let z = self.eyes().relief(x, y) + self.nose(x, y) + self.lips(x, y) + self.flesh(x, y);
        let tip = self.nose(x, y) / 0.3;
        Vec3::new(0.0, -0.05 * tip.max(0.0).powi(2) * self.nose[2], z) * front
    }

    fn nose(&self, x: f64, y: f64) -> f64 {
        let [out, wide, hang] = self.nose;
        let (root, tip, base) = (0.20, self.low(-0.31) - 0.06 * hang, self.low(-0.43) - 0.05 * hang);
        // A soft minimum: the bridge runs out into the tip without a kink.
        let s = ((root - y) / (root - tip)).clamp(0.0, 2.0);
        let s = s - (s - 0.7).max(0.0).powi(2) * 0.8;
        let under = step(base - 0.02, base + 0.17, y);
        let above = step(root + 0.16, root - 0.06, y);
        let height = 0.045 + (out - 0.045) * (1.2 * s - 0.2 * s * s) + self.hump * bump([y - 0.02, 0.0], [0.10, 1.0]);
        let width = (0.075 + 0.055 * s * s) * wide;
        let ridge = height * above * under * (-(x / width).abs().powf(2.4)).exp();
        let ball = 0.060 * bump([x, y - tip - 0.015], [0.095 * wide, 0.085]) * (out / 0.3);
        let wing = 0.105 * bump([x.abs() - 0.135 * wide, y - (base + 0.085)], [0.06 * wide, 0.07]);
        let nostril = -0.05 * bump([x.abs() - 0.07 * wide, y - (base + 0.025)], [0.04, 0.03]);
        ridge + ball + wing + nostril
    }

    fn lips(&self, x: f64, y: f64) -> f64 {
        let [wide, full] = self.mouth;
        let ym = self.mouth_y() + 0.012 * (x / wide).powi(2);
        let along = (1.0 - (x / wide).powi(2)).max(0.0).sqrt();
        let bow = 0.012 * (-((x.abs() - 0.06) / 0.05).powi(2)).exp();
        let mound = 0.055 * bump([x, y - ym], [wide * 1.05, 0.24]);
        let upper = 0.060 * full * along * bump([y - (ym + 0.048 * full + bow), 0.0], [0.040 * full + 0.008, 1.0]);
        let lower = 0.070 * full * along * bump([y - (ym - 0.056 * full), 0.0], [0.048 * full + 0.008, 1.0]);
        let slit =
            -0.060 * (0.25 + 0.75 * along) * bump([y - ym, 0.0], [0.016, 1.0]) * step(1.12, 0.95, (x / wide).abs());
        let corner = -0.030 * bump([x.abs() - wide * 1.04, y - ym], [0.055, 0.06]);
        let philtrum = -0.022 * bump([x, y - (ym + 0.15 * self.face)], [0.035, 0.07]);
        let below = -0.045 * bump([x, y - (ym - 0.165)], [0.20, 0.055]);
        mound + upper + lower + slit + corner + philtrum + below
    }

    fn flesh(&self, x: f64, y: f64) -> f64 {
        let brow_y = 0.345 - 0.10 * (x.abs() - 0.3).powi(2);
        let brow = 0.055 * self.brow * bump([x.abs() - 0.33, y - brow_y], [0.24, 0.075])
            + 0.03 * self.brow * bump([x, y - 0.32], [0.12, 0.09]);
        let bone = 0.060 * self.cheek * bump([x.abs() - 0.47, y - self.low(-0.17)], [0.17, 0.15]);
        let hollow = -0.045 * (2.0 - self.cheek) * bump([x.abs() - 0.50, y - self.low(-0.58)], [0.16, 0.20]);
        let fold = -0.022 * bump([x.abs() - 0.30, y - self.low(-0.46)], [0.045, 0.12]);
        let chin = 0.075 * self.chin * bump([x, y - self.low(-1.05)], [0.20, 0.13]);
        let temple = -0.03 * bump([x.abs() - 0.68, y - 0.38], [0.14, 0.22]);
        brow + bone + hollow + fold + chin + temple
    }
}
