//! `/v1/queries/{id}/maps`: an example laid on the input.

use super::body::Message;
use super::error::HttpError;
use super::files::{picture_answer, result_answer};
use super::idempotency::Key;
use super::making;
use super::negotiate::{ResponsePreferences, if_none_match};
use super::params::{Params, PathIds};
use crate::app::App;
use crate::work::mapping::MapState;
use crate::work::query::LiveQuery;
use crate::work::{mapping, pictures};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::{
    ConstraintEdit, Making, MakingEvent, Map, MapId, MapOrMaking, MeshFormat, NewMap, Page, Product, QueryId,
};
use std::sync::Arc;

/// Maps an example onto the input, first finishing its registration if it was locked. Answered at once, unless `wait` is given.
#[utoipa::path(
    post, path = "/v1/queries/{id}/maps", tag = "maps",
    params(
        ("id" = QueryId, Path), ("Idempotency-Key" = Option<String>, Header),
        ("wait" = Option<f64>, Query, minimum = 0, maximum = 86400, description = "Seconds for which the answer is held until the map is there, at most 240; default 0. Who hangs up meanwhile cancels it"),
    ),
    request_body = NewMap,
    responses(
        (status = 201, description = "Mapped within `wait`; `location` is its address", body = Map),
        (status = 202, description = "It is being mapped; `location` is its address", body = Making),
    )
)]
pub async fn create(
    State(app): State<App>,
    wants: ResponsePreferences,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
    wanted: Message<NewMap>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let wait = making::wait(&params)?;
    let start = || mapping::start(&app.work, &live, wanted.value);
    let map = making::begun(&app, &live, (key, wanted.fingerprint), (Product::Map, wait), start).await?;
    making::created(
        &wants,
        &live,
        (Product::Map, map),
        mapping::get(&live, map).map(|map| map.newest().summary.clone()),
    )
}

/// Lists a query's maps that are there, newest last; the query itself lists those that are being made.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps", tag = "maps",
    params(("id" = QueryId, Path)),
    responses((status = 200, description = "All its maps", body = Page<Map>))
)]
pub async fn list(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(QueryId,)>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let items: Vec<Map> = live.maps().values().map(|map| map.newest().summary.clone()).collect();
    wants.show(&Page { items, next: None })
}

/// A map: its constraints, its distortion and whether it is worth keeping; or how far it is.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps/{map}", tag = "maps",
    params(
        ("id" = QueryId, Path), ("map" = MapId, Path),
        ("wait" = Option<f64>, Query, minimum = 0, maximum = 86400, description = "Seconds for which the answer is held until the map is there, at most 240; default 0"),
    ),
    responses((status = 200, description = "The map, whose `state` is `done`; or how far it is", body = MapOrMaking))
)]
pub async fn get(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    params: Params,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::waited(&live, Product::Map, &map, making::wait(&params)?).await;
    making::shown(&wants, &live, (Product::Map, map), mapping::get(&live, map).map(|map| map.newest().summary.clone()))
}

/// Cancels a map that is being made, and frees one that is there.
#[utoipa::path(
    delete, path = "/v1/queries/{id}/maps/{map}", tag = "maps",
    params(("id" = QueryId, Path), ("map" = MapId, Path)),
    responses((status = 204, description = "Cancelled, or freed"))
)]
pub async fn remove(
    State(app): State<App>,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
) -> Result<StatusCode, HttpError> {
    mapping::remove(&*app.work.queries.get(id)?, map)?;
    Ok(StatusCode::NO_CONTENT)
}

/// How a map gets further: `progress`, and `end` once.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps/{map}/stream", tag = "maps",
    params(("id" = QueryId, Path), ("map" = MapId, Path)),
    responses((status = 200, description = "Events, by `accept`: server-sent events, JSON lines or MessagePack objects", content(
        (MakingEvent = "text/event-stream"), (MakingEvent = "application/x-ndjson")
    )))
)]
pub async fn stream(
    State(app): State<App>,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    making::streamed(&app, &headers, &live, (Product::Map, map), mapping::get(&live, map))
}

/// A map, once it is there: whoever asks for what belongs to it needn't have waited.
async fn there(app: &App, id: QueryId, map: MapId) -> Result<(Arc<LiveQuery>, Arc<MapState>), HttpError> {
    let live = app.work.queries.get(id)?;
    making::waited(&live, Product::Map, &map, making::LONGEST).await;
    let newest = mapping::get(&live, map)?.newest();
    Ok((live, newest))
}

/// The example's mesh on the input: the same vertex order, faces, UVs and groups.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps/{map}/mesh", tag = "maps",
    params(
        ("id" = QueryId, Path), ("map" = MapId, Path),
        ("format" = Option<MeshFormat>, Query, description = "Else by Accept, else OBJ"),
        ("quads" = Option<u32>, Query, minimum = 6, maximum = 1000000, description = "With about so many faces: rows of quads are split or taken out; the layout's extraordinary vertices stay. Header `quadmuse-faces` tells how many there are"),
        ("tolerance" = Option<f64>, Query, minimum = 0.001, maximum = 100, description = "In place of `quads`: rows are split until 95 % of the mesh and of the scan are so near to each other, in % of the scan's diagonal. Header `quadmuse-within` tells how near they are")
    ),
    responses((status = 200, description = "The mesh", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn mesh(
    State(app): State<App>,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let (live, state) = there(&app, id, map).await?;
    let tag = format!("{map}-{}", state.summary.revision);
    result_answer(&app, &live, &state.mapped.mesh, (&params, &headers), (&tag, &map.to_string())).await
}

/// A shaded picture of the mapped mesh.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps/{map}/preview.png", tag = "maps",
    params(("id" = QueryId, Path), ("map" = MapId, Path), ("size" = Option<u32>, Query, minimum = 16, maximum = 1024, description = "Side in pixels; default 256")),
    responses((status = 200, description = "A picture", content_type = "image/png", body = Vec<u8>))
)]
pub async fn preview(
    State(app): State<App>,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let (live, state) = there(&app, id, map).await?;
    let size = params.get("size", "from 16 to 1024")?.unwrap_or(pictures::SIZE_DEFAULT);
    let tag = format!("\"{map}-{}-{size}\"", state.summary.revision);
    picture_answer(&tag, if_none_match(&headers).as_deref(), async || {
        Ok(pictures::preview(&app.work, live.caller.user, &state.mapped.mesh, size).await?)
    })
    .await
}

/// Moves, adds and removes constraints: all of the edit or nothing.
#[utoipa::path(
    patch, path = "/v1/queries/{id}/maps/{map}/constraints", tag = "maps",
    params(("id" = QueryId, Path), ("map" = MapId, Path)),
    request_body = ConstraintEdit,
    responses((status = 200, description = "The map now", body = Map))
)]
pub async fn constrain(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    edit: Message<ConstraintEdit>,
) -> Result<Response, HttpError> {
    let (live, _) = there(&app, id, map).await?;
    let state = mapping::constrain(&app.work, &live, map, edit.value).await?;
    wants.answer(StatusCode::OK, None, &state.summary)
}
