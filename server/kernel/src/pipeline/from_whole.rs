//! Where a query was cut as an example is, the example's parts go where the whole was laid.
//!
//! A part alone knows less of where it belongs: one that is nearly its own mirror image may lie mirrored, and a trunk's half
//! turned. The caller's constraints bend that map on the surface ([`bend`]), since it has no registration that they could.

use super::constraint::{LocatedPoint, OnFold};
use super::error::{PipelineError, Refusal, Stop};
use super::model::WholeMap;
use super::registered::{self, IndexedChart, LaidBy, Registered, UnmeasuredMap};
use super::side::Side;
use crate::encode::index::Location;
use crate::map::bend::{BendError, Pin, bend};
use crate::map::placed::placed;
use crate::map::reembed::turn_back;
use crate::map::untangle::untangle;
use crate::map::{CrossMap, leave_fillings};
use crate::measure;
use crate::mesh::bvh::Bvh;
use crate::mesh::{TriMesh, Vec3};
use crate::settle::{Manner, Options, Settler, VertexLandmark};
use crate::topology::Patch;
use std::sync::{Arc, OnceLock};

/// Halvings by which the share of a way that can be gone is found.
const SHARE_STEPS: usize = 5;

/// A map that is given by where its vertices lie: that of a part where the whole was laid, or of an example that has settled.
#[derive(Debug)]
pub(crate) struct PositionedMap {
    /// Whether it lies mirrored.
    mirrored: bool,
    /// Cost of the registration, and log of the ratio of the moduli.
    cost: f64,
    modulus_log: f64,
    /// As the whole lies, whose cuts are beside the segment's.
    as_laid: CrossMap,
    /// Within the segment, boundary on boundary.
    cross: CrossMap,
    /// The tree of the example's part.
    bvh: Bvh,
    /// 95th percentile of the angle distortion as it was laid, in degrees.
    laid_angle_p95_deg: f64,
}

/// The part where the whole was laid on this query, if it was, and the 95th percentile of its angle distortion there, in
/// degrees.
pub(crate) fn from_whole<'a>(
    registered: &'a Registered,
    example: &Side,
    query: &Side,
) -> Result<Option<(UnmeasuredMap<'a>, f64)>, PipelineError> {
    let (of, on) = (&*example.model, &*query.model);
    let is_its_part = example.segment == query.segment;
    let whole = on.laid.as_ref().filter(|laid| is_its_part && laid.is_of(&example.model.mesh));
    let is_there = registered.of_whole.get().is_some();
    let (patch, surface) = match whole {
        None if !is_there => return Ok(None),
        _ => (of.patch(example.segment)?, registered.surface(query)?),
    };
    if let (Some(whole), false) = (whole, is_there) {
        let Some(made) = part_of(whole, patch, surface) else { return Ok(None) };
        let _ = registered.of_whole.set(made);
    }
    let Some(of_whole) = registered.of_whole.get() else { return Ok(None) };
    let source = &example.encoded.query;
    let own = PartOfWhole { part: &patch.mesh, of_whole, input: surface };
    let mut constraints = registered::constraints(registered.registration(), &registered.named(), source, surface);
    // A feature that the caller moved is one of the caller's.
    constraints.retain(|c| registered.pinned.iter().all(|p| p.0 != c.id) && !registered.removed.contains(&c.id));
    for c in &mut constraints {
        if let Some(there) = own.taken_to(Vec3::from(c.on_example.point)) {
            let [u, v] = there.uv(&surface.chart);
            c.on_input = LocatedPoint { point: there.point(&surface.chart).into(), u, v };
        }
    }
    constraints.extend(registered::pinned(registered, &source.chart, &surface.chart));
    let pins: Vec<(Vec3, Location)> =
        registered.pinned.iter().map(|(_, (a, b))| (a.point(&source.chart), *b)).collect();
    let within = own.bent(&pins, registered::sign(of_whole.mirrored)).map_err(|error| refused(registered, error))?;
    // What the constraints leave alone is shown where the whole lies.
    let mut cross = of_whole.as_laid.clone();
    for (v, bent) in within.locations.iter().enumerate().filter(|(v, bent)| **bent != of_whole.cross.locations[*v]) {
        (cross.locations[v], cross.positions[v]) = (*bent, within.positions[v]);
    }
    let laid = UnmeasuredMap {
        cross,
        as_part: Some(within.positions),
        way: LaidBy::Whole,
        input: &surface.chart,
        mirrored: of_whole.mirrored,
        cost: of_whole.cost,
        modulus_log: of_whole.modulus_log,
        constraints,
        registered: registered.clone(),
    };
    Ok(Some((laid, of_whole.laid_angle_p95_deg)))
}

