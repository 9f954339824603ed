//! `/v1/queries/{id}/retopos`: quads for all of a scan in one go.

use super::body::Message;
use super::error::HttpError;
use super::idempotency::Key;
use super::making;
use super::negotiate::ResponsePreferences;
use super::params::{Params, PathIds};
use crate::app::App;
use crate::work::retopo;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::{Making, MakingEvent, NewRetopo, Page, Product, QueryId, Retopo, RetopoId, RetopoOrMaking};

/// Makes quads for all of a scan: the best example on the whole, or else on its parts, for which the scan is cut and ranked
/// anew. The result is a map or a composition, of this query or of another of the same scan. Answered at once, unless `wait` is given.
#[utoipa::path(
    post, path = "/v1/queries/{id}/retopos", tag = "retopos",
    params(
        ("id" = QueryId, Path), ("Idempotency-Key" = Option<String>, Header),
        ("wait" = Option<f64>, Query, minimum = 0, maximum = 86400, description = "Seconds for which the answer is held until the retopology is there, at most 240; default 0. Who hangs up meanwhile cancels it"),
    ),
    request_body = NewRetopo,
    responses(
        (status = 201, description = "Made within `wait`; `location` is its address", body = Retopo),
        (status = 202, description = "It is being made; `location` is its address", body = Making),
    )
)]
pub async fn create(
    State(app): State<App>,
    wants: ResponsePreferences,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
    wanted: Message<NewRetopo>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let wait = making::wait(&params)?;
    let kept = (&app.kept, app.settings.upload_limit);
    let start = || retopo::start(&app.work, kept, &live, wanted.value);
    let made = making::begun(&app, &live, (key, wanted.fingerprint), (Product::Retopo, wait), start).await?;
    making::created(&wants, &live, (Product::Retopo, made), retopo::find(&live, made).map(|made| Retopo::clone(&made)))
}

/// Lists a query's retopologies that are there, newest last; the query itself lists those that are being made.
#[utoipa::path(
    get, path = "/v1/queries/{id}/retopos", tag = "retopos",
    params(("id" = QueryId, Path)),
    responses((status = 200, description = "All its retopologies", body = Page<Retopo>))
)]
pub async fn list(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(QueryId,)>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let items: Vec<Retopo> = live.retopos().values().map(|found| Retopo::clone(found)).collect();
    wants.show(&Page { items, next: None })
}

/// A retopology; or how far it is.
#[utoipa::path(
    get, path = "/v1/queries/{id}/retopos/{retopo}", tag = "retopos",
    params(
        ("id" = QueryId, Path), ("retopo" = RetopoId, Path),
        ("wait" = Option<f64>, Query, minimum = 0, maximum = 86400, description = "Seconds for which the answer is held until the retopology is there, at most 240; default 0"),
    ),
    responses((status = 200, description = "The retopology, whose `state` is `done`; or how far it is", body = RetopoOrMaking))
)]
pub async fn get(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id, retopo)): PathIds<(QueryId, RetopoId)>,
    params: Params,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::waited(&live, Product::Retopo, &retopo, making::wait(&params)?).await;
    making::shown(
        &wants,
        &live,
        (Product::Retopo, retopo),
        retopo::find(&live, retopo).map(|made| Retopo::clone(&made)),
    )
}

/// Cancels a retopology that is being made, and forgets one that is there; its map or composition stays.
#[utoipa::path(
    delete, path = "/v1/queries/{id}/retopos/{retopo}", tag = "retopos",
    params(("id" = QueryId, Path), ("retopo" = RetopoId, Path)),
    responses((status = 204, description = "Cancelled, or forgotten"))
)]
pub async fn remove(
    State(app): State<App>,
    PathIds((id, retopo)): PathIds<(QueryId, RetopoId)>,
) -> Result<StatusCode, HttpError> {
    retopo::remove(&*app.work.queries.get(id)?, retopo)?;
    Ok(StatusCode::NO_CONTENT)
}

/// How a retopology gets further: `progress`, and `end` once.
#[utoipa::path(
    get, path = "/v1/queries/{id}/retopos/{retopo}/stream", tag = "retopos",
    params(("id" = QueryId, Path), ("retopo" = RetopoId, Path)),
    responses((status = 200, description = "Events, by `accept`: server-sent events, JSON lines or MessagePack objects", content(
        (MakingEvent = "text/event-stream"), (MakingEvent = "application/x-ndjson")
    )))
)]
pub async fn stream(
    State(app): State<App>,
    PathIds((id, retopo)): PathIds<(QueryId, RetopoId)>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::streamed(&app, &headers, &live, (Product::Retopo, retopo), retopo::find(&live, retopo))
}
