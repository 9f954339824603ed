//! A connection to another server, for one request.
//!
//! None is kept for later: one that the other side closes at the moment it is used would look like a server that is gone.
//! While an answer is awaited, which may take minutes, the other server is asked now and then whether it is there.

use axum::body::Body;
use axum::http::{Request, Response, header};
use bytes::Bytes;
use http_body::{Frame, SizeHint};
use hyper::body::Incoming;
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper_util::rt::TokioIo;
use std::collections::HashMap;
use std::error::Error;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio::time::{Instant, Sleep};
use tokio_util::sync::{CancellationToken, WaitForCancellationFutureOwned};

/// Longest time for a connection to come about.
const CONNECT_TIME_MAX: Duration = Duration::from_millis(1500);

/// After this time without an answer the other server is asked whether it is there.
const PATIENCE: Duration = Duration::from_millis(300);

/// Longest time for it to say so. With [`PATIENCE`] it is less than two seconds.
const SIGN_TIME_MAX: Duration = Duration::from_millis(1400);

/// Pause between two such questions.
const SIGN_EVERY: Duration = Duration::from_secs(1);

/// Longest time between two pieces of an answer: streams say something every 10 s.
const SILENCE_TIME_MAX: Duration = Duration::from_secs(30);

/// Why another server gave no answer.
#[derive(Debug)]
pub(super) enum Fault {
    /// It takes no connection, or does not say that it is there.
    Gone,
    /// This server is stopping.
    Stopping,
    /// The body that it was to get failed on the way in.
    Body(Box<dyn Error + Send + Sync>),
    /// It is there, and broke off.
    Broken(Box<dyn Error + Send + Sync>),
}

impl Fault {
    /// As a label.
    pub(super) fn word(&self) -> &'static str {
        match self {
            Self::Gone => "gone",
            Self::Stopping => "stopping",
            Self::Body(_) => "body",
            Self::Broken(_) => "broken",
        }
    }
}

/// A task that ends with whoever waits for what it brings.
struct ConnectionTask(JoinHandle<()>);

impl Drop for ConnectionTask {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// A connection.
pub(super) struct Link<'a> {
    address: String,
    signs: &'a Signs,
    begun: Instant,
    sender: SendRequest<Body>,
    driving: ConnectionTask,
}

impl<'a> Link<'a> {
    /// A connection to the server at `http://host:port`.
    pub(super) async fn to(address: &str, signs: &'a Signs) -> Result<Self, Fault> {
        let begun = Instant::now();
        let host = address.strip_prefix("http://").unwrap_or(address);
        let connecting = tokio::time::timeout(CONNECT_TIME_MAX, TcpStream::connect(host));
        let stream = connecting.await.map_err(|_| Fault::Gone)?.map_err(|_| Fault::Gone)?;
        // Small events go out at once; if the system refuses, they go out later.
        let _ = stream.set_nodelay(true);
        let (sender, connection) = handshake(TokioIo::new(stream)).await.map_err(|_| Fault::Gone)?;
        // What it fails with, the sender tells.
        let driving = ConnectionTask(tokio::spawn(async move { drop(connection.await) }));
        Ok(Self { address: address.to_owned(), signs, begun, sender, driving })
    }

    /// Sends a request. Who drops the answer, or doesn't wait for it, closes the connection.
    pub(super) async fn ask(mut self, request: Request<Body>) -> Result<Response<Answer>, Fault> {
        let address = self.address;
        let asked = tokio::select! {
            biased;
            answer = self.sender.send_request(request) => answer,
            () = self.signs.watched(&address, self.begun) => return Err(Fault::Gone),
        };
        match asked {
            Ok(answer) => {
                let driving = self.driving;
                Ok(answer.map(|inner| Answer {
                    inner,
                    silence: None,
                    is_waiting: false,
                    stopping: None,
                    _driving: driving,
                }))
            }
            Err(error) if error.is_user() => Err(Fault::Body(error.into())),
            Err(_) if !self.signs.is_there(&address, Instant::now()).await => Err(Fault::Gone),
            Err(error) => Err(Fault::Broken(error.into())),
        }
    }
}

