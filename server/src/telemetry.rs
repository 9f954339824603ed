//! Logs: lines for people on a terminal, JSON lines everywhere else. Both escape what clients wrote; a thread of their own writes
//! them ([`lines`]).

pub mod lines;

use lines::{Guard, Lines};
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use std::io::IsTerminal;
use std::sync::OnceLock;
use tracing_subscriber::EnvFilter;

/// The variable that says what is logged, as `RUST_LOG` does elsewhere; that one is read where this one is not set.
pub const FILTER_VARIABLE: &str = "QUADMUSE_LOG";

/// Upper bounds of the buckets of durations, in seconds.
const SECONDS: [f64; 14] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0];

/// A filter that can't be read.
#[derive(Debug, thiserror::Error)]
#[error(
    "expected in {FILTER_VARIABLE} levels and targets as `info,quadmuse_server::http=debug`, found `{found}`: {source}"
)]
pub struct FilterError {
    found: String,
    source: tracing_subscriber::filter::ParseError,
}

/// What `text` lets through; of no text, what is told by default.
///
/// # Errors
/// [`FilterError`].
fn filter(text: Option<&str>) -> Result<EnvFilter, FilterError> {
    let text = text.filter(|text| !text.trim().is_empty()).unwrap_or("info");
    EnvFilter::try_new(text).map_err(|source| FilterError { found: text.into(), source })
}

/// Starts logging to standard error, until what is returned is dropped. Called once; a second call does nothing. Where the system
/// gives no thread for it, nothing is logged.
///
/// # Errors
/// [`FilterError`]: nothing is logged then.
pub fn start() -> Result<Option<Guard>, FilterError> {
    let set = [FILTER_VARIABLE, "RUST_LOG"].into_iter().find_map(|name| std::env::var(name).ok());
    let filter = filter(set.as_deref())?;
    let Ok((lines, guard)) = Lines::start(std::io::stderr()) else { return Ok(None) };
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(lines);
    let started = if std::io::stderr().is_terminal() {
        builder.with_target(false).try_init()
    } else {
        builder.json().flatten_event(true).with_current_span(true).with_span_list(false).try_init()
    };
    // Tests start several services in one process: the first wins.
    drop(started);
    Ok(Some(guard))
}

/// The recorder of metrics, one a process.
pub fn metrics() -> PrometheusHandle {
    static RECORDER: OnceLock<PrometheusHandle> = OnceLock::new();
    RECORDER.get_or_init(install_recorder).clone()
}

fn install_recorder() -> PrometheusHandle {
    // Buckets, so that those of several servers can be added. The list is not empty, so that it is never refused.
    let builder = PrometheusBuilder::new();
    let builder = builder.set_buckets(&SECONDS).unwrap_or_else(|_| PrometheusBuilder::new());
    let recorder = builder.build_recorder();
    let handle = recorder.handle();
    if metrics::set_global_recorder(recorder).is_err() {
        tracing::warn!("another recorder of metrics was installed before");
    }
    handle
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_that_is_none_is_refused_and_named() {
        assert!(filter(None).is_ok() && filter(Some("")).is_ok());
        assert!(filter(Some("warn,quadmuse_server::http=debug")).is_ok());
        let error = filter(Some("quadmuse_server=loud")).expect_err("no level");
        assert!(error.to_string().contains("quadmuse_server=loud"), "{error}");
    }
}
