//! How long the service goes on computing after something is cancelled at a random moment.
//!
//! A moment is a share of the processor time that the whole takes, so that a busy machine changes neither what is under
//! way nor what is measured: the processor time that a computing thread takes from the answer of `DELETE` until it sleeps.

use super::{Caller, PAUSE, Sent, Times, Until};
use crate::{
    bounds::families::random,
    scale::{ScaleError, process},
};
use serde_json::Value;
use std::{
    thread,
    time::{Duration, Instant},
};

/// Pause between two looks at the threads.
const LOOK: Duration = Duration::from_millis(1);
/// Looks one after the other at which all threads slept, until they count as free.
const ASLEEP_LOOKS: u32 = 5;
/// Longest wait for one thing.
const TIME_MAX: Duration = Duration::from_secs(300);
/// The threads that compute.
const COMPUTING: &str = "compute-";

/// What is cancelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A query.
    Query,
    /// A map.
    Map,
    /// A composition.
    Composition,
    /// A retopology.
    Retopo,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Query, Self::Map, Self::Composition, Self::Retopo];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Query => "query",
            Self::Map => "map",
            Self::Composition => "composition",
            Self::Retopo => "retopo",
        }
    }
}

/// What a cancelled computation took yet.
#[derive(Clone, Debug)]
pub struct Held {
    /// Processor time of the thread that took most, in milliseconds.
    pub ms: f64,
    /// The share of the whole that was over, 0–1.
    pub at: f64,
    /// What was under way.
    pub stage: String,
}

/// The waits of many cancellations of one thing.
#[derive(Clone, Debug)]
pub struct Cancelled {
    /// Processor time of the whole, in milliseconds.
    pub whole_ms: f64,
    /// Each cancellation that came before the end.
    pub held: Vec<Held>,
}

impl Cancelled {
    /// The waits alone.
    pub fn times(&self) -> Times {
        Times(self.held.iter().map(|held| held.ms).collect())
    }
}

/// Cancels one thing of a mesh `times` times, at moments spread over all that it takes; `None` where there is none of that kind.
///
/// # Errors
/// [`ScaleError`].
pub fn measure(
    caller: &Caller<'_>,
    kind: Kind,
    (content_type, mesh): (&str, &[u8]),
    times: usize,
) -> Result<Option<Cancelled>, ScaleError> {
    let before = computing_ms(caller);
    let query = sent(caller, content_type, mesh)?;
    caller.wait(&query, Until::End)?;
    free(caller)?;
    let (whole_ms, made) = match kind {
        Kind::Query => (computing_ms(caller) - before, None),
        Kind::Map | Kind::Composition | Kind::Retopo => {
            let Some(body) = wanted(caller, kind, &query)? else { return Ok(None) };
            // Maps that a composition has made are there for the next: the second is what all others take.
            let mut before = computing_ms(caller);
            for _ in 0..2 {
                before = computing_ms(caller);
                let made = begun(caller, kind, &query, &body)?;
                over(caller, &made)?;
                free(caller)?;
                delete(caller, &made)?;
            }
            (computing_ms(caller) - before, Some(body))
        }
    };
    let mut held = Vec::new();
    for k in 0..times {
        let at = (k as f64 + random(k)) / times as f64;
        let target = match &made {
            None => format!("/v1/queries/{}", sent(caller, content_type, mesh)?),
            Some(body) => begun(caller, kind, &query, body)?,
        };
        held.extend(cancelled(caller, &target, (at, whole_ms))?);
    }
    delete(caller, &format!("/v1/queries/{query}"))?;
    Ok(Some(Cancelled { whole_ms, held }))
}

/// Waits until so much of it was computed, and cancels it; `None` where it had ended.
fn cancelled(caller: &Caller<'_>, target: &str, (at, whole_ms): (f64, f64)) -> Result<Option<Held>, ScaleError> {
    let (begun, before) = (Instant::now(), computing_ms(caller));
    while computing_ms(caller) - before < at * whole_ms
        && begun.elapsed() < TIME_MAX
        && !(asleep(caller) && is_over(caller, target)?)
    {
        thread::sleep(LOOK);
    }
    let now = caller.value(&format!("GET {target}"), None)?;
    let stage = now["stage"].as_str().unwrap_or(now["state"].as_str().unwrap_or_default()).to_owned();
    delete(caller, target)?;
    let held = free(caller)?;
    Ok((!has_ended(&now)).then_some(Held { ms: held, at, stage }))
}

