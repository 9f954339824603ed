//! The artist's browser is hostile ground: any page open in it can send requests to this machine.
//!
//! *A rebound name*: a page of `evil.example` has its name resolve to 127.0.0.1, and is then of one origin with the
//! service. So the name in `Host` has to be one that cannot be rebound (an address, `localhost`), or one of
//! `--allow-host`. A service with tokens takes any name unless some are given: a page elsewhere has no token.
//!
//! *A request across origins* needs no name, and a form or a `no-cors` fetch asks nobody's leave. So whatever is no mere
//! read is refused where `Origin` or `Sec-Fetch-Site` says that another origin's page sent it. Programs send neither.
//!
//! Pages of origins that `--allow-origin` names may do what programs may.
//!
//! *Source:* Fetch Standard (`Sec-Fetch-Site`, CORS-safelisted requests); RFC 6454.

use super::caller::is_read;
use super::error::HttpError;
use super::forward::is_passed_on;
use crate::app::App;
use crate::auth::Access;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::Response;
use quadmuse_proto::upload::{TUS_RESUMABLE, UPLOAD_EXPIRES, UPLOAD_LENGTH, UPLOAD_METADATA, UPLOAD_OFFSET};
use std::net::IpAddr;
use std::time::Duration;
use tower_http::cors::{AllowOrigin, CorsLayer};

/// For so long a browser needn't ask again what it may send.
const PREFLIGHT_AGE: Duration = Duration::from_secs(600);

const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const CROSS_ORIGIN_RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// The host of an authority, in lower case, without its port and a last dot.
fn host_of(authority: &str) -> Option<String> {
    let parsed: axum::http::uri::Authority = authority.parse().ok()?;
    // No user part belongs in `Host`.
    (!authority.contains('@')).then(|| parsed.host().trim_end_matches('.').to_ascii_lowercase())
}

/// Whether no one but this machine's owner decides where a name leads.
fn is_fixed(host: &str) -> bool {
    let bare = host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(host);
    bare.parse::<IpAddr>().is_ok() || host == "localhost" || host.ends_with(".localhost")
}

/// A name as `--allow-host` gives it.
///
/// # Errors
/// A sentence, for one that is none.
pub fn host_name(text: &str) -> Result<String, String> {
    let host =
        host_of(text).filter(|host| !host.is_empty() && *host == text.trim_end_matches('.').to_ascii_lowercase());
    host.ok_or_else(|| format!("expected the name of a host, without scheme and port, found `{text}`"))
}

/// An origin as `--allow-origin` gives it, and as browsers write it.
///
/// # Errors
/// A sentence, for what is none.
pub fn origin_name(text: &str) -> Result<String, String> {
    let refused = || format!("expected an origin like https://tools.studio.example, without a path, found `{text}`");
    let (scheme, authority) = text.split_once("://").ok_or_else(refused)?;
    let host = host_of(authority).filter(|host| !host.is_empty() && !authority.contains('/')).ok_or_else(refused)?;
    let port = authority.to_ascii_lowercase().strip_prefix(&host).map(str::to_owned).ok_or_else(refused)?;
    let is_port = port.is_empty() || port.strip_prefix(':').is_some_and(|number| number.parse::<u16>().is_ok());
    let is_web = ["http", "https"].contains(&scheme);
    if is_web && is_port { Ok(format!("{scheme}://{host}{port}")) } else { Err(refused()) }
}

/// What pages of the origins that the configuration names may send and read. A token travels in a header that a page sets
/// itself, so no credentials of the browser are allowed. `None` where it names none: what a browser asks before it sends is then
/// refused like anything else.
pub fn cors(allowed: &[String]) -> Option<CorsLayer> {
    if allowed.is_empty() {
        return None;
    }
    let origins = allowed.iter().filter_map(|origin| HeaderValue::try_from(origin.as_str()).ok());
    let sent = [
        header::AUTHORIZATION,
        header::ACCEPT,
        header::CONTENT_TYPE,
        header::CONTENT_ENCODING,
        header::IF_NONE_MATCH,
        HeaderName::from_static("idempotency-key"),
        HeaderName::from_static("last-event-id"),
        HeaderName::from_static("x-request-id"),
        HeaderName::from_static(TUS_RESUMABLE),
        HeaderName::from_static(UPLOAD_LENGTH),
        HeaderName::from_static(UPLOAD_METADATA),
        HeaderName::from_static(UPLOAD_OFFSET),
    ];
    let read = [
        header::LOCATION,
        header::ETAG,
        header::RETRY_AFTER,
        header::CONTENT_DISPOSITION,
        HeaderName::from_static("x-request-id"),
        HeaderName::from_static(TUS_RESUMABLE),
        HeaderName::from_static(UPLOAD_EXPIRES),
        HeaderName::from_static(UPLOAD_LENGTH),
        HeaderName::from_static(UPLOAD_METADATA),
        HeaderName::from_static(UPLOAD_OFFSET),
    ];
    let layer = CorsLayer::new()
        .allow_origin(AllowOrigin::list(origins))
        .allow_methods([Method::GET, Method::HEAD, Method::POST, Method::PATCH, Method::DELETE])
        .allow_headers(sent)
        .expose_headers(read)
        .max_age(PREFLIGHT_AGE);
    Some(layer)
}

