//! Maps, compositions and retopologies while they are made: how an answer is waited for, and what is told until it is there.
//!
//! Who asks for one is answered at once, with 202 and how far it is; `?wait=` holds the answer until it is there, which then is
//! 201 with all of it.

use super::error::{HttpError, problem_of};
use super::idempotency::{Key, Turn};
use super::negotiate::{ResponsePreferences, choose};
use super::params::Params;
use super::stream::{Frames, HEARTBEAT, OFFERED, answer};
use crate::app::App;
use crate::work::WorkError;
use crate::work::making::{CancelOnDrop, Making, MakingStatus};
use crate::work::query::LiveQuery;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream::{Stream, unfold};
use quadmuse_proto::QueryId;
use quadmuse_proto::making::{self as proto, MakingEvent, MakingState, Product, WAIT_MAX};
use serde::Serialize;
use std::convert::Infallible;
use std::fmt::Display;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// For so long an answer is held where the caller names no time.
const WAIT_DEFAULT: Duration = Duration::ZERO;
/// For so long an answer is held at most.
pub const LONGEST: Duration = Duration::from_secs(WAIT_MAX);
/// The longest time that is accepted, in seconds; what is beyond [`WAIT_MAX`] is taken as that.
const WAIT_ACCEPTED_MAX: f64 = 86_400.0;

/// For how long the caller wants to wait.
///
/// # Errors
/// [`HttpError::Parameter`].
pub fn wait(params: &Params) -> Result<Duration, HttpError> {
    let expected = "seconds, from 0 to 86400";
    match params.get::<f64>("wait", expected)? {
        None => Ok(WAIT_DEFAULT),
        Some(seconds) if (0.0..=WAIT_ACCEPTED_MAX).contains(&seconds) => {
            Ok(Duration::from_secs_f64(seconds).min(LONGEST))
        }
        Some(found) => Err(HttpError::parameter("wait", expected, found)),
    }
}

/// Begins what is asked for, or finds what was begun under the same key, and waits for it; its id.
///
/// # Errors
/// Why it was refused, or failed within `wait`.
pub async fn begun<I: FromStr + Display>(
    app: &App,
    live: &LiveQuery,
    (key, fingerprint): (Key, blake3::Hash),
    (product, wait): (Product, Duration),
    start: impl FnOnce() -> Result<(I, Arc<Making>), WorkError>,
) -> Result<I, HttpError> {
    match app.idempotency.turn(key, fingerprint).await? {
        Turn::Made(made) => {
            let made = made.parse().map_err(|_| HttpError::Internal("a remembered id".into()))?;
            waited(live, product, &made, wait).await;
            Ok(made)
        }
        Turn::Make(claim) => {
            let (id, making) = start()?;
            awaited(live, &making, wait).await?;
            claim.made(&id);
            Ok(id)
        }
    }
}

/// Answers who had something made: 201 with what is there, or 202 with how far it is.
///
/// # Errors
/// That it is neither there nor made.
pub fn created<T: Serialize>(
    wants: &ResponsePreferences,
    live: &LiveQuery,
    (product, id): (Product, impl Display),
    there: Result<T, WorkError>,
) -> Result<Response, HttpError> {
    let location = Some(format!("/v1/queries/{}/{}s/{id}", live.id, product.as_str()));
    match there {
        Ok(there) => wants.answer(StatusCode::CREATED, location, &there),
        Err(missing) => wants.answer(StatusCode::ACCEPTED, location, &found(live, product, &id).ok_or(missing)?),
    }
}

/// Shows what is there, or how far it is.
///
/// # Errors
/// That it is neither there nor made.
pub fn shown<T: Serialize>(
    wants: &ResponsePreferences,
    live: &LiveQuery,
    (product, id): (Product, impl Display),
    there: Result<T, WorkError>,
) -> Result<Response, HttpError> {
    match there {
        Ok(there) => wants.show(&there),
        Err(missing) => wants.show(&found(live, product, &id).ok_or(missing)?),
    }
}

/// Waits for what was just begun. Who hangs up meanwhile was told nothing of it, so it is cancelled.
/// Fails with why it failed, or that somebody cancelled it, if that is known by then.
async fn awaited(live: &LiveQuery, making: &Arc<Making>, wait: Duration) -> Result<(), HttpError> {
    let unannounced = CancelOnDrop::new(making);
    let stand = making.within(wait).await;
    unannounced.announced();
    if wait.is_zero() {
        // Who doesn't wait is told where to look, however soon it failed.
        return Ok(());
    }
    match (stand.state, stand.failure) {
        (_, Some(failure)) => {
            live.makings.forget(&making.id);
            Err(WorkError::Query(failure).into())
        }
        (state @ MakingState::Cancelled, None) => {
            let (product, id) = (making.product.as_str(), making.id.clone());
            Err(WorkError::NotMade { product, id, state: state.as_str() }.into())
        }
        (_, None) => Ok(()),
    }
}

