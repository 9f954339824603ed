//! `/v1/uploads`: files that are sent piece by piece, and go on after a broken connection.
//!
//! *Source:* tus 1.0.0, <https://tus.io/protocols/resumable-upload>: the core and its extensions creation, expiration, termination.
//! *Ours:* a resource that takes a mesh takes `?upload=ID` in place of a body; `X-HTTP-Method-Override` is not read.

use super::body::{ArrivingBody, is_packed};
use super::caller::RequestCaller;
use super::error::HttpError;
use super::params::PathIds;
use crate::app::App;
use crate::work::uploads::{UploadError, UploadStatus, Uploads};
use crate::work::{Caller, WorkError};
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use http_body::Body as _;
use quadmuse_proto::UploadId;
use quadmuse_proto::upload::{
    OFFSET_OCTET_STREAM, TUS_EXTENSIONS, TUS_RESUMABLE, TUS_VERSION, UPLOAD_EXPIRES, UPLOAD_LENGTH, UPLOAD_METADATA,
    UPLOAD_OFFSET,
};
use std::sync::Arc;

/// Bytes that are gathered before they are written.
const PIECE_BYTES: usize = 256 << 10;

/// Longest `upload-metadata`, in bytes.
const METADATA_LENGTH_MAX: usize = 4096;

/// Sees to it that both ends speak the same version: another is answered [`HttpError::TusVersion`].
pub async fn speak(request: Request, next: Next) -> Response {
    let version =
        request.headers().get(TUS_RESUMABLE).map(|value| String::from_utf8_lossy(value.as_bytes()).into_owned());
    // Who asks for the version needn't know it.
    let mut response = match version {
        _ if request.method() == Method::OPTIONS => next.run(request).await,
        Some(version) if version == TUS_VERSION => next.run(request).await,
        found => HttpError::TusVersion { found: found.unwrap_or_else(|| "none".into()) }.into_response(),
    };
    response.headers_mut().insert(TUS_RESUMABLE, HeaderValue::from_static(TUS_VERSION));
    response
}

/// Answers who asks for the protocol before others take any `OPTIONS` for a browser's question of what it may send, which names a
/// method.
pub async fn announce(State(app): State<App>, request: Request, next: Next) -> Response {
    let is_browsers = request.headers().contains_key(header::ACCESS_CONTROL_REQUEST_METHOD);
    if request.method() != Method::OPTIONS || request.uri().path() != "/v1/uploads" || is_browsers {
        return next.run(request).await;
    }
    protocol(State(app)).await
}

/// Says which version and extensions of tus are spoken.
#[utoipa::path(
    options, path = "/v1/uploads", tag = "uploads",
    responses((status = 204, description = "Spoken: `tus-version`, `tus-extension`, `tus-max-size`"))
)]
pub async fn protocol(State(app): State<App>) -> Response {
    let mut response = StatusCode::NO_CONTENT.into_response();
    let headers = response.headers_mut();
    headers.insert(TUS_RESUMABLE, HeaderValue::from_static(TUS_VERSION));
    headers.insert("tus-version", HeaderValue::from_static(TUS_VERSION));
    headers.insert("tus-extension", HeaderValue::from_static(TUS_EXTENSIONS));
    headers.insert("tus-max-size", HeaderValue::from(app.uploads.largest()));
    response
}

/// Begins an upload, by tus 1.0.0. It is gone when nothing happened to it for an hour, and after a day.
#[utoipa::path(
    post, path = "/v1/uploads", tag = "uploads",
    params(
        ("Tus-Resumable" = String, Header, description = "1.0.0"),
        ("Upload-Length" = u64, Header, description = "Bytes of the whole file"),
        ("Upload-Metadata" = Option<String>, Header, description = "Keys with values in base 64, as tus has them; told again by HEAD"),
    ),
    responses((status = 201, description = "Begun; `location` is its address, and ends in the id for `upload=`"))
)]
pub async fn begin(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let expected = "the number of bytes of the file (`upload-defer-length` is not read)";
    let length = number(&headers, UPLOAD_LENGTH, expected)?;
    let metadata = metadata_of(&headers)?;
    let (id, standing) = blocking(&app, move |uploads| uploads.begin(caller, length, metadata)).await?;
    let mut response = tus_response(StatusCode::CREATED, &standing);
    if let Ok(location) = HeaderValue::try_from(format!("/v1/uploads/{id}")) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// Where an upload stands: `upload-offset` of `upload-length`.
#[utoipa::path(
    head, path = "/v1/uploads/{id}", tag = "uploads",
    params(("id" = UploadId, Path), ("Tus-Resumable" = String, Header, description = "1.0.0")),
    responses((status = 200, description = "It stands at `upload-offset`"))
)]
pub async fn standing(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id,)): PathIds<(UploadId,)>,
) -> Result<Response, HttpError> {
    Ok(tus_response(StatusCode::OK, &blocking(&app, move |uploads| uploads.look(caller, id)).await?))
}

