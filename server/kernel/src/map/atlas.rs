//! Surfaces with protrusions: one chart for each, matched tip to tip and blended.
//!
//! In a chart with its pole elsewhere a finger is smaller than a pixel; in the chart with its pole at the finger's tip
//! it fills the top rows. Tips are found on both surfaces, matched by registering charts with poles at pairs of them,
//! and then each matched tip gets a chart of its own, in which the other tips are controls. A vertex goes where the
//! charts send it, weighted by how little each compresses it there.
//! *Source:* paper §7 ("introduce extra singularities … one pole per disc segment"); blending after Kim, Lipman,
//! Funkhouser, *Blended Intrinsic Maps* (2011). *Ours:* poles at matched tips, area-fraction coordinates.

mod assignment;
mod cap;
mod limbs;
mod matching;

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use cap::Course;
pub use limbs::LimbDistances;
use matching::{Match, Matcher, WhichSurface, tip_controls};

use super::edit::EditError;
use super::reembed::{EqualAreaDisc, InputChart};
use super::{CrossMap, turns_over, vertex_uv};
use crate::encode::index::{Location, PlanarIndex};
use crate::encode::{Encoding, encode_to};
use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::{in_halves, many_in_halves, side_by_side};
use crate::register::entry::PROTRUSIONS_MANY;
use crate::register::{Flip, Level, Query, Registration, Solver, coarse_flip, query_images};
use crate::topology::Topology;
use crate::unfold::pole::Breadth;
use crate::unfold::{Chart, UnfoldError, Uv};

/// Level to which charts are registered.
const CHART_SIDE: usize = 128;
/// Tips that make an atlas worth its charts: with one or two, two poles do.
const TIPS_MIN: usize = PROTRUSIONS_MANY;
/// A match that costs more is none.
const MATCH_COST_MAX: f64 = 1.5;
/// A match of more tips is taken if it costs no more than this factor of one of fewer.
const FINER_WITHIN: f64 = 1.02;
/// How fast a chart's say falls with its compression.
const BLEND_POWER: f64 = 2.0;

/// A chart of one of the surfaces, with its encoding.
#[derive(Debug)]
struct EncodedChart {
    chart: Arc<Chart>,
    encoding: Encoding,
}

impl EncodedChart {
    /// Where a tip lies; `None` for one that is a pole.
    fn place(&self, tip: u32) -> Option<Uv> {
        let is_free = self.chart.poles.iter().all(|pole| pole.vertex != tip);
        is_free.then(|| self.chart.uv[tip as usize])
    }
}

/// One pair of charts with their registration.
#[derive(Debug)]
struct Sheet {
    example: Arc<Chart>,
    input: Arc<Chart>,
    /// The planar index of `input`.
    index: PlanarIndex,
    course: Course,
}

/// A map made of several charts.
#[derive(Debug)]
pub struct Atlas {
    sheets: Vec<Sheet>,
    /// The map without constraints, made once.
    unconstrained: OnceLock<CrossMap>,
    /// Matched tips: (vertex of the example's mesh, vertex of the input's).
    pub matches: Vec<(u32, u32)>,
    /// Whether the map mirrors.
    pub mirrored: bool,
    /// E / variance of the tips' match, at its level.
    pub cost: f64,
}

/// Tips of two surfaces that match.
#[derive(Clone, Debug, PartialEq)]
pub struct TipMatch {
    /// (Vertex of the example's mesh, vertex of the query's).
    pub pairs: Vec<(u32, u32)>,
    /// True where the match mirrors.
    pub mirrored: bool,
}

