//! Servers whose clocks are wrong, and are set while they run. Left out where there is no `nats-server` or no libfaketime
//! (Debian: apt-get install faketime). The engine's own clocks are right: no library reaches them.

use crate::{Place, cluster, cluster::join_with, listed, nodes::Nodes, text};
use quadmuse_tests::{
    binaries::program,
    http,
    server::Server,
    shapes::{self, Faces},
};
use serde_json::Value;
use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// The library that tells a program another time.
fn layer() -> Option<PathBuf> {
    let folders = std::fs::read_dir("/usr/lib").ok()?.flatten();
    let mut layers = folders.map(|folder| folder.path().join("faketime/libfaketime.so.1"));
    layers.find(|layer| layer.is_file())
}

/// Variables that make a program take its time from a file, which says by how much it is off.
fn clock(layer: &Path, file: &Path) -> [String; 4] {
    [
        format!("LD_PRELOAD={}", layer.display()),
        format!("FAKETIME_TIMESTAMP_FILE={}", file.display()),
        "FAKETIME_CACHE_DURATION=1".into(),
        // As a clock is set on a machine: what counts the time since its start goes on.
        "DONT_FAKE_MONOTONIC=1".into(),
    ]
}

/// The day of its clock, as the last line of its audit log has it.
fn day(data: &Path) -> String {
    let log = std::fs::read_to_string(data.join("audit.jsonl")).unwrap_or_default();
    let last: Value = log.lines().last().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default();
    last["time"].as_str().unwrap_or_default().chars().take(10).collect()
}

fn get(server: &Server, path: &str) -> Value {
    http::get(server.address(), path).expect("answered").json()
}

fn rename(server: &Server, id: &str, name: &str, revision: u32) -> u16 {
    let body = format!("{{\"name\": \"{name}\", \"revision\": {revision}}}");
    let length = body.len().to_string();
    let headers = [("content-type", "application/json"), ("content-length", &*length)];
    http::ask(server.address(), &format!("PATCH /v1/examples/{id}"), &headers, body.as_bytes())
        .expect("answered")
        .status
}

#[test]
fn servers_whose_clocks_are_wrong_lose_nothing_and_still_find_each_other() {
    let Some(layer) = layer() else {
        println!("left out: there is no libfaketime (Debian: apt-get install faketime)");
        return;
    };
    let Some(nodes) = Nodes::start(3) else { return };
    let (place, right_place, wrong_place) = (Place::new(), Place::new(), Place::new());
    let file = place.file("clock", "+2d\n");
    let words = clock(&layer, &file);
    let (right, one) = join_with(&nodes, &right_place.data(), &[]);
    let (wrong, two) = join_with(&nodes, &wrong_place.data(), &words.each_ref().map(String::as_str));
    let heads = place.heads(3);
    one.run(["add".as_ref(), heads[0].as_os_str()]).expect("it runs").ok().expect("added");
    two.run(["add".as_ref(), heads[1].as_os_str()]).expect("it runs").ok().expect("added");
    let both = || [listed(&one), listed(&two)];
    cluster::eventually("both have both", || both().iter().all(|list| list.len() == 2));
    let id = listed(&one).remove(0);
    assert_eq!(rename(&wrong, &id, "ahead", 1), 200);
    cluster::eventually("it is seen", || text(&get(&right, &format!("/v1/examples/{id}")), "name") == "ahead");

    // Its clock is set back by four days while it runs: what is refused is in its log, too.
    let [ahead, today] = [&wrong_place, &right_place].map(|place| day(&place.data()));
    assert!(ahead > today, "{ahead} and {today}");
    std::fs::write(&file, "-2d\n").expect("written");
    cluster::eventually("its clock is set", || {
        rename(&wrong, &id, "never", 99) == 409 && day(&wrong_place.data()) < today
    });
    assert_eq!(rename(&wrong, &id, "behind", 2), 200);
    assert_eq!(rename(&right, &id, "late", 2), 409);
    cluster::eventually("it is seen", || text(&get(&right, &format!("/v1/examples/{id}")), "name") == "behind");
    let scan = shapes::head(1, 16, Faces::Triangles);
    let posted = http::post(wrong.address(), "/v1/queries?resolution=32", "model/obj", scan.as_bytes());
    let query = posted.expect("answered").header("location").expect("an address").to_owned();
    cluster::eventually("it is done", || text(&get(&right, &query), "state") == "done");
    let queries = get(&right, "/v1/queries").to_string();
    assert!(queries.contains(query.rsplit('/').next().expect("an id")), "not in the list of the other: {queries}");
    two.run(["add".as_ref(), heads[2].as_os_str()]).expect("it runs").ok().expect("added");
    cluster::eventually("both have three", || both().iter().all(|list| list.len() == 3));

    // Objects that were put just now are not collected as two days old.
    one.run(["remove", "--yes", &id]).expect("it runs").ok().unwrap_or_else(|error| panic!("{error}"));
    std::fs::write(&file, "+2d\n").expect("written");
    let mut collect = Command::new("env");
    collect.args(&words).arg(program("quadmuse-server").expect("built")).args(["cluster", "collect"]);
    let collected = collect.env("QUADMUSE_CLUSTER", nodes.addresses()).env("QUADMUSE_BUCKET", "studio").output();
    let collected = collected.expect("it runs");
    let said = String::from_utf8_lossy(&collected.stdout).into_owned();
    assert!(collected.status.success() && said.starts_with("0 objects"), "{said}");

    // One that is gone is told as soon as ever.
    wrong.kill().expect("killed");
    assert_eq!(text(&get(&right, &query), "code"), "owner_gone");
    let (again, _) = join_with(&nodes, &wrong_place.data(), &words.each_ref().map(String::as_str));
    assert_eq!(text(&get(&again, &query), "code"), "owner_gone");
}
