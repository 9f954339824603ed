//! The cap of a chart: what lies about its upper pole, registered alone.
//!
//! In a chart of the whole surface a foot is a few rows, and what the other limbs show, pressed into specks, outweighs
//! it: the foot stays turned about its leg. So v ≥ 1 − a is drawn as a picture of its own, with rows
//!
//! ```text
//! w = 1 − (1 − v)/a
//! ```
//!
//! whose mean λ is 1 too where v is a share of the area (triangles that were laid anew apart). A small cap is laid on
//! one of area a·s by every turn and some scales s, and then caps twice as high start from what the smaller one found.
//! *Ours, not the paper's.*

use std::f64::consts::TAU;

use crate::encode::features::distance;
use crate::encode::raster::{Footprint, picture, shapes};
use crate::encode::{Encoding, LEVEL_SIDES, from_finest};
use crate::map::edit::{self, EditError};
use crate::register::image::Image;
use crate::register::{Level, Registration, Solver, query_images, translation_energies};
use crate::topology::Topology;
use crate::unfold::{Chart, Uv, signed_area};

/// Finest level of a cap's picture, and the level to which scales are compared.
const SIDE: usize = 128;
const TRIAL_SIDE: usize = 64;
/// How many caps there are, each twice as high as the one before.
const CAPS: i32 = 4;
/// A cap's room is the area up to the nearest other tip, and no more than this share of the whole.
const SHARE_MAX: f64 = 0.4;
/// The last cap takes so much of the room.
const REACH: f64 = 0.8;
/// Less room than this, as a share of the area, is none.
const ROOM_MIN: f64 = 1e-6;
/// Area of the input's cap in that of the example's: of the first cap, and of each further one in that of the one before.
const SCALES: [f64; 9] = [0.6, 0.7, 0.8, 0.9, 1.0, 1.12, 1.25, 1.45, 1.7];
const SCALES_NEXT: [f64; 5] = [0.8, 0.9, 1.0, 1.12, 1.25];
/// What a turn away from the whole chart's registration costs, in E a squared period: a plain tip keeps its turn.
const TURN: f64 = 0.3;
/// Up to this w the cap's map fades into the chart's.
const FADE: f64 = 0.35;
/// Controls nearer than three pixels of the coarsest picture are one.
const APART: f64 = 3.0 / LEVEL_SIDES[0] as f64;
/// Columns at which the two maps are compared.
const COLUMNS: usize = 16;

/// The map of one chart onto another: its registration, and near the upper pole that of the caps.
#[derive(Clone, Debug)]
pub(super) struct Course {
    pub(super) registration: Registration,
    cap: Option<Cap>,
}

/// A registration of two caps.
#[derive(Clone, Debug)]
struct Cap {
    /// Share of the example's area, and of the input's.
    shares: [f64; 2],
    registration: Registration,
    /// Whole periods by which the cap's u lies beside the chart's.
    periods: f64,
}

