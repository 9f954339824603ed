//! Opening: the index is opened or built anew, and brought into line with the ground files.
//!
//! An example is there if the index or a ground file says so, and whole if its objects are there. Writing makes the objects durable
//! first, then the index, then the ground file; removal takes the ground file first, then the row, then the objects. So whatever a kill
//! leaves is either whole (it comes back) or not (it is collected), and what the index silently lost comes back from the ground files.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;

use crate::engine::{Engine, Failure};
use crate::error::StoreError;
use crate::files::{self, Ground, Objects};
use crate::index::{Change, Index};
use crate::quarantine::Quarantine;
use crate::record::ExampleRecord;
use crate::shared::OpenOptions;
use crate::{compact, writer};

/// Name of the index's directory.
pub(crate) const INDEX_DIR: &str = "index";
/// Where a damaged index is moved while another one is built.
const ASIDE_DIR: &str = "index.damaged";
/// A database that has not opened within this time, and a second for each [`OPEN_BYTES_S`], never will.
const OPEN_DEADLINE: Duration = Duration::from_secs(60);
const OPEN_BYTES_S: u64 = 10 << 20;
/// How long the lock of a handle that is being closed is waited for.
const LOCK_WAIT: Duration = Duration::from_secs(10);

/// What opening found and mended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenReport {
    /// Examples served.
    pub examples: usize,
    /// Why the index had to be built anew from the ground files, if it had to.
    pub index_rebuilt: Option<String>,
    /// Records the index had lost, brought back from the ground files.
    pub records_restored: usize,
    /// Records whose ground file was missing, written anew.
    pub ground_restored: usize,
    /// Examples whose ground state is damaged, and how.
    pub quarantined: Vec<(ExampleId, String)>,
    /// Segments without an encoding: to be encoded from the mesh.
    pub missing_derived: Vec<(ExampleId, u32)>,
    /// Files and rows that an interrupted write or removal left, now removed.
    pub garbage_collected: usize,
    /// Files among the database's unsynced side files; 0 unless something is wrong.
    pub blobs: usize,
    /// Time taken, in milliseconds.
    pub took_ms: u64,
}

/// Opens the index, and brings it and the ground files into line.
pub(crate) fn load(
    dir: &Path,
    options: &OpenOptions,
    ground: &Ground,
    objects: &Objects,
    collect: Collect,
) -> Result<(Engine, Index, OpenReport), StoreError> {
    compact::switch(dir)?;
    let mut report = OpenReport::default();
    let engine = open_index(dir, options, &mut report)?;
    match reconcile(dir, &engine, ground, objects, collect, &mut report) {
        Ok(index) => Ok((engine, index, report)),
        Err(error) => {
            // What failed to be written makes it panic when it is dropped.
            let _ = writer::close(Arc::new(engine));
            Err(error)
        }
    }
}

/// Opens the index; when it can't be read, first without what it can do without, then by a new one.
pub(crate) fn open_index(store: &Path, options: &OpenOptions, report: &mut OpenReport) -> Result<Engine, StoreError> {
    let (dir, cache_bytes) = (store.join(INDEX_DIR), options.cache_bytes);
    let refused = match open_in_time(store, &dir, cache_bytes) {
        Ok(engine) => return Ok(engine),
        Err(failure @ (Failure::Io(_) | Failure::Full(_))) => return Err(failure.into_error("open")),
        Err(Failure::Damaged(reason) | Failure::Panic(reason)) => reason,
    };
    // What the database says on a full disk is no proof of damage, and another index couldn't be built anyway.
    if options.is_short(store) {
        return Err(StoreError::IndexFull { doing: "open", reason: refused });
    }
    tracing::warn!(reason = refused, "the index can't be opened; trying without its snapshot");
    drop_accessories(&dir)?;
    if let Ok(engine) = open_in_time(store, &dir, cache_bytes) {
        return Ok(engine);
    }
    tracing::warn!("the index is damaged; building it anew from the ground files");
    let aside = store.join(ASIDE_DIR);
    remove_tree(&aside)?;
    fs::rename(&dir, &aside).map_err(StoreError::io("move aside", &dir))?;
    files::sync_dir(store)?;
    report.index_rebuilt = Some(refused);
    open_in_time(store, &dir, cache_bytes).map_err(|failure| failure.into_error("build"))
}

