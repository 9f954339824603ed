//! Surfaces with protrusions: one chart for each, matched tip to tip and blended.
//!
//! In a chart with its pole elsewhere a finger is smaller than a pixel; in the chart with its pole at the finger's tip
//! it fills the top rows. Tips are found on both surfaces, matched by registering charts with poles at pairs of them,
//! and then each matched tip gets a chart of its own, in which the other tips are controls. A vertex goes where the
//! charts send it, weighted by how little each compresses it there.
//! *Source:* paper §7 ("introduce extra singularities … one pole per disc segment"); blending after Kim, Lipman,
//! Funkhouser, *Blended Intrinsic Maps* (2011). *Ours:* poles at matched tips, area-fraction coordinates.

use std::sync::Arc;

use super::edit::{self, EditError};
use super::{CrossMap, turns_over, vertex_uv};
use crate::encode::features::distance;
use crate::encode::index::{Location, PlanarIndex};
use crate::encode::{Encoding, encode_to};
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh};
use crate::register::entry::{MIRROR_MARGIN, PROTRUSIONS_MANY, SYMMETRIC_COST};
use crate::register::{Flip, Level, Query, Registration, Solver, coarse_flip, query_images};
use crate::topology::Topology;
use crate::unfold::path::distances;
use crate::unfold::{Chart, UnfoldError, Uv};

/// Level at which tips are matched, and to which charts are registered.
const MATCH_SIDE: usize = 32;
const CHART_SIDE: usize = 128;
/// A pair of tips may be this many times further apart on one surface than on the other (in √area).
const STRETCH_MAX: f64 = 1.7;
/// Ways to place the seed that are tried.
const TARGETS_MAX: usize = 12;
/// Mean distance in the domain between matched tips that doubles a match's cost.
const TIP_DISTANCE: f64 = 0.06;
/// Tips further apart than this in the domain are no match.
const TIP_DISTANCE_MAX: f64 = 0.25;
/// Tips that make an atlas worth its charts: with one or two, two poles do.
const TIPS_MIN: usize = PROTRUSIONS_MANY;
/// A match that costs more is none.
const MATCH_COST_MAX: f64 = 1.5;
/// How fast a chart's say falls with its compression.
const BLEND_POWER: f64 = 2.0;

/// A surface's side of a pair of charts.
#[derive(Debug)]
struct Side {
    chart: Arc<Chart>,
    encoding: Encoding,
}

/// One pair of charts with their registration.
#[derive(Debug)]
struct Sheet {
    example: Arc<Chart>,
    input: Arc<Chart>,
    registration: Registration,
}

/// A map made of several charts.
#[derive(Debug)]
pub struct Atlas {
    sheets: Vec<Sheet>,
    /// Matched tips: (vertex of the example's mesh, vertex of the input's).
    pub matches: Vec<(u32, u32)>,
    /// Whether the map mirrors.
    pub mirrored: bool,
    /// E / variance of the tips' match, at its level.
    pub cost: f64,
}

