//! A crowd that polls and streams while others saturate the service: whether it is answered, and whether health is.

use super::{Caller, Did, Times, has_end, saturate, spawn};
use crate::{http, scale::ScaleError, server::Server};
use std::{
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

/// How often a poller asks.
const POLL_EVERY: Duration = Duration::from_secs(1);
/// How often health is asked for.
const HEALTH_EVERY: Duration = Duration::from_millis(20);

/// What came of it.
#[derive(Clone, Debug, Default)]
pub struct Crowd {
    /// Health's times.
    pub health: Times,
    /// Polls answered, and those that were not.
    pub polls: [usize; 2],
    /// Streams that ended with their `end` event, and those that did not.
    pub streams: [usize; 2],
    /// What the saturating clients did.
    pub did: Did,
}

/// Lets `pollers` poll, `streams` stream and `clients` send queries for so long.
///
/// # Errors
/// [`ScaleError`].
pub fn measure(
    server: &Server,
    mesh: &[u8],
    [pollers, streams, clients]: [usize; 3],
    time: Duration,
) -> Result<Crowd, ScaleError> {
    let over = AtomicBool::new(false);
    let newest: Mutex<Vec<String>> = Mutex::default();
    let counts: [AtomicUsize; 4] = Default::default();
    let count = |at: usize, good: bool| counts[2 * at + usize::from(!good)].fetch_add(1, Ordering::Relaxed);
    let taken = |id: &str| newest.lock().unwrap_or_else(PoisonError::into_inner).push(id.to_owned());
    // The query watched is one of the last that were taken: an older one may have made room.
    let watched = |at: usize| {
        let newest = newest.lock().unwrap_or_else(PoisonError::into_inner);
        newest.len().checked_sub(1 + at % newest.len().clamp(1, 4)).map(|at| newest[at].clone())
    };
    let failed = |source| ScaleError::Io { doing: "start a thread".into(), source };
    let is_over = || over.load(Ordering::Relaxed);
    thread::scope(|scope| {
        let caller = Caller { server, token: None };
        let clients = saturate(scope, (server, mesh), clients, &over, &taken).map_err(failed)?;
        for at in 0..pollers {
            let caller = caller.clone();
            let poll = move || {
                while !is_over() {
                    if let Some(id) = watched(at) {
                        let answer = caller.ask(&format!("GET /v1/queries/{id}"), None);
                        count(0, answer.is_ok_and(|answer| [200, 410].contains(&answer.status)));
                    }
                    thread::sleep(POLL_EVERY);
                }
            };
            spawn(scope, poll).map_err(failed)?;
        }
        for at in 0..streams {
            let caller = caller.clone();
            let stream = move || {
                while !is_over() {
                    match watched(at) {
                        Some(id) => {
                            let answer = caller.ask(&format!("GET /v1/queries/{id}/stream"), None);
                            count(1, answer.is_ok_and(|answer| answer.status == 410 || has_end(&answer)));
                        }
                        None => thread::sleep(POLL_EVERY),
                    }
                    // A query that has ended is streamed in no time.
                    thread::sleep(POLL_EVERY / 2);
                }
            };
            spawn(scope, stream).map_err(failed)?;
        }
        let (begun, mut health) = (Instant::now(), Times::default());
        while begun.elapsed() < time {
            let asked = Instant::now();
            let answer = http::get(server.address(), "/healthz");
            let took = asked.elapsed().as_secs_f64() * 1000.0;
            health.0.push(if answer.is_ok_and(|answer| answer.status == 200) { took } else { f64::INFINITY });
            thread::sleep(HEALTH_EVERY);
        }
        over.store(true, Ordering::Relaxed);
        let did = Did::all(clients);
        let [polls, lost, ended, broken] = counts.each_ref().map(|count| count.load(Ordering::Relaxed));
        Ok(Crowd { health, polls: [polls, lost], streams: [ended, broken], did })
    })
}
