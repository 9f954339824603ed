//! Fitting: an example laid on an input that may end elsewhere than it does.
//!
//! Each hypothesis of how much of one belongs on how much of the other ([`crate::extent`]) is cut out, unfolded with its
//! own boundary, registered and laid as surfaces that end alike are.

pub mod beyond;
pub mod mend;
pub mod openings;
pub mod rest;
pub mod rough;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::encode::index::PlanarIndex;
use crate::extent::{Crop, Extent, extents};
use crate::map::atlas::Atlas;
use crate::map::reembed::{InputChart, settle};
use crate::map::{CrossMap, cross_map};
use crate::measure::{self, BURDENED_DEG, Distortion};
use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::{NONE, TriMesh, nearest_share};
use crate::register::entry::{Hypothesis, PROTRUSIONS_MANY};
use crate::register::{Entry, Query, Solver};
use crate::segment::{Segmented, segment_above, segment_labels};
use crate::settle::Similarity;
use crate::topology::{Components, Patch, Topology, connected, primitive};
use crate::unfold::{Chart, UnfoldError, UnfoldOptions};

/// Level to which everything is registered.
const SIDE: usize = 128;

/// A surface that can be fitted.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Its mesh.
    pub patch: Arc<Patch>,
    /// The same, unfolded.
    pub query: Arc<Query>,
}

impl Surface {
    /// Unfolds a patch.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn new(patch: Patch) -> Result<Self, UnfoldError> {
        let query = Arc::new(Query::new(&patch, &UnfoldOptions::default())?);
        Ok(Self { patch: Arc::new(patch), query })
    }
}

/// An example laid on an input, before it is told how good that is.
#[derive(Debug)]
pub struct FittedMap {
    /// Where its vertices go.
    pub cross: CrossMap,
    /// The chart on whose mesh they lie.
    pub input: Arc<Chart>,
    /// Whether it lies mirrored.
    pub mirrored: bool,
    /// E / variance at the finest level.
    pub cost: f64,
    /// 95th percentile of the angle distortion before the polish.
    pub laid_angle_p95_deg: f64,
    /// How it distorts the example.
    pub distortion: Distortion,
    /// Whether a chart for each protrusion made it.
    pub is_atlas: bool,
}

