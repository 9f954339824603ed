//! From a mesh and chosen examples to a checked result, stage by stage.
//!
//! ```text
//! bytes ─model::read─▶ Model ─encode─▶ Encoded        a Model, a segment of it and its Encoded are a Side
//! Registration, example and query Side ─map, fit─▶ Mapped ─sound::check─▶ Mapped, with its verdict
//! Parts, one a segment ─stitch::compose─▶ Stitched ─sound::appraise─▶ Appraisal
//! ```
//!
//! Each stage takes and gives plain values: no stage knows of the wire, of a pool or of a store. A stage that is told to stop
//! ends with [`PipelineError::Stopped`].

mod around;
mod as_one;
pub mod constrain;
mod constraint;
mod continued;
mod cut;
mod error;
mod extruded;
mod finished;
mod fitted;
mod from_whole;
mod grouped;
mod mapped;
mod measured;
mod model;
mod notes;
mod of_segments;
mod parts;
mod registered;
mod rejoined;
mod roughly;
mod settled;
mod side;
mod sound;
mod spanned;
mod stitch;
mod stitched;
#[cfg(test)]
mod tests;
mod transfer;

pub use crate::fit::rough::RoughInput;
pub use crate::map::atlas::LimbDistances;
pub use around::around;
pub use as_one::split;
pub use constraint::{
    Constraint, ConstraintEdit, ConstraintOrigin, Landmark, LocatedPoint, NewConstraint, OnFold, Place,
};
pub use cut::{Cut, CutMethod, ExtraParts, Grain};
pub use error::{PipelineError, Refusal, Stop};
pub use fitted::{ranked_against, reaches};
pub use mapped::{Beyond, Covers, Fitted, Judgement, Lead, MapBeforeEdit, MapExtent, Mapped, Verdict, Wishes};
pub use model::{FACES_CHOSEN_MIN, FACES_OF_SCAN_MIN, Model, SEGMENTS_MAX, Segment, few, in_primitives, read};
pub use of_segments::of_segments;
pub use registered::Registered;
pub use rejoined::{OnePart, rejoin};
pub use roughly::{RoughLead, RoughPlacement, lay as rough, ready as ready_for_rough};
pub use side::{Encoded, SegmentFacts, Side, encode};
pub use sound::{AllowedFlaws, Appraisal, appraise};
pub use stitch::{Part, RegularMesh, StitchOptions, compose, template};
pub use stitched::{AS_MAPPED, LayoutOwner, Stitched};
pub use transfer::alike;

/// A map that leaves more of the scan bare than this is surrounded by other layouts in a composition: stitching can't be made to follow it.
pub const BARE_MIN: f64 = 0.05;

/// How each reason begins why a map leaves some of the scan bare.
pub const BARE: &str = "the rest of the scan is left bare";

/// Maps every vertex of the example's segment onto the query's by a registration of the two, and checks the result.
///
/// # Errors
/// [`PipelineError`].
pub fn map(from: &Registered, example: &Side, query: &Side, stop: Stop) -> Result<Mapped, PipelineError> {
    let mut mapped = registered::map(from, example, query, stop)?;
    sound::check(&mut mapped, query);
    Ok(mapped)
}

/// Lays an example's segment on the query's wherever it fits best, and checks the result. Rows of quads that break a map are
/// left out.
///
/// # Errors
/// [`PipelineError`].
pub fn fit(
    from: Option<&Registered>,
    example: &Side,
    query: &Side,
    wishes: &Wishes,
    stop: Stop,
) -> Result<Fitted, PipelineError> {
    let mut fitted = fitted::fit(from, example, query, wishes, stop)?;
    let own = continued::own(&fitted.mapped);
    sound::check(&mut fitted.mapped, query);
    if let (Verdict::Broken, Some(mut own)) = (fitted.mapped.verdict, own) {
        sound::check(&mut own, query);
        if own.verdict != Verdict::Broken {
            fitted.mapped = own;
        }
    }
    let missed = match wishes.beyond {
        Beyond::Extend => extruded::extrude(&mut fitted.mapped, query),
        Beyond::Leave => extruded::missed(&fitted.mapped, query),
    };
    let covers = &mut fitted.mapped.reach.covers;
    covers.input = (covers.input - missed).max(0.0);
    Ok(fitted)
}

/// Maps once more after an edit of the constraints of the map `before`, and checks the result.
///
/// # Errors
/// [`PipelineError`].
pub fn edited(
    from: &Registered,
    before: &MapBeforeEdit,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<Mapped, PipelineError> {
    let mut mapped = continued::edited(from, before, example, query, stop)?;
    sound::check(&mut mapped, query);
    if before.reach.unextruded.is_some() {
        extruded::extrude(&mut mapped, query);
    }
    Ok(mapped)
}
