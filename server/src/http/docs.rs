//! The pages for people, embedded in the binary: `/` and `/docs`, without anything from elsewhere.

use super::error::HttpError;
use super::negotiate::{if_none_match, tagged};
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;

/// What the pages may load: only what this server serves.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                      connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const PICTURE: &str = "image/svg+xml";

fn page(text: &'static str, media_type: &'static str, headers: &HeaderMap) -> Response {
    let tag = format!("\"{}\"", &blake3::hash(text.as_bytes()).to_hex()[..32]);
    let mut response = tagged(text.into(), media_type, &tag, if_none_match(headers).as_deref(), "no-cache");
    let out = response.headers_mut();
    out.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    out.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}

/// The web page.
pub async fn index(headers: HeaderMap) -> Response {
    page(include_str!("../../web/index.html"), HTML, &headers)
}

/// The contract for people.
pub async fn docs(headers: HeaderMap) -> Response {
    page(include_str!("../../web/docs.html"), HTML, &headers)
}

/// What the pages need.
pub async fn asset(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, HttpError> {
    let (text, media_type) = match name.as_str() {
        "style.css" => (include_str!("../../web/style.css"), STYLE),
        "call.js" => (include_str!("../../web/call.js"), SCRIPT),
        "index.js" => (include_str!("../../web/index.js"), SCRIPT),
        "mesh.js" => (include_str!("../../web/mesh.js"), SCRIPT),
        "stage.js" => (include_str!("../../web/stage.js"), SCRIPT),
        "viewer.js" => (include_str!("../../web/viewer.js"), SCRIPT),
        "docs.js" => (include_str!("../../web/docs.js"), SCRIPT),
        "icon.svg" => (include_str!("../../web/icon.svg"), PICTURE),
        _ => return Err(HttpError::NoRoute { path: format!("/web/{name}") }),
    };
    Ok(page(text, media_type, &headers))
}
