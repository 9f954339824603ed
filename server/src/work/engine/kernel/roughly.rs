//! Examples laid roughly, to choose among many.

use super::super::{Encoding, EngineError, Model, Rough, RoughLead};
use super::fitted::matched_tips;
use super::fresh;
use super::model::ModelInner;
use crate::pool::Stop;
use quadmuse_kernel::fit::rough::{Lead, Shape, rough};
use quadmuse_kernel::topology::{Patch, Topology};
use std::sync::Arc;

/// Ways to match tips that are tried, of either orientation.
const MATCHED: usize = 1;

/// Lays an example's segment on a query's; `None` where either has no caps.
pub(super) fn lay(
    (example, of_example): (&Model, u32),
    (query, of_query): (&Model, u32),
    encodings: Option<[&Encoding; 2]>,
    lead: Option<&RoughLead>,
    stop: &Stop,
) -> Result<Option<Rough>, EngineError> {
    let (own, on): (&ModelInner, &ModelInner) = (example.inner.open()?, query.inner.open()?);
    let (one, two) = (own.patch(of_example)?, on.patch(of_query)?);
    let (Some(example), Some(input)) = (shape(one), shape(two)) else { return Ok(None) };
    let tips = match encodings {
        Some([one, two]) => matched_tips([fresh(one)?, fresh(two)?], (example.mesh, input.mesh), MATCHED, stop),
        None => Vec::new(),
    };
    let leading: Option<&ModelInner> = lead.map(|lead| lead.model.inner.open()).transpose()?;
    let part = match (leading, lead) {
        (Some(leading), Some(lead)) => {
            Some(Lead { mesh: &leading.patch(lead.segment)?.mesh, places: lead.rough.places.as_slice() })
        }
        _ => None,
    };
    let found = rough(example, input, &tips, part, &|| stop.reason().is_some());
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
    Ok(found.map(|fit| Rough {
        agreement: fit.agreement,
        covered: fit.covered,
        off: fit.off,
        places: Arc::new(fit.places),
        mirrored: fit.mirrored,
    }))
}

fn shape(patch: &Patch) -> Option<Shape<'_>> {
    let is_closed = patch.topology == Topology::Sphere;
    (is_closed || patch.topology == Topology::Disc).then_some(Shape { mesh: &patch.mesh, is_closed })
}
