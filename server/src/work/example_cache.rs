//! Examples that were read, in memory for whoever needs them next.
//!
//! A query reads some dozens of examples to see how they lie on it, and maps read some of them again. An example's mesh never
//! changes, so nothing here grows stale. What was not needed for the longest makes room.

use super::engine::{Encoded, LimbDistances, Model, Opaque};
use quadmuse_proto::ExampleId;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most bytes that are kept, by estimate, and the share of the memory limit that they are at most.
const BYTES_MAX: u64 = 512 << 20;
const SHARE_OF_MEMORY: u64 = 16;
/// What a model takes for each byte of its file: twice what the corpora of the tests take.
const MODEL_PER_BYTE: u64 = 16;
/// What a segment takes that is ready to be compared by its shape: samples at five sizes, and their trees.
const POSED: u64 = 2 << 20;
/// What an encoded segment takes at least, its pictures at every level, and for each byte of its example's file.
const ENCODED: u64 = 8 << 20;
const ENCODED_PER_BYTE: u64 = 24;

/// The distances between a segment's limbs take so many bytes, by estimate.
const LIMBS: u64 = 4 << 10;

/// The examples.
pub struct ExampleCache {
    bytes_max: u64,
    kept: Mutex<CachedExamples>,
}

/// Holds what is cached of examples, and counts its memory.
#[derive(Default)]
struct CachedExamples {
    models: Rows<ExampleId, Arc<Model>>,
    posed: Rows<(ExampleId, u32), Option<Opaque>>,
    encoded: Rows<(ExampleId, u32), Arc<Encoded>>,
    limbs: Rows<(ExampleId, u32), Option<Arc<LimbDistances>>>,
    bytes: u64,
    /// Counts uses: the higher, the later.
    now: u64,
}

/// What is kept of one kind.
type Rows<K, V> = HashMap<K, Row<V>>;

struct Row<V> {
    value: V,
    bytes: u64,
    used: u64,
}

/// What was not needed for the longest, by its kind.
#[derive(Clone, Copy)]
enum Oldest {
    Model(ExampleId),
    Posed((ExampleId, u32)),
    Encoded((ExampleId, u32)),
    Limbs((ExampleId, u32)),
}

