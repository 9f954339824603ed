//! `/v1/queries/{id}/stream`: the ranking as a stream of events, by SSE, NDJSON or MessagePack.
//!
//! A stream holds no events: when its reader is ready, it looks at the query's board and sends the oldest ranking that
//! the reader has not seen. So the latest ranking wins, and a slow reader holds nobody.

use super::error::{HttpError, problem_of};
use super::negotiate::{MSGPACK, Wire, choose};
use super::params::{Params, PathIds};
use super::queries::described;
use crate::app::App;
use crate::work::query::{Board, LiveQuery};
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream::{Stream, unfold};
use quadmuse_proto::ranking::ENTRIES_DEFAULT;
use quadmuse_proto::{End, Event, QueryId, StreamError};
use serde::Serialize;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// How often a silent stream shows that it is alive.
pub(super) const HEARTBEAT: Duration = Duration::from_secs(10);

/// The media type of server-sent events.
const SSE: &str = "text/event-stream";
/// The media type of JSON lines.
const NDJSON: &str = "application/x-ndjson";

/// How events are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frames {
    Sse,
    Ndjson,
    MsgPack,
}

/// What a stream may be asked for as.
pub(super) const OFFERED: [(&str, Frames); 3] =
    [(SSE, Frames::Sse), (NDJSON, Frames::Ndjson), (MSGPACK, Frames::MsgPack)];

impl Frames {
    fn media_type(self) -> &'static str {
        match self {
            Self::Sse => SSE,
            Self::Ndjson => NDJSON,
            Self::MsgPack => MSGPACK,
        }
    }

    /// An event of this name, which is gone on from by its `id`.
    pub(super) fn event(self, name: &str, id: Option<u64>, event: &impl Serialize) -> Result<Vec<u8>, HttpError> {
        match self {
            Self::MsgPack => Wire::MsgPack.write(event),
            Self::Ndjson => {
                let mut line = Wire::Json.write(event)?;
                line.push(b'\n');
                Ok(line)
            }
            Self::Sse => {
                let mut frame = format!("event: {name}\n").into_bytes();
                id.iter().for_each(|id| frame.extend(format!("id: {id}\n").into_bytes()));
                frame.extend(b"data: ");
                // JSON escapes line breaks, so that the object is one line.
                frame.extend(Wire::Json.write(event)?);
                frame.extend(b"\n\n");
                Ok(frame)
            }
        }
    }

    pub(super) fn heartbeat(self) -> &'static [u8] {
        match self {
            Self::Sse => b":\n\n",
            Self::Ndjson => b"\n",
            Self::MsgPack => &[0xc0],
        }
    }
}

/// The ranking as it is refined: `begin`, a `level` after each level of each segment, and `end` (or `error`).
#[utoipa::path(
    get, path = "/v1/queries/{id}/stream", tag = "queries",
    params(
        ("id" = QueryId, Path),
        ("limit" = Option<u32>, Query, minimum = 1, maximum = 500, description = "Entries a ranking; default 200"),
        ("Last-Event-ID" = Option<u64>, Header, description = "The revision after which to go on"),
    ),
    responses((status = 200, description = "Events, by `accept`: server-sent events, JSON lines or MessagePack objects", content(
        (Event = "text/event-stream"), (Event = "application/x-ndjson")
    )))
)]
pub async fn stream(
    State(app): State<App>,
    PathIds((id,)): PathIds<(QueryId,)>,
    params: Params,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let live = app.work.queries.get(id)?;
    let limit = params.limit(ENTRIES_DEFAULT)?;
    let frames = choose(&headers, &OFFERED)?;
    let resumed = match headers.get("last-event-id") {
        None => None,
        Some(value) => {
            let revision = value.to_str().ok().and_then(|text| text.parse::<u64>().ok());
            let wrong =
                || HttpError::parameter("last-event-id", "a revision", String::from_utf8_lossy(value.as_bytes()));
            Some(revision.ok_or_else(wrong)?)
        }
    };
    let reader = Reader::new(live, resumed, limit, app.stopping.clone());
    Ok(answer(frames, frames_of(reader, frames)))
}

/// The answer that is a stream.
pub(super) fn answer<S>(frames: Frames, stream: S) -> Response
where
    S: Stream<Item = Result<Bytes, Infallible>> + Send + 'static,
{
    let mut response = Response::new(Body::from_stream(stream));
    let out = response.headers_mut();
    out.insert(header::CONTENT_TYPE, HeaderValue::from_static(frames.media_type()));
    out.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    out.insert("x-accel-buffering", HeaderValue::from_static("no"));
    response
}

/// An item that a reader is given.
enum StreamItem {
    Event(Box<Event>),
    Heartbeat,
}

/// One reader of a query's stream.
struct Reader {
    live: Arc<LiveQuery>,
    board: watch::Receiver<Board>,
    limit: usize,
    stopping: CancellationToken,
    begun: bool,
    ended: bool,
    seen: u64,
}

impl Reader {
    fn new(live: Arc<LiveQuery>, resumed: Option<u64>, limit: usize, stopping: CancellationToken) -> Self {
        let board = live.watch();
        let (begun, seen) = (resumed.is_some(), resumed.unwrap_or(0));
        Self { live, board, limit, stopping, begun, ended: false, seen }
    }

    /// The next event; `None` after the last.
    async fn next(&mut self) -> Option<StreamItem> {
        if self.ended {
            return None;
        }
        if !std::mem::replace(&mut self.begun, true) {
            return Some(StreamItem::Event(Box::new(Event::Begin(self.live.begin()))));
        }
        loop {
            if let Some(event) = self.unseen() {
                self.ended = event.is_last();
                return Some(StreamItem::Event(Box::new(event)));
            }
            tokio::select! {
                biased;
                changed = self.board.changed() => changed.ok()?,
                () = self.stopping.cancelled() => {
                    self.ended = true;
                    let (query, problem) = (self.live.id, problem_of(&HttpError::Stopping));
                    return Some(StreamItem::Event(Box::new(Event::Error(StreamError { query, problem }))));
                }
                () = tokio::time::sleep(HEARTBEAT) => return Some(StreamItem::Heartbeat),
            }
        }
    }

    /// The oldest of the newest rankings that was not seen, or the end.
    fn unseen(&mut self) -> Option<Event> {
        let board = self.board.borrow_and_update().clone();
        let unseen = board.rankings.iter().enumerate().filter(|(_, ranking)| ranking.revision > self.seen);
        if let Some((segment, ranking)) = unseen.min_by_key(|(_, ranking)| ranking.revision) {
            self.seen = ranking.revision;
            return self.live.ranking(&board, segment as u32, self.limit).ok().map(Event::Level);
        }
        let end = self.live.ending(&board)?;
        Some(Event::End(Box::new(End { summary: described(&self.live), ..end })))
    }
}

fn frames_of(reader: Reader, frames: Frames) -> impl Stream<Item = Result<Bytes, Infallible>> {
    unfold(reader, move |mut reader| async move {
        let bytes = match reader.next().await? {
            StreamItem::Heartbeat => Bytes::from_static(frames.heartbeat()),
            StreamItem::Event(event) => match frames.event(event.name(), event.revision(), &*event) {
                Ok(bytes) => bytes.into(),
                Err(error) => {
                    tracing::error!(%error, "an event could not be written");
                    return None;
                }
            },
        };
        Some((Ok(bytes), reader))
    })
}
