//! `/v1/samples`: meshes that the server makes by itself, so that a new corpus needs no files.

use super::error::HttpError;
use super::files::{mesh_answer, wanted_format};
use super::negotiate::{ResponsePreferences, if_none_match};
use super::params::{Params, PathIds};
use crate::demo::samples::{self, SampleFile};
use axum::http::HeaderMap;
use axum::response::Response;
use quadmuse_proto::{MeshFormat, Page, Sample};

/// Lists the samples: examples to add to a corpus, and scans to try it with.
#[utoipa::path(get, path = "/v1/samples", tag = "samples", responses((status = 200, description = "All of them", body = Page<Sample>)))]
pub async fn list(wants: ResponsePreferences) -> Result<Response, HttpError> {
    let describe = |(number, file): (u32, &SampleFile)| Sample {
        number,
        kind: file.kind,
        name: file.name.clone(),
        tags: file.tags.clone(),
        relevance: file.relevance,
        faces: file.faces,
    };
    wants.show(&Page { items: (0..).zip(files().await?).map(describe).collect::<Vec<_>>(), next: None })
}

/// The mesh of a sample, as OBJ.
#[utoipa::path(
    get, path = "/v1/samples/{number}/mesh", tag = "samples",
    params(("number" = u32, Path, minimum = 0, description = "Its number in the list")),
    responses((status = 200, description = "The mesh", content_type = "model/obj", body = Vec<u8>))
)]
pub async fn mesh(
    PathIds((number,)): PathIds<(u32,)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let none = || HttpError::NoRoute { path: format!("/v1/samples/{number}/mesh") };
    let file = files().await?.get(number as usize).ok_or_else(none)?;
    let format = wanted_format(&params, &headers, MeshFormat::Obj)?;
    if format != MeshFormat::Obj {
        let found = format.as_str().to_owned();
        return Err(HttpError::NotAcceptable { offered: MeshFormat::Obj.as_str().into(), found });
    }
    let tag = format!("\"{}\"", &blake3::hash(&file.bytes).to_hex()[..32]);
    let known = if_none_match(&headers);
    mesh_answer(format, &tag, known.as_deref(), &file.name, async || Ok(file.bytes.clone())).await
}

async fn files() -> Result<&'static [SampleFile], HttpError> {
    let made = tokio::task::spawn_blocking(samples::files).await;
    made.map_err(|_| HttpError::Internal("the samples could not be made".into()))
}