impl Course {
    /// The map of a whole chart, and of the caps of `example` and `input` where there is room for them; `others` are the
    /// matched tips in the two charts, those at poles left out.
    pub(super) fn new(
        registration: Registration,
        [example, input]: [&Chart; 2],
        others: &[(Uv, Uv)],
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Self {
        let room = |of: fn(&(Uv, Uv)) -> Uv| others.iter().map(|pair| 1.0 - of(pair)[1]).fold(SHARE_MAX, f64::min);
        let rooms = [room(|pair| pair.0), room(|pair| pair.1)];
        let mut course = Self { registration, cap: None };
        if rooms.iter().all(|&room| room > ROOM_MIN) {
            let shapes = [above_all(example, REACH * rooms[0]), above_all(input, rooms[1])];
            let (whole, topology) = (&course.registration, example.topology);
            course.cap = CapGrowth { whole, topology, shapes, rooms, solver, stop }.cap();
        }
        course
    }

    /// The image of a point of the example.
    pub(super) fn map(&self, topology: Topology, x: Uv) -> Uv {
        let whole = self.registration.map(topology, x);
        let Some(cap) = &self.cap else { return whole };
        let w = height(x[1], cap.shares[0]);
        if w <= 0.0 {
            return whole;
        }
        let t = (w / FADE).min(1.0);
        let t = t * t * (3.0 - 2.0 * t);
        let [u, up] = cap.registration.map(Topology::Disc, [x[0], w]);
        let own = [u - cap.periods, lifted(up, cap.shares[1])];
        [0, 1].map(|k| whole[k] + t * (own[k] - whole[k]))
    }

    /// Adds a constraint: `p` on the example goes to `q` on the input. A cap in which only one of them lies is given up.
    ///
    /// # Errors
    /// [`EditError`].
    pub(super) fn constrain(&mut self, topology: Topology, p: Uv, q: Uv) -> Result<(), EditError> {
        edit::set(&mut self.registration, topology, None, p, q)?;
        let Some(cap) = &mut self.cap else { return Ok(()) };
        let heights = [height(p[1], cap.shares[0]), height(q[1], cap.shares[1])];
        match heights.map(|w| w > 0.0) {
            [true, true] => {
                edit::set(&mut cap.registration, Topology::Disc, None, [p[0], heights[0]], [q[0], heights[1]])?;
            }
            [false, false] => {}
            _ => self.cap = None,
        }
        Ok(())
    }

    /// Refuses a map that folds.
    ///
    /// # Errors
    /// [`EditError::Folds`].
    pub(super) fn check_folds(&self, topology: Topology) -> Result<(), EditError> {
        edit::check_folds(&self.registration, topology)?;
        self.cap.as_ref().map_or(Ok(()), |cap| edit::check_folds(&cap.registration, Topology::Disc))
    }
}

/// w of a point at v in the cap of share `a`; below 0 outside.
fn height(v: f64, a: f64) -> f64 {
    1.0 - (1.0 - v) / a
}

/// v of a point at w in the cap of share `a`.
fn lifted(w: f64, a: f64) -> f64 {
    1.0 - (1.0 - w) * a
}

/// Holds what is needed to grow caps.
struct CapGrowth<'a> {
    whole: &'a Registration,
    topology: Topology,
    /// What lies in the highest caps there can be, on either surface, and its shares of the area.
    shapes: [Vec<(Footprint, f64)>; 2],
    /// Share of the area below the nearest other tip, on either surface.
    rooms: [f64; 2],
    solver: &'a dyn Solver,
    stop: &'a dyn Fn() -> bool,
}

impl CapGrowth<'_> {
    /// The highest cap; `None` where one on the way to it finds no room on the input, or folds: they would not hold.
    fn cap(&self) -> Option<Cap> {
        let mut found: Option<Cap> = None;
        for k in (0..CAPS).rev() {
            let cap = self.next(found.as_ref(), REACH * self.rooms[0] * 0.5f64.powi(k))?;
            if cap.registration.folds > 0 {
                return None;
            }
            found = Some(cap);
        }
        let mut cap = found?;
        let apart = |x: Uv| {
            let w = height(x[1], cap.shares[0]);
            cap.registration.map(Topology::Disc, [x[0], w])[0] - self.whole.map(self.topology, x)[0]
        };
        let line = ring(lifted(FADE / 2.0, cap.shares[0]));
        cap.periods = (line.map(apart).sum::<f64>() / COLUMNS as f64).round();
        Some(cap)
    }

    /// The cap of share `share` by the scale that fits it best, from a lower one or by the best turn.
    fn next(&self, lower: Option<&Cap>, share: f64) -> Option<Cap> {
        let example = zoomed(&self.shapes[0], share);
        let (scales, before) = match lower {
            None => (&SCALES[..], 1.0),
            Some(cap) => (&SCALES_NEXT[..], cap.shares[1] / cap.shares[0]),
        };
        let mut best: Option<(Registration, Encoding, f64)> = None;
        for to in scales.iter().map(|scale| scale * before * share).filter(|&to| to <= self.rooms[1]) {
            if (self.stop)() {
                return None;
            }
            let input = zoomed(&self.shapes[1], to);
            let images = query_images(&input, TRIAL_SIDE);
            let mut trial = match lower {
                None => self.turned(share, &example, images.first()?),
                Some(cap) => carried(cap, [share, to]),
            };
            self.solve(&mut trial, &example, &images)?;
            if best.as_ref().is_none_or(|(least, ..)| trial.energy < least.energy) {
                best = Some((trial, input, to));
            }
        }
        let (mut registration, input, to) = best?;
        let images = query_images(&input, SIDE);
        self.solve(&mut registration, &example, images.get(images.len() - 1..)?)?;
        Some(Cap { shares: [share, to], registration, periods: 0.0 })
    }

    fn solve(&self, registration: &mut Registration, example: &Encoding, images: &[Image]) -> Option<()> {
        for image in images {
            let level = Level::new(example, image)?;
            if registration.side == 0 {
                registration.solve_level(&level, self.solver, self.stop);
            } else {
                registration.advance(&level, self.solver, self.stop);
            }
        }
        Some(())
    }

    /// The first cap, turned as fits it best, but not far from where the whole chart's registration turns its middle.
    fn turned(&self, share: f64, example: &Encoding, query: &Image) -> Registration {
        let flip = self.whole.flip;
        let own = example.pyramid.first().map(|picture| Image::new(picture, flip, false));
        let energies = own.map_or(vec![0.0], |own| translation_energies(&own, query));
        let turn = |x: Uv| (TAU * (self.whole.map(self.topology, x)[0] - flip.apply(x)[0])).sin_cos();
        let sums = ring(lifted(0.5, share)).map(turn).fold((0.0, 0.0), |s, t| (s.0 + t.0, s.1 + t.1));
        let before = sums.0.atan2(sums.1) / TAU;
        let cost = |t: usize| {
            let d = t as f64 / query.side as f64 - before;
            energies[t] + TURN * (d - d.round()).powi(2)
        };
        let best = (0..energies.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(0);
        let features = example.features.iter().filter(|f| f.side <= query.side);
        let mut p: Vec<Uv> = features.map(|f| flip.apply(f.uv)).collect();
        if p.is_empty() {
            p.push([0.5, 0.5]);
        }
        let q = p.iter().map(|p| [p[0] + best as f64 / query.side as f64, p[1]]).collect();
        Registration::from_controls(flip, p, q)
    }
}

