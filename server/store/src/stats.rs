//! Counts and sizes of a store, for whoever watches it.

use crate::store::Store;

/// Counts and sizes of a store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Examples served.
    pub examples: usize,
    /// Examples quarantined.
    pub quarantined: usize,
    /// Encoded segments.
    pub segments: usize,
    /// Bytes of their encodings, packed.
    pub derived_bytes: u64,
    /// Bytes of the meshes as uploaded.
    pub mesh_bytes: u64,
    /// Bytes of the index on disk.
    pub index_bytes: u64,
    /// Files among the database's unsynced side files; must be 0.
    pub blobs: usize,
    /// Bytes free on the file system.
    pub free_bytes: u64,
}

impl Store {
    /// Counts and sizes.
    pub fn stats(&self) -> Stats {
        let shared = self.shared();
        let (index_bytes, blobs) = shared.engine().ok().and_then(|engine| engine.size().ok()).unwrap_or((0, 0));
        let index = shared.index();
        Stats {
            examples: index.len() - index.quarantined().len().min(index.len()),
            quarantined: index.quarantined().len(),
            segments: index.pointers().count(),
            derived_bytes: index.pointers().map(|(_, pointer)| pointer.bytes()).sum(),
            mesh_bytes: index.records().map(|record| record.bytes).sum(),
            index_bytes,
            blobs,
            free_bytes: (shared.options.free_space)(&shared.dir).unwrap_or(0),
        }
    }
}
