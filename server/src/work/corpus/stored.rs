//! The corpus in earnest: on a backend, which is the store on disk or a corpus that servers share.
//!
//! A backend knows meshes, records and encodings; what else an [`Example`] tells is derived, and travels in the opaque
//! part of its segments' charts.

mod row;
mod shaped;

pub use row::without_picture;

use super::{Corpus, CorpusCheck, CorpusError, CorpusHealth, KeptRow, NewExample, PutOutcome};
use crate::work::engine::{Cut, Engine, ExtraParts, PackedEncoding, SegmentFacts};
use crate::work::ingest::counts_of;
use crate::work::query::rfc3339;
use bytes::Bytes;
use quadmuse_kernel::mesh;
use quadmuse_kernel::register::spectra::Row;
use quadmuse_proto::{Example, ExampleId, ExamplePatch, ExampleSegment, MeshCounts, Segmentation};
use quadmuse_store::{
    Added, Backend, Changed, Changes, Coarse, DerivedSegment, ExampleRecord, Following, Level, NewSegmentation,
    OpenOptions, OpenReport, PackedSegment, Problem, SegmentRow, SegmentSummary, Store, StoreError, coarse_when_kept,
};
use row::WrittenRow;
use shaped::{
    ShapedExample, derived_in, feature_out, labels_in, landmark_out, patch_in, segmentation_in, topology_out,
};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;
use tokio::sync::watch;

/// Makes the row that a search keeps of an encoding; `None` if there is none.
pub type RowMaker = Box<dyn Fn(&PackedEncoding) -> Option<Row> + Send + Sync>;

/// The corpus.
pub struct StoredCorpus {
    store: Arc<dyn Backend>,
    /// The same as a store on disk, if it is one: for what only such a store can.
    on_disk: Option<Store>,
    /// For a backend that keeps rows with what is added, so that other servers needn't make them.
    row_maker: Option<RowMaker>,
    /// What is derived of each example beside its record.
    described: RwLock<BTreeMap<ExampleId, Arc<ExampleCounts>>>,
    /// The rows that were written down, or came with a change, until they are asked for.
    rows: Mutex<HashMap<ExampleId, Vec<KeptRow>>>,
    newest: watch::Receiver<u64>,
    /// The position up to which `described` and `rows` know what changed.
    learned: Mutex<u64>,
}

/// Counts what an example has: triangles, quads and features.
#[derive(Clone, Debug, Default, PartialEq)]
struct ExampleCounts {
    triangles: u64,
    quads: u64,
    features: Vec<u32>,
}

impl StoredCorpus {
    /// Opens the store in `dir`, or creates it. Blocks.
    ///
    /// # Errors
    /// Those of [`Store::open`].
    pub fn open(dir: &Path, options: &OpenOptions) -> Result<(Self, OpenReport), StoreError> {
        let (store, report) = Store::open(dir, options)?;
        let corpus = Self { on_disk: Some(store.clone()), ..Self::of(Arc::new(store), None) };
        Ok((corpus, report))
    }

    /// The corpus on a backend. Blocks.
    pub fn of(store: Arc<dyn Backend>, row_maker: Option<RowMaker>) -> Self {
        let (announced, newest) = watch::channel(0);
        store.subscribe(Box::new(move |position| {
            // Whether anybody listens, or not.
            let _ = announced.send(position);
        }));
        // What changes from here on is learned with the changes.
        let learned = Mutex::new(store.changes(u64::MAX).position);
        let mut written: HashMap<ExampleId, Vec<SegmentRow>> = HashMap::new();
        for (id, row) in store.rows() {
            written.entry(id).or_default().push(row);
        }
        let (mut all, mut rows) = (BTreeMap::new(), HashMap::new());
        for record in &store.snapshot().examples {
            let (known, kept) = known_of(&*store, record, written.remove(&record.id).unwrap_or_default());
            all.insert(record.id, Arc::new(known));
            rows.extend(kept.map(|kept| (record.id, kept)));
        }
        Self { store, on_disk: None, row_maker, described: RwLock::new(all), rows: Mutex::new(rows), newest, learned }
    }

    fn example(&self, record: &ExampleRecord) -> Arc<Example> {
        let known = self.described.read().unwrap_or_else(PoisonError::into_inner).get(&record.id).cloned();
        // Whoever follows the corpus may see what another request has just added before that request has described it.
        Arc::new(example_of(record, &known.unwrap_or_else(|| Arc::new(described(&*self.store, record)))))
    }