/// Points around at height v.
fn ring(v: f64) -> impl Iterator<Item = Uv> {
    (0..COLUMNS).map(move |k| [(k as f64 + 0.5) / COLUMNS as f64, v])
}

/// A cap's controls in caps of other shares.
fn carried(cap: &Cap, shares: [f64; 2]) -> Registration {
    let old = &cap.registration;
    let in_new = |x: &Uv, k: usize| [x[0], height(lifted(x[1], cap.shares[k]), shares[k])];
    let (mut p, mut q): (Vec<Uv>, Vec<Uv>) = (Vec::new(), Vec::new());
    for (from, to) in old.p.iter().zip(&old.q) {
        let at = in_new(from, 0);
        if p.iter().all(|other| distance(*other, at) >= APART) {
            p.push(at);
            q.push(in_new(to, 1));
        }
    }
    Registration::from_controls(old.flip, p, q)
}

/// A chart's shapes of which something lies above v = 1 − `share`, with their shares of the area.
fn above_all(chart: &Chart, share: f64) -> Vec<(Footprint, f64)> {
    let is_above = |(shape, _): &(Footprint, f64)| corners(shape).iter().any(|x| height(x[1], share) > 0.0);
    shapes(chart).filter(is_above).collect()
}

fn corners(shape: &Footprint) -> &[Uv] {
    match shape {
        Footprint::Triangle(corners) => corners,
        Footprint::Pole(corners) => corners,
    }
}

/// The encoding of what of some shapes lies above v = 1 − `share`.
fn zoomed(shapes: &[(Footprint, f64)], share: f64) -> Encoding {
    let mut triangles = Vec::with_capacity(shapes.len());
    let mut scratch = [Vec::with_capacity(5), Vec::with_capacity(5)];
    for (shape, area) in shapes {
        clip(corners(shape), share, &mut scratch);
        let [polygon, kept] = &scratch;
        let whole: f64 = fan(polygon).map(|triangle| signed_area(&triangle).abs()).sum();
        let density = if whole > 0.0 { area / share / whole } else { 0.0 };
        triangles.extend(fan(kept).map(|t| (Footprint::Triangle(t), density * signed_area(&t).abs())));
    }
    from_finest(picture(Topology::Disc, SIDE, triangles.into_iter()), Topology::Disc, 1.0)
}

/// A convex polygon in the cap's rows, and what of it lies at w ≥ 0.
fn clip(corners: &[Uv], share: f64, [polygon, kept]: &mut [Vec<Uv>; 2]) {
    polygon.clear();
    kept.clear();
    polygon.extend(corners.iter().map(|&[u, v]| [u, height(v, share)]));
    for (k, &a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        if a[1] >= 0.0 {
            kept.push(a);
        }
        if (a[1] < 0.0) != (b[1] < 0.0) {
            kept.push([a[0] + a[1] / (a[1] - b[1]) * (b[0] - a[0]), 0.0]);
        }
    }
}

