//! The whole HTTP surface in one process: each endpoint and each problem, pinned by status and body.
//!
//! The geometry is a fake (see `work::engine::fake`) and the corpus is in memory; what is tested is everything above.

mod access;
mod bodies;
mod examples;
mod forward;
mod maps;
mod naming;
mod queries;
mod retopos;
mod shares;
mod sockets;
mod streams;
mod surface;
mod uploads;

use super::router;
use crate::app::{App, ClusterHandles, Settings};
use crate::audit::Audit;
use crate::auth::Tokens;
use crate::pool::{Admission, Pool, User};
use crate::work::corpus::memory::MemoryCorpus;
use crate::work::engine::Cut;
use crate::work::engine::fake::FakeEngine;
use crate::work::kept::{Files, KeptKind, KeptQueries};
use crate::work::query::{LiveQuery, QueryOptions};
use crate::work::uploads::Uploads;
use crate::work::{Caller, Work};
use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, StatusCode, header};
use http_body_util::BodyExt;
use quadmuse_proto::Share;
use serde_json::Value;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

/// Largest body in tests, in bytes.
const LIMIT: u64 = 64 << 10;

/// A service in memory.
struct Bench {
    work: Arc<Work>,
    corpus: Arc<MemoryCorpus>,
    router: Router,
    stopping: CancellationToken,
    dir: tempfile::TempDir,
}

/// An answer, read whole.
struct Answer {
    status: StatusCode,
    headers: HeaderMap,
    bytes: Vec<u8>,
}

impl Answer {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.bytes).unwrap_or_else(|e| panic!("expected JSON, found {e}: {}", self.text()))
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes).into_owned()
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().expect("a text"))
    }

    /// Asserts a problem of this status and code; gives its detail.
    fn problem(&self, status: u16, code: &str) -> String {
        assert_eq!(self.header("content-type"), "application/problem+json", "{}", self.text());
        let problem = self.json();
        assert_eq!(
            (problem["status"].as_u64(), problem["code"].as_str()),
            (Some(u64::from(status)), Some(code)),
            "{problem}"
        );
        assert_eq!(self.status.as_u16(), status);
        assert_eq!(problem["type"], format!("urn:quadmuse:problem:{code}"));
        assert_eq!(problem["request_id"], self.header("x-request-id"));
        problem["detail"].as_str().expect("a sentence").to_owned()
    }
}

impl Bench {
    fn new() -> Self {
        Self::with(Admission::new(64 << 20, 32))
    }

    fn with(admission: Admission) -> Self {
        let dir = tempfile::tempdir().expect("a directory");
        let kept = KeptQueries::on(Arc::new(Files::beside(dir.path())));
        Self::one_of(admission, dir, ClusterHandles { kept, peers: None, signs: Arc::default() })
    }

    fn one_of(admission: Admission, dir: tempfile::TempDir, together: ClusterHandles) -> Self {
        Self::holding(None, Arc::default(), admission, dir, together)
    }

    /// One with a share of a corpus.
    fn holding(
        share: Option<Share>,
        corpus: Arc<MemoryCorpus>,
        admission: Admission,
        dir: tempfile::TempDir,
        together: ClusterHandles,
    ) -> Self {
        let pool = Pool::new(2, admission).expect("threads");
        let server = together.peers.as_ref().map(|peers| peers.own());
        let shared = Arc::<MemoryCorpus>::clone(&corpus) as Arc<_>;
        let work = Work::holding(share, server, pool, Arc::new(FakeEngine), shared);
        work.load();
        let stopping = CancellationToken::new();
        let app = App::new(
            Arc::clone(&work),
            Arc::new(Tokens::beside(dir.path())),
            Audit::beside(dir.path()),
            Arc::new(Uploads::beside(dir.path(), LIMIT).on(server)),
            together,
            Settings {
                upload_limit: LIMIT,
                allowed_hosts: Vec::new(),
                allowed_origins: vec!["https://tools.example".into()],
                rate_limit: 0,
            },
            stopping.clone(),
        );
        Self { router: router(app), work, corpus, stopping, dir }
    }

    /// A service with examples `a` to `d` at 1, 2, 3 and 4.
    async fn stocked() -> Self {
        Self::new().with_stock().await
    }

    async fn with_stock(self) -> Self {
        self.stock().await;
        self
    }

    async fn stock(&self) {
        for (name, number) in [("a", 1), ("b", 2), ("c", 3), ("d", 4)] {
            self.add(name, &format!("segment disc {number}")).await;
        }
    }

    async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.expect("infallible");
        let (parts, body) = response.into_parts();
        let bytes = body.collect().await.expect("a whole body").to_bytes().to_vec();
        Answer { status: parts.status, headers: parts.headers, bytes }
    }

    async fn request(&self, method: Method, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Answer {
        let mut request = Request::builder().method(method).uri(path);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.send(request.body(body.into()).expect("a request")).await
    }

    async fn get(&self, path: &str) -> Answer {
        self.request(Method::GET, path, &[], Body::empty()).await
    }

    async fn post(&self, path: &str, body: &str) -> Answer {
        self.request(Method::POST, path, &[], body.to_owned()).await
    }

    async fn post_json(&self, path: &str, body: Value) -> Answer {
        let kind = [(header::CONTENT_TYPE.as_str(), "application/json")];
        self.request(Method::POST, path, &kind, body.to_string()).await
    }

    /// Adds an example; its id.
    async fn add(&self, name: &str, mesh: &str) -> String {
        let answer = self.post(&format!("/v1/examples?name={name}"), mesh).await;
        assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
        answer.json()["id"].as_str().expect("an id").to_owned()
    }

    /// Starts a query; its path.
    async fn query(&self, options: &str, mesh: &str) -> String {
        let answer = self.post(&format!("/v1/queries?{options}"), mesh).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text());
        answer.header("location").to_owned()
    }

    /// A query that nobody ranks.
    fn idle_query(&self) -> Arc<LiveQuery> {
        let job = self.work.pool.admit(User(0), 0, None).expect("room");
        let model = self.work.engine.read(b"segment disc 1", None, &Cut::default(), job.stop()).expect("a model");
        let options = QueryOptions { top: 1, resolution: 32, deadline: None, tags: Vec::new(), like: None };
        let id = quadmuse_proto::QueryId::generate();
        let live = Arc::new(LiveQuery::new(id, Caller::default(), options, Arc::new(model), job, Instant::now()));
        self.work.queries.insert(Arc::clone(&live)).expect("room");
        live
    }

    /// Waits until a query has ended; the query then.
    async fn ended(&self, path: &str) -> Value {
        let begun = Instant::now();
        loop {
            let query = self.get(path).await.json();
            if matches!(query["state"].as_str(), Some("done" | "cancelled" | "failed")) {
                return query;
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "expected an end, found {query}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
}
