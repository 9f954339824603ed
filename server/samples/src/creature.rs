//! Closed creatures: spheres in topology, with fins, legs, beaks and eyes grown out of one body.

use super::brush::{blob, step};
use super::cage::{Cage, Face};
use super::limb::finish;
use super::loft::{Hoop, Loft, Section};
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::TAU;

const COLUMNS: usize = 16;

/// A body lofted from tail to head and closed at both ends. Columns start at the top (the sections' front) and run to
/// the model's left; the face (r, c) lies between rows r, r + 1 and columns c, c + 1.
struct Body {
    cage: Cage,
    head: Vec<Face>,
    tail: Vec<Face>,
}

impl Body {
    fn of(sections: &[[f64; 8]], rows: usize, ends: [usize; 2]) -> Self {
        let sections: Vec<Section> = sections.iter().map(|&s| Section::of(s)).collect();
        let loft = Loft::open(&sections);
        let t = |r: usize| loft.end() * r as f64 / (rows - 1) as f64;
        let mut cage = Cage::tube(rows, COLUMNS, "body", |r, c| loft.at(TAU * c as f64 / COLUMNS as f64, t(r)));
        let last = (rows - 1) * COLUMNS;
        let start = |wide: usize| COLUMNS - wide / 2;
        let head: Vec<u32> = (0..COLUMNS).map(|c| (last + (c + start(ends[1])) % COLUMNS) as u32).collect();
        let tail: Vec<u32> =
            (0..COLUMNS).rev().map(|c| ((c + start(ends[0]) + 1 + ends[0]) % COLUMNS) as u32).collect();
        let head = cage.cap(&head, ends[1], "head");
        let tail = cage.cap(&tail, ends[0], "tail");
        Self { cage, head, tail }
    }

    fn block(&self, rows: std::ops::Range<usize>, columns: std::ops::Range<isize>) -> Vec<Face> {
        rows.flat_map(|r| columns.clone().map(move |c| r * COLUMNS + c.rem_euclid(COLUMNS as isize) as usize)).collect()
    }

    /// The outward direction of a block: the mean of its faces' normals.
    fn outward(&self, region: &[Face]) -> Vec3 {
        let p = |v: u32| self.cage.bases[v as usize];
        region
            .iter()
            .map(|&f| self.cage.quads[f].map(p))
            .map(|[a, b, c, d]| (c - a).cross(&(d - b)))
            .sum::<Vec3>()
            .normalize()
    }

    /// Loops around an eye on a block, `size` its radius.
    fn eye(&mut self, region: &[Face], size: f64, group: &str) {
        let out = self.outward(region);
        let centre = self.cage.centre(&self.cage.vertices(region));
        let u = (Vec3::z() - out * out.z).try_normalize(0.2).unwrap_or(Vec3::y());
        let v = out.cross(&u);
        let ring = |radius: f64, high: f64| Hoop {
            centre: centre + out * (high * size),
            u: u * (radius * size),
            v: v * (radius * size),
        };
        self.cage.grow(
            region,
            &[ring(1.35, 0.10), ring(1.10, 0.28), ring(0.92, 0.16), ring(0.72, 0.42), ring(0.38, 0.58)],
            group,
        );
    }

    /// A flat limb on a block: each hoop is (distance, half length along `along`, half thickness).
    fn fin(&mut self, region: &[Face], out: Vec3, along: Vec3, hoops: &[[f64; 4]], group: &str) {
        let centre = self.cage.centre(&self.cage.vertices(region));
        let out = out.normalize();
        let along = (along - out * out.dot(&along)).normalize();
        let across = out.cross(&along);
        let hoops: Vec<Hoop> = hoops
            .iter()
            .map(|&[far, long, thick, back]| Hoop {
                centre: centre + out * far + along * back,
                u: along * long,
                v: across * thick,
            })
            .collect();
        self.cage.grow(region, &hoops, group);
    }
}