/// Sends the bytes from `upload-offset` on: all, or some. What arrived before a connection broke is kept.
#[utoipa::path(
    patch, path = "/v1/uploads/{id}", tag = "uploads",
    params(
        ("id" = UploadId, Path),
        ("Tus-Resumable" = String, Header, description = "1.0.0"),
        ("Upload-Offset" = u64, Header, description = "From which byte on; as the last answer told it"),
    ),
    request_body(content = Vec<u8>, description = "Bytes of the file", content_type = "application/offset+octet-stream"),
    responses((status = 204, description = "Kept; `upload-offset` is the next byte"))
)]
pub async fn append(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id,)): PathIds<(UploadId,)>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, HttpError> {
    let offset = number(&headers, UPLOAD_OFFSET, "the number of bytes sent before")?;
    let kind = headers.get(header::CONTENT_TYPE).map_or("none", |value| value.to_str().unwrap_or("not a text"));
    if kind != OFFSET_OCTET_STREAM || is_packed(&headers) {
        let expected = format!("`content-type` {OFFSET_OCTET_STREAM} without a `content-encoding`");
        return Err(HttpError::BodyFormat { expected, found: kind.into() });
    }
    let now = blocking(&app, move |uploads| uploads.look(caller, id)).await?;
    if offset != now.offset {
        return Err(UploadError::Offset { expected: now.offset, found: offset }.into());
    }
    if body.size_hint().lower() > now.length - now.offset {
        return Err(UploadError::Beyond { length: now.length }.into());
    }
    received(&app, caller, id, offset, body).await?;
    let standing = blocking(&app, move |uploads| uploads.sync(caller, id)).await?;
    Ok(tus_response(StatusCode::NO_CONTENT, &standing))
}

/// Writes a body down as it arrives; where it breaks off, what came before.
async fn received(app: &App, caller: Caller, id: UploadId, offset: u64, body: Body) -> Result<(), HttpError> {
    // One piece is gathered while the one before is written.
    let _share = app.work.hold(caller.user, 2 * PIECE_BYTES as u64)?;
    let mut arriving = ArrivingBody::new(body, app.settings.upload_limit);
    let (mut at, mut piece) = (offset, Vec::new());
    loop {
        let next = arriving.next().await;
        if let Ok(Some(data)) = &next {
            piece.extend_from_slice(data);
        }
        if piece.len() >= PIECE_BYTES || (!piece.is_empty() && !matches!(next, Ok(Some(_)))) {
            let bytes = std::mem::take(&mut piece);
            at = blocking(app, move |uploads| uploads.append(caller, id, at, &bytes)).await?.offset;
        }
        if next?.is_none() {
            return Ok(());
        }
    }
}

/// Removes an upload.
#[utoipa::path(
    delete, path = "/v1/uploads/{id}", tag = "uploads",
    params(("id" = UploadId, Path), ("Tus-Resumable" = String, Header, description = "1.0.0")),
    responses((status = 204, description = "Removed"))
)]
pub async fn remove(
    State(app): State<App>,
    RequestCaller(caller): RequestCaller,
    PathIds((id,)): PathIds<(UploadId,)>,
) -> Result<StatusCode, HttpError> {
    blocking(&app, move |uploads| uploads.remove(caller, id)).await?;
    Ok(StatusCode::NO_CONTENT)
}

async fn blocking<T: Send + 'static>(
    app: &App,
    work: impl FnOnce(&Uploads) -> Result<T, UploadError> + Send + 'static,
) -> Result<T, HttpError> {
    let uploads = Arc::clone(&app.uploads);
    Ok(app.work.blocking(move |_| work(&uploads).map_err(WorkError::from)).await?)
}

fn number(headers: &HeaderMap, name: &str, expected: &str) -> Result<u64, HttpError> {
    let found = headers.get(name).map_or("none", |value| value.to_str().unwrap_or("not a text"));
    let is_number = !found.is_empty() && found.bytes().all(|byte| byte.is_ascii_digit());
    let number = found.parse().ok().filter(|_| is_number);
    number.ok_or_else(|| HttpError::parameter(name, expected, found))
}

/// `upload-metadata` as it came: keys without blanks and commas, each once, with values in base 64 or without one.
fn metadata_of(headers: &HeaderMap) -> Result<String, HttpError> {
    let Some(value) = headers.get(UPLOAD_METADATA) else { return Ok(String::new()) };
    let wrong = || {
        let found: String = String::from_utf8_lossy(value.as_bytes()).chars().take(40).collect();
        let expected = format!("pairs of a key and a value in base 64, at most {METADATA_LENGTH_MAX} bytes in all");
        HttpError::parameter(UPLOAD_METADATA, expected, found)
    };
    let text = value.to_str().ok().filter(|text| text.len() <= METADATA_LENGTH_MAX).ok_or_else(wrong)?;
    let mut keys = Vec::new();
    for pair in text.split(',') {
        let (key, value) = pair.trim().split_once(' ').unwrap_or((pair.trim(), ""));
        let is_base64 = value.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"+/=".contains(&byte));
        if key.is_empty() || !is_base64 || keys.contains(&key) {
            return Err(wrong());
        }
        keys.push(key);
    }
    Ok(text.into())
}

fn tus_response(status: StatusCode, standing: &UploadStatus) -> Response {
    let mut response = status.into_response();
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(UPLOAD_OFFSET, HeaderValue::from(standing.offset));
    headers.insert(UPLOAD_LENGTH, HeaderValue::from(standing.length));
    let texts =
        [(UPLOAD_EXPIRES, httpdate::fmt_http_date(standing.expires)), (UPLOAD_METADATA, standing.metadata.clone())];
    for (name, text) in texts.into_iter().filter(|(_, text)| !text.is_empty()) {
        if let Ok(value) = HeaderValue::try_from(text) {
            headers.insert(HeaderName::from_static(name), value);
        }
    }
    response
}
