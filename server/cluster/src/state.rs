//! The corpus as this server knows it: what the engine delivered, and what it wrote itself.
//!
//! Entries may come twice, late or out of order: of each key the newest position counts, also of what was removed. An engine that
//! lost its end gives positions away again: of two entries at one, the one that came last counts.

use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{Hash, Hasher};
use std::sync::Arc;

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{ChangeLog, Changed, ContentHash, Document, ExampleRecord, SegmentRow, Snapshot};

use crate::engine::Entry;
use crate::manifest::{DOCUMENT, EXAMPLE, Manifest};

/// Where the encoding of a segment is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Encoding {
    pub(crate) encoder_version: u32,
    pub(crate) object: ContentHash,
    pub(crate) bytes: u64,
}

/// An example.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    pub(crate) record: Arc<ExampleRecord>,
    pub(crate) encodings: Vec<Option<Encoding>>,
}

impl Known {
    /// The objects that it needs.
    pub(crate) fn objects(&self) -> impl Iterator<Item = ContentHash> + '_ {
        self.record.objects().chain(self.encodings.iter().flatten().map(|encoding| encoding.object))
    }
}

/// What stands under a key.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Slot {
    position: u64,
    /// Tells two entries at one position apart.
    content: u64,
    /// `None`: it was removed.
    id: Option<ExampleId>,
}

/// What is kept in memory of the row of a segment of an example, which is opaque here.
pub type RowKeeper = Arc<dyn Fn(ExampleId, Vec<u8>) -> Vec<u8> + Send + Sync>;

#[derive(Default)]
pub(crate) struct State {
    slots: HashMap<ContentHash, Slot>,
    examples: BTreeMap<ExampleId, Known>,
    /// Rows that nobody has asked for yet.
    rows: HashMap<ExampleId, Vec<SegmentRow>>,
    documents: HashMap<String, Document>,
    /// Examples whose ground state was found damaged, and how.
    damaged: BTreeMap<ExampleId, String>,
    log: ChangeLog,
    /// The newest position of all entries that came or were written here.
    newest: u64,
    row_keeper: Option<RowKeeper>,
    snapshot: Option<Arc<Snapshot>>,
    /// Keys of entries that this release can't read.
    unread: BTreeSet<String>,
    /// Keys of a newer release, which mean nothing here.
    foreign: BTreeSet<String>,
}

impl State {
    /// An empty one that keeps of each row what is told; all of it, if nothing is.
    pub(crate) fn keeping(row_keeper: Option<RowKeeper>) -> Self {
        Self { row_keeper, ..Self::default() }
    }

    /// Takes an entry in, unless a newer one of its key is; whether anything changed.
    pub(crate) fn apply(&mut self, key: &str, entry: &Entry) -> bool {
        self.newest = self.newest.max(entry.position);
        if let Some(name) = key.strip_prefix(DOCUMENT) {
            let is_known = |known: &Document| known.revision == entry.position && *known.bytes == *entry.bytes;
            let newer = self.documents.get(name).is_none_or(|d| d.revision <= entry.position && !is_known(d));
            if newer {
                let document = Document { revision: entry.position, bytes: entry.bytes.as_slice().into() };
                self.documents.insert(name.to_owned(), document);
            }
            return newer;
        }
        let Some(identity) = key.strip_prefix(EXAMPLE).and_then(ContentHash::from_hex) else {
            // Of a newer release; whatever it is, it is no example.
            self.foreign.insert(key.to_owned());
            return false;
        };
        let content = content(&entry.bytes);
        let is_known =
            |slot: &Slot| slot.position > entry.position || slot.position == entry.position && slot.content == content;
        if self.slots.get(&identity).is_some_and(is_known) {
            return false;
        }
        match Manifest::from_bytes(&entry.bytes) {
            Ok(manifest) => {
                self.unread.remove(key);
                self.set(identity, (entry.position, content), manifest);
            }
            Err(reason) => {
                tracing::error!(key, reason, "an entry of the corpus can't be read");
                self.unread.insert(key.to_owned());
            }
        }
        true
    }

    fn set(&mut self, identity: ContentHash, (position, content): (u64, u64), mut manifest: Manifest) {
        let rows = manifest.take_rows();
        let Manifest { record, segments, .. } = manifest;
        let id = record.as_ref().map(|record| record.id);
        let before = self.slots.insert(identity, Slot { position, content, id }).and_then(|slot| slot.id);
        self.snapshot = None;
        if let Some(gone) = before.filter(|before| Some(*before) != id) {
            self.examples.remove(&gone);
            self.rows.remove(&gone);
            self.damaged.remove(&gone);
            self.log.push(Changed::Removed(gone));
        }
        let Some(record) = record else { return };
        let id = record.id;
        let encodings = segments.into_iter().map(|segment| {
            segment.map(|segment| Encoding {
                encoder_version: segment.encoder_version,
                object: segment.object,
                bytes: segment.bytes,
            })
        });
        let mut encodings: Vec<_> = encodings.collect();
        encodings.resize(record.segments.len(), None);
        let same = self.examples.get(&id).is_some_and(|known| known.encodings == encodings);
        self.examples.insert(id, Known { record: Arc::new(record), encodings });
        if same {
            self.log.push(Changed::Annotated(id));
        } else {
            let rows = match &self.row_keeper {
                Some(keep) => rows.into_iter().map(|(segment, row)| (segment, keep(id, row))).collect(),
                None => rows,
            };
            self.rows.insert(id, rows);
            self.log.push(Changed::Encoded(id));
        }
    }

