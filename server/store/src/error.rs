//! What can go wrong with the corpus on disk, a variant a reason.

use std::io;
use std::path::{Path, PathBuf};

use quadmuse_proto::id::ExampleId;

/// Why the store refused or failed. Messages say what was expected, what was found and the way out.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// No such example (never added, or removed).
    #[error("expected an example of the corpus, found none with the id {id}; list the corpus for the ids it holds")]
    NotFound {
        /// The id asked for.
        id: ExampleId,
    },
    /// The ground state of one example is damaged; the others are served.
    #[error(
        "expected the example {id} whole, found it quarantined ({reason}); add the same mesh again to heal it, or remove it"
    )]
    Quarantined {
        /// The damaged example.
        id: ExampleId,
        /// What is wrong with its ground state.
        reason: String,
    },
    /// An encoding doesn't match its checksums; encode the segment anew from the mesh.
    #[error(
        "expected an intact encoding of segment {segment} of {id}, found {part} damaged ({reason}); encode it again from its mesh"
    )]
    DamagedDerived {
        /// The example.
        id: ExampleId,
        /// The segment, counted from 0.
        segment: u32,
        /// Which part of the encoding.
        part: &'static str,
        /// What did not match.
        reason: String,
    },
    /// The example is there, an encoding of that segment isn't (yet); encode the segment from the mesh.
    #[error("expected an encoding of segment {segment} of {id}, found none; encode it from its mesh")]
    MissingDerived {
        /// The example.
        id: ExampleId,
        /// The segment, counted from 0.
        segment: u32,
    },
    /// The encoding has no pyramid level of this side.
    #[error(
        "expected a pyramid level of side {side} in segment {segment} of {id}, found none; ask for one of its levels"
    )]
    NoSuchLevel {
        /// The example.
        id: ExampleId,
        /// The segment, counted from 0.
        segment: u32,
        /// The side asked for, in pixels.
        side: u32,
    },
    /// A value handed in is outside the store's limits.
    #[error("expected {field} {expected}, found {found}")]
    Invalid {
        /// Which value.
        field: &'static str,
        /// The limit, in words.
        expected: String,
        /// What was handed in.
        found: String,
    },
    /// Too little free space; reads and removals go on.
    #[error(
        "expected {needed} bytes of free space beside the reserve of {reserve}, found {available} free; free space or remove examples"
    )]
    Full {
        /// Bytes the write may need.
        needed: u64,
        /// Bytes held back so that removals work.
        reserve: u64,
        /// Bytes free on the file system.
        available: u64,
    },
    /// Writing is suspended after a failure; the store tries by itself to resume.
    #[error(
        "expected a writable store, found it read-only ({reason}); it resumes by itself once the cause is gone, try again later"
    )]
    ReadOnly {
        /// The failure that suspended writing.
        reason: String,
    },
    /// Too many writes are waiting.
    #[error("expected room in the queue of writes, found it full; try again shortly")]
    Busy,
    /// The store was written by a newer release. Not a byte was changed.
    #[error(
        "expected a store of schema {supported} or older, found schema {found}; use the release that wrote it or a newer one"
    )]
    Newer {
        /// Schema of the directory.
        found: u32,
        /// Newest schema this release knows.
        supported: u32,
    },
    /// Another process has the directory open.
    #[error("expected the store at {} to be free, found it in use by another process; stop that one first", dir.display())]
    Locked {
        /// The store's directory.
        dir: PathBuf,
    },
    /// The schema can't be read, or an upgrade failed.
    #[error("expected the store's schema to be readable and its upgrade to work; see the cause, or restore a backup")]
    Migration(#[from] quadmuse_migrations::MigrationError),
    /// A file operation failed.
    #[error("expected to {doing} {}; see the cause", path.display())]
    Io {
        /// What was attempted.
        doing: &'static str,
        /// On which file or directory.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// The embedded database failed or panicked; the handle is not used any further.
    #[error(
        "expected the index to {doing}, found a failure ({reason}); the store goes read-only and reopens it by itself"
    )]
    Engine {
        /// What was attempted.
        doing: &'static str,
        /// The database's words.
        reason: String,
    },
    /// The embedded database met a full disk.
    #[error("expected the index to {doing}, found the disk full ({reason}); free space, writing resumes by itself")]
    IndexFull {
        /// What was attempted.
        doing: &'static str,
        /// The database's words.
        reason: String,
    },
    /// The store can't be opened: the disk is full. What is in it stays as it is.
    #[error(
        "expected room to open the store in {}, found its disk full ({available} bytes free); free some {wanted} bytes there, or move the folder to a larger disk, and start again: nothing in it is lost", dir.display()
    )]
    NoRoom {
        /// The store's directory.
        dir: PathBuf,
        /// Bytes free on its file system.
        available: u64,
        /// Bytes free with which it opens.
        wanted: u64,
        /// What met the full disk.
        source: Box<StoreError>,
    },
    /// A backup can't be read or written.
    #[error("expected a whole backup, found {found} at byte {at}; use another copy")]
    Backup {
        /// What was found instead.
        found: String,
        /// Where, in bytes from its start.
        at: u64,
    },
    /// A backup is only restored into an empty store.
    #[error("expected an empty store to restore into, found {examples} examples; name an empty directory")]
    NotEmpty {
        /// Examples already there.
        examples: usize,
    },
    /// A restore into this directory did not end: it holds a part of a corpus.
    #[error("expected a whole corpus in {}, found a restore that did not end; restore into it again", dir.display())]
    HalfRestored {
        /// The store's directory.
        dir: PathBuf,
    },
    /// The record was changed since the caller read it.
    #[error(
        "expected the example {id} at revision {expected}, found it at revision {found}: somebody else changed it; read it again, and change that"
    )]
    Conflict {
        /// The example.
        id: ExampleId,
        /// The revision that the change was made for.
        expected: u32,
        /// The revision there is.
        found: u32,
    },
    /// The engine that servers share doesn't answer. Whether a write was kept is not known: send it again.
    #[error("expected the cluster's engine to {doing}, found that it does not ({reason}); try again shortly")]
    Unreachable {
        /// What was attempted.
        doing: &'static str,
        /// What it, or the network, said.
        reason: String,
    },
    /// The engine that servers share has no room left.
    #[error(
        "expected room on the cluster's engine, found none ({reason}); give its nodes larger disks, or raise their `max_file`"
    )]
    EngineFull {
        /// What it said.
        reason: String,
    },
    /// The store was closed while the call was waiting.
    #[error("expected an open store, found it closing; start it again")]
    Closed,
}

impl StoreError {
    /// An [`StoreError::Io`] for `map_err`.
    pub(crate) fn io<'a>(doing: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> StoreError + 'a {
        move |source| StoreError::Io { doing, path: path.to_path_buf(), source }
    }

    /// Whether the cause is a full file system, a quota or a limit on the size of files.
    pub fn is_full(&self) -> bool {
        match self {
            StoreError::Full { .. }
            | StoreError::IndexFull { .. }
            | StoreError::NoRoom { .. }
            | StoreError::EngineFull { .. } => true,
            StoreError::Io { source, .. } => is_full(source),
            StoreError::Migration(quadmuse_migrations::MigrationError::Io { source, .. }) => is_full(source),
            _ => false,
        }
    }
}

/// Whether a file system refused something for want of room.
pub(crate) fn is_full(error: &io::Error) -> bool {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge)
}
