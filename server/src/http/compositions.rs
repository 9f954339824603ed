//! `/v1/queries/{id}/compositions`: the maps of a query, stitched into one mesh of quads.

use super::body::Message;
use super::error::HttpError;
use super::files::{picture_answer, result_answer};
use super::idempotency::Key;
use super::making;
use super::negotiate::{ResponsePreferences, if_none_match};
use super::params::{Params, PathIds};
use crate::app::App;
use crate::work::composing::LiveComposition;
use crate::work::query::LiveQuery;
use crate::work::{composing, pictures};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::{
    Composition, CompositionId, CompositionOrMaking, Making, MakingEvent, MeshFormat, NewComposition, Page, Product,
    QueryId,
};
use std::sync::Arc;

/// Stitches maps of a query. Answered at once, unless `wait` is given.
#[utoipa::path(
    post, path = "/v1/queries/{id}/compositions", tag = "compositions",
    params(
        ("id" = QueryId, Path), ("Idempotency-Key" = Option<String>, Header),
        ("wait" = Option<f64>, Query, minimum = 0, maximum = 86400, description = "Seconds for which the answer is held until the composition is there, at most 240; default 0. Who hangs up meanwhile cancels it"),
    ),
    request_body = NewComposition,
    responses(
        (status = 201, description = "Stitched within `wait`; `location` is its address", body = Composition),
        (status = 202, description = "It is being stitched; `location` is its address", body = Making),
    )
)]
pub async fn create(
    State(app): State<App>,
    wants: ResponsePreferences,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
    wanted: Message<NewComposition>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let wait = making::wait(&params)?;
    let start = || composing::start(&app.work, &live, wanted.value);
    let composition =
        making::begun(&app, &live, (key, wanted.fingerprint), (Product::Composition, wait), start).await?;
    making::created(
        &wants,
        &live,
        (Product::Composition, composition),
        composing::find(&live, composition).map(|found| found.summary.clone()),
    )
}

/// Lists a query's compositions that are there, newest last; the query itself lists those that are being made.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions", tag = "compositions",
    params(("id" = QueryId, Path)),
    responses((status = 200, description = "All its compositions", body = Page<Composition>))
)]
pub async fn list(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(QueryId,)>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let items: Vec<Composition> = live.compositions().values().map(|found| found.summary.clone()).collect();
    wants.show(&Page { items, next: None })
}

/// A composition, in numbers; or how far it is.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions/{composition}", tag = "compositions",
    params(
        ("id" = QueryId, Path), ("composition" = CompositionId, Path),
        ("wait" = Option<f64>, Query, minimum = 0, maximum = 86400, description = "Seconds for which the answer is held until the composition is there, at most 240; default 0"),
    ),
    responses((status = 200, description = "The composition, whose `state` is `done`; or how far it is", body = CompositionOrMaking))
)]
pub async fn get(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
    params: Params,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::waited(&live, Product::Composition, &composition, making::wait(&params)?).await;
    making::shown(
        &wants,
        &live,
        (Product::Composition, composition),
        composing::find(&live, composition).map(|found| found.summary.clone()),
    )
}

/// Cancels a composition that is being made, and frees one that is there.
#[utoipa::path(
    delete, path = "/v1/queries/{id}/compositions/{composition}", tag = "compositions",
    params(("id" = QueryId, Path), ("composition" = CompositionId, Path)),
    responses((status = 204, description = "Cancelled, or freed"))
)]
pub async fn remove(
    State(app): State<App>,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
) -> Result<StatusCode, HttpError> {
    composing::remove(&*app.work.queries.get(id)?, composition)?;
    Ok(StatusCode::NO_CONTENT)
}

/// How a composition gets further: `progress`, and `end` once.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions/{composition}/stream", tag = "compositions",
    params(("id" = QueryId, Path), ("composition" = CompositionId, Path)),
    responses((status = 200, description = "Events, by `accept`: server-sent events, JSON lines or MessagePack objects", content(
        (MakingEvent = "text/event-stream"), (MakingEvent = "application/x-ndjson")
    )))
)]
pub async fn stream(
    State(app): State<App>,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::streamed(&app, &headers, &live, (Product::Composition, composition), composing::find(&live, composition))
}

/// A composition, once it is there: whoever asks for what belongs to it needn't have waited.
async fn there(
    app: &App,
    id: QueryId,
    composition: CompositionId,
) -> Result<(Arc<LiveQuery>, Arc<LiveComposition>), HttpError> {
    let live = app.work.queries.get(id)?;
    making::waited(&live, Product::Composition, &composition, making::LONGEST).await;
    let found = composing::find(&live, composition)?;
    Ok((live, found))
}

/// The stitched mesh.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions/{composition}/mesh", tag = "compositions",
    params(
        ("id" = QueryId, Path), ("composition" = CompositionId, Path),
        ("format" = Option<MeshFormat>, Query, description = "Else by Accept, else OBJ"),
        ("quads" = Option<u32>, Query, minimum = 6, maximum = 1000000, description = "With about so many faces: rows of quads are split or taken out; the layout's extraordinary vertices stay. Header `quadmuse-faces` tells how many there are"),
        ("tolerance" = Option<f64>, Query, minimum = 0.001, maximum = 100, description = "In place of `quads`: rows are split until 95 % of the mesh and of the scan are so near to each other, in % of the scan's diagonal. Header `quadmuse-within` tells how near they are")
    ),
    responses((status = 200, description = "The mesh", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn mesh(
    State(app): State<App>,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let (live, found) = there(&app, id, composition).await?;
    let name = composition.to_string();
    result_answer(&app, &live, &found.mesh, (&params, &headers), (&name, &name)).await
}

/// A shaded picture of the stitched mesh.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions/{composition}/preview.png", tag = "compositions",
    params(
        ("id" = QueryId, Path), ("composition" = CompositionId, Path),
        ("size" = Option<u32>, Query, minimum = 16, maximum = 1024, description = "Side in pixels; default 256")
    ),
    responses((status = 200, description = "A picture", content_type = "image/png", body = Vec<u8>))
)]
pub async fn preview(
    State(app): State<App>,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let (live, found) = there(&app, id, composition).await?;
    let size = params.get("size", "from 16 to 1024")?.unwrap_or(pictures::SIZE_DEFAULT);
    let tag = format!("\"{composition}-{size}\"");
    picture_answer(&tag, if_none_match(&headers).as_deref(), async || {
        Ok(pictures::preview(&app.work, live.caller.user, &found.mesh, size).await?)
    })
    .await
}
