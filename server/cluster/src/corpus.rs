//! A corpus that several servers share.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{
    Added, Backend, BackupReport, Changes, ChartRecord, CheckReport, Coarse, ContentHash, DerivedSegment, Document,
    Documents, ExampleRecord, Following, Level, Listener, NewExample, NewSegmentation, PackedSegment, Patch, Problem,
    SegmentRow, Snapshot, StoreError, Whole, identity, new_record, validate,
};
use serde_bytes::ByteBuf;

use crate::cache::Cache;
use crate::documents;
use crate::engine::{Engine, EngineError, Entry};
use crate::heal::{Healer, LOOKED_AFTER};
use crate::inner::Inner;
use crate::manifest::{DOCUMENT, Manifest, SCHEMA, SegmentEntry};
use crate::state::{Encoding, Known, RowKeeper};

/// Writes are refused, and the server is not ready, when it is not known for so long to be up to date.
pub const UNSURE_MAX: Duration = Duration::from_secs(10);

/// Makes the row that a search keeps of an encoding, of which segment of which example; `None` if it can't.
pub type RowMaker = Arc<dyn Fn(&ExampleRecord, u32, &PackedSegment) -> Option<Vec<u8>> + Send + Sync>;

/// How a shared corpus is opened.
#[derive(Clone)]
pub struct SharedOptions {
    /// Where objects are cached; it may be removed at any time.
    pub cache: PathBuf,
    /// Bytes the cache may take.
    pub cache_bytes: u64,
    /// Longest time to catch up with the engine.
    pub catch_up: Duration,
    /// How long after another node began to lead it is looked whether all that was written lately is there.
    pub looked_after: [Duration; 3],
    /// Makes rows for examples that come whole from another corpus, so that no server has to make them from encodings.
    pub row_maker: Option<RowMaker>,
    /// What of each row is kept in memory until it is asked for: a server with a share of the corpus leaves out the others'.
    pub row_keeper: Option<RowKeeper>,
}

impl SharedOptions {
    /// The usual: 32 GiB of cache in `cache`, and ten minutes to catch up.
    pub fn caching_in(cache: &Path) -> Self {
        Self {
            cache: cache.to_path_buf(),
            cache_bytes: 32 << 30,
            catch_up: Duration::from_secs(600),
            looked_after: LOOKED_AFTER,
            row_maker: None,
            row_keeper: None,
        }
    }
}

/// A corpus on an engine. Records are in memory, objects are fetched when they are needed and cached on disk.
pub struct SharedCorpus {
    pub(crate) engine: Arc<dyn Engine>,
    pub(crate) inner: Arc<Inner>,
    cache: Arc<Cache>,
    row_maker: Option<RowMaker>,
    stopping: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Drop for SharedCorpus {
    fn drop(&mut self) {
        self.stopping.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            thread.thread().unpark();
            // It returns what it panicked with: nothing to be done about it here.
            let _ = thread.join();
        }
    }
}

impl SharedCorpus {
    /// Joins: brings in every record, and returns when all that was there at the call is in. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`] if the engine doesn't answer, or not fast enough; [`StoreError::Newer`] if servers of a
    /// newer release have written to it.
    pub fn open(engine: Arc<dyn Engine>, options: &SharedOptions) -> Result<Self, StoreError> {
        let newest = engine.newest().map_err(unreachable("tell its newest entry"))?;
        let (inner, stopping) = (Arc::new(Inner::new(options.row_keeper.clone())), Arc::new(AtomicBool::new(false)));
        let (following, engine_of, stop) = (Arc::clone(&inner), Arc::clone(&engine), Arc::clone(&stopping));
        let cache = Arc::new(Cache::new(&options.cache, options.cache_bytes));
        let healer = Healer {
            engine: Arc::clone(&engine),
            inner: Arc::clone(&inner),
            cache: Arc::clone(&cache),
            looked_after: options.looked_after,
            stopping: Arc::clone(&stopping),
        };
        let row_maker = options.row_maker.clone();
        let mut corpus = Self { engine, inner, cache, row_maker, stopping, threads: Vec::new() };
        let follower = spawned("cluster-follower", move || crate::follow::run(&following, &engine_of, &stop));
        corpus.threads.push(follower?);
        corpus.threads.push(spawned("cluster-healer", move || healer.run())?);
        let begun = Instant::now();
        if !corpus.inner.wait_for(newest, options.catch_up) {
            let (position, seconds) = (corpus.inner.progress().position, begun.elapsed().as_secs());
            let reason = format!("after {seconds} s {position} of {newest} entries are in");
            return Err(StoreError::Unreachable { doing: "deliver all its entries", reason });
        }
        if corpus.inner.state().unread() > 0 {
            return Err(StoreError::Newer { found: SCHEMA + 1, supported: SCHEMA });
        }
        Ok(corpus)
    }

