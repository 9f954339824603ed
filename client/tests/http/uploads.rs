//! Long files: sent piece by piece, taken up again where the connection broke, and whole to a server that knows no pieces.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::example,
    run,
};
use quadmuse_proto::{Code, UploadId};
use std::sync::{
    Arc, Mutex,
    atomic::{AtomicUsize, Ordering},
};

/// Longer than what is sent at once: pieces of 4 MiB, the last of a byte.
const LENGTH: usize = (16 << 20) + 1;

/// A file of `LENGTH` bytes, of which no two neighbouring pieces are alike.
fn long() -> (tempfile::TempDir, String, Vec<u8>) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("long.obj");
    let bytes: Vec<u8> = (0..LENGTH).map(|at| b'a' + ((at >> 20) % 26) as u8).collect();
    std::fs::write(&path, &bytes).expect("writes");
    let line = format!("add {}", path.display());
    (folder, line, bytes)
}

fn with_offset(status: u16, offset: usize) -> Reply {
    Reply { status, headers: vec![format!("Upload-Offset: {offset}")], body: Vec::new() }
}

/// Takes pieces, and breaks off the `nth` after half of it.
fn taking(id: UploadId, nth: usize, arrived: Arc<Mutex<Vec<u8>>>) -> impl Fn(&Asked) -> Reply {
    let pieces = AtomicUsize::new(0);
    move |asked| {
        let mut arrived = arrived.lock().expect("no panic");
        let method = asked.line.split(' ').next().unwrap_or_default();
        match method {
            "POST" if asked.line.ends_with("/v1/uploads") => {
                Reply { status: 201, headers: vec![format!("Location: /v1/uploads/{id}")], body: Vec::new() }
            }
            "POST" => Reply::json(201, &example(1)),
            "HEAD" => with_offset(200, arrived.len()),
            "PATCH" if asked.header("upload-offset") != Some(&*arrived.len().to_string()) => {
                Reply::problem(Code::Conflict, 409, "expected the bytes from elsewhere on")
            }
            "PATCH" if pieces.fetch_add(1, Ordering::SeqCst) == nth => {
                arrived.extend_from_slice(&asked.body[..asked.body.len() / 2]);
                Reply::none()
            }
            "PATCH" => {
                arrived.extend_from_slice(&asked.body);
                with_offset(204, arrived.len())
            }
            _ => Reply { status: 204, headers: Vec::new(), body: Vec::new() },
        }
    }
}

#[tokio::test]
async fn a_long_file_goes_on_from_what_has_arrived_and_is_freed() {
    let (_folder, line, bytes) = long();
    let (id, arrived) = (UploadId::generate(), Arc::default());
    let server = Fake::start(taking(id, 1, Arc::clone(&arrived)));
    let ran = run(&server.url, &line).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(*arrived.lock().expect("no panic") == bytes, "the file, each byte once");
    let asked = server.asked();
    let is = |asked: &Asked, method: &str| asked.line.starts_with(method);
    assert!(asked.iter().any(|asked| is(asked, "HEAD")), "it asked what had arrived");
    let begun = &asked[0];
    assert_eq!((begun.line.as_str(), begun.header("upload-length")), ("POST /v1/uploads", Some(&*LENGTH.to_string())));
    let added = asked.iter().find(|asked| asked.line.starts_with("POST /v1/examples")).expect("it was used");
    assert!(added.line.ends_with(&format!("upload={id}")) && added.body.is_empty(), "{}", added.line);
    assert_eq!(added.header("content-type"), Some("model/obj"));
    assert_eq!(asked.last().map(|asked| asked.line.clone()), Some(format!("DELETE /v1/uploads/{id}")));
    assert!(
        asked.iter().filter(|asked| asked.line.contains("uploads")).all(|a| a.header("tus-resumable") == Some("1.0.0"))
    );
}

#[tokio::test]
async fn an_upload_that_the_server_lost_is_begun_anew() {
    let (_folder, line, bytes) = long();
    let (id, arrived) = (UploadId::generate(), Arc::default());
    let (take, lost) = (taking(id, usize::MAX, Arc::clone(&arrived)), AtomicUsize::new(0));
    let server = Fake::start(move |asked| {
        if asked.line.starts_with("PATCH") && lost.fetch_add(1, Ordering::SeqCst) == 0 {
            return Reply::problem(Code::NotFound, 404, "expected an upload of yours, found none");
        }
        take(asked)
    });
    let ran = run(&server.url, &line).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(*arrived.lock().expect("no panic") == bytes, "the file, each byte once");
    assert_eq!(server.lines().iter().filter(|line| *line == "POST /v1/uploads").count(), 2);
}

#[tokio::test]
async fn an_older_server_gets_the_file_whole() {
    let (_folder, line, bytes) = long();
    let server = Fake::start(|asked| match asked.line.contains("uploads") {
        true => Reply::problem(Code::NotFound, 404, "expected the address of a resource"),
        false => Reply::json(201, &example(1)),
    });
    let ran = run(&server.url, &line).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let asked = server.asked();
    assert_eq!(asked.len(), 2);
    assert!(asked[1].body == bytes, "the file as it is");
}
