//! Ctrl-C, in a process of its own.

use super::{
    fake::{Fake, Reply},
    messages::{map_id, query_id},
    queries::service,
};
use quadmuse_proto::{Making, MakingState, Product};
use std::{
    process::Command,
    thread,
    time::{Duration, Instant},
};

#[test]
fn an_interrupted_wait_cancels_what_the_service_makes() {
    let making = Making {
        id: map_id().to_string(),
        product: Product::Map,
        query: query_id(),
        state: MakingState::Running,
        progress: 0.4,
        stage: String::new(),
        created: "2025-01-01T00:00:00Z".into(),
        problem: None,
    };
    let server = Fake::start(move |asked| match asked.line.split(' ').next() {
        Some("POST") if asked.line.contains("/maps?wait=") => Reply::json(202, &making),
        Some("GET") if asked.line.contains("wait=") => {
            thread::sleep(Duration::from_secs(60));
            Reply::none()
        }
        Some("DELETE") => Reply { status: 204, headers: Vec::new(), body: Vec::new() },
        _ => service(asked, 1),
    });
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let mut client = Command::new(env!("CARGO_BIN_EXE_quadmuse"))
        .args(["--server", &server.url, "map", &query_id().to_string(), "--force", "-o"])
        .arg(&out)
        .env("QUADMUSE_STATE", folder.path())
        .spawn()
        .expect("the client");
    let path = format!("/v1/queries/{}/maps/{}", query_id(), map_id());
    let is_asked = |line: &str| server.lines().iter().any(|asked| asked.starts_with(line));
    let until = Instant::now() + Duration::from_secs(30);
    while !is_asked(&format!("GET {path}?wait=")) {
        assert!(Instant::now() < until, "it never waited: {:?}", server.lines());
        thread::sleep(Duration::from_millis(10));
    }
    let sent = Command::new("sh").args(["-c", &format!("kill -INT {}", client.id())]).status().expect("a shell");
    assert!(sent.success());
    let ended = client.wait().expect("an end");
    assert_eq!(ended.code(), Some(130));
    assert!(is_asked(&format!("DELETE {path}")), "{:?}", server.lines());
    assert!(!out.exists(), "nothing was made");
}
