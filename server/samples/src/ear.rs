//! A human ear: a disc, open where it grows from the head.

use super::brush::{bump, step};
use super::cage::Cage;
use super::limb::finish;
use quadmuse_kernel::mesh::Vec3;
use std::f64::consts::TAU;

const COLUMNS: usize = 20;

/// What tells one ear from another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ear {
    /// Width against height.
    pub(super) slim: f64,
    /// Length of the lobe.
    pub(super) lobe: f64,
    /// Thickness of the rolled rim.
    pub(super) helix: f64,
    /// Height of the inner fold.
    pub(super) fold: f64,
    /// How far the upper tip is drawn out.
    pub(super) point: f64,
}

/// One loop: radius, height over the head, and how much of its height follows the rolled rim, the inner fold and the
/// hollow.
const LOOPS: [[f64; 5]; 11] = [
    [0.66, -0.40, 0.0, 0.0, 0.0],
    [0.70, -0.22, 0.0, 0.0, 0.0],
    [0.86, -0.06, 0.0, 0.0, 0.0],
    [1.00, 0.02, 0.6, 0.0, 0.0],
    [1.02, 0.08, 1.0, 0.0, 0.0],
    [0.96, 0.10, 1.1, 0.0, 0.0],
    [0.88, 0.04, 0.5, 0.0, 0.0],
    [0.79, 0.00, -0.2, 0.25, 0.0],
    [0.66, 0.00, 0.0, 1.0, 0.0],
    [0.52, -0.02, 0.0, 0.55, -0.5],
    [0.40, -0.04, 0.0, 0.0, -1.0],
];

impl Ear {
    /// The outline at angle `a`: x points to the back of the head, y up.
    fn outline(&self, a: f64) -> [f64; 2] {
        let (s, c) = a.sin_cos();
        let up = step(-0.6, 0.8, s);
        let wide = self.slim * (0.40 + 0.28 * up) * (1.0 - 0.16 * step(0.1, -1.0, c) * (1.0 - up));
        let low = 1.0 + 0.16 * self.lobe * step(-0.5, -1.0, s);
        [
            wide * c + 0.10 * s.max(0.0) + 0.30 * self.point * step(0.5, 1.0, s),
            (s * low) + 0.45 * self.point * step(0.55, 1.0, s),
        ]
    }

    fn point_at(&self, a: f64, [radius, height, rim, fold, hollow]: [f64; 5]) -> Vec3 {
        let [x, y] = self.outline(a);
        let (s, c) = a.sin_cos();
        // The rim is rolled from the front over the top and the back, and fades into the lobe.
        let rolled = self.helix * step(-0.85, -0.35, s) * (0.45 + 0.55 * step(-1.0, -0.4, c));
        let folded = self.fold * step(-0.75, 0.15, c) * step(-1.0, -0.55, s) * (1.0 - 0.35 * step(0.75, 1.0, s));
        let centre = [-0.08 * (1.0 - radius), -0.16 * (1.0 - radius)];
        let z = height + 0.15 * rim * rolled + 0.20 * fold * folded + 0.22 * hollow + 0.16 * x * radius;
        Vec3::new(centre[0] + x * radius, centre[1] + y * radius, z)
    }

    /// The finished ear after `levels` subdivisions; the head would be behind it (−z).
    pub(super) fn build(&self, levels: usize) -> (Cage, Vec<Vec3>) {
        let angle = |c: usize| TAU * (c as f64 + 0.5) / COLUMNS as f64;
        let mut cage = Cage::tube(LOOPS.len(), COLUMNS, "helix", |r, c| self.point_at(angle(c), LOOPS[r]));
        let row = |r: usize| (r * COLUMNS..(r + 1) * COLUMNS).collect::<Vec<_>>();
        (0..3).for_each(|r| cage.name(&row(r), "root"));
        (6..10).for_each(|r| cage.name(&row(r), "fold"));
        for r in 2..7 {
            cage.name(&[r * COLUMNS + 13, r * COLUMNS + 14, r * COLUMNS + 15], "lobe");
        }
        // The cap's corners lie on the diagonals.
        let rim: Vec<u32> = (0..COLUMNS).map(|c| ((LOOPS.len() - 1) * COLUMNS + (c + 12) % COLUMNS) as u32).collect();
        cage.cap(&rim, 5, "concha");
        finish(cage, levels, |p| {
            let tragus = 0.20 * bump([p.x + 0.30, p.y + 0.16], [0.10, 0.13]);
            let antitragus = 0.13 * bump([p.x - 0.02, p.y + 0.50], [0.12, 0.08]);
            let crus = 0.13 * bump([p.x + 0.16, p.y - 0.02 - 0.25 * (p.x + 0.2)], [0.20, 0.06]);
            let canal = -0.17 * bump([p.x + 0.13, p.y + 0.20], [0.11, 0.12]);
            let fossa = -0.05 * bump([p.x - 0.10, p.y - 0.50], [0.14, 0.12]);
            let front = step(-0.2, -0.02, p.z + 0.1);
            Vec3::new(0.35 * tragus, 0.0, front * (tragus + antitragus + crus + canal + fossa))
        })
    }
}
