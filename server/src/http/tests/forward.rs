//! Several servers on loopback: each answers for what lives on another.

use super::*;
use crate::connections::{ConnectionLimits, Connections};
use crate::peers::Peers;
use crate::peers::tests::InMemory;
use crate::shutdown::serve;
use hyper_util::rt::TokioIo;
use quadmuse_proto::QueryId;
use std::net::SocketAddr;
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::Runtime;

/// What the servers share: their list, and what queries were started with.
pub(super) struct Shared {
    documents: Arc<InMemory>,
    uploads: tempfile::TempDir,
}

/// One of them.
pub(super) struct Server {
    pub(super) bench: Bench,
    pub(super) address: SocketAddr,
    /// What serves, so that it can end at once with all its connections, as a process that is killed.
    runtime: Option<Runtime>,
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

impl Shared {
    pub(super) fn new() -> Self {
        Self { documents: Arc::default(), uploads: tempfile::tempdir().expect("a directory") }
    }

    pub(super) fn join(&self, address: &str, share: Option<Share>) -> Arc<Peers> {
        Arc::new(Peers::join_with(Arc::clone(&self.documents) as Arc<_>, address, share).expect("joined"))
    }

    pub(super) async fn server(&self) -> Server {
        let server = self.holding(None, Arc::default()).await;
        server.bench.stock().await;
        server
    }

    /// A server with a share of a corpus.
    pub(super) async fn holding(&self, share: Option<Share>, corpus: Arc<MemoryCorpus>) -> Server {
        let dir = tempfile::tempdir().expect("a directory");
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("threads");
        let binding = runtime.spawn(TcpListener::bind("127.0.0.1:0"));
        let listener = binding.await.expect("no panic").expect("a port");
        let address = listener.local_addr().expect("an address");
        let kept = KeptQueries::on(Arc::new(Files::beside(self.uploads.path())));
        let peers = Some(self.join(&format!("http://{address}"), share));
        let together = ClusterHandles { kept, peers, signs: Arc::default() };
        let bench = Bench::holding(share, corpus, Admission::new(64 << 20, 32), dir, together);
        let connections = Connections::new(ConnectionLimits { all: 100, per_address: 100 });
        runtime.spawn(serve(listener, bench.router.clone(), connections, bench.stopping.clone()));
        Server { bench, address, runtime: Some(runtime) }
    }

