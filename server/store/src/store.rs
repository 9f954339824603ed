//! The store as the server sees it. Every call blocks: call from a thread that may wait, never from one of tokio's workers.

use std::borrow::Cow;
use std::fs::{self, File, TryLockError};
use std::path::Path;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use quadmuse_proto::id::ExampleId;

use crate::derived::{self, ChartRecord, Coarse, DerivedSegment, Level, PackedLevels};
use crate::engine::{Engine, Pointer, Reader};
use crate::error::StoreError;
use crate::files::{Ground, Objects, create_dir};
use crate::index::{Filter, Page, Snapshot};
use crate::keys::SegmentKey;
use crate::record::{
    ContentHash, ExampleRecord, NewSegmentation, Patch, SegmentSummary, Segmentation, identity, invalid, label_bytes,
    normalise, validate,
};
use crate::recover::{self, OpenReport};
use crate::shared::{OpenOptions, Shared};
use crate::spare;
use crate::writer::{Done, NewRows, Packed, QUEUE_MAX, Request, Work, Writer, close};

/// Most examples of one page of a list.
pub const LIST_MAX: usize = 500;
pub(crate) const LOCK_FILE: &str = "lock";
/// There while a restore has not ended.
pub(crate) const RESTORING: &str = "restoring";
/// How long a write waits for room in the queue.
const QUEUE_WAIT: Duration = Duration::from_secs(5);
/// Bytes that a write may need beside its payload (the database grows by whole segments).
const OVERHEAD_BYTES: u64 = 1 << 20;

/// An example to be added.
#[derive(Clone, Debug)]
pub struct NewExample<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its tags, in any order.
    pub tags: &'a [String],
    /// Its relevance, 0–5.
    pub relevance: f32,
    /// The format of `mesh` (`obj`, `ply`, …).
    pub format: &'a str,
    /// The mesh as uploaded (unpacked).
    pub mesh: &'a [u8],
    /// How it was to be cut.
    pub segmentation: NewSegmentation<'a>,
    /// Its segments.
    pub segments: &'a [SegmentSummary],
    /// Vertices of the mesh.
    pub vertices: u32,
    /// Polygons of the mesh.
    pub faces: u32,
    /// What was repaired when it was read.
    pub repairs: &'a [String],
    /// Version of the encoder that made `derived`.
    pub encoder_version: u32,
    /// The encoding of each segment.
    pub derived: &'a [DerivedSegment],
}

/// What adding came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Added {
    /// It is new.
    Created(Arc<ExampleRecord>),
    /// The same mesh with the same options was there already, as this example.
    Exists(Arc<ExampleRecord>),
}

impl Added {
    /// The example, new or not.
    pub fn record(&self) -> &Arc<ExampleRecord> {
        let (Added::Created(record) | Added::Exists(record)) = self;
        record
    }
}

/// The corpus on disk. Cheap to clone; the last clone to go closes it.
#[derive(Clone)]
pub struct Store {
    handle: Arc<Handle>,
}

struct Handle {
    shared: Arc<Shared>,
    requests: Option<SyncSender<Request>>,
    writer: Option<JoinHandle<()>>,
    /// Held while the store is open, so that no other process opens it.
    _lock: File,
    report: Mutex<OpenReport>,
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(writer) = self.writer.take() {
            // It returns what it panicked with: nothing to be done about it here.
            let _ = writer.join();
        }
        let engine = self.shared.engine.write().unwrap_or_else(PoisonError::into_inner).take();
        engine.map(close);
    }
}

impl Store {
    /// Opens the store in `dir`, or creates it. Migrates an older one, mends what an interrupted process left, and builds the index anew
    /// when it can't be read.
    ///
    /// # Errors
    /// [`StoreError::Newer`] for a store of a newer release, without changing a byte; [`StoreError::Locked`] if another process has it open;
    /// [`StoreError::NoRoom`] on a full disk, where the room kept for that is gone, too; [`StoreError::Migration`], [`StoreError::Io`] and
    /// [`StoreError::Engine`] if it can't be opened.
    pub fn open(dir: &Path, options: &OpenOptions) -> Result<(Store, OpenReport), StoreError> {
        Self::open_dir(dir, options).map_err(|error| match error.is_full() {
            true => StoreError::NoRoom {
                dir: dir.to_path_buf(),
                available: options.available(dir),
                wanted: options.opening_bytes() + options.spare_bytes,
                source: Box::new(error),
            },
            false => error,
        })
    }

