//! Requests to the service: one function a call, typed by the messages of the wire.
//!
//! Every `POST` carries an `Idempotency-Key`, so that it can be sent again when the service is overloaded.

mod examples;
mod multipart;
mod queries;
mod unfinished;
mod uploads;

pub use examples::{Added, ExampleFilter, ExampleUpload, Gain};
pub use queries::{MeshSource, RankingView, Resized};

use crate::{
    args::SegmentsArg,
    error::ClientError,
    file::{self, MeshBytes, Packing},
    spec::SegmentsSpec,
};
use quadmuse_proto::{Code, MeshFormat, Page, Problem, QueryId, id::RequestId, paging::LIMIT_MAX};
use reqwest::{Method, RequestBuilder, Response, StatusCode, Url, header};
use serde::de::DeserializeOwned;
use std::{path::Path, time::Duration};
use unfinished::Unfinished;

/// How long a connection may take to come about.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// How long an ordinary answer may take.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(120);
/// How long an upload or a computation may take.
const WORK_TIMEOUT: Duration = Duration::from_secs(3600);
/// Sendings of one request that the service is too busy for.
const SENDINGS_MAX: u32 = 6;
/// Longest pause between two sendings, whatever the service asks for.
const PAUSE_MAX: Duration = Duration::from_secs(30);
/// Characters of an unintelligible answer that are shown.
const FOUND_LENGTH_MAX: usize = 120;

/// Told how much of a long file has arrived, 0–1.
pub type Sent<'a> = &'a (dyn Fn(f64) + Sync);

/// A client of one server.
#[derive(Clone, Debug)]
pub struct Api {
    http: reqwest::Client,
    base: Url,
    token: Option<String>,
    unfinished: Unfinished,
}

impl Api {
    /// A client of the server at `address` (`http://host:port`, the scheme may be left out).
    ///
    /// # Errors
    /// [`ClientError::Address`] if that is no address this client can speak to.
    pub fn new(address: &str, token: Option<&str>) -> Result<Self, ClientError> {
        let base = base_url(address)?;
        let http = reqwest::Client::builder()
            .user_agent(concat!("quadmuse/", env!("CARGO_PKG_VERSION")))
            .connect_timeout(CONNECT_TIMEOUT)
            .tcp_keepalive(Duration::from_secs(30))
            .no_proxy()
            .build()
            .map_err(|source| ClientError::Unreachable { server: base.to_string(), source })?;
        Ok(Self { http, base, token: token.map(str::to_owned), unfinished: Unfinished::default() })
    }

    /// The server's address.
    pub fn server(&self) -> &str {
        self.base.as_str().trim_end_matches('/')
    }

    /// A request to the resource whose path segments are given.
    fn request(&self, method: Method, path: &[&str]) -> RequestBuilder {
        let mut url = self.base.clone();
        if let Ok(mut segments) = url.path_segments_mut() {
            segments.pop_if_empty().push("v1").extend(path);
        }
        let mut request = self.http.request(method.clone(), url).timeout(ANSWER_TIMEOUT);
        if method == Method::POST {
            request = request.header("idempotency-key", RequestId::generate().to_string());
        }
        match &self.token {
            Some(token) => request.bearer_auth(token),
            None => request,
        }
    }

    /// Sends a request, again and again while the service is too busy for it; answers only with success.
    async fn send(&self, request: RequestBuilder) -> Result<Response, ClientError> {
        let mut request = request;
        for sending in 1.. {
            let again = request.try_clone();
            let response = match (self.send_once(request).await, &again) {
                // A connection kept open may be closed from the other side at the moment it is used again.
                (Err(error), Some(again)) if sending == 1 && is_broken_early(&error) => {
                    let again = again.try_clone();
                    self.send_once(again.ok_or(error)?).await?
                }
                (sent, _) => sent?,
            };
            if response.status().is_success() {
                return Ok(response);
            }
            let busy = matches!(response.status(), StatusCode::SERVICE_UNAVAILABLE | StatusCode::TOO_MANY_REQUESTS);
            let pause = retry_after(&response);
            let query = query_in(response.url());
            let problem = Box::new(problem(response).await);
            match (again, pause, query) {
                // Waiting doesn't bring it back.
                (_, _, Some(query)) if problem.code == Code::OwnerGone => {
                    return Err(ClientError::OwnerGone { query, problem });
                }
                (Some(again), Some(pause), _) if busy && sending < SENDINGS_MAX => {
                    tokio::time::sleep(pause.min(PAUSE_MAX)).await;
                    request = again;
                }
                _ => return Err(ClientError::Refused(problem)),
            }
        }
        unreachable!("the loop has no end")
    }

