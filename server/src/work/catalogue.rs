//! What of the corpus is resident: every example's record and every segment's coarsest level.
//!
//! A search takes one [`Snapshot`] and sees the corpus as it was then, whatever is added or removed meanwhile.

use super::corpus::{Corpus, CorpusError};
use super::engine::{Encoding, Engine};
use super::error::WorkError;
use super::ranking::levels_up_to;
use quadmuse_proto::query::LEVELS;
use quadmuse_proto::{Example, ExampleId, Topology};
use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock};

/// The coarsest level of the pyramid, in pixels a side.
pub const LEVEL_COARSEST: u32 = LEVELS[0];

/// A segment that can be ranked.
#[derive(Debug)]
pub struct Resident {
    /// The example.
    pub example: Arc<Example>,
    /// The example's segment.
    pub segment: u32,
    /// Its encoding, with the coarsest level.
    pub coarse: Arc<Encoding>,
}

impl Resident {
    /// What ties are broken on: the content, so that no order of insertion shows.
    pub fn tie_break(&self) -> (&str, u32, ExampleId) {
        (&self.example.hash, self.segment, self.example.id)
    }

    /// Whether its example has all the tags.
    pub fn has_tags(&self, tags: &[String]) -> bool {
        tags.iter().all(|tag| self.example.tags.contains(tag))
    }
}

/// The resident corpus at some moment.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    examples: BTreeMap<ExampleId, Arc<Example>>,
    segments: BTreeMap<(ExampleId, u32), Arc<Resident>>,
}

impl Snapshot {
    /// The segments of a topology whose examples have all the tags, in the order of ties.
    pub fn segments_of(&self, topology: Topology, tags: &[String]) -> Vec<Arc<Resident>> {
        let fits = |r: &&Arc<Resident>| r.coarse.facts.topology == topology && r.has_tags(tags);
        let mut found: Vec<_> = self.segments.values().filter(fits).cloned().collect();
        found.sort_by(|a, b| a.tie_break().cmp(&b.tie_break()));
        found
    }

    /// A segment.
    pub fn segment(&self, example: ExampleId, segment: u32) -> Option<&Arc<Resident>> {
        self.segments.get(&(example, segment))
    }

    /// An example.
    pub fn example(&self, id: ExampleId) -> Option<&Arc<Example>> {
        self.examples.get(&id)
    }

    /// The examples after `after`, in order of creation.
    pub fn examples_after(&self, after: Option<ExampleId>) -> impl Iterator<Item = &Arc<Example>> {
        use std::ops::Bound::{Excluded, Unbounded};
        self.examples.range((after.map_or(Unbounded, Excluded), Unbounded)).map(|(_, example)| example)
    }

    /// Number of examples.
    pub fn example_count(&self) -> usize {
        self.examples.len()
    }

    /// Number of segments that can be ranked.
    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// Segments of its examples, whether they can be ranked or not.
    pub fn segment_count_all(&self) -> usize {
        self.examples.values().map(|example| example.segments.len()).sum()
    }

    fn put(&mut self, example: &Arc<Example>, encodings: Vec<(u32, Arc<Encoding>)>) {
        self.examples.insert(example.id, Arc::clone(example));
        for (segment, coarse) in encodings {
            let resident = Resident { example: Arc::clone(example), segment, coarse };
            self.segments.insert((example.id, segment), Arc::new(resident));
        }
    }
}

/// The resident corpus, kept in step with the store by those who change it.
pub struct Catalogue {
    corpus: Arc<dyn Corpus>,
    engine: Arc<dyn Engine>,
    now: RwLock<Arc<Snapshot>>,
}

impl Catalogue {
    /// An empty catalogue of `corpus`.
    pub fn new(corpus: Arc<dyn Corpus>, engine: Arc<dyn Engine>) -> Self {
        Self { corpus, engine, now: RwLock::default() }
    }

    /// The corpus now.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(&self.now.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Brings the whole corpus in. Blocks.
    pub fn load(&self) {
        let mut fresh = Snapshot::default();
        for example in self.corpus.list() {
            let encodings = self.coarse_of(&example);
            fresh.put(&example, encodings);
        }
        *self.now.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(fresh);
    }

    /// Brings an example in, or its new state and encodings. Blocks.
    pub fn refresh(&self, example: &Arc<Example>) {
        let encodings = self.coarse_of(example);
        self.put_newest(example.id, encodings);
    }

    /// Brings an example's new annotations in; its encodings are the same.
    pub fn annotate(&self, example: &Arc<Example>) {
        let now = self.snapshot();
        let of = now.segments.range((example.id, 0)..=(example.id, u32::MAX));
        self.put_newest(example.id, of.map(|(key, r)| (key.1, Arc::clone(&r.coarse))).collect());
    }

    /// The record is read under the lock, so that whoever comes last brings the newest, and none that was removed.
    fn put_newest(&self, id: ExampleId, encodings: Vec<(u32, Arc<Encoding>)>) {
        self.change(|snapshot| {
            if let Ok(newest) = self.corpus.get(id) {
                snapshot.put(&newest, encodings);
            }
        });
    }

    /// Takes an example out.
    pub fn forget(&self, id: ExampleId) {
        self.change(|snapshot| {
            snapshot.examples.remove(&id);
            let gone: Vec<_> = snapshot.segments.range((id, 0)..=(id, u32::MAX)).map(|(key, _)| *key).collect();
            gone.iter().for_each(|key| drop(snapshot.segments.remove(key)));
        });
    }

    fn change(&self, change: impl FnOnce(&mut Snapshot)) {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        change(Arc::make_mut(&mut now));
    }

    /// The coarse encodings that are there; those that are not are left to `reencode`.
    fn coarse_of(&self, example: &Example) -> Vec<(u32, Arc<Encoding>)> {
        let load = |segment: u32| match self.encoding(example.id, segment, LEVEL_COARSEST) {
            Ok(encoding) => Some((segment, Arc::new(encoding))),
            Err(error) => {
                tracing::warn!(example = %example.id, segment, %error, "no encoding: not ranked until it is rebuilt");
                None
            }
        };
        example.segments.iter().filter_map(|s| load(s.segment)).collect()
    }

    /// An encoding with one level of its pyramid, from the store. Blocks.
    ///
    /// # Errors
    /// [`WorkError::Corpus`], [`WorkError::Engine`].
    pub fn encoding(&self, id: ExampleId, segment: u32, level: u32) -> Result<Encoding, WorkError> {
        let packed = self.corpus.encoding(id, segment, level)?;
        Ok(self.engine.unpack(&packed)?)
    }

    /// An encoding with all levels up to `level`, from the store. Blocks.
    ///
    /// # Errors
    /// [`WorkError::Corpus`], [`WorkError::Engine`].
    pub fn pyramid(&self, id: ExampleId, segment: u32, level: u32) -> Result<Encoding, WorkError> {
        let mut levels = levels_up_to(level);
        let mut packed = self.corpus.encoding(id, segment, levels.next().unwrap_or(LEVEL_COARSEST))?;
        for finer in levels {
            packed.levels.extend(self.corpus.encoding(id, segment, finer)?.levels);
        }
        Ok(self.engine.unpack(&packed)?)
    }

    /// An example.
    ///
    /// # Errors
    /// [`CorpusError::NotFound`].
    pub fn example(&self, id: ExampleId) -> Result<Arc<Example>, WorkError> {
        let snapshot = self.snapshot();
        Ok(snapshot.example(id).cloned().ok_or(CorpusError::NotFound(id))?)
    }
}
