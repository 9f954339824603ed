//! The accept loop, and how it ends.
//!
//! Ours instead of `axum::serve`, which has no time limit on headers and never ends while a stream is open. On a
//! signal the listener closes, `stopping` is set (streams send their last event, long polls answer), idle connections
//! are closed, and those that are still open after [`DRAIN_TIME_MAX`] are dropped.

use crate::http::caller::Peer;
use axum::Router;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt;

/// Longest time for a request's head to arrive.
const HEADER_TIME_MAX: Duration = Duration::from_secs(10);

/// Longest time for open connections to end after a signal.
pub const DRAIN_TIME_MAX: Duration = Duration::from_secs(8);

/// Pause after an error of the listener (out of descriptors).
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Serves until `stopping` is set, then drains. At most `connections` at a time: more wait in the listener's queue.
pub async fn serve(listener: TcpListener, router: Router, connections: usize, stopping: CancellationToken) {
    let places = Arc::new(Semaphore::new(connections));
    let open = TaskTracker::new();
    let abort = CancellationToken::new();
    while let Some((stream, peer, place)) = stopping.run_until_cancelled(accept(&listener, &places)).await {
        let (router, stopping, abort) = (router.clone(), stopping.clone(), abort.clone());
        open.spawn(async move {
            // A connection that is dropped drops its request, and so stops its computation.
            abort.run_until_cancelled(connection(stream, peer, router, stopping)).await;
            drop(place);
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

async fn accept(
    listener: &TcpListener,
    places: &Arc<Semaphore>,
) -> (TcpStream, SocketAddr, Option<tokio::sync::OwnedSemaphorePermit>) {
    // The semaphore is never closed.
    let place = Arc::clone(places).acquire_owned().await.ok();
    loop {
        match listener.accept().await {
            Ok((stream, peer)) => return (stream, peer, place),
            Err(error) => {
                tracing::warn!(%error, "no connection accepted");
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

async fn connection(stream: TcpStream, peer: SocketAddr, router: Router, stopping: CancellationToken) {
    // Small events go out at once; if the system refuses, they go out later.
    let _ = stream.set_nodelay(true);
    let service = hyper::service::service_fn(move |request: Request<Incoming>| {
        let router = router.clone();
        async move {
            let (mut head, body) = request.into_parts();
            head.extensions.insert(Peer(peer.ip()));
            let answer: Result<_, Infallible> = router.oneshot(Request::from_parts(head, Body::new(body))).await;
            answer
        }
    });
    let mut serving = std::pin::pin!(
        http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEADER_TIME_MAX)
            .serve_connection(TokioIo::new(stream), service)
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