/// A fish: tail fin, dorsal, pectoral and belly fins, eyes, a mouth. `tall` is its height against the usual, `long`
/// its length.
pub(super) fn fish(tall: f64, long: f64, levels: usize) -> (Cage, Vec<Vec3>) {
    let h = |y: f64| y * tall;
    let ring = |z: f64, top: f64, wide: f64, bottom: f64| {
        [h(top), z * long, -wide, h(0.5 * (top + bottom)), z * long, h(bottom), z * long, 1.0]
    };
    let mut tail_out = ring(-2.05, 0.66, 0.025, -0.58);
    (tail_out[1], tail_out[4], tail_out[6]) = (-2.25 * long, -1.80 * long, -2.18 * long);
    let sections = [
        tail_out,
        ring(-1.66, 0.36, 0.05, -0.30),
        ring(-1.36, 0.18, 0.09, -0.14),
        ring(-1.05, 0.24, 0.16, -0.20),
        ring(-0.65, 0.44, 0.27, -0.38),
        ring(-0.20, 0.60, 0.355, -0.52),
        ring(0.25, 0.62, 0.385, -0.54),
        ring(0.65, 0.50, 0.36, -0.46),
        ring(0.98, 0.32, 0.28, -0.33),
        ring(1.20, 0.15, 0.165, -0.20),
    ];
    let mut body = Body::of(&sections, 19, [2, 4]);
    let spine = body.block(6..13, -1..1);
    body.fin(
        &spine,
        Vec3::new(0.0, 1.0, -0.25),
        Vec3::z(),
        &[[0.04, 0.58 * long, 0.045, 0.0], [0.22, 0.50 * long, 0.03, -0.08], [0.40, 0.36 * long, 0.02, -0.22]],
        "dorsal_fin",
    );
    let belly = body.block(5..8, 7..9);
    body.fin(
        &belly,
        Vec3::new(0.0, -1.0, -0.5),
        Vec3::z(),
        &[[0.03, 0.20, 0.04, 0.0], [0.16, 0.17, 0.03, -0.06], [0.28, 0.12, 0.02, -0.14]],
        "anal_fin",
    );
    for (side, columns, group) in [(1.0, 10..12, "fin_l"), (-1.0, 4..6, "fin_r")] {
        let region = body.block(12..14, columns);
        let out = Vec3::new(side, -0.35, -0.9);
        body.fin(
            &region,
            out,
            Vec3::y(),
            &[[0.06, 0.11, 0.045, 0.0], [0.22, 0.16, 0.03, 0.0], [0.42, 0.20, 0.02, -0.02], [0.58, 0.16, 0.015, -0.05]],
            group,
        );
    }
    for (columns, group) in [(11..13, "eye_l"), (3..5, "eye_r")] {
        let region = body.block(15..17, columns);
        body.eye(&region, 0.092, group);
    }
    let mouth = body.head.clone();
    body.cage.inset(
        &mouth,
        &[(0.80, Vec3::new(0.0, 0.0, 0.07)), (0.72, Vec3::new(0.0, 0.0, 0.02)), (0.75, Vec3::new(0.0, 0.0, -0.10))],
        "mouth",
    );
    finish(body.cage, levels, move |p| {
        let notch = 0.26 * step(-1.9 * long, -2.25 * long, p.z) * (-(p.y / (0.22 * tall)).powi(2)).exp();
        let gill = -0.045 * (-((p.z - 0.66 + 0.35 * p.y * p.y) / 0.055).powi(2)).exp() * step(0.5, 0.2, p.y.abs());
        let sway = 0.10 * step(-0.2, -2.0, p.z) * (1.6 * p.z).sin();
        lopsided(p) + Vec3::new(sway + gill * p.x.signum() * step(0.1, 0.25, p.x.abs()), 0.0, notch)
    })
}