    fn open_dir(dir: &Path, options: &OpenOptions) -> Result<(Store, OpenReport), StoreError> {
        let begun = Instant::now();
        check_schema(dir)?;
        let existed = dir.join(quadmuse_migrations::SCHEMA_FILE).exists();
        create_dir(dir)?;
        let lock = lock_dir(dir)?;
        if dir.join(RESTORING).exists() && !options.restores {
            return Err(StoreError::HalfRestored { dir: dir.to_path_buf() });
        }
        let collect = recover::may_collect(dir, existed, options.keeps_files)?;
        quadmuse_migrations::mark(dir)?;
        let (objects, ground) = (Objects::new(dir.join("objects")), Ground::new(dir.join("ground")));
        create_dir(objects.dir())?;
        create_dir(ground.dir())?;
        let load = || recover::load(dir, options, &ground, &objects, collect);
        let ((engine, index, mut report), is_short) = spare::used_if_full(dir, options, load)?;
        report.took_ms = begun.elapsed().as_millis() as u64;
        let shared = Arc::new(Shared::new(dir.to_path_buf(), options.clone(), objects, ground, engine, index));
        if is_short {
            shared.suspend_full();
        } else {
            spare::keep(dir, options);
        }
        let (requests, receiver) = sync_channel(QUEUE_MAX);
        let writer = Writer { shared: shared.clone(), requests: receiver, tried: Instant::now() };
        let thread = std::thread::Builder::new().name("store-writer".into()).spawn(move || writer.run());
        let writer = Some(thread.map_err(StoreError::io("start the writer of", dir))?);
        let handle =
            Handle { shared, requests: Some(requests), writer, _lock: lock, report: Mutex::new(report.clone()) };
        Ok((Store { handle: Arc::new(handle) }, report))
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.handle.shared
    }

