//! What the callers and the writer of a store share.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;

use crate::backend::Listener;
use crate::changes::{ChangeLog, Changed, Changes};
use crate::engine::{Engine, Failure};
use crate::error::StoreError;
use crate::files::{Ground, Objects};
use crate::index::{Change, Index};
use crate::quarantine::Quarantine;
use crate::record::ContentHash;

/// Tells the bytes free for unprivileged writing on the file system of a path.
pub type FreeSpace = Arc<dyn Fn(&Path) -> std::io::Result<u64> + Send + Sync>;

/// How a store is opened.
#[derive(Clone)]
pub struct OpenOptions {
    /// Memory the index may use for its pages, in bytes.
    pub cache_bytes: u64,
    /// Free space that adding leaves alone, in bytes, so that removals work on a full disk.
    pub reserve_bytes: u64,
    /// Space kept in a file of the store for a start on a full disk, in bytes; 0 for none.
    pub spare_bytes: u64,
    /// Whether this opening is that of a restore, which finds an unfinished one.
    pub restores: bool,
    /// Whether files that nothing names are left alone.
    pub keeps_files: bool,
    /// Where the free space is read; tests put another source here.
    pub free_space: FreeSpace,
}

impl Default for OpenOptions {
    fn default() -> Self {
        Self {
            cache_bytes: 256 << 20,
            reserve_bytes: 128 << 20,
            spare_bytes: 64 << 20,
            restores: false,
            keeps_files: false,
            free_space: Arc::new(free_space),
        }
    }
}

/// Free space that opening an index needs, in bytes; less if the reserve is smaller.
const OPENING_BYTES: u64 = 32 << 20;

impl OpenOptions {
    /// Free space with which an index can be opened, in bytes.
    pub(crate) fn opening_bytes(&self) -> u64 {
        OPENING_BYTES.min(self.reserve_bytes)
    }

    /// Bytes free where the store is; 0 if they can't be told.
    pub(crate) fn available(&self, dir: &Path) -> u64 {
        (self.free_space)(dir).unwrap_or(0)
    }

    /// Whether the disk has too little room to open an index on.
    pub(crate) fn is_short(&self, dir: &Path) -> bool {
        self.available(dir) < self.opening_bytes()
    }
}

fn free_space(path: &Path) -> std::io::Result<u64> {
    let facts = rustix::fs::statvfs(path)?;
    Ok(facts.f_bavail.saturating_mul(facts.f_frsize))
}

/// Why writing is suspended.
#[derive(Clone, Debug)]
pub(crate) struct Fault {
    pub(crate) reason: String,
    /// The index must be copied, without what can't be read, before writing goes on.
    pub(crate) damaged: Damaged,
    /// Free space with which writing goes on, in bytes.
    pub(crate) room: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Damaged {
    No,
    Index,
}

pub(crate) struct Shared {
    pub(crate) dir: PathBuf,
    pub(crate) options: OpenOptions,
    pub(crate) objects: Objects,
    pub(crate) ground: Ground,
    pub(crate) quarantine: Quarantine,
    pub(crate) engine: RwLock<Option<Arc<Engine>>>,
    index: RwLock<Index>,
    revision: Mutex<u64>,
    changed: Condvar,
    /// What changed since the store was opened.
    log: Mutex<ChangeLog>,
    listeners: Mutex<Vec<Listener>>,
    fault: Mutex<Option<Fault>>,
    in_flight: Mutex<HashMap<ContentHash, usize>>,
    /// Examples whose adding was refused after some of it was written: gone when the index is reopened.
    pub(crate) refused: Mutex<Vec<(ExampleId, u32)>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub(crate) fn new(
        dir: PathBuf,
        options: OpenOptions,
        objects: Objects,
        ground: Ground,
        engine: Engine,
        index: Index,
    ) -> Self {
        let revision = Mutex::new(index.revision());
        Self {
            quarantine: Quarantine::of(&dir),
            dir,
            options,
            objects,
            ground,
            engine: RwLock::new(Some(Arc::new(engine))),
            index: RwLock::new(index),
            revision,
            changed: Condvar::new(),
            log: Mutex::default(),
            listeners: Mutex::default(),
            fault: Mutex::new(None),
            in_flight: Mutex::new(HashMap::new()),
            refused: Mutex::default(),
        }
    }

    pub(crate) fn index(&self) -> RwLockReadGuard<'_, Index> {
        self.index.read().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn index_mut(&self) -> RwLockWriteGuard<'_, Index> {
        self.index.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets an example aside, over restarts too.
    pub(crate) fn quarantine(&self, id: ExampleId, reason: &str) {
        self.quarantine.note(id, reason);
        self.publish([Change::Quarantined(id, reason.to_owned())]);
    }

    /// The open index; waits while it is being reopened.
    pub(crate) fn engine(&self) -> Result<Arc<Engine>, StoreError> {
        let engine = self.engine.read().unwrap_or_else(PoisonError::into_inner);
        engine.clone().ok_or_else(|| self.read_only())
    }

    pub(crate) fn publish(&self, changes: impl IntoIterator<Item = Change>) {
        let revision = {
            let mut index = self.index_mut();
            let mut last = None;
            for change in changes {
                if let Change::Removed(id) | Change::Healed(id) = change {
                    self.quarantine.forget(id);
                }
                // Each segment of a new example has a pointer: it is told once.
                if let Some(changed) =
                    change_for_followers(&index, &change).filter(|changed| last.replace(*changed) != Some(*changed))
                {
                    lock(&self.log).push(changed);
                }
                index.apply(change);
            }
            index.revision()
        };
        self.announce(revision);
    }

