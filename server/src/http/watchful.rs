//! What happens around every request: its id, its log line, its metrics, its time limit, and the net under panics.

use super::caller::Peer;
use super::error::{HttpError, REQUEST_ID};
use crate::pool::words_of;
use crate::telemetry::traces;
use axum::extract::{MatchedPath, Request};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::FutureExt;
use quadmuse_proto::id::RequestId;
use std::panic::AssertUnwindSafe;
use std::time::{Duration, Instant};
use tracing::Instrument;

/// The header of a request's id.
pub const X_REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longest id that is taken over from a caller, in bytes.
const REQUEST_ID_LENGTH_MAX: usize = 128;

/// Longest time until an answer begins. Longer than any limit within: this one only catches what forgot its own.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(300);

fn request_id(headers: &HeaderMap) -> String {
    let given = headers.get(X_REQUEST_ID).and_then(|value| value.to_str().ok());
    let usable = given.filter(|id| (1..=REQUEST_ID_LENGTH_MAX).contains(&id.len()));
    usable.map_or_else(|| RequestId::generate().to_string(), Into::into)
}

/// Fields of the log that an answer carries beside what the caller gets.
#[derive(Clone, Debug, Default)]
pub struct LogFields {
    /// The token's id.
    pub user: Option<String>,
    /// The problem's code.
    pub code: Option<&'static str>,
}

/// Adds to the fields of an answer in the log.
pub fn tell(response: &mut Response, add: impl FnOnce(&mut LogFields)) {
    add(response.extensions_mut().get_or_insert_default::<LogFields>());
}

/// The outermost layer: gives the request its id and the answer its header, and writes a line in the log.
pub async fn identify(request: Request, next: Next) -> Response {
    let id = request_id(request.headers());
    // Debug formatting escapes whatever the client wrote.
    let span = tracing::info_span!("request", id = ?id, method = %request.method(), path = ?request.uri().path());
    let peer = request.extensions().get::<Peer>().map(|peer| peer.0.to_string());
    let bytes_in = http_body::Body::size_hint(request.body()).exact();
    let start = Instant::now();
    let traced = traces::of_request(&request, &id, known_method(request.method()));
    // The inner one is what else is linked to, or made below.
    let running = next.run(request).instrument(traced.clone()).instrument(span.clone());
    let mut response = REQUEST_ID.scope(id.clone(), running).await;
    traces::answered(&traced, response.status());
    if let Ok(value) = HeaderValue::try_from(id) {
        response.headers_mut().insert(X_REQUEST_ID, value);
    }
    let (status, ms) = (response.status().as_u16(), start.elapsed().as_secs_f64() * 1e3);
    let logged = response.extensions().get::<LogFields>().cloned().unwrap_or_default();
    let bytes_out = http_body::Body::size_hint(response.body()).exact();
    let (user, code) = (logged.user, logged.code);
    span.in_scope(|| tracing::info!(status, ms, user, peer, code, bytes_in, bytes_out, "answered"));
    response
}

/// The net: a panic or a stuck handler becomes a problem.
pub async fn guard(request: Request, next: Next) -> Response {
    let running = AssertUnwindSafe(next.run(request)).catch_unwind();
    match tokio::time::timeout(ANSWER_TIME_MAX, running).await {
        Ok(Ok(response)) => response,
        Ok(Err(panic)) => HttpError::Internal(format!("a handler panicked: {}", words_of(&*panic))).into_response(),
        Err(_) => HttpError::TooSlow { seconds: ANSWER_TIME_MAX.as_secs() }.into_response(),
    }
}

/// A method as a label: invented ones are all the same, so that nobody fills the memory with them.
fn known_method(method: &Method) -> &'static str {
    match method.as_str() {
        "GET" => "GET",
        "HEAD" => "HEAD",
        "POST" => "POST",
        "PATCH" => "PATCH",
        "PUT" => "PUT",
        "DELETE" => "DELETE",
        "OPTIONS" => "OPTIONS",
        _ => "other",
    }
}

/// Counts and times each route.
pub async fn measure(request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("none", |path| path.as_str()).to_owned();
    let method = known_method(request.method());
    let start = Instant::now();
    let response = next.run(request).await;
    let status = response.status().as_u16().to_string();
    let labels = [("method", method.to_owned()), ("route", route), ("status", status)];
    metrics::counter!("quadmuse_requests_total", &labels).increment(1);
    metrics::histogram!("quadmuse_request_seconds", &labels).record(start.elapsed().as_secs_f64());
    response
}
