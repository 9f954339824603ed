//! Content negotiation: the same types as JSON or as MessagePack, and conditional answers.

mod strict;

use super::error::HttpError;
use super::packed::{Coding, Text};
use axum::body::Body;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use serde::Serialize;
use serde::de::{Deserialize, DeserializeOwned};

/// The media type of JSON.
pub const JSON: &str = "application/json";
/// The media type of MessagePack.
pub const MSGPACK: &str = "application/msgpack";

/// How a value is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// JSON.
    Json,
    /// MessagePack, structs as maps with string keys.
    MsgPack,
}

impl Wire {
    /// Its media type.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => JSON,
            Self::MsgPack => MSGPACK,
        }
    }

    /// A value as bytes.
    ///
    /// # Errors
    /// [`HttpError::Internal`]; our types always print.
    pub fn write<T: Serialize>(self, value: &T) -> Result<Vec<u8>, HttpError> {
        match self {
            Self::Json => serde_json::to_vec(value).map_err(|error| HttpError::Internal(error.to_string())),
            Self::MsgPack => rmp_serde::to_vec_named(value).map_err(|error| HttpError::Internal(error.to_string())),
        }
    }

    /// A value from bytes that the caller sent.
    ///
    /// # Errors
    /// [`HttpError::BodyInvalid`].
    pub fn read<T: DeserializeOwned>(self, bytes: &[u8]) -> Result<T, HttpError> {
        let invalid = |what: &str, error: String| {
            HttpError::BodyInvalid(format!("expected a body of {what} as /docs describes it, found another: {error}"))
        };
        match self {
            Self::Json => strict::from_slice(bytes).map_err(|error| invalid("JSON", error.to_string())),
            Self::MsgPack => {
                let mut reader = rmp_serde::Deserializer::new(bytes);
                reader.set_max_depth(MSGPACK_DEPTH_MAX);
                let value = T::deserialize(&mut reader).map_err(|error| invalid("MessagePack", error.to_string()))?;
                if let rest @ [_, ..] = *reader.get_ref() {
                    return Err(invalid("MessagePack", format!("{} bytes too many", rest.len())));
                }
                let mut again = rmp_serde::Deserializer::new(bytes);
                again.set_max_depth(MSGPACK_DEPTH_MAX);
                let plain = serde_json::Value::deserialize(&mut again);
                let plain = plain.map_err(|error| invalid("MessagePack", error.to_string()))?;
                strict::check::<T>(plain).map_err(|error| invalid("MessagePack", error.to_string()))?;
                Ok(value)
            }
        }
    }
}

/// Deepest nesting of a MessagePack body.
const MSGPACK_DEPTH_MAX: usize = 64;

/// One range of an `Accept` header.
struct Range<'a> {
    kind: &'a str,
    subtype: &'a str,
    quality: f32,
}

impl<'a> Range<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let mut parts = text.split(';').map(str::trim);
        let (kind, subtype) = parts.next()?.split_once('/')?;
        let quality = parts.find_map(|p| p.strip_prefix("q=").or_else(|| p.strip_prefix("Q=")));
        let quality = quality.map_or(Some(1.0), |q| q.parse().ok())?;
        Some(Self { kind, subtype, quality })
    }

    /// How closely the range names the media type: 3 exactly, 2 by kind, 1 by `*/*`; `None`: not at all.
    fn closeness(&self, media_type: &str) -> Option<u8> {
        let (kind, subtype) = media_type.split_once('/')?;
        match (self.kind, self.subtype) {
            ("*", "*") => Some(1),
            (k, "*") if k.eq_ignore_ascii_case(kind) => Some(2),
            (k, s) if k.eq_ignore_ascii_case(kind) && s.eq_ignore_ascii_case(subtype) => Some(3),
            _ => None,
        }
    }
}

/// The offer that `Accept` likes best, the earlier of equals; the first when there is no `Accept`.
///
/// # Errors
/// [`HttpError::NotAcceptable`].
pub fn choose<T: Copy>(headers: &HeaderMap, offers: &[(&str, T)]) -> Result<T, HttpError> {
    let values: Vec<&str> = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let accept = values.join(",");
    let offered = || offers.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    if accept.trim().is_empty() {
        let first = offers.first().map(|(_, offer)| *offer);
        return first.ok_or_else(|| HttpError::Internal("nothing to offer".into()));
    }
    let ranges: Vec<Range<'_>> = accept.split(',').filter_map(Range::parse).collect();
    let quality = |name: &str| {
        let named = ranges.iter().filter_map(|range| Some((range.closeness(name)?, range.quality)));
        named.max_by_key(|(closeness, _)| *closeness).map_or(0.0, |(_, quality)| quality)
    };
    let mut best: Option<(f32, T)> = None;
    for (name, offer) in offers {
        let q = quality(name);
        if q > best.map_or(0.0, |(q, _)| q) {
            best = Some((q, *offer));
        }
    }
    best.map(|(_, offer)| offer).ok_or_else(|| HttpError::NotAcceptable { offered: offered(), found: accept.clone() })
}

/// The answer that the caller prefers: how it is written, and what the caller has already.
#[derive(Clone, Debug)]
pub struct ResponsePreferences {
    wire: Wire,
    if_none_match: Option<String>,
    coding: Coding,
}

