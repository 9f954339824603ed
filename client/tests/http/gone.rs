//! What becomes of a command when the server that had its query, one of several, dies.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{query, query_id},
    queries::{mesh_file, service},
    run,
};
use quadmuse_proto::{Code, Query, QueryId, QueryState};

fn gone_id() -> QueryId {
    QueryId::from_bytes([9; 16])
}

/// A service of which one server took the query and died; `keeps`: another can start it again.
fn dying(asked: &Asked, keeps: bool) -> Reply {
    let gone = gone_id().to_string();
    if asked.line.starts_with("POST /v1/queries?") || asked.line == "POST /v1/queries" {
        return Reply::json(202, &Query { id: gone_id(), ..query(QueryState::Queued, 1) });
    }
    if asked.line == format!("POST /v1/queries/{gone}/restart") && keeps {
        return Reply::json(202, &query(QueryState::Queued, 1));
    }
    if asked.line.ends_with("/restart") {
        return Reply::problem(Code::NotFound, 404, "expected a query, found none");
    }
    if asked.line.contains(&gone) {
        let mut reply = Reply::problem(Code::OwnerGone, 503, "expected a server, found it gone");
        reply.headers.push("Retry-After: 2".into());
        return reply;
    }
    service(asked, 1)
}

#[tokio::test]
async fn a_query_whose_server_died_is_started_again_once_and_that_is_said() {
    let server = Fake::start(|asked| dying(asked, true));
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("query {}", mesh.path().display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert_eq!(ran.out.lines().last(), Some(query_id().to_string().as_str()));
    let said = format!("the server that had the query {} is gone; it was started again as {}", gone_id(), query_id());
    assert_eq!(ran.notes.lines().filter(|line| line.contains(&said)).count(), 1, "{}", ran.notes);
    // No waiting for what does not come back.
    let polls = server.lines().into_iter().filter(|line| line.contains(&gone_id().to_string())).count();
    assert!(polls <= 2, "{:?}", server.lines());
}

#[tokio::test]
async fn retopo_goes_on_with_what_another_server_started_again() {
    let server = Fake::start(|asked| dying(asked, true));
    let (mesh, out) = (mesh_file(), tempfile::tempdir().expect("a folder"));
    let out = out.path().join("out.obj");
    let ran = run(&server.url, &format!("retopo {} -o {}", mesh.path().display(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(ran.notes.contains("it was started again as"), "{}", ran.notes);
    assert!(out.exists());
    let uploads = server.asked().into_iter().filter(|asked| !asked.body.is_empty() && asked.line == "POST /v1/queries");
    assert_eq!(uploads.count(), 1, "the scan is sent once");
}

#[tokio::test]
async fn what_nobody_keeps_is_a_failure() {
    let server = Fake::start(|asked| dying(asked, false));
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("query {}", mesh.path().display())).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("not_found"), "{}", ran.notes);
}
