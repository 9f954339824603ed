//! A regular layout of all of a scan, in place of a composition that examples make worse than that.

use super::INSPIRED_LEAST;
use super::headline::{Headline, is_crumpled};
use super::sound::{MeasuredComposition, stitched_sound};
use super::waist;
use crate::pool::{Job, Lane, Stop, StopReason};
use crate::work::engine::{AllowedFlaws, Appraisal, Part, StitchOptions};
use crate::work::query::LiveQuery;
use crate::work::{REQUEST_TIME_MAX, Work, WorkError};
use quadmuse_proto::Verdict;
use std::ops::Range;
use std::sync::Arc;

/// A regular layout takes the place of a usable composition if no more than this share of the crumpled area is left. *Untuned.*
const SMOOTHER: f64 = 0.5;

/// Why a composition may be worse than a regular layout of all of the scan; `None` where nothing speaks for that.
pub(super) fn reason(composed: &Headline, appraisal: &Appraisal) -> Option<String> {
    if composed.inspired <= 0.0 {
        return Some("none of what was laid could be joined".into());
    }
    if composed.verdict >= Verdict::Poor || is_crumpled(appraisal) {
        return Some(composed.reasons.first().cloned().unwrap_or_else(|| "it is poor".into()));
    }
    (composed.inspired < INSPIRED_LEAST).then(|| makes_up(composed.inspired))
}

/// Tells the share that examples have.
pub(super) fn makes_up(share: f64) -> String {
    format!("they make up {:.0} % of it", 100.0 * share)
}

/// The note of a composition in place of which there is a regular layout.
pub(super) fn gave_way(reason: &str) -> String {
    format!("examples gave way to a regular layout of all of it: {reason}")
}

/// Regular layouts for some segments.
pub(super) async fn templates(live: &LiveQuery, segments: Range<u32>) -> Result<Vec<Part>, WorkError> {
    let mut parts = Vec::new();
    for segment in segments {
        parts.push(Part::Template(live.encoded(segment).await?));
    }
    Ok(parts)
}

/// The scan of a query in a regular layout, where that is sound and no worse than what examples made: beside what is `usable`, though
/// crumpled, half as crumpled. `None` where it takes more than half of a composition's time, too.
pub(super) async fn regular(
    work: &Arc<Work>,
    live: &LiveQuery,
    job: &Job,
    (composed, is_usable, how): (&MeasuredComposition, bool, StitchOptions),
) -> Result<Option<MeasuredComposition>, WorkError> {
    let job = job.renew(Some(REQUEST_TIME_MAX / 2));
    let (model, parts) = match live.model.is_waist {
        true => waist::in_primitives(work, live, &job).await?,
        false => {
            let parts = templates(live, 0..live.model.segments.len() as u32).await?;
            (Arc::clone(&live.model), parts)
        }
    };
    let engine = Arc::clone(&work.engine);
    let stitch =
        move |stop: &Stop| stitched_sound(&*engine, &model, (parts, &[]), (how, AllowedFlaws::default()), stop);
    match WorkError::joined(work.pool.run(&job, Lane::Lay, stitch).await) {
        Err(error) if error.stop_reason().is_some_and(|reason| reason != StopReason::Cancelled) => Ok(None),
        found => {
            let most = if is_usable { SMOOTHER * composed.appraisal.turned } else { f64::INFINITY };
            let is_better = |regular: &MeasuredComposition| {
                regular.is_layout_no_worse_than(composed) && regular.appraisal.turned <= most
            };
            Ok(Some(found?).filter(is_better))
        }
    }
}
