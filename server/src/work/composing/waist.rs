//! Compositions of scans that were cut at their waist, such as a figure and its base.
//!
//! One side's map is laid out around, as a map is that covers a part of a scan of one segment: the sides are no pieces that could be
//! stitched, since what closes their openings is no surface.

use crate::pool::{Job, Lane};
use crate::work::engine::{Encoded, Model, Part};
use crate::work::ingest::encode;
use crate::work::laying;
use crate::work::mapping::LiveMap;
use crate::work::query::LiveQuery;
use crate::work::{Work, WorkError};
use std::sync::Arc;

/// The maps of both sides, first that which is worth most for the share of the scan that its side is.
pub(super) fn by_worth(model: &Model, maps: &[Option<Arc<LiveMap>>]) -> Vec<Arc<LiveMap>> {
    let worth = |map: &LiveMap| {
        model.segments.get(map.segment as usize).map_or(0.0, |side| side.faces as f64) * laying::worth(map)
    };
    let mut there: Vec<Arc<LiveMap>> = maps.iter().flatten().cloned().collect();
    there.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
    there
}

/// The scan of a query cut into primitives instead, each of which takes a regular layout: what is left where no map can be laid out
/// around.
pub(super) async fn in_primitives(
    work: &Arc<Work>,
    live: &LiveQuery,
    job: &Job,
) -> Result<(Arc<Model>, Vec<Part>), WorkError> {
    let (engine, model) = (Arc::clone(&work.engine), Arc::clone(&live.model));
    let cut = Arc::new(work.pool.run(job, Lane::Lay, move |_| engine.recut(&model)).await??);
    let mut parts = Vec::new();
    for segment in 0..cut.segments.len() as u32 {
        let encoded: Encoded = encode(work, job, Lane::Lay, &cut, segment).await?;
        parts.push(Part::Template(Arc::new(encoded)));
    }
    Ok((cut, parts))
}
