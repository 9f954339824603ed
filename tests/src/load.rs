//! The service under load, measured from outside: crowds that watch, floods that ask, one user beside another, edits.
//!
//! Many small threads with a connection each: what waits here costs the machine little, and what is measured is the server.

pub mod cancel;
pub mod crowd;
pub mod fairness;
pub mod flood;
pub mod siege;

use crate::{http, scale::ScaleError, server::Server};
use serde_json::Value;
use std::{
    io,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread::{self, Scope, ScopedJoinHandle},
    time::{Duration, Instant},
};

/// Stack of a thread that only waits, in bytes.
const STACK_BYTES: usize = 256 << 10;
/// Pause between two looks at a query.
const PAUSE: Duration = Duration::from_millis(20);
/// Longest wait for a query.
const TIME_MAX: Duration = Duration::from_secs(300);

/// Times in milliseconds.
#[derive(Clone, Debug, Default)]
pub struct Times(pub Vec<f64>);

impl Times {
    /// The time that this share (0–1) of all stays below; not a number where there are none.
    pub fn share(&self, share: f64) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let at = ((sorted.len() as f64 * share).ceil() as usize).clamp(1, sorted.len().max(1)) - 1;
        sorted.get(at).copied().unwrap_or(f64::NAN)
    }

    /// Median, p95, p99 and the most, as a row tells them.
    pub fn summary(&self) -> String {
        let [median, most_of, nearly_all, most] = [0.5, 0.95, 0.99, 1.0].map(|share| self.share(share));
        format!("{} times, p50 {median:.1}, p95 {most_of:.1}, p99 {nearly_all:.1}, most {most:.1} ms", self.0.len())
    }
}

/// Starts a server for a crowd: as many connections as it needs, and no limit on the rate of calls, which all come from one address.
///
/// # Errors
/// [`ScaleError`].
pub fn server(data: &Path) -> Result<Server, ScaleError> {
    let words =
        ["env", "QUADMUSE_CONNECTIONS=4096", "QUADMUSE_CONNECTIONS_PER_ADDRESS=4000", "QUADMUSE_RATE_LIMIT=1000000"];
    Ok(Server::start_under(&words, data)?)
}

/// A small thread.
///
/// # Errors
/// The system refuses.
pub fn spawn<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() -> T + Send + 'scope,
) -> io::Result<ScopedJoinHandle<'scope, T>> {
    thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, work)
}

/// Somebody who calls.
#[derive(Clone, Debug)]
pub struct Caller<'a> {
    /// The server called.
    pub server: &'a Server,
    /// The token that is shown, if any.
    pub token: Option<String>,
}

/// What came of sending a query.
#[derive(Clone, Debug)]
pub enum Sent {
    /// It is taken, under this id.
    Taken(String),
    /// It is refused for now; whether the answer says when to come again.
    Later(bool),
}

impl Caller<'_> {
    /// Asks the server something.
    ///
    /// # Errors
    /// [`ScaleError`].
    pub fn ask(&self, line: &str, body: Option<(&str, &[u8])>) -> Result<http::Answer, ScaleError> {
        let token = self.token.as_ref().map(|token| format!("Bearer {token}"));
        let mut headers: Vec<(&str, &str)> = token.iter().map(|token| ("authorization", token.as_str())).collect();
        let length = body.map_or(0, |(_, body)| body.len()).to_string();
        if let Some((content_type, _)) = body {
            headers.extend([("content-type", content_type), ("content-length", &length)]);
        }
        let answer = http::ask(self.server.address(), line, &headers, body.map_or(&[], |(_, body)| body));
        answer.map_err(|source| ScaleError::Io { doing: line.to_owned(), source })
    }

    /// Asks for JSON.
    ///
    /// # Errors
    /// [`ScaleError`].
    pub fn value(&self, line: &str, body: Option<(&str, &[u8])>) -> Result<Value, ScaleError> {
        let answer = self.ask(line, body)?;
        let value = serde_json::from_slice(&answer.body).ok().filter(|_| answer.status < 300);
        value.ok_or_else(|| ScaleError::Answer {
            expected: "a good answer",
            found: format!("{line}: {}", answer.text()),
        })
    }

    /// Sends a query.
    ///
    /// # Errors
    /// [`ScaleError`].
    pub fn send(&self, mesh: &[u8]) -> Result<Sent, ScaleError> {
        self.send_as("model/obj", mesh)
    }

    /// The same with a mesh of another format.
    ///
    /// # Errors
    /// [`ScaleError`].
    pub fn send_as(&self, content_type: &str, mesh: &[u8]) -> Result<Sent, ScaleError> {
        let answer = self.ask("POST /v1/queries", Some((content_type, mesh)))?;
        if [429, 503].contains(&answer.status) {
            return Ok(Sent::Later(answer.header("retry-after").is_some()));
        }
        let value = answer.json();
        match value["id"].as_str().filter(|_| answer.status < 300) {
            Some(id) => Ok(Sent::Taken(id.to_owned())),
            None => {
                Err(ScaleError::Answer { expected: "a query", found: format!("{}: {}", answer.status, answer.text()) })
            }
        }
    }

    /// Waits for the end of a query, by its stream as clients do, or until it has its first ranking, by looking again and again;
    /// false if it didn't come in time.
    ///
    /// # Errors
    /// [`ScaleError`].
    pub fn wait(&self, id: &str, until: Until) -> Result<bool, ScaleError> {
        let begun = Instant::now();
        while begun.elapsed() < TIME_MAX {
            if until == Until::End {
                let answer = self.ask(&format!("GET /v1/queries/{id}/stream"), None)?;
                if answer.status == 410 || has_end(&answer) {
                    return Ok(true);
                }
                thread::sleep(PAUSE);
                continue;
            }
            let query = self.value(&format!("GET /v1/queries/{id}"), None)?;
            let is_over = matches!(query["state"].as_str(), Some("done" | "failed" | "cancelled"));
            if is_over || (until == Until::First && query["revision"].as_u64().unwrap_or_default() > 0) {
                return Ok(true);
            }
            thread::sleep(PAUSE);
        }
        Ok(false)
    }
}

