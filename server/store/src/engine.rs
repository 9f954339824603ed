//! The embedded database, behind typed calls: the only place of this crate that names it.
//!
//! What it does, and what follows. An `insert` is not yet on disk, and its `flush` ends in no real sync, so [`Engine::commit`] syncs the
//! file through a second descriptor. Values and nodes over a quarter of a segment would go to unsynced side files, so segments have their
//! greatest size and values stay below 16 KiB (a leaf has 17 of them at most). It panics where others return errors, so every call is under `catch_unwind`.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use quadmuse_migrations::MigrationError;
use quadmuse_proto::id::ExampleId;
use serde::{Deserialize, Serialize};

use crate::derived::{Part, PartKind, PartSource};
use crate::error::{StoreError, is_full};
use crate::files::{self, sync_dir};
use crate::frame::{seal, unseal};
use crate::keys::{self, CHUNK_BYTES, Generation, SegmentKey};
use crate::record::ExampleRecord;

const SEGMENT_BYTES: usize = 16 << 20;
const BLOBS: &str = "blobs";
const RECORD_SUM: usize = 16;
/// Rows removed at once when garbage is collected.
const COLLECT_ROWS: usize = 512;

/// Empty rows behind each segment's: as many as make a leaf split, so that what is written next doesn't write the segment's last
/// chunks again.
const GUARD_KEYS: u16 = 17;

/// When the disk is first tried while a commit waits for it, then after twice as long each time; how long a commit may take once
/// that failed, and how long at all: longer for the first.
const TRY_AFTER: Duration = Duration::from_millis(50);
const LET_GO: Duration = Duration::from_secs(1);
const COMMIT_DEADLINE: Duration = Duration::from_secs(60);
const FIRST_COMMIT_DEADLINE: Duration = Duration::from_secs(300);

/// Threads that read records at an opening, at most.
const READERS_MAX: usize = 4;

/// What names the parts of a segment: the row that is switched when it is encoded anew.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pointer {
    pub(crate) encoder_version: u32,
    generation: [u8; keys::GENERATION_BYTES],
    /// Kind and length in bytes of each part.
    parts: Vec<(PartKind, u32)>,
}

impl Pointer {
    pub(crate) fn new(encoder_version: u32, generation: Generation, parts: &[Part]) -> Self {
        let parts = parts.iter().map(|part| (part.kind, part.bytes.len() as u32)).collect();
        Self { encoder_version, generation: generation.0, parts }
    }

    pub(crate) fn generation(&self) -> Generation {
        Generation(self.generation)
    }

    /// Bytes of all its parts.
    pub(crate) fn bytes(&self) -> u64 {
        self.parts.iter().map(|&(_, length)| u64::from(length)).sum()
    }

    fn length(&self, kind: PartKind) -> Option<usize> {
        self.parts.iter().find(|(found, _)| *found == kind).map(|&(_, length)| length as usize)
    }

    pub(crate) fn has(&self, kind: PartKind) -> bool {
        self.length(kind).is_some()
    }

    pub(crate) fn kinds(&self) -> impl Iterator<Item = PartKind> + '_ {
        self.parts.iter().map(|&(kind, _)| kind)
    }
}

/// A failure of the database.
#[derive(Debug)]
pub(crate) enum Failure {
    /// What is on disk is not what it once wrote.
    Damaged(String),
    /// It panicked: damage, a failed write, or a bug of its own.
    Panic(String),
    /// The file system refused something; it may not the next time.
    Io(String),
    /// The file system has no room.
    Full(String),
}

impl Failure {
    pub(crate) fn reason(&self) -> &str {
        let (Failure::Damaged(reason) | Failure::Panic(reason) | Failure::Io(reason) | Failure::Full(reason)) = self;
        reason
    }