/// A rubber duck: round body, tail up, wings, a head with beak and eyes. `neck` is the neck's length.
pub(super) fn duck(neck: f64, plump: f64, levels: usize) -> (Cage, Vec<Vec3>) {
    let (n, w) = (0.30 * neck, -plump);
    // top y, z | side x, y, z | bottom y, z: from the tail's tip through the breast up to the crown.
    let sections = [
        [0.52, -1.32, 0.07 * w, 0.47, -1.34, 0.42, -1.34, 1.0],
        [0.40, -1.12, 0.30 * w, 0.28, -1.18, 0.10, -1.26, 1.0],
        [0.28, -0.88, 0.54 * w, 0.06, -0.90, -0.30, -1.00, 0.95],
        [0.27, -0.58, 0.70 * w, -0.05, -0.52, -0.52, -0.56, 0.92],
        [0.33, -0.28, 0.75 * w, -0.06, -0.10, -0.56, 0.02, 0.92],
        [0.42, -0.06, 0.68 * w, 0.02, 0.28, -0.40, 0.56, 0.95],
        [0.54 + 0.4 * n, 0.06, 0.50 * w, 0.26 + 0.3 * n, 0.40, 0.00, 0.78, 1.0],
        [0.68 + n, 0.10, 0.385 * w, 0.58 + n, 0.40, 0.46 + 0.8 * n, 0.72, 1.0],
        [0.82 + n, 0.02, 0.43 * w, 0.80 + n, 0.38, 0.74 + n, 0.74, 1.0],
        [1.05 + n, -0.05, 0.47 * w, 1.05 + n, 0.37, 1.03 + n, 0.80, 1.0],
        [1.30 + n, 0.06, 0.38 * w, 1.31 + n, 0.36, 1.28 + n, 0.68, 1.0],
        [1.43 + n, 0.22, 0.20 * w, 1.44 + n, 0.36, 1.41 + n, 0.50, 1.0],
    ];
    let mut body = Body::of(&sections, 21, [4, 4]);
    (body.cage).name(&(15 * COLUMNS..20 * COLUMNS).collect::<Vec<_>>(), "head");
    for (side, columns, group) in [(1.0, 11..14, "wing_l"), (-1.0, 2..5, "wing_r")] {
        let region = body.block(5..10, columns);
        let centre = body.cage.centre(&body.cage.vertices(&region));
        let hoop = |out: f64, long: f64, high: f64, back: f64| Hoop {
            centre: centre + Vec3::new(side * out, 0.06 + 0.25 * back, -back),
            u: Vec3::new(0.0, 0.10, -0.95).normalize() * long,
            v: Vec3::new(0.0, 0.95, 0.10) * (high * side),
        };
        body.cage.grow(
            &region,
            &[
                hoop(0.05, 0.50, 0.25, 0.02),
                hoop(0.13, 0.54, 0.26, 0.10),
                hoop(0.17, 0.44, 0.18, 0.12),
                hoop(0.17, 0.22, 0.07, 0.12),
            ],
            group,
        );
    }
    let beak = body.block(15..17, 7..9);
    let centre = body.cage.centre(&body.cage.vertices(&beak));
    let lip = |far: f64, wide: f64, high: f64, rise: f64| Hoop {
        centre: centre + Vec3::new(0.0, rise, far),
        u: Vec3::x() * wide,
        v: Vec3::y() * high,
    };
    body.cage.grow(
        &beak,
        &[
            lip(0.02, 0.20, 0.13, 0.0),
            lip(0.12, 0.21, 0.10, 0.0),
            lip(0.26, 0.24, 0.07, 0.01),
            lip(0.36, 0.22, 0.055, 0.03),
            lip(0.42, 0.13, 0.03, 0.04),
        ],
        "beak",
    );
    for (columns, group) in [(9..11, "eye_l"), (5..7, "eye_r")] {
        let region = body.block(17..19, columns);
        body.eye(&region, 0.085, group);
    }
    finish(body.cage, levels, |p| {
        let turn = 0.05 * step(0.5, 1.3, p.y);
        let mouth = -0.04 * blob(p, [0.0, 0.885, 0.95], [0.26, 0.02, 0.25]);
        lopsided(p) + Vec3::new(turn * p.z, 0.0, mouth)
    })
}