/// Lays an example on an input that ends where it does.
///
/// # Errors
/// [`UnfoldError`].
pub fn lay(
    one: &Surface,
    two: &Surface,
    solver: &dyn Solver,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<FittedMap>, UnfoldError> {
    let Some(mut entry) = Entry::coarse(&two.query, one.query.encoding(), solver, stop) else { return Ok(None) };
    while entry.side() < SIDE {
        entry.advance(&two.query, one.query.encoding(), solver, stop)?;
    }
    entry.refine_poles(&two.query, one.query.encoding(), solver, stop)?;
    let mut laid = by_chart(one, two, &entry)?;
    if two.query.protrusions().len() < PROTRUSIONS_MANY && laid.laid_angle_p95_deg > BURDENED_DEG {
        let mesh = &one.patch.mesh;
        let burden = |h: &Hypothesis| measure::burden(mesh, &one.query.chart, &two.query, h);
        entry.unburden_poles(&two.query, one.query.encoding(), solver, &burden, stop)?;
        laid = by_chart(one, two, &entry)?;
    }
    let many = by_atlas(one, two, solver, stop)?;
    Ok(Some(many.filter(|many| many.distortion.badness() < laid.distortion.badness()).unwrap_or(laid)))
}

fn by_chart(one: &Surface, two: &Surface, entry: &Entry) -> Result<FittedMap, UnfoldError> {
    let best = entry.best();
    let input = two.query.chart_for(&best.unfolded.poles)?;
    let index = PlanarIndex::new(&input);
    let mut cross = cross_map(&best.registration, &one.query.chart, &input, &index);
    let mirrored = best.registration.flip.is_mirror();
    let laid_angle_p95_deg = settled(one, &mut cross, &[InputChart { chart: &input, index: &index }], mirrored);
    let distortion = measure::distortion(&one.patch.mesh, &cross, &input, sign(mirrored));
    Ok(FittedMap { cross, input, mirrored, cost: best.cost(), laid_angle_p95_deg, distortion, is_atlas: false })
}

fn by_atlas(
    one: &Surface,
    two: &Surface,
    solver: &dyn Solver,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<FittedMap>, UnfoldError> {
    let Some(atlas) = Atlas::build(&one.query, &two.query, solver, stop)? else { return Ok(None) };
    let Ok(mut cross) = atlas.cross_map(&[]) else { return Ok(None) };
    let Some(input) = atlas.input() else { return Ok(None) };
    let mirrored = atlas.mirrored;
    let laid_angle_p95_deg = settled(one, &mut cross, &atlas.grounds(), mirrored);
    let distortion = measure::distortion(&one.patch.mesh, &cross, input, sign(mirrored));
    let input = Arc::clone(input);
    Ok(Some(FittedMap {
        cross,
        input,
        mirrored,
        cost: atlas.mean_cost(),
        laid_angle_p95_deg,
        distortion,
        is_atlas: true,
    }))
}

fn settled(one: &Surface, cross: &mut CrossMap, grounds: &[InputChart], mirrored: bool) -> f64 {
    let laid = measure::angle_distortion(&one.patch.mesh, cross).p95;
    settle(&one.patch.mesh, cross, grounds, sign(mirrored));
    laid
}

fn sign(mirrored: bool) -> f64 {
    if mirrored { -1.0 } else { 1.0 }
}

/// A surface with what a crop leaves of it in front.
#[derive(Debug)]
pub struct Cropped {
    /// The surface cut in two: the part that stays, and the rest.
    pub segmented: Segmented,
    /// The part that stays, unfolded.
    pub surface: Surface,
}

/// Cuts a part out of a surface, through its triangles; `None` where what is cut out is no disc.
pub fn crop(surface: &Surface, crop: &Crop) -> Option<Cropped> {
    let below = surface.query.shares_below(&crop.poles)?;
    let level = 1.0 - crop.share;
    let field: Vec<f64> = below.iter().take(surface.patch.mesh.positions.len()).map(|v| v - level).collect();
    cut_out(segment_above(&surface.patch.mesh, &field).ok()?, surface, crop)
}

/// The same between the polygons: each goes where most of it is.
pub fn crop_between(surface: &Surface, crop: &Crop) -> Option<Cropped> {
    let below = surface.query.shares_below(&crop.poles)?;
    let level = 1.0 - crop.share;
    let field: Vec<f64> = below.iter().take(surface.patch.mesh.positions.len()).map(|v| v - level).collect();
    let cut = segment_above(&surface.patch.mesh, &field).ok()?;
    cut_out(cut.between_polygons(&surface.patch.mesh).ok()?, surface, crop)
}

/// What is left of an example's surface without the polygons most of whose vertices are `lost`; `None` where that is no
/// disc, or no more goes than a share `least` of the area. Lost pieces that are surrounded by what stays, stay.
pub fn without(surface: &Surface, lost: &[bool], least: f64) -> Option<Cropped> {
    let mesh = &surface.patch.mesh;
    let mut counts: BTreeMap<u32, [u32; 2]> = BTreeMap::new();
    for (corners, f) in mesh.triangles.iter().zip(&mesh.polygon_of) {
        let count = counts.entry(*f).or_default();
        corners.iter().for_each(|&v| count[usize::from(lost.get(v as usize) == Some(&true))] += 1);
    }
    let is_gone: Vec<bool> =
        mesh.polygon_of.iter().map(|f| counts.get(f).is_some_and(|[kept, gone]| gone > kept)).collect();
    let area = |set: &Vec<u32>| set.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
    let mut pieces: Vec<Vec<u32>> =
        connected(mesh, &is_gone).into_iter().filter(|set| is_gone[set[0] as usize]).collect();
    // A closed surface opens where its largest piece goes.
    pieces.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.cmp(b)));
    let is_closed = mesh.twins.iter().all(|twin| *twin != NONE);
    let has_rim = |set: &[u32]| set.iter().any(|t| (0..3).any(|side| mesh.twin(3 * t + side) == NONE));
    // What stays is 0, each piece that goes has a number of its own.
    let mut label_of = vec![0; mesh.triangles.len()];
    let goes = |(k, set): &(usize, &Vec<u32>)| (is_closed && *k == 0) || has_rim(set);
    if pieces.iter().enumerate().filter(goes).map(|(_, set)| area(set)).sum::<f64>() <= least * mesh.total_area() {
        return None;
    }
    for ((_, set), label) in pieces.iter().enumerate().filter(goes).zip(1..) {
        set.iter().for_each(|&t| label_of[t as usize] = label);
    }
    let mut segmented = segment_labels(mesh, label_of);
    let part = segmented.parts.first()?;
    let found = primitive(&part.mesh, Components::Crumbs).ok().filter(|p| p.topology == Topology::Disc)?;
    let patch = Patch { topology: found.topology, holes: found.holes, ..part.clone() };
    segmented.parts[0] = patch.clone();
    Some(Cropped { segmented, surface: Surface::new(patch).ok()? })
}

fn cut_out(mut segmented: Segmented, surface: &Surface, crop: &Crop) -> Option<Cropped> {
    let part = segmented.parts.first()?;
    let found = primitive(&part.mesh, Components::Crumbs).ok().filter(|p| p.topology == Topology::Disc)?;
    let patch = Patch { topology: found.topology, holes: found.holes, ..part.clone() };
    segmented.parts[0] = patch.clone();
    // The solve's own vertices lie beside the patch's.
    let solved = surface.query.unfolder().mesh();
    let at = solved.positions[*crop.poles.last()? as usize];
    let away = |v: &usize| (patch.mesh.positions[*v] - at).norm_squared();
    let on_boundary = patch.mesh.boundary_vertices();
    let inner = (0..patch.mesh.positions.len()).filter(|&v| !on_boundary[v]);
    let pole = inner.min_by(|a, b| away(a).total_cmp(&away(b)))? as u32;
    let query = Query::starting_at(&patch, &UnfoldOptions { poles: vec![pole] }).ok()?;
    Some(Cropped { segmented, surface: Surface { patch: Arc::new(patch), query: Arc::new(query) } })
}