    async fn send_once(&self, request: RequestBuilder) -> Result<Response, ClientError> {
        let (http, request) = request.build_split();
        let request = request.map_err(|source| self.broken(source, 0))?;
        let sent = request.body().and_then(|body| body.as_bytes()).map_or(0, <[u8]>::len);
        http.execute(request).await.map_err(|source| self.broken(source, sent))
    }

    /// What a fault of the connection means, after `sent` bytes of a body.
    fn broken(&self, source: reqwest::Error, sent: usize) -> ClientError {
        let (server, source) = (self.server().to_owned(), source.without_url());
        if source.is_connect() {
            ClientError::Unreachable { server, source }
        } else if sent > 0 && !source.is_timeout() {
            ClientError::UploadBrokenOff { server, bytes: sent, source }
        } else {
            ClientError::BrokenOff { server, source }
        }
    }

    async fn json<T: DeserializeOwned>(
        &self,
        request: RequestBuilder,
        expected: &'static str,
    ) -> Result<T, ClientError> {
        let response = self.send(request).await?;
        self.decode(response, expected).await
    }

    async fn decode<T: DeserializeOwned>(&self, response: Response, expected: &'static str) -> Result<T, ClientError> {
        let url = response.url().to_string();
        let body = response.bytes().await.map_err(|source| self.broken(source, 0))?;
        serde_json::from_slice(&body).map_err(|fault| {
            let beginning = String::from_utf8_lossy(&body);
            let beginning: String = beginning.chars().take(FOUND_LENGTH_MAX).collect();
            ClientError::Unintelligible { url, expected, found: format!("`{beginning}` ({fault})") }
        })
    }

    /// All of a list, page by page.
    async fn pages<T: DeserializeOwned>(
        &self,
        path: &[&str],
        fixed: &[(&str, String)],
        expected: &'static str,
    ) -> Result<Vec<T>, ClientError> {
        let mut items = Vec::new();
        let mut cursor: Option<String> = None;
        loop {
            let mut query = vec![("limit", LIMIT_MAX.to_string())];
            query.extend(fixed.iter().cloned());
            query.extend(cursor.take().map(|cursor| ("cursor", cursor)));
            let page: Page<T> = self.json(self.request(Method::GET, path).query(&query), expected).await?;
            let is_empty = page.items.is_empty();
            items.extend(page.items);
            match page.next {
                Some(next) if !is_empty => cursor = Some(next),
                _ => return Ok(items),
            }
        }
    }

    async fn bytes(&self, request: RequestBuilder) -> Result<Vec<u8>, ClientError> {
        let response = self.send(request.timeout(WORK_TIMEOUT)).await?;
        Ok(response.bytes().await.map_err(|source| self.broken(source, 0))?.to_vec())
    }

    /// Sends a request with a mesh file as its body, and with the labels of its faces if there are some. A long one is uploaded
    /// piece by piece before.
    async fn send_mesh(
        &self,
        request: RequestBuilder,
        mesh: &Path,
        how: &SegmentsArg,
        sent: Sent<'_>,
    ) -> Result<Response, ClientError> {
        let (request, bytes) = with_mesh(request.timeout(WORK_TIMEOUT), mesh, how)?;
        let upload = if bytes.len() > uploads::WHOLE_MAX { self.upload(&bytes, sent).await? } else { None };
        let Some(id) = upload else { return self.send(request.body(bytes)).await };
        drop(bytes);
        let answer = self.send(request.query(&[("upload", &id)])).await;
        self.free_upload(&id).await;
        answer
    }
}

/// Gives a request all that says what a mesh file in its body is; the body, too.
fn with_mesh(
    request: RequestBuilder,
    mesh: &Path,
    how: &SegmentsArg,
) -> Result<(RequestBuilder, Vec<u8>), ClientError> {
    let found = MeshBytes::read(mesh)?;
    let media_type = found.format.map_or("application/octet-stream", MeshFormat::media_type);
    let request = match how.parts {
        None => request,
        Some(parts) => request.query(&[("parts", parts.to_string())]),
    };
    let request = match how.components {
        None => request,
        Some(components) => request.query(&[("components", components.as_str())]),
    };
    let request = match &how.segments {
        None => request,
        Some(SegmentsSpec::Rule(rule)) => request.query(&[("segments", rule.as_str())]),
        Some(SegmentsSpec::Labels(labels)) => {
            let form = multipart::Form::new().part("mesh", media_type, &found.unpacked(mesh)?).part(
                "segments",
                "text/plain",
                &file::read(labels)?,
            );
            let (content_type, body) = form.finish();
            return Ok((request.header(header::CONTENT_TYPE, content_type), body));
        }
    };
    let request = match found.packing {
        Packing::Plain => request,
        Packing::Gzip => request.header(header::CONTENT_ENCODING, "gzip"),
    };
    Ok((request.header(header::CONTENT_TYPE, media_type), found.bytes))
}