/// A piggy bank: a barrel on four stubs, with snout, ears and eyes. `round` is its girth.
pub(super) fn pig(round: f64, levels: usize) -> (Cage, Vec<Vec3>) {
    let g = round;
    let ring = |z: f64, top: f64, wide: f64, bottom: f64| [top, z, -wide * g, 0.5 * (top + bottom), z, bottom, z, 0.95];
    let sections = [
        ring(-1.10, 0.26, 0.24, -0.16),
        ring(-1.00, 0.46, 0.45, -0.36),
        ring(-0.72, 0.64, 0.63, -0.53),
        ring(-0.35, 0.70, 0.70, -0.60),
        ring(0.05, 0.70, 0.70, -0.60),
        ring(0.42, 0.68, 0.66, -0.54),
        ring(0.72, 0.62, 0.56, -0.40),
        ring(0.96, 0.46, 0.42, -0.24),
        ring(1.10, 0.30, 0.29, -0.10),
        ring(1.22, 0.24, 0.235, -0.06),
        ring(1.36, 0.23, 0.23, -0.06),
    ];
    let mut body = Body::of(&sections, 21, [4, 4]);
    let snout = body.head.clone();
    body.cage.name(&(17 * COLUMNS..20 * COLUMNS).collect::<Vec<_>>(), "snout");
    body.cage.inset(
        &snout,
        &[(1.08, Vec3::new(0.0, 0.0, 0.03)), (0.86, Vec3::new(0.0, 0.0, 0.02)), (0.80, Vec3::new(0.0, 0.0, -0.015))],
        "snout",
    );
    let tail = body.tail.clone();
    let middle: Vec<Face> = vec![tail[5], tail[6], tail[9], tail[10]];
    let root = body.cage.centre(&body.cage.vertices(&middle));
    let curl: Vec<Hoop> = (0..8)
        .map(|k| {
            let s = f64::from(k) / 7.0;
            let a = 5.2 * s;
            let axis = Vec3::new(0.75 * a.cos(), 0.75 * a.sin(), -0.5).normalize();
            let u = (Vec3::y() - axis * axis.y).try_normalize(0.2).unwrap_or(Vec3::x());
            let r = 0.072 - 0.035 * s;
            Hoop {
                centre: root + Vec3::new(0.10 * a.sin(), 0.10 * (1.0 - a.cos()), -0.05 - 0.22 * s),
                u: u * r,
                v: axis.cross(&u) * r,
            }
        })
        .collect();
    body.cage.grow(&middle, &curl, "tail");
    pig_legs_and_ears(&mut body);
    for (columns, group) in [(12..14, "eye_l"), (2..4, "eye_r")] {
        let region = body.block(15..17, columns);
        body.eye(&region, 0.07, group);
    }
    finish(body.cage, levels, |p| {
        let nostril = -0.10 * blob(p, [0.085, 0.09, 1.42], [0.045, 0.065, 0.1])
            - 0.10 * blob(p, [-0.085, 0.09, 1.42], [0.045, 0.065, 0.1]);
        let smile = -0.05
            * (-((p.y + 0.20 - 0.5 * p.x * p.x) / 0.035).powi(2)).exp()
            * step(0.75, 0.95, p.z)
            * step(0.4, 0.25, p.x.abs());
        lopsided(p) + Vec3::new(0.0, 0.0, nostril + smile)
    })
}

fn pig_legs_and_ears(body: &mut Body) {
    for (side, columns, end) in [(1.0, 9..11, "l"), (-1.0, 5..7, "r")] {
        for (rows, place) in [(4..6, "hind"), (11..13, "fore")] {
            let region = body.block(rows, columns.clone());
            let centre = body.cage.centre(&body.cage.vertices(&region)) + Vec3::new(0.04 * side, 0.0, 0.0);
            let hoop =
                |y: f64, r: f64| Hoop { centre: Vec3::new(centre.x, y, centre.z), u: Vec3::x() * r, v: Vec3::z() * r };
            let hoops =
                [hoop(-0.66, 0.22), hoop(-0.78, 0.20), hoop(-0.95, 0.195), hoop(-1.0, 0.17), hoop(-1.005, 0.10)];
            body.cage.grow(&region, &hoops, &format!("leg_{place}_{end}"));
        }
    }
    for (side, columns, end) in [(1.0, 13..15, "l"), (-1.0, 1..3, "r")] {
        let region = body.block(12..14, columns);
        let out = Vec3::new(0.75 * side, 1.0, 0.25).normalize();
        body.fin(
            &region,
            out,
            Vec3::new(1.0, -0.6 * side, -0.2 * side),
            &[[0.0, 0.19, 0.08, 0.0], [0.13, 0.20, 0.06, 0.0], [0.27, 0.14, 0.045, 0.0], [0.36, 0.06, 0.03, 0.02]],
            &format!("ear_{end}"),
        );
    }
}

/// What keeps left and right from being the same.
fn lopsided(p: &Vec3) -> Vec3 {
    Vec3::new(0.018 * (1.6 * p.z + 0.4).sin() + 0.01 * p.y, 0.014 * (1.9 * p.x + 0.5).sin(), 0.0)
}
