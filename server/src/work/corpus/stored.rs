//! The corpus in earnest: the store on disk.
//!
//! The store knows meshes, records and encodings; what else an [`Example`] tells is derived, and travels in the opaque
//! part of its segments' charts.

mod row;
mod shaped;

use super::{Corpus, CorpusCheck, CorpusError, CorpusHealth, KeptRow, NewExample, Put};
use crate::work::engine::{Besides, Cut, Packed, SegmentFacts};
use crate::work::ingest::counts_of;
use crate::work::query::rfc3339;
use bytes::Bytes;
use quadmuse_kernel::mesh;
use quadmuse_proto::{Example, ExampleId, ExamplePatch, ExampleSegment, MeshCounts, Segmentation};
use quadmuse_store::{
    Added, ExampleRecord, NewSegmentation, OpenOptions, OpenReport, Problem, SegmentSummary, Store, StoreError,
};
use row::WrittenRow;
use shaped::{Shaped, derived_in, feature_out, labels_in, landmark_out, patch_in, segmentation_in, topology_out};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use tokio::sync::watch;

/// The corpus on disk.
pub struct StoredCorpus {
    store: Store,
    /// What is derived of each example beside its record.
    described: RwLock<BTreeMap<ExampleId, Arc<Described>>>,
    /// The rows that were written down, until they are asked for.
    rows: Mutex<HashMap<ExampleId, Vec<KeptRow>>>,
    changes: watch::Sender<u64>,
}

/// What an example tells beside its record.
#[derive(Clone, Debug, Default, PartialEq)]
struct Described {
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
        Ok((Self::of(store), report))
    }

    /// The corpus in an open store. Blocks.
    pub fn of(store: Store) -> Self {
        let mut written: HashMap<ExampleId, Vec<WrittenRow>> = HashMap::new();
        for (id, (segment, bytes)) in store.rows() {
            written.entry(id).or_default().extend(row::read(segment, &bytes));
        }
        let (mut all, mut rows) = (BTreeMap::new(), HashMap::new());
        for record in &store.snapshot().examples {
            let mut of = written.remove(&record.id).unwrap_or_default();
            of.sort_by_key(|written| written.segment);
            let whole = of.iter().map(|written| written.segment).eq(0..record.segments.len() as u32);
            let known = match of.first() {
                Some(first) if whole => Described {
                    triangles: first.counts.0,
                    quads: first.counts.1,
                    features: of.iter().map(|written| written.features).collect(),
                },
                _ => described(&store, record),
            };
            all.insert(record.id, Arc::new(known));
            if whole {
                let kept = of.into_iter().zip(&record.segments).map(|(written, summary)| written.kept(summary));
                rows.insert(record.id, kept.collect());
            }
        }
        Self { described: RwLock::new(all), rows: Mutex::new(rows), store, changes: watch::Sender::new(0) }
    }

    fn example(&self, record: &ExampleRecord) -> Arc<Example> {
        let known = self.described.read().unwrap_or_else(PoisonError::into_inner).get(&record.id).cloned();
        Arc::new(example_of(record, &known.unwrap_or_default()))
    }

    fn describe(&self, id: ExampleId, known: Option<Described>) {
        let mut all = self.described.write().unwrap_or_else(PoisonError::into_inner);
        match known {
            Some(known) => drop(all.insert(id, Arc::new(known))),
            None => drop(all.remove(&id)),
        }
        drop(all);
        self.changes.send_modify(|revision| *revision += 1);
    }
}

/// Reads what the encodings tell; features that are missing count as 0 until they are found again.
fn described(store: &Store, record: &ExampleRecord) -> Described {
    let segments = 0..record.segments.len() as u32;
    let features =
        segments.clone().map(|s| store.coarse(record.id, s).map_or(0, |coarse| coarse.features.len() as u32));
    let charts = segments.clone().filter_map(|s| store.chart(record.id, s).ok());
    let told = charts.filter_map(|chart| unpack_counts(&chart.extra)).next();
    // Until it is encoded again, the mesh tells.
    let (triangles, quads) = told.or_else(|| counted(store, record.id)).unwrap_or_default();
    Described { triangles, quads, features: features.collect() }
}