    /// The same as an error of the store, met while doing something.
    pub(crate) fn into_error(self, doing: &'static str) -> StoreError {
        match self {
            Failure::Full(reason) => StoreError::IndexFull { doing, reason },
            other => StoreError::Engine { doing, reason: other.reason().to_owned() },
        }
    }
}

impl From<&std::io::Error> for Failure {
    fn from(error: &std::io::Error) -> Self {
        if is_full(error) { Failure::Full(error.to_string()) } else { Failure::Io(error.to_string()) }
    }
}

impl From<&MigrationError> for Failure {
    fn from(error: &MigrationError) -> Self {
        match error {
            MigrationError::Io { source, .. } | MigrationError::Index { source: sled::Error::Io(source), .. } => {
                source.into()
            }
            other => Failure::Io(other.to_string()),
        }
    }
}

/// How the database's panics tell of a full disk: they hold nothing but words.
const FULL_WORDS: [&str; 2] = ["No space left on device", "StorageFull"];

/// Calls the database, and makes a panic of its an error.
fn guarded<T>(call: impl FnOnce() -> sled::Result<T>) -> Result<T, Failure> {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(sled::Error::Io(error))) if error.kind() != ErrorKind::UnexpectedEof => Err((&error).into()),
        Ok(Err(error)) => Err(Failure::Damaged(error.to_string())),
        Err(panic) => {
            let text =
                panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
            let text = format!("panic: {}", text.unwrap_or("without a message"));
            let is_full = FULL_WORDS.iter().any(|words| text.contains(words));
            Err(if is_full { Failure::Full(text) } else { Failure::Panic(text) })
        }
    }
}

/// An open index.
pub(crate) struct Engine {
    db: sled::Db,
    manifest: sled::Tree,
    body: sled::Tree,
    derived: sled::Tree,
    parts: sled::Tree,
    pending: sled::Tree,
    /// A second descriptor of the database's file, to sync it for real.
    file: File,
    dir: PathBuf,
}

impl Engine {
    /// Opens or creates the index in `dir`, and carries out pending migrations of the store around it.
    pub(crate) fn open(store: &Path, dir: &Path, cache_bytes: u64) -> Result<Engine, Failure> {
        let config =
            sled::Config::new().path(dir).segment_size(SEGMENT_BYTES).cache_capacity(cache_bytes).flush_every_ms(None);
        let new = !dir.join("db").exists();
        let db = guarded(|| config.open())?;
        let migrate =
            || Ok(quadmuse_migrations::run(store, &db, &mut |progress| tracing::info!(?progress, "migrating")));
        guarded(migrate)?.map_err(|error| Failure::from(&error))?;
        let tree = |name: &str| guarded(|| db.open_tree(name));
        let file = File::open(dir.join("db")).map_err(|error| Failure::from(&error))?;
        let engine = Engine {
            manifest: tree("manifest")?,
            body: tree("body")?,
            derived: tree("derived")?,
            parts: tree("parts")?,
            pending: tree("pending")?,
            db,
            file,
            dir: dir.to_path_buf(),
        };
        if new {
            engine.commit()?;
            let sync = || File::open(dir.join("conf"))?.sync_all();
            sync().map_err(|error| Failure::from(&error))?;
            for dir in [dir.join(BLOBS), dir.to_path_buf(), store.to_path_buf()] {
                sync_dir(&dir).map_err(|error| Failure::Io(error.to_string()))?;
            }
        }
        Ok(engine)
    }

    /// Makes everything written so far durable, power cuts included.
    pub(crate) fn commit(&self) -> Result<(), Failure> {
        self.committed(COMMIT_DEADLINE)
    }

    /// The first [`Engine::commit`] after an opening, which writes what the opening mended.
    pub(crate) fn first_commit(&self) -> Result<(), Failure> {
        self.committed(FIRST_COMMIT_DEADLINE)
    }

