//! A corpus in memory, for tests.

use super::*;
use crate::work::engine::ExtraParts;
use crate::work::query::rfc3339;
use quadmuse_proto::ExampleSegment;
use quadmuse_store::{ChangeLog, Changed};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};

/// The corpus.
pub(crate) struct MemoryCorpus {
    rows: Mutex<BTreeMap<ExampleId, Row>>,
    log: Mutex<ChangeLog>,
    newest: watch::Sender<u64>,
    /// Refuses writes as a full disk does.
    pub(crate) full: AtomicBool,
}

struct Row {
    example: Arc<Example>,
    bytes: Bytes,
    cut: Cut,
    segments: Vec<(u32, PackedEncoding)>,
}

impl Default for MemoryCorpus {
    fn default() -> Self {
        Self {
            rows: Mutex::default(),
            log: Mutex::default(),
            newest: watch::Sender::new(0),
            full: AtomicBool::new(false),
        }
    }
}

impl MemoryCorpus {
    fn rows(&self) -> MutexGuard<'_, BTreeMap<ExampleId, Row>> {
        self.rows.lock().expect("not poisoned")
    }

    /// Makes all encodings those of an older encoder.
    pub(crate) fn make_old(&self) {
        self.rows().values_mut().flat_map(|row| &mut row.segments).for_each(|(version, _)| *version -= 1);
    }

    fn tell(&self, changed: Changed) {
        let position = self.log.lock().expect("not poisoned").push(changed);
        self.newest.send_replace(position);
    }

    fn writable(&self) -> Result<(), CorpusError> {
        match self.full.load(Ordering::Relaxed) {
            true => Err(CorpusError::Full("expected free space, found none".into())),
            false => Ok(()),
        }
    }
}

fn described(new: &NewExample) -> Example {
    let id = ExampleId::generate();
    let has_parts = matches!(new.cut.besides, ExtraParts::Known(_));
    let segment = |(segment, packed): (usize, &PackedEncoding)| ExampleSegment {
        segment: segment as u32,
        is_part: has_parts && segment > 0,
        topology: packed.facts.topology,
        k: packed.facts.k,
        faces: packed.facts.faces,
        features: packed.facts.features,
    };
    Example {
        id,
        revision: 1,
        name: new.name.clone(),
        tags: new.tags.clone(),
        relevance: new.relevance,
        author: String::new(),
        licence: String::new(),
        notes: String::new(),
        landmarks: Vec::new(),
        hash: blake3::hash(&new.bytes).to_hex().to_string(),
        format: new.format.clone(),
        bytes: new.bytes.len() as u64,
        counts: MeshCounts::clone(&new.counts),
        segments: new.segments.iter().enumerate().map(segment).collect(),
        repairs: new.repairs.clone(),
        doubts: Vec::new(),
        created: rfc3339(id.created_unix_ms()),
        template: None,
    }
}

impl Corpus for MemoryCorpus {
    fn put(&self, new: NewExample) -> Result<(Arc<Example>, PutOutcome), CorpusError> {
        self.writable()?;
        if let Some(there) = self.find(&new.bytes, &new.cut) {
            return Ok((there, PutOutcome::There));
        }
        let example = Arc::new(described(&new));
        let segments = new.segments.into_iter().map(|packed| (new.encoder_version, packed)).collect();
        let row = Row { example: Arc::clone(&example), bytes: new.bytes, cut: new.cut, segments };
        self.rows().insert(example.id, row);
        self.tell(Changed::Encoded(example.id));
        Ok((example, PutOutcome::Added))
    }

    fn find(&self, bytes: &[u8], cut: &Cut) -> Option<Arc<Example>> {
        let rows = self.rows();
        // Whole and by its parts, or whole alone: it is one example.
        let as_whole = |cut: &Cut| Cut { besides: ExtraParts::Nothing, ..cut.clone() };
        let is_it = |row: &&Row| row.bytes == bytes && as_whole(&row.cut) == as_whole(cut);
        rows.values().find(is_it).map(|row| Arc::clone(&row.example))
    }

