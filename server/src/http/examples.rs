//! `/v1/examples`: the meshes of the corpus.

use super::body::Message;
use super::caller::RequestCaller;
use super::error::HttpError;
use super::files::{mesh_answer, picture_answer, wanted_format};
use super::idempotency::{Key, Turn};
use super::negotiate::{ResponsePreferences, if_none_match};
use super::params::{Params, PathIds};
use super::upload::MeshUpload;
use crate::app::App;
use crate::work::corpus::PutOutcome;
use crate::work::engine::Cut;
use crate::work::ingest::{Faces, Upload};
use crate::work::{ingest, pictures};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use quadmuse_proto::{Example, ExampleId, ExamplePatch, Page, Topology, segment::Parts};
use std::sync::Arc;

/// Adds an example: the mesh in the body. Durable when answered.
#[utoipa::path(
    post, path = "/v1/examples", tag = "examples",
    params(
        ("name" = Option<String>, Query, description = "A name, for people"),
        ("tag" = Option<Vec<String>>, Query, description = "A tag; may repeat"),
        ("relevance" = Option<f64>, Query, minimum = 0, maximum = 5, description = "How good it is; default 3"),
        ("segments" = Option<quadmuse_proto::Segmentation>, Query, description = "How to cut the mesh"),
        ("components" = Option<quadmuse_proto::Components>, Query, description = "What becomes of small components beside the largest"),
        ("parts" = Option<String>, Query, description = "Segments that automatic segmentation aims at: a number from 1 to 64, or `auto`, one a protrusion; without it a mesh that is one primitive is kept whole, as segment 0, and by its parts, as segments 1 and up; `none` keeps it whole alone"),
        ("format" = Option<quadmuse_proto::MeshFormat>, Query, description = "The body's format; else by Content-Type, else recognised"),
        ("upload" = Option<quadmuse_proto::UploadId>, Query, description = "An upload (`/v1/uploads`) that takes the place of the body; the headers say what it holds"),
        ("Idempotency-Key" = Option<String>, Header, description = "Sent again with the same key, nothing new is made"),
    ),
    request_body(content = Vec<u8>, description = "A mesh, or multipart/form-data with the parts `mesh` and `segments`", content_type = "application/octet-stream"),
    responses((status = 201, description = "Added", body = Example), (status = 200, description = "It was there already", body = Example))
)]
pub async fn add(
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
            return answer(&wants, StatusCode::OK, &*app.work.catalogue.example(id)?);
        }
        Turn::Make(claim) => claim,
    };
    let annotation = ingest::Annotation {
        name: params.text("name")?.unwrap_or_default().into(),
        tags: params.all("tag"),
        relevance: params.get("relevance", "from 0 to 5")?.unwrap_or(ingest::RELEVANCE_DEFAULT),
    };
    if mesh.upload.cut.parts == Some(Parts::Waist) {
        return Err(HttpError::parameter(
            "parts",
            "auto, none, or a number: an example is not cut at its waist",
            "waist",
        ));
    }
    let upload = Upload { cut: Cut { besides: mesh.besides, ..mesh.upload.cut }, ..mesh.upload };
    let (example, put) = ingest::add(&app.work, caller, upload, annotation).await?;
    claim.made(&example.id);
    let status = match put {
        PutOutcome::Added => StatusCode::CREATED,
        PutOutcome::There => StatusCode::OK,
    };
    answer(&wants, status, &example)
}

fn answer(wants: &ResponsePreferences, status: StatusCode, example: &Example) -> Result<Response, HttpError> {
    wants.answer(status, Some(format!("/v1/examples/{}", example.id)), example)
}

/// Lists the corpus in order of creation.
#[utoipa::path(
    get, path = "/v1/examples", tag = "examples",
    params(
        ("tag" = Option<Vec<String>>, Query, description = "Only examples with this tag; may repeat"),
        ("topology" = Option<Topology>, Query, description = "Only examples with such a segment; parts of one that is there whole don't count"),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 500, description = "Examples a page; default 50"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses((status = 200, description = "A page", body = Page<Example>))
)]
pub async fn list(State(app): State<App>, wants: ResponsePreferences, params: Params) -> Result<Response, HttpError> {
    let (limit, tags) = (params.page_limit()?, params.all("tag"));
    let topology: Option<Topology> = params.get("topology", "disc, annulus, sphere or torus")?;
    let after: Option<ExampleId> = params.get("cursor", "as `next` gave it")?;
    let snapshot = app.work.catalogue.snapshot();
    let fits = |example: &&Arc<Example>| {
        tags.iter().all(|tag| example.tags.contains(tag))
            && topology.is_none_or(|t| example.segments.iter().any(|s| s.topology == t && !s.is_part))
    };
    let mut items: Vec<Example> =
        snapshot.examples_after(after).filter(fits).take(limit + 1).map(|example| (**example).clone()).collect();
    let more = items.len() > limit;
    items.truncate(limit);
    let next = items.last().filter(|_| more).map(|last| last.id.to_string());
    wants.show(&Page { items, next })
}

