//! Logs: lines for people on a terminal, JSON lines everywhere else. Both escape what clients wrote; a thread of their own writes
//! them ([`lines`]). Beside them traces, where a collector is named ([`traces`]).

pub mod lines;
pub mod traces;

use lines::Lines;
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use std::io::IsTerminal;
use std::sync::OnceLock;
use traces::{Collector, TracesError};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry};

/// The variable that says what is logged, as `RUST_LOG` does elsewhere; that one is read where this one is not set.
pub const FILTER_VARIABLE: &str = "QUADMUSE_LOG";

/// Upper bounds of the buckets of durations, in seconds.
const SECONDS: [f64; 14] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0];

/// Why nothing is logged as asked.
#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    /// A filter that can't be read.
    #[error(
        "expected in {FILTER_VARIABLE} levels and targets as `info,quadmuse_server::http=debug`, found `{found}`: {source}"
    )]
    Filter {
        /// The filter.
        found: String,
        /// What is wrong with it.
        source: tracing_subscriber::filter::ParseError,
    },
    /// No traces can be exported.
    #[error(transparent)]
    Traces(#[from] TracesError),
}

/// What ends in order when it is dropped: the traces, then the log, which tells of them.
#[derive(Debug)]
#[must_use = "the last lines and spans are lost without it"]
pub struct Guard {
    _traces: Option<traces::Guard>,
    _lines: Option<lines::Guard>,
}

/// What `text` lets through; of no text, what is told by default.
///
/// # Errors
/// [`TelemetryError::Filter`].
fn filter(text: Option<&str>) -> Result<EnvFilter, TelemetryError> {
    let text = text.filter(|text| !text.trim().is_empty()).unwrap_or("info");
    let filter = EnvFilter::try_new(text).map_err(|source| TelemetryError::Filter { found: text.into(), source })?;
    // Its spans say again what the lines say, for others.
    let without = format!("{}=off", traces::TARGET);
    Ok(without.parse().map_or(EnvFilter::new(text), |directive| filter.add_directive(directive)))
}

/// Starts logging to standard error, and exporting traces to `collector`, until what is returned is dropped. Called once; a second
/// call does nothing. Where the system gives no thread for it, nothing is logged.
///
/// # Errors
/// [`TelemetryError`]: nothing is logged then.
pub fn start(collector: Option<&Collector>) -> Result<Guard, TelemetryError> {
    let set = [FILTER_VARIABLE, "RUST_LOG"].into_iter().find_map(|name| std::env::var(name).ok());
    let filter = filter(set.as_deref())?;
    let (tracer, traces) = collector.map(traces::start).transpose()?.unzip();
    let (log, lines) = match Lines::start(std::io::stderr()) {
        Ok((lines, guard)) => (Some(log_to(lines).with_filter(filter)), Some(guard)),
        Err(_) => (None, None),
    };
    let spans = Targets::new().with_target(traces::TARGET, LevelFilter::INFO);
    let exported = tracer.map(|tracer| {
        let layer = tracing_opentelemetry::layer().with_tracer(tracer);
        layer.with_location(false).with_threads(false).with_target(false).with_filter(spans)
    });
    // Tests start several services in one process: the first wins.
    drop(tracing_subscriber::registry().with(log).with(exported).try_init());
    Ok(Guard { _traces: traces, _lines: lines })
}

/// Lines for people on a terminal, JSON lines elsewhere.
fn log_to(lines: Lines) -> Box<dyn Layer<Registry> + Send + Sync> {
    let layer = tracing_subscriber::fmt::layer().with_writer(lines);
    if std::io::stderr().is_terminal() {
        layer.with_target(false).boxed()
    } else {
        layer.json().flatten_event(true).with_current_span(true).with_span_list(false).boxed()
    }
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
