//! Traces for a collector that speaks OTLP over HTTP: a span a request, one a quantum that is computed for it, and one for what goes
//! on behind it, linked to the request that began it.
//!
//! Spans are gathered in a bounded queue, and sent in batches by a thread of their own; beyond the queue they are lost, and nobody
//! waits. A collector that is away is told of once, and once again when it is back. The spans have a target of their own
//! ([`TARGET`]), so that they cost nothing where no collector is named, and the log is what it is without them.

use axum::extract::MatchedPath;
use axum::http::{Request, Response, StatusCode, Uri, header};
use bytes::Bytes;
use http_body_util::{BodyExt, Full, Limited};
use hyper_util::rt::TokioIo;
use opentelemetry::trace::TracerProvider;
use opentelemetry_http::{HttpClient, HttpError};
use opentelemetry_otlp::{ExporterBuildError, Protocol, RetryPolicy, SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::{SdkTracerProvider, Tracer};
use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::runtime::Runtime;
use tracing::{Span, field::Empty};

/// The target of spans for a collector.
pub const TARGET: &str = "quadmuse_trace";

/// Where a collector takes spans, below its address.
const PATH: &str = "/v1/traces";

/// Longest time for a batch to be taken.
const SENDING_TIME_MAX: Duration = Duration::from_secs(5);

/// Longest wait for the last batch, at the end of the process.
const LAST_TIME_MAX: Duration = Duration::from_secs(2);

/// Longest answer of a collector that is read, in bytes.
const ANSWER_BYTES_MAX: usize = 64 << 10;

/// The address of a collector.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Collector(Uri);

impl std::str::FromStr for Collector {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("expected the address of a collector like http://127.0.0.1:4318, found `{text}`");
        let address: Uri = text.parse().map_err(|_| refused())?;
        let is_plain = address.scheme_str() == Some("http") && address.query().is_none();
        if !is_plain || address.host().is_none_or(str::is_empty) {
            return Err(refused());
        }
        let whole = format!("{}{PATH}", text.trim_end_matches('/'));
        Ok(Self(whole.parse().map_err(|_| refused())?))
    }
}

