//! Which examples are damaged, over restarts: a file each in `quarantined/`, with the reason.
//!
//! Opening compares lengths, and a flipped bit changes none: without the file a damaged mesh would be served as whole until
//! somebody reads it again.

use std::fs;
use std::path::{Path, PathBuf};

use quadmuse_proto::id::ExampleId;

use crate::error::StoreError;
use crate::files::{self, create_dir};

/// The files.
#[derive(Debug)]
pub(crate) struct Quarantine {
    dir: PathBuf,
}

/// More than any reason has, in bytes.
const REASON_BYTES_MAX: usize = 4096;

impl Quarantine {
    pub(crate) fn of(store: &Path) -> Self {
        Self { dir: store.join("quarantined") }
    }

    /// Notes that an example is damaged. On a disk that takes no more it is noted in memory alone.
    pub(crate) fn note(&self, id: ExampleId, reason: &str) {
        let write = || -> Result<(), StoreError> {
            create_dir(&self.dir)?;
            let path = self.dir.join(id.to_string());
            fs::write(&path, reason).map_err(StoreError::io("write", &path))?;
            files::sync_dir(&self.dir)
        };
        if let Err(error) = write() {
            tracing::warn!(%id, %error, "the quarantine is not noted on disk");
        }
    }

    /// Forgets it: the example is whole again, or gone.
    pub(crate) fn forget(&self, id: ExampleId) {
        let path = self.dir.join(id.to_string());
        if path.exists()
            && let Err(error) = fs::remove_file(&path).and_then(|()| fs::File::open(&self.dir)?.sync_all())
        {
            tracing::warn!(%id, %error, "the quarantine is not forgotten on disk");
        }
    }

    /// All that are noted, with their reasons.
    pub(crate) fn noted(&self) -> Vec<(ExampleId, String)> {
        let Ok(entries) = fs::read_dir(&self.dir) else { return Vec::new() };
        let noted = |entry: fs::DirEntry| {
            let id = entry.file_name().to_str()?.parse().ok()?;
            let mut reason = fs::read_to_string(entry.path()).unwrap_or_default();
            reason.truncate(reason.floor_char_boundary(REASON_BYTES_MAX));
            Some((id, reason))
        };
        entries.flatten().filter_map(noted).collect()
    }
}