    fn describe(&self, id: ExampleId, known: ExampleCounts) {
        self.described.write().unwrap_or_else(PoisonError::into_inner).insert(id, Arc::new(known));
    }

    /// Learns what changed since the last time, before anybody is told that it did.
    fn learn_changes(&self) {
        let mut learned = self.learned.lock().unwrap_or_else(PoisonError::into_inner);
        let Changes { position, changed } = self.store.changes(*learned);
        let all = || self.store.snapshot().examples.iter().map(|record| Changed::Encoded(record.id)).collect();
        // Each once, however often it changed.
        let changed: HashSet<Changed> = changed.unwrap_or_else(all).into_iter().collect();
        for one in changed {
            match one {
                Changed::Encoded(id) => self.learn(id),
                Changed::Annotated(_) => {}
                Changed::Removed(id) => self.forget(id),
            }
        }
        *learned = position;
    }

    fn forget(&self, id: ExampleId) {
        if self.store.get(id).is_err() {
            self.described.write().unwrap_or_else(PoisonError::into_inner).remove(&id);
        }
    }

    /// Learns what is derived of an example that is new, or encoded anew.
    fn learn(&self, id: ExampleId) {
        let Ok(record) = self.store.get(id) else { return };
        let (known, kept) = known_of(&*self.store, &record, self.store.rows_of(id));
        self.describe(id, known);
        if let Some(kept) = kept {
            self.rows.lock().unwrap_or_else(PoisonError::into_inner).insert(id, kept);
        }
    }

    /// The rows of new encodings, as bytes, where the backend keeps them: all of them, or none.
    fn rows_for(&self, derived: &[DerivedSegment], faces: &[u64], counts: MeshCounts) -> Vec<Vec<u8>> {
        let Some(maker) = &self.row_maker else { return Vec::new() };
        let row = |(segment, (derived, faces)): (u32, (&DerivedSegment, &u64))| {
            // What is made of the encoding as it will be read, so that every server makes the same.
            let coarse = coarse_when_kept(derived).ok()?;
            let packed = packed_of(&coarse, coarse.level.clone(), *faces);
            let row = maker(&packed)?;
            Some(row::write(
                &KeptRow { segment, facts: packed.facts, row: Some(row) },
                (counts.triangles, counts.quads),
            ))
        };
        let rows: Option<Vec<_>> = (0..).zip(derived.iter().zip(faces)).map(row).collect();
        rows.unwrap_or_default()
    }
}

/// What the rows of an example tell, or else its encodings; and the rows, if all are there.
fn known_of(
    store: &dyn Backend,
    record: &ExampleRecord,
    rows: Vec<SegmentRow>,
) -> (ExampleCounts, Option<Vec<KeptRow>>) {
    let mut of: Vec<WrittenRow> = rows.into_iter().filter_map(|(segment, bytes)| row::read(segment, &bytes)).collect();
    of.sort_by_key(|written| written.segment);
    let whole = of.iter().map(|written| written.segment).eq(0..record.segments.len() as u32);
    let known = match of.first() {
        Some(first) if whole => ExampleCounts {
            triangles: first.counts.0,
            quads: first.counts.1,
            features: of.iter().map(|written| written.features).collect(),
        },
        _ => described(store, record),
    };
    let kept = of.into_iter().zip(&record.segments).map(|(written, summary)| written.kept(summary));
    (known, whole.then(|| kept.collect()))
}

/// The row of a packed encoding, as bytes, as a backend keeps it.
pub fn row_of_packed(
    record: &ExampleRecord,
    segment: u32,
    packed: &PackedSegment,
    maker: &RowMaker,
) -> Option<Vec<u8>> {
    let reader = packed.of(record.id, segment);
    let coarse = reader.coarse().ok()?;
    let counts = unpack_counts(&reader.chart().ok()?.extra)?;
    let faces = u64::from(record.segments.get(segment as usize)?.faces);
    let read = packed_of(&coarse, coarse.level.clone(), faces);
    let row = maker(&read)?;
    Some(row::write(&KeptRow { segment, facts: read.facts, row: Some(row) }, counts))
}

/// A maker of rows by the geometry.
pub fn row_maker(engine: Arc<dyn Engine>) -> RowMaker {
    Box::new(move |packed: &PackedEncoding| engine.unpack(packed).and_then(|encoding| engine.row(&encoding)).ok())
}

/// What is read of an encoding, with one level of its pyramid, as the service passes it on.
fn packed_of(coarse: &Coarse, level: Level, faces: u64) -> PackedEncoding {
    let (topology, k) = (topology_out(coarse.topology), coarse.modulus);
    let bending = coarse.signature.first().copied();
    PackedEncoding {
        facts: SegmentFacts { topology, k, faces, features: coarse.features.len() as u32, bending },
        features: coarse.features.iter().map(feature_out).collect(),
        levels: vec![(level.side, level.lambda)],
    }
}

