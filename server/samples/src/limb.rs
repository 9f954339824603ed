//! Limbs: annuli, open at both ends, with their joints' loops.

use super::brush::{blob, step};
use super::cage::Cage;
use super::loft::{Hoop, hoops};
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::TAU;

const COLUMNS: usize = 16;

/// A limb's tube; columns start at the limb's left (+x) and turn over its back; row 0 is the lower end.
fn tube(rings: &[Hoop], group: &str) -> Cage {
    Cage::tube(rings.len(), COLUMNS, group, |r, c| rings[r].at(TAU * c as f64 / COLUMNS as f64))
}

/// Heights of rows that stand densest around `joint`.
fn rows(count: usize, end: f64, joint: f64) -> Vec<f64> {
    let even = |k: usize| end * k as f64 / (count - 1) as f64;
    (0..count)
        .map(|k| {
            let t = even(k);
            let pull = 0.55 * (-((t - joint) / (0.16 * end)).powi(2)).exp();
            t + (joint - t) * pull
        })
        .collect()
}

/// What tells one arm or leg from another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Build {
    /// Thickness against the usual.
    pub(super) thick: f64,
    /// Fullness of the muscles.
    pub(super) muscle: f64,
    /// How far the joint is bent, 0–1.
    pub(super) bend: f64,
}

/// A left arm from the wrist (below) to the shoulder, the elbow behind.
pub(super) fn arm(build: &Build, levels: usize) -> (Cage, Vec<Vec3>) {
    let Build { thick: w, muscle: m, bend } = *build;
    let b = 0.9 * bend;
    let keys = [
        [0.10, -1.70, 0.05 + 1.50 * b, 0.21 * w, 0.15 * w],
        [0.08, -1.40, 0.03 + 1.16 * b, 0.22 * w, 0.165 * w],
        [0.05, -1.00, 0.01 + 0.74 * b, 0.28 * w, 0.235 * w],
        [0.03, -0.62, 0.0 + 0.38 * b, 0.335 * w, 0.28 * w],
        [0.0, -0.27, 0.08 * b, 0.325 * w, 0.28 * w],
        [0.0, 0.0, -0.05 * b, 0.295 * w, 0.275 * w],
        [0.0, 0.35, -0.02 * b, 0.285 * w, 0.295 * w],
        [0.01, 0.75, 0.0, 0.315 * w, 0.36 * w],
        [0.03, 1.15, 0.0, 0.37 * w, 0.39 * w],
        [0.05, 1.50, 0.0, 0.42 * w, 0.41 * w],
        [0.04, 1.80, 0.0, 0.40 * w, 0.41 * w],
    ];
    let rings = hoops(&keys, Vec3::x(), &rows(21, 10.0, 4.9));
    let mut cage = tube(&rings, "forearm");
    let row = |r: usize| (r * COLUMNS..(r + 1) * COLUMNS).collect::<Vec<_>>();
    (12..20).for_each(|r| cage.name(&row(r), "upper_arm"));
    (7..12).for_each(|r| cage.name(&row(r), "elbow"));
    // v of a hoop is axis × x: behind the arm. So column 4 of 16 is the elbow's.
    let cap: Vec<usize> = (9..11).flat_map(|r| [r * COLUMNS + 3, r * COLUMNS + 4]).collect();
    joint_rings(&mut cage, &cap, &[(0.16, 0.0), (0.11, 0.012), (0.05, 0.018)], "elbow");
    let sculpt = move |p: &Vec3| {
        let biceps = 0.115 * m * blob(p, [0.02, 0.85, 0.40], [0.30, 0.40, 0.30]);
        let triceps = -0.085 * m * blob(p, [-0.02, 0.95, -0.40], [0.30, 0.50, 0.28]);
        let tip = -0.085 * blob(p, [0.0, -0.03 + 0.02 * b, -0.28 - 0.05 * b], [0.13, 0.15, 0.20]);
        let pit = -0.05 * blob(p, [0.0, 0.05, 0.30], [0.25, 0.14, 0.2]);
        let deltoid = 0.11 * m * blob(p, [0.45, 1.42, 0.0], [0.30, 0.34, 0.40]);
        let outer = 0.085 * m * blob(p, [0.35, -0.42, 0.12 + 0.28 * b], [0.25, 0.36, 0.30]);
        let inner = -0.06 * m * blob(p, [-0.32, -0.55, 0.10 + 0.35 * b], [0.25, 0.40, 0.30]);
        let bone = 0.045 * blob(p, [0.30, -1.58, -0.08 + 1.35 * b], [0.11, 0.10, 0.14]);
        Vec3::new(deltoid + outer + inner + bone, 0.0, biceps + triceps + tip + pit)
    };
    finish(cage, levels, sculpt)
}

