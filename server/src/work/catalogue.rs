//! What of the corpus is resident: every example's record and every segment's coarsest picture, as row spectra.
//!
//! A search takes one [`Snapshot`] and sees the corpus as it was then, whatever is added or removed meanwhile.

pub mod row_blocks;

use super::corpus::{Corpus, CorpusError, KeptRow};
use super::engine::{Encoding, Engine, SegmentFacts};
use super::error::WorkError;
use super::ranking::levels_up_to;
use quadmuse_kernel::register::spectra::LANES;
use quadmuse_proto::query::LEVELS;
use quadmuse_proto::{Example, ExampleId, Share, Topology};
use quadmuse_store::Changed;
use row_blocks::{RowBlocks, Slot};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

/// The coarsest level of the pyramid, in pixels a side.
pub const LEVEL_COARSEST: u32 = LEVELS[0];

/// A segment that can be ranked.
#[derive(Debug)]
pub struct Resident {
    /// The example.
    pub example: Arc<Example>,
    /// The example's segment.
    pub segment: u32,
    /// What is known of it.
    pub facts: SegmentFacts,
    /// Where it stands on its blocks; of no meaning where another server holds its picture.
    pub place: Slot,
}

impl Resident {
    /// What ties are broken on: the content, so that no order of insertion shows.
    pub fn tie_break(&self) -> (&str, u32, ExampleId) {
        (&self.example.hash, self.segment, self.example.id)
    }

    /// Whether it is a part of its example, which is there whole, too.
    pub fn is_part(&self) -> bool {
        self.example.segments.get(self.segment as usize).is_some_and(|segment| segment.is_part)
    }

    /// Whether its example is there whole and by its parts.
    pub fn has_siblings(&self) -> bool {
        self.example.segments.iter().any(|segment| segment.is_part)
    }

    /// Whether its example has all the tags.
    pub fn has_tags(&self, tags: &[String]) -> bool {
        tags.iter().all(|tag| self.example.tags.contains(tag))
    }
}

/// Which segments stand on a blocks. Parts stand apart, so that who compares wholes alone doesn't pass them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stock {
    /// Examples, or the segments they were cut into.
    Wholes,
    /// Parts of examples that are there whole, too.
    Parts,
}

impl Stock {
    fn of(resident: &Resident) -> Self {
        if resident.is_part() { Self::Parts } else { Self::Wholes }
    }
}

/// The resident corpus at some moment.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// The share whose pictures are in memory; `None`: all are.
    share: Option<Share>,
    examples: BTreeMap<ExampleId, Arc<Example>>,
    segments: BTreeMap<(ExampleId, u32), Arc<Resident>>,
    row_blocks: BTreeMap<(Topology, Stock), RowBlocks>,
    /// Those whose pictures other servers hold.
    elsewhere: BTreeMap<(Topology, Stock), BTreeMap<(ExampleId, u32), Arc<Resident>>>,
}

impl Snapshot {
    /// The share whose pictures are in memory; `None`: all are.
    pub fn share(&self) -> Option<Share> {
        self.share
    }

    /// The segments of a topology.
    pub fn row_blocks(&self, topology: Topology, stock: Stock) -> Option<&RowBlocks> {
        self.row_blocks.get(&(topology, stock))
    }

