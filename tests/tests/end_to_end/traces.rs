//! Traces: sent to a collector that is there, and no trouble without one.

use crate::Place;
use quadmuse_tests::{http, server::Server};
use std::{
    io::{BufRead, BufReader, Read, Write},
    net::{SocketAddr, TcpListener},
    sync::{Arc, Mutex},
    time::Duration,
};

/// How long a server may take to end.
const END_TIME_MAX: Duration = Duration::from_secs(30);

/// A collector that keeps what it is sent: first lines and bodies.
fn collector() -> (SocketAddr, Arc<Mutex<Vec<(String, Vec<u8>)>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let (address, kept) = (listener.local_addr().expect("an address"), Arc::<Mutex<Vec<_>>>::default());
    let all = Arc::clone(&kept);
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let mut reader = BufReader::new(stream.try_clone().expect("a handle"));
            let (mut first, mut length) = (String::new(), 0);
            loop {
                let mut line = String::new();
                if reader.read_line(&mut line).is_err() || line.trim().is_empty() {
                    break;
                }
                if let Some(value) = line.to_ascii_lowercase().strip_prefix("content-length:") {
                    length = value.trim().parse().expect("a number");
                }
                if first.is_empty() {
                    first = line.trim().to_owned();
                }
            }
            let mut body = vec![0; length];
            if reader.read_exact(&mut body).is_ok() {
                all.lock().expect("no panic").push((first, body));
                let _ = stream
                    .write_all(b"HTTP/1.1 200 OK\r\ncontent-type: application/x-protobuf\r\ncontent-length: 0\r\n\r\n");
            }
        }
    });
    (address, kept)
}

fn holds(bytes: &[u8], text: &str) -> bool {
    bytes.windows(text.len()).any(|window| window == text.as_bytes())
}

#[test]
fn a_collector_gets_the_spans_of_requests_by_their_routes() {
    let place = Place::new();
    let (address, kept) = collector();
    let named = format!("QUADMUSE_OTLP=http://{address}");
    let mut server = Server::start_under(&["env", &named], &place.data()).expect("a server");
    let mesh = b"v 0 0 0\nv 1 0 0\nv 2 0 .1\nv 0 1 0\nv 1 1 .2\nv 2 1 0\nf 1 2 5 4\nf 2 3 6 5\n";
    let added = http::post(server.address(), "/v1/examples?name=secret", "model/obj", mesh).expect("an answer");
    assert_eq!(added.status, 201, "{}", added.text());
    let absent = "/v1/examples/01ARZ3NDEKTSV4RRFFQ69G5FAV";
    let id = ("x-request-id", "asked-by-the-test");
    assert_eq!(http::ask(server.address(), &format!("GET {absent}"), &[id], &[]).expect("an answer").status, 404);
    let ended = server.terminate(END_TIME_MAX).expect("it is told");
    assert!(ended.is_some_and(|status| status.success()), "{ended:?}");
    let sent = kept.lock().expect("no panic");
    assert!(sent.iter().all(|(line, _)| line == "POST /v1/traces HTTP/1.1"), "it speaks to the collector");
    let sends = |text: &str| sent.iter().any(|(_, body)| holds(body, text));
    for text in
        ["quadmuse-server", "GET /v1/examples/{id}", "POST /v1/examples", "asked-by-the-test", "compute", "ingest"]
    {
        assert!(sends(text), "expected `{text}` in what the collector got");
    }
    assert!(!sends("01ARZ3NDEKTSV4RRFFQ69G5FAV") && !sends("secret"), "addresses and parameters are nobody's business");
    assert!(!server.log().contains("quadmuse_trace"), "the log is what it is without traces");
}

#[test]
fn a_collector_that_is_away_is_told_of_once_and_holds_up_nothing() {
    let place = Place::new();
    // A port that nobody listens on.
    let address = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port");
    let named = format!("QUADMUSE_OTLP=http://{address}");
    // Batches go out quickly, so that there are several.
    let words = ["env", &named, "OTEL_BSP_SCHEDULE_DELAY=20"];
    let mut server = Server::start_under(&words, &place.data()).expect("a server");
    for _ in 0..20 {
        assert_eq!(http::get(server.address(), "/healthz").expect("an answer").status, 200);
        std::thread::sleep(Duration::from_millis(20));
    }
    let ended = server.terminate(END_TIME_MAX).expect("it is told");
    assert!(ended.is_some_and(|status| status.success()), "{ended:?}");
    assert_eq!(server.log().matches("the collector takes no traces").count(), 1, "{}", server.log());
}

#[test]
fn an_address_that_is_none_is_refused_at_once() {
    let place = Place::new();
    let refused = Server::start_under(&["env", "QUADMUSE_OTLP=collector:4318"], &place.data()).err();
    let said = refused.expect("it does not start").to_string();
    assert!(said.contains("expected the address of a collector like"), "{said}");
}