/// Reads what the encodings tell; features that are missing count as 0 until they are found again.
fn described(store: &dyn Backend, record: &ExampleRecord) -> ExampleCounts {
    let segments = 0..record.segments.len() as u32;
    let features =
        segments.clone().map(|s| store.coarse(record.id, s).map_or(0, |coarse| coarse.features.len() as u32));
    let charts = segments.clone().filter_map(|s| store.chart(record.id, s).ok());
    let counts = charts.filter_map(|chart| unpack_counts(&chart.extra)).next();
    // Until it is encoded again, the mesh tells.
    let (triangles, quads) = counts.or_else(|| counted(store, record.id)).unwrap_or_default();
    ExampleCounts { triangles, quads, features: features.collect() }
}

/// Triangles and quads of a mesh, from its bytes.
fn counted(store: &dyn Backend, id: ExampleId) -> Option<(u64, u64)> {
    let bytes = store.mesh_bytes(id).ok()?;
    let mesh = mesh::read(&bytes, mesh::Format::sniff(&bytes), &mesh::Limits::default()).ok()?;
    let counts = counts_of(&mesh);
    Some((counts.triangles, counts.quads))
}

fn pack_counts(counts: MeshCounts) -> Vec<u8> {
    [counts.triangles.to_le_bytes(), counts.quads.to_le_bytes()].concat()
}

fn unpack_counts(extra: &[u8]) -> Option<(u64, u64)> {
    let (words, _) = extra.as_chunks::<8>();
    match words {
        [triangles, quads, ..] => Some((u64::from_le_bytes(*triangles), u64::from_le_bytes(*quads))),
        _ => None,
    }
}

fn example_of(record: &ExampleRecord, known: &ExampleCounts) -> Example {
    let has_parts = matches!(record.segmentation, quadmuse_store::Segmentation::Parted { .. });
    let segment = |(at, s): (usize, &SegmentSummary)| ExampleSegment {
        segment: at as u32,
        is_part: has_parts && at > 0,
        topology: topology_out(s.topology),
        k: s.modulus,
        faces: u64::from(s.faces),
        features: known.features.get(at).copied().unwrap_or(0),
    };
    let (vertices, faces) = (u64::from(record.vertices), u64::from(record.faces));
    Example {
        id: record.id,
        revision: record.revision,
        name: record.name.clone(),
        tags: record.tags.clone(),
        // f32 holds what was given; the shortest decimal of it is what was written.
        relevance: record.relevance.to_string().parse().unwrap_or_else(|_| f64::from(record.relevance)),
        author: record.author.clone(),
        licence: record.licence.clone(),
        notes: record.notes.clone(),
        landmarks: record.landmarks.iter().map(landmark_out).collect(),
        hash: record.content_hash.to_string(),
        format: record.format.clone(),
        bytes: record.bytes,
        counts: MeshCounts { vertices, faces, triangles: known.triangles, quads: known.quads },
        segments: record.segments.iter().enumerate().map(segment).collect(),
        repairs: record.repairs.clone(),
        doubts: Vec::new(),
        created: rfc3339(record.created_unix_ms),
        template: None,
    }
}

impl StoredCorpus {
    /// Adds many examples, on a store by one commit; durable when it returns.
    ///
    /// # Errors
    /// As [`Corpus::put`]; on a store none is added then.
    pub fn put_all(&self, new: Vec<NewExample>) -> Result<Vec<(Arc<Example>, PutOutcome)>, CorpusError> {
        let Some(store) = &self.on_disk else { return new.into_iter().map(|new| self.put(new)).collect() };
        let shaped: Vec<ShapedExample> = new.into_iter().map(ShapedExample::of).collect();
        let added = store.add_all(&shaped.iter().map(ShapedExample::for_store).collect::<Vec<_>>())?;
        Ok(shaped.iter().zip(&added).map(|(shaped, added)| self.added(&shaped.new, added)).collect())
    }

    /// The store on disk, if that is where the corpus lies.
    pub fn on_disk(&self) -> Option<&Store> {
        self.on_disk.as_ref()
    }

