//! The whole path over HTTP: the real server, the real client, a store on disk.

mod clocks;
mod cluster;
mod crash;
mod disks;
mod hostile;
#[path = "../../../server/cluster/tests/support/nodes.rs"]
mod nodes;
mod path;
mod proxies;
mod shares;
mod shutdown;
mod together;
mod traces;
mod uploads;

use quadmuse_tests::{
    client::{Client, Ran},
    server::Server,
    shapes::{self, Faces},
};
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder with a place for a store and for files.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a folder") }
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, text).expect("writes");
        path
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Quads of heads, `count` of them.
    fn heads(&self, count: u32) -> Vec<PathBuf> {
        (0..count).map(|kind| self.file(&format!("head_{kind}.obj"), &shapes::head(kind, 16, Faces::Quads))).collect()
    }

    fn serve(&self) -> (Server, Client) {
        let server = Server::start(&self.data()).expect("a server");
        let client = Client::new(server.url());
        (server, client)
    }
}

/// Runs a command line; words that are paths stand at the end.
fn run(client: &Client, words: &[&str], paths: &[&Path]) -> Ran {
    let words = words.iter().map(AsRef::as_ref).chain(paths.iter().map(|path| path.as_os_str()));
    client.run(words).expect("it runs")
}

/// The JSON values that a successful command prints.
fn values(client: &Client, words: &[&str], paths: &[&Path]) -> Vec<Value> {
    let mut line = vec!["--json"];
    line.extend(words);
    let ran = run(client, &line, paths).ok().unwrap_or_else(|error| panic!("{error}"));
    ran.values().expect("JSON")
}

/// Text in a JSON value.
fn text<'a>(value: &'a Value, name: &str) -> &'a str {
    value[name].as_str().unwrap_or_else(|| panic!("no {name} in {value}"))
}

/// The ids of the whole corpus.
fn listed(client: &Client) -> Vec<String> {
    let list = values(client, &["list"], &[]).remove(0);
    list.as_array().expect("a list").iter().map(|example| text(example, "id").to_owned()).collect()
}