/// A left leg from the ankle (below) to the thigh, the knee in front.
pub(super) fn leg(build: &Build, levels: usize) -> (Cage, Vec<Vec3>) {
    let Build { thick: w, muscle: m, bend: b } = *build;
    let keys = [
        [-0.02, -1.95, -0.05 - 0.75 * b, 0.225 * w, 0.25 * w],
        [-0.02, -1.70, -0.05 - 0.62 * b, 0.215 * w, 0.25 * w],
        [-0.01, -1.30, -0.06 - 0.42 * b, 0.27 * w, 0.31 * w],
        [0.0, -0.90, -0.08 - 0.22 * b, 0.345 * w, 0.385 * w],
        [0.0, -0.52, -0.06 - 0.06 * b, 0.35 * w, 0.385 * w],
        [0.0, -0.20, -0.01 + 0.04 * b, 0.325 * w, 0.345 * w],
        [0.0, 0.10, 0.0 + 0.06 * b, 0.345 * w, 0.36 * w],
        [0.01, 0.50, 0.0, 0.40 * w, 0.43 * w],
        [0.03, 0.95, 0.0, 0.47 * w, 0.515 * w],
        [0.06, 1.40, 0.0, 0.53 * w, 0.58 * w],
        [0.08, 1.75, -0.01, 0.56 * w, 0.60 * w],
    ];
    let rings = hoops(&keys, Vec3::x(), &rows(23, 10.0, 5.3));
    let mut cage = tube(&rings, "shin");
    let row = |r: usize| (r * COLUMNS..(r + 1) * COLUMNS).collect::<Vec<_>>();
    (15..22).for_each(|r| cage.name(&row(r), "thigh"));
    (9..15).for_each(|r| cage.name(&row(r), "knee"));
    let cap: Vec<usize> = (11..13).flat_map(|r| [r * COLUMNS + 11, r * COLUMNS + 12]).collect();
    joint_rings(&mut cage, &cap, &[(0.21, 0.0), (0.16, 0.02), (0.09, 0.03)], "kneecap");
    let sculpt = move |p: &Vec3| {
        let cap = 0.055 * blob(p, [0.0, -0.05, 0.38], [0.20, 0.17, 0.25]);
        let below = 0.04 * blob(p, [0.0, -0.42, 0.33], [0.12, 0.14, 0.2]);
        let pit = 0.05 * blob(p, [0.0, -0.05, -0.38], [0.22, 0.20, 0.2]);
        let quad = 0.10 * m * blob(p, [0.05, 0.95, 0.50], [0.40, 0.55, 0.40]);
        let calf_in = -0.14 * m * blob(p, [-0.20, -0.70, -0.42 - 0.2 * b], [0.26, 0.42, 0.30]);
        let calf_out = -0.10 * m * blob(p, [0.22, -0.62, -0.40 - 0.2 * b], [0.26, 0.38, 0.30]);
        let shin = 0.05 * blob(p, [-0.05, -1.05, 0.25 - 0.3 * b], [0.13, 0.60, 0.2]);
        let tear = -0.075 * m * blob(p, [-0.40, 0.36, 0.20], [0.25, 0.26, 0.3]);
        let sweep = 0.07 * m * blob(p, [0.50, 0.75, 0.20], [0.30, 0.50, 0.4]);
        let inner_ankle = -0.05 * blob(p, [-0.26, -1.83, -0.05 - 0.68 * b], [0.11, 0.11, 0.15]);
        let outer_ankle = 0.055 * blob(p, [0.24, -1.89, -0.09 - 0.70 * b], [0.11, 0.11, 0.15]);
        Vec3::new(tear + sweep + inner_ankle + outer_ankle, 0.0, cap + below + pit + quad + calf_in + calf_out + shin)
    };
    finish(cage, levels, sculpt)
}

