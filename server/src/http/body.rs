//! Bodies as they come in: limited on the stream, before and after they are unpacked.
//!
//! When an answer goes out before the body was read (it is too large, or not wanted), what the client still sends is
//! read and dropped for a while, so that it sees the answer and not a broken pipe.

use super::error::HttpError;
use super::negotiate::{JSON, MSGPACK, Wire};
use crate::app::App;
use axum::body::Body;
use axum::extract::{FromRequest, Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use http_body::{Body as _, Frame, SizeHint};
use http_body_util::{BodyExt, LengthLimitError, Limited};
use serde::de::DeserializeOwned;
use std::error::Error;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

/// Largest body of a message (not of a mesh), in bytes.
const MESSAGE_LIMIT: u64 = 1 << 20;

/// Longest time for a body to arrive.
pub const ARRIVAL_TIME_MAX: Duration = Duration::from_secs(120);

/// Most bytes of an unwanted body that are read and dropped.
const DRAIN_BYTES_MAX: u64 = 512 << 20;

/// Longest time for which an unwanted body is read and dropped.
const DRAIN_TIME_MAX: Duration = Duration::from_secs(5);

/// More bytes than the limit on the wire.
#[derive(Debug, thiserror::Error)]
#[error("the body is longer than its limit")]
struct TooLong;

/// A body that counts and fails beyond its limit; what of it is not read is drained.
struct Metered {
    inner: Option<Body>,
    left: u64,
}

impl http_body::Body for Metered {
    type Data = Bytes;
    type Error = axum::BoxError;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::BoxError>>> {
        let Some(inner) = self.inner.as_mut() else { return Poll::Ready(None) };
        let frame = ready!(Pin::new(inner).poll_frame(cx));
        if let Some(Ok(frame)) = &frame {
            let length = frame.data_ref().map_or(0, |data| data.len() as u64);
            match self.left.checked_sub(length) {
                Some(left) => self.left = left,
                None => return Poll::Ready(Some(Err(Box::new(TooLong)))),
            }
        }
        Poll::Ready(frame.map(|frame| frame.map_err(Into::into)))
    }

    fn is_end_stream(&self) -> bool {
        self.inner.as_ref().is_none_or(Body::is_end_stream)
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.as_ref().map(Body::size_hint).unwrap_or_default()
    }
}

impl Drop for Metered {
    fn drop(&mut self) {
        if let (Some(inner), Ok(runtime)) = (self.inner.take(), tokio::runtime::Handle::try_current())
            && !inner.is_end_stream()
        {
            runtime.spawn(tokio::time::timeout(DRAIN_TIME_MAX, drain(inner)));
        }
    }
}

async fn drain(mut body: Body) {
    let mut left = DRAIN_BYTES_MAX;
    while let Some(Ok(frame)) = body.frame().await {
        let length = frame.data_ref().map_or(0, |data| data.len() as u64);
        match left.checked_sub(length) {
            Some(rest) => left = rest,
            None => return,
        }
    }
}

/// Limits the body on the wire: by its `Content-Length` at once, else as it comes.
pub async fn limit(State(app): State<App>, request: Request, next: Next) -> Response {
    let limit = app.settings.upload_limit;
    let (parts, body) = request.into_parts();
    let length = body.size_hint().lower();
    let body = Body::new(Metered { inner: Some(body), left: limit });
    if length > limit {
        return HttpError::BodyTooLarge { limit }.into_response();
    }
    next.run(Request::from_parts(parts, body)).await
}

/// A whole body of at most `limit` bytes, unpacked. The layers before have unpacked it.
///
/// # Errors
/// [`HttpError::BodyTooLarge`], [`HttpError::BodyTimeout`], [`HttpError::BodyFormat`], [`HttpError::BodyInvalid`].
pub async fn whole(headers: &HeaderMap, body: Body, limit: u64) -> Result<Bytes, HttpError> {
    let body = limited(headers, body, limit)?;
    let seconds = ARRIVAL_TIME_MAX.as_secs();
    let read = tokio::time::timeout(ARRIVAL_TIME_MAX, body.collect()).await;
    match read.map_err(|_| HttpError::BodyTimeout { seconds })? {
        Ok(collected) => Ok(collected.to_bytes()),
        Err(error) => Err(body_error(&*error, limit)),
    }
}

/// A body that fails beyond `limit` bytes, unpacked.
///
/// # Errors
/// [`HttpError::BodyFormat`] when it is packed in a way that is not read.
pub fn limited(headers: &HeaderMap, body: Body, limit: u64) -> Result<Limited<Body>, HttpError> {
    if let Some(coding) = headers.get(header::CONTENT_ENCODING).filter(|coding| *coding != "identity") {
        let found = String::from_utf8_lossy(coding.as_bytes()).into_owned();
        return Err(HttpError::BodyFormat { expected: "`content-encoding` gzip or zstd".into(), found });
    }
    Ok(Limited::new(body, usize::try_from(limit).unwrap_or(usize::MAX)))
}

/// What it means that a body could not be read.
pub fn body_error(error: &(dyn Error + 'static), limit: u64) -> HttpError {
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(at) = cause {
        if at.is::<TooLong>() || at.is::<LengthLimitError>() {
            return HttpError::BodyTooLarge { limit };
        }
        cause = at.source();
    }
    HttpError::BodyInvalid(format!(
        "expected a whole body, packed as `content-encoding` says, found a broken one: {error}"
    ))
}

/// A message in the body, as JSON or MessagePack by `Content-Type`.
pub struct Message<T> {
    /// The message.
    pub value: T,
    /// Its bytes' hash, for `Idempotency-Key`.
    pub fingerprint: blake3::Hash,
}

impl<T: DeserializeOwned> FromRequest<App> for Message<T> {
    type Rejection = HttpError;

    async fn from_request(request: Request, _: &App) -> Result<Self, HttpError> {
        let (parts, body) = request.into_parts();
        let wire = wire_of(&parts.headers)?;
        let bytes = whole(&parts.headers, body, MESSAGE_LIMIT).await?;
        Ok(Self { value: wire.read(&bytes)?, fingerprint: blake3::hash(&bytes) })
    }
}

fn wire_of(headers: &HeaderMap) -> Result<Wire, HttpError> {
    // No page of another origin can send these types without asking leave, and one without a type it can.
    let text = headers.get(header::CONTENT_TYPE).map_or("none", |value| value.to_str().unwrap_or("not a text"));
    let essence = text.split(';').next().unwrap_or_default().trim();
    match essence {
        kind if kind.eq_ignore_ascii_case(JSON) => Ok(Wire::Json),
        kind if kind.eq_ignore_ascii_case(MSGPACK) => Ok(Wire::MsgPack),
        _ => {
            let expected = format!("`content-type` {JSON} or {MSGPACK}");
            Err(HttpError::BodyFormat { expected, found: text.into() })
        }
    }
}
