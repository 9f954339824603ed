//! `/v1/queries/{id}/retopos`: quads for all of a scan in one go.

use super::body::Message;
use super::error::HttpError;
use super::idempotency::{Key, Turn};
use super::making;
use super::negotiate::Wants;
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
    wants: Wants,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
    wanted: Message<NewRetopo>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let wait = making::wait(&params)?;
    let made = match app.idempotency.turn(key, wanted.fingerprint).await? {
        Turn::Made(made) => {
            let made = made.parse().map_err(|_| HttpError::Internal("a remembered id".into()))?;
            making::waited(&live, Product::Retopo, &made, wait).await;
            made
        }
        Turn::Make(claim) => {
            let kept = (&app.kept, app.settings.upload_limit);
            let (made, making) = retopo::start(&app.work, kept, &live, wanted.value)?;
            making::awaited(&live, &making, wait).await?;
            claim.made(&made);
            made
        }
    };
    let location = Some(format!("/v1/queries/{id}/retopos/{made}"));
    match retopo::find(&live, made) {
        Ok(found) => wants.answer(StatusCode::CREATED, location, &*found),
        Err(missing) => {
            let making = making::found(&live, Product::Retopo, &made).ok_or(missing)?;
            wants.answer(StatusCode::ACCEPTED, location, &making)
        }
    }
}

/// Lists a query's retopologies that are there, newest last; the query itself lists those that are being made.
#[utoipa::path(
    get, path = "/v1/queries/{id}/retopos", tag = "retopos",
    params(("id" = QueryId, Path)),
    responses((status = 200, description = "All its retopologies", body = Page<Retopo>))
)]
pub async fn list(
    State(app): State<App>,
    wants: Wants,
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
    wants: Wants,
    PathIds((id, retopo)): PathIds<(QueryId, RetopoId)>,
    params: Params,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::waited(&live, Product::Retopo, &retopo, making::wait(&params)?).await;
    match retopo::find(&live, retopo) {
        Ok(found) => wants.show(&*found),
        Err(missing) => wants.show(&making::found(&live, Product::Retopo, &retopo).ok_or(missing)?),
    }
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
    match live.makings.get(Product::Retopo, &retopo.to_string()) {
        Some(making) => making::stream(&app, &headers, id, &making),
        None => {
            let found = retopo::find(&live, retopo)?;
            making::ended(&headers, id, Product::Retopo, found.id.to_string())
        }
    }
}