    /// The position to write an identity at where no example is known to be: 0, or that of one that was removed.
    pub(crate) fn vacant(&self, identity: ContentHash) -> Option<u64> {
        match self.slots.get(&identity) {
            None => Some(0),
            Some(Slot { position, id: None, .. }) => Some(*position),
            Some(_) => None,
        }
    }

    /// How many keys it knows an entry of.
    pub(crate) fn keys(&self) -> u64 {
        let unread = self.unread.iter().filter(|key| self.position(key) == 0).count();
        (self.slots.len() + self.documents.len() + self.foreign.len() + unread) as u64
    }

    /// Tells whether an entry of a key is known, also one that can't be read.
    pub(crate) fn knows(&self, key: &str) -> bool {
        self.position(key) > 0 || self.foreign.contains(key) || self.unread.contains(key)
    }

    /// The newest position known of a key; 0 if none is.
    pub(crate) fn position(&self, key: &str) -> u64 {
        let known = match key.strip_prefix(DOCUMENT) {
            Some(name) => self.documents.get(name).map(|document| document.revision),
            None => {
                let identity = key.strip_prefix(EXAMPLE).and_then(ContentHash::from_hex);
                identity.and_then(|identity| self.slots.get(&identity)).map(|slot| slot.position)
            }
        };
        known.unwrap_or(0)
    }

    pub(crate) fn example(&self, id: ExampleId) -> Option<&Known> {
        self.examples.get(&id)
    }

    pub(crate) fn by_identity(&self, identity: ContentHash) -> Option<&Known> {
        self.examples.get(&self.slots.get(&identity)?.id?)
    }

    pub(crate) fn examples(&self) -> impl Iterator<Item = &Known> {
        self.examples.values()
    }

    pub(crate) fn snapshot(&mut self) -> Arc<Snapshot> {
        let taken = self.snapshot.take().unwrap_or_else(|| {
            let whole = self.examples.values().filter(|known| !self.damaged.contains_key(&known.record.id));
            let examples = whole.map(|known| Arc::clone(&known.record)).collect();
            Arc::new(Snapshot { revision: self.log.newest(), examples })
        });
        self.snapshot = Some(Arc::clone(&taken));
        taken
    }

    pub(crate) fn take_rows(&mut self) -> HashMap<ExampleId, Vec<SegmentRow>> {
        std::mem::take(&mut self.rows)
    }

    pub(crate) fn take_rows_of(&mut self, id: ExampleId) -> Vec<SegmentRow> {
        self.rows.remove(&id).unwrap_or_default()
    }

    pub(crate) fn document(&self, name: &str) -> Option<Document> {
        self.documents.get(name).cloned()
    }

    pub(crate) fn newest(&self) -> u64 {
        self.newest
    }

    pub(crate) fn log(&self) -> &ChangeLog {
        &self.log
    }

    /// Sets an example aside.
    pub(crate) fn quarantine(&mut self, id: ExampleId, reason: &str) {
        if self.examples.contains_key(&id) {
            self.damaged.insert(id, reason.to_owned());
            self.snapshot = None;
        }
    }

    /// Takes an example back that was set aside.
    pub(crate) fn heal(&mut self, id: ExampleId) {
        if self.damaged.remove(&id).is_some() {
            self.snapshot = None;
            self.log.push(Changed::Encoded(id));
        }
    }

    pub(crate) fn damage(&self, id: ExampleId) -> Option<&str> {
        self.damaged.get(&id).map(String::as_str)
    }

    pub(crate) fn damaged(&self) -> Vec<(ExampleId, String)> {
        self.damaged.iter().map(|(&id, reason)| (id, reason.clone())).collect()
    }

    /// Keys of entries that this release can't read.
    pub(crate) fn unread(&self) -> usize {
        self.unread.len()
    }
}

fn content(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_entries_at_one_position_the_last_to_come_counts() {
        let mut state = State::keeping(None);
        let key = format!("{DOCUMENT}tokens");
        let entry = |position: u64, text: &str| Entry { position, bytes: text.as_bytes().to_vec() };
        let mut applied = |position, text| {
            let changed = state.apply(&key, &entry(position, text));
            let document = state.document("tokens").expect("there");
            (changed, document.revision, String::from_utf8_lossy(&document.bytes).into_owned())
        };
        assert_eq!(applied(4, "one"), (true, 4, "one".into()));
        assert_eq!(applied(4, "one"), (false, 4, "one".into()));
        assert_eq!(applied(4, "another"), (true, 4, "another".into()));
        assert_eq!(applied(3, "late"), (false, 4, "another".into()));
        assert_eq!(applied(5, "new"), (true, 5, "new".into()));

        let removed = |position: u64, write: u64| {
            let bytes = Manifest::removed().written(write, None).to_bytes().expect("packed");
            Entry { position, bytes }
        };
        let key = Manifest::key(ContentHash::of(b"a mesh"));
        let came = [(7, 1), (7, 1), (7, 2), (6, 3), (8, 2)].map(|(at, write)| state.apply(&key, &removed(at, write)));
        assert_eq!(came, [true, false, true, false, true]);
    }
}
