//! A query over HTTP, and where its time went.

use super::{ScaleError, process};
use crate::{http, server::Server};
use serde_json::Value;
use std::{
    io,
    time::{Duration, Instant},
};

/// Pause between two looks at a query.
const PAUSE: Duration = Duration::from_millis(5);
/// Pause between two looks at a server's processor time.
const LOOK: Duration = Duration::from_millis(2);
/// A server that hasn't computed for so long is idle; on a busy machine a thread may wait for a processor meanwhile.
const IDLE: Duration = Duration::from_millis(200);
/// Processor time in milliseconds that is none: what the clock of the system itself adds.
const IDLE_MS: f64 = 0.05;
/// Longest wait for a query, or for a server to be idle.
const TIME_MAX: Duration = Duration::from_secs(120);

/// Where the time of a query went, in milliseconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Timed {
    /// The input.
    pub name: String,
    /// Unfolding and encoding.
    pub encode_ms: f64,
    /// From the end of encoding to the first ranking.
    pub first_ms: f64,
    /// Each level after the first ranking, with the entries registered at it; finishing comes last.
    pub levels: Vec<(f64, u64)>,
    /// From the upload to the end.
    pub total_ms: f64,
    /// The server's processor time from upload to end.
    pub cpu_ms: f64,
}

fn failed(doing: &str) -> impl FnOnce(io::Error) -> ScaleError {
    let doing = doing.to_owned();
    move |source| ScaleError::Io { doing, source }
}

fn json(answer: &http::Answer, expected: &'static str) -> Result<Value, ScaleError> {
    let value = serde_json::from_slice(&answer.body).ok().filter(|_| answer.status < 300);
    value.ok_or_else(|| ScaleError::Answer { expected, found: format!("{}: {}", answer.status, answer.text()) })
}

fn posted(server: &Server, input: &[u8]) -> Result<String, ScaleError> {
    let answer = http::post(server.address(), "/v1/queries", "model/obj", input).map_err(failed("post a query"))?;
    let value = json(&answer, "a query")?;
    Ok(value["id"].as_str().unwrap_or_default().to_owned())
}

fn asked(server: &Server, id: &str) -> Result<Value, ScaleError> {
    let answer = http::get(server.address(), &format!("/v1/queries/{id}")).map_err(failed("ask for a query"))?;
    json(&answer, "a query")
}

/// Puts a query with defaults, and waits for its end.
///
/// # Errors
/// [`ScaleError`].
pub fn timed(server: &Server, name: &str, input: &[u8]) -> Result<Timed, ScaleError> {
    let (begun, cpu) = (Instant::now(), process::cpu_ms(server.id()));
    let id = posted(server, input)?;
    loop {
        let query = asked(server, &id)?;
        match query["state"].as_str() {
            Some("done") => return Ok(read(name, &query["timings"], process::cpu_ms(server.id()) - cpu)),
            Some("failed" | "cancelled") | None => {
                return Err(ScaleError::Answer { expected: "a query that ends well", found: query.to_string() });
            }
            Some(_) if begun.elapsed() > TIME_MAX => {
                return Err(ScaleError::Answer { expected: "a query that ends", found: query.to_string() });
            }
            Some(_) => std::thread::sleep(PAUSE),
        }
    }
}

fn read(name: &str, timings: &Value, cpu_ms: f64) -> Timed {
    let ms = |name: &str| timings[name].as_f64().unwrap_or_default();
    let level =
        |level: &Value| (level["ms"].as_f64().unwrap_or_default(), level["entries"].as_u64().unwrap_or_default());
    let levels: Vec<(f64, u64)> = timings["levels"].as_array().into_iter().flatten().map(level).collect();
    let before = ms("read_ms") + ms("queued_ms") + ms("encode_ms");
    Timed {
        name: name.to_owned(),
        encode_ms: ms("encode_ms"),
        first_ms: (ms("first_ranking_ms") - before).max(0.0),
        levels: levels.into_iter().skip(1).collect(),
        total_ms: ms("total_ms"),
        cpu_ms,
    }
}

/// Deletes a query after its first ranking: how long the server goes on computing.
///
/// # Errors
/// [`ScaleError`].
pub fn cancelled(server: &Server, input: &[u8]) -> Result<Duration, ScaleError> {
    let id = posted(server, input)?;
    let begun = Instant::now();
    while asked(server, &id)?["revision"].as_u64().unwrap_or_default() == 0 && begun.elapsed() < TIME_MAX {
        std::thread::sleep(PAUSE);
    }
    let deleted = Instant::now();
    http::ask(server.address(), &format!("DELETE /v1/queries/{id}"), &[], &[]).map_err(failed("delete a query"))?;
    let (mut last, mut cpu) = (deleted.elapsed(), process::cpu_ms(server.id()));
    while deleted.elapsed() < TIME_MAX {
        std::thread::sleep(LOOK);
        let now = process::cpu_ms(server.id());
        if now - cpu > IDLE_MS {
            (last, cpu) = (deleted.elapsed(), now);
        } else if deleted.elapsed() > last + IDLE {
            return Ok(last);
        }
    }
    Err(ScaleError::Answer { expected: "a server that is idle", found: format!("that it computes after {TIME_MAX:?}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timings_are_told_apart() {
        let timings = serde_json::json!({
            "read_ms": 20.0, "queued_ms": 1.0, "encode_ms": 100.0, "first_ranking_ms": 130.5, "total_ms": 900.0,
            "levels": [{"level": 32, "entries": 512, "ms": 8.0}, {"level": 32, "entries": 128, "ms": 200.0},
                       {"level": 64, "entries": 64, "ms": 150.0}],
        });
        let timed = read("head", &timings, 1234.0);
        assert_eq!((timed.first_ms, timed.encode_ms, timed.total_ms), (9.5, 100.0, 900.0));
        assert_eq!(timed.levels, [(200.0, 128), (150.0, 64)]);
    }
}