    fn get(&self, id: ExampleId) -> Result<Arc<Example>, CorpusError> {
        self.rows().get(&id).map(|row| Arc::clone(&row.example)).ok_or(CorpusError::NotFound(id))
    }

    fn list(&self) -> Vec<Arc<Example>> {
        self.rows().values().map(|row| Arc::clone(&row.example)).collect()
    }

    fn annotate(&self, id: ExampleId, patch: &ExamplePatch) -> Result<Arc<Example>, CorpusError> {
        self.writable()?;
        let mut rows = self.rows();
        let row = rows.get_mut(&id).ok_or(CorpusError::NotFound(id))?;
        let mut example = (*row.example).clone();
        if patch.revision.is_some_and(|revision| revision != example.revision) {
            return Err(CorpusError::Conflict(format!("expected another revision, found {}", example.revision)));
        }
        example.revision += 1;
        patch.name.iter().for_each(|name| example.name.clone_from(name));
        patch.tags.iter().for_each(|tags| example.tags.clone_from(tags));
        patch.relevance.iter().for_each(|relevance| example.relevance = *relevance);
        patch.author.iter().for_each(|author| example.author.clone_from(author));
        patch.licence.iter().for_each(|licence| example.licence.clone_from(licence));
        patch.notes.iter().for_each(|notes| example.notes.clone_from(notes));
        patch.landmarks.iter().for_each(|landmarks| example.landmarks.clone_from(landmarks));
        let example = Arc::new(example);
        row.example = Arc::clone(&example);
        drop(rows);
        self.tell(Changed::Annotated(id));
        Ok(example)
    }

    fn remove(&self, id: ExampleId) -> Result<(), CorpusError> {
        self.rows().remove(&id).map(drop).ok_or(CorpusError::NotFound(id))?;
        self.tell(Changed::Removed(id));
        Ok(())
    }

    fn bytes(&self, id: ExampleId) -> Result<Bytes, CorpusError> {
        self.rows().get(&id).map(|row| row.bytes.clone()).ok_or(CorpusError::NotFound(id))
    }

    fn cut(&self, id: ExampleId) -> Result<Cut, CorpusError> {
        self.rows().get(&id).map(|row| row.cut.clone()).ok_or(CorpusError::NotFound(id))
    }

    fn encoding(&self, id: ExampleId, segment: u32, level: u32) -> Result<PackedEncoding, CorpusError> {
        let rows = self.rows();
        let row = rows.get(&id).ok_or(CorpusError::NotFound(id))?;
        let (_, packed) = row.segments.get(segment as usize).ok_or_else(|| CorpusError::NoEncoding("none".into()))?;
        let levels = packed.levels.iter().filter(|(side, _)| *side == level).cloned().collect();
        Ok(PackedEncoding { levels, ..packed.clone() })
    }

    fn put_encoding(
        &self,
        id: ExampleId,
        segment: u32,
        packed: &PackedEncoding,
        _: MeshCounts,
        version: u32,
    ) -> Result<(), CorpusError> {
        let mut rows = self.rows();
        let row = rows.get_mut(&id).ok_or(CorpusError::NotFound(id))?;
        row.segments[segment as usize] = (version, packed.clone());
        drop(rows);
        self.tell(Changed::Encoded(id));
        Ok(())
    }

    fn stale(&self, version: u32) -> Vec<(ExampleId, u32)> {
        let of = |(id, row): (&ExampleId, &Row)| {
            let old = row.segments.iter().enumerate().filter(|(_, (v, _))| *v != version);
            old.map(|(segment, _)| (*id, segment as u32)).collect::<Vec<_>>()
        };
        self.rows().iter().flat_map(of).collect()
    }

    fn changes(&self, position: u64) -> Changes {
        self.log.lock().expect("not poisoned").after(position)
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.newest.subscribe()
    }

    fn health(&self) -> CorpusHealth {
        let read_only = self.writable().err().map(|error| error.to_string());
        CorpusHealth { read_only, quarantined: Vec::new() }
    }
}