    /// What opening found and mended.
    pub fn open_report(&self) -> OpenReport {
        self.handle.report.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn submit(&self, work: Work) -> Result<Done, StoreError> {
        let (reply, answer) = sync_channel(1);
        let requests = self.handle.requests.as_ref().ok_or(StoreError::Closed)?;
        let mut request = Request { work, reply };
        let begun = Instant::now();
        loop {
            match requests.try_send(request) {
                Ok(()) => break,
                Err(TrySendError::Disconnected(_)) => return Err(StoreError::Closed),
                Err(TrySendError::Full(_)) if begun.elapsed() > QUEUE_WAIT => return Err(StoreError::Busy),
                Err(TrySendError::Full(refused)) => request = refused,
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        answer.recv().map_err(|_| StoreError::Closed)?
    }

    /// The example that adding this mesh with these options would come to, if it is there and whole: worth a look before encoding.
    pub fn find(
        &self,
        mesh: &[u8],
        segmentation: NewSegmentation<'_>,
        poles: impl IntoIterator<Item = Option<u32>>,
    ) -> Option<Arc<ExampleRecord>> {
        let identity = identity(ContentHash::of(mesh), segmentation, poles);
        let index = self.shared().index();
        index.by_identity(identity).filter(|record| index.quarantine_reason(record.id).is_none()).cloned()
    }

    /// Whether the example that adding this mesh with these options would come to is there, but damaged: adding it heals it.
    pub fn is_damaged(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> bool {
        let identity = identity(ContentHash::of(mesh), segmentation, None);
        let index = self.shared().index();
        index.by_identity(identity).is_some_and(|record| index.quarantine_reason(record.id).is_some())
    }

    /// Adds an example with its encodings. On return it is durable, power cuts included. The same mesh with the same options is the
    /// same example; a quarantined one is healed by it.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] outside the limits, [`StoreError::Full`], [`StoreError::ReadOnly`], [`StoreError::Busy`].
    pub fn add(&self, new: &NewExample<'_>) -> Result<Added, StoreError> {
        let (record, labels) = new_record(new)?;
        if let Some(existing) = self.existing(record.identity) {
            return Ok(Added::Exists(existing));
        }
        let packed = |(number, derived)| Ok((number, Packed::new(new.encoder_version, derived::pack(derived)?)));
        let segments = (0u32..).zip(new.derived).map(packed).collect::<Result<Vec<_>, StoreError>>()?;
        self.add_packed(record, new.mesh, labels.as_deref(), segments)
    }

    fn existing(&self, identity: ContentHash) -> Option<Arc<ExampleRecord>> {
        let index = self.shared().index();
        index.by_identity(identity).filter(|record| index.quarantine_reason(record.id).is_none()).cloned()
    }

    /// Adds an example whose segments, each with its number, are packed already.
    pub(crate) fn add_packed(
        &self,
        record: ExampleRecord,
        mesh: &[u8],
        labels: Option<&[u8]>,
        segments: Vec<(u32, Packed)>,
    ) -> Result<Added, StoreError> {
        let shared = self.shared();
        if shared.fault().is_some() {
            return Err(shared.read_only());
        }
        let derived: u64 = segments.iter().map(|(_, packed)| packed.pointer.bytes()).sum();
        let needed = mesh.len() as u64 + labels.map_or(0, |labels| labels.len() as u64) + 2 * derived + OVERHEAD_BYTES;
        shared.check_space(needed)?;
        let held = shared.hold(record.objects().collect());
        let put = |hash, bytes| shared.objects.put(hash, bytes).map_err(|error| shared.as_full(error, needed));
        put(record.content_hash, mesh)?;
        if let (Some(object), Some(labels)) = (record.segmentation.labels(), labels) {
            put(object, labels)?;
        }
        match self.submit(Work::Add(NewRows { record: Arc::new(record), segments, held }))? {
            Done::Added(added) => Ok(added),
            Done::AddedAll(_) | Done::Annotated(_) | Done::Unit => Err(StoreError::Closed),
        }
    }

    /// Adds many examples by one commit, as [`Store::add`] does one by one: all of them are durable on return.
    ///
    /// # Errors
    /// As [`Store::add`]; none is added then.
    pub fn add_all(&self, new: &[NewExample<'_>]) -> Result<Vec<Added>, StoreError> {
        let shared = self.shared();
        if shared.fault().is_some() {
            return Err(shared.read_only());
        }
        let mut alike = PackedLevels::default();
        let mut pack = |example: &NewExample<'_>| {
            let packed = |(number, derived)| {
                let parts = derived::pack_beside(derived, &mut alike)?;
                Ok((number, Packed::new(example.encoder_version, parts)))
            };
            (0u32..).zip(example.derived).map(packed).collect::<Result<Vec<_>, StoreError>>()
        };
        let packed = new.iter().map(&mut pack).collect::<Result<Vec<_>, StoreError>>()?;
        let mut rows = Vec::with_capacity(new.len());
        let mut objects: Vec<(ContentHash, Cow<'_, [u8]>)> = Vec::new();
        let mut needed = OVERHEAD_BYTES;
        // The ids are given when all is packed: those of one commit then follow each other, and so do its rows in the
        // index, which would otherwise lie among those of another and be written again with them.
        for (example, segments) in new.iter().zip(packed) {
            let (record, labels) = new_record(example)?;
            needed += example.mesh.len() as u64 + labels.as_ref().map_or(0, |labels| labels.len() as u64);
            needed += segments.iter().map(|(_, packed)| 2 * packed.pointer.bytes()).sum::<u64>();
            objects.push((record.content_hash, Cow::Borrowed(example.mesh)));
            if let (Some(object), Some(labels)) = (record.segmentation.labels(), labels) {
                objects.push((object, Cow::Owned(labels)));
            }
            let held = shared.hold(record.objects().collect());
            rows.push(NewRows { record: Arc::new(record), segments, held });
        }
        shared.check_space(needed)?;
        shared.objects.put_all(objects.into_iter()).map_err(|error| shared.as_full(error, needed))?;
        match self.submit(Work::AddAll(rows))? {
            Done::AddedAll(added) => Ok(added),
            Done::Added(_) | Done::Annotated(_) | Done::Unit => Err(StoreError::Closed),
        }
    }

    /// An example.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Quarantined`].
    pub fn get(&self, id: ExampleId) -> Result<Arc<ExampleRecord>, StoreError> {
        let index = self.shared().index();
        if let Some(reason) = index.quarantine_reason(id) {
            return Err(StoreError::Quarantined { id, reason: reason.to_owned() });
        }
        index.record(id).cloned().ok_or(StoreError::NotFound { id })
    }

    /// Up to `limit` (at most [`LIST_MAX`]) examples after `after`, in order of creation. Quarantined ones are left out.
    pub fn list(&self, after: Option<ExampleId>, limit: usize, filter: Filter<'_>) -> Page {
        self.shared().index().list(after, limit.clamp(1, LIST_MAX), filter)
    }

    /// The examples whose ground state is damaged, and how.
    pub fn quarantined(&self) -> Vec<(ExampleId, String)> {
        self.shared().index().quarantined().iter().map(|(&id, reason)| (id, reason.clone())).collect()
    }

    /// The whole corpus at this moment: what a query ranks against.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.shared().index_mut().snapshot()
    }

    /// Waits until the corpus is newer than revision `known`, at most for `timeout`; its revision then.
    pub fn wait_newer(&self, known: u64, timeout: Duration) -> u64 {
        self.shared().wait_newer(known, timeout)
    }

    /// Changes name, tags or relevance. Durable on return.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Quarantined`], [`StoreError::Invalid`], [`StoreError::ReadOnly`], [`StoreError::Full`].
    pub fn annotate(&self, id: ExampleId, patch: Patch) -> Result<Arc<ExampleRecord>, StoreError> {
        patch.apply(&*self.get(id)?)?;
        self.shared().check_space(OVERHEAD_BYTES)?;
        match self.submit(Work::Annotate { id, patch })? {
            Done::Annotated(record) => Ok(record),
            Done::Added(_) | Done::AddedAll(_) | Done::Unit => Err(StoreError::Closed),
        }
    }

    /// Removes an example, quarantined or not. Durable on return. Works on a full disk.
    ///
    /// # Errors
    /// [`StoreError::NotFound`]; [`StoreError::ReadOnly`] while writing is suspended and another example shares the mesh.
    pub fn remove(&self, id: ExampleId) -> Result<(), StoreError> {
        self.submit(Work::Remove { id }).map(drop)
    }

    /// The mesh as uploaded, checked against its hash.
    ///
    /// # Errors
    /// [`StoreError::NotFound`]; [`StoreError::Quarantined`] if it is damaged (the example is quarantined from then on); [`StoreError::Io`].
    pub fn mesh_bytes(&self, id: ExampleId) -> Result<Vec<u8>, StoreError> {
        let record = self.get(id)?;
        self.object(id, record.content_hash)
    }

    pub(crate) fn object(&self, id: ExampleId, hash: ContentHash) -> Result<Vec<u8>, StoreError> {
        self.shared().objects.get(hash)?.map_err(|reason| {
            // The example may have been removed since its record was read.
            if self.shared().index().record(id).is_none() {
                return StoreError::NotFound { id };
            }
            tracing::error!(%id, reason, "an example is quarantined");
            self.shared().quarantine(id, &reason);
            StoreError::Quarantined { id, reason }
        })
    }

    /// The user's labels, or the part of each face, one a face; `None` if the mesh was cut in another way.
    ///
    /// # Errors
    /// As [`Store::mesh_bytes`].
    pub fn labels(&self, id: ExampleId) -> Result<Option<Vec<u32>>, StoreError> {
        let record = self.get(id)?;
        let Some(object) = record.segmentation.labels() else { return Ok(None) };
        let bytes = self.object(id, object)?;
        Ok(Some(bytes.as_chunks::<4>().0.iter().map(|&bytes| u32::from_le_bytes(bytes)).collect()))
    }

    /// Replaces the encoding of a segment; the former one answers until this returns. Durable on return.
    ///
    /// # Errors
    /// As [`Store::add`], and [`StoreError::NotFound`].
    pub fn put_derived(
        &self,
        id: ExampleId,
        segment: u32,
        encoder_version: u32,
        derived: &DerivedSegment,
    ) -> Result<(), StoreError> {
        self.get(id)?;
        let packed = Packed::new(encoder_version, derived::pack(derived)?);
        self.shared().check_space(2 * packed.pointer.bytes() + OVERHEAD_BYTES)?;
        self.submit(Work::PutDerived { key: (id, segment), packed }).map(drop)
    }

    /// Version of the encoder that made the encoding of a segment; `None` if there is none.
    pub fn encoder_version(&self, id: ExampleId, segment: u32) -> Option<u32> {
        self.shared().index().pointer((id, segment)).map(|pointer| pointer.encoder_version)
    }

    /// Segments (of examples that are not quarantined) whose encoding is missing or older than `encoder_version`.
    pub fn missing_derived(&self, encoder_version: u32) -> Vec<(ExampleId, u32)> {
        recover::missing_derived(&self.shared().index(), encoder_version)
    }

    fn pointer(&self, key: SegmentKey) -> Result<Arc<Pointer>, StoreError> {
        let (id, segment) = key;
        self.get(id)?;
        self.shared().index().pointer(key).cloned().ok_or(StoreError::MissingDerived { id, segment })
    }

    /// Reads from the encoding of a segment. An encoding that was replaced meanwhile is read once more.
    fn read<T>(&self, key: SegmentKey, read: impl Fn(&Reader<'_>) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let pointer = self.pointer(key)?;
        let result = self.read_at(key, &pointer, &read);
        if result.is_err() {
            let newer = self.pointer(key)?;
            if newer.generation() != pointer.generation() {
                return self.read_at(key, &newer, &read);
            }
        }
        result
    }

    fn read_at<T>(
        &self,
        key: SegmentKey,
        pointer: &Pointer,
        read: impl Fn(&Reader<'_>) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let engine: Arc<Engine> = self.shared().engine()?;
        read(&Reader { engine: &engine, key, pointer, on_failure: &|failure| self.shared().failed(failure) })
    }

    /// The encoding of a segment, whole.
    ///
    /// # Errors
    /// [`StoreError::MissingDerived`] and [`StoreError::DamagedDerived`]: encode the segment from its mesh; [`StoreError::NotFound`], [`StoreError::Quarantined`].
    pub fn derived(&self, id: ExampleId, segment: u32) -> Result<DerivedSegment, StoreError> {
        self.read((id, segment), |reader| derived::read_all(reader))
    }

    /// What a search keeps in memory of a segment.
    ///
    /// # Errors
    /// As [`Store::derived`].
    pub fn coarse(&self, id: ExampleId, segment: u32) -> Result<Coarse, StoreError> {
        self.read((id, segment), |reader| derived::read_coarse(reader))
    }

    /// One level of a segment's pyramid; nothing else is read.
    ///
    /// # Errors
    /// As [`Store::derived`], and [`StoreError::NoSuchLevel`].
    pub fn level(&self, id: ExampleId, segment: u32, side: u32) -> Result<Level, StoreError> {
        let pointer = self.pointer((id, segment))?;
        if !derived::has_level(|kind| pointer.has(kind), side) {
            return Err(StoreError::NoSuchLevel { id, segment, side });
        }
        self.read((id, segment), |reader| derived::read_level(reader, side))
    }

    /// One level of many segments, in their order; each may fail by itself.
    pub fn levels(&self, segments: &[(ExampleId, u32)], side: u32) -> Vec<Result<Level, StoreError>> {
        segments.iter().map(|&(id, segment)| self.level(id, segment, side)).collect()
    }

    /// The chart of a segment.
    ///
    /// # Errors
    /// As [`Store::derived`].
    pub fn chart(&self, id: ExampleId, segment: u32) -> Result<ChartRecord, StoreError> {
        self.read((id, segment), |reader| derived::read_chart(reader))
    }

    /// Whether writing is suspended, and why.
    pub fn suspended(&self) -> Option<String> {
        self.shared().fault().map(|fault| fault.reason)
    }

    /// Why a new example would be refused now, if it would be: writing is suspended, or space is short.
    pub fn unwritable(&self) -> Option<String> {
        self.suspended().or_else(|| self.shared().check_space(OVERHEAD_BYTES).err().map(|error| error.to_string()))
    }

    /// Writes a fresh copy of the index without garbage. Needs free space for it; readers wait a moment, writers until it is done.
    ///
    /// # Errors
    /// [`StoreError::Full`], [`StoreError::ReadOnly`], [`StoreError::Engine`].
    pub fn compact(&self) -> Result<(), StoreError> {
        self.submit(Work::Compact).map(drop)
    }

    /// Closes and reopens the index. Worth it after a large import: the first opening after one reads all that was written, and
    /// this way it isn't the next start of the service that waits. Readers wait meanwhile.
    ///
    /// # Errors
    /// [`StoreError::ReadOnly`], [`StoreError::Engine`].
    pub fn reopen(&self) -> Result<(), StoreError> {
        self.submit(Work::Reopen).map(drop)
    }
}

fn check_schema(dir: &Path) -> Result<(), StoreError> {
    match quadmuse_migrations::check(dir) {
        Ok(_) => Ok(()),
        Err(quadmuse_migrations::MigrationError::Newer { found, supported }) => {
            Err(StoreError::Newer { found, supported })
        }
        Err(error) => Err(error.into()),
    }
}

fn lock_dir(dir: &Path) -> Result<File, StoreError> {
    let path = dir.join(LOCK_FILE);
    let file = fs::OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        .map_err(StoreError::io("open", &path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(StoreError::Locked { dir: dir.to_path_buf() }),
        Err(TryLockError::Error(error)) => Err(StoreError::io("lock", &path)(error)),
    }
}

/// The record of a new example with a fresh id, and its labels as an object.
///
/// # Errors
/// [`StoreError::Invalid`] outside the limits.
pub fn new_record(new: &NewExample<'_>) -> Result<(ExampleRecord, Option<Vec<u8>>), StoreError> {
    if new.derived.len() != new.segments.len() || new.derived.is_empty() {
        let found = format!("{} encodings of {} segments", new.derived.len(), new.segments.len());
        return Err(invalid("the encodings", "one a segment, and at least one".into(), found));
    }
    let content_hash = ContentHash::of(new.mesh);
    let (segmentation, labels) = match new.segmentation {
        NewSegmentation::Auto => (Segmentation::Auto, None),
        NewSegmentation::Whole => (Segmentation::Whole, None),
        NewSegmentation::Groups => (Segmentation::Groups, None),
        NewSegmentation::Labels(labels) => {
            let bytes = label_bytes(labels);
            (Segmentation::Labels { object: ContentHash::of(&bytes), faces: labels.len() as u32 }, Some(bytes))
        }
        NewSegmentation::Parted(parts) => {
            let bytes = label_bytes(parts);
            (Segmentation::Parted { object: ContentHash::of(&bytes), faces: parts.len() as u32 }, Some(bytes))
        }
    };
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let mut record = ExampleRecord {
        id: ExampleId::generate(),
        revision: 1,
        name: new.name.to_owned(),
        tags: new.tags.to_vec(),
        relevance: new.relevance,
        format: new.format.to_owned(),
        content_hash,
        identity: identity(content_hash, new.segmentation, new.segments.iter().map(|segment| segment.pole_override)),
        bytes: new.mesh.len() as u64,
        created_unix_ms: now.as_millis() as u64,
        segmentation,
        segments: new.segments.to_vec(),
        vertices: new.vertices,
        faces: new.faces,
        repairs: new.repairs.to_vec(),
        author: String::new(),
        licence: String::new(),
        notes: String::new(),
        landmarks: Vec::new(),
    };
    normalise(&mut record);
    validate(&record)?;
    Ok((record, labels))
}
