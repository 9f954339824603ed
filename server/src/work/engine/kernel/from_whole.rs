//! Where a query was cut as an example is, the example's parts go where the whole was laid.
//!
//! A part alone knows less of where it belongs: one that is nearly its own mirror image may lie mirrored, and a trunk's half
//! turned. The caller's constraints bend that map on the surface ([`bend`]), since it has no registration that they could.

use super::super::{EngineError, Refusal, Side};
use super::fresh;
use super::model::{Laid as WholeLaid, ModelInner};
use super::registered::{self, Laid, Registered, Surface, Way};
use quadmuse_kernel::encode::index::Location as Place;
use quadmuse_kernel::map::bend::{BendError, Pin, bend};
use quadmuse_kernel::map::placed::placed;
use quadmuse_kernel::map::untangle::untangle;
use quadmuse_kernel::map::{CrossMap, leave_fillings};
use quadmuse_kernel::measure;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_kernel::topology::Patch;
use quadmuse_proto::Location;

/// A map that is given by where its vertices lie: that of a part where the whole was laid, or of an example that has settled.
#[derive(Debug)]
pub(super) struct OfWhole {
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
pub(super) fn from_whole<'a>(
    registered: &'a Registered,
    example: &Side,
    query: &Side,
) -> Result<Option<(Laid<'a>, f64)>, EngineError> {
    let (of, on): (&ModelInner, &ModelInner) = (example.model.inner.open()?, query.model.inner.open()?);
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
    let source = fresh(&example.encoded.encoding)?;
    let own = Own { part: &patch.mesh, of_whole, input: surface };
    let mut constraints = registered::constraints(registered.registration(), &registered.named(), source, surface);
    for c in &mut constraints {
        if let Some(there) = own.taken_to(Vec3::from(c.on_example.point)) {
            let [u, v] = there.uv(&surface.chart);
            c.on_input = Location { point: there.point(&surface.chart).into(), u, v };
        }
    }
    constraints.extend(registered::pinned(registered, &source.chart, &surface.chart));
    let pins: Vec<(Vec3, Place)> = registered.pinned.iter().map(|(_, (a, b))| (a.point(&source.chart), *b)).collect();
    let within = own.bent(&pins, registered::sign(of_whole.mirrored)).map_err(|error| refused(registered, error))?;
    // What the constraints leave alone is shown where the whole lies.
    let mut cross = of_whole.as_laid.clone();
    for (v, bent) in within.locations.iter().enumerate().filter(|(v, bent)| **bent != of_whole.cross.locations[*v]) {
        (cross.locations[v], cross.positions[v]) = (*bent, within.positions[v]);
    }
    let laid = Laid {
        cross,
        as_part: Some(within.positions),
        way: Way::Whole,
        input: &surface.chart,
        mirrored: of_whole.mirrored,
        cost: of_whole.cost,
        modulus_log: of_whole.modulus_log,
        constraints,
        registered: registered.clone(),
    };
    Ok(Some((laid, of_whole.laid_angle_p95_deg)))
}

/// The part of the whole on a segment's surface; `None` where a vertex has no place, or the boundaries differ.
fn part_of(whole: &WholeLaid, patch: &Patch, surface: &Surface) -> Option<OfWhole> {
    let points: Option<Vec<Vec3>> =
        patch.vertex_of.iter().map(|&v| whole.places.get(v as usize).copied().flatten()).collect();
    let (chart, mirror) = (&surface.chart, registered::sign(whole.mirrored));
    let points = points?;
    let mut cross = placed(patch, &points, chart, surface.tree(), mirror)?;
    untangle(&patch.mesh, &mut cross, chart, mirror, &surface.bvh);
    leave_fillings(&mut cross, chart);
    let as_laid = CrossMap { locations: cross.locations.clone(), positions: points };
    let laid_angle_p95_deg = measure::angle_distortion(&patch.mesh, &as_laid).p95;
    let WholeLaid { mirrored, cost, modulus_log, .. } = *whole;
    Some(OfWhole { mirrored, cost, modulus_log, as_laid, cross, bvh: Bvh::new(&patch.mesh), laid_angle_p95_deg })
}

impl OfWhole {
    /// A map that has settled.
    pub(super) fn settled(patch: &Patch, cross: CrossMap, mirrored: bool) -> Self {
        let laid_angle_p95_deg = measure::angle_distortion(&patch.mesh, &cross).p95;
        let (as_laid, bvh) = (cross.clone(), Bvh::new(&patch.mesh));
        Self { mirrored, cost: 0.0, modulus_log: 0.0, as_laid, cross, bvh, laid_angle_p95_deg }
    }
}

fn refused(registered: &Registered, error: BendError) -> EngineError {
    let which: Vec<&str> = registered.pinned.iter().map(|p| p.0.as_str()).collect();
    let refusal = match error {
        BendError::Folds { .. } => Refusal::ConstraintFolds,
        BendError::OnBoundary => Refusal::ConstraintInvalid,
    };
    EngineError::refused(refusal, format!("constraint {}: {error}", which.join(", ")))
}

/// A part with the map that the whole makes of it.
struct Own<'a> {
    part: &'a TriMesh,
    of_whole: &'a OfWhole,
    input: &'a Surface,
}

impl Own<'_> {
    /// Where a point of the example goes.
    fn taken_to(&self, from: Vec3) -> Option<Place> {
        let near = self.of_whole.bvh.closest(from);
        let corners = self.part.triangles.get(near.triangle as usize)?;
        let point: Vec3 =
            (0..3).map(|k| self.of_whole.cross.positions[corners[k] as usize] * near.barycentric[k]).sum();
        let on = self.input.tree().closest(point);
        Some(on.into())
    }

    /// The map with points of the example taken to places on the input.
    fn bent(&self, pins: &[(Vec3, Place)], mirror: f64) -> Result<CrossMap, BendError> {
        let chart = &self.input.chart;
        let pin = |(from, to): &(Vec3, Place)| Pin {
            on_example: self.of_whole.bvh.closest(*from).into(),
            to: to.point(chart),
        };
        let pins: Vec<Pin> = pins.iter().map(pin).collect();
        bend(self.part, &self.of_whole.cross, &pins, chart, mirror, self.input.tree())
    }
}