/// Ways to match the tips of two surfaces, at most `most` unmirrored and as many mirrored, best first. Empty where either has
/// fewer than three, or they are no discs or spheres.
pub fn likely_matches(
    example: &Query,
    query: &Query,
    solver: &dyn Solver,
    most: usize,
    stop: &(dyn Fn() -> bool + Sync),
) -> Vec<TipMatch> {
    let sides = [example, query];
    let topology = example.encoding().topology;
    if !matches!(topology, Topology::Disc | Topology::Sphere) || topology != query.encoding().topology {
        return Vec::new();
    }
    let mut found: Vec<(f64, bool, Vec<(u32, u32)>)> = Vec::new();
    for breadth in [Breadth::Limbs, Breadth::Fingers] {
        if stop() || sides.iter().any(|side| side.tips(breadth).len() < TIPS_MIN) {
            continue;
        }
        let matcher = Matcher::new(example, query, breadth, solver, stop);
        let likely = matcher.likely().into_iter();
        let many = likely.filter(|m| m.assignment.pairs.len() >= TIPS_MIN);
        found.extend(many.map(|m| (m.cost, m.flip.is_mirror(), matcher.vertices(&m.assignment.pairs))));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut matches: Vec<TipMatch> = Vec::new();
    let mut left = [most; 2];
    for (_, mirrored, pairs) in found {
        let left = &mut left[usize::from(mirrored)];
        if *left > 0 && !matches.iter().any(|known| known.pairs == pairs) {
            matches.push(TipMatch { pairs, mirrored });
            *left -= 1;
        }
    }
    matches
}

impl Atlas {
    /// Matches two surfaces by their tips; `None` where either has fewer than three, or
    /// they are no discs or spheres, or the match is too poor to be one.
    ///
    /// # Errors
    /// [`UnfoldError`] when a chart cannot be made.
    pub fn build(
        example: &Query,
        query: &Query,
        solver: &dyn Solver,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, UnfoldError> {
        let Some((matcher, found)) = matched(example, query, solver, stop) else { return Ok(None) };
        let matches = matcher.vertices(&found.assignment.pairs);
        let flip = found.flip;
        let poles_at = |k: usize| {
            [WhichSurface::Example, WhichSurface::Query]
                .map(|which| matcher.poles_at(&found.assignment.pairs, k, which))
        };
        let poles: Vec<[Vec<u32>; 2]> = (0..matches.len()).map(poles_at).collect();
        let sheet = |k: usize| {
            let (one, two) = (side_at(example, &poles[k][0])?, side_at(query, &poles[k][1])?);
            Ok(Sheet::new(one, two, &matches, flip, solver, stop))
        };
        let some = |range: Range<usize>| -> Result<Vec<Sheet>, UnfoldError> {
            range.take_while(|_| !stop()).map(sheet).collect()
        };
        let (half, all) = (matches.len() / 2, matches.len());
        let (first, second) = side_by_side(|| some(0..half), || some(half..all));
        let mut sheets = first?;
        sheets.extend(second?);
        if stop() {
            return Ok(None);
        }
        Ok(Some(Self {
            sheets,
            unconstrained: OnceLock::new(),
            matches,
            mirrored: found.flip.is_mirror(),
            cost: found.cost,
        }))
    }

    /// Maps the vertices of the example's patch onto the mesh of the input's charts. Each of `constraints`, a place on
    /// the example's charts and one on the input's, holds in every chart.
    ///
    /// # Errors
    /// [`EditError::Folds`] when the constraints fold a chart.
    pub fn cross_map(&self, constraints: &[(Location, Location)]) -> Result<CrossMap, EditError> {
        if !constraints.is_empty() {
            return self.constrained(constraints);
        }
        if self.unconstrained.get().is_none() {
            let _ = self.unconstrained.set(self.constrained(&[])?);
        }
        Ok(self.unconstrained.get().cloned().unwrap_or_default())
    }

    fn constrained(&self, constraints: &[(Location, Location)]) -> Result<CrossMap, EditError> {
        let Some(first) = self.sheets.first() else { return Ok(CrossMap::default()) };
        let (n, input) = (first.example.patch_vertices, &first.input);
        let laid = in_halves(&self.sheets, |sheet| SheetMap::new(sheet, constraints, n));
        let laid: Vec<SheetMap> = laid.into_iter().collect::<Result<_, EditError>>()?;
        let on_boundary = first.example.mesh.boundary_vertices();
        let rim = InputBoundary::new(&input.mesh);
        let vertices: Vec<usize> = (0..n).collect();
        let locations = many_in_halves(&vertices, |&v| {
            let place = blended(&laid, v);
            if on_boundary[v] { rim.closest(&input.mesh, place.point(input)) } else { place }
        });
        let positions = locations.iter().map(|l| l.point(input)).collect();
        Ok(CrossMap { locations, positions })
    }

    /// Polygons that the map turns over in the domain, each looked at in the chart that has most say on it; in order.
    /// `mesh` is the example's patch.
    pub fn folded_faces(&self, mesh: &TriMesh) -> Vec<u32> {
        let compressions: Vec<Vec<f64>> = self.sheets.iter().map(|s| compression(&s.example)).collect();
        let mut folded = Vec::new();
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let pressed = |k: &usize| corners.iter().map(|&v| compressions[*k][v as usize]).sum::<f64>();
            let sheet = (0..self.sheets.len()).min_by(|a, b| pressed(a).total_cmp(&pressed(b)));
            let Some(sheet) = sheet.and_then(|k| self.sheets.get(k)) else { continue };
            let (course, chart) = (&sheet.course, &sheet.example);
            let image = |v: u32| course.map(chart.topology, chart.uv[v as usize]);
            if turns_over(course.registration.flip, chart, image, corners) {
                folded.push(mesh.polygon_of[t]);
            }
        }
        folded.sort_unstable();
        folded.dedup();
        folded
    }

    /// The input's charts, for [`settle`](super::reembed::settle).
    pub fn grounds(&self) -> Vec<InputChart<'_>> {
        self.sheets.iter().map(|s| InputChart { chart: &s.input, index: &s.index }).collect()
    }

    /// Mean of the charts' E / variance.
    pub fn mean_cost(&self) -> f64 {
        let cost = |s: &Sheet| s.course.registration.energy / s.course.registration.variance.max(1e-300);
        self.sheets.iter().map(cost).sum::<f64>() / self.sheets.len().max(1) as f64
    }

    /// The chart from which [`Self::cross_map`] takes the example's vertices.
    pub fn example(&self) -> Option<&Arc<Chart>> {
        self.sheets.first().map(|s| &s.example)
    }

    /// The chart on whose mesh [`Self::cross_map`] places vertices.
    pub fn input(&self) -> Option<&Arc<Chart>> {
        self.sheets.first().map(|s| &s.input)
    }
}

