//! The accept loop, and how it ends.
//!
//! Ours instead of `axum::serve`, which has no time limit on headers and never ends while a stream is open. A client that takes nothing of what it is sent is dropped,
//! too. On a
//! signal the listener closes, `stopping` is set (streams send their last event, long polls answer), idle connections
//! are closed, and those that are still open after [`DRAIN_TIME_MAX`] are dropped.

use crate::connections::{ConnectionPlace, Connections, ReserveReason};
use crate::http::caller::Peer;
use axum::Router;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

/// Longest time for a request's head to arrive.
const HEADER_TIME_MAX: Duration = Duration::from_secs(10);

/// Longest time for open connections to end after a signal.
pub const DRAIN_TIME_MAX: Duration = Duration::from_secs(8);

/// Pause after an error of the listener (out of descriptors).
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Longest time for the head of a request in the reserve to arrive.
const RESERVED_HEADER_TIME_MAX: Duration = Duration::from_secs(2);

/// Longest time in which a client that was sent something takes none of it.
const WRITE_TIME_MAX: Duration = Duration::from_secs(20);

/// Most bytes of a head, and of an answer that waits to be written.
const BUFFER_BYTES_MAX: usize = 128 << 10;

/// Serves until `stopping` is set, then drains. Connections beyond `limits` are taken into the reserve (see
/// [`crate::connections`]).
pub async fn serve(listener: TcpListener, router: Router, connections: Connections, stopping: CancellationToken) {
    let open = TaskTracker::new();
    let abort = CancellationToken::new();
    while let Some((stream, peer)) = stopping.run_until_cancelled(accept(&listener)).await {
        let (router, stopping, abort) = (router.clone(), stopping.clone(), abort.clone());
        let place = connections.place(peer.ip());
        open.spawn(async move {
            // A connection that is dropped drops its request, and so stops its computation.
            match place {
                ConnectionPlace::Served(place) => {
                    abort.run_until_cancelled(connection(stream, peer, router, stopping, None)).await;
                    drop(place);
                }
                ConnectionPlace::Reserved(place, beyond) => {
                    let served = connection(stream, peer, router, stopping, Some(beyond));
                    abort.run_until_cancelled(place.run_until_cancelled(served)).await;
                    place.cancel();
                }
            }
        });
    }
    drop(listener);
    open.close();
    if tokio::time::timeout(DRAIN_TIME_MAX, open.wait()).await.is_err() {
        tracing::warn!(open = open.len(), "dropping connections that did not end");
        abort.cancel();
        open.wait().await;
    }
}

async fn accept(listener: &TcpListener) -> (TcpStream, SocketAddr) {
    loop {
        match listener.accept().await {
            Ok(accepted) => return accepted,
            Err(error) => {
                tracing::warn!(%error, "no connection accepted");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

async fn connection(
    stream: TcpStream,
    peer: SocketAddr,
    router: Router,
    stopping: CancellationToken,
    beyond: Option<ReserveReason>,
) {
    // Small events go out at once; if the system refuses, they go out later.
    let _ = stream.set_nodelay(true);
    let service = hyper::service::service_fn(move |request: Request<Incoming>| {
        let router = router.clone();
        async move {
            let (mut head, body) = request.into_parts();
            head.extensions.insert(Peer(peer.ip()));
            head.extensions
                .extend(beyond.map(crate::http::caller::ReservedConnection).map(into_extensions).unwrap_or_default());
            let answer: Result<_, Infallible> = router.oneshot(Request::from_parts(head, Body::new(body))).await;
            answer
        }
    });
    let mut patient = TimeoutStream::new(stream);
    patient.set_write_timeout(Some(WRITE_TIME_MAX));
    let header_time = if beyond.is_some() { RESERVED_HEADER_TIME_MAX } else { HEADER_TIME_MAX };
    let mut serving = std::pin::pin!(
        http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(header_time)
            .keep_alive(beyond.is_none())
            .max_buf_size(BUFFER_BYTES_MAX)
            .serve_connection(TokioIo::new(Box::pin(patient)), service)
    );
    let ended = tokio::select! {
        ended = serving.as_mut() => ended,
        () = stopping.cancelled() => {
            serving.as_mut().graceful_shutdown();
            serving.await
        }
    };
    if let Err(error) = ended {
        tracing::debug!(%error, "connection ended early");
    }
}

fn into_extensions(reserved: crate::http::caller::ReservedConnection) -> axum::http::Extensions {
    let mut extensions = axum::http::Extensions::new();
    extensions.insert(reserved);
    extensions
}

/// Waits for SIGTERM or SIGINT.
///
/// # Errors
/// When the system lets nobody wait for signals.
pub async fn signal() -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut term, mut int) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    tokio::select! {
        _ = term.recv() => tracing::info!("SIGTERM: stopping"),
        _ = int.recv() => tracing::info!("SIGINT: stopping"),
    }
    Ok(())
}
