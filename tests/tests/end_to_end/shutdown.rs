//! SIGTERM: streams end with a final event, and the process ends in good order.

use crate::{Place, text, values};
use quadmuse_tests::shapes::{self, Faces};
use serde_json::Value;
use std::{
    io::{BufRead, BufReader},
    process::Stdio,
    time::Duration,
};

/// How long the server may take to stop.
const STOP_TIME_MAX: Duration = Duration::from_secs(10);

#[test]
fn an_open_stream_gets_its_last_event_when_the_server_is_stopped() {
    let place = Place::new();
    let (mut server, client) = place.serve();
    let heads = place.heads(12);
    values(&client, &["add"], &heads.iter().map(AsRef::as_ref).collect::<Vec<_>>());
    // Large and fine enough to be under way for a while.
    let scan = place.file("scan.obj", &shapes::head(3, 120, Faces::Triangles));
    let started = values(&client, &["query", "--resolution", "512", "--top", "12", "--no-follow"], &[&scan]).remove(0);
    let query = text(&started, "id");
    let mut follow = client
        .command(["--json", "ranking", query, "--follow"])
        .expect("a command")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut lines = BufReader::new(follow.stdout.take().expect("a pipe")).lines();
    let first: Value = serde_json::from_str(&lines.next().expect("an event").expect("a line")).expect("JSON");
    assert_eq!(first["event"], "begin");

    let status = server.terminate(STOP_TIME_MAX).expect("it is told");
    let status = status.unwrap_or_else(|| panic!("it still runs after {STOP_TIME_MAX:?}:\n{}", server.log()));
    assert!(status.success(), "it ended with {status}:\n{}", server.log());

    let rest: Vec<Value> = lines.map(|line| serde_json::from_str(&line.expect("a line")).expect("JSON")).collect();
    let last = rest.last().expect("a last event");
    assert!(matches!(last["event"].as_str(), Some("end" | "error")), "the stream broke off after {last}");
    let lasts = rest.iter().filter(|event| matches!(event["event"].as_str(), Some("end" | "error"))).count();
    assert_eq!(lasts, 1, "{rest:?}");
    follow.wait().expect("it ends");
}