/// The best match of the tips of two discs or spheres: of their limbs, or of their fingers too where that matches more
/// of them about as well.
fn matched<'a>(
    example: &'a Query,
    query: &'a Query,
    solver: &'a dyn Solver,
    stop: &'a (dyn Fn() -> bool + Sync),
) -> Option<(Matcher<'a>, Match)> {
    let sides = [example, query];
    let topology = example.encoding().topology;
    if !matches!(topology, Topology::Disc | Topology::Sphere) || topology != query.encoding().topology {
        return None;
    }
    let few = |breadth: Breadth| sides.iter().any(|side| side.tips(breadth).len() < TIPS_MIN);
    let by = |breadth: Breadth| {
        let matcher = Matcher::new(example, query, breadth, solver, stop);
        let found = matcher.best()?;
        (found.assignment.pairs.len() >= TIPS_MIN && found.cost <= MATCH_COST_MAX).then_some((matcher, found))
    };
    if few(Breadth::Limbs) {
        return None;
    }
    let limbs = by(Breadth::Limbs);
    let are_more = sides.iter().any(|side| side.tips(Breadth::Fingers) != side.tips(Breadth::Limbs));
    if !are_more || few(Breadth::Fingers) {
        return limbs;
    }
    let fingers = by(Breadth::Fingers);
    let pairs = |(_, found): &(Matcher, Match)| found.assignment.pairs.len();
    match (&limbs, &fingers) {
        (Some(a), Some(b)) if pairs(b) <= pairs(a) || b.1.cost >= FINER_WITHIN * a.1.cost => limbs,
        (Some(_), None) => limbs,
        (_, _) => fingers,
    }
}

/// Where one sheet sends the example's vertices.
struct SheetMap<'a> {
    input: &'a Chart,
    index: &'a PlanarIndex,
    images: Vec<Uv>,
    places: Vec<Location>,
    /// What the sheet has to say at each vertex.
    weights: Vec<f64>,
}

impl<'a> SheetMap<'a> {
    /// The first `n` vertices.
    fn new(sheet: &'a Sheet, constraints: &[(Location, Location)], n: usize) -> Result<Self, EditError> {
        let index = &sheet.index;
        let course = sheet.constrained(constraints)?;
        let image = |v: usize| course.map(sheet.example.topology, vertex_uv(&sheet.example, v));
        let images: Vec<Uv> = (0..n).map(image).collect();
        let places = images.iter().map(|&uv| index.locate(&sheet.input, uv)).collect();
        let weights = compression(&sheet.example)[..n].iter().map(|c| c.powf(-BLEND_POWER)).collect();
        Ok(Self { input: &sheet.input, index, images, places, weights })
    }
}

/// The mean of the places to which the sheets send vertex `v`, taken on the surface: in the [`EqualAreaDisc`] about the nearer
/// end of the chart that has most say, so that no place between two fingers is ever passed.
fn blended(laid: &[SheetMap], v: usize) -> Location {
    let strongest = laid.iter().reduce(|a, b| if b.weights[v] > a.weights[v] { b } else { a });
    let Some(chart) = strongest else { return Location { triangle: 0, barycentric: [1.0, 0.0, 0.0] } };
    let picture = EqualAreaDisc::about(chart.input, chart.images[v][1]);
    let (mut sum, mut all) = ([0.0; 2], 0.0);
    for sheet in laid {
        let uv = if std::ptr::eq(sheet, chart) { chart.images[v] } else { sheet.places[v].uv(chart.input) };
        let [x, y] = picture.flat(uv);
        sum[0] += sheet.weights[v] * x;
        sum[1] += sheet.weights[v] * y;
        all += sheet.weights[v];
    }
    chart.index.locate(chart.input, picture.uv(sum.map(|s| s / all.max(1e-300))))
}

