//! `/v1/queries/{id}/ranking`: the ranking now, or as soon as there is a newer one.

use super::error::HttpError;
use super::negotiate::ResponsePreferences;
use super::params::{Params, PathIds};
use crate::app::App;
use axum::extract::State;
use axum::response::Response;
use quadmuse_proto::query::WAIT_MS_MAX;
use quadmuse_proto::ranking::ENTRIES_DEFAULT;
use quadmuse_proto::{QueryId, Ranking};
use std::time::Duration;

/// The ranking of a segment now; with `after` and `wait_ms`, as soon as its revision is greater than `after`, or the
/// query has ended, or the time is over.
#[utoipa::path(
    get, path = "/v1/queries/{id}/ranking", tag = "queries",
    params(
        ("id" = QueryId, Path),
        ("segment" = Option<u32>, Query, minimum = 0, description = "The query's segment; default 0"),
        ("after" = Option<u64>, Query, minimum = 0, description = "The revision that the caller has"),
        ("wait_ms" = Option<u64>, Query, minimum = 0, maximum = 60_000, description = "How long to wait for a newer one; default 0"),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 500, description = "Entries; default 200"),
    ),
    responses((status = 200, description = "The ranking", body = Ranking))
)]
pub async fn get(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let segment: u32 = params.get("segment", "a number")?.unwrap_or(0);
    let limit = params.limit(ENTRIES_DEFAULT)?;
    let after: Option<u64> = params.get("after", "a revision")?;
    let expected = format!("from 0 to {WAIT_MS_MAX}");
    let wait_ms: u64 = params.get("wait_ms", &expected)?.unwrap_or(0);
    if wait_ms > WAIT_MS_MAX {
        return Err(HttpError::parameter("wait_ms", expected, wait_ms));
    }
    // Says at once when there is no such segment.
    live.ranking(&live.board(), segment, 0)?;
    if let Some(after) = after
        && wait_ms > 0
    {
        let newer = live.wait_for(|board| board.rankings.get(segment as usize).is_some_and(|r| r.revision > after));
        tokio::select! {
            _ = newer => {}
            () = tokio::time::sleep(Duration::from_millis(wait_ms)) => {}
            () = app.stopping.cancelled() => {}
        }
    }
    wants.show(&live.ranking(&live.board(), segment, limit)?)
}