/// When each of the other servers was asked last whether it is there, and whether it was: those who wait for the same one
/// share the answer.
#[derive(Default)]
pub struct Signs(Mutex<HashMap<String, Arc<Turn>>>);

type Turn = tokio::sync::Mutex<Option<(Instant, bool)>>;

impl Signs {
    /// Returns when a server no longer says that it is there, to one who has waited since `begun`.
    async fn watched(&self, address: &str, begun: Instant) {
        tokio::time::sleep(PATIENCE).await;
        let mut since = begun;
        while self.is_there(address, since).await {
            tokio::time::sleep(SIGN_EVERY).await;
            since = Instant::now() - SIGN_EVERY / 2;
        }
    }

    /// Whether a server said after `since`, or says now, that it is there.
    async fn is_there(&self, address: &str, since: Instant) -> bool {
        let turn = {
            let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            Arc::clone(all.entry(address.to_owned()).or_default())
        };
        // One asks, the others wait for it.
        let mut last = turn.lock().await;
        match *last {
            Some((at, was_there)) if at >= since => was_there,
            _ => {
                let is_there = says_so(address).await;
                *last = Some((Instant::now(), is_there));
                is_there
            }
        }
    }
}

/// Whether a server says in time that it is there.
async fn says_so(address: &str) -> bool {
    let host = address.strip_prefix("http://").unwrap_or(address);
    let asked = async {
        let stream = TcpStream::connect(host).await.ok()?;
        let (mut sender, connection) = handshake(TokioIo::new(stream)).await.ok()?;
        let driving = ConnectionTask(tokio::spawn(async move { drop(connection.await) }));
        let request = Request::get("/healthz").header(header::HOST, host).body(Body::empty()).ok()?;
        let answer = sender.send_request(request).await.ok();
        drop(driving);
        answer
    };
    matches!(tokio::time::timeout(SIGN_TIME_MAX, asked).await, Ok(Some(_)))
}

/// The body of an answer as it comes, with its connection. One that is silent for too long has failed.
pub(super) struct Answer {
    inner: Incoming,
    silence: Option<Pin<Box<Sleep>>>,
    /// Whether the other side is waited for, and not the client.
    is_waiting: bool,
    /// Set when it is to break off.
    stopping: Option<Pin<Box<WaitForCancellationFutureOwned>>>,
    _driving: ConnectionTask,
}

impl Answer {
    /// Lets a stream without an end break off when this server stops: its reader goes on with another.
    pub(super) fn breaks_off_at(&mut self, stopping: CancellationToken) {
        self.stopping = Some(Box::pin(stopping.cancelled_owned()));
    }
}

impl http_body::Body for Answer {
    type Data = Bytes;
    type Error = Box<dyn Error + Send + Sync>;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        let this = &mut *self;
        if let Poll::Ready(frame) = Pin::new(&mut this.inner).poll_frame(cx) {
            this.is_waiting = false;
            return Poll::Ready(frame.map(|frame| frame.map_err(Into::into)));
        }
        if this.stopping.as_mut().is_some_and(|stopping| stopping.as_mut().poll(cx).is_ready()) {
            return Poll::Ready(Some(Err("this server is stopping".into())));
        }
        let until = Instant::now() + SILENCE_TIME_MAX;
        let silence = this.silence.get_or_insert_with(|| Box::pin(tokio::time::sleep_until(until)));
        if !std::mem::replace(&mut this.is_waiting, true) {
            silence.as_mut().reset(until);
        }
        match silence.as_mut().poll(cx) {
            Poll::Ready(()) => Poll::Ready(Some(Err("the other server fell silent".into()))),
            Poll::Pending => Poll::Pending,
        }
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.size_hint()
    }
}