/// An example, or a part of it, laid on an input, or a part of it.
#[derive(Debug)]
pub struct Fit {
    /// How much of each, as the pictures told; `None`: all of both.
    pub extent: Option<Extent>,
    /// What is left of the example, where it reaches beyond the input.
    pub one: Option<Cropped>,
    /// What is left of the input, where it reaches beyond the example.
    pub two: Option<Cropped>,
    /// The map of the one on the other.
    pub laid: FittedMap,
}

impl Fit {
    /// Where each vertex of the example goes; those that were cut off follow the others as a whole.
    pub fn start(&self, example: &Surface) -> Vec<Vec3> {
        let laid = &self.laid.cross.positions;
        let Some(one) = &self.one else { return laid.clone() };
        let rest = &example.patch.mesh.positions;
        let part = &one.segmented.parts[0].vertex_of;
        let pairs = part.iter().zip(laid).map(|(&v, x)| (rest[v as usize], *x, 1.0));
        let mirrored = self.laid.mirrored;
        let reflect = |x: &Vec3| if mirrored { Vec3::new(-x.x, x.y, x.z) } else { *x };
        let Some(fit) = Similarity::fit(pairs.map(|(e, x, w)| (reflect(&e), x, w))) else { return laid.clone() };
        let mut start: Vec<Vec3> = rest.iter().map(|x| fit.apply(&reflect(x))).collect();
        part.iter().zip(laid).for_each(|(&v, x)| start[v as usize] = *x);
        start
    }
}

/// Every hypothesis laid, in the order in which their pictures register, all of both first.
///
/// # Errors
/// [`UnfoldError`].
pub fn fits(
    one: &Surface,
    two: &Surface,
    solver: &dyn Solver,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<Fit>, UnfoldError> {
    let mut all = Vec::new();
    if let Some(laid) = lay(one, two, solver, stop)? {
        all.push(Fit { extent: None, one: None, two: None, laid });
    }
    for extent in extents(&one.query, &two.query, solver, stop) {
        let of_one = (!extent.one.is_whole()).then(|| crop_between(one, &extent.one));
        let of_two = (!extent.two.is_whole()).then(|| crop(two, &extent.two));
        if matches!(of_one, Some(None)) || matches!(of_two, Some(None)) {
            continue;
        }
        let (of_one, of_two) = (of_one.flatten(), of_two.flatten());
        let surface = |cropped: &Option<Cropped>, whole: &Surface| {
            cropped.as_ref().map_or_else(|| whole.clone(), |cropped| cropped.surface.clone())
        };
        if let Some(laid) = lay(&surface(&of_one, one), &surface(&of_two, two), solver, stop)? {
            all.push(Fit { extent: Some(extent), one: of_one, two: of_two, laid });
        }
    }
    Ok(all)
}

/// Where an input goes on beyond an example that was laid on it: a value a vertex of the input, positive within the example,
/// about as large as the distance from the example's rim. `None` for an example without a rim.
pub fn within(example: &TriMesh, positions: &[Vec3], input: &TriMesh) -> Option<Vec<f64>> {
    let laid = TriMesh { positions: positions.to_vec(), ..example.clone() };
    let rim: Vec<[Vec3; 2]> = (0..laid.twins.len() as u32)
        .filter(|&h| laid.twin(h) == NONE)
        .map(|h| [laid.tail(h), laid.head(h)].map(|v| laid.positions[v as usize]))
        .collect();
    if rim.is_empty() {
        return None;
    }
    let (tree, on_rim) = (Bvh::new(&laid), laid.boundary_vertices());
    let away = |x: Vec3| {
        let of = |edge: &[Vec3; 2]| (edge[0].lerp(&edge[1], nearest_share(*edge, x)) - x).norm();
        rim.iter().map(of).fold(f64::INFINITY, f64::min)
    };
    let signed = |&x: &Vec3| if is_on_rim(&laid, &on_rim, &tree.closest(x)) { -away(x) } else { away(x) };
    Some(input.positions.iter().map(signed).collect())
}

/// Tells whether a point of a mesh lies on its boundary: on one of its edges, or at one of its vertices (`on_rim`), whose triangle may
/// have no such edge.
fn is_on_rim(mesh: &TriMesh, on_rim: &[bool], at: &Closest) -> bool {
    let corners = mesh.triangles[at.triangle as usize];
    let is_at_vertex = |k: usize| at.barycentric[k] > 1.0 - 1e-9 && on_rim[corners[k] as usize];
    (0..3).any(is_at_vertex)
        || (0..3u32).any(|k| {
            // The edge opposite the third corner is the halfedge of the first.
            at.barycentric[(k as usize + 2) % 3] < 1e-9 && mesh.twin(3 * at.triangle + k) == NONE
        })
}