    /// A commit may never end by itself: the database does not wake who waits for a write that failed on a thread of its own, and
    /// forgets what failed while it opened. So it is woken, and the disk is tried, when it takes long.
    fn committed(&self, deadline: Duration) -> Result<(), Failure> {
        let (db, file) = (self.db.clone(), self.file.try_clone().map_err(|error| Failure::from(&error))?);
        let (sender, receiver) = mpsc::sync_channel(1);
        let flush = move || {
            let synced = || file.sync_all().map_err(|error| Failure::from(&error));
            let _ = sender.send(guarded(|| db.flush()).and_then(|_| synced()));
        };
        let thread = std::thread::Builder::new().name("store-flush".into()).spawn(flush);
        thread.map_err(|error| Failure::from(&error))?;
        let begun = Instant::now();
        let mut wait = TRY_AFTER;
        loop {
            match receiver.recv_timeout(wait.min(deadline.saturating_sub(begun.elapsed()))) {
                Ok(result) => return result,
                Err(mpsc::RecvTimeoutError::Disconnected) => return Err(Failure::Panic("its thread ended".into())),
                Err(mpsc::RecvTimeoutError::Timeout) => self.wake()?,
            }
            if let Err(error) = self.try_disk() {
                // Woken, it most often ends, and lets go of the database's lock.
                return receiver.recv_timeout(LET_GO).unwrap_or_else(|_| Err(Failure::from(&error)));
            }
            if begun.elapsed() > deadline {
                return Err(Failure::Io("it was not written in time".into()));
            }
            wait *= 2;
        }
    }

    /// Starts a second flush: where a write has failed, it wakes the first and ends; else it ends with it.
    fn wake(&self) -> Result<(), Failure> {
        let db = self.db.clone();
        let thread = std::thread::Builder::new().name("store-wake".into()).spawn(move || drop(guarded(|| db.flush())));
        thread.map(drop).map_err(|error| Failure::from(&error))
    }

    /// Writes a little beside the index, and removes it.
    fn try_disk(&self) -> std::io::Result<()> {
        let path = self.dir.join("tried");
        let tried = fs::write(&path, [1; CHUNK_BYTES]);
        let removed = fs::remove_file(&path);
        tried.and(removed)
    }

    /// Bytes on disk, and files among the database's unsynced side files (there must be none).
    pub(crate) fn size(&self) -> Result<(u64, usize), Failure> {
        let bytes = guarded(|| self.db.size_on_disk())?;
        let blobs = fs::read_dir(self.dir.join(BLOBS)).map(Iterator::count).unwrap_or(0);
        Ok((bytes, blobs))
    }

    fn chunks(bytes: &[u8]) -> impl Iterator<Item = (u16, &[u8])> {
        (0u16..=u16::MAX).zip(bytes.chunks(CHUNK_BYTES))
    }

    /// Writes a record: its body first, its row last.
    pub(crate) fn put_record(&self, record: &ExampleRecord, encoded: &[u8]) -> Result<(), Failure> {
        let mut batch = sled::Batch::default();
        for (chunk, bytes) in Self::chunks(encoded) {
            let key = keys::body(record.id, record.revision, chunk);
            let value = seal("body", &key, bytes);
            batch.insert(key, value);
        }
        let hash = blake3::hash(encoded);
        let mut row = record.revision.to_le_bytes().to_vec();
        row.extend_from_slice(&(encoded.len() as u32).to_le_bytes());
        row.extend(hash.as_bytes().iter().take(RECORD_SUM));
        let key = keys::record(record.id);
        guarded(|| {
            self.body.apply_batch(batch)?;
            self.manifest.insert(key, seal("manifest", &key, &row))
        })?;
        Ok(())
    }

    /// Removes a record's row; its body is removed by [`Engine::remove_bodies`].
    pub(crate) fn remove_row(&self, id: ExampleId) -> Result<(), Failure> {
        guarded(|| self.manifest.remove(keys::record(id)))?;
        Ok(())
    }