/// The database's own settings and snapshot are written anew from its log when they are gone.
fn drop_accessories(dir: &Path) -> Result<(), StoreError> {
    let Ok(entries) = fs::read_dir(dir) else { return Ok(()) };
    for entry in entries.flatten() {
        let name = entry.file_name();
        if name == "conf" || name.to_string_lossy().starts_with("snap.") {
            let path = entry.path();
            fs::remove_file(&path).map_err(StoreError::io("remove", &path))?;
        }
    }
    Ok(())
}

pub(crate) fn remove_tree(dir: &Path) -> Result<(), StoreError> {
    if dir.exists() { fs::remove_dir_all(dir).map_err(StoreError::io("remove", dir)) } else { Ok(()) }
}

/// Opens the database on a thread of its own: damaged, it may never come back.
fn open_in_time(store: &Path, dir: &Path, cache_bytes: u64) -> Result<Engine, Failure> {
    let deadline =
        OPEN_DEADLINE + Duration::from_secs(fs::metadata(dir.join("db")).map_or(0, |facts| facts.len()) / OPEN_BYTES_S);
    let begun = Instant::now();
    loop {
        let (sender, receiver) = mpsc::sync_channel(1);
        let (store, dir) = (store.to_path_buf(), dir.to_path_buf());
        let open = move || drop(sender.send(Engine::open(&store, &dir, cache_bytes)));
        let thread = std::thread::Builder::new().name("store-open".into()).spawn(open);
        thread.map_err(|error| Failure::from(&error))?;
        match receiver.recv_timeout(deadline) {
            Ok(Err(Failure::Io(reason)))
                if reason.contains("could not acquire lock") && begun.elapsed() < LOCK_WAIT =>
            {
                std::thread::sleep(Duration::from_millis(20));
            }
            Ok(result) => return result,
            Err(mpsc::RecvTimeoutError::Timeout) => return Err(Failure::Panic("it did not open in time".into())),
            Err(mpsc::RecvTimeoutError::Disconnected) => return Err(Failure::Panic("its thread ended".into())),
        }
    }
}

fn engine_error(doing: &'static str) -> impl Fn(Failure) -> StoreError {
    move |failure| failure.into_error(doing)
}

/// When files that nothing names may be collected.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Collect {
    /// Nobody is writing yet.
    Files,
    /// Objects may be under way: leave them alone.
    RowsOnly,
    /// A part of the store is missing: not even a record without its objects is dropped.
    Nothing,
}

/// There while objects may belong to records that are missing.
const KEEP_OBJECTS: &str = "objects.keep";

/// Whether files that nothing names may be collected. Where the ground files or the index of a store that was there before
/// are missing, as after a restore of some of its files, whatever nothing names may still be wanted: a mark says so until
/// somebody who knows better removes it.
pub(crate) fn may_collect(store: &Path, existed: bool, keeps_files: bool) -> Result<Collect, StoreError> {
    let mark = store.join(KEEP_OBJECTS);
    let is_missing = |name: &str| !store.join(name).is_dir();
    let holds_objects = || fs::read_dir(store.join("objects")).is_ok_and(|mut entries| entries.next().is_some());
    if (existed || holds_objects())
        && (is_missing("ground") || is_missing(INDEX_DIR))
        && holds_objects()
        && !mark.exists()
    {
        let words = "The ground files or the index were missing: no object is removed until this file is.\n";
        fs::write(&mark, words).map_err(StoreError::io("write", &mark))?;
        files::sync_dir(store)?;
    }
    if mark.exists() {
        tracing::warn!(mark = %mark.display(), "a part of the store was missing: nothing is collected until this file is removed");
        return Ok(Collect::Nothing);
    }
    Ok(if keeps_files { Collect::RowsOnly } else { Collect::Files })
}

