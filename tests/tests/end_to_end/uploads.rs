//! Uploads that go on: over connections that break, and over an end of the server.

use crate::{Place, run, values};
use quadmuse_tests::{
    client::Client,
    http::{self, Answer},
    server::Server,
};
use std::{
    io::{Read, Write},
    net::{Shutdown, SocketAddr, TcpListener, TcpStream},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

/// A mesh that is longer than what the client sends at once.
const LONG: usize = 18 << 20;

const TUS: (&str, &str) = ("tus-resumable", "1.0.0");

fn mesh(bytes: usize) -> Vec<u8> {
    let mut text = b"v 0 0 0\nv 1 0 0\nv 2 0 .1\nv 0 1 0\nv 1 1 .2\nv 2 1 0\nf 1 2 5 4\nf 2 3 6 5\n".to_vec();
    let mut line = 0;
    while text.len() < bytes {
        // No two alike: a piece in another's place would be noticed.
        text.extend_from_slice(format!("# line {line} makes the file longer and is read by nobody\n").as_bytes());
        line += 1;
    }
    text
}

/// Passes connections on to `to`; the first `breaks` that send more than `bytes` are broken there.
fn breaking(to: SocketAddr, bytes: usize, breaks: usize) -> (String, Arc<AtomicUsize>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("an address");
    let broken = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&broken);
    std::thread::spawn(move || {
        for client in listener.incoming().flatten() {
            let Ok(server) = TcpStream::connect(to) else { continue };
            let (mut from, mut back) = (server.try_clone().expect("a handle"), client.try_clone().expect("a handle"));
            std::thread::spawn(move || std::io::copy(&mut from, &mut back).map(|_| back.shutdown(Shutdown::Both)));
            let counter = Arc::clone(&counter);
            std::thread::spawn(move || pass(client, server, bytes, breaks, &counter));
        }
    });
    (format!("http://{address}"), broken)
}

fn pass(mut client: TcpStream, mut server: TcpStream, bytes: usize, breaks: usize, broken: &AtomicUsize) {
    let (mut passed, mut piece) = (0, vec![0; 64 << 10]);
    while let Ok(read) = client.read(&mut piece) {
        passed += read;
        if passed > bytes && broken.fetch_add(1, Ordering::SeqCst) < breaks {
            break;
        }
        // From now on nothing is broken: the count only grows.
        if read == 0 || server.write_all(&piece[..read]).is_err() {
            break;
        }
    }
    let _ = (client.shutdown(Shutdown::Both), server.shutdown(Shutdown::Both));
}

fn waiting(place: &Place) -> usize {
    std::fs::read_dir(place.data().join("uploads")).map_or(0, Iterator::count)
}

#[test]
fn a_long_file_arrives_whole_however_often_the_connection_breaks() {
    let place = Place::new();
    let (server, _) = place.serve();
    let bytes = mesh(LONG);
    let path = place.path("long.obj");
    std::fs::write(&path, &bytes).expect("writes");
    let (url, broken) = breaking(server.address(), 3 << 20, 4);
    let client = Client::new(url);
    let added = values(&client, &["add"], &[&path]).remove(0);
    assert!(broken.load(Ordering::SeqCst) >= 4, "the connection broke");
    assert!(added.to_string().contains(&format!("\"bytes\":{}", bytes.len())), "{added}");
    let listed = http::get(server.address(), "/v1/examples").expect("a list").text();
    let list: serde_json::Value = serde_json::from_str(&listed).expect("JSON");
    let id = list["items"][0]["id"].as_str().expect("an id");
    let kept = http::get(server.address(), &format!("/v1/examples/{id}/mesh")).expect("a mesh");
    assert!(kept.body == bytes, "expected the bytes that were sent, found {} others", kept.body.len());
    assert_eq!(waiting(&place), 0, "what was used is freed");
    // What is refused is freed, too.
    std::fs::write(&path, vec![b'x'; LONG]).expect("writes");
    let refused = run(&client, &["add"], &[&path]);
    assert_eq!((refused.code, waiting(&place)), (Some(1), 0), "{}", refused.notes);
    assert!(refused.notes.contains("expected a surface"), "{}", refused.notes);
}

fn ask(server: &Server, line: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
    let length = body.len().to_string();
    let all: Vec<_> = headers.iter().copied().chain([TUS, ("content-length", &*length)]).collect();
    http::ask(server.address(), line, &all, body).expect("an answer")
}

fn piece(server: &Server, at: &str, offset: usize, body: &[u8]) -> Answer {
    let offset = offset.to_string();
    let headers = [("upload-offset", &*offset), ("content-type", "application/offset+octet-stream")];
    ask(server, &format!("PATCH {at}"), &headers, body)
}

#[test]
fn an_upload_goes_on_after_the_server_was_killed() {
    let place = Place::new();
    let (server, _) = place.serve();
    let bytes = mesh(1 << 20);
    let length = bytes.len().to_string();
    let at = ask(&server, "POST /v1/uploads", &[("upload-length", &length)], &[]);
    let at = at.header("location").expect("an address").to_owned();
    let half = bytes.len() / 2;
    assert_eq!(piece(&server, &at, 0, &bytes[..half]).status, 204);
    server.kill().expect("it is killed");
    let (server, _) = place.serve();
    let standing = ask(&server, &format!("HEAD {at}"), &[], &[]);
    assert_eq!((standing.status, standing.header("upload-offset")), (200, Some(&*half.to_string())));
    assert_eq!(piece(&server, &at, half, &bytes[half..]).status, 204);
    let id = at.rsplit('/').next().expect("an id");
    let added = ask(&server, &format!("POST /v1/examples?upload={id}"), &[("content-type", "model/obj")], &[]);
    assert_eq!(added.status, 201, "{}", added.text());
    assert_eq!(ask(&server, &format!("DELETE {at}"), &[], &[]).status, 204);
    assert_eq!(waiting(&place), 0);
}