    pub(crate) fn replace_index(&self, mut index: Index) {
        let revision = {
            let mut present = self.index_mut();
            index.continue_from(present.revision());
            *present = index;
            present.revision()
        };
        self.announce(revision);
    }

    fn announce(&self, revision: u64) {
        *lock(&self.revision) = revision;
        self.changed.notify_all();
        let position = lock(&self.log).newest();
        lock(&self.listeners).iter().for_each(|tell| tell(position));
    }

    /// What changed after `position`.
    pub(crate) fn changes(&self, position: u64) -> Changes {
        lock(&self.log).after(position)
    }

    pub(crate) fn subscribe(&self, listener: Listener) {
        lock(&self.listeners).push(listener);
    }

    /// Waits until the corpus is newer than `known` or the time is up; its revision then.
    pub(crate) fn wait_newer(&self, known: u64, timeout: Duration) -> u64 {
        let until = Instant::now() + timeout;
        let mut revision = lock(&self.revision);
        while *revision <= known {
            let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) else { break };
            revision = self.changed.wait_timeout(revision, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        *revision
    }

    pub(crate) fn fault(&self) -> Option<Fault> {
        lock(&self.fault).clone()
    }

    pub(crate) fn clear_fault(&self) {
        *lock(&self.fault) = None;
    }

    /// Suspends writing until the index was reopened.
    pub(crate) fn suspend(&self, reason: &str, damaged: Damaged) {
        let mut fault = lock(&self.fault);
        if fault.as_ref().is_none_or(|fault| fault.damaged == Damaged::No && damaged == Damaged::Index) {
            tracing::error!(reason, "the store goes read-only");
            let room = fault.as_ref().map_or(self.options.opening_bytes(), |fault| fault.room);
            *fault = Some(Fault { reason: reason.to_owned(), damaged, room });
        }
    }

    /// Suspends writing after an opening that had to use the room kept for it, until as much is free as writes leave alone.
    pub(crate) fn suspend_full(&self) {
        let reason = "the disk was full at the start".to_owned();
        tracing::error!(reason, dir = %self.dir.display(), "the store goes read-only");
        *lock(&self.fault) = Some(Fault { reason, damaged: Damaged::No, room: self.options.reserve_bytes });
    }

    /// Suspends writing after a failure of the database.
    pub(crate) fn failed(&self, failure: &Failure) {
        let damaged = if matches!(failure, Failure::Damaged(_)) { Damaged::Index } else { Damaged::No };
        self.suspend(failure.reason(), damaged);
    }

    pub(crate) fn read_only(&self) -> StoreError {
        let reason = self.fault().map_or_else(|| "the index is being reopened".into(), |fault| fault.reason);
        // Only a full disk is told as one: whatever else fails is no matter of space.
        match self.check_space(0) {
            Err(full @ StoreError::Full { .. }) => full,
            _ => StoreError::ReadOnly { reason },
        }
    }

    /// Refuses a write that might need `needed` bytes and would touch the reserve.
    pub(crate) fn check_space(&self, needed: u64) -> Result<(), StoreError> {
        let available =
            (self.options.free_space)(&self.dir).map_err(StoreError::io("read the free space of", &self.dir))?;
        let reserve = self.options.reserve_bytes;
        if available >= needed.saturating_add(reserve) {
            Ok(())
        } else {
            Err(StoreError::Full { needed, reserve, available })
        }
    }

    /// A full disk is told as such, whichever call met it.
    pub(crate) fn as_full(&self, error: StoreError, needed: u64) -> StoreError {
        if !error.is_full() {
            return error;
        }
        let available = self.options.available(&self.dir);
        StoreError::Full { needed, reserve: self.options.reserve_bytes, available }
    }

    /// Keeps objects from being removed while the returned guard lives.
    pub(crate) fn hold(self: &Arc<Self>, objects: Vec<ContentHash>) -> InFlight {
        let mut in_flight = lock(&self.in_flight);
        for &object in &objects {
            *in_flight.entry(object).or_default() += 1;
        }
        InFlight { shared: self.clone(), objects }
    }

    /// Removes an object unless a record or a write under way names it.
    pub(crate) fn remove_object(&self, object: ContentHash) -> Result<(), StoreError> {
        let in_flight = lock(&self.in_flight);
        if in_flight.contains_key(&object) || self.index().object_uses(object) > 0 {
            return Ok(());
        }
        self.objects.remove(object)
    }
}

/// What a change of the index, which is not applied yet, is to whoever follows the corpus. That an example is set aside is
/// told where it is asked for.
fn change_for_followers(index: &Index, change: &Change) -> Option<Changed> {
    match change {
        Change::Record(record) if index.record(record.id).is_some() => Some(Changed::Annotated(record.id)),
        Change::Record(record) => Some(Changed::Encoded(record.id)),
        Change::Pointer((id, _), _) | Change::Healed(id) => Some(Changed::Encoded(*id)),
        Change::Removed(id) => Some(Changed::Removed(*id)),
        Change::Quarantined(..) => None,
    }
}

/// Objects of a write under way.
pub(crate) struct InFlight {
    shared: Arc<Shared>,
    objects: Vec<ContentHash>,
}

impl Drop for InFlight {
    fn drop(&mut self) {
        let mut in_flight = lock(&self.shared.in_flight);
        for object in &self.objects {
            if let Some(count) = in_flight.get_mut(object) {
                *count -= 1;
                if *count == 0 {
                    in_flight.remove(object);
                }
            }
        }
    }
}