/// Brings index and ground files into line and loads the corpus.
pub(crate) fn reconcile(
    store: &Path,
    engine: &Engine,
    ground: &Ground,
    objects: &Objects,
    collect: Collect,
    report: &mut OpenReport,
) -> Result<Index, StoreError> {
    let mut index = Index::default();
    let mut work = Reconcile { engine, ground, objects, report, collect, damage: false };
    work.records(&mut index)?;
    still_quarantined(store, objects, &mut index)?;
    work.pointers(&mut index)?;
    work.garbage(&index, collect)?;
    let intact = !work.damage;
    engine.first_commit().map_err(engine_error("commit"))?;
    files::sync_dir(ground.dir())?;
    if intact {
        remove_tree(&store.join(ASIDE_DIR))?;
    }
    finish(engine, &index, report)?;
    Ok(index)
}

fn finish(engine: &Engine, index: &Index, report: &mut OpenReport) -> Result<(), StoreError> {
    let (_, blobs) = engine.size().map_err(engine_error("report its size"))?;
    report.blobs = blobs;
    if blobs > 0 {
        tracing::error!(blobs, "the index wrote unsynced side files, which it never should; compact the store");
    }
    report.quarantined = index.quarantined().iter().map(|(&id, reason)| (id, reason.clone())).collect();
    report.examples = index.records().filter(|record| index.quarantine_reason(record.id).is_none()).count();
    report.missing_derived = missing_derived(index, 0);
    Ok(())
}

/// Segments whose encoding is missing or older than `encoder_version`.
pub(crate) fn missing_derived(index: &Index, encoder_version: u32) -> Vec<(ExampleId, u32)> {
    let stale = |key| index.pointer(key).is_none_or(|pointer| pointer.encoder_version < encoder_version);
    let segments = |record: &Arc<ExampleRecord>| (0..record.segments.len() as u32).zip(std::iter::repeat(record.id));
    let all = index.records().filter(|record| index.quarantine_reason(record.id).is_none()).flat_map(segments);
    all.map(|(segment, id)| (id, segment)).filter(|&key| stale(key)).collect()
}

/// What was quarantined before is, unless its objects are whole again.
fn still_quarantined(store: &Path, objects: &Objects, index: &mut Index) -> Result<(), StoreError> {
    let quarantine = Quarantine::of(store);
    for (id, reason) in quarantine.noted() {
        let Some(record) = index.record(id).cloned() else { continue };
        let mut is_whole = true;
        for object in record.objects() {
            is_whole &= objects.get(object)?.is_ok();
        }
        match is_whole {
            true => quarantine.forget(id),
            false => index.apply(Change::Quarantined(id, reason)),
        }
    }
    Ok(())
}

struct Reconcile<'a> {
    engine: &'a Engine,
    ground: &'a Ground,
    objects: &'a Objects,
    report: &'a mut OpenReport,
    collect: Collect,
    /// Something could not be read: nothing is collected that it might have named.
    damage: bool,
}

/// What is known of one example before its record is settled.
#[derive(Default)]
struct Known {
    row: Option<Result<ExampleRecord, String>>,
    /// Revisions there is a ground file of, ascending.
    revisions: Vec<u32>,
}