    /// Entries of the engine that are in.
    pub fn position(&self) -> u64 {
        self.inner.progress().position
    }

    /// Removes objects that no example needs and that were put longer ago than `age`; how many.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`].
    pub fn collect(&self, age: Duration) -> Result<u64, StoreError> {
        let newest = self.engine.newest().map_err(unreachable("tell its newest entry"))?;
        // What others added before is known when it is decided what nobody needs; what they are adding now is young.
        if !self.inner.wait_for(newest, UNSURE_MAX) {
            return Err(StoreError::Unreachable { doing: "deliver its newest entries", reason: "too late".into() });
        }
        let state = self.inner.state();
        let used: std::collections::HashSet<String> =
            state.examples().flat_map(|known| known.objects().map(|object| object.to_string())).collect();
        drop(state);
        // By both clocks: where this machine's is ahead, what others are adding right now would look old.
        let clock = self.engine.clock().map_err(unreachable("tell its time"))?.min(SystemTime::now());
        let before = clock.checked_sub(age).unwrap_or(SystemTime::UNIX_EPOCH);
        self.engine.collect(before, &|name| used.contains(name)).map_err(unreachable("remove objects"))
    }

    /// Keeps bytes for a while, for [`UPLOADS_KEPT_FOR`](crate::UPLOADS_KEPT_FOR) at most. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`], [`StoreError::EngineFull`].
    pub fn keep_upload(&self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        self.engine.keep_upload(name, bytes).map_err(unreachable("keep an upload"))
    }

    /// What was kept for a while under a name; `None` if there is nothing, or no more. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`].
    pub fn upload(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.engine.upload(name).map_err(unreachable("give an upload"))
    }

    /// Removes what was kept for a while under a name, if it is there. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`].
    pub fn remove_upload(&self, name: &str) -> Result<(), StoreError> {
        self.engine.remove_upload(name).map_err(unreachable("remove an upload"))
    }

    pub(crate) fn put_object(&self, name: ContentHash, bytes: &[u8]) -> Result<(), StoreError> {
        self.engine.put_object(&name.to_string(), bytes).map_err(unreachable("keep an object"))?;
        self.cache.put(name, bytes);
        self.inner.recent.put(name);
        Ok(())
    }

    /// An object from the cache or the engine; what is wrong, if it isn't there whole.
    fn object(&self, name: ContentHash) -> Result<Result<Vec<u8>, String>, StoreError> {
        if let Some(bytes) = self.cache.get(name) {
            return Ok(Ok(bytes));
        }
        match self.engine.object(&name.to_string()).map_err(unreachable("give an object"))? {
            Some(bytes) if ContentHash::of(&bytes) == name => {
                self.cache.put(name, &bytes);
                Ok(Ok(bytes))
            }
            Some(_) => Ok(Err("bytes that don't match their hash".into())),
            None => Ok(Err("no such object on the engine".into())),
        }
    }

    /// An object of an example's ground state; the example is set aside where it is damaged.
    fn ground(&self, id: ExampleId, name: ContentHash) -> Result<Vec<u8>, StoreError> {
        self.object(name)?.map_err(|reason| {
            if self.inner.state().example(id).is_none() {
                return StoreError::NotFound { id };
            }
            tracing::error!(%id, reason, "an example is quarantined");
            self.inner.change(|state| state.quarantine(id, &reason));
            StoreError::Quarantined { id, reason }
        })
    }

