//! A mesh in the body, or in an upload that takes its place: raw bytes, or `multipart/form-data` with the parts `mesh` and `segments`.

use super::body::{Source, computed};
use super::caller::RequestCaller;
use super::error::HttpError;
use super::params::Params;
use crate::app::App;
use crate::pool::{Stop, User};
use crate::work::engine::{Cut, EngineError, ExtraParts, Refusal};
use crate::work::ingest::{Upload, check_labels};
use axum::body::Body;
use axum::extract::{FromRequest, FromRequestParts, Multipart, Request};
use axum::http::{HeaderValue, header};
use bytes::Bytes;
use http_body::Body as _;
use quadmuse_proto::{Components, MeshFormat, Segmentation, segment};

/// Names of the parts that are read.
const PARTS: &str = "`mesh` and (optional) `segments`";

/// Media types that say nothing of the format: it is recognised from the bytes.
const ANY_BYTES: [&str; 4] =
    ["application/octet-stream", "application/x-www-form-urlencoded", "text/plain", "binary/octet-stream"];

/// An uploaded mesh, with the hash of all that was sent, for `Idempotency-Key`.
pub struct MeshUpload {
    /// The mesh.
    pub upload: Upload,
    /// Which parts become segments beside the whole if it is added as an example.
    pub besides: ExtraParts,
    /// Hash of the bytes and of the parameters.
    pub fingerprint: blake3::Hash,
}

/// What the body holds.
#[derive(Default)]
struct Parts {
    mesh: Option<Bytes>,
    format: Option<MeshFormat>,
    labels: Option<Vec<i64>>,
}

impl FromRequest<App> for MeshUpload {
    type Rejection = HttpError;

    async fn from_request(request: Request, app: &App) -> Result<Self, HttpError> {
        let (mut head, body) = request.into_parts();
        let params = Params::from_request_parts(&mut head, app).await?;
        let asked = match params.text("format")? {
            None => None,
            Some(name) => Some(format_named(name)?),
        };
        let way = params.get::<Segmentation>("segments", "auto, whole or groups")?.unwrap_or_default();
        let components = params.get::<Components>("components", "largest or refuse")?.unwrap_or_default();
        let count = params.get::<segment::Parts>("parts", "auto, waist, none, or a number from 1 to 64")?;
        let RequestCaller(caller) = head.extensions.get::<RequestCaller>().copied().unwrap_or_default();
        let media_type = head.headers.get(header::CONTENT_TYPE).map(|value| value.to_str().unwrap_or("not a text"));
        let is_form = media_type.is_some_and(|kind| essence(kind).eq_ignore_ascii_case("multipart/form-data"));
        let named = match media_type.filter(|_| asked.is_none() && !is_form) {
            Some(kind) => format_of_media_type(kind)?,
            None => asked,
        };
        let asked_for = UploadParameters {
            format: named,
            way,
            components,
            count,
            query: head.uri.query().unwrap_or_default().into(),
        };
        let (headers, runtime) = (head.headers.clone(), tokio::runtime::Handle::current());
        let (this, kind) = (app.clone(), head.headers.get(header::CONTENT_TYPE).cloned());
        let read = move |bytes: Bytes, _: &Stop| {
            let parts = match kind.filter(|_| is_form) {
                // All of it is there: nothing is waited for.
                Some(kind) => runtime.block_on(multipart(kind, bytes, &this, caller.user))?,
                None => Parts { mesh: Some(bytes), ..Parts::default() },
            };
            asked_for.upload(parts)
        };
        let source = match params.get("upload", "the id of an upload")? {
            None => Source::Body(body),
            Some(id) if body.is_end_stream() => Source::Upload(id),
            Some(_) => return Err(HttpError::BodyInvalid("expected no body beside `upload`, found one".into())),
        };
        computed(app, caller, &headers, source, read).await
    }
}

/// The parameters of an upload: what the request says beside its body.
struct UploadParameters {
    format: Option<MeshFormat>,
    way: Segmentation,
    components: Components,
    count: Option<segment::Parts>,
    query: String,
}

impl UploadParameters {
    fn upload(self, parts: Parts) -> Result<MeshUpload, HttpError> {
        let none = || HttpError::BodyInvalid("expected a part `mesh`, found none".into());
        let bytes = parts.mesh.ok_or_else(none)?;
        if bytes.is_empty() {
            let detail = "expected a mesh in the body, found no bytes; send the file's bytes as they are";
            return Err(HttpError::Work(EngineError::refused(Refusal::Empty, detail).into()));
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.query.as_bytes()).update(&[0]).update(&bytes);
        for label in parts.labels.iter().flatten() {
            hasher.update(&label.to_le_bytes());
        }
        let count = self.count.filter(|count| *count != segment::Parts::None);
        if let Some(count) = count
            && (self.way != Segmentation::Auto || parts.labels.is_some())
        {
            return Err(HttpError::parameter(
                "parts",
                "only where the service cuts (`segments=auto`, no labels)",
                count,
            ));
        }
        let cut =
            Cut { way: self.way, labels: parts.labels, parts: count, components: self.components, ..Cut::default() };
        let besides =
            if self.count.is_none() && !cut.is_asked_for() { ExtraParts::Sought } else { ExtraParts::Nothing };
        let upload = Upload { bytes, format: self.format.or(parts.format), cut };
        Ok(MeshUpload { upload, besides, fingerprint: hasher.finalize() })
    }
}

