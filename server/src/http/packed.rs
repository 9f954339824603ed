//! Texts that travel packed: the page, the contract and long answers go as gzip to whoever takes it (RFC 9110, 12.5.3).
//!
//! Streams and meshes go as they are: a stream would wait for what fills a block, and a mesh is binary, or asked for once.
//! Each coding is another representation, with a tag of its own.

use super::negotiate::{has_tag, tagged};
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::sync::OnceLock;

/// Shorter answers are not worth it, in bytes: what is sent once has to be packed each time, what is kept only once.
const LONG: usize = 4 << 10;
const LONG_KEPT: usize = 256;

/// A way to write bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// As they are.
    Plain,
    /// As gzip.
    Gzip,
}

impl Coding {
    /// The coding that the caller takes: gzip where it is named, or any is, and not refused.
    pub fn of(headers: &HeaderMap) -> Self {
        let values = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
        let (mut named, mut any) = (None, None);
        for choice in values.flat_map(|value| value.split(',')) {
            let mut parts = choice.split(';').map(str::trim);
            let name = parts.next().unwrap_or_default().to_ascii_lowercase();
            let quality = parts.find_map(|part| part.strip_prefix("q=").or_else(|| part.strip_prefix("Q=")));
            let is_taken = quality.map_or(Some(1.0), |q| q.parse::<f32>().ok()).is_some_and(|q| q > 0.0);
            match name.as_str() {
                "gzip" | "x-gzip" => named = Some(is_taken),
                "*" => any = Some(is_taken),
                _ => {}
            }
        }
        if named.or(any).unwrap_or(false) { Self::Gzip } else { Self::Plain }
    }
}

/// Bytes as gzip. Writing to memory does not fail; if it did, there would be no bytes.
fn gzip(plain: &[u8], level: Compression) -> Option<Bytes> {
    let mut encoder = GzEncoder::new(Vec::with_capacity(plain.len() / 3), level);
    encoder.write_all(plain).ok()?;
    encoder.finish().ok().map(Bytes::from)
}

/// Describes a text to answer with.
#[derive(Debug)]
pub struct Text {
    plain: Bytes,
    /// The tag of it as it is, in quotes.
    tag: String,
    level: Compression,
    /// What is shorter is never packed, in bytes.
    long: usize,
    /// As gzip, once somebody took it.
    gzip: OnceLock<Option<Bytes>>,
}

impl Text {
    /// A text that is sent often, packed as well as can be.
    pub fn kept(plain: Bytes) -> Self {
        Self::new(plain, Compression::best(), LONG_KEPT)
    }

    /// A text that is sent once, packed quickly.
    pub fn once(plain: Bytes) -> Self {
        Self::new(plain, Compression::fast(), LONG)
    }

    fn new(plain: Bytes, level: Compression, long: usize) -> Self {
        let tag = format!("\"{}\"", &blake3::hash(&plain).to_hex()[..32]);
        Self { plain, tag, level, long, gzip: OnceLock::new() }
    }

    /// The answer: in the coding that the caller takes, or 304 if the caller has it.
    pub fn answer(&self, coding: Coding, media_type: &'static str, if_none_match: Option<&str>) -> Response {
        let is_packed = coding == Coding::Gzip && self.plain.len() >= self.long;
        let tag = if is_packed { format!("{}-gzip\"", self.tag.trim_end_matches('"')) } else { self.tag.clone() };
        let is_known = has_tag(if_none_match, &tag);
        let packed = (is_packed && !is_known).then(|| self.gzip.get_or_init(|| gzip(&self.plain, self.level)).clone());
        let packed = packed.flatten();
        let coding = packed.as_ref().map(|_| HeaderValue::from_static("gzip"));
        let mut response =
            tagged(packed.unwrap_or_else(|| self.plain.clone()), media_type, &tag, if_none_match, "no-cache");
        let headers = response.headers_mut();
        headers.insert(header::VARY, HeaderValue::from_static("accept, accept-encoding"));
        headers.extend(coding.map(|coding| (header::CONTENT_ENCODING, coding)));
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gzip_is_taken_where_it_is_named_and_not_refused() {
        let coding = |text: &str| {
            Coding::of(&HeaderMap::from_iter([(
                header::ACCEPT_ENCODING,
                HeaderValue::try_from(text).expect("a value"),
            )]))
        };
        for text in ["gzip", "br, GZIP;q=0.5", "deflate, x-gzip", "*", "*;q=0, gzip", "gzip; q=0.001"] {
            assert_eq!(coding(text), Coding::Gzip, "{text}");
        }
        for text in ["", "identity", "br, zstd", "gzip;q=0", "gzip;q=0, *", "*;q=0", "gzip;q=nonsense"] {
            assert_eq!(coding(text), Coding::Plain, "{text}");
        }
        assert_eq!(Coding::of(&HeaderMap::new()), Coding::Plain);
    }

    #[test]
    fn each_coding_is_another_representation_with_a_tag_of_its_own() {
        let answer = |text: &Text, coding, known: Option<&str>| {
            let response = text.answer(coding, "text/plain", known);
            let header = |name| response.headers().get(name).map(|value| value.to_str().expect("text").to_owned());
            let found = (response.status().as_u16(), header(header::CONTENT_ENCODING), header(header::ETAG));
            assert_eq!(header(header::VARY).as_deref(), Some("accept, accept-encoding"));
            (found.0, found.1, found.2.expect("a tag"))
        };
        let long = Text::once(Bytes::from(vec![b'a'; LONG]));
        let (plain, packed) = (answer(&long, Coding::Plain, None), answer(&long, Coding::Gzip, None));
        assert_eq!((plain.0, plain.1), (200, None));
        assert_eq!((packed.0, packed.1.as_deref()), (200, Some("gzip")));
        assert_ne!(plain.2, packed.2);
        for (coding, known, status) in [
            (Coding::Plain, &plain.2, 304),
            (Coding::Gzip, &packed.2, 304),
            (Coding::Gzip, &plain.2, 200),
            (Coding::Plain, &packed.2, 200),
        ] {
            let again = answer(&long, coding, Some(known));
            assert_eq!((again.0, again.1.is_some()), (status, status == 200 && coding == Coding::Gzip));
        }
        let short = Text::once(Bytes::from(vec![b'a'; LONG - 1]));
        assert_eq!(answer(&short, Coding::Gzip, None).1, None);
        assert!(answer(&Text::kept(Bytes::from(vec![b'a'; LONG_KEPT])), Coding::Gzip, None).1.is_some());
    }
}