/// Round loops on a joint's tip: (radius, height).
fn joint_rings(cage: &mut Cage, region: &[usize], rings: &[(f64, f64)], group: &str) {
    let rim = cage.outline(region);
    let centre = cage.centre(&cage.vertices(region));
    let spoke = |k: usize| cage.bases[rim[k % rim.len()] as usize] - centre;
    let out = (0..rim.len()).map(|k| spoke(k).cross(&spoke(k + 1))).sum::<Vec3>().normalize();
    let u = (Vec3::x() - out * out.x).normalize();
    let v = out.cross(&u);
    let hoops: Vec<Hoop> =
        rings.iter().map(|&(r, high)| Hoop { centre: centre + out * high, u: u * r, v: v * r }).collect();
    cage.lay(region, &hoops[0]);
    cage.grow(region, &hoops[1..], group);
}

/// A piece of a tentacle with suckers; `curl` is how far it winds, in radians.
pub(super) fn tentacle(curl: f64, suckers: usize, levels: usize) -> (Cage, Vec<Vec3>) {
    let count = 3 * suckers + 3;
    let keys: Vec<[f64; 5]> = (0..=12)
        .map(|k| {
            let s = f64::from(k) / 12.0;
            let radius = 0.52 - 0.40 * s.powf(0.85);
            let angle = curl * s * s;
            let reach = 1.35 - 0.62 * s;
            [
                0.16 * (3.0 * s).sin(),
                2.6 * s + 0.4 * s * angle.sin(),
                reach * (1.0 - angle.cos()),
                radius,
                radius * 0.92,
            ]
        })
        .collect();
    let ts: Vec<f64> = (0..count).map(|k| 12.0 * (k as f64 / (count - 1) as f64).powf(0.92)).collect();
    let rings = hoops(&keys, Vec3::x(), &ts);
    let mut cage = tube(&rings, "skin");
    let row = |r: usize| (r * COLUMNS..(r + 1) * COLUMNS).collect::<Vec<_>>();
    (0..2).for_each(|r| cage.name(&row(r), "root"));
    (count - 3..count - 1).for_each(|r| cage.name(&row(r), "tip"));
    for k in 0..suckers {
        let rows = 3 * k + 1..3 * k + 3;
        // Two rows of suckers in front, left and right in turn.
        let first = if k % 2 == 0 { 12 } else { 10 };
        let block: Vec<usize> = rows.flat_map(|r| [r * COLUMNS + first, r * COLUMNS + first + 1]).collect();
        let hoop = &rings[3 * k + 2];
        let angle = TAU * (first as f64 + 1.0) / COLUMNS as f64;
        let out = hoop.at(angle) - hoop.centre;
        let (size, out) = (0.52 * out.norm(), out.normalize());
        let u = hoop.u.normalize();
        let u = (u - out * u.dot(&out)).normalize();
        let v = out.cross(&u);
        let at = |high: f64, wide: f64| Hoop {
            centre: hoop.at(angle) + out * (high * size),
            u: u * (wide * size),
            v: v * (wide * size),
        };
        cage.grow(&block, &[at(0.0, 0.62), at(0.34, 0.80), at(0.40, 0.62), at(0.08, 0.36)], "suckers");
    }
    finish(cage, levels, |p| Vec3::new(0.0, 0.0, -0.04 * step(0.1, 0.5, p.x.abs())))
}

/// Subdivides and sculpts.
pub(super) fn finish(mut cage: Cage, levels: usize, sculpt: impl Fn(&Vec3) -> Vec3) -> (Cage, Vec<Vec3>) {
    for _ in 0..levels {
        cage = cage.subdivided();
    }
    let positions = cage.bases.iter().map(|p| p + sculpt(p)).collect();
    (cage, positions)
}
