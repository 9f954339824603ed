//! Answers that are files: meshes and pictures.

use super::error::HttpError;
use super::negotiate::{choose, has_tag, if_none_match, tagged};
use super::params::Params;
use super::upload::format_named;
use crate::app::App;
use crate::work::engine::{PolyMesh, SizeTarget};
use crate::work::query::LiveQuery;
use crate::work::{ingest, resized};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use quadmuse_proto::MeshFormat;
use std::sync::Arc;

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

/// Most quads that a mesh may be asked for with, and fewest.
const QUADS: std::ops::RangeInclusive<usize> = 6..=1_000_000;

/// The size that a mesh is asked for in: `?quads=` or `?tolerance=`, in % of the scan's diagonal; `None`: as it is.
///
/// # Errors
/// [`HttpError::Parameter`].
pub fn wanted_size(params: &Params) -> Result<Option<SizeTarget>, HttpError> {
    let (of_quads, of_tolerance) = ("from 6 to 1000000", "in % of the scan's diagonal, from 0.001 to 100");
    let quads: Option<usize> = params.get("quads", of_quads)?;
    let tolerance: Option<f64> = params.get("tolerance", of_tolerance)?;
    match (quads, tolerance) {
        (Some(_), Some(tolerance)) => Err(HttpError::parameter("tolerance", "without `quads`", tolerance)),
        (Some(quads), None) if !QUADS.contains(&quads) => Err(HttpError::parameter("quads", of_quads, quads)),
        (None, Some(percent)) if !(0.001..=100.0).contains(&percent) => {
            Err(HttpError::parameter("tolerance", of_tolerance, percent))
        }
        (Some(quads), None) => Ok(Some(SizeTarget::Quads(quads))),
        (None, tolerance) => Ok(tolerance.map(|percent| SizeTarget::Within(percent / 100.0))),
    }
}

/// A result's mesh as a file, in the size that is asked for; made only if the caller doesn't have it. Of another size than its own
/// the headers `quadmuse-faces` and `quadmuse-within` tell how many faces it has, and its distance from the scan in % of the
/// diagonal.
///
/// # Errors
/// Refusals of the format and of the pool.
pub async fn result_answer(
    app: &App,
    live: &LiveQuery,
    mesh: &Arc<PolyMesh>,
    (params, headers): (&Params, &HeaderMap),
    (tag, name): (&str, &str),
) -> Result<Response, HttpError> {
    let (format, size) = (wanted_format(params, headers, MeshFormat::Obj)?, wanted_size(params)?);
    let if_none_match = if_none_match(headers);
    let Some(wanted) = size else {
        let tag = format!("\"{tag}-{format}\"");
        return mesh_answer(format, &tag, if_none_match.as_deref(), name, async || {
            Ok(ingest::mesh_file(&app.work, live.caller.user, mesh, format).await?)
        })
        .await;
    };
    let tag = match wanted {
        SizeTarget::Quads(count) => format!("\"{tag}-{format}-{count}\""),
        SizeTarget::Within(share) => format!("\"{tag}-{format}-within-{share}\""),
    };
    let mut size_made = None;
    let mut response = mesh_answer(format, &tag, if_none_match.as_deref(), name, async || {
        let made = resized::file(&app.work, live.caller.user, (&live.model, mesh), wanted, format).await?;
        size_made = Some((made.1, made.2));
        Ok(made.0)
    })
    .await?;
    if let Some((faces, within)) = size_made {
        response.headers_mut().insert("quadmuse-faces", HeaderValue::from(faces));
        if let Ok(within) = HeaderValue::try_from(format!("{within:.4}")) {
            response.headers_mut().insert("quadmuse-within", within);
        }
    }
    Ok(response)
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
