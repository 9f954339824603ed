//! The client remembers the last query of each server between commands, in the user's state folder.
//!
//! A file of JSON, an object from a server's address to the query's id. That it can't be written is no failure: it only
//! makes `@last` unknown.

use crate::{error::ClientError, file};
use quadmuse_proto::QueryId;
use std::{
    collections::BTreeMap,
    env,
    path::{Path, PathBuf},
};

/// The name of the file.
const FILE: &str = "last-query.json";

/// Servers that are remembered at most; beyond them all are forgotten but the newest.
const SERVERS_MAX: usize = 64;

/// Remembers the last query of each server.
#[derive(Clone, Debug)]
pub struct State {
    folder: Option<PathBuf>,
}

impl State {
    /// In a folder, or else in that of the user (XDG: `quadmuse` in `$XDG_STATE_HOME`, or in `~/.local/state`).
    pub fn new(folder: Option<PathBuf>) -> Self {
        Self { folder: folder.or_else(|| of_user(env::var_os("XDG_STATE_HOME"), env::var_os("HOME"))) }
    }

    /// The last query that was started on a server.
    pub fn last_query(&self, server: &str) -> Option<QueryId> {
        self.read()?.get(server)?.parse().ok()
    }

    /// Remembers a query that was started.
    ///
    /// # Errors
    /// [`ClientError::Unwritable`].
    pub fn keep_query(&self, server: &str, id: QueryId) -> Result<(), ClientError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let mut all = self.read().filter(|all| all.len() < SERVERS_MAX).unwrap_or_default();
        all.insert(server.to_owned(), id.to_string());
        let path = folder.join(FILE);
        let unwritable = |source| ClientError::Unwritable { path: path.clone(), source };
        std::fs::create_dir_all(folder).map_err(unwritable)?;
        let text = serde_json::to_vec_pretty(&all).map_err(|error| unwritable(error.into()))?;
        file::write(&path, &text)
    }

    fn read(&self) -> Option<BTreeMap<String, String>> {
        let text = std::fs::read(self.folder.as_ref()?.join(FILE)).ok()?;
        serde_json::from_slice(&text).ok()
    }
}

/// The user's folder; a relative path in the environment counts as none, as XDG has it.
fn of_user(state_home: Option<std::ffi::OsString>, home: Option<std::ffi::OsString>) -> Option<PathBuf> {
    let absolute = |path: std::ffi::OsString| Some(PathBuf::from(path)).filter(|path| path.is_absolute());
    let state_home = state_home.and_then(absolute);
    let base = state_home.or_else(|| home.and_then(absolute).map(|home| home.join(Path::new(".local/state"))));
    base.map(|base| base.join("quadmuse"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_query_is_remembered_for_each_server() {
        let folder = tempfile::tempdir().expect("a folder");
        let state = State::new(Some(folder.path().join("new")));
        assert_eq!(state.last_query("http://a"), None);
        let [one, two, three] = [1, 2, 3].map(|k| QueryId::from_bytes([k; 16]));
        for (server, id) in [("http://a", one), ("http://b", two), ("http://a", three)] {
            state.keep_query(server, id).expect("writes");
        }
        assert_eq!(["http://a", "http://b"].map(|server| state.last_query(server)), [Some(three), Some(two)]);
        std::fs::write(folder.path().join("new").join(FILE), "{").expect("writes");
        assert_eq!(state.last_query("http://a"), None, "a damaged file is none");
    }

    #[test]
    fn the_folder_is_that_of_the_user() {
        let of = |state: Option<&str>, home: Option<&str>| of_user(state.map(Into::into), home.map(Into::into));
        assert_eq!(of(Some("/s"), Some("/h")), Some("/s/quadmuse".into()));
        assert_eq!(of(Some("s"), Some("/h")), Some("/h/.local/state/quadmuse".into()));
        assert_eq!(of(None, None), None);
    }
}
