//! Maps, compositions and retopologies while they are made: how an answer is waited for, and what is told until it is there.
//!
//! Who asks for one is answered at once, with 202 and how far it is; `?wait=` holds the answer until it is there, which then is
//! 201 with all of it.

use super::error::{HttpError, problem_of};
use super::negotiate::choose;
use super::params::Params;
use super::stream::{Frames, HEARTBEAT, OFFERED, answer};
use crate::app::App;
use crate::work::WorkError;
use crate::work::making::{Awaited, Making, Stand};
use crate::work::query::LiveQuery;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream::{Stream, unfold};
use quadmuse_proto::QueryId;
use quadmuse_proto::making::{self as proto, MakingEvent, MakingState, Product, WAIT_MAX};
use std::convert::Infallible;
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

/// Waits for what was just begun. Who hangs up meanwhile was told nothing of it, so it is cancelled.
///
/// # Errors
/// Why it failed, or that somebody cancelled it, if that is known by then.
pub async fn awaited(live: &LiveQuery, making: &Arc<Making>, wait: Duration) -> Result<(), HttpError> {
    let untold = Awaited::new(making);
    let stand = making.within(wait).await;
    untold.told();
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
    told(query, making, making.stand())
}

fn told(query: QueryId, making: &Making, stand: Stand) -> proto::Making {
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

/// The stream of what is made: `progress` as it gets further, and `end` once.
///
/// # Errors
/// [`HttpError::NotAcceptable`].
pub fn stream(app: &App, headers: &HeaderMap, query: QueryId, making: &Arc<Making>) -> Result<Response, HttpError> {
    let frames = choose(headers, &OFFERED)?;
    let (making, watch) = (Arc::clone(making), making.watch());
    let reader = Reader { query, making, watch, stopping: app.stopping.clone(), begun: false, ended: false };
    Ok(answer(frames, frames_of(reader, frames)))
}

/// The stream of what is there already: its end.
///
/// # Errors
/// [`HttpError::NotAcceptable`].
pub fn ended(headers: &HeaderMap, query: QueryId, product: Product, id: String) -> Result<Response, HttpError> {
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
    watch: watch::Receiver<Stand>,
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
        let making = told(self.query, &self.making, stand);
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