/// Whether a stream ended with its last event.
pub fn has_end(answer: &http::Answer) -> bool {
    let is_end = |line: &str| line.strip_prefix("event:").is_some_and(|event| event.trim() == "end");
    answer.status == 200 && answer.text().lines().any(is_end)
}

/// What of a query is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Until {
    /// Its first ranking.
    First,
    /// Its end.
    End,
}

/// Keeps `count` clients sending queries, each the next when its last has ended, until `over`; what each did, in order of clients.
pub fn saturate<'scope>(
    scope: &'scope Scope<'scope, '_>,
    (server, mesh): (&'scope Server, &'scope [u8]),
    count: usize,
    over: &'scope AtomicBool,
    taken: &'scope (dyn Fn(&str) + Sync),
) -> io::Result<Vec<ScopedJoinHandle<'scope, Did>>> {
    let client = move || {
        let (caller, mut did) = (Caller { server, token: None }, Did::default());
        while !over.load(Ordering::Relaxed) {
            let begun = Instant::now();
            match caller.send(mesh) {
                Ok(Sent::Taken(id)) => {
                    taken(&id);
                    match caller.wait(&id, Until::End) {
                        Ok(true) => did.ended.push(Instant::now()),
                        Ok(false) | Err(_) => did.errors += 1,
                    }
                }
                Ok(Sent::Later(says_when)) => {
                    did.refused.0.push(begun.elapsed().as_secs_f64() * 1000.0);
                    did.silent += usize::from(!says_when);
                    thread::sleep(10 * PAUSE);
                }
                Err(_) => did.errors += 1,
            }
        }
        did
    };
    (0..count).map(|_| spawn(scope, client)).collect()
}

/// What a client did.
#[derive(Clone, Debug, Default)]
pub struct Did {
    /// When its queries ended.
    pub ended: Vec<Instant>,
    /// How long refusals took.
    pub refused: Times,
    /// Refusals that did not say when to come again.
    pub silent: usize,
    /// Calls that failed.
    pub errors: usize,
}

impl Did {
    /// What several did together.
    pub fn all(clients: Vec<ScopedJoinHandle<'_, Did>>) -> Did {
        let mut all = Did::default();
        for client in clients {
            let Ok(did) = client.join() else {
                all.errors += 1;
                continue;
            };
            all.ended.extend(did.ended);
            all.refused.0.extend(did.refused.0);
            all.silent += did.silent;
            all.errors += did.errors;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_times_is_the_least_that_so_many_stay_within() {
        let times = Times((1..=100).rev().map(f64::from).collect());
        assert_eq!([0.5, 0.95, 0.99, 1.0].map(|share| times.share(share)), [50.0, 95.0, 99.0, 100.0]);
        assert_eq!(Times(vec![7.0]).share(0.99), 7.0);
        assert!(Times::default().share(0.5).is_nan());
    }
}