/// Triangles and quads of a mesh, from its bytes.
fn counted(store: &Store, id: ExampleId) -> Option<(u64, u64)> {
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

fn example_of(record: &ExampleRecord, known: &Described) -> Example {
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
        created: rfc3339(record.created_unix_ms),
        template: None,
    }
}

impl StoredCorpus {
    /// Adds many examples by one commit; durable when it returns.
    ///
    /// # Errors
    /// As [`Corpus::put`]; none is added then.
    pub fn put_all(&self, new: Vec<NewExample>) -> Result<Vec<(Arc<Example>, Put)>, CorpusError> {
        let shaped: Vec<Shaped> = new.into_iter().map(Shaped::of).collect();
        let added = self.store.add_all(&shaped.iter().map(Shaped::for_store).collect::<Vec<_>>())?;
        Ok(shaped.iter().zip(&added).map(|(shaped, added)| self.added(&shaped.new, added)).collect())
    }

    fn added(&self, new: &NewExample, added: &Added) -> (Arc<Example>, Put) {
        let put = match added {
            Added::Created(_) => Put::Added,
            Added::Exists(_) => Put::There,
        };
        let record = added.record();
        let features = new.segments.iter().map(|packed| packed.features.len() as u32).collect();
        let known = match added {
            Added::Created(_) => Described { triangles: new.counts.triangles, quads: new.counts.quads, features },
            // Its parts may be others than are found now.
            Added::Exists(_) => described(&self.store, record),
        };
        self.describe(record.id, Some(known));
        (self.example(record), put)
    }
}

impl Corpus for StoredCorpus {
    fn put(&self, mut new: NewExample) -> Result<(Arc<Example>, Put), CorpusError> {
        // What is there whole, and damaged, is healed, not added beside itself.
        if matches!(new.cut.besides, Besides::Known(_)) && self.store.is_damaged(&new.bytes, NewSegmentation::Auto) {
            new.cut.besides = Besides::Nothing;
            new.segments.truncate(1);
        }
        let shaped = Shaped::of(new);
        let added = self.store.add(&shaped.for_store())?;
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
        let found = ways.into_iter().find_map(|way| self.store.find(bytes, way, None));
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
        self.changes.send_modify(|revision| *revision += 1);
        Ok(self.example(&record))
    }

    fn remove(&self, id: ExampleId) -> Result<(), CorpusError> {
        self.store.remove(id)?;
        self.describe(id, None);
        Ok(())
    }

    fn bytes(&self, id: ExampleId) -> Result<Bytes, CorpusError> {
        Ok(self.store.mesh_bytes(id)?.into())
    }

    fn cut(&self, id: ExampleId) -> Result<Cut, CorpusError> {
        let labels = self.store.labels(id)?.map(|labels| labels.into_iter().map(i64::from).collect());
        // What was refused for its crumbs is not here; for the rest it makes no difference.
        let way = |way| Cut { way, ..Cut::default() };
        Ok(match self.store.get(id)?.segmentation {
            quadmuse_store::Segmentation::Whole => way(Segmentation::Whole),
            quadmuse_store::Segmentation::Groups => way(Segmentation::Groups),
            quadmuse_store::Segmentation::Auto => Cut::default(),
            quadmuse_store::Segmentation::Labels { .. } => Cut { labels, ..Cut::default() },
            quadmuse_store::Segmentation::Parted { .. } => {
                Cut { besides: labels.map_or(Besides::Nothing, Besides::Known), ..Cut::default() }
            }
        })
    }

