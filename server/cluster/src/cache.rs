//! Objects on this server's disk, so that each is fetched from the engine once. It may be removed at any time.

use std::collections::{HashMap, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use quadmuse_store::{ContentHash, PackedSegment};

/// Packed encodings that are kept in memory: one is read several times in a row, level by level.
const IN_MEMORY: usize = 64;

pub(crate) struct Cache {
    dir: PathBuf,
    /// Bytes it may take.
    limit: u64,
    /// Bytes it takes, about.
    used: Mutex<u64>,
    recent: Mutex<Recent>,
}

#[derive(Default)]
struct Recent {
    by_name: HashMap<ContentHash, Arc<PackedSegment>>,
    order: VecDeque<ContentHash>,
}

impl Cache {
    /// The cache in `dir`, which is created when the first object comes.
    pub(crate) fn new(dir: &Path, limit: u64) -> Self {
        let used = files(dir).iter().map(|(_, length, _)| length).sum();
        Self { dir: dir.to_path_buf(), limit, used: Mutex::new(used), recent: Mutex::default() }
    }

    fn path(&self, name: ContentHash) -> PathBuf {
        let name = name.to_string();
        self.dir.join(&name[..2]).join(name)
    }

    /// An object, if it is here whole. One that is damaged is removed.
    pub(crate) fn get(&self, name: ContentHash) -> Option<Vec<u8>> {
        let path = self.path(name);
        let bytes = fs::read(&path).ok()?;
        if ContentHash::of(&bytes) == name {
            return Some(bytes);
        }
        let _ = fs::remove_file(&path);
        None
    }

    /// Keeps an object. What fails costs a fetch later, and nothing else.
    pub(crate) fn put(&self, name: ContentHash, bytes: &[u8]) {
        if let Err(error) = self.try_put(name, bytes) {
            tracing::warn!(%error, dir = %self.dir.display(), "the cache can't be written; objects are fetched again");
        }
    }

    fn try_put(&self, name: ContentHash, bytes: &[u8]) -> std::io::Result<()> {
        let path = self.path(name);
        if path.exists() || bytes.len() as u64 > self.limit {
            return Ok(());
        }
        fs::create_dir_all(path.parent().unwrap_or(&self.dir))?;
        // Under a name of its own until it is whole; no sync, since what is damaged is noticed and fetched again.
        let partial = path.with_extension(format!("{}.partial", quadmuse_proto::id::ExampleId::generate()));
        fs::write(&partial, bytes)?;
        fs::rename(&partial, &path)?;
        let mut used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        *used += bytes.len() as u64;
        if *used > self.limit {
            *used = make_room(&self.dir, self.limit / 4 * 3);
        }
        Ok(())
    }

    /// A packed encoding that was read lately.
    pub(crate) fn recent(&self, name: ContentHash) -> Option<Arc<PackedSegment>> {
        self.recent.lock().unwrap_or_else(PoisonError::into_inner).by_name.get(&name).cloned()
    }

    pub(crate) fn remember(&self, name: ContentHash, packed: &Arc<PackedSegment>) {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if recent.by_name.insert(name, Arc::clone(packed)).is_none() {
            recent.order.push_back(name);
        }
        while recent.order.len() > IN_MEMORY {
            let oldest = recent.order.pop_front();
            oldest.map(|oldest| recent.by_name.remove(&oldest));
        }
    }
}

/// The files of the cache, with their lengths in bytes and when they were written.
fn files(dir: &Path) -> Vec<(PathBuf, u64, SystemTime)> {
    let entries = |dir: &Path| fs::read_dir(dir).into_iter().flatten().flatten().collect::<Vec<_>>();
    let within = entries(dir).into_iter().flat_map(|entry| entries(&entry.path()));
    let facts = |entry: fs::DirEntry| {
        let facts = entry.metadata().ok().filter(fs::Metadata::is_file)?;
        Some((entry.path(), facts.len(), facts.modified().unwrap_or(SystemTime::UNIX_EPOCH)))
    };
    within.filter_map(facts).collect()
}

/// Removes the oldest files until the rest takes at most `target` bytes; how many it takes then.
fn make_room(dir: &Path, target: u64) -> u64 {
    let mut files = files(dir);
    files.sort_by_key(|(_, _, written)| *written);
    let mut used: u64 = files.iter().map(|(_, length, _)| length).sum();
    for (path, length, _) in files {
        if used <= target {
            break;
        }
        // Somebody else may have removed it: it is gone either way.
        let _ = fs::remove_file(path);
        used -= length;
    }
    used
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_keeps_to_its_limit_and_gives_back_only_what_is_whole() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::new(dir.path(), 10_000);
        let objects: Vec<Vec<u8>> = (0..20u8).map(|k| vec![k; 1000]).collect();
        for object in &objects {
            cache.put(ContentHash::of(object), object);
        }
        let kept = |cache: &Cache| objects.iter().filter(|object| cache.get(ContentHash::of(object)).is_some()).count();
        assert!((7..=10).contains(&kept(&cache)), "{}", kept(&cache));
        let newest = ContentHash::of(&objects[19]);
        assert_eq!(cache.get(newest), Some(objects[19].clone()));
        fs::write(cache.path(newest), b"damaged").unwrap();
        assert_eq!(cache.get(newest), None);
        assert!(!cache.path(newest).exists());
        // It is there after a restart, and anybody may remove it.
        let again = Cache::new(dir.path(), 10_000);
        assert!(kept(&again) > 5);
        fs::remove_dir_all(dir.path()).unwrap();
        assert_eq!(kept(&again), 0);
        again.put(newest, &objects[19]);
        assert_eq!(kept(&again), 1);
    }
}
