//! The seam: what a corpus is to the service, wherever it lies.
//!
//! A [`Store`] on this machine's disk is one backend, a corpus that several servers share on a replicated engine another
//! (`quadmuse-cluster`). What holds of all of them is one suite of tests, `tests/support/conformance.rs`:
//!
//! - What was answered is kept, and is seen by whoever asks the same backend afterwards.
//! - Objects are named by their content: the same mesh with the same options is the same example, whoever adds it.
//! - A record has a revision; a change that names an older one is refused with the revision there is.
//! - Changes come as a stream with positions; who has followed it to its end has the corpus as it is.
//!
//! Tokens, the audit log and idempotency keys are the server's; a backend that servers share keeps a document for them
//! ([`Documents`]). Opening, locking, migrating, compacting and mending files are a store's own business.

use std::io::Write;
use std::sync::Arc;

use quadmuse_proto::id::ExampleId;

use crate::backup::{self, BackupReport};
use crate::changes::Changes;
use crate::check::{CheckReport, Problem};
use crate::derived::{ChartRecord, Coarse, DerivedSegment, Level};
use crate::error::StoreError;
use crate::index::Snapshot;
use crate::packed::PackedSegment;
use crate::record::{ContentHash, ExampleRecord, NewSegmentation, Patch};
use crate::rows::SegmentRow;
use crate::store::{Added, NewExample, Store};

/// An example with all that is kept of it, as it goes from one corpus to another.
#[derive(Clone, Debug, PartialEq)]
pub struct Whole {
    /// Its record, id and revision included.
    pub record: Arc<ExampleRecord>,
    /// Its objects, in the order in which the record names them: the mesh, then the labels if there are any.
    pub objects: Vec<Vec<u8>>,
    /// Its encodings, each with its segment's number; those that are missing or damaged are left out.
    pub segments: Vec<(u32, PackedSegment)>,
}

impl Whole {
    /// What is wrong with it, if something is: objects that don't match their hashes, or encodings of segments that the
    /// record hasn't.
    pub fn fault(&self) -> Option<String> {
        let id = self.record.id;
        let found: Vec<ContentHash> = self.objects.iter().map(|object| ContentHash::of(object)).collect();
        if self.record.objects().collect::<Vec<_>>() != found {
            return Some(format!("the mesh of {id} not matching its hash"));
        }
        let count = self.record.segments.len();
        let beyond = self.segments.iter().any(|(segment, _)| *segment as usize >= count);
        beyond.then(|| format!("an encoding of a segment {id} doesn't have"))
    }
}

/// Told the position of the newest change, whenever there is one.
pub type Listener = Box<dyn Fn(u64) + Send + Sync>;

/// How well a backend knows what others changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Following {
    /// Changes of others that are not seen yet, as far as is known.
    pub behind: u64,
    /// Milliseconds since it was last known to be up to date; 0 where nobody else writes.
    pub unsure_ms: u64,
}

