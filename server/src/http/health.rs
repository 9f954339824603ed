//! Whether the service is alive and ready, and its metrics.

use super::error::HttpError;
use super::negotiate::Wants;
use crate::app::App;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use quadmuse_proto::{Health, Readiness};

/// The media type of the Prometheus text format.
const PROMETHEUS: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The process runs.
#[utoipa::path(get, path = "/healthz", tag = "health", responses((status = 200, description = "Alive", body = Health)))]
pub async fn alive(wants: Wants) -> Result<Response, HttpError> {
    wants.answer(StatusCode::OK, None, &Health { status: "ok".into(), version: env!("CARGO_PKG_VERSION").into() })
}

/// Requests are taken: 200; or not (any more): 503.
#[utoipa::path(
    get, path = "/readyz", tag = "health",
    responses((status = 200, description = "Ready", body = Readiness), (status = 503, description = "Not ready", body = Readiness))
)]
pub async fn ready(State(app): State<App>, wants: Wants) -> Result<Response, HttpError> {
    let (snapshot, health) = (app.work.catalogue.snapshot(), app.work.corpus.health());
    let ready = !app.stopping.is_cancelled();
    let readiness = Readiness {
        ready,
        writable: health.read_only.is_none(),
        examples: snapshot.example_count() as u64,
        segments: snapshot.segment_count() as u64,
        segments_waiting: snapshot.segment_count_all().saturating_sub(snapshot.segment_count()) as u64,
        quarantined: health.quarantined.iter().map(ToString::to_string).collect(),
        encoder_version: app.work.engine.version(),
    };
    let status = if ready { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    wants.answer(status, None, &readiness)
}

/// Metrics for Prometheus.
#[utoipa::path(
    get, path = "/metrics", tag = "health",
    responses((status = 200, description = "Metrics", content_type = "text/plain", body = String))
)]
pub async fn metrics(State(app): State<App>) -> Response {
    let snapshot = app.work.catalogue.snapshot();
    metrics::gauge!("quadmuse_examples").set(snapshot.example_count() as f64);
    metrics::gauge!("quadmuse_segments").set(snapshot.segment_count() as f64);
    metrics::gauge!("quadmuse_queries_held").set(app.work.queries.len() as f64);
    metrics::gauge!("quadmuse_pool_waiting").set(app.work.pool.waiting() as f64);
    app.metrics.run_upkeep();
    ([(header::CONTENT_TYPE, HeaderValue::from_static(PROMETHEUS))], app.metrics.render()).into_response()
}