/// A way to match the tips.
struct Match {
    pairs: Vec<(usize, usize)>,
    mirrored: bool,
    cost: f64,
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
        stop: &dyn Fn() -> bool,
    ) -> Result<Option<Self>, UnfoldError> {
        let topology = example.encoding().topology;
        let tips = (example.protrusions(), query.protrusions());
        let wanted = matches!(topology, Topology::Disc | Topology::Sphere) && topology == query.encoding().topology;
        if !wanted || tips.0.len() < TIPS_MIN || tips.1.len() < TIPS_MIN {
            return Ok(None);
        }
        let matcher = Matcher::new(example, query, solver, stop);
        let Some(found) = matcher.best() else { return Ok(None) };
        if found.pairs.len() < TIPS_MIN || found.cost > MATCH_COST_MAX {
            return Ok(None);
        }
        let matches: Vec<(u32, u32)> = found.pairs.iter().map(|&(a, b)| (tips.0[a], tips.1[b])).collect();
        let flip = Flip { u: found.mirrored, v: false };
        let mut sheets = Vec::new();
        for k in 0..matches.len() {
            if stop() {
                return Ok(None);
            }
            let (one, two) =
                (matcher.poles_at(&found.pairs, k, Which::Example), matcher.poles_at(&found.pairs, k, Which::Query));
            let (one, two) = (side_at(example, &one)?, side_at(query, &two)?);
            sheets.push(Sheet::new(one, two, &matches, flip, solver, stop));
        }
        Ok(Some(Self { sheets, matches, mirrored: found.mirrored, cost: found.cost }))
    }

    /// Maps the vertices of the example's patch onto the mesh of the input's charts. Each of `constraints`, a place on
    /// the example's charts and one on the input's, holds in every chart.
    ///
    /// # Errors
    /// [`EditError::Folds`] when the constraints fold a chart.
    pub fn cross_map(&self, constraints: &[(Location, Location)]) -> Result<CrossMap, EditError> {
        let Some(first) = self.sheets.first() else {
            return Ok(CrossMap { locations: Vec::new(), positions: Vec::new() });
        };
        let (n, input) = (first.example.patch_vertices, &first.input);
        let mut sums = vec![(Vec3::zeros(), 0.0f64); n];
        for sheet in &self.sheets {
            let index = PlanarIndex::new(&sheet.input);
            let registration = sheet.constrained(constraints)?;
            let compression = compression(&sheet.example);
            for (v, sum) in sums.iter_mut().enumerate() {
                let uv = registration.map(sheet.example.topology, vertex_uv(&sheet.example, v));
                let place = index.locate(&sheet.input, uv);
                let weight = compression[v].powf(-BLEND_POWER);
                sum.0 += place.point(&sheet.input) * weight;
                sum.1 += weight;
            }
        }
        let on_boundary = first.example.mesh.boundary_vertices();
        let (bvh, rim) = (Bvh::new(&input.mesh), Rim::new(&input.mesh));
        let locations: Vec<Location> = sums
            .iter()
            .enumerate()
            .map(|(v, (sum, weight))| {
                let target = sum / weight.max(1e-300);
                if on_boundary[v] {
                    return rim.closest(&input.mesh, target);
                }
                let closest = bvh.closest(target);
                Location { triangle: closest.triangle, barycentric: closest.barycentric }
            })
            .collect();
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
            if turns_over(&sheet.registration, &sheet.example, corners) {
                folded.push(mesh.polygon_of[t]);
            }
        }
        folded.sort_unstable();
        folded.dedup();
        folded
    }

    /// Mean of the charts' E / variance.
    pub fn mean_cost(&self) -> f64 {
        let cost = |s: &Sheet| s.registration.energy / s.registration.variance.max(1e-300);
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

fn side_at(query: &Query, poles: &[u32]) -> Result<Side, UnfoldError> {
    let chart = match query.quick_chart(poles) {
        Some(chart) => Arc::new(chart),
        None => query.chart_for(poles)?,
    };
    let encoding = encode_to(&chart, CHART_SIDE);
    Ok(Side { chart, encoding })
}

impl Sheet {
    /// Registers a pair of charts, the other matched tips as controls.
    fn new(
        one: Side,
        two: Side,
        matches: &[(u32, u32)],
        flip: Flip,
        solver: &dyn Solver,
        stop: &dyn Fn() -> bool,
    ) -> Self {
        let is_pole = |chart: &Chart, v: u32| chart.poles.iter().any(|p| p.vertex == v);
        let mut pairs: Vec<(Uv, Uv)> = matches
            .iter()
            .filter(|(a, b)| !is_pole(&one.chart, *a) && !is_pole(&two.chart, *b))
            .map(|&(a, b)| (flip.apply(one.chart.uv[a as usize]), two.chart.uv[b as usize]))
            .collect();
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
        Self { example: one.chart, input: two.chart, registration: registration.unwrap_or_else(identity) }
    }
}

impl Sheet {
    /// The registration with further constraints; refused where they fold it.
    fn constrained(&self, constraints: &[(Location, Location)]) -> Result<Registration, EditError> {
        let mut registration = self.registration.clone();
        let topology = self.example.topology;
        for (on_example, on_input) in constraints {
            let (p, q) = (on_example.uv(&self.example), on_input.uv(&self.input));
            edit::set(&mut registration, topology, None, p, q)?;
        }
        if !constraints.is_empty() {
            edit::check_folds(&registration, topology)?;
        }
        Ok(registration)
    }
}

/// Moves each target to the period nearest to the common shift (circular mean).
fn unwrap_shifts(pairs: &mut [(Uv, Uv)]) {
    let tau = std::f64::consts::TAU;
    let turn = |(p, q): &(Uv, Uv)| (tau * (q[0] - p[0])).sin_cos();
    let (sin, cos) = pairs.iter().map(turn).fold((0.0, 0.0), |s, t| (s.0 + t.0, s.1 + t.1));
    let shift = sin.atan2(cos) / tau;
    for (p, q) in pairs {
        q[0] += (p[0] + shift - q[0]).round();
    }
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
struct Rim {
    halfedges: Vec<u32>,
}

impl Rim {
    fn new(mesh: &TriMesh) -> Self {
        Self { halfedges: (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE).collect() }
    }

    /// The nearest point of the boundary; of a closed surface, a corner of its first triangle.
    fn closest(&self, mesh: &TriMesh, target: Vec3) -> Location {
        let mut best = (f64::INFINITY, Location { triangle: 0, barycentric: [1.0, 0.0, 0.0] });
        for &h in &self.halfedges {
            let (a, b) = (mesh.positions[mesh.tail(h) as usize], mesh.positions[mesh.head(h) as usize]);
            let along = b - a;
            let f = ((target - a).dot(&along) / along.norm_squared().max(1e-300)).clamp(0.0, 1.0);
            let d = (a + along * f - target).norm_squared();
            if d < best.0 {
                let mut barycentric = [0.0; 3];
                barycentric[h as usize % 3] = 1.0 - f;
                barycentric[(h as usize + 1) % 3] = f;
                best = (d, Location { triangle: h / 3, barycentric });
            }
        }
        best.1
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Which {
    Example,
    Query,
}

/// Matches tips by registering charts with poles at them.
struct Matcher<'a> {
    example: &'a Query,
    query: &'a Query,
    solver: &'a dyn Solver,
    stop: &'a dyn Fn() -> bool,
    /// Distances between tips along each surface, in √area.
    between: [Vec<Vec<f64>>; 2],
}

impl<'a> Matcher<'a> {
    fn new(example: &'a Query, query: &'a Query, solver: &'a dyn Solver, stop: &'a dyn Fn() -> bool) -> Self {
        let between = [example, query].map(|side| {
            let mesh = side.unfolder().mesh();
            let scale = mesh.total_area().sqrt();
            let tips = side.protrusions();
            let row = |&t: &u32| {
                let (d, _) = distances(mesh, &[t]);
                tips.iter().map(|&x| d[x as usize] / scale).collect()
            };
            tips.iter().map(row).collect()
        });
        Self { example, query, solver, stop, between }
    }

    /// The poles of the chart for pair `k`: its tip at the top, and on spheres the matched tip furthest from it below.
    fn poles_at(&self, pairs: &[(usize, usize)], k: usize, which: Which) -> Vec<u32> {
        let tip = |j: usize| match which {
            Which::Example => self.example.protrusions()[pairs[j].0],
            Which::Query => self.query.protrusions()[pairs[j].1],
        };
        if self.example.encoding().topology == Topology::Disc {
            return vec![tip(k)];
        }
        let from = &self.between[0][pairs[k].0];
        let other = (0..pairs.len()).filter(|&j| j != k);
        let farthest = other.max_by(|&a, &b| from[pairs[a].0].total_cmp(&from[pairs[b].0]));
        vec![tip(farthest.unwrap_or(k)), tip(k)]
    }

    /// The best match. A mirrored one has to beat the best unmirrored one, on an example that is not its own mirror
    /// image: on one that is, both fit and the pictures cannot tell.
    fn best(&self) -> Option<Match> {
        let [plain, mirror] = self.search(&[Flip { u: false, v: false }, Flip { u: true, v: false }]);
        let mirror_wins = match (&plain, &mirror) {
            (Some(plain), Some(mirror)) => mirror.cost * MIRROR_MARGIN < plain.cost && !self.example_is_symmetric(),
            (plain, _) => plain.is_none(),
        };
        if mirror_wins { mirror } else { plain }
    }

    fn example_is_symmetric(&self) -> bool {
        let own = Matcher::new(self.example, self.example, self.solver, self.stop);
        let [_, mirror] = own.search(&[Flip { u: true, v: false }]);
        mirror.is_some_and(|m| m.cost < SYMMETRIC_COST)
    }

    /// The best unmirrored and the best mirrored match among the given flips, over all ways to place the example's
    /// leading tips (disc) or its two farthest (sphere).
    fn search(&self, flips: &[Flip]) -> [Option<Match>; 2] {
        let spherical = self.example.encoding().topology == Topology::Sphere;
        let mut best: [Option<Match>; 2] = [None, None];
        for seed in self.seeds(spherical) {
            let poles: Vec<u32> = seed.iter().map(|&t| self.example.protrusions()[t]).collect();
            let Some(one) = self.quick(Which::Example, &poles) else { continue };
            for targets in self.targets(&seed) {
                if (self.stop)() {
                    return best;
                }
                let poles: Vec<u32> = targets.iter().map(|&t| self.query.protrusions()[t]).collect();
                let Some(two) = self.quick(Which::Query, &poles) else { continue };
                let images = query_images(&two.encoding, MATCH_SIDE);
                let Some(level) = images.first().and_then(|i| Level::new(&one.encoding, i)) else { continue };
                for &flip in flips {
                    let registration = coarse_flip(&level, flip, self.solver, self.stop);
                    let found = self.assign(&registration, &one, &two, &seed, &targets);
                    let slot = &mut best[usize::from(found.mirrored)];
                    if slot.as_ref().is_none_or(|b| found.cost < b.cost) {
                        *slot = Some(found);
                    }
                }
            }
        }
        best
    }

    /// Tips of the example to start from.
    fn seeds(&self, spherical: bool) -> Vec<Vec<usize>> {
        let n = self.between[0].len();
        if !spherical {
            return (0..n.min(3)).map(|t| vec![t]).collect();
        }
        let mut pairs: Vec<(usize, usize)> = (0..n).flat_map(|a| (0..a).map(move |b| (a, b))).collect();
        pairs.sort_by(|x, y| self.between[0][y.0][y.1].total_cmp(&self.between[0][x.0][x.1]));
        pairs.into_iter().take(1).map(|(a, b)| vec![a, b]).collect()
    }

    /// Tips of the query on which the seed may go, the likeliest first: those that lie to the other tips as it does.
    fn targets(&self, seed: &[usize]) -> Vec<Vec<usize>> {
        let n = self.between[1].len();
        let mut all: Vec<(f64, Vec<usize>)> = match *seed {
            [a, b] => {
                let wanted = self.between[0][a][b];
                let pairs = (0..n).flat_map(|x| (0..n).map(move |y| (x, y))).filter(|(x, y)| x != y);
                let misfit = |(x, y): (usize, usize)| {
                    let apart = (self.between[1][x][y] / wanted).ln().abs();
                    (apart + self.unlikeness(a, x) + self.unlikeness(b, y), vec![x, y])
                };
                pairs
                    .filter(|&(x, y)| (self.between[1][x][y] / wanted).ln().abs() < STRETCH_MAX.ln())
                    .map(misfit)
                    .collect()
            }
            _ => (0..n).map(|x| (self.unlikeness(seed[0], x), vec![x])).collect(),
        };
        all.sort_by(|x, y| x.0.total_cmp(&y.0).then_with(|| x.1.cmp(&y.1)));
        all.truncate(TARGETS_MAX);
        all.into_iter().map(|(_, targets)| targets).collect()
    }

    /// How differently tip `a` of the example and tip `x` of the query lie to the other tips: mean difference of their
    /// sorted distances.
    fn unlikeness(&self, a: usize, x: usize) -> f64 {
        let sorted = |row: &[f64]| {
            let mut row = row.to_vec();
            row.sort_by(|p, q| q.total_cmp(p));
            row
        };
        let (one, two) = (sorted(&self.between[0][a]), sorted(&self.between[1][x]));
        let n = one.len().min(two.len());
        one.iter().zip(&two).map(|(p, q)| (p - q).abs()).sum::<f64>() / n as f64
    }

    fn quick(&self, which: Which, poles: &[u32]) -> Option<Side> {
        let side = match which {
            Which::Example => self.example,
            Which::Query => self.query,
        };
        let chart = side.quick_chart(poles)?;
        let encoding = encode_to(&chart, MATCH_SIDE);
        Some(Side { chart: Arc::new(chart), encoding })
    }

    /// Pairs the other tips by where the registration sends them, nearest first.
    fn assign(&self, r: &Registration, one: &Side, two: &Side, seed: &[usize], targets: &[usize]) -> Match {
        let (from, to) = (self.example.protrusions(), self.query.protrusions());
        let mut near: Vec<(f64, usize, usize)> = Vec::new();
        for a in (0..from.len()).filter(|a| !seed.contains(a)) {
            let x = r.map(one.chart.topology, one.chart.uv[from[a] as usize]);
            for b in (0..to.len()).filter(|b| !targets.contains(b)) {
                near.push((distance(x, two.chart.uv[to[b] as usize]), a, b));
            }
        }
        near.sort_by(|x, y| x.0.total_cmp(&y.0));
        let mut pairs: Vec<(usize, usize)> = seed.iter().copied().zip(targets.iter().copied()).collect();
        let mut sum = 0.0;
        for (d, a, b) in near {
            let free = !pairs.iter().any(|(x, y)| *x == a || *y == b);
            if free && d <= TIP_DISTANCE_MAX {
                pairs.push((a, b));
                sum += d;
            }
        }
        let possible = from.len().min(to.len());
        sum += (possible - pairs.len().min(possible)) as f64 * TIP_DISTANCE_MAX;
        let mean = sum / possible.max(1) as f64;
        let mirrored = r.flip.is_mirror();
        let cost = r.energy / r.variance.max(1e-300) * (1.0 + mean / TIP_DISTANCE);
        Match { pairs, mirrored, cost }
    }
}
