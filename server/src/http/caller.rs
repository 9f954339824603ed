//! Who asks: the token's role against the one needed, and whose turn the work is counted as.

use super::error::HttpError;
use crate::app::App;
use crate::auth::Role;
use crate::pool::User;
use crate::work::Caller;
use axum::extract::{FromRequestParts, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::Response;
use std::net::IpAddr;

/// The address of the other end, put into each request by the accept loop.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub IpAddr);

/// The caller of a request.
#[derive(Clone, Copy, Debug, Default)]
pub struct Who(pub Caller);

impl<S: Sync> FromRequestParts<S> for Who {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Self::Rejection> {
        Ok(parts.extensions.get::<Self>().copied().unwrap_or_default())
    }
}

/// The role that a request needs; `None`: anybody.
fn role_needed(method: &Method, path: &str) -> Option<Role> {
    let reads = method == Method::GET || method == Method::HEAD;
    match path {
        "/metrics" => Some(Role::Reader),
        _ if !path.starts_with("/v1/") => None,
        _ if path.starts_with("/v1/examples") && !reads => Some(Role::Contributor),
        _ => Some(Role::Reader),
    }
}

fn name_of(role: Role) -> &'static str {
    match role {
        Role::Reader => "reader",
        Role::Contributor => "contributor",
        Role::Admin => "admin",
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

/// Lets in whom the tokens allow; with no token created, everybody.
///
/// # Errors
/// [`HttpError::Unauthorized`], [`HttpError::Forbidden`].
pub async fn authorize(State(app): State<App>, mut request: Request, next: Next) -> Result<Response, HttpError> {
    let peer = request.extensions().get::<Peer>().map(|peer| peer.0);
    let mut user = user_of(peer.map(|peer| peer.to_string()).unwrap_or_default().as_bytes());
    if !app.tokens.is_empty()
        && let Some(needed) = role_needed(request.method(), request.uri().path())
    {
        let token = bearer(request.headers()).and_then(|token| app.tokens.find(token));
        let token = token.ok_or(HttpError::Unauthorized)?;
        if token.role < needed {
            return Err(HttpError::Forbidden { needed: name_of(needed), found: name_of(token.role) });
        }
        user = user_of(token.id.to_string().as_bytes());
    }
    request.extensions_mut().insert(Who(Caller { user }));
    Ok(next.run(request).await)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_needs_less_than_changing_the_corpus() {
        assert_eq!(role_needed(&Method::GET, "/healthz"), None);
        assert_eq!(role_needed(&Method::GET, "/v1/examples"), Some(Role::Reader));
        assert_eq!(role_needed(&Method::POST, "/v1/queries"), Some(Role::Reader));
        for method in [Method::POST, Method::PATCH, Method::DELETE, Method::PUT] {
            assert_eq!(role_needed(&method, "/v1/examples/x"), Some(Role::Contributor));
        }
    }
}