    fn added(&self, new: &NewExample, added: &Added) -> (Arc<Example>, PutOutcome) {
        let put = match added {
            Added::Created(_) => PutOutcome::Added,
            Added::Exists(_) => PutOutcome::There,
        };
        let record = added.record();
        let features = new.segments.iter().map(|packed| packed.features.len() as u32).collect();
        let known = match added {
            Added::Created(_) => ExampleCounts { triangles: new.counts.triangles, quads: new.counts.quads, features },
            // Its parts may be others than are found now.
            Added::Exists(_) => described(&*self.store, record),
        };
        self.describe(record.id, known);
        (self.example(record), put)
    }
}

impl Corpus for StoredCorpus {
    fn put(&self, mut new: NewExample) -> Result<(Arc<Example>, PutOutcome), CorpusError> {
        // What is there whole, and damaged, is healed, not added beside itself.
        if matches!(new.cut.besides, ExtraParts::Known(_)) && self.store.is_damaged(&new.bytes, NewSegmentation::Auto) {
            new.cut.besides = ExtraParts::Nothing;
            new.segments.truncate(1);
        }
        let shaped = ShapedExample::of(new);
        let faces: Vec<u64> = shaped.new.segments.iter().map(|packed| packed.facts.faces).collect();
        let rows = self.rows_for(shaped.derived(), &faces, shaped.new.counts);
        let added = self.store.add(&shaped.for_store(), &rows)?;
        Ok(self.added(&shaped.new, &added))
    }

    fn find(&self, bytes: &[u8], cut: &Cut) -> Option<Arc<Example>> {
        let labels = labels_in(cut);
        let own = segmentation_in(cut, labels.as_deref());
        // Whole and by its parts, or whole alone: it is one example, as it was added first.
        let ways = match own {
            NewSegmentation::Auto | NewSegmentation::Parted(_) => {
                vec![NewSegmentation::Parted(&[]), NewSegmentation::Auto]
            }
            _ => vec![own],
        };
        let found = ways.into_iter().find_map(|way| self.store.find(bytes, way));
        found.map(|record| self.example(&record))
    }

    fn get(&self, id: ExampleId) -> Result<Arc<Example>, CorpusError> {
        Ok(self.example(&*self.store.get(id)?))
    }

    fn list(&self) -> Vec<Arc<Example>> {
        self.store.snapshot().examples.iter().map(|record| self.example(record)).collect()
    }

    fn annotate(&self, id: ExampleId, patch: &ExamplePatch) -> Result<Arc<Example>, CorpusError> {
        let record = self.store.annotate(id, patch_in(patch))?;
        Ok(self.example(&record))
    }

    fn remove(&self, id: ExampleId) -> Result<(), CorpusError> {
        self.store.remove(id)?;
        self.forget(id);
        Ok(())
    }

    fn bytes(&self, id: ExampleId) -> Result<Bytes, CorpusError> {
        Ok(self.store.mesh_bytes(id)?.into())
    }

    fn cut(&self, id: ExampleId) -> Result<Cut, CorpusError> {
        let labels = self.store.labels(id)?.map(|labels| labels.into_iter().map(i64::from).collect());
        // What was refused for its small components is not here; for the rest it makes no difference.
        let way = |way| Cut { way, ..Cut::default() };
        Ok(match self.store.get(id)?.segmentation {
            quadmuse_store::Segmentation::Whole => way(Segmentation::Whole),
            quadmuse_store::Segmentation::Groups => way(Segmentation::Groups),
            quadmuse_store::Segmentation::Auto => Cut::default(),
            quadmuse_store::Segmentation::Labels { .. } => Cut { labels, ..Cut::default() },
            quadmuse_store::Segmentation::Parted { .. } => {
                Cut { besides: labels.map_or(ExtraParts::Nothing, ExtraParts::Known), ..Cut::default() }
            }
        })
    }

    fn encoding(&self, id: ExampleId, segment: u32, level: u32) -> Result<PackedEncoding, CorpusError> {
        let coarse = self.store.coarse(id, segment)?;
        let record = self.store.get(id)?;
        let faces = record.segments.get(segment as usize).map_or(0, |summary| u64::from(summary.faces));
        let wanted = match coarse.level.side == level {
            true => coarse.level.clone(),
            false => self.store.level(id, segment, level)?,
        };
        Ok(packed_of(&coarse, wanted, faces))
    }

    fn put_encoding(
        &self,
        id: ExampleId,
        segment: u32,
        packed: &PackedEncoding,
        counts: MeshCounts,
        version: u32,
    ) -> Result<(), CorpusError> {
        let derived = derived_in(packed, counts);
        let row = self.rows_for(std::slice::from_ref(&derived), &[packed.facts.faces], counts).pop();
        self.store.put_derived(id, segment, version, &derived, row)?;
        Ok(())
    }

