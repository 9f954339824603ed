//! Bodies as they come in: limited on the stream, before and after they are unpacked, and paid for in memory.
//!
//! The memory of a body is taken from what is admitted ([`Work::hold`]) as its bytes arrive, and given back with them. What
//! arrives slower than [`RATE_LEAST`] is given up. Unpacking is computing, and done where computing is done.
//!
//! When an answer goes out before the body was read (it is too large, or not wanted), what the client still sends is
//! read and dropped for a while, so that it sees the answer and not a broken pipe.

use super::caller::RequestCaller;
use super::error::HttpError;
use super::negotiate::{JSON, MSGPACK, Wire};
use crate::app::App;
use crate::pool::{Admitted, Lane, PoolError, Stop, User};
use crate::work::{Caller, REQUEST_TIME_MAX, Work, uploads};
use axum::body::Body;
use axum::extract::{FromRequest, Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use http_body::{Body as _, Frame, SizeHint};
use http_body_util::BodyExt;
use quadmuse_proto::UploadId;
use serde::de::DeserializeOwned;
use std::error::Error;
use std::io::Read;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};

/// Largest body of a message (not of a mesh), in bytes.
const MESSAGE_LIMIT: u64 = 1 << 20;

/// Longest time for a body to arrive.
pub const ARRIVAL_TIME_MAX: Duration = Duration::from_secs(120);

/// Longest time between two pieces of a body.
const SILENCE_TIME_MAX: Duration = Duration::from_secs(15);

/// Slowest rate at which a body may arrive, in bytes a second, once [`RATE_GRACE`] is over.
const RATE_LEAST: u64 = 4096;

/// For so long a body may arrive as slowly as it likes.
const RATE_GRACE: Duration = Duration::from_secs(10);

/// Memory that unpacking takes beside what it gives: the window of zstd is at most 8 MiB (RFC 9659).
const UNPACKING_BYTES: u64 = 10 << 20;

/// log₂ of that window.
const ZSTD_WINDOW_LOG_MAX: u32 = 23;

/// Bytes that are unpacked between two looks at the limit, the memory and the stop flag.
const UNPACKED_AT_A_TIME: usize = 256 << 10;

/// Most bytes of an unwanted body that are read and dropped.
const DRAIN_BYTES_MAX: u64 = 512 << 20;

/// Longest time for which an unwanted body is read and dropped.
const DRAIN_TIME_MAX: Duration = Duration::from_secs(5);

/// More bytes than the limit on the wire.
#[derive(Debug, thiserror::Error)]
#[error("the body is longer than its limit")]
struct TooLong;

/// A body that counts and fails beyond its limit; what of it is not read is drained.
struct MeteredBody {
    inner: Option<Body>,
    left: u64,
}

impl http_body::Body for MeteredBody {
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

impl Drop for MeteredBody {
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
    let body = Body::new(MeteredBody { inner: Some(body), left: limit });
    if length > limit {
        return HttpError::BodyTooLarge { limit }.into_response();
    }
    next.run(Request::from_parts(parts, body)).await
}

/// Bytes that grow, and are paid for before they do.
struct GrowingBytes<'a> {
    bytes: Vec<u8>,
    share: &'a Admitted,
    work: &'a Work,
    limit: u64,
}

impl GrowingBytes<'_> {
    fn push(&mut self, more: &[u8]) -> Result<(), HttpError> {
        let length = self.bytes.len() + more.len();
        if length as u64 > self.limit {
            return Err(HttpError::BodyTooLarge { limit: self.limit });
        }
        if length > self.bytes.capacity() {
            let capacity = length.max(2 * self.bytes.capacity());
            // While it is moved, the bytes are there twice.
            self.work.grow(self.share, capacity as u64)?;
            let before = self.bytes.capacity() as u64;
            self.bytes.reserve_exact(capacity - self.bytes.len());
            self.share.take(self.share.bytes().saturating_sub(before));
        }
        self.bytes.extend_from_slice(more);
        Ok(())
    }
}

/// A body as it arrives, given up where it is too slow.
pub struct ArrivingBody {
    body: Body,
    limit: u64,
    begun: Instant,
    arrived: u64,
}

impl ArrivingBody {
    /// A body that is limited to `limit` bytes on the wire.
    pub fn new(body: Body, limit: u64) -> Self {
        Self { body, limit, begun: Instant::now(), arrived: 0 }
    }

    /// Its next bytes; `None` at its end.
    ///
    /// # Errors
    /// [`HttpError::BodyTooLarge`], [`HttpError::BodyTimeout`], [`HttpError::BodyInvalid`].
    pub async fn next(&mut self) -> Result<Option<Bytes>, HttpError> {
        let begun = self.begun;
        let late = || HttpError::BodyTimeout { seconds: begun.elapsed().as_secs() };
        let left = ARRIVAL_TIME_MAX.saturating_sub(begun.elapsed()).min(SILENCE_TIME_MAX);
        let frame = tokio::time::timeout(left, self.body.frame()).await.map_err(|_| late())?;
        let Some(frame) = frame else { return Ok(None) };
        let frame = frame.map_err(|error| body_error(&error, self.limit))?;
        let data = frame.into_data().unwrap_or_default();
        self.arrived += data.len() as u64;
        let due = begun.elapsed().saturating_sub(RATE_GRACE).as_secs().saturating_mul(RATE_LEAST);
        if self.arrived < due { Err(late()) } else { Ok(Some(data)) }
    }
}