/// A corpus. Every call blocks; call from a thread that may wait.
pub trait Backend: Send + Sync + 'static {
    /// Every example that is whole, in order of creation.
    fn snapshot(&self) -> Arc<Snapshot>;

    /// An example.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Quarantined`].
    fn get(&self, id: ExampleId) -> Result<Arc<ExampleRecord>, StoreError>;

    /// The example that adding this mesh with these options would come to, if it is there and whole.
    fn find(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> Option<Arc<ExampleRecord>>;

    /// Whether that example is there, but damaged: adding it heals it.
    fn is_damaged(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> bool;

    /// Adds an example with its encodings, and with the row that a search keeps of each segment, or with none (`rows` is
    /// empty then). Durable on return. The same mesh with the same options is the same example.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] outside the limits; [`StoreError::Full`], [`StoreError::ReadOnly`], [`StoreError::Busy`],
    /// [`StoreError::Unreachable`] if it is not known to be kept.
    fn add(&self, new: &NewExample<'_>, rows: &[Vec<u8>]) -> Result<Added, StoreError>;

    /// Changes name, tags or relevance. Durable on return.
    ///
    /// # Errors
    /// As [`Backend::add`], [`StoreError::NotFound`], and [`StoreError::Conflict`] if the patch was made for another revision.
    fn annotate(&self, id: ExampleId, patch: Patch) -> Result<Arc<ExampleRecord>, StoreError>;

    /// Removes an example. Durable on return.
    ///
    /// # Errors
    /// As [`Backend::add`], and [`StoreError::NotFound`].
    fn remove(&self, id: ExampleId) -> Result<(), StoreError>;

    /// The mesh as uploaded, checked against its hash.
    ///
    /// # Errors
    /// [`StoreError::NotFound`], [`StoreError::Quarantined`], [`StoreError::Io`], [`StoreError::Unreachable`].
    fn mesh_bytes(&self, id: ExampleId) -> Result<Vec<u8>, StoreError>;

    /// The user's labels, or the part of each face; `None` if the mesh was cut in another way.
    ///
    /// # Errors
    /// As [`Backend::mesh_bytes`].
    fn labels(&self, id: ExampleId) -> Result<Option<Vec<u32>>, StoreError>;

    /// Replaces the encoding of a segment, and its row. Durable on return.
    ///
    /// # Errors
    /// As [`Backend::annotate`].
    fn put_derived(
        &self,
        id: ExampleId,
        segment: u32,
        encoder_version: u32,
        derived: &DerivedSegment,
        row: Option<Vec<u8>>,
    ) -> Result<(), StoreError>;

    /// What a search keeps in memory of a segment.
    ///
    /// # Errors
    /// [`StoreError::MissingDerived`], [`StoreError::DamagedDerived`], [`StoreError::NotFound`], [`StoreError::Quarantined`],
    /// [`StoreError::Unreachable`].
    fn coarse(&self, id: ExampleId, segment: u32) -> Result<Coarse, StoreError>;

    /// One level of a segment's pyramid, of `side` pixels a side.
    ///
    /// # Errors
    /// As [`Backend::coarse`], and [`StoreError::NoSuchLevel`].
    fn level(&self, id: ExampleId, segment: u32, side: u32) -> Result<Level, StoreError>;

    /// The chart of a segment.
    ///
    /// # Errors
    /// As [`Backend::coarse`].
    fn chart(&self, id: ExampleId, segment: u32) -> Result<ChartRecord, StoreError>;

    /// Segments whose encoding is missing or older than `encoder_version`.
    fn missing_derived(&self, encoder_version: u32) -> Vec<(ExampleId, u32)>;

    /// The rows that are known at a start, in no order. They are handed out once.
    fn rows(&self) -> Vec<(ExampleId, SegmentRow)>;

    /// The rows that came with a change of an example, once: afterwards they are the caller's to keep.
    fn rows_of(&self, id: ExampleId) -> Vec<SegmentRow>;

    /// Writes rows down for the next start, where that is worth it.
    ///
    /// # Errors
    /// [`StoreError::Full`], [`StoreError::Io`].
    fn put_rows(&self, rows: &mut dyn Iterator<Item = (ExampleId, SegmentRow)>) -> Result<(), StoreError>;

    /// Reads everything and compares it with its checksums; changes nothing.
    ///
    /// # Errors
    /// [`StoreError::Io`], [`StoreError::ReadOnly`], [`StoreError::Unreachable`].
    fn check(&self, progress: &mut dyn FnMut(usize)) -> Result<CheckReport, StoreError>;

    /// Checks one example, and mends or sets aside what is damaged.
    ///
    /// # Errors
    /// As [`Backend::check`].
    fn scrub(&self, id: ExampleId) -> Result<Vec<Problem>, StoreError>;

    /// The examples whose ground state is damaged, and how.
    fn quarantined(&self) -> Vec<(ExampleId, String)>;

    /// Why a new example would be refused now, if it would be.
    fn unwritable(&self) -> Option<String>;

    /// An example with all that is kept of it.
    ///
    /// # Errors
    /// As [`Backend::mesh_bytes`].
    fn whole(&self, id: ExampleId) -> Result<Whole, StoreError>;

    /// Adds an example as another corpus had it: its id, its revision and its encodings stay.
    ///
    /// # Errors
    /// As [`Backend::add`]; [`StoreError::Invalid`] if it doesn't match its own record.
    fn put_whole(&self, whole: Whole) -> Result<Added, StoreError>;

    /// What changed after `position`.
    fn changes(&self, position: u64) -> Changes;

    /// Calls `listener` after every change.
    fn subscribe(&self, listener: Listener);

    /// The newest change that is known here, by a number that all who share the corpus count alike; 0 where nobody does.
    fn reached(&self) -> u64 {
        0
    }

    /// Waits until a change with such a number is known here, for `time` at most; whether it is.
    fn wait_for(&self, _position: u64, _time: std::time::Duration) -> bool {
        true
    }

    /// How well it knows what others changed.
    fn following(&self) -> Following {
        Following::default()
    }

    /// Where servers that share this corpus keep what is theirs; `None` where there is one server, which keeps it in files.
    fn documents(self: Arc<Self>) -> Option<Arc<dyn Documents>> {
        None
    }

    /// Writes the whole corpus, as it is at this moment, to `writer`.
    ///
    /// # Errors
    /// [`StoreError::Io`] if writing or reading fails, and as [`Backend::whole`].
    fn backup(&self, writer: &mut dyn Write) -> Result<BackupReport, StoreError>;
}

/// A document's contents with its revision.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Document {
    /// Grows with every change; 0: there never was one.
    pub revision: u64,
    /// What it says.
    pub bytes: Arc<[u8]>,
}

/// Small documents that servers share beside the corpus, such as the list of tokens.
pub trait Documents: Send + Sync + 'static {
    /// A document as this server knows it; `None` if there never was one.
    fn known(&self, name: &str) -> Option<Document>;

    /// A document as it is now, asked of the engine.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`].
    fn read(&self, name: &str) -> Result<Option<Document>, StoreError>;

    /// Writes a document unless it has another revision than `expected` (0: none yet); whether it was written. Durable on
    /// return.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`], [`StoreError::Invalid`] if it is too long.
    fn write(&self, name: &str, expected: u64, bytes: &[u8]) -> Result<bool, StoreError>;
}