    /// Removes a record's bodies of all revisions but `keep`.
    pub(crate) fn remove_bodies(&self, id: ExampleId, keep: Option<u32>) -> Result<(), Failure> {
        let kept = keep.map(|revision| [&keys::record(id)[..], &revision.to_be_bytes()].concat());
        Self::remove_prefix(&self.body, &keys::record(id), kept.as_deref())
    }

    /// Removes the bodies that no row names any more; `keep` says which revision of an example stays.
    pub(crate) fn collect_bodies(&self, keep: impl Fn(ExampleId) -> Option<u32>) -> Result<usize, Failure> {
        let rows: Vec<_> = guarded(|| self.body.iter().keys().collect::<sled::Result<_>>())?;
        let mut batch = sled::Batch::default();
        let mut removed = 0;
        for key in rows {
            let kept = keys::parse_body(&key).is_some_and(|(id, revision)| keep(id) == Some(revision));
            if !kept {
                batch.remove(key);
                removed += 1;
            }
        }
        guarded(|| self.body.apply_batch(batch))?;
        Ok(removed)
    }

    fn remove_prefix(tree: &sled::Tree, prefix: &[u8], keep: Option<&[u8]>) -> Result<(), Failure> {
        guarded(|| {
            let mut batch = sled::Batch::default();
            let mut rows = 0;
            for key in tree.scan_prefix(prefix).keys() {
                let key = key?;
                if keep.is_some_and(|keep| key.starts_with(keep)) {
                    continue;
                }
                batch.remove(key);
                rows += 1;
                if rows >= COLLECT_ROWS {
                    tree.apply_batch(std::mem::take(&mut batch))?;
                    rows = 0;
                }
            }
            tree.apply_batch(batch)
        })
    }

    /// Every record there is a row of; `Err` in an entry says how it is damaged.
    pub(crate) fn records(&self) -> Result<Vec<(ExampleId, Result<ExampleRecord, String>)>, Failure> {
        let rows: Vec<_> = guarded(|| self.manifest.iter().collect())?;
        let read = |rows: &[(sled::IVec, sled::IVec)]| -> Result<Vec<_>, Failure> {
            let known = rows.iter().filter_map(|(key, value)| Some((keys::parse_record(key)?, value)));
            known.map(|(id, value)| Ok((id, self.record(id, value)?))).collect()
        };
        // Most of an opening's time goes here: it is shared among the cores, and joined in order.
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(READERS_MAX);
        let parts = std::thread::scope(|scope| {
            let read = &read;
            let part = |rows| scope.spawn(move || read(rows));
            let parts: Vec<_> = rows.chunks(rows.len().div_ceil(threads).max(1)).map(part).collect();
            parts.into_iter().map(|part| part.join()).collect::<Vec<_>>()
        });
        let mut records = Vec::with_capacity(rows.len());
        for part in parts {
            records.extend(part.map_err(|_| Failure::Panic("a reader of records panicked".into()))??);
        }
        Ok(records)
    }

    fn record(&self, id: ExampleId, row: &[u8]) -> Result<Result<ExampleRecord, String>, Failure> {
        let Some(&[r0, r1, r2, r3, l0, l1, l2, l3, ref sum @ ..]) = unseal("manifest", &keys::record(id), row) else {
            return Ok(Err("a row of the index with a checksum that does not match".into()));
        };
        let (revision, length) = (u32::from_le_bytes([r0, r1, r2, r3]), u32::from_le_bytes([l0, l1, l2, l3]));
        let key = |chunk| keys::body(id, revision, chunk);
        let bytes = match self.gather(&self.body, "body", length as usize, key)? {
            Ok(bytes) => bytes,
            Err(reason) => return Ok(Err(reason)),
        };
        if blake3::hash(&bytes).as_bytes().get(..RECORD_SUM) != Some(sum) {
            return Ok(Err("a record that does not match its row".into()));
        }
        Ok(files::decode(&bytes))
    }