/// Keeps where an atlas lays the example, so that it is bent there from now on.
pub(crate) fn keep(registered: &Registered, example: &Side, query: &Side, stop: Stop) -> Result<(), PipelineError> {
    if registered.of_whole.get().is_some() {
        return Ok(());
    }
    let atlas = registered.atlas(example, query, stop)?;
    let (laid, _) = registered::lay(atlas, registered, example, query, stop)?;
    let model = &*example.model;
    let _ = registered.of_whole.set(PositionedMap::settled(model.patch(example.segment)?, laid.cross, laid.mirrored));
    Ok(())
}

/// Sees to it that the constraints of a map that is given by places can be met; `touched` are those that were set. Where they
/// would fold it, either the edit is refused, with the share of the way that does not, or the whole example settles anew, held at
/// its constraints, and at last those that were set go as far as they can.
pub(crate) fn fitted(
    registered: Registered,
    touched: &[usize],
    on_fold: OnFold,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<Registered, PipelineError> {
    let (source, surface) = (&example.encoded.query, registered.surface(query)?);
    let (of, on) = (&*example.model, &*query.model);
    let patch = of.patch(example.segment)?;
    let Some(of_whole) = registered.of_whole.get() else { return Ok(registered) };
    let own = PartOfWhole { part: &patch.mesh, of_whole, input: surface };
    let sign = registered::sign(of_whole.mirrored);
    let wanted: Vec<(Vec3, Location)> =
        registered.pinned.iter().map(|(_, (a, b))| (a.point(&source.chart), *b)).collect();
    let fits = |made: &PositionedMap| {
        PartOfWhole { part: &patch.mesh, of_whole: made, input: surface }.bent(&wanted, sign).is_ok()
    };
    // What made room goes back once there is no need for it.
    if let Some(first) = registered.before_room.clone().filter(|first| first.get().is_some_and(&fits)) {
        return Ok(Registered { of_whole: first, before_room: None, ..registered });
    }
    let Err(error) = own.bent(&wanted, sign) else { return Ok(registered) };
    // Boundaries of segments belong to their neighbours, too.
    let is_alone = on.laid.is_none() && on.segmented.parts.len() == 1;
    let made = (on_fold == OnFold::Resolve && is_alone).then(|| own.settled_anew(&wanted, sign, stop)).flatten();
    if let Some(made) = made.filter(fits) {
        let first = registered.before_room.clone().unwrap_or_else(|| Arc::clone(&registered.of_whole));
        let of_whole = OnceLock::new();
        let _ = of_whole.set(made);
        return Ok(Registered { of_whole: Arc::new(of_whole), before_room: Some(first), ..registered });
    }
    let share = own.reached(&wanted, touched, sign);
    if on_fold == OnFold::Refuse {
        return Err(match refused(&registered, error) {
            PipelineError::Refused { refusal, detail } => {
                PipelineError::refused(refusal, format!("{detail}; {:.0} % of the way can be gone", 100.0 * share))
            }
            other => other,
        });
    }
    let ends = own.on_the_way(&wanted, touched, share);
    let mut pinned = registered.pinned.clone();
    pinned.iter_mut().zip(ends).for_each(|(pin, end)| pin.1.1 = end.1);
    Ok(Registered { pinned, ..registered })
}

/// The part of the whole on a segment's surface; `None` where a vertex has no place, or the boundaries differ.
fn part_of(whole: &WholeMap, patch: &Patch, surface: &IndexedChart) -> Option<PositionedMap> {
    let points: Option<Vec<Vec3>> =
        patch.vertex_of.iter().map(|&v| whole.places.get(v as usize).copied().flatten()).collect();
    let (chart, mirror) = (&surface.chart, registered::sign(whole.mirrored));
    let points = points?;
    let mut cross = placed(patch, &points, chart, surface.tree(), mirror)?;
    untangle(&patch.mesh, &mut cross, chart, mirror, &surface.bvh);
    leave_fillings(&mut cross, chart, f64::INFINITY);
    let as_laid = CrossMap { locations: cross.locations.clone(), positions: points };
    let laid_angle_p95_deg = measure::angle_distortion(&patch.mesh, &as_laid).p95;
    let WholeMap { mirrored, cost, modulus_log, .. } = *whole;
    Some(PositionedMap { mirrored, cost, modulus_log, as_laid, cross, bvh: Bvh::new(&patch.mesh), laid_angle_p95_deg })
}

impl PositionedMap {
    /// A map that has settled.
    pub(crate) fn settled(patch: &Patch, cross: CrossMap, mirrored: bool) -> Self {
        Self::of(&patch.mesh, cross, mirrored)
    }

    /// Where the vertices of the example's part lie, before the caller's constraints.
    pub(crate) fn positions(&self) -> &[Vec3] {
        &self.cross.positions
    }

    fn of(part: &TriMesh, cross: CrossMap, mirrored: bool) -> Self {
        let laid_angle_p95_deg = measure::angle_distortion(part, &cross).p95;
        let (as_laid, bvh) = (cross.clone(), Bvh::new(part));
        Self { mirrored, cost: 0.0, modulus_log: 0.0, as_laid, cross, bvh, laid_angle_p95_deg }
    }
}

fn refused(registered: &Registered, error: BendError) -> PipelineError {
    let which: Vec<&str> = registered.pinned.iter().map(|p| p.0.as_str()).collect();
    let refusal = match error {
        BendError::Folds { .. } => Refusal::ConstraintFolds,
        BendError::OnBoundary => Refusal::ConstraintInvalid,
    };
    PipelineError::refused(refusal, format!("constraint {}: {error}", which.join(", ")))
}

/// A part of an example, with the map that the whole makes of it.
struct PartOfWhole<'a> {
    part: &'a TriMesh,
    of_whole: &'a PositionedMap,
    input: &'a IndexedChart,
}

