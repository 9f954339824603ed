//! Requests for what lives on another server are passed on to it, so that any server of a cluster answers for all.
//!
//! The id of a query or an upload tells its server ([`crate::peers`]). The request goes there as it came, its body and the
//! answer's streamed as they come, under a seal that names the client's address; what is sealed is never passed on again. A
//! server that does not take a connection, or has stopped answering, is told to be gone within two seconds.

mod link;
pub mod shares;

use super::body::body_error;
use super::caller::{Peer, is_read};
use super::error::{HttpError, REQUEST_ID};
use super::watchful::X_REQUEST_ID;
use crate::app::App;
use crate::peers::{ForwardedRequest, Peers, StorageMedium, Whereabouts};
use axum::RequestExt;
use axum::body::Body;
use axum::extract::{FromRequestParts, MatchedPath, RawPathParams, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use futures_util::future::join_all;
use http_body_util::{BodyExt, Limited};
pub use link::Signs;
use link::{Fault, Link};
use quadmuse_proto::id::ServerNumber;
use quadmuse_proto::{QueryId, UploadId};
use serde::de::DeserializeOwned;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// What one server tells another of a request that it passes on. Sealed: strangers may send it, and nobody reads theirs.
const PASSED: HeaderName = HeaderName::from_static("quadmuse-passed");

/// Longest time for another server to give its part of a list.
const LIST_TIME_MAX: Duration = Duration::from_secs(2);

/// For so long a stopping server waits for answers that others still owe it.
const STOPPING_GRACE: Duration = Duration::from_secs(1);

/// Longest part of a list, in bytes.
const LIST_BYTES_MAX: usize = 64 << 20;

/// Headers that concern one connection, or what the first server has seen to.
const NOT_PASSED_ON: [&str; 14] = [
    "connection",
    "keep-alive",
    "proxy-connection",
    "proxy-authenticate",
    "proxy-authorization",
    "te",
    "trailer",
    "transfer-encoding",
    "upgrade",
    "expect",
    "origin",
    "sec-fetch-site",
    "quadmuse-passed",
    "x-request-id",
];

/// A request that another server of the cluster passed on, put into it once its seal was checked.
#[derive(Clone, Copy, Debug)]
pub struct FromPeer(pub ForwardedRequest);

/// An answer that another server gave; it has written down what there was to write.
#[derive(Clone, Copy, Debug)]
pub struct AnsweredElsewhere;

/// The outermost layer: reads what another server says of a request. What no server sealed is dropped.
pub async fn receive(State(app): State<App>, mut request: Request, next: Next) -> Response {
    let sealed = request.headers_mut().remove(PASSED);
    if let (Some(peers), Some(sealed)) = (&app.peers, sealed.as_ref().and_then(|value| value.to_str().ok())) {
        match peers.open(sealed, request.method().as_str(), target(request.uri())) {
            Some(passed) => {
                if let Some(peer) = passed.peer {
                    request.extensions_mut().insert(Peer(peer));
                }
                request.extensions_mut().insert(FromPeer(passed));
            }
            None => tracing::warn!("a request says that a server passed it on, and none of the cluster did"),
        }
    }
    next.run(request).await
}

fn target(uri: &axum::http::Uri) -> &str {
    uri.path_and_query().map_or("/", |target| target.as_str())
}

/// The query or upload that a request is for, which lives on one server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ForwardTarget {
    Query(QueryId),
    Upload(UploadId),
}

impl ForwardTarget {
    fn server(self) -> Option<(ServerNumber, StorageMedium)> {
        match self {
            Self::Query(id) => id.server().map(|server| (server, StorageMedium::InMemory)),
            Self::Upload(id) => id.server().map(|server| (server, StorageMedium::OnDisk)),
        }
    }

    fn gone(self) -> HttpError {
        match self {
            Self::Query(id) => HttpError::OwnerGone { of: format!("the query {id}"), way_out: way_out_of(id) },
            Self::Upload(id) => {
                HttpError::OwnerGone { of: format!("the upload {id}"), way_out: "begin it anew".into() }
            }
        }
    }
}

fn way_out_of(id: QueryId) -> String {
    format!("start it again by `POST /v1/queries/{id}/restart`")
}