    /// Reads `length` bytes in chunks; the inner error says what is wrong with them.
    fn gather(
        &self,
        tree: &sled::Tree,
        name: &str,
        length: usize,
        key: impl Fn(u16) -> Vec<u8>,
    ) -> Result<Result<Vec<u8>, String>, Failure> {
        let mut bytes = Vec::with_capacity(length.min(1 << 20));
        // Chunks are as long as the release made them that wrote them.
        for chunk in 0..=u16::MAX {
            if bytes.len() >= length {
                break;
            }
            let key = key(chunk);
            let Some(value) = guarded(|| tree.get(&key))? else { return Ok(Err(format!("chunk {chunk} missing"))) };
            let Some(payload) = unseal(name, &key, &value) else {
                return Ok(Err(format!("chunk {chunk} with a checksum that does not match")));
            };
            bytes.extend_from_slice(payload);
        }
        Ok(if bytes.len() == length { Ok(bytes) } else { Err(format!("{} bytes instead of {length}", bytes.len())) })
    }

    /// Makes room for the parts of a segment under a fresh generation: their keys, with empty values.
    ///
    /// The database keeps a leaf of its tree as one written node and up to nine changes behind it, and writes the node anew with the
    /// tenth, or when it is split: chunks that arrive one by one are each written some five times, and what is left
    /// behind is only reclaimed where it is more than half of a segment. Keys alone cost next to nothing to write again; once they are there the
    /// leaves have split, to no more keys than there may be changes, and each chunk is written once.
    pub(crate) fn reserve_parts(&self, key: SegmentKey, pointer: &Pointer) -> Result<(), Failure> {
        let generation = pointer.generation();
        guarded(|| self.pending.insert(keys::generation(key, generation), &[]))?;
        let mut parts = pointer.parts.clone();
        parts.sort_unstable_by_key(|&(kind, _)| kind);
        let of_part = |(kind, length): (PartKind, u32)| {
            let chunks = (0..=u16::MAX).take((length as usize).div_ceil(CHUNK_BYTES));
            chunks.map(move |chunk| keys::part(key, generation, kind, chunk))
        };
        // One by one, since a batch is written in no order.
        let mut all = parts.into_iter().flat_map(of_part);
        guarded(|| all.try_for_each(|key| self.parts.insert(key, &[]).map(drop)))
    }

    /// Ends a round of reservations: what is written after it doesn't write the last chunks again.
    pub(crate) fn reserve_guards(&self, (key, generation): (SegmentKey, Generation)) -> Result<(), Failure> {
        let mut guards = (0..GUARD_KEYS).map(|chunk| keys::part(key, generation, PartKind::GUARD, chunk));
        guarded(|| guards.try_for_each(|key| self.parts.insert(key, &[]).map(drop)))
    }

    /// Writes the parts of a segment, for which there is room. Nothing names them until [`Engine::put_pointer`].
    pub(crate) fn put_parts(&self, key: SegmentKey, generation: Generation, parts: &[Part]) -> Result<(), Failure> {
        for part in parts {
            let mut batch = sled::Batch::default();
            for (chunk, bytes) in Self::chunks(&part.bytes) {
                let key = keys::part(key, generation, part.kind, chunk);
                let value = seal("parts", &key, bytes);
                batch.insert(key, value);
            }
            guarded(|| self.parts.apply_batch(batch))?;
        }
        Ok(())
    }

    /// Switches a segment to these parts, and notes the former ones as garbage.
    pub(crate) fn put_pointer(
        &self,
        key: SegmentKey,
        pointer: &Pointer,
        former: Option<&Pointer>,
    ) -> Result<(), Failure> {
        let row = rmp_serde::to_vec_named(pointer).map_err(|error| Failure::Io(error.to_string()))?;
        let at = keys::segment(key);
        guarded(|| {
            if let Some(former) = former {
                self.pending.insert(keys::generation(key, former.generation()), &[])?;
            }
            let value = seal("derived", &at, &row);
            self.derived.insert(at, value)
        })?;
        Ok(())
    }