    fn take_rows(&self) -> HashMap<ExampleId, Vec<KeptRow>> {
        std::mem::take(&mut *self.rows.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn rows_of(&self, id: ExampleId) -> Option<Vec<KeptRow>> {
        self.rows.lock().unwrap_or_else(PoisonError::into_inner).remove(&id)
    }

    fn keep_rows(&self, rows: &mut dyn Iterator<Item = (ExampleId, KeptRow)>) -> Result<(), CorpusError> {
        let described = self.described.read().unwrap_or_else(PoisonError::into_inner).clone();
        let written = |(id, kept): (ExampleId, KeptRow)| {
            let counts = described.get(&id).map_or((0, 0), |known| (known.triangles, known.quads));
            (id, (kept.segment, row::write(&kept, counts)))
        };
        Ok(self.store.put_rows(&mut rows.map(written))?)
    }

    fn check(&self) -> Result<CorpusCheck, CorpusError> {
        let report = self.store.check(&mut |_| {})?;
        Ok(CorpusCheck {
            examples: report.examples as u64,
            segments: report.segments as u64,
            bytes: report.bytes,
            problems: report.problems.iter().map(words_of).collect(),
        })
    }

    fn scrub(&self, id: ExampleId) -> Result<Vec<String>, CorpusError> {
        Ok(self.store.scrub(id)?.iter().map(words_of).collect())
    }

    fn backup(&self, to: &mut dyn std::io::Write) -> Result<Vec<(ExampleId, String)>, CorpusError> {
        Ok(self.store.backup(to)?.skipped)
    }

    fn stale(&self, version: u32) -> Vec<(ExampleId, u32)> {
        self.store.missing_derived(version)
    }

    fn changes(&self, position: u64) -> Changes {
        self.learn_changes();
        self.store.changes(position)
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.newest.clone()
    }

    fn reached(&self) -> u64 {
        self.store.reached()
    }

    fn wait_for(&self, position: u64, time: Duration) {
        self.store.wait_for(position, time);
    }

    fn following(&self) -> Following {
        self.store.following()
    }

    fn health(&self) -> CorpusHealth {
        let quarantined = self.store.quarantined().into_iter().map(|(id, _)| id).collect();
        CorpusHealth { read_only: self.store.unwritable(), quarantined }
    }
}

/// What a check found, as a sentence.
pub fn words_of(problem: &Problem) -> String {
    match problem {
        Problem::Ground { id, reason } => {
            format!("{id}: damaged ({reason}); add the same mesh again, or remove it")
        }
        Problem::Record { id, reason } => {
            format!("{id}: its record is damaged ({reason}); the service writes it anew")
        }
        Problem::Derived { id, segment, reason } => {
            format!("{id}: the encoding of segment {segment} is damaged ({reason}); the service makes it anew")
        }
        Problem::Blobs { count } => format!("{count} files are not synced; compact the store"),
    }
}

impl From<StoreError> for CorpusError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::NotFound { id } => Self::NotFound(id),
            StoreError::Quarantined { .. } => Self::Damaged(error.to_string()),
            StoreError::DamagedDerived { .. } | StoreError::MissingDerived { .. } | StoreError::NoSuchLevel { .. } => {
                Self::NoEncoding(error.to_string())
            }
            StoreError::Invalid { .. } => Self::Invalid(error.to_string()),
            StoreError::Full { .. }
            | StoreError::IndexFull { .. }
            | StoreError::NoRoom { .. }
            | StoreError::EngineFull { .. } => Self::Full(error.to_string()),
            StoreError::ReadOnly { .. } => Self::ReadOnly(error.to_string()),
            StoreError::Busy => Self::Busy,
            StoreError::Conflict { .. } => Self::Conflict(error.to_string()),
            StoreError::Unreachable { .. } => Self::Unreachable(error.to_string()),
            StoreError::Io { .. } if error.is_full() => Self::Full(error.to_string()),
            // The paths are nobody's business but the log's.
            StoreError::Io { .. } => {
                tracing::error!(error = &error as &dyn std::error::Error, "the disk fails");
                Self::ReadOnly("expected a disk that works, found one that fails; try again later".into())
            }
            StoreError::Engine { .. }
            | StoreError::Newer { .. }
            | StoreError::Locked { .. }
            | StoreError::Migration(_)
            | StoreError::Backup { .. }
            | StoreError::NotEmpty { .. }
            | StoreError::HalfRestored { .. }
            | StoreError::Closed => Self::Failed(Box::new(error)),
        }
    }
}

#[cfg(test)]
mod tests;
