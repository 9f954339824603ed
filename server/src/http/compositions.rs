//! `/v1/queries/{id}/compositions`: the maps of a query, stitched into one mesh of quads.

use super::body::Message;
use super::error::HttpError;
use super::files::{mesh_answer, picture_answer, wanted_format};
use super::idempotency::{Key, Turn};
use super::negotiate::{Wants, if_none_match};
use super::params::{Params, PathIds};
use crate::app::App;
use crate::work::{composing, ingest, pictures};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::{Composition, CompositionId, MeshFormat, NewComposition, QueryId};

/// Stitches maps of a query.
#[utoipa::path(
    post, path = "/v1/queries/{id}/compositions", tag = "compositions",
    params(("id" = QueryId, Path), ("Idempotency-Key" = Option<String>, Header)),
    request_body = NewComposition,
    responses((status = 201, description = "Stitched; `location` is its address", body = Composition))
)]
pub async fn create(
    State(app): State<App>,
    wants: Wants,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
    wanted: Message<NewComposition>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let composition = match app.idempotency.turn(key, wanted.fingerprint).await? {
        Turn::Made(made) => {
            let made = made.parse().map_err(|_| HttpError::Internal("a remembered id".into()))?;
            composing::find(&live, made)?
        }
        Turn::Make(claim) => {
            let composition = composing::create(&app.work, &live, wanted.value).await?;
            claim.made(&composition.summary.id);
            composition
        }
    };
    let location = format!("/v1/queries/{id}/compositions/{}", composition.summary.id);
    wants.answer(StatusCode::CREATED, Some(location), &composition.summary)
}

/// A composition, in numbers.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions/{composition}", tag = "compositions",
    params(("id" = QueryId, Path), ("composition" = CompositionId, Path)),
    responses((status = 200, description = "The composition", body = Composition))
)]
pub async fn get(
    State(app): State<App>,
    wants: Wants,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
) -> Result<Response, HttpError> {
    wants.show(&composing::find(&*app.work.queries.get(id)?, composition)?.summary)
}

/// The stitched mesh.
#[utoipa::path(
    get, path = "/v1/queries/{id}/compositions/{composition}/mesh", tag = "compositions",
    params(
        ("id" = QueryId, Path), ("composition" = CompositionId, Path),
        ("format" = Option<MeshFormat>, Query, description = "Else by Accept, else OBJ")
    ),
    responses((status = 200, description = "The mesh", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn mesh(
    State(app): State<App>,
    PathIds((id, composition)): PathIds<(QueryId, CompositionId)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let found = composing::find(&live, composition)?;
    let format = wanted_format(&params, &headers, MeshFormat::Obj)?;
    let (tag, name) = (format!("\"{composition}-{format}\""), composition.to_string());
    mesh_answer(format, &tag, if_none_match(&headers).as_deref(), &name, async || {
        Ok(ingest::mesh_file(&app.work, live.caller.user, &found.mesh, format).await?)
    })
    .await
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
    let live = app.work.queries.get(id)?;
    let found = composing::find(&live, composition)?;
    let size = params.get("size", "from 16 to 1024")?.unwrap_or(pictures::SIZE_DEFAULT);
    let tag = format!("\"{composition}-{size}\"");
    picture_answer(&tag, if_none_match(&headers).as_deref(), async || {
        Ok(pictures::preview(&app.work, live.caller.user, &found.mesh, size).await?)
    })
    .await
}