/// Reads an example.
#[utoipa::path(
    get, path = "/v1/examples/{id}", tag = "examples",
    params(("id" = ExampleId, Path)),
    responses((status = 200, description = "The example", body = Example))
)]
pub async fn get(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(ExampleId,)>,
) -> Result<Response, HttpError> {
    wants.show(&*app.work.catalogue.example(id)?)
}

/// Annotates an example: what is absent stays as it is.
#[utoipa::path(
    patch, path = "/v1/examples/{id}", tag = "examples",
    params(("id" = ExampleId, Path)),
    request_body = ExamplePatch,
    responses((status = 200, description = "The example now", body = Example))
)]
pub async fn annotate(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(ExampleId,)>,
    patch: Message<ExamplePatch>,
) -> Result<Response, HttpError> {
    wants.answer(StatusCode::OK, None, &*ingest::annotate(&app.work, caller, id, patch.value).await?)
}

/// Removes an example.
#[utoipa::path(
    delete, path = "/v1/examples/{id}", tag = "examples",
    params(("id" = ExampleId, Path)),
    responses((status = 204, description = "Removed"))
)]
pub async fn remove(State(app): State<App>, PathIds((id,)): PathIds<(ExampleId,)>) -> Result<StatusCode, HttpError> {
    ingest::remove(&app.work, id).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// The mesh as uploaded, or in another format.
#[utoipa::path(
    get, path = "/v1/examples/{id}/mesh", tag = "examples",
    params(
        ("id" = ExampleId, Path),
        ("format" = Option<quadmuse_proto::MeshFormat>, Query, description = "Else by Accept, else as uploaded"),
        ("labels" = Option<bool>, Query, description = "Each face tells the segment that it is of, as the property `segment` of a PLY file; 0 for what is of no part of an example that is there whole"),
    ),
    responses((status = 200, description = "The mesh", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn mesh(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id,)): PathIds<(ExampleId,)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let example = app.work.catalogue.example(id)?;
    let format = wanted_format(&params, &headers, example.format.parse().unwrap_or_default())?;
    let (faces, labelled) = match params.get::<bool>("labels", "true or false")? {
        Some(true) => (Faces::Labelled, "-labels"),
        Some(false) | None => (Faces::Plain, ""),
    };
    let tag = format!("\"{}-{format}{labelled}\"", example.hash);
    mesh_answer(format, &tag, if_none_match(&headers).as_deref(), &id.to_string(), async || {
        Ok(ingest::mesh(&app.work, caller, id, (format, faces)).await?)
    })
    .await
}

/// A shaded picture with the example's quads.
#[utoipa::path(
    get, path = "/v1/examples/{id}/thumbnail.png", tag = "examples",
    params(
        ("id" = ExampleId, Path),
        ("size" = Option<u32>, Query, minimum = 16, maximum = 1024, description = "Side in pixels; default 256"),
        ("segment" = Option<u32>, Query, minimum = 0, description = "A segment that stands out from the rest"),
    ),
    responses((status = 200, description = "A picture", content_type = "image/png", body = Vec<u8>))
)]
pub async fn thumbnail(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id,)): PathIds<(ExampleId,)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let size = params.get("size", "from 16 to 1024")?.unwrap_or(pictures::SIZE_DEFAULT);
    let segment = params.get("segment", "the number of a segment")?;
    let of = segment.map(|segment: u32| format!("-{segment}")).unwrap_or_default();
    let tag = format!("\"{}-{size}{of}\"", app.work.catalogue.example(id)?.hash);
    picture_answer(&tag, if_none_match(&headers).as_deref(), async || {
        Ok(pictures::thumbnail(&app.work, caller, id, (size, segment)).await?)
    })
    .await
}

/// λ of a segment as a picture, with its features.
#[utoipa::path(
    get, path = "/v1/examples/{id}/segments/{segment}/encoding.png", tag = "examples",
    params(
        ("id" = ExampleId, Path), ("segment" = u32, Path, minimum = 0),
        ("level" = Option<u32>, Query, description = "32, 64, 128, 256 or 512 pixels a side; default 128")
    ),
    responses((status = 200, description = "A picture", content_type = "image/png", body = Vec<u8>))
)]
pub async fn encoding(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id, segment)): PathIds<(ExampleId, u32)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let level =
        params.get("level", "one of 32, 64, 128, 256, 512")?.unwrap_or(quadmuse_proto::query::RESOLUTION_DEFAULT);
    let hash = app.work.catalogue.example(id)?.hash.clone();
    let tag = format!("\"{hash}-{segment}-{level}-{}\"", app.work.engine.version());
    picture_answer(&tag, if_none_match(&headers).as_deref(), async || {
        Ok(pictures::encoding(&app.work, caller, id, segment, level).await?)
    })
    .await
}
