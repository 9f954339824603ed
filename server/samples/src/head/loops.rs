//! Rings of quads laid around a feature of the face.

use super::super::cage::{Cage, Face};
use super::peg::Peg;
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::TAU;

/// A closed curve in the front view: half widths to either side and half heights up and down around a centre.
#[derive(Clone, Copy, Debug)]
pub(super) struct Oval {
    /// x and y of the centre.
    pub(super) centre: [f64; 2],
    /// Half width.
    pub(super) wide: f64,
    /// Half height above the centre.
    pub(super) up: f64,
    /// Half height below the centre.
    pub(super) down: f64,
    /// Exponent of the height along the curve: 1 an ellipse, above pointed corners (an almond).
    pub(super) almond: f64,
}

impl Oval {
    /// The same curve grown by these factors in width and height, a little rounder the larger.
    pub(super) fn grown(self, wide: f64, high: f64) -> Self {
        let almond = 1.0 + (self.almond - 1.0) / wide.max(high).max(1.0).powi(3);
        Self { wide: self.wide * wide, up: self.up * high, down: self.down * high, almond, ..self }
    }

    /// The point at angle `angle` (radians, counter-clockwise in the front view).
    pub(super) fn at(&self, angle: f64) -> [f64; 2] {
        let (s, c) = angle.sin_cos();
        let high = if s >= 0.0 { self.up } else { self.down };
        [self.centre[0] + self.wide * c, self.centre[1] + high * s.signum() * s.abs().powf(self.almond)]
    }

    /// 1 on the curve, 0 at its centre, growing outwards: the factor that grows the curve to the point.
    pub(super) fn radius(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = ((x - self.centre[0]) / self.wide, y - self.centre[1]);
        let dy = dy / if dy >= 0.0 { self.up } else { self.down };
        // An almond's outline: |dy| = (1 − dx²)^(almond / 2); inside the bend is scaled with the width left.
        let p = 2.0 / self.almond;
        (dx * dx + dy.abs().powf(p)).sqrt()
    }
}

/// The plane that ovals are drawn in.
#[derive(Clone, Copy)]
pub(super) enum Sheet<'a> {
    /// The front view: x and y of the skull.
    Front(&'a Peg),
    /// Azimuth (radians) and height on the peg, for what lies across a snout.
    Chart(&'a Peg),
}

impl Sheet<'_> {
    fn see(&self, base: &Vec3) -> [f64; 2] {
        match self {
            Self::Front(peg) => {
                let [a, t] = peg.chart(base);
                let p = peg.skull(a, t);
                [p.x, p.y]
            }
            Self::Chart(peg) => peg.chart(base),
        }
    }

    fn find(&self, [x, y]: [f64; 2]) -> Vec3 {
        match self {
            Self::Front(peg) => peg.find(x, y),
            Self::Chart(peg) => peg.base(x, y),
        }
    }
}

/// A region of the face that becomes rings around a feature.
pub(super) struct Feature {
    /// The faces inside the innermost ring so far.
    pub(super) region: Vec<Face>,
    /// Vertices that stay where they were put.
    pub(super) pinned: Vec<u32>,
    /// Angle of each vertex of the current loop.
    angles: Vec<f64>,
}

impl Feature {
    /// Lays the region's outline on `oval`: the corner nearest to angle 0 first, then evenly.
    pub(super) fn on(cage: &mut Cage, sheet: Sheet, region: Vec<Face>, oval: &Oval) -> Self {
        let rim = cage.outline(&region);
        let seen = |v: u32| {
            let [x, y] = sheet.see(&cage.bases[v as usize]);
            (y - oval.centre[1]).atan2(x - oval.centre[0]).rem_euclid(TAU)
        };
        let n = rim.len() as f64;
        // The mean turn between the seen angles and even ones, as a unit vector lest angles wrap.
        let (mut s, mut c) = (0.0, 0.0);
        for (k, &v) in rim.iter().enumerate() {
            let off = seen(v) - TAU * k as f64 / n;
            (s, c) = (s + off.sin(), c + off.cos());
        }
        let start = (s.atan2(c) * n / TAU).round() * TAU / n;
        let angles: Vec<f64> = (0..rim.len()).map(|k| start + TAU * k as f64 / n).collect();
        let mut feature = Self { region, pinned: Vec::new(), angles };
        feature.lay(cage, sheet, &rim, oval);
        feature
    }

    /// Adds a ring whose inner loop lies on `oval`; returns its faces.
    pub(super) fn ring(&mut self, cage: &mut Cage, sheet: Sheet, oval: &Oval, group: &str) -> Vec<Face> {
        let outline = cage.outline(&self.region);
        let ring = cage.extrude(&self.region, group);
        debug_assert_eq!(outline.len(), ring.inner.len());
        self.lay(cage, sheet, &ring.inner, oval);
        ring.faces
    }

    fn lay(&mut self, cage: &mut Cage, sheet: Sheet, rim: &[u32], oval: &Oval) {
        for (&v, &angle) in rim.iter().zip(&self.angles) {
            cage.bases[v as usize] = sheet.find(oval.at(angle));
        }
        self.pinned.extend(rim);
    }

    /// Places the region's inner vertices: `place` maps the sheet.
    pub(super) fn inside(&mut self, cage: &mut Cage, sheet: Sheet, place: impl Fn([f64; 2]) -> [f64; 2]) {
        let rim = cage.outline(&self.region);
        let inner: Vec<u32> = cage.vertices(&self.region).into_iter().filter(|v| !rim.contains(v)).collect();
        for &v in &inner {
            cage.bases[v as usize] = sheet.find(place(sheet.see(&cage.bases[v as usize])));
        }
        self.pinned.extend(inner);
    }
}

/// Evens out the vertices that are not pinned, on the peg.
pub(super) fn relax(cage: &mut Cage, peg: &Peg, pinned: &[u32], rounds: usize) {
    let n = cage.bases.len();
    let mut fixed = vec![false; n];
    pinned.iter().for_each(|&v| fixed[v as usize] = true);
    for _ in 0..rounds {
        let mut sums = vec![(Vec3::zeros(), 0.0f64); n];
        let mut uses: Vec<usize> = vec![0; n];
        for q in &cage.quads {
            for k in 0..4 {
                let (a, b) = (q[k] as usize, q[(k + 1) % 4] as usize);
                sums[a] = (sums[a].0 + cage.bases[b], sums[a].1 + 1.0);
                sums[b] = (sums[b].0 + cage.bases[a], sums[b].1 + 1.0);
                uses[a] += 1;
            }
        }
        for v in 0..n {
            // A boundary vertex has more edge ends than twice its faces.
            let inner = (sums[v].1 - 2.0 * uses[v] as f64).abs() < 0.5 && sums[v].1 > 4.5;
            if !fixed[v] && inner && cage.bases[v].y > 0.01 {
                let even = sums[v].0 / sums[v].1;
                let [a, t] = peg.chart(&(cage.bases[v] * 0.65 + even * 0.35));
                cage.bases[v] = peg.base(a, t);
            }
        }
    }
}