    fn encoding_of(&self, id: ExampleId, segment: u32) -> Result<Encoding, StoreError> {
        self.get(id)?;
        let state = self.inner.state();
        let known = state.example(id).ok_or(StoreError::NotFound { id })?;
        let encoding = known.encodings.get(segment as usize).copied().flatten();
        encoding.ok_or(StoreError::MissingDerived { id, segment })
    }

    fn packed(&self, id: ExampleId, segment: u32) -> Result<Arc<PackedSegment>, StoreError> {
        self.packed_as(id, segment, self.encoding_of(id, segment)?)
    }

    fn packed_as(&self, id: ExampleId, segment: u32, encoding: Encoding) -> Result<Arc<PackedSegment>, StoreError> {
        if let Some(packed) = self.cache.recent(encoding.object) {
            return Ok(packed);
        }
        let damaged = |reason| StoreError::DamagedDerived { id, segment, part: "all of it", reason };
        let bytes = self.object(encoding.object)?.map_err(damaged)?;
        let packed = Arc::new(PackedSegment::from_bytes(&bytes).map_err(damaged)?);
        self.cache.remember(encoding.object, &packed);
        Ok(packed)
    }

    /// An example as it is, or was, known: with what can be read of its encodings.
    fn whole_of(&self, known: &Known) -> Result<Whole, StoreError> {
        let (record, id) = (Arc::clone(&known.record), known.record.id);
        let objects = record.objects().map(|object| self.ground(id, object)).collect::<Result<_, _>>()?;
        let mut segments = Vec::with_capacity(known.encodings.len());
        for (segment, encoding) in (0u32..).zip(&known.encodings) {
            let Some(encoding) = encoding else { continue };
            match self.packed_as(id, segment, *encoding) {
                Ok(packed) => segments.push((segment, (*packed).clone())),
                Err(StoreError::DamagedDerived { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Whole { record, objects, segments })
    }

    /// Puts the object of an encoding; what an entry says of it.
    fn put_packed(&self, packed: &PackedSegment, row: Option<Vec<u8>>) -> Result<SegmentEntry, StoreError> {
        let bytes = packed.to_bytes()?;
        let object = ContentHash::of(&bytes);
        self.put_object(object, &bytes)?;
        let (encoder_version, bytes) = (packed.encoder_version, bytes.len() as u64);
        Ok(SegmentEntry { encoder_version, object, bytes, row: row.map(ByteBuf::from) })
    }

    /// Adds an example whose objects and segments are given.
    fn add_entry(
        &self,
        record: ExampleRecord,
        objects: &[&[u8]],
        segments: Vec<Option<SegmentEntry>>,
    ) -> Result<Added, StoreError> {
        for bytes in objects {
            self.put_object(ContentHash::of(bytes), bytes)?;
        }
        let identity = record.identity;
        let manifest = Manifest { record: Some(record), segments, ..Manifest::removed() };
        // Where nothing is known to be there, it is tried without reading first.
        let guess = self.inner.state().vacant(identity);
        let kept = self.commit(identity, guess, |now| match now.and_then(|now| now.record.as_ref()) {
            Some(_) => Ok(None),
            None => Ok(Some(manifest.clone())),
        })?;
        let record = kept.known.map(|known| known.record);
        let record = record.ok_or_else(|| StoreError::Unreachable {
            doing: "tell what was added",
            reason: "it was removed at the same moment".into(),
        })?;
        if !kept.written {
            // Its objects have just been put again, where they were damaged.
            self.inner.change(|state| state.heal(record.id));
        }
        Ok(if kept.written { Added::Created(record) } else { Added::Exists(record) })
    }

    fn sound_by(&self, wanted: ContentHash) -> Option<Arc<ExampleRecord>> {
        let state = self.inner.state();
        let known = state.by_identity(wanted)?;
        state.damage(known.record.id).is_none().then(|| Arc::clone(&known.record))
    }

    /// Reads what an example needs; what is wrong.
    fn check_example(&self, id: ExampleId, report: &mut CheckReport) -> Result<(), StoreError> {
        let Some(known) = self.inner.state().example(id).cloned() else { return Ok(()) };
        for object in known.record.objects() {
            match self.object(object)? {
                Ok(bytes) => report.bytes += bytes.len() as u64,
                Err(reason) => report.problems.push(Problem::Ground { id, reason }),
            }
        }
        for (segment, encoding) in (0u32..).zip(&known.encodings) {
            let reason = match encoding {
                None => Some("no encoding".to_owned()),
                Some(encoding) => {
                    report.segments += 1;
                    report.bytes += encoding.bytes;
                    let found = self.object(encoding.object)?;
                    found.and_then(|bytes| PackedSegment::from_bytes(&bytes)).err()
                }
            };
            report.problems.extend(reason.map(|reason| Problem::Derived { id, segment, reason }));
        }
        report.examples += 1;
        Ok(())
    }
}

fn spawned(name: &str, run: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, StoreError> {
    let thread = std::thread::Builder::new().name(name.into()).spawn(run);
    thread.map_err(|error| StoreError::Unreachable { doing: "be looked after by a thread", reason: error.to_string() })
}

/// An [`EngineError`] as the store's, for `map_err`.
pub(crate) fn unreachable(doing: &'static str) -> impl Fn(EngineError) -> StoreError {
    move |error| match error {
        EngineError::Silent { reason, .. } | EngineError::Refused { reason, .. } => {
            StoreError::Unreachable { doing, reason }
        }
        EngineError::Full { reason, .. } => StoreError::EngineFull { reason },
    }
}

impl Backend for SharedCorpus {
    fn snapshot(&self) -> Arc<Snapshot> {
        self.inner.state_mut().snapshot()
    }

    fn get(&self, id: ExampleId) -> Result<Arc<ExampleRecord>, StoreError> {
        let state = self.inner.state();
        if let Some(reason) = state.damage(id) {
            return Err(StoreError::Quarantined { id, reason: reason.to_owned() });
        }
        state.example(id).map(|known| Arc::clone(&known.record)).ok_or(StoreError::NotFound { id })
    }

    fn find(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> Option<Arc<ExampleRecord>> {
        self.sound_by(identity(ContentHash::of(mesh), segmentation, None))
    }

    fn is_damaged(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> bool {
        let state = self.inner.state();
        let known = state.by_identity(identity(ContentHash::of(mesh), segmentation, None));
        known.is_some_and(|known| state.damage(known.record.id).is_some())
    }

    fn add(&self, new: &NewExample<'_>, rows: &[Vec<u8>]) -> Result<Added, StoreError> {
        let (record, labels) = new_record(new)?;
        if let Some(there) = self.sound_by(record.identity) {
            return Ok(Added::Exists(there));
        }
        let mut segments = Vec::with_capacity(new.derived.len());
        for (at, derived) in new.derived.iter().enumerate() {
            let packed = PackedSegment::pack(new.encoder_version, derived)?;
            segments.push(Some(self.put_packed(&packed, rows.get(at).cloned())?));
        }
        let objects: Vec<&[u8]> = std::iter::once(new.mesh).chain(labels.as_deref()).collect();
        self.add_entry(record, &objects, segments)
    }

    fn annotate(&self, id: ExampleId, patch: Patch) -> Result<Arc<ExampleRecord>, StoreError> {
        let record = self.get(id)?;
        let kept = self.commit(record.identity, None, |now| {
            let mut next = now.filter(|now| is_of(now, id)).cloned().ok_or(StoreError::NotFound { id })?;
            next.record = next.record.map(|record| patch.apply(&record)).transpose()?;
            Ok(Some(next))
        })?;
        kept.known.map(|known| known.record).ok_or(StoreError::NotFound { id })
    }

    fn remove(&self, id: ExampleId) -> Result<(), StoreError> {
        let found = self.inner.state().example(id).map(|known| known.record.identity);
        let identity = found.ok_or(StoreError::NotFound { id })?;
        let remove = |now: Option<&Manifest>| match now.filter(|now| is_of(now, id)) {
            Some(_) => Ok(Some(Manifest::removed())),
            None => Err(StoreError::NotFound { id }),
        };
        self.commit(identity, None, remove).map(drop)
    }

    fn mesh_bytes(&self, id: ExampleId) -> Result<Vec<u8>, StoreError> {
        let record = self.get(id)?;
        self.ground(id, record.content_hash)
    }

    fn labels(&self, id: ExampleId) -> Result<Option<Vec<u32>>, StoreError> {
        let Some(object) = self.get(id)?.segmentation.labels() else { return Ok(None) };
        let bytes = self.ground(id, object)?;
        Ok(Some(bytes.as_chunks::<4>().0.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect()))
    }

    fn put_derived(
        &self,
        id: ExampleId,
        segment: u32,
        encoder_version: u32,
        derived: &DerivedSegment,
        row: Option<Vec<u8>>,
    ) -> Result<(), StoreError> {
        let record = self.get(id)?;
        let count = record.segments.len();
        if segment as usize >= count {
            let (expected, found) = (format!("at most {count} for this example"), (segment + 1).to_string());
            return Err(StoreError::Invalid { field: "the segment's number", expected, found });
        }
        let entry = self.put_packed(&PackedSegment::pack(encoder_version, derived)?, row)?;
        let replace = |now: Option<&Manifest>| {
            let mut next = now.filter(|now| is_of(now, id)).cloned().ok_or(StoreError::NotFound { id })?;
            next.segments.resize(count, None);
            // Another server may have been faster, with a newer encoder.
            let place = next.segments.get_mut(segment as usize);
            match place {
                // Made twice, as a job that was taken again: it has been put, and nothing changes.
                Some(Some(there)) if there.encoder_version == encoder_version && there.object == entry.object => {
                    Ok(None)
                }
                Some(place) if place.as_ref().is_none_or(|there| there.encoder_version <= encoder_version) => {
                    *place = Some(entry.clone());
                    Ok(Some(next))
                }
                _ => Ok(None),
            }
        };
        self.commit(record.identity, None, replace).map(drop)
    }

    fn coarse(&self, id: ExampleId, segment: u32) -> Result<Coarse, StoreError> {
        self.packed(id, segment)?.of(id, segment).coarse()
    }

    fn level(&self, id: ExampleId, segment: u32, side: u32) -> Result<Level, StoreError> {
        self.packed(id, segment)?.of(id, segment).level(side)
    }

    fn chart(&self, id: ExampleId, segment: u32) -> Result<ChartRecord, StoreError> {
        self.packed(id, segment)?.of(id, segment).chart()
    }

    fn missing_derived(&self, encoder_version: u32) -> Vec<(ExampleId, u32)> {
        let state = self.inner.state();
        let sound = state.examples().filter(|known| state.damage(known.record.id).is_none());
        let missing = sound.flat_map(|known| {
            let numbered = (0u32..).zip(&known.encodings);
            let old = |encoding: &Option<Encoding>| encoding.is_none_or(|e| e.encoder_version < encoder_version);
            numbered.filter(move |(_, encoding)| old(encoding)).map(|(segment, _)| (known.record.id, segment))
        });
        missing.collect()
    }

    fn rows(&self) -> Vec<(ExampleId, SegmentRow)> {
        let rows = self.inner.state_mut().take_rows();
        rows.into_iter().flat_map(|(id, rows)| rows.into_iter().map(move |row| (id, row))).collect()
    }

    fn rows_of(&self, id: ExampleId) -> Vec<SegmentRow> {
        self.inner.state_mut().take_rows_of(id)
    }

    /// The engine has them already.
    fn put_rows(&self, _rows: &mut dyn Iterator<Item = (ExampleId, SegmentRow)>) -> Result<(), StoreError> {
        Ok(())
    }

    fn check(&self, progress: &mut dyn FnMut(usize)) -> Result<CheckReport, StoreError> {
        let mut report = CheckReport::default();
        let ids: Vec<ExampleId> = self.inner.state().examples().map(|known| known.record.id).collect();
        for id in ids {
            self.check_example(id, &mut report)?;
            progress(report.examples);
        }
        Ok(report)
    }

    fn scrub(&self, id: ExampleId) -> Result<Vec<Problem>, StoreError> {
        let mut report = CheckReport::default();
        self.check_example(id, &mut report)?;
        for problem in &report.problems {
            if let Problem::Ground { id, reason } = problem {
                self.inner.change(|state| state.quarantine(*id, reason));
            }
        }
        Ok(report.problems)
    }

    fn quarantined(&self) -> Vec<(ExampleId, String)> {
        self.inner.state().damaged()
    }

    fn unwritable(&self) -> Option<String> {
        let unsure = self.following().unsure_ms;
        (unsure > UNSURE_MAX.as_millis() as u64)
            .then(|| format!("expected the cluster's engine to answer, found it silent for {} s", unsure / 1000))
    }

    fn whole(&self, id: ExampleId) -> Result<Whole, StoreError> {
        self.get(id)?;
        let known = self.inner.state().example(id).cloned().ok_or(StoreError::NotFound { id })?;
        self.whole_of(&known)
    }

    fn put_whole(&self, whole: Whole) -> Result<Added, StoreError> {
        validate(&whole.record)?;
        if let Some(found) = whole.fault() {
            let expected = "to match its record".into();
            return Err(StoreError::Invalid { field: "an example", expected, found });
        }
        if let Some(there) = self.sound_by(whole.record.identity) {
            return Ok(Added::Exists(there));
        }
        let mut segments = vec![None; whole.record.segments.len()];
        for (segment, packed) in &whole.segments {
            if let Some(place) = segments.get_mut(*segment as usize) {
                let row = self.row_maker.as_ref().and_then(|make| make(&whole.record, *segment, packed));
                *place = Some(self.put_packed(packed, row)?);
            }
        }
        let objects: Vec<&[u8]> = whole.objects.iter().map(Vec::as_slice).collect();
        self.add_entry(Arc::unwrap_or_clone(whole.record), &objects, segments)
    }

    fn changes(&self, position: u64) -> Changes {
        self.inner.state().log().after(position)
    }

    fn subscribe(&self, listener: Listener) {
        self.inner.subscribe(listener);
    }

    fn reached(&self) -> u64 {
        self.inner.progress().position.max(self.inner.state().newest())
    }

    fn wait_for(&self, position: u64, time: Duration) -> bool {
        self.inner.wait_for(position, time)
    }

    fn following(&self) -> Following {
        self.inner.following()
    }

    fn documents(self: Arc<Self>) -> Option<Arc<dyn Documents>> {
        Some(self)
    }

    fn backup(&self, writer: &mut dyn Write) -> Result<BackupReport, StoreError> {
        // An example that is removed from now on keeps its objects until they are collected: it is in the backup, too.
        let (known, skipped) = {
            let state = self.inner.state();
            let sound = state.examples().filter(|known| state.damage(known.record.id).is_none());
            (sound.map(|known| (known.record.id, known.clone())).collect::<BTreeMap<_, _>>(), state.damaged())
        };
        let records: Vec<_> = known.values().map(|known| Arc::clone(&known.record)).collect();
        let whole = |record: &ExampleRecord| {
            known.get(&record.id).ok_or(StoreError::NotFound { id: record.id }).and_then(|known| self.whole_of(known))
        };
        quadmuse_store::write_backup_of(&records, skipped, &whole, writer)
    }
}

fn is_of(manifest: &Manifest, id: ExampleId) -> bool {
    manifest.record.as_ref().is_some_and(|record| record.id == id)
}

impl Documents for SharedCorpus {
    fn known(&self, name: &str) -> Option<Document> {
        self.inner.state().document(name)
    }

    fn read(&self, name: &str) -> Result<Option<Document>, StoreError> {
        let found = self.read_newest(&format!("{DOCUMENT}{name}"), "give a document")?;
        Ok(found.map(documents::document))
    }

    fn write(&self, name: &str, expected: u64, bytes: &[u8]) -> Result<bool, StoreError> {
        let written = documents::write(&*self.engine, name, expected, bytes)?;
        if let Some(position) = written {
            self.inner.wrote(&format!("{DOCUMENT}{name}"), &Entry { position, bytes: bytes.to_vec() });
        }
        Ok(written.is_some())
    }
}
