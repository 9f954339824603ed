//! `/v1/queries/{id}/maps`: an example laid on the input.

use super::body::Message;
use super::error::HttpError;
use super::files::{mesh_answer, picture_answer, wanted_format};
use super::idempotency::{Key, Turn};
use super::negotiate::{Wants, if_none_match};
use super::params::{Params, PathIds};
use crate::app::App;
use crate::work::mapping::MapState;
use crate::work::{ingest, mapping, pictures};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::{ConstraintEdit, Map, MapId, MeshFormat, NewMap, Page, QueryId};

/// Maps an example onto the input, first finishing its registration if it was locked.
#[utoipa::path(
    post, path = "/v1/queries/{id}/maps", tag = "maps",
    params(("id" = QueryId, Path), ("Idempotency-Key" = Option<String>, Header)),
    request_body = NewMap,
    responses((status = 201, description = "Mapped; `location` is its address", body = Map))
)]
pub async fn create(
    State(app): State<App>,
    wants: Wants,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
    wanted: Message<NewMap>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let map = match app.idempotency.turn(key, wanted.fingerprint).await? {
        Turn::Made(made) => {
            let made = made.parse().map_err(|_| HttpError::Internal("a remembered id".into()))?;
            mapping::get(&live, made)?
        }
        Turn::Make(claim) => {
            let map = mapping::create(&app.work, &live, wanted.value).await?;
            claim.made(&map.id);
            map
        }
    };
    let location = format!("/v1/queries/{id}/maps/{}", map.id);
    wants.answer(StatusCode::CREATED, Some(location), &map.newest().summary)
}

/// Lists a query's maps, newest last.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps", tag = "maps",
    params(("id" = QueryId, Path)),
    responses((status = 200, description = "All its maps", body = Page<Map>))
)]
pub async fn list(
    State(app): State<App>,
    wants: Wants,
    PathIds((id,)): PathIds<(QueryId,)>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let items: Vec<Map> = live.maps().values().map(|map| map.newest().summary.clone()).collect();
    wants.show(&Page { items, next: None })
}

/// A map: its constraints, its distortion and whether it is worth keeping.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps/{map}", tag = "maps",
    params(("id" = QueryId, Path), ("map" = MapId, Path)),
    responses((status = 200, description = "The map", body = Map))
)]
pub async fn get(
    State(app): State<App>,
    wants: Wants,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
) -> Result<Response, HttpError> {
    wants.show(&newest(&app, id, map)?.summary)
}

fn newest(app: &App, id: QueryId, map: MapId) -> Result<std::sync::Arc<MapState>, HttpError> {
    Ok(mapping::get(&*app.work.queries.get(id)?, map)?.newest())
}

/// The example's mesh on the input: the same vertex order, faces, UVs and groups.
#[utoipa::path(
    get, path = "/v1/queries/{id}/maps/{map}/mesh", tag = "maps",
    params(("id" = QueryId, Path), ("map" = MapId, Path), ("format" = Option<MeshFormat>, Query, description = "Else by Accept, else OBJ")),
    responses((status = 200, description = "The mesh", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn mesh(
    State(app): State<App>,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let (user, state) = (app.work.queries.get(id)?.caller.user, newest(&app, id, map)?);
    let format = wanted_format(&params, &headers, MeshFormat::Obj)?;
    let tag = format!("\"{map}-{}-{format}\"", state.summary.revision);
    mesh_answer(format, &tag, if_none_match(&headers).as_deref(), &map.to_string(), async || {
        Ok(ingest::mesh_file(&app.work, user, &state.mapped.mesh, format).await?)
    })
    .await
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
    let (user, state) = (app.work.queries.get(id)?.caller.user, newest(&app, id, map)?);
    let size = params.get("size", "from 16 to 2048")?.unwrap_or(pictures::SIZE_DEFAULT);
    let tag = format!("\"{map}-{}-{size}\"", state.summary.revision);
    picture_answer(&tag, if_none_match(&headers).as_deref(), async || {
        Ok(pictures::preview(&app.work, user, &state.mapped.mesh, size).await?)
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
    wants: Wants,
    PathIds((id, map)): PathIds<(QueryId, MapId)>,
    edit: Message<ConstraintEdit>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let state = mapping::constrain(&app.work, &live, map, edit.value).await?;
    wants.answer(StatusCode::OK, None, &state.summary)
}