    /// The segments of a topology whose pictures other servers hold.
    pub fn elsewhere(&self, topology: Topology, stock: Stock) -> impl Iterator<Item = &Arc<Resident>> {
        self.elsewhere.get(&(topology, stock)).into_iter().flat_map(BTreeMap::values)
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

    fn put(&mut self, example: &Arc<Example>, rows: Vec<KeptRow>) {
        self.examples.insert(example.id, Arc::clone(example));
        for KeptRow { segment, facts, row } in rows {
            self.take_out((example.id, segment));
            let is_part = example.segments.get(segment as usize).is_some_and(|segment| segment.is_part);
            let stock = if is_part { Stock::Parts } else { Stock::Wholes };
            let row_is_elsewhere = row.is_none();
            let made = |place| Resident { example: Arc::clone(example), segment, facts, place };
            let (key, kind) = ((example.id, segment), (facts.topology, stock));
            let resident = match row {
                Some(row) => self.row_blocks.entry(kind).or_default().put(&row, facts.shape(), made),
                None => Arc::new(made(Slot::default())),
            };
            if row_is_elsewhere {
                self.elsewhere.entry(kind).or_default().insert(key, Arc::clone(&resident));
            }
            self.segments.insert(key, resident);
        }
    }

    /// The same segments with another record.
    fn annotate(&mut self, example: &Arc<Example>) {
        self.examples.insert(example.id, Arc::clone(example));
        for (&(_, segment), resident) in self.segments.range_mut((example.id, 0)..=(example.id, u32::MAX)) {
            let Resident { facts, place, .. } = **resident;
            *resident = Arc::new(Resident { example: Arc::clone(example), segment, facts, place });
            let kind = (facts.topology, Stock::of(resident));
            if let Some(there) = self.elsewhere.get_mut(&kind).and_then(|all| all.get_mut(&(example.id, segment))) {
                *there = Arc::clone(resident);
            } else if let Some(blocks) = self.row_blocks.get_mut(&kind) {
                blocks.replace(resident);
            }
        }
    }

    fn set(&mut self, id: ExampleId, now: ExampleChange) {
        match now {
            ExampleChange::Encoded(example, rows) => self.put(&example, rows),
            ExampleChange::Annotated(example) => self.annotate(&example),
            ExampleChange::Gone => self.forget(id),
            ExampleChange::AsBefore => {}
        }
    }

    fn forget(&mut self, id: ExampleId) {
        self.examples.remove(&id);
        let gone: Vec<_> = self.segments.range((id, 0)..=(id, u32::MAX)).map(|(key, _)| *key).collect();
        gone.into_iter().for_each(|key| self.take_out(key));
    }

    fn take_out(&mut self, key: (ExampleId, u32)) {
        let Some(gone) = self.segments.remove(&key) else { return };
        let kind = (gone.facts.topology, Stock::of(&gone));
        let was_elsewhere = self.elsewhere.get_mut(&kind).and_then(|all| all.remove(&key)).is_some();
        if let Some(blocks) = self.row_blocks.get_mut(&kind).filter(|_| !was_elsewhere) {
            blocks.remove(gone.place);
        }
    }
}

/// Tells what became of an example.
enum ExampleChange {
    Encoded(Arc<Example>, Vec<KeptRow>),
    Annotated(Arc<Example>),
    Gone,
    AsBefore,
}

/// Examples that are brought in together: their rows are in memory twice for a moment.
const FOLLOWED_AT_ONCE: usize = 1000;

/// The resident corpus, which follows the changes of the corpus, whoever made them: a writer before it answers, and the
/// service in the background ([`super::follow`]).
pub struct Catalogue {
    corpus: Arc<dyn Corpus>,
    engine: Arc<dyn Engine>,
    /// The share whose pictures are in memory; `None`: all are.
    share: Option<Share>,
    now: RwLock<Arc<Snapshot>>,
    /// The position of the last change that is in. Held while changes are brought in, so that they come in order.
    followed: Mutex<u64>,
}

impl Catalogue {
    /// An empty catalogue of `corpus`.
    pub fn new(corpus: Arc<dyn Corpus>, engine: Arc<dyn Engine>) -> Self {
        Self { corpus, engine, share: None, now: RwLock::default(), followed: Mutex::new(0) }
    }

    /// The same with the pictures of one share alone.
    #[must_use]
    pub fn holding(self, share: Option<Share>) -> Self {
        let now = RwLock::new(Arc::new(Snapshot { share, ..Snapshot::default() }));
        Self { share, now, ..self }
    }

    /// The share whose pictures are in memory; `None`: all are.
    pub fn share(&self) -> Option<Share> {
        self.share
    }

    /// Whether the pictures of an example are to be in memory.
    fn is_held(&self, id: ExampleId) -> bool {
        self.share.is_none_or(|share| share.holds(id))
    }

    /// The corpus now.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(&self.now.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Brings the whole corpus in; how many rows had to be made from their encodings. Blocks.
    pub fn load(&self) -> usize {
        self.load_at(&mut self.followed())
    }

    fn followed(&self) -> MutexGuard<'_, u64> {
        self.followed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn load_at(&self, followed: &mut u64) -> usize {
        // What changes while the corpus is read comes in twice, and is the same then.
        *followed = self.corpus.changes(u64::MAX).position;
        let mut fresh = Snapshot { share: self.share, ..Snapshot::default() };
        let mut kept = self.corpus.take_rows();
        let mut made = 0;
        for example in self.corpus.list() {
            let rows = kept.remove(&example.id).and_then(|rows| self.whole(&example, rows));
            let rows = rows.unwrap_or_else(|| {
                let rows = self.rows_of(&example);
                made += rows.len();
                rows
            });
            fresh.put(&example, rows);
        }
        *self.now.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(fresh);
        made
    }