impl Backend for Store {
    fn snapshot(&self) -> Arc<Snapshot> {
        Store::snapshot(self)
    }

    fn get(&self, id: ExampleId) -> Result<Arc<ExampleRecord>, StoreError> {
        Store::get(self, id)
    }

    fn find(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> Option<Arc<ExampleRecord>> {
        Store::find(self, mesh, segmentation, None)
    }

    fn is_damaged(&self, mesh: &[u8], segmentation: NewSegmentation<'_>) -> bool {
        Store::is_damaged(self, mesh, segmentation)
    }

    /// The rows are left out: they stand in a file of their own ([`Store::put_rows`]), which is written at the end.
    fn add(&self, new: &NewExample<'_>, _rows: &[Vec<u8>]) -> Result<Added, StoreError> {
        Store::add(self, new)
    }

    fn annotate(&self, id: ExampleId, patch: Patch) -> Result<Arc<ExampleRecord>, StoreError> {
        Store::annotate(self, id, patch)
    }

    fn remove(&self, id: ExampleId) -> Result<(), StoreError> {
        Store::remove(self, id)
    }

    fn mesh_bytes(&self, id: ExampleId) -> Result<Vec<u8>, StoreError> {
        Store::mesh_bytes(self, id)
    }

    fn labels(&self, id: ExampleId) -> Result<Option<Vec<u32>>, StoreError> {
        Store::labels(self, id)
    }

    fn put_derived(
        &self,
        id: ExampleId,
        segment: u32,
        encoder_version: u32,
        derived: &DerivedSegment,
        _row: Option<Vec<u8>>,
    ) -> Result<(), StoreError> {
        Store::put_derived(self, id, segment, encoder_version, derived)
    }

    fn coarse(&self, id: ExampleId, segment: u32) -> Result<Coarse, StoreError> {
        Store::coarse(self, id, segment)
    }

    fn level(&self, id: ExampleId, segment: u32, side: u32) -> Result<Level, StoreError> {
        Store::level(self, id, segment, side)
    }

    fn chart(&self, id: ExampleId, segment: u32) -> Result<ChartRecord, StoreError> {
        Store::chart(self, id, segment)
    }

    fn missing_derived(&self, encoder_version: u32) -> Vec<(ExampleId, u32)> {
        Store::missing_derived(self, encoder_version)
    }

    fn rows(&self) -> Vec<(ExampleId, SegmentRow)> {
        Store::rows(self)
    }

    fn rows_of(&self, _id: ExampleId) -> Vec<SegmentRow> {
        Vec::new()
    }

    fn put_rows(&self, rows: &mut dyn Iterator<Item = (ExampleId, SegmentRow)>) -> Result<(), StoreError> {
        Store::put_rows(self, rows)
    }

    fn check(&self, progress: &mut dyn FnMut(usize)) -> Result<CheckReport, StoreError> {
        Store::check(self, progress)
    }

    fn scrub(&self, id: ExampleId) -> Result<Vec<Problem>, StoreError> {
        Store::scrub(self, id)
    }

    fn quarantined(&self) -> Vec<(ExampleId, String)> {
        Store::quarantined(self)
    }

    fn unwritable(&self) -> Option<String> {
        Store::unwritable(self)
    }

    fn whole(&self, id: ExampleId) -> Result<Whole, StoreError> {
        Store::whole(self, id)
    }

    fn put_whole(&self, whole: Whole) -> Result<Added, StoreError> {
        Store::put_whole(self, whole)
    }

    fn changes(&self, position: u64) -> Changes {
        self.shared().changes(position)
    }

    fn subscribe(&self, listener: Listener) {
        self.shared().subscribe(listener);
    }

    fn backup(&self, writer: &mut dyn Write) -> Result<BackupReport, StoreError> {
        backup::write(self, writer)
    }
}