impl Reconcile<'_> {
    fn records(&mut self, index: &mut Index) -> Result<(), StoreError> {
        let mut known: BTreeMap<ExampleId, Known> = BTreeMap::new();
        for (id, revision) in self.ground.list()? {
            known.entry(id).or_default().revisions.push(revision);
        }
        for (id, row) in self.engine.records().map_err(engine_error("list its records"))? {
            known.entry(id).or_default().row = Some(row);
        }
        for (id, known) in known {
            self.settle(id, known, index)?;
        }
        Ok(())
    }

    /// Chooses the newest intact record of an example and writes it where it is missing.
    fn settle(&mut self, id: ExampleId, known: Known, index: &mut Index) -> Result<(), StoreError> {
        let half = known.row.is_none() != known.revisions.is_empty();
        let mut reasons = Vec::new();
        let mut best =
            known.row.and_then(|row| row.map_err(|reason| reasons.push(reason)).ok().filter(|record| record.id == id));
        let in_index = best.as_ref().map(|record| record.revision);
        for &revision in known.revisions.iter().rev() {
            if in_index.is_some_and(|found| found >= revision) {
                break;
            }
            match self.ground.get(id, revision)? {
                Ok(record) => {
                    best = Some(record);
                    break;
                }
                Err(reason) => reasons.push(reason),
            }
        }
        let Some(record) = best else {
            self.damage = true;
            index.apply(Change::Quarantined(id, reasons.join("; ")));
            return Ok(());
        };
        let broken = record.objects().zip([Some(record.bytes), None]).find_map(|(object, bytes)| {
            match self.objects.length(object) {
                None => Some(format!("object {object} is missing")),
                Some(found) => {
                    bytes.filter(|&bytes| bytes != found).map(|_| format!("object {object} has {found} bytes"))
                }
            }
        });
        if half && broken.is_some() && self.report.index_rebuilt.is_none() && self.collect != Collect::Nothing {
            return self.drop_half(id, &known.revisions);
        }
        self.write_missing(&record, in_index, &known.revisions)?;
        index.apply(Change::Record(Arc::new(record)));
        if let Some(reason) = broken {
            index.apply(Change::Quarantined(id, reason));
        }
        Ok(())
    }

    /// What an interrupted removal left.
    fn drop_half(&mut self, id: ExampleId, revisions: &[u32]) -> Result<(), StoreError> {
        self.engine.remove_row(id).map_err(engine_error("remove a row"))?;
        revisions.iter().try_for_each(|&revision| self.ground.remove(id, revision))?;
        self.report.garbage_collected += 1;
        Ok(())
    }

    fn write_missing(
        &mut self,
        record: &ExampleRecord,
        in_index: Option<u32>,
        revisions: &[u32],
    ) -> Result<(), StoreError> {
        if in_index != Some(record.revision) {
            let encoded = files::encode(record)?;
            self.engine.put_record(record, &encoded).map_err(engine_error("restore a record"))?;
            self.report.records_restored += 1;
        }
        if !revisions.contains(&record.revision) {
            self.ground.put(record)?;
            self.report.ground_restored += 1;
        }
        for &old in revisions.iter().filter(|&&revision| revision < record.revision) {
            self.ground.remove(record.id, old)?;
        }
        Ok(())
    }

    fn pointers(&mut self, index: &mut Index) -> Result<(), StoreError> {
        for (key, pointer) in self.engine.pointers().map_err(engine_error("list its encodings"))? {
            let wanted = index.record(key.0).is_some_and(|record| (key.1 as usize) < record.segments.len());
            match pointer {
                Some(pointer) if wanted => index.apply(Change::Pointer(key, Arc::new(pointer))),
                Some(pointer) => {
                    self.engine.remove_pointer(key, &pointer).map_err(engine_error("remove an encoding"))?
                }
                None => self.engine.remove_damaged_pointer(key).map_err(engine_error("remove a damaged encoding"))?,
            }
        }
        Ok(())
    }

    fn garbage(&mut self, index: &Index, collect: Collect) -> Result<(), StoreError> {
        let fail = engine_error("collect garbage");
        for (key, generation) in self.engine.pending().map_err(&fail)? {
            if index.pointer(key).is_some_and(|pointer| pointer.generation() == generation) {
                self.engine.settle(key, generation).map_err(&fail)?;
            } else {
                self.engine.collect(key, generation).map_err(&fail)?;
                self.report.garbage_collected += 1;
            }
        }
        if !self.damage {
            let keep = |id| index.record(id).map(|record| record.revision);
            self.report.garbage_collected += self.engine.collect_bodies(keep).map_err(&fail)?;
        }
        if !self.damage && collect == Collect::Files {
            self.report.garbage_collected += self.objects.collect(|object| index.object_uses(object) > 0)?;
        }
        Ok(())
    }
}
