//! `name`: what the parts of a scan are called.

use crate::{
    api::Api,
    error::ClientError,
    names,
    spec::{Name, SegmentNameSpec},
    state::State,
    table,
    ui::Ui,
};
use quadmuse_proto::{QueryPatch, SegmentName};

pub(super) async fn name(
    query: &Name,
    given: &[SegmentNameSpec],
    api: &Api,
    state: &State,
    ui: &mut Ui,
) -> Result<(), ClientError> {
    let id = names::query(query, api, state).await?;
    let mut query = api.query(id).await?;
    if !given.is_empty() {
        let mut segments = Vec::with_capacity(given.len());
        for SegmentNameSpec { segment, name } in given {
            segments.push(SegmentName { segment: names::segment(segment, &query.segments)?, name: name.clone() });
        }
        query = api.patch_query(id, &QueryPatch { segments }).await?;
    }
    ui.value(&query)?;
    ui.text(&table::segments(&query, ui.room()))
}