/// A whole body of at most `limit` bytes, as it came over the wire.
async fn arrived(work: &Work, user: User, body: Body, limit: u64) -> Result<Bytes, HttpError> {
    let share = work.hold(user, 0)?;
    let mut all = GrowingBytes { bytes: Vec::new(), share: &share, work, limit };
    let mut arriving = ArrivingBody::new(body, limit);
    while let Some(data) = arriving.next().await? {
        all.push(&data)?;
    }
    let bytes = all.bytes;
    Ok(share.held(bytes))
}

/// How a body is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    Plain,
    Gzip,
    Zstd,
}

fn coding_of(headers: &HeaderMap) -> Result<Coding, HttpError> {
    let Some(coding) = headers.get(header::CONTENT_ENCODING) else { return Ok(Coding::Plain) };
    match coding.as_bytes().to_ascii_lowercase().as_slice() {
        b"identity" => Ok(Coding::Plain),
        b"gzip" | b"x-gzip" => Ok(Coding::Gzip),
        b"zstd" => Ok(Coding::Zstd),
        _ => {
            let found = String::from_utf8_lossy(coding.as_bytes()).into_owned();
            Err(HttpError::BodyFormat { expected: "`content-encoding` gzip or zstd".into(), found })
        }
    }
}

/// Whether a body is packed, in a known way or another.
pub fn is_packed(headers: &HeaderMap) -> bool {
    !matches!(coding_of(headers), Ok(Coding::Plain))
}

/// A body, unpacked. Blocks for as long as that takes.
fn unpacked(
    work: &Work,
    user: User,
    coding: Coding,
    bytes: &Bytes,
    limit: u64,
    stop: &Stop,
) -> Result<Bytes, HttpError> {
    let broken = |error: std::io::Error| body_error(&error, limit);
    let mut reader: Box<dyn Read + '_> = match coding {
        Coding::Plain => return Ok(bytes.clone()),
        Coding::Gzip => Box::new(flate2::bufread::MultiGzDecoder::new(&bytes[..])),
        Coding::Zstd => {
            let mut decoder = zstd::stream::read::Decoder::with_buffer(&bytes[..]).map_err(broken)?;
            decoder.window_log_max(ZSTD_WINDOW_LOG_MAX).map_err(broken)?;
            Box::new(decoder)
        }
    };
    let share = work.hold(user, 0)?;
    let mut all = GrowingBytes { bytes: Vec::new(), share: &share, work, limit };
    let mut piece = vec![0; UNPACKED_AT_A_TIME];
    loop {
        if let Some(reason) = stop.reason() {
            return Err(PoolError::Stopped(reason).into());
        }
        let read = reader.read(&mut piece).map_err(broken)?;
        match piece.get(..read) {
            None | Some([]) => break,
            Some(read) => all.push(read)?,
        }
    }
    drop(reader);
    let bytes = all.bytes;
    Ok(share.held(bytes))
}

/// Where the bytes of a mesh are.
pub enum Source {
    /// In the request's body.
    Body(Body),
    /// In an upload that ended before.
    Upload(UploadId),
}

/// A whole body of at most `limit` bytes, packed and unpacked, given to `read` where computing is done.
///
/// # Errors
/// [`HttpError::BodyTooLarge`], [`HttpError::BodyTimeout`], [`HttpError::BodyFormat`], [`HttpError::BodyInvalid`],
/// refusals of the pool, and those of `read`.
pub async fn computed<T: Send + 'static>(
    app: &App,
    caller: Caller,
    headers: &HeaderMap,
    source: Source,
    read: impl FnOnce(Bytes, &Stop) -> Result<T, HttpError> + Send + 'static,
) -> Result<T, HttpError> {
    let (coding, limit, user) = (coding_of(headers)?, app.settings.upload_limit, caller.user);
    // Who is over the share needn't send the rest.
    app.work.look(user)?;
    let bytes = match source {
        Source::Body(body) => arrived(&app.work, user, body, limit).await?,
        Source::Upload(id) => uploads::whole(&app.work, &app.uploads, caller, id).await?,
    };
    let unpacking = if coding == Coding::Plain { 0 } else { UNPACKING_BYTES };
    // What comes after will need as much: who would be refused then is refused now, not after its turn in the queue.
    let needed = unpacking.max(app.work.engine.memory_estimate(bytes.len() as u64));
    let job = app.work.admit(user, needed, REQUEST_TIME_MAX)?;
    let work = Arc::clone(&app.work);
    let compute = move |stop: &Stop| {
        let bytes = unpacked(&work, user, coding, &bytes, limit, stop)?;
        read(bytes, stop)
    };
    app.work.pool.run(&job, Lane::Coarse, compute).await?
}

/// What it means that a body could not be read.
pub fn body_error(error: &(dyn Error + 'static), limit: u64) -> HttpError {
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(at) = cause {
        if at.is::<TooLong>() {
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

    async fn from_request(request: Request, app: &App) -> Result<Self, HttpError> {
        let (parts, body) = request.into_parts();
        let (wire, coding) = (wire_of(&parts.headers)?, coding_of(&parts.headers)?);
        let RequestCaller(caller) = parts.extensions.get::<RequestCaller>().copied().unwrap_or_default();
        let packed = arrived(&app.work, caller.user, body, MESSAGE_LIMIT).await?;
        // So short that it is unpacked here.
        let bytes = unpacked(&app.work, caller.user, coding, &packed, MESSAGE_LIMIT, &Stop::new(None))?;
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