/// Why there are no traces.
#[derive(Debug, thiserror::Error)]
pub enum TracesError {
    /// The system gives no thread.
    #[error("expected a thread for traces, found that the system refuses: {0}")]
    Thread(#[from] std::io::Error),
    /// The exporter can't be made.
    #[error("expected to make an exporter of traces, found: {0}")]
    Exporter(#[from] ExporterBuildError),
}

/// Sends what is left when it is dropped, for a while.
#[derive(Debug)]
#[must_use = "spans that wait when it is dropped are sent; without it they are lost at the end of the process"]
pub struct Guard(SdkTracerProvider);

impl Drop for Guard {
    fn drop(&mut self) {
        // Whether the collector took them was told by its client.
        let _ = self.0.shutdown_with_timeout(LAST_TIME_MAX);
    }
}

/// Starts to export to a collector; what makes spans, and what ends it.
///
/// # Errors
/// [`TracesError`].
pub fn start(collector: &Collector) -> Result<(Tracer, Guard), TracesError> {
    let client = Client {
        runtime: tokio::runtime::Builder::new_current_thread().enable_all().build()?,
        is_away: AtomicBool::new(false),
    };
    let exporter = SpanExporter::builder()
        .with_http()
        .with_http_client(client)
        .with_endpoint(collector.0.to_string())
        .with_protocol(Protocol::HttpBinary)
        .with_timeout(SENDING_TIME_MAX)
        // The next batch comes soon enough, and a thread that waits would hold up the end.
        .with_retry_policy(RetryPolicy::disabled())
        .build()?;
    let resource = Resource::builder().with_service_name("quadmuse-server").build();
    let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
    Ok((provider.tracer("quadmuse-server"), Guard(provider)))
}

/// Sends batches, on the exporter's own thread.
#[derive(Debug)]
struct Client {
    runtime: Runtime,
    is_away: AtomicBool,
}

impl Client {
    fn send(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        let address = request.uri().clone();
        let sent = self.runtime.block_on(async { tokio::time::timeout(SENDING_TIME_MAX, send(request)).await });
        let sent = sent.unwrap_or_else(|_| Err("no answer in time".into()));
        let wrong = match &sent {
            Ok(answer) if answer.status().is_success() => None,
            Ok(answer) => Some(format!("status {}", answer.status().as_u16())),
            Err(error) => Some(error.to_string()),
        };
        let was_away = self.is_away.swap(wrong.is_some(), Ordering::Relaxed);
        match wrong {
            Some(error) if !was_away => tracing::warn!(%address, error, "the collector takes no traces: they are lost"),
            None if was_away => tracing::info!(%address, "the collector takes traces again"),
            _ => {}
        }
        sent
    }
}

impl HttpClient for Client {
    // As the attribute of the trait would write it.
    fn send_bytes<'a, 'b>(
        &'a self,
        request: Request<Bytes>,
    ) -> Pin<Box<dyn Future<Output = Result<Response<Bytes>, HttpError>> + Send + 'b>>
    where
        'a: 'b,
        Self: 'b,
    {
        Box::pin(std::future::ready(self.send(request)))
    }
}

async fn send(request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
    let (mut parts, body) = request.into_parts();
    let authority = parts.uri.authority().cloned().ok_or("no host")?;
    let host = authority.host().trim_matches(['[', ']']);
    let stream = TcpStream::connect((host, authority.port_u16().unwrap_or(80))).await?;
    let (mut sender, connection) = hyper::client::conn::http1::handshake(TokioIo::new(stream)).await?;
    // What it fails with, the sender tells.
    let driving = tokio::spawn(connection);
    parts.headers.insert(header::HOST, authority.as_str().parse()?);
    parts.uri = parts.uri.path_and_query().map_or("/", |path| path.as_str()).parse()?;
    let answer = sender.send_request(Request::from_parts(parts, Full::new(body))).await?;
    let (parts, body) = answer.into_parts();
    let body = Limited::new(body, ANSWER_BYTES_MAX).collect().await?.to_bytes();
    driving.abort();
    Ok(Response::from_parts(parts, body))
}

/// The span of a request, named by its route: an address would make a name of its own for each id.
pub fn of_request<B>(request: &Request<B>, id: &str, method: &'static str) -> Span {
    let route = request.extensions().get::<MatchedPath>().map_or("none", |path| path.as_str());
    tracing::info_span!(
        target: TARGET,
        "request",
        otel.name = format!("{method} {route}"),
        otel.kind = "server",
        otel.status_code = Empty,
        http.request.method = method,
        http.route = route,
        http.response.status_code = Empty,
        request.id = id,
    )
}

/// Tells the span of a request how it was answered.
pub fn answered(span: &Span, status: StatusCode) {
    span.record("http.response.status_code", status.as_u16());
    if status.is_server_error() {
        span.record("otel.status_code", "ERROR");
    }
}

/// The span of what goes on when its request is answered: a trace of its own, linked to the request's, which else would last as long.
pub fn behind(what: &'static str, id: &str) -> Span {
    let span = tracing::info_span!(target: TARGET, parent: None, "behind", otel.name = what, id);
    span.follows_from(Span::current());
    span
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collector_is_named_by_its_address_and_takes_spans_below_it() {
        for (text, whole) in [
            ("http://127.0.0.1:4318", "http://127.0.0.1:4318/v1/traces"),
            ("http://collector/", "http://collector/v1/traces"),
            ("http://[::1]:4318/otlp", "http://[::1]:4318/otlp/v1/traces"),
        ] {
            assert_eq!(text.parse::<Collector>().expect(text).0.to_string(), whole);
        }
        for text in ["", "collector:4318", "https://collector", "http://", "http:///x", "http://x/?a=b", "/v1/traces"] {
            let error = text.parse::<Collector>().expect_err(text);
            assert!(error.contains("http://127.0.0.1:4318"), "{error}");
        }
    }
}