    /// Forgets that a generation might be garbage.
    pub(crate) fn settle(&self, key: SegmentKey, generation: Generation) -> Result<(), Failure> {
        guarded(|| self.pending.remove(keys::generation(key, generation)))?;
        Ok(())
    }

    /// Removes a pointer, and notes its parts as garbage.
    pub(crate) fn remove_pointer(&self, key: SegmentKey, pointer: &Pointer) -> Result<(), Failure> {
        guarded(|| {
            self.pending.insert(keys::generation(key, pointer.generation()), &[])?;
            self.derived.remove(keys::segment(key))
        })?;
        Ok(())
    }

    /// Removes the rows of a generation, then the note that it is garbage.
    pub(crate) fn collect(&self, key: SegmentKey, generation: Generation) -> Result<(), Failure> {
        Self::remove_prefix(&self.parts, &keys::generation(key, generation), None)?;
        self.settle(key, generation)
    }

    /// Every generation that may be garbage.
    pub(crate) fn pending(&self) -> Result<Vec<(SegmentKey, Generation)>, Failure> {
        let rows: Vec<_> = guarded(|| self.pending.iter().keys().collect::<sled::Result<_>>())?;
        Ok(rows.iter().filter_map(|key| keys::parse_generation(key)).collect())
    }

    /// Every pointer; a damaged row is `None`.
    pub(crate) fn pointers(&self) -> Result<Vec<(SegmentKey, Option<Pointer>)>, Failure> {
        let rows: Vec<(sled::IVec, sled::IVec)> = guarded(|| self.derived.iter().collect())?;
        let pointer = |key: &[u8], value: &[u8]| rmp_serde::from_slice(unseal("derived", key, value)?).ok();
        Ok(rows.iter().filter_map(|(key, value)| Some((keys::parse_segment(key)?, pointer(key, value)))).collect())
    }

    /// Removes a damaged pointer row.
    pub(crate) fn remove_damaged_pointer(&self, key: SegmentKey) -> Result<(), Failure> {
        guarded(|| self.derived.remove(keys::segment(key)))?;
        Self::remove_prefix(&self.parts, &keys::segment(key), None)
    }

    /// The bytes of a part as they were written; the inner error says how it is damaged.
    pub(crate) fn part(
        &self,
        key: SegmentKey,
        pointer: &Pointer,
        kind: PartKind,
    ) -> Result<Result<Vec<u8>, String>, Failure> {
        let Some(length) = pointer.length(kind) else { return Ok(Err("part missing".into())) };
        self.gather(&self.parts, "parts", length, |chunk| keys::part(key, pointer.generation(), kind, chunk))
    }
}

/// One segment's parts, to be read.
pub(crate) struct Reader<'a> {
    pub(crate) engine: &'a Engine,
    pub(crate) key: SegmentKey,
    pub(crate) pointer: &'a Pointer,
    /// Told when the database itself fails.
    pub(crate) on_failure: &'a dyn Fn(&Failure),
}

impl PartSource for Reader<'_> {
    fn part(&self, kind: PartKind) -> Result<Vec<u8>, StoreError> {
        let bytes = self.engine.part(self.key, self.pointer, kind).unwrap_or_else(|failure| {
            (self.on_failure)(&failure);
            Err(failure.reason().to_owned())
        });
        bytes.map_err(|reason| self.damaged(kind, &reason))
    }

    fn has(&self, kind: PartKind) -> bool {
        self.pointer.has(kind)
    }

    fn damaged(&self, kind: PartKind, reason: &str) -> StoreError {
        let (id, segment) = self.key;
        StoreError::DamagedDerived { id, segment, part: kind.name(), reason: reason.to_owned() }
    }
}