/// Waits for what was begun before, if it is still made.
pub async fn waited(live: &LiveQuery, product: Product, id: &impl ToString, wait: Duration) {
    if let Some(making) = live.makings.get(product, &id.to_string()) {
        making.within(wait).await;
    }
}

/// What is made, or was to be made, under an id.
pub fn found(live: &LiveQuery, product: Product, id: &impl ToString) -> Option<proto::Making> {
    live.makings.get(product, &id.to_string()).map(|making| described(live.id, &making))
}

/// How far it is, as it goes over the wire.
pub fn described(query: QueryId, making: &Making) -> proto::Making {
    to_wire(query, making, making.stand())
}

fn to_wire(query: QueryId, making: &Making, stand: MakingStatus) -> proto::Making {
    proto::Making {
        id: making.id.clone(),
        product: making.product,
        query,
        state: stand.state,
        progress: stand.progress,
        stage: stand.stage.into(),
        created: making.created.clone(),
        problem: stand.failure.map(|failure| problem_of(&HttpError::Work(WorkError::Query(failure)))),
    }
}

/// The stream of what is made under an id, or of what is `there` already.
///
/// # Errors
/// [`HttpError::NotAcceptable`], or that it is neither there nor made.
pub fn streamed<T>(
    app: &App,
    headers: &HeaderMap,
    live: &LiveQuery,
    (product, id): (Product, impl Display),
    there: Result<T, WorkError>,
) -> Result<Response, HttpError> {
    let id = id.to_string();
    match live.makings.get(product, &id) {
        Some(making) => stream(app, headers, live.id, &making),
        None => there.map_err(HttpError::from).and_then(|_| ended(headers, live.id, product, id)),
    }
}

/// The stream of what is made: `progress` as it gets further, and `end` once.
fn stream(app: &App, headers: &HeaderMap, query: QueryId, making: &Arc<Making>) -> Result<Response, HttpError> {
    let frames = choose(headers, &OFFERED)?;
    let (making, watch) = (Arc::clone(making), making.watch());
    let reader = Reader { query, making, watch, stopping: app.stopping.clone(), begun: false, ended: false };
    Ok(answer(frames, frames_of(reader, frames)))
}

/// The stream of what is there already: its end.
fn ended(headers: &HeaderMap, query: QueryId, product: Product, id: String) -> Result<Response, HttpError> {
    let frames = choose(headers, &OFFERED)?;
    let created = String::new();
    let (state, stage) = (MakingState::Done, "done".into());
    let done = proto::Making { id, product, query, state, progress: 1.0, stage, created, problem: None };
    let bytes = frames.event("end", None, &MakingEvent::End(done))?;
    Ok(answer(frames, futures_util::stream::iter([Ok(Bytes::from(bytes))])))
}

struct Reader {
    query: QueryId,
    making: Arc<Making>,
    watch: watch::Receiver<MakingStatus>,
    stopping: CancellationToken,
    begun: bool,
    ended: bool,
}

impl Reader {
    /// The next event, or nothing where it is time to show that the stream is alive; `None` after the last.
    async fn next(&mut self) -> Option<Option<MakingEvent>> {
        if self.ended {
            return None;
        }
        if std::mem::replace(&mut self.begun, true) && !self.watch.borrow().state.is_final() {
            tokio::select! {
                biased;
                changed = self.watch.changed() => changed.ok()?,
                () = self.stopping.cancelled() => return None,
                () = tokio::time::sleep(HEARTBEAT) => return Some(None),
            }
        }
        let stand = self.watch.borrow_and_update().clone();
        self.ended = stand.state.is_final();
        let making = to_wire(self.query, &self.making, stand);
        Some(Some(if self.ended { MakingEvent::End(making) } else { MakingEvent::Progress(making) }))
    }
}

fn frames_of(reader: Reader, frames: Frames) -> impl Stream<Item = Result<Bytes, Infallible>> {
    unfold(reader, move |mut reader| async move {
        let bytes = match reader.next().await? {
            None => Bytes::from_static(frames.heartbeat()),
            Some(event) => frames.event(event.name(), None, &event).ok()?.into(),
        };
        Some((Ok(bytes), reader))
    })
}