    /// Waits until something is kept of a query.
    pub(super) async fn until_kept(&self, path: &str, what: KeptKind) {
        use crate::work::kept::UploadStore;
        let id = id_of(path);
        let begun = Instant::now();
        while Files::beside(self.uploads.path()).get(id, what).expect("answered").is_none() {
            assert!(begun.elapsed() < Duration::from_secs(20), "{path} is not kept");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
}

fn id_of(path: &str) -> QueryId {
    path.rsplit('/').next().and_then(|id| id.parse().ok()).expect("an id")
}

impl Server {
    /// Sends a request over a connection from an address of the loopback.
    async fn ask_from(
        &self,
        from: [u8; 4],
        line: (Method, &str),
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Answer {
        let socket = TcpSocket::new_v4().expect("a socket");
        socket.bind(SocketAddr::from((from, 0))).expect("an address of the loopback");
        let stream = socket.connect(self.address).await.expect("a connection");
        let (mut sender, connection) =
            hyper::client::conn::http1::handshake(TokioIo::new(stream)).await.expect("a connection");
        tokio::spawn(connection);
        let mut request = Request::builder().method(line.0).uri(line.1).header("host", "localhost");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let asked = sender.send_request(request.body(body.into()).expect("a request"));
        let response = tokio::time::timeout(Duration::from_secs(30), asked).await.expect("in time").expect("answered");
        let (parts, body) = response.into_parts();
        let bytes = body.collect().await.expect("a whole body").to_bytes().to_vec();
        Answer { status: parts.status, headers: parts.headers, bytes }
    }

    pub(super) async fn ask(
        &self,
        method: Method,
        path: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Answer {
        self.ask_from([127, 0, 0, 1], (method, path), headers, body).await
    }

    pub(super) async fn get(&self, path: &str) -> Answer {
        self.ask(Method::GET, path, &[], Body::empty()).await
    }

    /// What comes of an answer that breaks off.
    async fn broken(&self, path: &str) -> String {
        let stream = tokio::net::TcpStream::connect(self.address).await.expect("a connection");
        let (mut sender, connection) =
            hyper::client::conn::http1::handshake::<_, Body>(TokioIo::new(stream)).await.expect("a connection");
        tokio::spawn(connection);
        let request = Request::get(path).header("host", "localhost").body(Body::empty()).expect("a request");
        let mut body = sender.send_request(request).await.expect("answered").into_body();
        let mut text = String::new();
        loop {
            match tokio::time::timeout(Duration::from_secs(20), body.frame()).await.expect("in time") {
                Some(Ok(frame)) => text.push_str(&String::from_utf8_lossy(&frame.into_data().unwrap_or_default())),
                Some(Err(_)) => return text,
                None => panic!("it ended: {text}"),
            }
        }
    }

    /// Starts a query; its path.
    pub(super) async fn query(&self, mesh: &str) -> String {
        let answer = self.ask(Method::POST, "/v1/queries", &[], mesh.to_owned()).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text());
        answer.header("location").to_owned()
    }

    /// Ends as a process would that is killed: nobody is told.
    pub(super) async fn die(self) {
        let address = self.address;
        drop(self);
        let begun = Instant::now();
        while tokio::net::TcpStream::connect(address).await.is_ok() {
            assert!(begun.elapsed() < Duration::from_secs(20), "it still listens");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    fn audit(&self) -> String {
        std::fs::read_to_string(self.bench.dir.path().join(crate::audit::FILE)).unwrap_or_default()
    }
}

/// An answer without what differs between any two.
fn essence(answer: &Answer) -> (u16, Vec<(String, String)>, String) {
    let named = |(name, value): (&axum::http::HeaderName, &axum::http::HeaderValue)| {
        (name.to_string(), value.to_str().unwrap_or_default().to_owned())
    };
    let is_same = |(name, _): &(String, String)| !["date", "x-request-id"].contains(&name.as_str());
    let mut headers: Vec<_> = answer.headers.iter().map(named).filter(is_same).collect();
    headers.sort();
    (answer.status.as_u16(), headers, answer.text())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_one_server_has_another_answers_byte_for_byte() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query("segment disc 1").await;
    a.bench.ended(&query).await;
    // All that is made of it goes through the other.
    let kind = [("content-type", "application/json")];
    let wanted = a.get(&format!("{query}/ranking")).await.json()["entries"][0]["example"].clone();
    let body = serde_json::json!({"segment": 0, "example": wanted}).to_string();
    let map = b.ask(Method::POST, &format!("{query}/maps?wait=30"), &kind, body).await;
    assert_eq!(map.status, StatusCode::CREATED, "{}", map.text());
    let map = map.header("location").to_owned();
    let composed = b.ask(Method::POST, &format!("{query}/compositions?wait=30"), &kind, "{}").await;
    assert_eq!(composed.status, StatusCode::CREATED, "{}", composed.text());
    let composition = composed.header("location").to_owned();
    let ndjson = [("accept", "application/x-ndjson")];
    for path in [
        query.clone(),
        format!("{query}/ranking"),
        format!("{query}/ranking?segment=9"),
        format!("{query}/mesh?format=ply"),
        format!("{query}/stream"),
        format!("{query}/no-such-thing"),
        map.clone(),
        format!("{map}/mesh"),
        format!("{map}/preview.png?size=64"),
        format!("{map}/stream"),
        format!("{query}/maps"),
        format!("{composition}/mesh"),
        format!("{query}/ranking?misspelt=1"),
    ] {
        for headers in [&[][..], &ndjson] {
            let [here, there] = [
                a.ask(Method::GET, &path, &with_id(headers), Body::empty()).await,
                b.ask(Method::GET, &path, &with_id(headers), Body::empty()).await,
            ];
            assert_eq!(essence(&here), essence(&there), "{path}");
        }
    }
    let mesh = b.get(&format!("{map}/mesh")).await;
    let again = b.ask(Method::GET, &format!("{map}/mesh"), &[("if-none-match", mesh.header("etag"))], "").await;
    assert_eq!(again.status, StatusCode::NOT_MODIFIED);

    let listed = |answer: &Answer| answer.json()["items"].as_array().map_or(0, Vec::len);
    let other = b.query("segment disc 2").await;
    assert_eq!((listed(&a.get("/v1/queries").await), listed(&b.get("/v1/queries").await)), (2, 2));
    let page = a.get("/v1/queries?limit=1").await.json();
    assert_eq!(page["items"][0]["id"], id_of(&query).to_string());
    let next = format!("/v1/queries?limit=1&cursor={}", page["next"].as_str().expect("more"));
    assert_eq!(a.get(&next).await.json()["items"][0]["id"], id_of(&other).to_string());

    // So long a list that it travels packed: between servers it does not.
    for seed in 0..12 {
        b.query(&format!("segment disc {seed}7")).await;
    }
    let packed = a.ask(Method::GET, "/v1/queries", &[("accept-encoding", "gzip")], "").await;
    assert_eq!(packed.header("content-encoding"), "gzip");
    let unpacked: Value = serde_json::from_reader(flate2::read::GzDecoder::new(&packed.bytes[..])).expect("JSON");
    assert_eq!(unpacked["items"].as_array().map(Vec::len), Some(14));

    let gone = b.ask(Method::DELETE, &query, &[], "").await;
    assert_eq!(gone.status, StatusCode::NO_CONTENT);
    for server in [&a, &b] {
        server.get(&query).await.problem(404, "not_found");
    }
}

/// With the same id, so that problems are the same.
fn with_id<'a>(headers: &[(&'a str, &'a str)]) -> Vec<(&'a str, &'a str)> {
    headers.iter().copied().chain([("x-request-id", "one")]).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_comes_as_it_is_written_and_breaks_off_with_its_server() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query("segment disc 1\nslow 60000").await;
    let stream = tokio::net::TcpStream::connect(b.address).await.expect("a connection");
    let (mut sender, connection) =
        hyper::client::conn::http1::handshake::<_, Body>(TokioIo::new(stream)).await.expect("a connection");
    let connection = tokio::spawn(connection);
    let request = Request::get(format!("{query}/stream")).header("host", "localhost").body(Body::empty());
    let mut answer = sender.send_request(request.expect("a request")).await.expect("answered");
    // The query goes on for a minute: the first event is there all the same.
    let first = tokio::time::timeout(Duration::from_secs(10), answer.body_mut().frame()).await.expect("in time");
    let first = first.expect("an event").expect("read").into_data().expect("bytes");
    assert!(String::from_utf8_lossy(&first).contains("event: begin"), "{first:?}");
    // The owner dies: the stream breaks off, and who asks again is told.
    a.die().await;
    let rest = tokio::time::timeout(Duration::from_secs(20), answer.into_body().collect()).await.expect("in time");
    assert!(rest.is_err(), "{rest:?}");
    connection.abort();
    let gone = b.get(&format!("{query}/stream")).await;
    gone.problem(503, "owner_gone");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_hangs_up_on_one_server_cancels_on_the_other() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query("segment disc 1\nslow 60000").await;
    let example = a.get("/v1/examples").await.json()["items"][0]["id"].clone();
    let body = serde_json::json!({"segment": 0, "example": example}).to_string();
    let path = format!("{query}/maps?wait=120");
    // The first that is being made of the query, once there is one.
    let until = async |holds: fn(Option<&str>) -> bool| {
        let begun = Instant::now();
        loop {
            let now = a.get(&query).await.json();
            if holds(now["making"][0]["state"].as_str()) {
                return;
            }
            assert!(begun.elapsed() < Duration::from_secs(20), "{now}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::select! {
        early = b.ask(Method::POST, &path, &[("content-type", "application/json")], body) => panic!("{}", early.text()),
        () = until(|state| state.is_some()) => {}
    }
    until(|state| state.is_none_or(|state| state == "cancelled")).await;
    a.ask(Method::DELETE, &query, &[], "").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_stops_lets_go_of_what_others_answer() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query("segment disc 1\nslow 60000").await;
    let stream = format!("{query}/stream");
    let poll = format!("{query}/ranking?after=99&wait_ms=60000");
    let stop = async {
        tokio::time::sleep(Duration::from_millis(200)).await;
        b.bench.stopping.cancel();
    };
    let begun = Instant::now();
    let (polled, streamed, ()) = tokio::join!(b.get(&poll), b.broken(&stream), stop);
    polled.problem(503, "unavailable");
    assert!(streamed.contains("event: begin"), "{streamed}");
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    a.ask(Method::DELETE, &query, &[], "").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_asks_for_what_a_dead_server_had_is_told_and_starts_it_again() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query("segment disc 3").await;
    shared.until_kept(&query, KeptKind::Upload).await;
    let before = a.bench.ended(&query).await;
    a.die().await;
    let begun = Instant::now();
    for path in [query.clone(), format!("{query}/ranking?after=0&wait_ms=10000"), format!("{query}/maps")] {
        let answer = b.get(&path).await;
        let detail = answer.problem(503, "owner_gone");
        assert!(detail.contains(&format!("POST {query}/restart")), "{detail}");
        assert!(answer.header("retry-after").parse::<u64>().is_ok());
    }
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
    let again = b.ask(Method::POST, &format!("{query}/restart"), &[("idempotency-key", "k")], "").await;
    assert_eq!(again.status, StatusCode::ACCEPTED, "{}", again.text());
    let new = again.header("location").to_owned();
    assert_ne!(new, query);
    let twice = b.ask(Method::POST, &format!("{query}/restart"), &[("idempotency-key", "k")], "").await;
    assert_eq!(twice.header("location"), new);
    let after = b.bench.ended(&new).await;
    assert_eq!((&after["segments"], &after["resolution"]), (&before["segments"], &before["resolution"]));
    // A list leaves out what is gone.
    assert_eq!(b.get("/v1/queries").await.json()["items"].as_array().map(Vec::len), Some(1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_is_silent_is_gone_too() {
    let shared = Shared::new();
    let b = shared.server().await;
    // It takes connections, as the system does for a process that is stopped, and never answers.
    let silent = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let peers = shared.join(&format!("http://{}", silent.local_addr().expect("an address")), None);
    let id = QueryId::generate().on(peers.own());
    b.get(&format!("/v1/queries/{id}/ranking?after=1&wait_ms=10000")).await.problem(503, "owner_gone");
    // One that said that it ends is not asked.
    peers.leave().expect("left");
    b.get(&format!("/v1/queries/{id}")).await.problem(503, "owner_gone");
    let nobody = quadmuse_proto::id::ServerNumber::new(4711).expect("not 0");
    b.get(&format!("/v1/queries/{}", QueryId::generate().on(nobody))).await.problem(404, "not_found");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_request_makes_one_hop_and_strangers_are_not_believed() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query("segment disc 1").await;
    // The owner keeps the books of what is passed on to it, under the client's address.
    let removed = b.ask_from([127, 0, 0, 9], (Method::DELETE, &query), &[], "").await;
    assert_eq!(removed.status, StatusCode::NO_CONTENT);
    let forged = format!("{} 127.0.0.77 {}", id_of(&query).server().expect("a server"), "0".repeat(64));
    let query = a.query("segment disc 1").await;
    let headers = [("quadmuse-passed", forged.as_str())];
    assert_eq!(b.ask(Method::GET, &query, &headers, "").await.status, StatusCode::OK);
    assert_eq!(a.ask(Method::DELETE, &query, &headers, "").await.status, StatusCode::NO_CONTENT);
    let begun = Instant::now();
    while a.audit().matches("DELETE").count() < 2 {
        assert!(begun.elapsed() < Duration::from_secs(20), "{}", a.audit());
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let (here, there) = (a.audit(), b.audit());
    assert!(here.contains("127.0.0.9") && !here.contains("127.0.0.77"), "{here}");
    assert!(!there.contains("DELETE"), "{there}");

    // Another took the place of `b` in the list: what is meant for it comes to `b`, and goes no further.
    let usurper = shared.join(&format!("http://{}", b.address), None);
    let id = QueryId::generate().on(usurper.own());
    a.get(&format!("/v1/queries/{id}")).await.problem(503, "owner_gone");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_upload_in_pieces_goes_on_through_any_server() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let mesh = "segment disc 2";
    let tus = ("tus-resumable", "1.0.0");
    let length = mesh.len().to_string();
    let begun = a.ask(Method::POST, "/v1/uploads", &[tus, ("upload-length", &length)], "").await;
    assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.text());
    let upload = begun.header("location").to_owned();
    let piece =
        |offset: &'static str| [tus, ("upload-offset", offset), ("content-type", "application/offset+octet-stream")];
    let sent = b.ask(Method::PATCH, &upload, &piece("0"), &mesh[..5]).await;
    assert_eq!((sent.status, sent.header("upload-offset")), (StatusCode::NO_CONTENT, "5"), "{}", sent.text());
    assert_eq!(b.ask(Method::HEAD, &upload, &[tus], "").await.header("upload-offset"), "5");
    let sent = b.ask(Method::PATCH, &upload, &piece("5"), &mesh[5..]).await;
    assert_eq!(sent.status, StatusCode::NO_CONTENT, "{}", sent.text());
    // The query is made where the upload lies.
    let id = upload.rsplit('/').next().expect("an id");
    let query = b.ask(Method::POST, &format!("/v1/queries?upload={id}"), &[], "").await;
    assert_eq!(query.status, StatusCode::ACCEPTED, "{}", query.text());
    let owner = id_of(query.header("location")).server();
    assert_eq!(owner, id.parse::<quadmuse_proto::UploadId>().expect("an id").server());
    a.die().await;
    assert_eq!(b.ask(Method::HEAD, &upload, &[tus], "").await.status, StatusCode::SERVICE_UNAVAILABLE);
    b.ask(Method::POST, &format!("/v1/queries?upload={id}"), &[], "").await.problem(503, "owner_gone");
}

#[tokio::test]
async fn a_single_server_starts_a_query_again_and_only_for_whom_it_was() {
    let closed = super::access::Closed::new().await;
    let (ann, bob) = (format!("Bearer {}", closed.ann), format!("Bearer {}", closed.bob));
    let bench = &closed.bench;
    let posted = bench.request(Method::POST, "/v1/queries?top=2", &[("authorization", &ann)], "segment disc 1").await;
    let query = posted.header("location").to_owned();
    let restart = async |token: &str, path: &str| {
        bench.request(Method::POST, &format!("{path}/restart"), &[("authorization", token)], "").await
    };
    // What was sent is put away behind the answer's back, and waited for here.
    let again = restart(&ann, &query).await;
    assert_eq!(again.status, StatusCode::ACCEPTED, "{}", again.text());
    assert_ne!(again.header("location"), query);
    let absent = format!("/v1/queries/{}", QueryId::generate());
    let foreign = restart(&bob, &query).await;
    let none = restart(&bob, &absent).await;
    let shape = super::access::shape;
    let id = |path: &str| id_of(path).to_string();
    assert_eq!(shape(&foreign, &id(&query)), shape(&none, &id(&absent)));
    none.problem(404, "not_found");
    // What its owner removed is gone for good.
    let removed = bench.request(Method::DELETE, &query, &[("authorization", &ann)], "").await;
    assert_eq!(removed.status, StatusCode::NO_CONTENT);
    let begun = Instant::now();
    while restart(&ann, &query).await.status != StatusCode::NOT_FOUND {
        assert!(begun.elapsed() < Duration::from_secs(20), "still kept");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}