/// A convex polygon as triangles.
fn fan(polygon: &[Uv]) -> impl Iterator<Item = [Uv; 3]> + '_ {
    polygon.windows(2).skip(1).map(|next| [polygon[0], next[0], next[1]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::index::PlanarIndex;
    use crate::mesh::Vec3;
    use crate::register::{Flip, LevenbergMarquardt};
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    const SIDE_CELLS: u32 = 96;

    /// A hill on a sheet with knobs about its top, the whole of which is turned by `turn` periods; its chart about the top.
    fn hill(turn: f64) -> Chart {
        let mut mesh = grid(SIDE_CELLS, SIDE_CELLS, false, false);
        for p in &mut mesh.positions {
            let (x, y) = (p.x - 0.5, p.y - 0.5);
            let knob = |at: f64, r: f64, size: f64| {
                let (sin, cos) = (TAU * at).sin_cos();
                (-((x - r * cos).powi(2) + (y - r * sin).powi(2)) / (size * size)).exp()
            };
            let top = 0.35 * knob(turn, 0.09, 0.025) + 0.25 * knob(turn + 0.3, 0.08, 0.02);
            let foot = 0.3 * knob(0.1, 0.4, 0.05) + 0.2 * knob(0.45, 0.4, 0.05) + 0.25 * knob(0.75, 0.4, 0.04);
            p.z = 0.8 * (-(x * x + y * y) / 0.02).exp() + top + foot;
        }
        let middle = SIDE_CELLS / 2 * (SIDE_CELLS + 1) + SIDE_CELLS / 2;
        let options = UnfoldOptions { poles: vec![middle] };
        unfold(&whole(&mesh).expect("a disc"), &options).expect("solvable")
    }

    /// Where a knob lies in a chart.
    fn knob(chart: &Chart, at: f64, r: f64) -> Uv {
        let (sin, cos) = (TAU * at).sin_cos();
        let place = Vec3::new(0.5 + r * cos, 0.5 + r * sin, 0.0).xy();
        let off = |v: &usize| (chart.mesh.positions[*v].xy() - place).norm();
        let vertex = (0..chart.mesh.positions.len()).min_by(|a, b| off(a).total_cmp(&off(b))).expect("vertices");
        chart.uv[vertex]
    }

    /// The map that holds at the hills' feet.
    fn by_feet(example: &Chart, input: &Chart) -> Registration {
        let mut feet = [0.1, 0.45, 0.75].map(|at| (knob(example, at, 0.4), knob(input, at, 0.4)));
        super::super::unwrap_shifts(&mut feet);
        let (p, q) = feet.into_iter().unzip();
        Registration::from_controls(Flip::default(), p, q)
    }

    #[test]
    fn a_top_that_is_turned_is_found_turned() {
        let (example, input) = (hill(0.2), hill(0.34));
        let solver = LevenbergMarquardt::default();
        let foot = (knob(&example, 0.1, 0.4), knob(&input, 0.1, 0.4));
        let whole = by_feet(&example, &input);
        let course = Course::new(whole.clone(), [&example, &input], &[foot], &solver, &|| false);
        let expected = knob(&input, 0.34, 0.09);
        let off = |image: Uv| {
            let du = image[0] - expected[0];
            (du - du.round()).abs().max((image[1] - expected[1]).abs())
        };
        let top = knob(&example, 0.2, 0.09);
        assert!(off(whole.map(Topology::Disc, top)) > 0.1);
        assert!(off(course.map(Topology::Disc, top)) < 0.02, "{}", off(course.map(Topology::Disc, top)));
        let below = [0.3, 0.1];
        assert_eq!(course.map(Topology::Disc, below), whole.map(Topology::Disc, below));
    }

    #[test]
    fn the_mean_of_lambda_is_one_in_a_cap() {
        let mut mesh = grid(60, 60, false, false);
        mesh.positions
            .iter_mut()
            .for_each(|p| p.z = 0.4 * (-(p.xy() - Vec3::new(0.5, 0.5, 0.0).xy()).norm_squared() / 0.03).exp());
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        for share in [0.4, 0.1] {
            let mean = zoomed(&above_all(&chart, share), share).pyramid[0].mean();
            assert!((mean - 1.0).abs() < 0.02, "{share}: {mean}");
        }
    }

    #[test]
    fn a_constraint_holds_in_the_cap_and_across_its_edge() {
        let (example, input) = (hill(0.2), hill(0.2));
        let index = PlanarIndex::new(&input);
        let solver = LevenbergMarquardt::default();
        let course = Course::new(by_feet(&example, &input), [&example, &input], &[], &solver, &|| false);
        assert!(course.cap.is_some());
        for v in [0.97, 0.7, 0.595, 0.3] {
            let mut moved = course.clone();
            let (p, q) = ([0.4, v], [0.42, v + 0.01]);
            moved.constrain(Topology::Disc, p, q).expect("room");
            assert!(moved.check_folds(Topology::Disc).is_ok());
            let [at, there] = [moved.map(Topology::Disc, p), q].map(|x| index.locate(&input, x).point(&input));
            assert!((at - there).norm() < 1e-6, "{v}: {at} {there}");
        }
    }
}
