//! kill -9 while examples are added: what was acknowledged is there, and nothing is there by halves.

use crate::{Place, listed, text, values};
use quadmuse_tests::{
    http,
    shapes::{self, Faces},
};
use serde_json::Value;
use std::{
    io::{BufRead, BufReader},
    process::Stdio,
};

/// Files that are sent.
const FILES: u32 = 60;

#[test]
fn nothing_acknowledged_is_lost_when_the_server_is_killed() {
    let place = Place::new();
    let files: Vec<_> = (0..FILES)
        .map(|kind| place.file(&format!("e{kind}.obj"), &shapes::vase(kind, 16 + kind, 8, Faces::Quads)))
        .collect();
    // Killed after so many acknowledgements; the store goes on from one round to the next.
    let mut acknowledged: Vec<(String, String)> = Vec::new();
    for (round, kill_after) in [3, 7, 20].into_iter().enumerate() {
        let (server, client) = place.serve();
        for (id, file) in &acknowledged {
            assert!(listed(&client).contains(id), "round {round}: {file} was acknowledged, and is lost");
        }
        let mut add = client
            .command(["--json".as_ref(), "add".as_ref()].into_iter().chain(files.iter().map(|file| file.as_os_str())))
            .expect("a command")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("it runs");
        let mut server = Some(server);
        let mut answers = 0;
        for line in BufReader::new(add.stdout.take().expect("a pipe")).lines() {
            let answer: Value = serde_json::from_str(&line.expect("a line")).expect("JSON");
            let Some(id) = answer["id"].as_str() else { continue };
            acknowledged.push((id.to_owned(), text(&answer, "file").to_owned()));
            answers += 1;
            if answers == kill_after
                && let Some(server) = server.take()
            {
                server.kill().expect("it is killed");
            }
        }
        assert!(server.is_none(), "round {round}: all {FILES} files were added before the server could be killed");
        let status = add.wait().expect("it ends");
        assert!(matches!(status.code(), Some(1 | 3)), "round {round}: the client should have failed, not {status}");
    }

    let (server, client) = place.serve();
    let ids = listed(&client);
    for (id, file) in &acknowledged {
        assert!(ids.contains(id), "{file} was acknowledged, and is lost");
    }
    for id in &ids {
        // What is listed is whole.
        values(&client, &["show", id], &[]);
        let mesh = http::get(server.address(), &format!("/v1/examples/{id}/mesh")).expect("an answer");
        assert_eq!(mesh.status, 200, "{id}: {}", mesh.text());
        assert!(files.iter().any(|file| std::fs::read(file).expect("reads") == mesh.body), "{id}: other bytes");
    }
    // The rest can be added as if nothing had happened.
    let paths: Vec<_> = files.iter().map(AsRef::as_ref).collect();
    assert_eq!(values(&client, &["add"], &paths).len(), FILES as usize);
    assert_eq!(listed(&client).len(), FILES as usize);
}