/// The most processor time that a computing thread takes from now until all sleep, in milliseconds.
fn free(caller: &Caller<'_>) -> Result<f64, ScaleError> {
    let (begun, before) = (Instant::now(), process::threads(caller.server.id(), COMPUTING));
    let mut looks = 0;
    while looks < ASLEEP_LOOKS {
        looks = if asleep(caller) { looks + 1 } else { 0 };
        if begun.elapsed() > TIME_MAX {
            let found = format!("that it computes after {TIME_MAX:?}");
            return Err(ScaleError::Answer { expected: "a server whose threads sleep", found });
        }
        thread::sleep(LOOK);
    }
    let after = process::threads(caller.server.id(), COMPUTING);
    let took = |thread: &process::Thread| {
        let earlier = before.iter().find(|other| other.id == thread.id);
        thread.cpu_ms - earlier.map_or(0.0, |other| other.cpu_ms)
    };
    Ok(after.iter().map(took).fold(0.0, f64::max))
}

fn asleep(caller: &Caller<'_>) -> bool {
    process::threads(caller.server.id(), COMPUTING).iter().all(|thread| thread.is_asleep)
}

fn computing_ms(caller: &Caller<'_>) -> f64 {
    process::threads(caller.server.id(), COMPUTING).iter().map(|thread| thread.cpu_ms).sum()
}

fn sent(caller: &Caller<'_>, content_type: &str, mesh: &[u8]) -> Result<String, ScaleError> {
    let begun = Instant::now();
    loop {
        match caller.send_as(content_type, mesh)? {
            Sent::Taken(id) => return Ok(id),
            Sent::Later(_) if begun.elapsed() < TIME_MAX => thread::sleep(PAUSE),
            Sent::Later(_) => {
                return Err(ScaleError::Answer { expected: "room for a query", found: "that it is refused".into() });
            }
        }
    }
}

/// What is asked of a query that ended: a map of its best example, its composition, or quads for all of it.
fn wanted(caller: &Caller<'_>, kind: Kind, query: &str) -> Result<Option<Value>, ScaleError> {
    if kind != Kind::Map {
        return Ok(Some(serde_json::json!({})));
    }
    let ranking = caller.value(&format!("GET /v1/queries/{query}/ranking"), None)?;
    let best = &ranking["entries"][0];
    let part = &best["example_segment"];
    let wanted = |example| serde_json::json!({ "segment": 0, "example": example, "example_segment": part });
    Ok(best["example"].as_str().map(wanted))
}

fn begun(caller: &Caller<'_>, kind: Kind, query: &str, body: &Value) -> Result<String, ScaleError> {
    let all = format!("/v1/queries/{query}/{}s", kind.name());
    let body = body.to_string();
    let making = caller.value(&format!("POST {all}"), Some(("application/json", body.as_bytes())))?;
    Ok(format!("{all}/{}", making["id"].as_str().unwrap_or_default()))
}

fn is_over(caller: &Caller<'_>, target: &str) -> Result<bool, ScaleError> {
    Ok(has_ended(&caller.value(&format!("GET {target}"), None)?))
}

fn over(caller: &Caller<'_>, target: &str) -> Result<(), ScaleError> {
    let begun = Instant::now();
    while !is_over(caller, target)? && begun.elapsed() < TIME_MAX {
        thread::sleep(PAUSE);
    }
    Ok(())
}

fn delete(caller: &Caller<'_>, target: &str) -> Result<(), ScaleError> {
    caller.ask(&format!("DELETE {target}"), None).map(drop)
}

/// Tells whether something ended by what is told of it; what is gone has.
fn has_ended(answer: &Value) -> bool {
    matches!(answer["state"].as_str(), Some("done" | "failed" | "cancelled") | None)
}