/// Checks where a request is sent to.
///
/// # Errors
/// [`HttpError::HostUnknown`].
fn check_host(headers: &HeaderMap, allowed: &[String], access: Access) -> Result<(), HttpError> {
    let mut all = headers.get_all(header::HOST).iter();
    // Every browser names it; HTTP/1.0 needn't.
    let Some(first) = all.next() else { return Ok(()) };
    let found = || String::from_utf8_lossy(first.as_bytes()).into_owned();
    let unknown = || HttpError::HostUnknown { found: found() };
    let host = first.to_str().ok().and_then(host_of).filter(|_| all.next().is_none()).ok_or_else(unknown)?;
    let any = access == Access::Tokens && allowed.is_empty();
    if any || is_fixed(&host) || allowed.contains(&host) { Ok(()) } else { Err(unknown()) }
}

/// Checks that no page of another origin sent a request that is no mere read.
///
/// # Errors
/// [`HttpError::CrossOrigin`].
fn check_origin(headers: &HeaderMap, allowed: &[String]) -> Result<(), HttpError> {
    let refused = |found: &HeaderValue| {
        Err(HttpError::CrossOrigin { found: String::from_utf8_lossy(found.as_bytes()).into_owned() })
    };
    let mut origins = headers.get_all(header::ORIGIN).iter().peekable();
    // Of one that the configuration names, all are.
    if origins.peek().is_some() && origins.all(|origin| allowed.iter().any(|known| origin == known.as_str())) {
        return Ok(());
    }
    for site in headers.get_all(SEC_FETCH_SITE) {
        // `none`: the address was typed, or a program sends it.
        if site != "same-origin" && site != "none" {
            return refused(site);
        }
    }
    for origin in headers.get_all(header::ORIGIN) {
        let sender = origin.to_str().ok().and_then(|text| text.split_once("://"));
        let here = headers.get(header::HOST).and_then(|host| host.to_str().ok());
        let is_same = sender.zip(here).is_some_and(|((scheme, from), here)| {
            ["http", "https"].contains(&scheme) && from.eq_ignore_ascii_case(here)
        });
        if !is_same {
            return refused(origin);
        }
    }
    Ok(())
}

/// Refuses what a page of another origin, or under a rebound name, sends; forbids all to guess media types, and other
/// origins to embed what is answered.
///
/// # Errors
/// [`HttpError::HostUnknown`], [`HttpError::CrossOrigin`].
pub async fn check(State(app): State<App>, request: Request, next: Next) -> Result<Response, HttpError> {
    // Another server has checked it, and knows its own names.
    if is_passed_on(&request) {
        return Ok(next.run(request).await);
    }
    check_host(request.headers(), &app.settings.allowed_hosts, app.tokens.access())?;
    if !is_read(request.method()) {
        check_origin(request.headers(), &app.settings.allowed_origins)?;
    }
    Ok(next.run(request).await)
}

/// The headers that every answer carries.
pub async fn harden(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(CROSS_ORIGIN_RESOURCE_POLICY, HeaderValue::from_static("same-origin"));
    headers.entry(header::X_FRAME_OPTIONS).or_insert(HeaderValue::from_static("DENY"));
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers
                .append(HeaderName::try_from(*name).expect("a name"), HeaderValue::try_from(*value).expect("a value"));
        }
        headers
    }

    #[test]
    fn names_that_can_be_rebound_are_refused_on_an_open_service() {
        let host = |host: &str, access| check_host(&headers(&[("host", host)]), &["studio-server".into()], access);
        for good in
            ["127.0.0.1:7979", "[::1]:7979", "localhost", "LOCALHOST:80", "a.localhost", "10.0.0.7", "Studio-Server:1"]
        {
            assert!(host(good, Access::Open).is_ok(), "{good}");
        }
        for bad in [
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "a@localhost",
            "",
            "0x7f.1",
            "localhost:x y",
        ] {
            assert!(host(bad, Access::Open).is_err(), "{bad}");
            assert!(host(bad, Access::Tokens).is_err(), "{bad}: names were given");
        }
        assert!(check_host(&headers(&[("host", "evil.example")]), &[], Access::Tokens).is_ok());
        assert!(check_host(&headers(&[]), &[], Access::Open).is_ok());
        let twice = headers(&[("host", "localhost"), ("host", "localhost")]);
        assert!(check_host(&twice, &[], Access::Open).is_err());
    }

    #[test]
    fn what_another_origins_page_sends_is_refused() {
        let sent = |pairs: &[(&str, &str)]| {
            let here: [(&str, &str); 1] = [("host", "127.0.0.1:7979")];
            check_origin(&headers(&[&here, pairs].concat()), &["https://tools.example".into()]).is_ok()
        };
        assert!(sent(&[]));
        assert!(sent(&[("origin", "http://127.0.0.1:7979"), ("sec-fetch-site", "same-origin")]));
        assert!(sent(&[("sec-fetch-site", "none")]));
        for bad in
            ["null", "http://127.0.0.1:8000", "http://evil.example", "127.0.0.1:7979", "ftp://127.0.0.1:7979", ""]
        {
            assert!(!sent(&[("origin", bad)]), "{bad}");
        }
        for site in ["cross-site", "same-site", ""] {
            assert!(!sent(&[("sec-fetch-site", site)]), "{site}");
            assert!(!sent(&[("origin", "http://127.0.0.1:7979"), ("sec-fetch-site", site)]), "{site}");
        }
        assert!(!sent(&[("origin", "http://127.0.0.1:7979"), ("origin", "http://evil.example")]));
    }

    #[test]
    fn a_name_to_allow_is_a_name() {
        assert_eq!(host_name("Studio.Example."), Ok("studio.example".into()));
        for bad in ["", "http://x", "x:7979", "a b", "x/y", "u@x"] {
            assert!(host_name(bad).is_err(), "{bad}");
        }
    }
}
