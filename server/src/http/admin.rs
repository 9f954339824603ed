//! `/v1/admin`: how the service is in detail, a check of the corpus, a backup while it runs.

use super::error::HttpError;
use super::negotiate::ResponsePreferences;
use crate::app::App;
use crate::pool::taken;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::Response;
use bytes::Bytes;
use futures_util::stream::unfold;
use quadmuse_proto::admin::{CallerUse, Check, DamagedExample, Status};
use std::io::{self, Write};
use tokio::sync::mpsc;

/// Pieces of a backup that wait to be sent.
const PIECES_WAITING: usize = 4;

/// Bytes of a piece, about.
const PIECE_BYTES: usize = 256 << 10;

/// How the service is.
#[utoipa::path(get, path = "/v1/admin/status", tag = "admin", responses((status = 200, description = "The status", body = Status)))]
pub async fn status(State(app): State<App>, wants: ResponsePreferences) -> Result<Response, HttpError> {
    let (health, admission) = (app.work.corpus.health(), app.work.pool.admission());
    let memory = taken::of_process();
    let caller = |(user, used): (crate::pool::User, crate::pool::Used)| CallerUse {
        caller: format!("{:016x}", user.0),
        jobs: used.places,
        memory_bytes: used.bytes,
    };
    wants.show(&Status {
        unwritable: health.read_only,
        damaged: health.quarantined.iter().map(|id| DamagedExample { example: id.to_string() }).collect(),
        callers: admission.by_user().into_iter().map(caller).collect(),
        memory_limit_bytes: admission.limit_bytes(),
        memory_admitted_bytes: admission.used().bytes,
        memory_allocated_bytes: memory.allocated,
        memory_resident_bytes: memory.resident,
    })
}

/// Reads every byte of the corpus and reports what is damaged; changes nothing.
#[utoipa::path(post, path = "/v1/admin/check", tag = "admin", responses((status = 200, description = "What was found", body = Check)))]
pub async fn check(State(app): State<App>, wants: ResponsePreferences) -> Result<Response, HttpError> {
    let found = app.work.blocking(|work| Ok(work.corpus.check()?)).await?;
    let (examples, segments, bytes, problems) = (found.examples, found.segments, found.bytes, found.problems);
    wants.answer(StatusCode::OK, None, &Check { examples, segments, bytes, problems })
}

/// Writes the corpus as it is at this moment, for `quadmuse-server restore`; the service goes on meanwhile. Where an
/// example is damaged and left out, the answer breaks off before its end, so that it is not taken for a whole backup.
#[utoipa::path(
    get, path = "/v1/admin/backup", tag = "admin",
    responses((status = 200, description = "The backup", content_type = "application/octet-stream", body = Vec<u8>))
)]
pub async fn backup(State(app): State<App>) -> Response {
    let (send, receive) = mpsc::channel(PIECES_WAITING);
    let work = std::sync::Arc::clone(&app.work);
    app.work.background.spawn_blocking(move || {
        let mut out = Pieces { send: send.clone(), piece: Vec::new() };
        let ended = work.corpus.backup(&mut out).map_err(|error| io::Error::other(error.to_string()));
        let whole = ended.and_then(|skipped| match skipped.first() {
            None => out.flush(),
            Some((id, reason)) => {
                Err(io::Error::other(format!("{} left out, the first {id}: {reason}", skipped.len())))
            }
        });
        if let Err(error) = whole {
            tracing::error!(%error, "a backup was not whole");
            // The one who asked may be gone.
            let _ = send.blocking_send(Err(error));
        }
    });
    let pieces = unfold(receive, |mut receive| async move { receive.recv().await.map(|piece| (piece, receive)) });
    let mut response = Response::new(Body::from_stream(pieces));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let disposition = HeaderValue::from_static("attachment; filename=\"quadmuse.backup\"");
    headers.insert(header::CONTENT_DISPOSITION, disposition);
    response
}

/// Writes pieces into a channel; waits where the reader is slow, and ends with it.
struct Pieces {
    send: mpsc::Sender<io::Result<Bytes>>,
    piece: Vec<u8>,
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.piece.extend_from_slice(bytes);
        if self.piece.len() >= PIECE_BYTES {
            self.flush()?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.piece.is_empty() {
            return Ok(());
        }
        let piece = std::mem::take(&mut self.piece).into();
        self.send.blocking_send(Ok(piece)).map_err(|_| io::ErrorKind::BrokenPipe.into())
    }
}