    /// Writes all rows down, so that the next start needn't make them. Blocks.
    ///
    /// # Errors
    /// [`CorpusError`].
    pub fn keep(&self) -> Result<(), CorpusError> {
        let snapshot = self.snapshot();
        let chunks = snapshot.row_blocks.values().flat_map(|blocks| blocks.chunks());
        let rows = chunks.flat_map(|chunk| (0..LANES).filter_map(|lane| chunk.row(lane)));
        let kept = |(row, r): (_, &Arc<Resident>)| {
            (r.example.id, KeptRow { segment: r.segment, facts: r.facts, row: Some(row) })
        };
        let mut rows = rows.map(kept);
        self.corpus.keep_rows(&mut rows)
    }

    /// Brings in what changed since the last time. Blocks; when it returns, all that was written before the call is in.
    pub fn follow(&self) {
        let mut followed = self.followed();
        let changes = self.corpus.changes(*followed);
        let Some(changed) = changes.changed else {
            tracing::info!("too far behind the corpus's changes: it is read anew");
            self.load_at(&mut followed);
            return;
        };
        // One look an example, however often it changed.
        let mut by_id: BTreeMap<ExampleId, bool> = BTreeMap::new();
        for one in changed {
            *by_id.entry(one.id()).or_default() |= matches!(one, Changed::Encoded(_));
        }
        let ids: Vec<_> = by_id.into_iter().collect();
        for some in ids.chunks(FOLLOWED_AT_ONCE) {
            let now: Vec<_> = some.iter().map(|&(id, is_encoded)| (id, self.now_of(id, is_encoded))).collect();
            self.change(|snapshot| now.into_iter().for_each(|(id, now)| snapshot.set(id, now)));
        }
        *followed = changes.position;
    }

    /// What an example is now, read from the corpus.
    fn now_of(&self, id: ExampleId, is_encoded: bool) -> ExampleChange {
        match self.corpus.get(id) {
            Ok(example) if is_encoded => {
                let rows = self.corpus.rows_of(id).and_then(|rows| self.whole(&example, rows));
                let rows = rows.unwrap_or_else(|| self.rows_of(&example));
                ExampleChange::Encoded(example, rows)
            }
            Ok(example) => ExampleChange::Annotated(example),
            Err(CorpusError::NotFound(_)) => ExampleChange::Gone,
            // One that is set aside stays until it is healed or removed; its encodings are whole.
            Err(_) => ExampleChange::AsBefore,
        }
    }

    fn change(&self, change: impl FnOnce(&mut Snapshot)) {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        change(Arc::make_mut(&mut now));
    }

    /// The rows of an example, if all are there, with the pictures that are to be in memory and without the others.
    fn whole(&self, example: &Example, mut rows: Vec<KeptRow>) -> Option<Vec<KeptRow>> {
        let is_held = self.is_held(example.id);
        if !is_held {
            rows.iter_mut().for_each(|kept| kept.row = None);
        }
        let is_whole = rows.len() == example.segments.len() && (!is_held || rows.iter().all(|kept| kept.row.is_some()));
        is_whole.then_some(rows)
    }

    /// The rows of the encodings that are there; those that are not are left to `reencode`.
    fn rows_of(&self, example: &Example) -> Vec<KeptRow> {
        let is_held = self.is_held(example.id);
        let load = |segment: u32| {
            let encoding = self.encoding(example.id, segment, LEVEL_COARSEST);
            let row = |encoding: &Encoding| is_held.then(|| self.engine.row(encoding)).transpose();
            match encoding.and_then(|encoding| Ok((encoding.facts, row(&encoding)?))) {
                Ok((facts, row)) => Some(KeptRow { segment, facts, row }),
                Err(error) => {
                    tracing::warn!(example = %example.id, segment, %error, "no encoding: not ranked until it is rebuilt");
                    None
                }
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
        match snapshot.example(id) {
            Some(example) => Ok(Arc::clone(example)),
            // One that is set aside says so.
            None => Err(self.corpus.get(id).err().unwrap_or(CorpusError::NotFound(id)).into()),
        }
    }
}
