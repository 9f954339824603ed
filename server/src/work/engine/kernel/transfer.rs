//! An input cut as an example is cut: the example is laid on it whole, and its parts go where the map takes them.

use super::super::{Engine, EngineError, Model, Opaque, Refusal, Side};
use super::model::{ModelInner, WholeMap};
use super::{KernelEngine, registered};
use crate::pool::Stop;
use quadmuse_kernel::map::parted;
use quadmuse_kernel::segment::Segmented;
use quadmuse_kernel::topology::Components;
use std::sync::Arc;

/// The finest level at which the two are registered, in pixels a side.
const SIDE: u32 = 128;

/// The input `query`, cut as `example` is.
pub(super) fn alike(engine: &KernelEngine, query: &Model, example: &Model, stop: &Stop) -> Result<Model, EngineError> {
    let (on, of): (&ModelInner, &ModelInner) = (query.inner.open()?, example.inner.open()?);
    if of.segmented.parts.len() < 2 {
        let detail = "expected `like` to name an example of several segments, found one that is whole; \
                      leave `like` out, or add the example in parts alone";
        return Err(EngineError::refused(Refusal::Unlike, detail));
    }
    let (one, two) = (whole(example, of, "the example")?, whole(query, on, "the input")?);
    let found = (one.segments[0].topology, two.segments[0].topology);
    if found.0 != found.1 {
        let detail = format!("expected an input that is a {} as the example is, found a {}", found.0, found.1);
        return Err(EngineError::refused(Refusal::Unlike, detail));
    }
    let sides = (side(engine, one, stop)?, side(engine, two, stop)?);
    let (first, second) = (&sides.0.encoded.encoding, &sides.1.encoded.encoding);
    let mut registration = registered::wholes(first, second, stop)?;
    while registration.level < SIDE {
        registration = engine.refine(&registration, first, second, stop)?;
    }
    let registration = engine.finish(&registration, first, second, stop)?;
    let whole = registered::whole(&registration, &sides.0, &sides.1, stop)?;
    let one: &ModelInner = sides.0.model.inner.open()?;
    let patch = one.patch(0)?;
    let segmented = parted::alike(&of.segmented, patch, &whole.positions, &on.prepared.mesh).map_err(|e| {
        let detail = format!("the input can't be cut as the example is: {e}; have it cut without `like`");
        EngineError::refused(Refusal::Unlike, detail)
    })?;
    let mut places = vec![None; of.segmented.mesh.positions.len()];
    patch.vertex_of.iter().zip(&whole.positions).for_each(|(&v, p)| places[v as usize] = Some(*p));
    let registered::Whole { mesh, mirrored, cost, modulus_log, .. } = whole;
    let laid = Some(WholeMap { example: example.clone(), mesh, places, mirrored, cost, modulus_log });
    let inner = ModelInner { prepared: on.prepared.clone(), segmented, parts: Vec::new(), laid, is_part: false };
    Ok(Model {
        segments: inner.segments(),
        labels: Some(inner.labels(query.mesh.faces.len())),
        inner: Opaque::new(inner),
        ..query.clone()
    })
}

/// A model uncut.
fn whole(model: &Model, inner: &ModelInner, what: &str) -> Result<Model, EngineError> {
    let segmented = Segmented::primitive(&inner.prepared.mesh, Components::Crumbs).map_err(|e| {
        let detail = format!("expected {what} to be a disc, annulus, sphere or torus when it is whole, found: {e}");
        EngineError::refused(Refusal::Unlike, detail)
    })?;
    let prepared = inner.prepared.clone();
    let inner = ModelInner { prepared, segmented, parts: Vec::new(), laid: None, is_part: false };
    Ok(Model { segments: inner.segments(), labels: None, inner: Opaque::new(inner), ..model.clone() })
}

fn side(engine: &KernelEngine, model: Model, stop: &Stop) -> Result<Side, EngineError> {
    let encoded = Arc::new(engine.encode(&model, 0, stop)?);
    Ok(Side { model: Arc::new(model), segment: 0, encoded })
}