async fn wanted(request: &mut Request) -> Option<ForwardTarget> {
    let path = request.extensions().get::<MatchedPath>()?.as_str().to_owned();
    match path.as_str() {
        // Any server can start a query again.
        "/v1/queries/{id}/restart" => None,
        _ if path.starts_with("/v1/queries/{id}") => id_in(request).await.map(ForwardTarget::Query),
        _ if path.starts_with("/v1/uploads/{id}") => id_in(request).await.map(ForwardTarget::Upload),
        "/v1/queries" | "/v1/examples" if request.method() == Method::POST => {
            let query = request.uri().query()?;
            let (_, upload) = form_urlencoded::parse(query.as_bytes()).find(|(name, _)| name == "upload")?;
            upload.parse().ok().map(ForwardTarget::Upload)
        }
        _ => None,
    }
}

async fn id_in<T: std::str::FromStr>(request: &mut Request) -> Option<T> {
    let params = request.extract_parts::<RawPathParams>().await.ok()?;
    params.iter().find(|(name, _)| *name == "id")?.1.parse().ok()
}

/// The innermost layer: passes a request on to the server where what it wants lives, if that is another one.
///
/// # Errors
/// [`HttpError::OwnerGone`], [`HttpError::OwnerBroke`], [`HttpError::Stopping`].
pub async fn pass(State(app): State<App>, mut request: Request, next: Next) -> Result<Response, HttpError> {
    let Some(peers) = &app.peers else { return Ok(next.run(request).await) };
    let Some(wanted) = wanted(&mut request).await else { return Ok(next.run(request).await) };
    let Some((server, kept)) = wanted.server() else { return Ok(next.run(request).await) };
    let place = match peers.place_of(server, kept) {
        Whereabouts::Unknown => {
            let asking = Arc::clone(peers);
            // What it panicked with was logged.
            let _ = tokio::task::spawn_blocking(move || asking.look_again()).await;
            peers.place_of(server, kept)
        }
        known => known,
    };
    let passed = request.extensions().get::<FromPeer>().copied();
    match place {
        // Of a number that nobody has the handlers say that there is no such thing.
        Whereabouts::Here | Whereabouts::Unknown => Ok(next.run(request).await),
        // Passed on to one that has meanwhile started anew: it does not go further.
        Whereabouts::There(..) if passed.is_some() => Err(wanted.gone()),
        Whereabouts::There(number, address) => {
            let limit = app.settings.upload_limit;
            let answer = passed_on(&app, peers, (number, &address), request).await;
            let outcome = answer.as_ref().err().map_or("answered", Fault::word);
            metrics::counter!("quadmuse_passed_on_total", "outcome" => outcome).increment(1);
            answer.map_err(|fault| match fault {
                Fault::Gone => {
                    tracing::warn!(server = number.get(), address, "another server does not answer");
                    wanted.gone()
                }
                Fault::Stopping => HttpError::Stopping,
                Fault::Body(error) => body_error(&*error, limit),
                Fault::Broken(error) => {
                    tracing::warn!(server = number.get(), address, %error, "another server broke off");
                    HttpError::OwnerBroke
                }
            })
        }
        Whereabouts::Gone(_) => Err(wanted.gone()),
    }
}

async fn passed_on(
    app: &App,
    peers: &Peers,
    (to, address): (ServerNumber, &str),
    request: Request,
) -> Result<Response, Fault> {
    let peer = request.extensions().get::<Peer>().map(|peer| peer.0);
    let (head, body) = request.into_parts();
    let link = Link::to(address, &app.signs).await?;
    let asking = link.ask(Request::from_parts(passed_head(peers, to, peer, &head), body));
    let answer = tokio::select! {
        answer = asking => answer?,
        // What only waits is asked again elsewhere, and soon; what changes anything is waited for to the end.
        () = ending(&app.stopping), if is_read(&head.method) => return Err(Fault::Stopping),
    };
    let (mut answer, mut body) = answer.into_parts();
    if head.uri.path().ends_with("/stream") {
        body.breaks_off_at(app.stopping.clone());
    }
    for name in ["connection", "keep-alive", "transfer-encoding"] {
        answer.headers.remove(name);
    }
    without_cors(&mut answer.headers);
    answer.extensions.insert(AnsweredElsewhere);
    Ok(Response::from_parts(answer, Body::new(body)))
}

/// Returns when the service has been stopping for a while.
async fn ending(stopping: &CancellationToken) {
    stopping.cancelled().await;
    tokio::time::sleep(STOPPING_GRACE).await;
}

