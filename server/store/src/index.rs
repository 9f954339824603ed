//! The corpus in memory: every record and every pointer, so that listing and reading of records never wait for the disk.

use std::collections::{BTreeMap, HashMap};
use std::ops::Bound;
use std::sync::Arc;

use quadmuse_proto::id::ExampleId;

use crate::engine::Pointer;
use crate::keys::SegmentKey;
use crate::record::{ContentHash, ExampleRecord, Topology};

/// The examples at one moment, in order of their ids (that is, of their creation), without the quarantined ones.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Grows with every change of the corpus; not kept over restarts.
    pub revision: u64,
    /// The examples.
    pub examples: Vec<Arc<ExampleRecord>>,
}

/// What a list is narrowed to.
#[derive(Clone, Copy, Debug, Default)]
pub struct Filter<'a> {
    /// Only examples with this tag.
    pub tag: Option<&'a str>,
    /// Only examples with a segment of this kind.
    pub topology: Option<Topology>,
}

impl Filter<'_> {
    /// Whether an example passes.
    pub fn passes(&self, record: &ExampleRecord) -> bool {
        let tag = self.tag.is_none_or(|tag| record.tags.iter().any(|found| found == tag));
        let topology = self.topology.is_none_or(|kind| record.segments.iter().any(|segment| segment.topology == kind));
        tag && topology
    }
}

/// A page of a list.
#[derive(Clone, Debug)]
pub struct Page {
    /// The examples, in order of their ids.
    pub examples: Vec<Arc<ExampleRecord>>,
    /// The id to go on after; `None` at the end.
    pub next: Option<ExampleId>,
}

/// One change of the corpus.
pub(crate) enum Change {
    Record(Arc<ExampleRecord>),
    Pointer(SegmentKey, Arc<Pointer>),
    Removed(ExampleId),
    Quarantined(ExampleId, String),
    Healed(ExampleId),
}

#[derive(Default)]
pub(crate) struct Index {
    records: BTreeMap<ExampleId, Arc<ExampleRecord>>,
    identities: HashMap<ContentHash, ExampleId>,
    objects: HashMap<ContentHash, usize>,
    pointers: BTreeMap<SegmentKey, Arc<Pointer>>,
    quarantined: BTreeMap<ExampleId, String>,
    revision: u64,
    snapshot: Option<Arc<Snapshot>>,
}

impl Index {
    pub(crate) fn apply(&mut self, change: Change) {
        match change {
            Change::Record(record) => {
                self.forget_record(record.id);
                for object in record.objects() {
                    *self.objects.entry(object).or_default() += 1;
                }
                self.identities.insert(record.identity, record.id);
                self.records.insert(record.id, record);
            }
            Change::Pointer(key, pointer) => {
                self.pointers.insert(key, pointer);
            }
            Change::Removed(id) => {
                self.forget_record(id);
                self.quarantined.remove(&id);
                let keys: Vec<SegmentKey> = self.pointers_of(id).map(|(key, _)| key).collect();
                keys.iter().for_each(|key| drop(self.pointers.remove(key)));
            }
            Change::Quarantined(id, reason) => {
                self.quarantined.insert(id, reason);
            }
            Change::Healed(id) => {
                self.quarantined.remove(&id);
            }
        }
        self.revision += 1;
        self.snapshot = None;
    }

    fn forget_record(&mut self, id: ExampleId) {
        let Some(record) = self.records.remove(&id) else { return };
        self.identities.remove(&record.identity);
        for object in record.objects() {
            if let Some(count) = self.objects.get_mut(&object) {
                *count = count.saturating_sub(1);
                if *count == 0 {
                    self.objects.remove(&object);
                }
            }
        }
    }

    /// A record, quarantined or not.
    pub(crate) fn record(&self, id: ExampleId) -> Option<&Arc<ExampleRecord>> {
        self.records.get(&id)
    }

    pub(crate) fn records(&self) -> impl Iterator<Item = &Arc<ExampleRecord>> {
        self.records.values()
    }

    pub(crate) fn len(&self) -> usize {
        self.records.len()
    }

    pub(crate) fn by_identity(&self, identity: ContentHash) -> Option<&Arc<ExampleRecord>> {
        self.records.get(self.identities.get(&identity)?)
    }

    /// How many records name this object.
    pub(crate) fn object_uses(&self, object: ContentHash) -> usize {
        self.objects.get(&object).copied().unwrap_or(0)
    }

    pub(crate) fn quarantine_reason(&self, id: ExampleId) -> Option<&str> {
        self.quarantined.get(&id).map(String::as_str)
    }

    pub(crate) fn quarantined(&self) -> &BTreeMap<ExampleId, String> {
        &self.quarantined
    }

    pub(crate) fn pointer(&self, key: SegmentKey) -> Option<&Arc<Pointer>> {
        self.pointers.get(&key)
    }

    pub(crate) fn pointers(&self) -> impl Iterator<Item = (SegmentKey, &Arc<Pointer>)> {
        self.pointers.iter().map(|(&key, pointer)| (key, pointer))
    }

    pub(crate) fn pointers_of(&self, id: ExampleId) -> impl Iterator<Item = (SegmentKey, &Arc<Pointer>)> {
        self.pointers.range((id, 0)..=(id, u32::MAX)).map(|(&key, pointer)| (key, pointer))
    }

    pub(crate) fn list(&self, after: Option<ExampleId>, limit: usize, filter: Filter<'_>) -> Page {
        let start = after.map_or(Bound::Unbounded, Bound::Excluded);
        let mut passing = self
            .records
            .range((start, Bound::Unbounded))
            .filter(|(id, record)| !self.quarantined.contains_key(id) && filter.passes(record))
            .map(|(_, record)| record.clone());
        let examples: Vec<_> = passing.by_ref().take(limit).collect();
        let more = passing.next().is_some();
        let next = examples.last().map(|record| record.id).filter(|_| more);
        Page { examples, next }
    }

    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// Goes on counting where another index stopped.
    pub(crate) fn continue_from(&mut self, revision: u64) {
        self.revision = self.revision.max(revision + 1);
        self.snapshot = None;
    }

    pub(crate) fn snapshot(&mut self) -> Arc<Snapshot> {
        let taken = self.snapshot.take().unwrap_or_else(|| {
            let whole = self.records.values().filter(|record| !self.quarantined.contains_key(&record.id));
            Arc::new(Snapshot { revision: self.revision, examples: whole.cloned().collect() })
        });
        self.snapshot = Some(taken.clone());
        taken
    }
}
