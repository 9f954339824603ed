//! Who asks: the token's role against the one needed, whose turn the work is counted as, and what is the caller's own.

use super::error::{HttpError, REQUEST_ID};
use super::forward::{self, AnsweredElsewhere, is_passed_on};
use crate::app::App;
use crate::audit::Line;
use crate::auth::{Access, Role, TokenRecord};
use crate::connections::ReserveReason;
use crate::pool::User;
use crate::work::{Caller, Scope, WorkError};
use axum::RequestExt;
use axum::extract::{FromRequestParts, MatchedPath, RawPathParams, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use quadmuse_proto::QueryId;
use std::net::IpAddr;

/// The address of the other end, put into each request by the accept loop.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub IpAddr);

/// A request on a connection of the reserve, put into it by the accept loop.
#[derive(Clone, Copy, Debug)]
pub struct ReservedConnection(pub ReserveReason);

/// What is answered in the reserve.
fn is_for_operators(path: &str) -> bool {
    ["/healthz", "/readyz", "/metrics"].contains(&path) || ADMIN_PATHS.iter().any(|admin| path.starts_with(admin))
}

/// What a request costs of the rate: a change five times as much as a read, a wrong token most.
const COST_READ: f64 = 1.0;
const COST_WRITE: f64 = 5.0;
const COST_REFUSED: f64 = 50.0;

/// The caller of a request.
#[derive(Clone, Copy, Debug, Default)]
pub struct RequestCaller(pub Caller);

impl<S: Sync> FromRequestParts<S> for RequestCaller {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        Ok(parts.extensions.get::<Self>().copied().unwrap_or_default())
    }
}

/// The addresses for admins alone.
const ADMIN_PATHS: [&str; 2] = ["/v1/tokens", "/v1/admin"];

/// Whether a request only reads.
pub fn is_read(method: &Method) -> bool {
    [Method::GET, Method::HEAD, Method::OPTIONS].contains(method)
}

/// The role that a request needs; `None`: anybody.
fn role_needed(method: &Method, path: &str) -> Option<Role> {
    match path {
        "/metrics" => Some(Role::Reader),
        _ if !path.starts_with("/v1/") => None,
        _ if ADMIN_PATHS.iter().any(|admin| path.starts_with(admin)) => Some(Role::Admin),
        _ if path.starts_with("/v1/examples") && !is_read(method) => Some(Role::Contributor),
        _ => Some(Role::Reader),
    }
}

fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

fn user_of(text: &[u8]) -> User {
    let mut first = [0; 8];
    first.iter_mut().zip(blake3::hash(text).as_bytes()).for_each(|(to, from)| *to = *from);
    User(u64::from_le_bytes(first))
}

/// Lets in whom the tokens allow; where none was ever created, everybody, save to what is for admins. Whatever is no mere
/// read leaves a line in the audit log.
pub async fn authorize(State(app): State<App>, mut request: Request, next: Next) -> Response {
    let peer = request.extensions().get::<Peer>().map(|peer| peer.0);
    let found = bearer(request.headers()).and_then(|token| app.tokens.find(token));
    let is_open = app.tokens.access() == Access::Open;
    // What another server asks changes nothing.
    let is_question = request.uri().path() == forward::shares::PATH && is_passed_on(&request);
    let line = (!is_read(request.method()) && !is_question).then(|| line_of(&request, peer, found.as_ref(), is_open));
    let caller = caller(peer, found.as_ref(), is_open);
    let quota = found.as_ref().map(|token| token.quota).unwrap_or_default();
    let allowed = in_reserve(&request)
        .and_then(|()| allowed(&request, found.as_ref(), is_open))
        .and_then(|()| rated(&app, &request, caller, quota.requests_per_second));
    let mut response = match allowed {
        Ok(()) => {
            app.work.pool.admission().set_quota(caller.user, quota);
            request.extensions_mut().insert(RequestCaller(caller));
            next.run(request).await
        }
        Err(refused) => {
            if matches!(refused, HttpError::Unauthorized { .. }) {
                // Whoever tries tokens has few tries.
                let _ = app.rates.take(caller.user, COST_REFUSED, None);
            }
            refused.into_response()
        }
    };
    super::watchful::tell(&mut response, |logged| logged.user = found.map(|token| token.id.to_string()));
    // What another server answered, it wrote down.
    if let Some(line) = line.filter(|_| response.extensions().get::<AnsweredElsewhere>().is_none()) {
        let made = response.headers().get(header::LOCATION).and_then(|at| at.to_str().ok()).unwrap_or_default();
        app.audit.note(Line { status: response.status().as_u16(), made: made.into(), ..line });
    }
    response
}

