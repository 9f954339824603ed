//! Whether the service is alive and ready, and its metrics.

use super::error::HttpError;
use super::negotiate::ResponsePreferences;
use crate::app::App;
use crate::pool::{Used, taken};
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use quadmuse_proto::{Health, Readiness};

/// The media type of the Prometheus text format.
const PROMETHEUS: &str = "text/plain; version=0.0.4; charset=utf-8";

/// A server of several is ready as long as it was known to be up to date so many milliseconds ago.
const UNSURE_MAX_MS: u64 = 10_000;

/// The process runs.
#[utoipa::path(get, path = "/healthz", tag = "health", responses((status = 200, description = "Alive", body = Health)))]
pub async fn alive(wants: ResponsePreferences) -> Result<Response, HttpError> {
    wants.answer(StatusCode::OK, None, &Health { status: "ok".into(), version: env!("CARGO_PKG_VERSION").into() })
}

/// Requests are taken: 200; or not (any more): 503.
#[utoipa::path(
    get, path = "/readyz", tag = "health",
    responses((status = 200, description = "Ready", body = Readiness), (status = 503, description = "Not ready", body = Readiness))
)]
pub async fn ready(State(app): State<App>, wants: ResponsePreferences) -> Result<Response, HttpError> {
    let (snapshot, health) = (app.work.catalogue.snapshot(), app.work.corpus.health());
    // A server that doesn't know what others changed doesn't answer for the corpus.
    let is_sure = app.work.corpus.following().unsure_ms < UNSURE_MAX_MS;
    let ready = is_sure && !app.stopping.is_cancelled();
    let readiness = Readiness {
        ready,
        writable: health.read_only.is_none(),
        examples: snapshot.example_count() as u64,
        segments: snapshot.segment_count() as u64,
        segments_waiting: snapshot.segment_count_all().saturating_sub(snapshot.segment_count()) as u64,
        // Open to all: how many, and not which. Admins are told which.
        quarantined: Vec::new(),
        quarantined_count: health.quarantined.len() as u64,
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
    gauges(&app);
    app.metrics.run_upkeep();
    ([(header::CONTENT_TYPE, HeaderValue::from_static(PROMETHEUS))], app.metrics.render()).into_response()
}

/// Brings the gauges up to date. Users are told by how many there are and by the greediest, so that labels stay few.
fn gauges(app: &App) {
    let (pool, health, memory) = (&app.work.pool, app.work.corpus.health(), taken::of_process());
    metrics::gauge!("quadmuse_pool_waiting").set(pool.waiting() as f64);
    for (lane, waiting) in ["edit", "lay", "coarse", "fine", "ingest"].into_iter().zip(pool.waiting_by_lane()) {
        metrics::gauge!("quadmuse_lane_waiting", "lane" => lane).set(waiting as f64);
    }
    let (used, users) = (pool.admission().used(), pool.admission().by_user());
    metrics::gauge!("quadmuse_jobs").set(used.places as f64);
    metrics::gauge!("quadmuse_users").set(users.len() as f64);
    let most = |of: fn(&Used) -> u64| users.iter().map(|(_, used)| of(used)).max().unwrap_or(0) as f64;
    metrics::gauge!("quadmuse_user_jobs_max").set(most(|used| used.places));
    metrics::gauge!("quadmuse_user_memory_bytes_max").set(most(|used| used.bytes));
    let limit = pool.admission().limit_bytes();
    for (kind, bytes) in
        [("limit", limit), ("admitted", used.bytes), ("allocated", memory.allocated), ("resident", memory.resident)]
    {
        metrics::gauge!("quadmuse_memory_bytes", "kind" => kind).set(bytes as f64);
    }
    let following = app.work.corpus.following();
    metrics::gauge!("quadmuse_cluster_behind").set(following.behind as f64);
    metrics::gauge!("quadmuse_cluster_unsure_seconds").set(following.unsure_ms as f64 / 1000.0);
    if let Some(own) = app.work.catalogue.share() {
        metrics::gauge!("quadmuse_share").set(f64::from(own.number()));
        metrics::gauge!("quadmuse_shares").set(f64::from(own.of()));
        metrics::gauge!("quadmuse_shares_missing").set(app.work.shares.without_holder(own).len() as f64);
    }
    metrics::gauge!("quadmuse_quarantined").set(health.quarantined.len() as f64);
    metrics::gauge!("quadmuse_writable").set(f64::from(u8::from(health.read_only.is_none())));
}
