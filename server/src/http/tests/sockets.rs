//! Over a real socket: what only a connection shows.

use super::*;
use crate::connections::{ConnectionLimits, Connections};
use crate::shutdown::serve;
use std::net::SocketAddr;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;

async fn listening(bench: &Bench, connections: usize) -> (SocketAddr, JoinHandle<()>) {
    let limits = ConnectionLimits { all: connections, per_address: connections };
    listening_within(bench, limits).await
}

async fn listening_within(bench: &Bench, limits: ConnectionLimits) -> (SocketAddr, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let connections = Connections::new(limits);
    (address, tokio::spawn(serve(listener, bench.router.clone(), connections, bench.stopping.clone())))
}

async fn say(address: SocketAddr, text: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).await.expect("a connection");
    stream.write_all(text.as_bytes()).await.expect("sent");
    stream
}

async fn all(mut stream: TcpStream) -> String {
    let mut bytes = Vec::new();
    let read = tokio::time::timeout(Duration::from_secs(10), stream.read_to_end(&mut bytes)).await;
    read.expect("an end within 10 s").expect("a clean end");
    String::from_utf8_lossy(&bytes).into_owned()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn shutdown_ends_an_open_stream_with_a_last_event() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nslow 60000").await;
    let (address, serving) = listening(&bench, 10).await;
    let idle = say(address, "").await;
    let streaming = say(address, &format!("GET {path}/stream HTTP/1.1\r\nhost: localhost\r\n\r\n")).await;
    tokio::time::sleep(Duration::from_millis(100)).await;
    let begun = Instant::now();
    bench.stopping.cancel();
    let text = all(streaming).await;
    assert!(text.contains("event: begin\n") && text.contains("event: error\n"), "{text}");
    tokio::time::timeout(Duration::from_secs(9), serving).await.expect("in time").expect("no panic");
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    drop(idle);
    bench.request(Method::DELETE, &path, &[], Body::empty()).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_sends_too_much_still_sees_the_answer() {
    let bench = Bench::new();
    let (address, _serving) = listening(&bench, 10).await;
    let size = 20 * LIMIT as usize;
    let head =
        format!("POST /v1/examples HTTP/1.1\r\nhost: localhost\r\ncontent-length: {size}\r\nconnection: close\r\n\r\n");
    let mut stream = say(address, &head).await;
    stream.write_all(&vec![b' '; size]).await.expect("the service reads on");
    assert!(all(stream).await.starts_with("HTTP/1.1 413 "));
    let mut stream = say(
        address,
        "POST /v1/examples HTTP/1.1\r\nhost: localhost\r\ntransfer-encoding: chunked\r\nconnection: close\r\n\r\n",
    )
    .await;
    let chunk = format!("{LIMIT:x}\r\n{}\r\n", " ".repeat(LIMIT as usize));
    for _ in 0..20 {
        stream.write_all(chunk.as_bytes()).await.expect("the service reads on");
    }
    stream.write_all(b"0\r\n\r\n").await.expect("the service reads on");
    let answer = all(stream).await;
    assert!(answer.starts_with("HTTP/1.1 413 ") && answer.contains("body_too_large"), "{answer}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_hangs_up_frees_the_cores() {
    let bench = Bench::stocked().await;
    let (address, _serving) = listening(&bench, 10).await;
    let mesh = "segment disc 1\nencode-slow 60000";
    let upload =
        format!("POST /v1/examples HTTP/1.1\r\nhost: localhost\r\ncontent-length: {}\r\n\r\n{mesh}", mesh.len());
    let clients = [say(address, &upload).await, say(address, &upload).await];
    tokio::time::sleep(Duration::from_millis(100)).await;
    let begun = Instant::now();
    drop(clients);
    // Both threads were busy; they are free as soon as this is answered.
    bench.add("next", "segment disc 5").await;
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_head_that_does_not_come_is_not_waited_for() {
    let bench = Bench::new();
    let (address, _serving) = listening(&bench, 1).await;
    let begun = Instant::now();
    let mut slow = say(address, "GET /healthz HTTP/1.1\r\nhost:").await;
    let mut rest = Vec::new();
    let ended = tokio::time::timeout(Duration::from_secs(15), slow.read_to_end(&mut rest)).await;
    assert!(ended.is_ok() && begun.elapsed() >= Duration::from_secs(9), "{:?}", begun.elapsed());
    // The one place is free again.
    let next = say(address, "GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").await;
    assert!(all(next).await.starts_with("HTTP/1.1 200 "));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn broken_requests_are_answered_or_dropped_and_the_next_one_is_served() {
    let bench = Bench::stocked().await;
    let (address, _serving) = listening(&bench, 10).await;
    let post = "POST /v1/examples HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n";
    let many: String = (0..500).map(|n| format!("x-{n}: a\r\n")).collect();
    let cases = [
        // A body that ends before its length, or whose chunks are none.
        (format!("{post}content-length: 1000\r\n\r\nabc"), "400", "body_invalid"),
        (format!("{post}transfer-encoding: chunked\r\n\r\nZZ\r\nabc\r\n0\r\n\r\n"), "400", "body_invalid"),
        (format!("{post}content-length: 99999999999\r\n\r\nabc"), "413", "body_too_large"),
        (format!("{post}content-length: 0\r\n\r\n"), "422", "mesh_empty"),
        (format!("{post}content-length: abc\r\n\r\n"), "400", ""),
        (format!("{post}{many}content-length: 0\r\n\r\n"), "431", ""),
        (format!("GET /{} HTTP/1.1\r\nhost: localhost\r\n\r\n", "a".repeat(100_000)), "414", ""),
        ("GET /v1/examples/%ff%fe HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n".into(), "404", "not_found"),
        (
            "BREW /v1/examples HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n".into(),
            "405",
            "method_not_allowed",
        ),
        ("\u{16}\u{3}\u{1}\u{2} no http at all\r\n\r\n".into(), "400", ""),
    ];
    for (request, status, code) in cases {
        let mut stream = say(address, &request).await;
        if request.ends_with("abc") {
            // What is still to come doesn't.
            stream.shutdown().await.expect("half closed");
        }
        let answer = all(stream).await;
        let beginning: String = request.chars().take(60).collect();
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{beginning:?}: {answer}");
        assert!(answer.contains(code), "{beginning:?}: {answer}");
        assert_eq!(bench.get("/healthz").await.status, StatusCode::OK);
    }
}

const HEALTH: &str = "GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n";
const LIST: &str = "GET /v1/examples HTTP/1.1\r\nhost: localhost\r\n\r\n";

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_that_never_send_or_read_do_not_keep_an_operator_out() {
    let bench = Bench::stocked().await;
    let (address, _serving) = listening(&bench, 8).await;
    let mut idle = Vec::new();
    for _ in 0..200 {
        idle.push(say(address, "").await);
    }
    // Among them are those of the reserve, and more than it has places.
    for _ in 0..5 {
        assert!(all(say(address, HEALTH).await).await.starts_with("HTTP/1.1 200 "));
    }
    let refused = all(say(address, LIST).await).await;
    assert!(refused.starts_with("HTTP/1.1 503 ") && refused.contains("retry-after"), "{refused}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_address_has_its_share_of_the_connections() {
    let bench = Bench::stocked().await;
    let (address, _serving) = listening_within(&bench, ConnectionLimits { all: 8, per_address: 2 }).await;
    let idle = [say(address, "").await, say(address, "").await];
    tokio::time::sleep(Duration::from_millis(50)).await;
    let refused = all(say(address, LIST).await).await;
    assert!(refused.starts_with("HTTP/1.1 429 ") && refused.contains("of this address"), "{refused}");
    drop(idle);
    tokio::time::sleep(Duration::from_millis(50)).await;
    let served = all(say(address, &LIST.replace("\r\n\r\n", "\r\nconnection: close\r\n\r\n")).await).await;
    assert!(served.starts_with("HTTP/1.1 200 "), "{served}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_that_takes_nothing_of_its_answers_is_dropped() {
    let bench = Bench::stocked().await;
    let (address, _serving) = listening(&bench, 1).await;
    // More answers than the sockets hold, and none is read.
    let greedy = TcpStream::connect(address).await.expect("a connection");
    let (reading, mut writing) = greedy.into_split();
    let asking = tokio::spawn(async move {
        let many = LIST.repeat(100);
        while writing.write_all(many.as_bytes()).await.is_ok() {}
    });
    let begun = Instant::now();
    let ended = tokio::time::timeout(Duration::from_secs(60), asking).await;
    assert!(ended.is_ok(), "still connected after {:?}", begun.elapsed());
    drop(reading);
    let next = all(say(address, &LIST.replace("\r\n\r\n", "\r\nconnection: close\r\n\r\n")).await).await;
    assert!(next.starts_with("HTTP/1.1 200 "), "{next}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_body_that_comes_by_drops_is_given_up_and_its_memory_with_it() {
    let bench = Bench::stocked().await;
    let (address, _serving) = listening(&bench, 4).await;
    let before = bench.work.pool.admission().used();
    let head = "POST /v1/examples HTTP/1.1\r\nhost: localhost\r\ncontent-length: 60000\r\nconnection: close\r\n\r\n";
    let stream = say(address, head).await;
    let (mut reading, mut writing) = stream.into_split();
    let dripping = tokio::spawn(async move {
        while writing.write_all(b"x").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    let mut answer = Vec::new();
    let read = tokio::time::timeout(Duration::from_secs(60), reading.read_to_end(&mut answer)).await;
    assert!(read.is_ok(), "expected an answer within a minute");
    let answer = String::from_utf8_lossy(&answer);
    assert!(answer.starts_with("HTTP/1.1 408 "), "{answer}");
    dripping.abort();
    assert_eq!(bench.work.pool.admission().used(), before);
}
