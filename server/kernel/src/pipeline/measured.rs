//! What was laid, measured: the map as the service tells it.

use super::error::PipelineError;
use super::mapped::{MapExtent, Mapped, Verdict};
use super::registered::{LaidBy, Registered, UnmeasuredMap, assembled, sign, winding};
use super::side::Side;
use crate::map::untangle::turned_in_domain;
use crate::map::{CrossMap, folded_faces, leave_fillings};
use crate::measure::coverage::{Coverage, coverage, feature_points};
use crate::measure::{self, MapMeasurements};
use crate::mesh::TriMesh;
use crate::numerics::side_by_side;
use crate::register::Flip;
use std::sync::Arc;

/// A vertex over a gap of the scan that is farther from its rim, in √area of the scan, bridges the gap.
const BRIDGED: f64 = 0.01;

/// What was laid, measured; `laid_angle_p95_deg` is the 95th percentile of the angle distortion before it settled.
pub(crate) fn measured(
    mut laid: UnmeasuredMap<'_>,
    laid_angle_p95_deg: f64,
    from: &Registered,
    example: &Side,
    query: &Side,
) -> Result<Mapped, PipelineError> {
    // What has settled bridges the gaps of a scan as the example does; drawn to their rims its faces would collapse.
    let has_settled = matches!(laid.way, LaidBy::Whole) && query.model.laid.is_none();
    let size = laid.input.mesh.total_area().sqrt();
    leave_fillings(&mut laid.cross, laid.input, if has_settled { BRIDGED * size } else { f64::INFINITY });
    let model = &*example.model;
    let patch = model.patch(example.segment)?;
    let chart = &&example.encoded.query.chart;
    let made = || {
        let mesh = assembled(&laid, example);
        let positions = laid.as_part.as_ref().unwrap_or(&laid.cross.positions);
        let part = crate::compose::part::polygons(&patch.mesh, positions, winding(&laid));
        let in_domain = match laid.way {
            LaidBy::Atlas(atlas) => Some(atlas.folded_faces(&patch.mesh)),
            LaidBy::Chart => Some(folded_faces(laid.registered.registration(), chart, &patch.mesh)),
            LaidBy::Whole => Some(turned_in_domain(&patch.mesh, &laid.cross, laid.input, sign(laid.mirrored))),
        };
        (mesh, part, in_domain, distortion(&laid, example))
    };
    // Both take as long, together half of an edit.
    let ((mesh, part, in_domain, distortion), coverage) =
        side_by_side(made, || covered(&patch.mesh, &laid.cross, query));
    let (mesh, distortion, coverage) = (mesh?, distortion?, coverage?);
    // A face over a crease may look inward without a fold: the domain tells them apart.
    let folds = match &in_domain {
        Some(faces) => faces.iter().filter(|f| distortion.inward.binary_search(f).is_ok()).count(),
        None => distortion.inward.len(),
    };
    let evidence = MapMeasurements {
        cost: laid.cost,
        modulus_log: laid.modulus_log,
        turned_share: distortion.inward.len() as f64 / distortion.faces.max(1) as f64,
        angle_p95_deg: measure::layout_distortion(&patch.mesh, &laid.cross, chart).p95,
        laid_angle_p95_deg,
        coverage,
        is_flat: [patch.mesh.is_flat(), laid.input.mesh.is_flat()],
        is_ring: measure::is_ring(chart),
    };
    let (word, reasons) = measure::verdict(&evidence);
    let on = &query.model;
    let is_of_whole = matches!(laid.way, LaidBy::Whole) && on.laid.is_some() && laid.registered.pinned.is_empty();
    let flip = match laid.way {
        LaidBy::Chart => from.registration().flip,
        LaidBy::Atlas(_) | LaidBy::Whole => Flip { u: laid.mirrored, v: false },
    };
    Ok(Mapped {
        mesh: Arc::new(mesh),
        part: Arc::new(part),
        constraints: laid.constraints,
        registration: laid.registered,
        flip,
        is_of_whole,
        folds: (folds as u64).saturating_sub(from.turned_there),
        distortion,
        verdict: match word {
            measure::Grade::Good => Verdict::Good,
            measure::Grade::Fair => Verdict::Fair,
            measure::Grade::Poor => Verdict::Poor,
        },
        reasons,
        stitched: None,
        reach: MapExtent::default(),
        evidence: None,
        sureness: None,
    })
}

/// The part of the query's surface that a map leaves out.
fn covered(example: &TriMesh, cross: &CrossMap, query: &Side) -> Result<Coverage, PipelineError> {
    let input = &*query.model;
    let searched = &query.encoded.query;
    let features = feature_points(&searched.encoding().features, &searched.chart, searched.index());
    Ok(coverage(example, cross, &input.patch(query.segment)?.mesh, &features))
}

/// Measures how a map distorts the example.
pub(crate) fn distortion(laid: &UnmeasuredMap<'_>, example: &Side) -> Result<measure::Distortion, PipelineError> {
    let model = &*example.model;
    let mesh = &model.patch(example.segment)?.mesh;
    Ok(measure::distortion(mesh, &laid.cross, laid.input, sign(laid.mirrored)))
}