impl<S: Sync> FromRequestParts<S> for ResponsePreferences {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, HttpError> {
        let wire = choose(&parts.headers, &[(JSON, Wire::Json), (MSGPACK, Wire::MsgPack)])?;
        Ok(Self { wire, if_none_match: if_none_match(&parts.headers), coding: Coding::of(&parts.headers) })
    }
}

impl ResponsePreferences {
    /// A representation with its `ETag`, packed where it is long and the caller takes that, or 304 if the caller has it.
    ///
    /// # Errors
    /// [`HttpError::Internal`].
    pub fn show<T: Serialize>(&self, value: &T) -> Result<Response, HttpError> {
        let text = Text::once(self.wire.write(value)?.into());
        Ok(text.answer(self.coding, self.wire.media_type(), self.if_none_match.as_deref()))
    }

    /// A representation with another status and, if it is a new resource, its address.
    ///
    /// # Errors
    /// [`HttpError::Internal`].
    pub fn answer<T: Serialize>(
        &self,
        status: StatusCode,
        location: Option<String>,
        value: &T,
    ) -> Result<Response, HttpError> {
        let mut response = (status, Body::from(self.wire.write(value)?)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.wire.media_type()));
        if let Some(location) = location.and_then(|location| HeaderValue::try_from(location).ok()) {
            headers.insert(header::LOCATION, location);
        }
        Ok(response)
    }
}

/// The tags that the caller has.
pub fn if_none_match(headers: &HeaderMap) -> Option<String> {
    Some(headers.get(header::IF_NONE_MATCH)?.to_str().ok()?.to_owned())
}

/// Whether one of the tags of `If-None-Match` is `tag`, by weak comparison.
pub fn has_tag(if_none_match: Option<&str>, tag: &str) -> bool {
    let strip = |text: &str| text.trim().trim_start_matches("W/").to_owned();
    if_none_match.is_some_and(|tags| tags.split(',').any(|have| have.trim() == "*" || strip(have) == strip(tag)))
}

/// Bytes with their `ETag`, or 304 if the caller has them.
pub fn tagged(
    body: Bytes,
    media_type: &'static str,
    tag: &str,
    if_none_match: Option<&str>,
    cache: &'static str,
) -> Response {
    let mut response = match has_tag(if_none_match, tag) {
        true => StatusCode::NOT_MODIFIED.into_response(),
        false => Body::from(body).into_response(),
    };
    let headers = response.headers_mut();
    if response_has_body(if_none_match, tag) {
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
    }
    if let Ok(tag) = HeaderValue::try_from(tag) {
        headers.insert(header::ETAG, tag);
    }
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(cache));
    headers.insert(header::VARY, HeaderValue::from_static("accept"));
    response
}

fn response_has_body(if_none_match: Option<&str>, tag: &str) -> bool {
    !has_tag(if_none_match, tag)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accept(text: &str) -> Result<Wire, HttpError> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::try_from(text).expect("a value"))]);
        choose(&headers, &[(JSON, Wire::Json), (MSGPACK, Wire::MsgPack)])
    }

    #[test]
    fn the_best_liked_offer_is_chosen() {
        assert_eq!(choose(&HeaderMap::new(), &[(JSON, Wire::Json)]).expect("the first"), Wire::Json);
        assert_eq!(accept("*/*").expect("any"), Wire::Json);
        assert_eq!(accept("application/msgpack").expect("named"), Wire::MsgPack);
        assert_eq!(accept("application/json;q=0.5, application/msgpack").expect("by quality"), Wire::MsgPack);
        assert_eq!(accept("application/*;q=0.9, application/json;q=0.1").expect("the closer rules"), Wire::MsgPack);
        assert_eq!(accept("text/html, */*;q=0.1").expect("any at last"), Wire::Json);
        assert!(matches!(accept("text/html"), Err(HttpError::NotAcceptable { .. })));
        assert!(matches!(accept("application/json;q=0"), Err(HttpError::NotAcceptable { .. })));
        assert!(matches!(accept("nonsense"), Err(HttpError::NotAcceptable { .. })));
    }

    #[test]
    fn tags_are_compared_weakly() {
        assert!(has_tag(Some("\"a\", W/\"b\""), "\"b\""));
        assert!(has_tag(Some("*"), "\"b\""));
        assert!(!has_tag(Some("\"a\""), "\"b\""));
        assert!(!has_tag(None, "\"b\""));
    }

    #[test]
    fn a_packed_body_with_a_tail_is_refused() {
        let mut bytes = rmp_serde::to_vec_named(&7u8).expect("packs");
        assert_eq!(Wire::MsgPack.read::<u8>(&bytes).expect("reads"), 7);
        bytes.push(0);
        assert!(Wire::MsgPack.read::<u8>(&bytes).is_err());
        let list = rmp_serde::to_vec_named(&serde_json::json!([null, null])).expect("packs");
        assert!(Wire::MsgPack.read::<quadmuse_proto::TokenPatch>(&list).is_err());
        let number = rmp_serde::to_vec_named(&serde_json::json!({ "role": 0 })).expect("packs");
        assert!(Wire::MsgPack.read::<quadmuse_proto::NewToken>(&number).is_err());
        let deep = vec![0x91; 100_000];
        assert!(Wire::MsgPack.read::<serde_json::Value>(&deep).is_err());
    }
}
