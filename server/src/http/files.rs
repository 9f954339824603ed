//! Answers that are files: meshes and pictures.

use super::error::HttpError;
use super::negotiate::{choose, has_tag, tagged};
use super::params::Params;
use super::upload::format_named;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use quadmuse_proto::MeshFormat;

/// How long a client may keep a file without asking again: never, but it may ask by `ETag`.
const CACHE: &str = "no-cache";

/// The format asked for: `?format=`, else `Accept`, else `default`.
///
/// # Errors
/// [`HttpError::BodyFormat`], [`HttpError::NotAcceptable`].
pub fn wanted_format(params: &Params, headers: &HeaderMap, default: MeshFormat) -> Result<MeshFormat, HttpError> {
    if let Some(name) = params.text("format")? {
        return format_named(name);
    }
    let mut offers = vec![(default.media_type(), default), ("application/octet-stream", default)];
    offers.extend(MeshFormat::ALL.map(|format| (format.media_type(), format)));
    choose(headers, &offers)
}

/// A mesh file, made only if the caller doesn't have it.
///
/// # Errors
/// Those of `make`.
pub async fn mesh_answer(
    format: MeshFormat,
    tag: &str,
    if_none_match: Option<&str>,
    name: &str,
    make: impl AsyncFnOnce() -> Result<Bytes, HttpError>,
) -> Result<Response, HttpError> {
    let body = if has_tag(if_none_match, tag) { Bytes::new() } else { make().await? };
    let mut response = tagged(body, format.media_type(), tag, if_none_match, CACHE);
    if let Ok(value) = HeaderValue::try_from(format!("attachment; filename=\"{name}.{format}\"")) {
        response.headers_mut().insert(header::CONTENT_DISPOSITION, value);
    }
    Ok(response)
}

/// A picture, drawn only if the caller doesn't have it.
///
/// # Errors
/// Those of `draw`.
pub async fn picture_answer(
    tag: &str,
    if_none_match: Option<&str>,
    draw: impl AsyncFnOnce() -> Result<Bytes, HttpError>,
) -> Result<Response, HttpError> {
    let body = if has_tag(if_none_match, tag) { Bytes::new() } else { draw().await? };
    Ok(tagged(body, "image/png", tag, if_none_match, CACHE))
}