fn essence(media_type: &str) -> &str {
    media_type.split(';').next().unwrap_or_default().trim()
}

/// The format of `?format=`.
///
/// # Errors
/// [`HttpError::BodyFormat`].
pub fn format_named(name: &str) -> Result<MeshFormat, HttpError> {
    let unknown =
        |_| HttpError::BodyFormat { expected: "`format` obj, ply, off, stl or glb".into(), found: name.into() };
    name.parse().map_err(unknown)
}

fn format_of_media_type(media_type: &str) -> Result<Option<MeshFormat>, HttpError> {
    if let Some(format) = MeshFormat::from_media_type(media_type) {
        return Ok(Some(format));
    }
    if ANY_BYTES.iter().any(|any| any.eq_ignore_ascii_case(essence(media_type))) {
        return Ok(None);
    }
    let known: Vec<&str> = MeshFormat::ALL.iter().map(|format| format.media_type()).collect();
    let expected = format!("`content-type` {}, or application/octet-stream", known.join(", "));
    Err(HttpError::BodyFormat { expected, found: media_type.into() })
}

async fn multipart(kind: HeaderValue, bytes: Bytes, app: &App, user: User) -> Result<Parts, HttpError> {
    let invalid =
        |error: String| HttpError::BodyInvalid(format!("expected multipart/form-data with {PARTS}, found: {error}"));
    // The parts lie beside the form until all is read.
    let share = app.work.hold(user, bytes.len() as u64)?;
    let mut request = Request::new(Body::from(bytes));
    request.headers_mut().insert(header::CONTENT_TYPE, kind);
    let mut form = Multipart::from_request(request, app).await.map_err(|error| invalid(error.body_text()))?;
    let mut parts = Parts::default();
    let broken = |error: axum::extract::multipart::MultipartError| invalid(error.body_text());
    while let Some(field) = form.next_field().await.map_err(broken)? {
        let name = field.name().unwrap_or_default().to_owned();
        let format = field.content_type().and_then(MeshFormat::from_media_type);
        let format = format.or_else(|| field.file_name().and_then(MeshFormat::from_file_name));
        let bytes = field.bytes().await.map_err(broken)?;
        match name.as_str() {
            "mesh" if parts.mesh.is_none() => (parts.mesh, parts.format) = (Some(bytes), format),
            "segments" if parts.labels.is_none() => {
                // Eight bytes a label, of which two bytes may be one.
                app.work.grow(&share, 4 * bytes.len() as u64)?;
                parts.labels = Some(labels(&bytes)?);
            }
            "mesh" | "segments" => return Err(invalid(format!("the part `{name}` twice"))),
            _ => return Err(invalid(format!("a part named {name:?}"))),
        }
    }
    Ok(parts)
}

/// One integer a line; blank lines at the end don't count.
fn labels(bytes: &[u8]) -> Result<Vec<i64>, HttpError> {
    let wrong = |line: usize, found: &str| {
        let found: String = found.chars().take(40).collect();
        HttpError::parameter("segments", "one integer a line, one line a face", format!("{found} in line {line}"))
    };
    let text = std::str::from_utf8(bytes).map_err(|_| wrong(1, "bytes that are no text"))?;
    let line = |(at, line): (usize, &str)| line.trim().parse().map_err(|_| wrong(at + 1, line));
    let labels: Vec<i64> = text.trim_end().lines().enumerate().map(line).collect::<Result<_, _>>()?;
    // Before any is cut: each costs memory, however few its faces are.
    check_labels(&labels)?;
    Ok(labels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_one_integer_a_line() {
        assert_eq!(labels(b"0\n-1\r\n 7 \n\n").expect("labels"), [0, -1, 7]);
        let error = labels(b"0\nx\n").expect_err("no number in line 2");
        assert!(error.to_string().contains("line 2"), "{error}");
        assert!(labels(b"1.5").is_err());
        assert!(labels(&[0xff]).is_err());
        assert_eq!(labels(b"").expect("none"), [0i64; 0]);
    }

    #[test]
    fn media_types_of_meshes_are_known_and_those_of_bytes_say_nothing() {
        assert_eq!(format_of_media_type("model/ply; x=y").expect("known"), Some(MeshFormat::Ply));
        assert_eq!(format_of_media_type("application/octet-stream").expect("bytes"), None);
        assert!(format_of_media_type("image/png").is_err());
    }
}
