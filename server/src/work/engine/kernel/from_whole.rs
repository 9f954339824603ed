//! Where a query was cut as an example is, the example's parts go where the whole was laid.
//!
//! A part alone knows less of where it belongs: one that is nearly its own mirror image may lie mirrored, and a trunk's half
//! turned. An edit bends the registration of the part's own charts; the vertices keep what the whole took them away from there,
//! but for those near the caller's constraints.

use super::super::{EngineError, Side};
use super::model::ModelInner;
use super::registered::{self, Laid, Registered, Surface, Way};
use super::settled::{self, settle};
use quadmuse_kernel::encode::index::Location as Place;
use quadmuse_kernel::map::placed::placed;
use quadmuse_kernel::map::untangle::untangle;
use quadmuse_kernel::map::{CrossMap, leave_fillings};
use quadmuse_kernel::measure;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_proto::{Constraint, Location};
use std::sync::OnceLock;

/// The map of the part that the whole makes, unless the caller has edited it or the whole was not laid on this query; with
/// the 95th percentile of the angle distortion before it settled, in degrees.
pub(super) fn from_whole<'a>(
    registered: &'a Registered,
    example: &Side,
    query: &Side,
) -> Result<Option<(Laid<'a>, f64)>, EngineError> {
    let (of, on): (&ModelInner, &ModelInner) = (example.model.inner.open()?, query.model.inner.open()?);
    let is_edited = registered.edited.is_some() || !registered.pinned.is_empty();
    let is_its_part = !is_edited && example.segment == query.segment;
    let Some(whole) = on.laid.as_ref().filter(|laid| is_its_part && laid.is_of(&example.model.mesh)) else {
        return Ok(None);
    };
    let patch = of.patch(example.segment)?;
    let points: Option<Vec<Vec3>> =
        patch.vertex_of.iter().map(|&v| whole.places.get(v as usize).copied().flatten()).collect();
    let surface = registered.surface(query)?;
    let mirror = registered::sign(whole.mirrored);
    let Some(mut cross) = points.and_then(|points| placed(patch, &points, &surface.chart, mirror)) else {
        return Ok(None);
    };
    untangle(&patch.mesh, &mut cross, &surface.chart, mirror, &surface.bvh);
    leave_fillings(&mut cross, &surface.chart);
    let angle_p95_deg = measure::angle_distortion(&patch.mesh, &cross).p95;
    let by_chart = registered::by_chart(registered, example, query)?;
    match settled::first(&registered.settled) {
        Some(first) => cross = first.clone(),
        None => {
            let laying = registered::laying(example, query)?;
            settle(&OnceLock::new(), &laying, &mut cross, &[surface.ground()], mirror, &[]);
        }
    }
    if by_chart.mirrored == whole.mirrored {
        settled::keep(&registered.settled, by_chart.cross.positions, cross.clone());
    }
    // Edits bend the part's own chart.
    let _ = registered.atlas.set(None);
    let constraints = moved(by_chart.constraints, &patch.mesh, &cross, surface);
    let laid = Laid {
        cross,
        way: Way::Whole,
        input: &surface.chart,
        mirrored: whole.mirrored,
        cost: whole.cost,
        modulus_log: whole.modulus_log,
        constraints,
        registered: by_chart.registered,
    };
    Ok(Some((laid, angle_p95_deg)))
}

/// Constraints whose ends on the input are where the map takes their ends on the example.
fn moved(constraints: Vec<Constraint>, part: &TriMesh, cross: &CrossMap, input: &Surface) -> Vec<Constraint> {
    let own = Bvh::new(part);
    let there = |from: &Location| {
        let near = own.closest(Vec3::from(from.point));
        let corners = part.triangles.get(near.triangle as usize)?;
        let point: Vec3 = (0..3).map(|k| cross.positions[corners[k] as usize] * near.barycentric[k]).sum();
        let on = input.bvh.get_or_init(|| Bvh::new(&input.chart.mesh)).closest(point);
        let uv = Place { triangle: on.triangle, barycentric: on.barycentric }.uv(&input.chart);
        Some(Location { point: on.point.into(), u: uv[0], v: uv[1] })
    };
    let moved = |c: Constraint| Constraint { on_input: there(&c.on_example).unwrap_or(c.on_input), ..c };
    constraints.into_iter().map(moved).collect()
}
