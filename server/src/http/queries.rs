//! `/v1/queries`: input meshes while they are ranked, and after.

use super::body::Message;
use super::caller::RequestCaller;
use super::error::{HttpError, problem_of};
use super::files::{mesh_answer, wanted_format};
use super::forward::OtherServers;
use super::idempotency::{Key, Turn};
use super::making;
use super::negotiate::{ResponsePreferences, if_none_match};
use super::params::{Params, PathIds};
use super::upload::MeshUpload;
use crate::app::App;
use crate::work::query::{LiveQuery, QueryOptions};
use crate::work::{WorkError, ingest, naming, search};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::query::{RESOLUTION_DEFAULT, TOP_DEFAULT};
use quadmuse_proto::{ExampleId, Page, Query, QueryId, QueryPatch};
use std::sync::Arc;
use std::time::Duration;

/// Starts a query: the mesh in the body. It is ranked in the background.
#[utoipa::path(
    post, path = "/v1/queries", tag = "queries",
    params(
        ("top" = Option<u32>, Query, minimum = 1, maximum = 64, description = "Entries a segment that reach the full resolution; default 4"),
        ("tag" = Option<Vec<String>>, Query, description = "Rank only examples with this tag; may repeat"),
        ("resolution" = Option<u32>, Query, description = "32, 64, 128, 256 or 512; default 128"),
        ("deadline_ms" = Option<u64>, Query, minimum = 1, maximum = 3_600_000, description = "After this time the ranking so far is the answer"),
        ("segments" = Option<quadmuse_proto::Segmentation>, Query, description = "How to cut the mesh"),
        ("components" = Option<quadmuse_proto::Components>, Query, description = "What becomes of small components beside the largest"),
        ("parts" = Option<String>, Query, description = "Segments that automatic segmentation aims at: a number from 1 to 64, `auto`, one a protrusion, or `waist`, the two sides of the cut that is shortest for what it divides, as a figure and its base; without it, or with `none`, a primitive stays whole"),
        ("like" = Option<ExampleId>, Query, description = "Cut the mesh as this example is cut: segment k where segment k of the example would lie. In place of `segments` and `parts`"),
        ("format" = Option<quadmuse_proto::MeshFormat>, Query, description = "The body's format; else by Content-Type, else recognised"),
        ("upload" = Option<quadmuse_proto::UploadId>, Query, description = "An upload (`/v1/uploads`) that takes the place of the body; the headers say what it holds"),
        ("Idempotency-Key" = Option<String>, Header, description = "Sent again with the same key, nothing new is made"),
    ),
    request_body(content = Vec<u8>, description = "A mesh, or multipart/form-data with the parts `mesh` and `segments`", content_type = "application/octet-stream"),
    responses((status = 202, description = "Started; `location` is its address", body = Query))
)]
pub async fn start(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    wants: ResponsePreferences,
    key: Key,
    params: Params,
    mesh: MeshUpload,
) -> Result<Response, HttpError> {
    let claim = match app.idempotency.turn(key, mesh.fingerprint).await? {
        Turn::Made(id) => {
            let id = id.parse().map_err(|_| HttpError::Internal("a remembered id".into()))?;
            return accepted(&wants, &*app.work.queries.get(id)?);
        }
        Turn::Make(claim) => claim,
    };
    let options = QueryOptions {
        top: params.get("top", "from 1 to 64")?.unwrap_or(TOP_DEFAULT),
        resolution: params.get("resolution", "one of 32, 64, 128, 256, 512")?.unwrap_or(RESOLUTION_DEFAULT),
        deadline: params.get("deadline_ms", "from 1 to 3600000")?.map(Duration::from_millis),
        tags: params.all("tag"),
        like: params.get("like", "the id of an example")?,
    };
    let upload = mesh.upload.clone();
    let live = search::start(&app.work, caller, mesh.upload, options).await?;
    app.kept.keep(&app.work, &live, upload);
    claim.made(&live.id);
    accepted(&wants, &live)
}

/// Starts a query again, with what it was started with: another query, with an id of its own. For one that has ended, or whose
/// server is gone (`owner_gone`). Its segments have the names that they had. Uploads are kept for a day, while there is room.
#[utoipa::path(
    post, path = "/v1/queries/{id}/restart", tag = "queries",
    params(
        ("id" = QueryId, Path),
        ("Idempotency-Key" = Option<String>, Header, description = "Sent again with the same key, nothing new is made"),
    ),
    responses((status = 202, description = "Started; `location` is the address of the new query", body = Query))
)]
pub async fn restart(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    wants: ResponsePreferences,
    key: Key,
    PathIds((id,)): PathIds<(QueryId,)>,
) -> Result<Response, HttpError> {
    let claim = match app.idempotency.turn(key, blake3::hash(&id.to_bytes())).await? {
        Turn::Made(id) => {
            let id = id.parse().map_err(|_| HttpError::Internal("a remembered id".into()))?;
            return accepted(&wants, &*app.work.queries.get(id)?);
        }
        Turn::Make(claim) => claim,
    };
    let (upload, options) = app.kept.find(&app.work, caller, id, app.settings.upload_limit).await?;
    let names = app.kept.names(&app.work, id).await;
    let live = search::start(&app.work, caller, upload.clone(), options).await?;
    app.kept.keep(&app.work, &live, upload);
    if !names.is_empty() {
        naming::name_again(&app.work, &live, names);
        app.kept.keep_names(&app.work, &live);
    }
    claim.made(&live.id);
    accepted(&wants, &live)
}