fn side_at(query: &Query, poles: &[u32]) -> Result<EncodedChart, UnfoldError> {
    let chart = match query.quick_chart(poles) {
        Some(chart) => Arc::new(chart),
        None => query.chart_for(poles)?,
    };
    let encoding = encode_to(&chart, CHART_SIDE);
    Ok(EncodedChart { chart, encoding })
}

impl Sheet {
    /// Registers a pair of charts, the other matched tips as controls.
    fn new(
        one: EncodedChart,
        two: EncodedChart,
        matches: &[(u32, u32)],
        flip: Flip,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Self {
        let mut pairs = tip_controls(matches, flip, |tip| one.place(tip), |tip| two.place(tip));
        let others = pairs.clone();
        unwrap_shifts(&mut pairs);
        let images = query_images(&two.encoding, CHART_SIDE);
        let mut registration = match pairs.is_empty() {
            true => None,
            false => {
                let (p, q) = pairs.into_iter().unzip();
                Some(Registration::from_controls(flip, p, q))
            }
        };
        for image in &images {
            let Some(level) = Level::new(&one.encoding, image) else { continue };
            match &mut registration {
                None => registration = Some(coarse_flip(&level, flip, solver, stop)),
                Some(r) if r.side == 0 => r.solve_level(&level, solver, stop),
                Some(r) => r.advance(&level, solver, stop),
            }
        }
        let identity = || Registration::from_controls(flip, vec![[0.5, 0.5]], vec![[0.5, 0.5]]);
        let index = PlanarIndex::new(&two.chart);
        let registration = registration.unwrap_or_else(identity);
        let course = Course::new(registration, [&one.chart, &two.chart], &others, solver, stop);
        Self { example: one.chart, input: two.chart, index, course }
    }
}

impl Sheet {
    /// The map with further constraints; refused where they fold it.
    fn constrained(&self, constraints: &[(Location, Location)]) -> Result<Course, EditError> {
        let mut course = self.course.clone();
        let topology = self.example.topology;
        for (on_example, on_input) in constraints {
            course.constrain(topology, on_example.uv(&self.example), on_input.uv(&self.input))?;
        }
        if !constraints.is_empty() {
            course.check_folds(topology)?;
        }
        Ok(course)
    }
}

/// Moves each target to the period nearest to the common shift (circular mean), and returns that.
pub(super) fn unwrap_shifts(pairs: &mut [(Uv, Uv)]) -> f64 {
    let tau = std::f64::consts::TAU;
    let turn = |(p, q): &(Uv, Uv)| (tau * (q[0] - p[0])).sin_cos();
    let (sin, cos) = pairs.iter().map(turn).fold((0.0, 0.0), |s, t| (s.0 + t.0, s.1 + t.1));
    let shift = sin.atan2(cos) / tau;
    for (p, q) in pairs {
        q[0] += (p[0] + shift - q[0]).round();
    }
    shift
}

/// 3D area per area of the domain at each vertex, both as shares.
fn compression(chart: &Chart) -> Vec<f64> {
    let total = chart.mesh.total_area();
    let mut areas = vec![[0.0f64; 2]; chart.mesh.positions.len()];
    for (t, corners) in chart.mesh.triangles.iter().enumerate() {
        let share = chart.mesh.area(t) / total;
        let mut flat = crate::unfold::signed_area(&chart.corners[t]).abs();
        if crate::encode::index::pole_corner(chart, t as u32).is_some() {
            // A pole's triangle stands for a quad of about twice its size.
            flat *= 2.0;
        }
        for &v in corners {
            areas[v as usize][0] += share;
            areas[v as usize][1] += flat;
        }
    }
    areas.iter().map(|[a3, a2]| (a3 / a2.max(1e-300)).clamp(1e-3, 1e30)).collect()
}

/// The input's boundary, for vertices that must stay on it.
struct InputBoundary {
    halfedges: Vec<u32>,
}

impl InputBoundary {
    fn new(mesh: &TriMesh) -> Self {
        Self { halfedges: (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE).collect() }
    }

    /// The nearest point of the boundary; of a closed surface, a corner of its first triangle.
    fn closest(&self, mesh: &TriMesh, target: Vec3) -> Location {
        let mut best = (f64::INFINITY, Location { triangle: 0, barycentric: [1.0, 0.0, 0.0] });
        for &h in &self.halfedges {
            let share = mesh.nearest_share(h, target);
            let away = (mesh.point_on(h, share) - target).norm_squared();
            if away < best.0 {
                best = (away, Location::on_edge(h, share));
            }
        }
        best.1
    }
}
