//! The pages for people, embedded in the binary: `/` and `/docs`, without anything from elsewhere.

use super::error::HttpError;
use super::negotiate::if_none_match;
use super::packed::{Coding, Text};
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use std::sync::LazyLock;

/// What the pages may load: only what this server serves.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                      connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const PICTURE: &str = "image/svg+xml";

fn page(text: &Text, media_type: &'static str, headers: &HeaderMap) -> Response {
    let mut response = text.answer(Coding::of(headers), media_type, if_none_match(headers).as_deref());
    let out = response.headers_mut();
    out.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    out.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    response
}

fn kept(text: &'static str) -> Text {
    Text::kept(text.into())
}

/// The web page.
pub async fn index(headers: HeaderMap) -> Response {
    static TEXT: LazyLock<Text> = LazyLock::new(|| kept(include_str!("../../web/index.html")));
    page(&TEXT, HTML, &headers)
}

/// The contract for people.
pub async fn docs(headers: HeaderMap) -> Response {
    static TEXT: LazyLock<Text> = LazyLock::new(|| kept(include_str!("../../web/docs.html")));
    page(&TEXT, HTML, &headers)
}

macro_rules! assets {
    ($($name:literal $media_type:ident),* $(,)?) => {
        /// What the pages need: a name, the text and its media type.
        static ASSETS: LazyLock<Vec<(&str, Text, &str)>> = LazyLock::new(|| {
            vec![$(($name, kept(include_str!(concat!("../../web/", $name))), $media_type)),*]
        });
    };
}

assets!(
    "access.js" SCRIPT, "bench.css" STYLE, "bench.js" SCRIPT, "call.js" SCRIPT, "camera.js" SCRIPT, "coarse.js" SCRIPT,
    "corpus.js" SCRIPT, "cutkeys.js" SCRIPT, "cutting.js" SCRIPT, "partnames.js" SCRIPT, "pen.js" SCRIPT, "regions.js" SCRIPT, "ways.js" SCRIPT,
    "docs.js" SCRIPT, "drape.js" SCRIPT, "example.js" SCRIPT, "files.js" SCRIPT, "follow.js" SCRIPT, "heat.js" SCRIPT,
    "histograms.js" SCRIPT, "history.js" SCRIPT, "icon.svg" PICTURE, "index.js" SCRIPT, "landmarks.js" SCRIPT, "laying.js" SCRIPT, "making.js" SCRIPT, "mesh.js" SCRIPT,
    "mirror.js" SCRIPT, "naming.js" SCRIPT,
    "near.js" SCRIPT,
    "paint.js" SCRIPT, "painting.js" SCRIPT, "panel.js" SCRIPT, "parts.js" SCRIPT, "plane.js" SCRIPT, "points.js" SCRIPT, "pose.js" SCRIPT, "ranking.js" SCRIPT,
    "read.js" SCRIPT, "route.js" SCRIPT, "samples.js" SCRIPT, "state.js" SCRIPT, "status.js" SCRIPT, "style.css" STYLE, "tools.js" SCRIPT,
    "viewer.js" SCRIPT, "weld.js" SCRIPT, "words.js" SCRIPT,
);

/// What the pages need, by its name.
pub async fn asset(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, HttpError> {
    let (_, text, media_type) = ASSETS
        .iter()
        .find(|(known, _, _)| *known == name)
        .ok_or_else(|| HttpError::NoRoute { path: format!("/web/{name}") })?;
    Ok(page(text, media_type, &headers))
}