    fn encoding(&self, id: ExampleId, segment: u32, level: u32) -> Result<Packed, CorpusError> {
        let coarse = self.store.coarse(id, segment)?;
        let record = self.store.get(id)?;
        let faces = record.segments.get(segment as usize).map_or(0, |summary| u64::from(summary.faces));
        let wanted = match coarse.level.side == level {
            true => coarse.level,
            false => self.store.level(id, segment, level)?,
        };
        let (topology, k) = (topology_out(coarse.topology), coarse.modulus);
        let bending = coarse.signature.first().copied();
        Ok(Packed {
            facts: SegmentFacts { topology, k, faces, features: coarse.features.len() as u32, bending },
            features: coarse.features.iter().map(feature_out).collect(),
            levels: vec![(wanted.side, wanted.lambda)],
        })
    }

    fn put_encoding(
        &self,
        id: ExampleId,
        segment: u32,
        packed: &Packed,
        counts: MeshCounts,
        version: u32,
    ) -> Result<(), CorpusError> {
        self.store.put_derived(id, segment, version, &derived_in(packed, counts))?;
        let record = self.store.get(id)?;
        self.describe(id, Some(described(&self.store, &record)));
        Ok(())
    }

    fn take_rows(&self) -> HashMap<ExampleId, Vec<KeptRow>> {
        std::mem::take(&mut *self.rows.lock().unwrap_or_else(PoisonError::into_inner))
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

    fn watch(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
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
            StoreError::Full { .. } | StoreError::IndexFull { .. } | StoreError::NoRoom { .. } => {
                Self::Full(error.to_string())
            }
            StoreError::ReadOnly { .. } => Self::ReadOnly(error.to_string()),
            StoreError::Busy => Self::Busy,
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
mod tests {
    use super::*;
    use quadmuse_proto::Topology;
    use quadmuse_store::Feature;

    fn packed(level_value: f32) -> Packed {
        let facts = SegmentFacts { topology: Topology::Annulus, k: 0.4, faces: 12, features: 1, bending: Some(3.25) };
        let levels = [32u32, 64].map(|side| (side, vec![level_value; (side * side) as usize])).to_vec();
        Packed { facts, features: vec![feature_out(&Feature { u: 0.25, v: 0.5, lambda: 2.0, level: 64 })], levels }
    }

    fn new_example(bytes: &'static [u8], labels: Option<Vec<i64>>) -> NewExample {
        NewExample {
            name: "limb".into(),
            tags: vec!["arm".into()],
            relevance: 3.3,
            bytes: Bytes::from_static(bytes),
            format: "obj".into(),
            cut: Cut { labels, ..Cut::default() },
            counts: MeshCounts { vertices: 14, faces: 12, triangles: 2, quads: 10 },
            repairs: vec!["two vertices merged".into()],
            segments: vec![packed(1.0)],
            encoder_version: 1,
        }
    }

    fn open(dir: &Path) -> StoredCorpus {
        StoredCorpus::open(dir, &OpenOptions { reserve_bytes: 0, ..OpenOptions::default() }).expect("a store").0
    }

    #[test]
    fn an_example_is_told_the_same_before_and_after_a_restart() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let (example, put) = corpus.put(new_example(b"mesh", Some(vec![7, -1, 7]))).expect("added");
        assert_eq!(put, Put::Added);
        assert_eq!((example.relevance, example.counts.quads, example.segments[0].features), (3.3, 10, 1));
        let encoding = corpus.encoding(example.id, 0, 64).expect("an encoding");
        drop(corpus);
        let corpus = open(dir.path());
        assert_eq!(corpus.get(example.id).expect("there"), example);
        assert_eq!(corpus.encoding(example.id, 0, 64).expect("an encoding"), encoding);
        assert_eq!(corpus.bytes(example.id).expect("bytes"), Bytes::from_static(b"mesh"));
        assert_eq!(corpus.cut(example.id).expect("a cut").labels, Some(vec![1, 0, 1]));
    }

    /// Whole, and by as many parts as there are labels but 0.
    fn with_parts(bytes: &'static [u8], labels: Vec<i64>) -> NewExample {
        let count = labels.iter().max().map_or(0, |label| *label as usize);
        let cut = Cut { besides: Besides::Known(labels), ..Cut::default() };
        NewExample { cut, segments: vec![packed(1.0); count + 1], ..new_example(bytes, None) }
    }

    #[test]
    fn parts_besides_the_whole_are_told_the_same_after_a_restart_and_a_restore() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let (example, _) = corpus.put(with_parts(b"mesh", vec![2, 0, 1])).expect("added");
        assert_eq!(example.segments.iter().map(|s| s.is_part).collect::<Vec<_>>(), [false, true, true]);
        let mut backup = Vec::new();
        corpus.backup(&mut backup).expect("written");
        drop(corpus);
        let other = tempfile::tempdir().expect("a directory");
        Store::restore(other.path(), &OpenOptions { reserve_bytes: 0, ..OpenOptions::default() }, &mut &backup[..])
            .map(drop)
            .expect("restored");
        for dir in [dir.path(), other.path()] {
            let corpus = open(dir);
            assert_eq!(corpus.list()[0].segments, example.segments);
            let id = corpus.list()[0].id;
            let cut = corpus.cut(id).expect("a cut");
            assert_eq!(cut, Cut { besides: Besides::Known(vec![2, 0, 1]), ..Cut::default() });
            assert_eq!(corpus.check().expect("checked").problems, Vec::<String>::new());
        }
    }

    #[test]
    fn whole_or_with_any_parts_it_is_one_example_and_damage_to_it_is_healed() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let sought = Cut { besides: Besides::Sought, ..Cut::default() };
        let (both, _) = corpus.put(with_parts(b"both", vec![1, 2])).expect("added");
        for cut in [&sought, &Cut::default()] {
            assert_eq!(corpus.find(b"both", cut).map(|e| e.id), Some(both.id));
        }
        // Another release finds other parts.
        let (again, put) = corpus.put(with_parts(b"both", vec![1, 2, 3])).expect("there");
        assert_eq!((&again, put), (&both, Put::There));
        let (whole, _) = corpus.put(new_example(b"whole", None)).expect("added");
        assert_eq!(corpus.find(b"whole", &sought).map(|e| e.id), Some(whole.id));
        let objects = dir.path().join("objects");
        for example in [&both, &whole] {
            std::fs::write(objects.join(&example.hash), b"other").expect("damaged");
            assert!(matches!(corpus.bytes(example.id), Err(CorpusError::Damaged(_))));
        }
        assert_eq!(corpus.find(b"whole", &sought), None);
        let healed = corpus.put(with_parts(b"whole", vec![1, 2])).expect("healed");
        assert_eq!((healed.0.id, healed.0.segments.len(), healed.1), (whole.id, 1, Put::There));
        corpus.put(with_parts(b"both", vec![1, 2])).expect("healed");
        assert_eq!(corpus.bytes(both.id).expect("whole"), Bytes::from_static(b"both"));
        assert_eq!(corpus.health().quarantined, []);
    }