fn accepted(wants: &ResponsePreferences, live: &LiveQuery) -> Result<Response, HttpError> {
    wants.answer(StatusCode::ACCEPTED, Some(format!("/v1/queries/{}", live.id)), &described(live))
}

/// A query as it goes over the wire, with the problem that ended it, if one did.
pub fn described(live: &LiveQuery) -> Query {
    let failure = live.board().failure;
    let problem = failure.map(|failure| problem_of(&HttpError::Work(WorkError::Query(failure))));
    let making = live.makings.all().iter().map(|making| making::described(live.id, making)).collect();
    Query { problem, making, ..live.describe() }
}

/// Lists the caller's queries that are held, by all servers that share the corpus, newest last; to an admin everybody's.
#[utoipa::path(
    get, path = "/v1/queries", tag = "queries",
    params(
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 500, description = "Queries a page; default 50"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses((status = 200, description = "A page", body = Page<Query>))
)]
pub async fn list(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    wants: ResponsePreferences,
    params: Params,
    others: OtherServers,
) -> Result<Response, HttpError> {
    let limit = params.page_limit()?;
    let after: Option<QueryId> = params.get("cursor", "as `next` gave it")?;
    let wanted = |live: &Arc<LiveQuery>| caller.sees(live.caller.user) && after.is_none_or(|after| live.id > after);
    let held: Vec<Arc<LiveQuery>> = app.work.queries.all().into_iter().filter(wanted).collect();
    let mut items: Vec<Query> = held.iter().take(limit).map(|live| described(live)).collect();
    let mut has_more = held.len() > limit;
    for page in others.answers::<Page<Query>>(&app).await {
        has_more |= page.next.is_some();
        items.extend(page.items);
    }
    items.sort_by_key(|query| query.id);
    has_more |= items.len() > limit;
    items.truncate(limit);
    let next = items.last().filter(|_| has_more).map(|last| last.id.to_string());
    wants.show(&Page { items, next })
}

/// Where a query stands.
#[utoipa::path(
    get, path = "/v1/queries/{id}", tag = "queries",
    params(("id" = QueryId, Path)),
    responses((status = 200, description = "The query", body = Query))
)]
pub async fn get(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(QueryId,)>,
) -> Result<Response, HttpError> {
    wants.show(&described(&*app.work.queries.get(id)?))
}

/// Names segments of a query, for all who look at it. They stay named where it is started again.
#[utoipa::path(
    patch, path = "/v1/queries/{id}", tag = "queries",
    params(("id" = QueryId, Path)),
    request_body = QueryPatch,
    responses((status = 200, description = "The query now", body = Query))
)]
pub async fn annotate(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(QueryId,)>,
    patch: Message<QueryPatch>,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    naming::name(&app.work, &live, patch.value.segments)?;
    app.kept.keep_names(&app.work, &live);
    wants.answer(StatusCode::OK, None, &described(&live))
}

/// Cancels a query and frees it; streams of it end with `cancelled`.
#[utoipa::path(
    delete, path = "/v1/queries/{id}", tag = "queries",
    params(("id" = QueryId, Path)),
    responses((status = 204, description = "Cancelled and freed"))
)]
pub async fn cancel(State(app): State<App>, PathIds((id,)): PathIds<(QueryId,)>) -> Result<StatusCode, HttpError> {
    search::cancel(&app.work, id)?;
    app.kept.remove(&app.work, id);
    Ok(StatusCode::NO_CONTENT)
}

/// The input as read, for viewers. As PLY each face tells its segment (`segment`), where there are several.
#[utoipa::path(
    get, path = "/v1/queries/{id}/mesh", tag = "queries",
    params(("id" = QueryId, Path), ("format" = Option<quadmuse_proto::MeshFormat>, Query, description = "Else by Accept, else OBJ")),
    responses((status = 200, description = "The mesh", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn mesh(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let format = wanted_format(&params, &headers, quadmuse_proto::MeshFormat::Obj)?;
    let tag = format!("\"{id}-{format}\"");
    mesh_answer(format, &tag, if_none_match(&headers).as_deref(), &id.to_string(), async || {
        Ok(ingest::input_file(&app.work, caller.user, &live.model, format).await?)
    })
    .await
}