impl PartOfWhole<'_> {
    /// Where a point of the example goes.
    fn taken_to(&self, from: Vec3) -> Option<Location> {
        let near = self.of_whole.bvh.closest(from);
        let corners = self.part.triangles.get(near.triangle as usize)?;
        let point: Vec3 =
            (0..3).map(|k| self.of_whole.cross.positions[corners[k] as usize] * near.barycentric[k]).sum();
        let on = self.input.tree().closest(point);
        Some(on.into())
    }

    /// The example settled anew from where it lies, held at its constraints; `None` when stopped.
    fn settled_anew(&self, pins: &[(Vec3, Location)], sign: f64, stop: Stop) -> Option<PositionedMap> {
        let chart = &self.input.chart;
        let landmark = |(from, to): &(Vec3, Location)| {
            VertexLandmark::between(
                self.part,
                &self.of_whole.bvh.closest(*from),
                self.input.tree().closest(to.point(chart)),
            )
        };
        let held: Vec<VertexLandmark> = pins.iter().filter_map(landmark).collect();
        let options = Options { manner: Manner::Following, ..Options::default() };
        let settler = Settler::new(self.part, &chart.mesh, sign, &options)?.holding(&held);
        let found = settler.settle(&self.of_whole.cross.positions, stop)?;
        let locations: Vec<Location> = found.places.into_iter().map(Location::from).collect();
        let mut cross = CrossMap { positions: found.positions, locations };
        turn_back(self.part, &mut cross, &self.input.ground(), sign, &self.input.bvh);
        Some(PositionedMap::of(self.part, cross, self.of_whole.mirrored))
    }

    /// The share of the way to where they were set that the touched pins can go without a fold: a multiple of 1/32.
    fn reached(&self, pins: &[(Vec3, Location)], touched: &[usize], sign: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..SHARE_STEPS {
            let share = 0.5 * (low + high);
            let fits = self.bent(&self.on_the_way(pins, touched, share), sign).is_ok();
            *(if fits { &mut low } else { &mut high }) = share;
        }
        low
    }

    /// The pins, of which the touched ones have gone a share of their way only.
    fn on_the_way(&self, pins: &[(Vec3, Location)], touched: &[usize], share: f64) -> Vec<(Vec3, Location)> {
        let chart = &self.input.chart;
        let part_way = |(k, (from, to)): (usize, &(Vec3, Location))| {
            let start = self.taken_to(*from).filter(|_| touched.contains(&k));
            let end = start.map_or(*to, |start| {
                let (a, b) = (start.point(chart), to.point(chart));
                self.input.tree().closest(a + (b - a) * share).into()
            });
            (*from, end)
        };
        pins.iter().enumerate().map(part_way).collect()
    }

    /// The map with points of the example taken to places on the input.
    fn bent(&self, pins: &[(Vec3, Location)], mirror: f64) -> Result<CrossMap, BendError> {
        let chart = &self.input.chart;
        let pin = |(from, to): &(Vec3, Location)| Pin {
            on_example: self.of_whole.bvh.closest(*from).into(),
            to: to.point(chart),
        };
        let pins: Vec<Pin> = pins.iter().map(pin).collect();
        bend(self.part, &self.of_whole.cross, &pins, chart, mirror, self.input.tree())
    }
}
