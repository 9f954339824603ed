//! Servers that share a corpus on a real engine. Left out where there is no `nats-server`.

use crate::{Place, listed, nodes::Nodes, text};
use quadmuse_tests::{
    binaries::program,
    client::Client,
    http,
    server::Server,
    shapes::{self, Faces},
};
use serde_json::Value;
use std::{
    path::Path,
    process::{Command, Output},
    time::{Duration, Instant},
};

/// Longest time for one server to see what another wrote: on a busy machine nodes may elect a leader meanwhile.
const SEEN_WITHIN: Duration = Duration::from_secs(90);

/// A server of the corpus `studio`, with a cache of its own.
pub(crate) fn join(nodes: &Nodes, data: &Path) -> (Server, Client) {
    join_with(nodes, data, &[])
}

/// The same with more variables.
pub(crate) fn join_with(nodes: &Nodes, data: &Path, variables: &[&str]) -> (Server, Client) {
    let cluster = format!("QUADMUSE_CLUSTER={}", nodes.addresses());
    let words: Vec<&str> = ["env", &cluster, "QUADMUSE_BUCKET=studio"].iter().chain(variables).copied().collect();
    let server = Server::start_under(&words, data).expect("a server");
    let client = Client::new(server.url());
    (server, client)
}

/// Runs a command of the server's program against that corpus.
fn command(nodes: &Nodes, words: &[&str], path: &Path) -> Output {
    let mut command = Command::new(program("quadmuse-server").expect("built"));
    command.env("QUADMUSE_CLUSTER", nodes.addresses()).env("QUADMUSE_BUCKET", "studio").args(words).arg(path);
    let output = command.output().expect("it runs");
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

pub(crate) fn eventually(what: &str, holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < SEEN_WITHIN, "not so after {SEEN_WITHIN:?}: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn json(answer: &http::Answer) -> Value {
    serde_json::from_str(&answer.text()).expect("JSON")
}

#[test]
fn servers_share_one_corpus_its_tokens_and_its_changes() {
    let Some(nodes) = Nodes::start(3) else { return };
    let (place, first_place, second_place) = (Place::new(), Place::new(), Place::new());
    let files: Vec<_> = (0..3)
        .map(|kind| place.file(&format!("e{kind}.obj"), &shapes::vase(kind, 16 + kind, 8, Faces::Quads)))
        .collect();
    // What a studio has already goes to the engine.
    let (local, client) = place.serve();
    client.run(["add".as_ref(), files[0].as_os_str()]).expect("it runs").ok().expect("added");
    let imported = listed(&client);
    drop(local);
    command(&nodes, &["cluster", "import", "--data"], &place.data());

    let (first, one) = join(&nodes, &first_place.data());
    let (second, two) = join(&nodes, &second_place.data());
    assert_eq!((listed(&one), listed(&two)), (imported.clone(), imported.clone()));
    one.run(["add".as_ref(), files[1].as_os_str()]).expect("it runs").ok().expect("added");
    two.run(["add".as_ref(), files[2].as_os_str()]).expect("it runs").ok().expect("added");
    for client in [&one, &two] {
        eventually("both have three", || listed(client).len() == 3);
    }
    // The same on the other server: nothing new.
    two.run(["add".as_ref(), files[1].as_os_str()]).expect("it runs").ok().expect("there");
    assert_eq!(listed(&two), listed(&one));
    // Encoded on one server, ranked on the other.
    let ranked = two.run(["--json".as_ref(), "query".as_ref(), files[1].as_os_str()]).expect("it runs").ok();
    assert!(ranked.expect("ranked").out.contains("e1"));

    let example = format!("/v1/examples/{}", imported[0]);
    let rename = |server: &Server, name: &str| {
        let body = format!("{{\"name\": \"{name}\", \"revision\": 1}}");
        let length = body.len().to_string();
        let headers = [("content-type", "application/json"), ("content-length", &length)];
        http::ask(server.address(), &format!("PATCH {example}"), &headers, body.as_bytes()).expect("answered")
    };
    assert_eq!(rename(&first, "mine").status, 200);
    let refused = rename(&second, "yours");
    assert_eq!(refused.status, 409);
    assert!(text(&json(&refused), "detail").contains("revision 2"), "{}", refused.text());
    eventually("both have the name", || {
        http::get(second.address(), &example).is_ok_and(|answer| text(&json(&answer), "name") == "mine")
    });

    // A server that is killed comes back with everything, also without its cache.
    second.kill().expect("killed");
    std::fs::remove_dir_all(second_place.data()).expect("removed");
    let (second, two) = join(&nodes, &second_place.data());
    assert_eq!(listed(&two), listed(&one));

    // And back to a store of one server, byte for byte.
    let (exported, again) = (place.path("exported"), place.path("again"));
    command(&nodes, &["cluster", "backup"], &place.path("shared.backup"));
    command(&nodes, &["cluster", "export", "--data"], &exported);
    let exported = exported.to_str().expect("a plain path");
    let backup = command(&nodes, &["backup", "--data", exported], &again);
    assert!(String::from_utf8_lossy(&backup.stdout).contains("3 examples"));
    let read = |path: &str| std::fs::read(place.path(path)).expect("a file");
    assert!(read("shared.backup") == read("again"));

    // The backup fills another engine, here one of a single node.
    let elsewhere = Nodes::start(1).expect("a node");
    command(&elsewhere, &["cluster", "restore"], &place.path("shared.backup"));
    command(&elsewhere, &["cluster", "backup"], &place.path("restored.backup"));
    assert!(read("shared.backup") == read("restored.backup"));

    // A token that is made anywhere holds everywhere.
    let words = ["token", "--data", exported, "create", "--role", "admin", "--name"];
    let secret = command(&nodes, &words, Path::new("ada"));
    let secret = format!("Bearer {}", String::from_utf8_lossy(&secret.stdout).trim());
    for server in [&first, &second] {
        let list = |headers: &[(&str, &str)]| http::ask(server.address(), "GET /v1/examples", headers, b"");
        eventually("closed", || list(&[]).is_ok_and(|answer| answer.status == 401));
        assert_eq!(list(&[("authorization", &secret)]).expect("answered").status, 200);
    }
}