    #[test]
    fn damaged_labels_of_parts_are_healed_by_the_same_parts_and_by_no_others() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let (both, _) = corpus.put(with_parts(b"both", vec![1, 2])).expect("added");
        let labels = std::fs::read_dir(dir.path().join("objects")).expect("objects").map(|e| e.expect("a file").path());
        let labels = labels.filter(|path| !path.ends_with(&both.hash)).collect::<Vec<_>>();
        assert_eq!(labels.len(), 1);
        std::fs::write(&labels[0], b"none").expect("damaged");
        assert!(matches!(corpus.cut(both.id), Err(CorpusError::Damaged(_))));
        assert!(matches!(corpus.put(with_parts(b"both", vec![2, 1])), Err(CorpusError::Damaged(_))));
        assert_eq!(corpus.health().quarantined, [both.id]);
        corpus.put(with_parts(b"both", vec![1, 2])).expect("healed");
        assert_eq!(corpus.cut(both.id).expect("a cut").besides, Besides::Known(vec![1, 2]));
    }

    #[test]
    fn the_same_bytes_cut_the_same_way_are_the_same_example() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let (first, _) = corpus.put(new_example(b"mesh", None)).expect("added");
        let (second, put) = corpus.put(new_example(b"mesh", None)).expect("there");
        assert_eq!((second.id, put), (first.id, Put::There));
        assert_eq!(corpus.find(b"mesh", &Cut::default()).map(|e| e.id), Some(first.id));
        assert_eq!(corpus.find(b"mesh", &Cut { way: Segmentation::Whole, ..Cut::default() }), None);
    }

    #[test]
    fn what_is_removed_is_gone_and_an_older_encoding_is_stale() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let (example, _) = corpus.put(new_example(b"mesh", None)).expect("added");
        assert_eq!(corpus.stale(1), []);
        assert_eq!(corpus.stale(2), [(example.id, 0)]);
        corpus.put_encoding(example.id, 0, &packed(2.0), example.counts, 2).expect("encoded again");
        assert_eq!(corpus.stale(2), []);
        corpus.remove(example.id).expect("removed");
        assert!(matches!(corpus.get(example.id), Err(CorpusError::NotFound(_))));
        assert!(matches!(corpus.remove(example.id), Err(CorpusError::NotFound(_))));
    }

    #[test]
    fn counts_are_told_while_encodings_are_made_anew() {
        let dir = tempfile::tempdir().expect("a directory");
        let mesh: &[u8] = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nf 1 2 3 4\nf 2 5 3\n";
        let counts = MeshCounts { vertices: 5, faces: 2, triangles: 1, quads: 1 };
        let (example, _) = open(dir.path()).put(NewExample { counts, ..new_example(mesh, None) }).expect("added");
        std::fs::remove_dir_all(dir.path().join("index")).expect("removed");
        let told = open(dir.path()).get(example.id).expect("there");
        assert_eq!((told.counts.triangles, told.counts.quads), (1, 1));
    }

    #[test]
    fn a_damaged_example_says_so_also_after_a_restart() {
        let dir = tempfile::tempdir().expect("a directory");
        let corpus = open(dir.path());
        let (example, _) = corpus.put(new_example(b"mesh", None)).expect("added");
        std::fs::write(dir.path().join("objects").join(&example.hash), b"hsem").expect("damaged");
        assert!(matches!(corpus.bytes(example.id), Err(CorpusError::Damaged(_))));
        drop(corpus);
        let corpus = open(dir.path());
        assert!(matches!(corpus.get(example.id), Err(CorpusError::Damaged(_))));
        assert_eq!(corpus.health().quarantined, [example.id]);
        corpus.put(new_example(b"mesh", None)).expect("healed");
        assert_eq!(corpus.bytes(example.id).expect("whole"), Bytes::from_static(b"mesh"));
        assert_eq!(corpus.health().quarantined, []);
    }

    #[test]
    fn it_is_writable_only_where_there_is_space() {
        use std::sync::atomic::{AtomicU64, Ordering};
        let dir = tempfile::tempdir().expect("a directory");
        let free = Arc::new(AtomicU64::new(u64::MAX));
        let probe = Arc::clone(&free);
        let free_space: quadmuse_store::FreeSpace = Arc::new(move |_| Ok(probe.load(Ordering::SeqCst)));
        let (corpus, _) =
            StoredCorpus::open(dir.path(), &OpenOptions { free_space, ..OpenOptions::default() }).expect("a store");
        assert_eq!(corpus.health().read_only, None);
        free.store(1 << 20, Ordering::SeqCst);
        assert!(corpus.health().read_only.is_some());
        assert!(matches!(corpus.put(new_example(b"mesh", None)), Err(CorpusError::Full(_))));
    }
}