fn base_url(address: &str) -> Result<Url, ClientError> {
    let refuse = |way_out| Err(ClientError::Address { found: address.into(), way_out });
    let text = if address.contains("://") { address.to_owned() } else { format!("http://{address}") };
    let Ok(url) = text.parse::<Url>() else { return refuse("check its spelling") };
    match url.scheme() {
        "http" if url.has_host() && url.query().is_none() && url.fragment().is_none() => Ok(url),
        "https" => {
            refuse("this client speaks plain http: reach the server through a tunnel, or a local proxy that adds TLS")
        }
        _ => refuse("check its spelling"),
    }
}

/// The query that an address is of, or of something that belongs to it.
fn query_in(url: &Url) -> Option<QueryId> {
    let mut segments = url.path_segments()?.skip_while(|segment| *segment != "queries");
    segments.nth(1)?.parse().ok()
}

/// Whether a connection broke, other than by taking too long.
fn is_broken_early(error: &ClientError) -> bool {
    match error {
        ClientError::BrokenOff { source, .. } | ClientError::UploadBrokenOff { source, .. } => !source.is_timeout(),
        _ => false,
    }
}

fn retry_after(response: &Response) -> Option<Duration> {
    let seconds = response.headers().get(header::RETRY_AFTER)?.to_str().ok()?.trim().parse::<u64>().ok()?;
    Some(Duration::from_secs(seconds))
}

/// The problem that an answer other than success tells, or one made up from its status.
async fn problem(response: Response) -> Problem {
    let status = response.status();
    let body = response.bytes().await.unwrap_or_default();
    if let Ok(problem) = serde_json::from_slice::<Problem>(&body) {
        return problem;
    }
    let beginning: String = String::from_utf8_lossy(&body).chars().take(FOUND_LENGTH_MAX).collect();
    let detail = format!(
        "expected an answer of a Quadmuse server, found status {status} with `{}`; see whether the address is that of one",
        beginning.trim()
    );
    Problem::new(Code::Other, status.as_u16(), detail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_needs_no_scheme_and_may_have_a_path() {
        assert_eq!(base_url("localhost:7979").expect("an address").as_str(), "http://localhost:7979/");
        let api = Api::new("http://studio:80/quadmuse/", None).expect("an address");
        let request = api.request(Method::GET, &["examples", "a/b c"]).build().expect("a request");
        assert_eq!(request.url().as_str(), "http://studio/quadmuse/v1/examples/a%2Fb%20c");
        assert_eq!(api.server(), "http://studio/quadmuse");
    }

    #[test]
    fn an_address_that_cannot_be_spoken_to_is_wrong_usage() {
        for address in ["https://studio", "ftp://x", "http://", "", "http://x/?a=b", "::"] {
            let error = base_url(address).expect_err(address);
            assert_eq!(error.exit_code(), crate::error::EXIT_USAGE, "{address}");
        }
    }

    #[test]
    fn an_address_tells_its_query() {
        let of = |path: &str| query_in(&format!("http://x/quadmuse/v1/{path}").parse().expect("an address"));
        let id = QueryId::from_bytes([7; 16]);
        assert_eq!(of(&format!("queries/{id}/maps/x?wait=1")), Some(id));
        assert_eq!(of(&format!("queries/{id}")), Some(id));
        assert_eq!((of("queries"), of("queries/x"), of("examples/x")), (None, None, None));
    }

    #[test]
    fn the_token_travels_as_a_bearer_and_posts_carry_a_key() {
        let api = Api::new("x", Some("secret")).expect("an address");
        let request = api.request(Method::POST, &["queries"]).build().expect("a request");
        assert_eq!(request.headers()["authorization"], "Bearer secret");
        assert!(request.headers().contains_key("idempotency-key"));
        let request = api.request(Method::GET, &["queries"]).build().expect("a request");
        assert!(!request.headers().contains_key("idempotency-key"));
    }
}