impl ExampleCache {
    /// An empty one for a service that may use so much memory.
    pub fn within(memory_bytes: u64) -> Self {
        Self { bytes_max: BYTES_MAX.min(memory_bytes / SHARE_OF_MEMORY), kept: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, CachedExamples> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An example's mesh, if it was read before.
    pub fn model(&self, id: ExampleId) -> Option<Arc<Model>> {
        let mut kept = self.lock();
        let now = kept.tick();
        used(&mut kept.models, &id, now)
    }

    /// Keeps the mesh of an example whose file has so many bytes.
    pub fn put_model(&self, id: ExampleId, model: &Arc<Model>, file_bytes: u64) {
        self.put(file_bytes.saturating_mul(MODEL_PER_BYTE), |kept, row| {
            kept.models.insert(id, row(Arc::clone(model))).map(|old| old.bytes)
        });
    }

    /// A segment that is ready to be compared by its shape, if it was made so before; it may be none that can be.
    pub fn posed(&self, of: (ExampleId, u32)) -> Option<Option<Opaque>> {
        let mut kept = self.lock();
        let now = kept.tick();
        used(&mut kept.posed, &of, now)
    }

    /// Keeps a segment that is ready to be compared by its shape.
    pub fn put_posed(&self, of: (ExampleId, u32), posed: &Option<Opaque>) {
        self.put(POSED, |kept, row| kept.posed.insert(of, row(posed.clone())).map(|old| old.bytes));
    }

    /// An encoded segment, if it was encoded before.
    pub fn encoded(&self, of: (ExampleId, u32)) -> Option<Arc<Encoded>> {
        let mut kept = self.lock();
        let now = kept.tick();
        used(&mut kept.encoded, &of, now)
    }

    /// Keeps an encoded segment of an example whose file has so many bytes.
    pub fn put_encoded(&self, of: (ExampleId, u32), encoded: &Arc<Encoded>, file_bytes: u64) {
        self.put(ENCODED.saturating_add(file_bytes.saturating_mul(ENCODED_PER_BYTE)), |kept, row| {
            kept.encoded.insert(of, row(Arc::clone(encoded))).map(|old| old.bytes)
        });
    }

    /// Returns the distances between a segment's limbs if they were measured before: `Some(None)` of one with too few.
    pub fn limbs(&self, of: (ExampleId, u32)) -> Option<Option<Arc<LimbDistances>>> {
        let mut kept = self.lock();
        let now = kept.tick();
        used(&mut kept.limbs, &of, now)
    }

    /// Keeps the distances between a segment's limbs.
    pub fn put_limbs(&self, of: (ExampleId, u32), limbs: &Option<Arc<LimbDistances>>) {
        self.put(LIMBS, |kept, row| kept.limbs.insert(of, row(limbs.clone())).map(|old| old.bytes));
    }

    /// Adds a row of so many bytes, which `insert` makes; it tells the bytes of the row that it replaced.
    fn put<V>(&self, bytes: u64, insert: impl FnOnce(&mut CachedExamples, &dyn Fn(V) -> Row<V>) -> Option<u64>) {
        let mut kept = self.lock();
        let used = kept.tick();
        let replaced = insert(&mut kept, &|value| Row { value, bytes, used }).unwrap_or(0);
        kept.bytes = kept.bytes + bytes - replaced;
        while kept.bytes > self.bytes_max && kept.drop_oldest() {}
    }

    /// Forgets what was kept of an example.
    pub fn forget(&self, id: ExampleId) {
        let mut kept = self.lock();
        let CachedExamples { models, posed, encoded, limbs, .. } = &mut *kept;
        let mut freed = models.remove(&id).map_or(0, |row| row.bytes);
        freed += posed.extract_if(|of, _| of.0 == id).map(|(_, row)| row.bytes).sum::<u64>();
        freed += encoded.extract_if(|of, _| of.0 == id).map(|(_, row)| row.bytes).sum::<u64>();
        freed += limbs.extract_if(|of, _| of.0 == id).map(|(_, row)| row.bytes).sum::<u64>();
        kept.bytes -= freed;
    }
}

impl CachedExamples {
    fn tick(&mut self) -> u64 {
        self.now += 1;
        self.now
    }

    /// Drops what was not needed for the longest; whether there was anything.
    fn drop_oldest(&mut self) -> bool {
        let models = self.models.iter().map(|(id, row)| (row.used, Oldest::Model(*id)));
        let posed = self.posed.iter().map(|(of, row)| (row.used, Oldest::Posed(*of)));
        let encoded = self.encoded.iter().map(|(of, row)| (row.used, Oldest::Encoded(*of)));
        let limbs = self.limbs.iter().map(|(of, row)| (row.used, Oldest::Limbs(*of)));
        let all = models.chain(posed).chain(encoded).chain(limbs);
        let Some((_, oldest)) = all.min_by_key(|(used, _)| *used) else { return false };
        let freed = match oldest {
            Oldest::Model(id) => self.models.remove(&id).map(|row| row.bytes),
            Oldest::Posed(of) => self.posed.remove(&of).map(|row| row.bytes),
            Oldest::Encoded(of) => self.encoded.remove(&of).map(|row| row.bytes),
            Oldest::Limbs(of) => self.limbs.remove(&of).map(|row| row.bytes),
        };
        self.bytes -= freed.unwrap_or(0);
        true
    }
}

/// A value, which counts as needed now.
fn used<K: Eq + std::hash::Hash, V: Clone>(rows: &mut Rows<K, V>, key: &K, now: u64) -> Option<V> {
    let row = rows.get_mut(key)?;
    row.used = now;
    Some(row.value.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_needed_for_the_longest_makes_room() {
        let cache = ExampleCache::within(3 * POSED * SHARE_OF_MEMORY);
        let ids: Vec<ExampleId> = (0..4).map(|_| ExampleId::generate()).collect();
        let put = |k: usize| cache.put_posed((ids[k], 0), &None);
        let is_kept = || [0, 1, 2, 3].map(|k| cache.lock().posed.contains_key(&(ids[k], 0)));
        (0..3).for_each(put);
        assert!(cache.posed((ids[0], 0)).is_some() && cache.posed((ids[0], 1)).is_none());
        put(3);
        assert_eq!(is_kept(), [true, false, true, true]);
        put(3);
        assert_eq!((is_kept(), cache.lock().bytes), ([true, false, true, true], 3 * POSED));
        cache.forget(ids[0]);
        assert_eq!((is_kept(), cache.lock().bytes), ([false, false, true, true], 2 * POSED));
    }

    #[test]
    fn what_is_larger_than_all_room_is_not_kept() {
        let cache = ExampleCache::within(POSED * SHARE_OF_MEMORY / 2);
        cache.put_posed((ExampleId::generate(), 0), &None);
        let kept = cache.lock();
        assert!(kept.posed.is_empty() && kept.bytes == 0);
    }
}
