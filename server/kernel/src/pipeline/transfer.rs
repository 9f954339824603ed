//! An input cut as an example is cut: the example is laid on it whole, and its parts go where the map takes them.

use super::error::{PipelineError, Refusal, Stop, internal};
use super::fitted::registration;
use super::model::{Model, WholeMap};
use super::registered;
use super::side::{Side, encode};
use crate::map::parted;
use crate::segment::Segmented;
use crate::topology::Components;
use std::sync::Arc;

/// The input `query`, cut as `example` is: segment k lies where segment k of the example does. `labels` tell the segment of each
/// face.
///
/// # Errors
/// [`Refusal::Unlike`] where either is no primitive when whole, or the parts would not be alike; [`PipelineError::Stopped`].
pub fn alike(query: &Model, example: &Arc<Model>, stop: Stop) -> Result<Model, PipelineError> {
    if example.segmented.parts.len() < 2 {
        let detail = "expected `like` to name an example of several segments, found one that is whole; \
                      leave `like` out, or add the example in parts alone";
        return Err(PipelineError::refused(Refusal::Unlike, detail));
    }
    let (one, two) = (whole(example, "the example")?, whole(query, "the input")?);
    let found = (one.segments()[0].topology, two.segments()[0].topology);
    if found.0 != found.1 {
        let detail = format!("expected an input that is a {} as the example is, found a {}", found.0, found.1);
        return Err(PipelineError::refused(Refusal::Unlike, detail));
    }
    let (one, two) = (side(one, stop)?, side(two, stop)?);
    let registration = registration(&one.encoded.query, &two.encoded.query, stop)?
        .ok_or_else(|| internal("expected surfaces of one topology"))?;
    let whole = registered::whole(&registration, &one, &two, stop)?;
    let patch = one.model.patch(0)?;
    let segmented = parted::alike(&example.segmented, patch, &whole.positions, &query.prepared.mesh).map_err(|e| {
        let detail = format!("the input can't be cut as the example is: {e}; have it cut without `like`");
        PipelineError::refused(Refusal::Unlike, detail)
    })?;
    let mut places = vec![None; example.segmented.mesh.positions.len()];
    patch.vertex_of.iter().zip(&whole.positions).for_each(|(&v, p)| places[v as usize] = Some(*p));
    let registered::LaidWhole { mesh, mirrored, cost, modulus_log, .. } = whole;
    let laid = Some(WholeMap { example: Arc::clone(example), mesh, places, mirrored, cost, modulus_log });
    let cut = Model { laid, ..query.recut(segmented, false) };
    let labels = Some(cut.face_labels(query.mesh.faces.len()));
    Ok(Model { labels, ..cut })
}

/// A model uncut.
fn whole(model: &Model, what: &str) -> Result<Model, PipelineError> {
    let segmented = Segmented::primitive(&model.prepared.mesh, Components::SmallLeftOut).map_err(|e| {
        let detail = format!("expected {what} to be a disc, annulus, sphere or torus when it is whole, found: {e}");
        PipelineError::refused(Refusal::Unlike, detail)
    })?;
    Ok(model.recut(segmented, false))
}

fn side(model: Model, stop: Stop) -> Result<Side, PipelineError> {
    let encoded = Arc::new(encode(&model, 0, stop)?);
    Ok(Side { model: Arc::new(model), segment: 0, encoded })
}