/// On a connection of the reserve only what operators need is answered.
fn in_reserve(request: &Request) -> Result<(), HttpError> {
    match request.extensions().get::<ReservedConnection>() {
        Some(ReservedConnection(beyond)) if !is_for_operators(request.uri().path()) => {
            Err(HttpError::TooManyConnections { beyond: *beyond })
        }
        _ => Ok(()),
    }
}

/// Whether the caller has not asked too often. Health is told to everybody.
fn rated(app: &App, request: &Request, caller: Caller, own_rate: Option<u32>) -> Result<(), HttpError> {
    let is_free = role_needed(request.method(), request.uri().path()).is_none();
    if is_free || is_passed_on(request) {
        return Ok(());
    }
    let cost = if is_read(request.method()) { COST_READ } else { COST_WRITE };
    app.rates.take(caller.user, cost, own_rate).map_err(|retry_after| HttpError::TooOften { retry_after })
}

fn allowed(request: &Request, found: Option<&TokenRecord>, is_open: bool) -> Result<(), HttpError> {
    let Some(needed) = role_needed(request.method(), request.uri().path()) else { return Ok(()) };
    match found {
        Some(token) if token.role >= needed => Ok(()),
        Some(token) => Err(HttpError::Forbidden { needed: needed.as_str(), found: token.role.as_str() }),
        // Nobody is an admin by being first: whoever has the machine creates the first token at its console.
        None if is_open && needed == Role::Admin => Err(HttpError::AdminNeedsToken),
        None if is_open => Ok(()),
        // Whether a token is of no use is known to whoever sent it; which of the three it is, is told to nobody.
        None if bearer(request.headers()).is_some() => {
            Err(HttpError::Unauthorized { found: "one that is unknown, expired or revoked" })
        }
        None => Err(HttpError::Unauthorized { found: "none" }),
    }
}

fn caller(peer: Option<IpAddr>, found: Option<&TokenRecord>, is_open: bool) -> Caller {
    let user = match found {
        Some(token) => user_of(token.id.to_string().as_bytes()),
        None => user_of(peer.map(|peer| peer.to_string()).unwrap_or_default().as_bytes()),
    };
    let is_admin = found.is_some_and(|token| token.role == Role::Admin);
    Caller { user, scope: if is_open || is_admin { Scope::All } else { Scope::Own } }
}

fn line_of(request: &Request, peer: Option<IpAddr>, found: Option<&TokenRecord>, is_open: bool) -> Line {
    Line {
        request: REQUEST_ID.try_with(Clone::clone).unwrap_or_default(),
        user: match found {
            Some(token) => token.id.to_string(),
            None if is_open => "open".into(),
            None => "none".into(),
        },
        name: found.map(|token| token.name.clone()).unwrap_or_default(),
        role: found.map(|token| token.role.to_string()).unwrap_or_default(),
        peer: peer.map(|peer| peer.to_string()).unwrap_or_default(),
        action: request.method().to_string(),
        on: request.uri().path().to_owned(),
        ..Line::default()
    }
}

/// Where the routes of one query begin.
const ONE_QUERY: &str = "/v1/queries/{id}";

/// A query, with its maps and compositions, is its caller's own: to others it is not there, whatever the route. Checked
/// here for all routes below a query, so that no handler can forget it.
///
/// # Errors
/// [`HttpError::Work`] with [`WorkError::NoSuchQuery`], as for a query that never was.
pub async fn own(State(app): State<App>, mut request: Request, next: Next) -> Result<Response, HttpError> {
    let is_of_query = request.extensions().get::<MatchedPath>().is_some_and(|p| p.as_str().starts_with(ONE_QUERY));
    if is_of_query {
        // As the handlers see it, unescaped.
        let params = request.extract_parts::<RawPathParams>().await;
        let id =
            params.ok().and_then(|params| params.iter().find(|(name, _)| *name == "id")?.1.parse::<QueryId>().ok());
        let RequestCaller(caller) = request.extensions().get::<RequestCaller>().copied().unwrap_or_default();
        if let Some(id) = id
            && app.work.queries.owner(id).is_some_and(|owner| !caller.sees(owner))
        {
            return Err(WorkError::NoSuchQuery(id).into());
        }
    }
    Ok(next.run(request).await)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_needs_less_than_changing_the_corpus_and_tokens_need_most() {
        assert_eq!(role_needed(&Method::GET, "/healthz"), None);
        assert_eq!(role_needed(&Method::GET, "/v1/examples"), Some(Role::Reader));
        assert_eq!(role_needed(&Method::POST, "/v1/queries"), Some(Role::Reader));
        for method in [Method::POST, Method::PATCH, Method::DELETE, Method::PUT] {
            assert_eq!(role_needed(&method, "/v1/examples/x"), Some(Role::Contributor));
        }
        for path in ["/v1/tokens", "/v1/tokens/x", "/v1/admin/backup"] {
            assert_eq!(role_needed(&Method::GET, path), Some(Role::Admin));
        }
    }
}