/// This server says by itself what pages of other origins may read.
fn without_cors(headers: &mut HeaderMap) {
    let is_cors = |name: &HeaderName| name.as_str().starts_with("access-control-");
    let cors: Vec<HeaderName> = headers.keys().filter(|name| is_cors(name)).cloned().collect();
    for name in cors {
        headers.remove(name);
    }
    let is_other = |value: &&HeaderValue| !value.as_bytes().starts_with(b"origin");
    let vary: Vec<HeaderValue> = headers.get_all(header::VARY).iter().filter(is_other).cloned().collect();
    headers.remove(header::VARY);
    for value in vary {
        headers.append(header::VARY, value);
    }
}

/// A request's head as the other server gets it.
fn passed_head(peers: &Peers, to: ServerNumber, peer: Option<IpAddr>, head: &Parts) -> Parts {
    let (mut parts, ()) = Request::new(()).into_parts();
    parts.method = head.method.clone();
    parts.uri = head.uri.path_and_query().cloned().map_or_else(axum::http::Uri::default, axum::http::Uri::from);
    // What `connection` names concerns the connection, too.
    let named = head.headers.get_all(header::CONNECTION).iter().filter_map(|value| value.to_str().ok());
    let named: Vec<String> =
        named.flat_map(|names| names.split(',').map(|name| name.trim().to_ascii_lowercase())).collect();
    for (name, value) in &head.headers {
        let name_text = name.as_str();
        if !NOT_PASSED_ON.contains(&name_text) && !named.iter().any(|named| named == name_text) {
            parts.headers.append(name.clone(), value.clone());
        }
    }
    let sealed = peers.seal(to, peer, parts.method.as_str(), target(&parts.uri));
    // Both are letters, digits and a few signs.
    parts.headers.extend(HeaderValue::try_from(sealed).ok().map(|sealed| (PASSED, sealed)));
    let id = REQUEST_ID.try_with(Clone::clone).ok().and_then(|id| HeaderValue::try_from(id).ok());
    parts.headers.extend(id.map(|id| (X_REQUEST_ID, id)));
    parts
}

/// The other servers, to be asked the same as this one was; nobody where the request came from one of them.
pub struct OtherServers {
    head: Parts,
}

impl<S: Sync> FromRequestParts<S> for OtherServers {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        Ok(Self { head: parts.clone() })
    }
}

impl OtherServers {
    /// What the others answer to the same request. Who does not answer soon is left out: what lived there is likely gone.
    pub async fn answers<T: DeserializeOwned>(&self, app: &App) -> Vec<T> {
        let is_passed = self.head.extensions.get::<FromPeer>().is_some();
        let Some(peers) = app.peers.as_ref().filter(|_| !is_passed) else { return Vec::new() };
        let asked = peers.others().into_iter().map(|(number, address)| async move {
            let answer = tokio::time::timeout(LIST_TIME_MAX, self.ask(app, peers, (number, &address))).await;
            match answer {
                Ok(Ok(answer)) => serde_json::from_slice(&answer).ok(),
                Ok(Err(_)) | Err(_) => {
                    tracing::debug!(server = number.get(), address, "another server gives no part of a list");
                    None
                }
            }
        });
        join_all(asked).await.into_iter().flatten().collect()
    }

    async fn ask(&self, app: &App, peers: &Peers, (to, address): (ServerNumber, &str)) -> Result<Vec<u8>, Fault> {
        let peer = self.head.extensions.get::<Peer>().map(|peer| peer.0);
        let mut head = passed_head(peers, to, peer, &self.head);
        head.headers.insert(header::ACCEPT, HeaderValue::from_static("application/json"));
        head.headers.remove(header::IF_NONE_MATCH);
        head.headers.remove(header::ACCEPT_ENCODING);
        let answer = Link::to(address, &app.signs).await?.ask(Request::from_parts(head, Body::empty())).await?;
        let (head, body) = answer.into_parts();
        if head.status != StatusCode::OK {
            return Err(Fault::Broken(head.status.to_string().into()));
        }
        let whole = Limited::new(body, LIST_BYTES_MAX).collect().await;
        Ok(whole.map_err(Fault::Broken)?.to_bytes().to_vec())
    }
}

/// Whether another server passed a request on: it has checked where the request comes from, and how often the caller asks.
pub fn is_passed_on(request: &Request) -> bool {
    request.extensions().get::<FromPeer>().is_some()
}
