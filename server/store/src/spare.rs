//! Room kept for a start on a full disk.
//!
//! The database writes while it opens: it zeroes the rest of its last segment, notes in a snapshot what it found, and may begin
//! a segment. On a disk that somebody else has filled it can't, and then nothing can be read either. So a file of the
//! store holds some space, which such a start gives back to the disk. The store is read-only then, until space returns.

use std::fs::{self, File};
use std::path::Path;

use crate::error::StoreError;
use crate::recover::INDEX_DIR;
use crate::shared::OpenOptions;

/// Name of the file.
const SPARE_FILE: &str = "spare";

/// Opens by `load`; on a full disk with the room kept for it. Also tells whether that had to be used.
pub(crate) fn used_if_full<T>(
    dir: &Path,
    options: &OpenOptions,
    load: impl Fn() -> Result<T, StoreError>,
) -> Result<(T, bool), StoreError> {
    let is_short = options.is_short(dir);
    if is_short {
        give(dir)?;
    }
    match load() {
        // A quota, or somebody who is just filling the disk: the free space told nothing of it.
        Err(error) if error.is_full() && !is_short && give(dir)? => match load() {
            Ok(loaded) => Ok((loaded, true)),
            // What failed first may hold the index until the process ends, and then says less.
            Err(_) => Err(error),
        },
        loaded => loaded.map(|loaded| (loaded, is_short)),
    }
}

/// Gives the room back to the disk; false if there was none.
fn give(dir: &Path) -> Result<bool, StoreError> {
    let path = dir.join(SPARE_FILE);
    match fs::remove_file(&path) {
        Ok(()) => {
            tracing::warn!(path = %path.display(), "the disk is full: the room kept for a start is used");
            Ok(true)
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(StoreError::io("remove", &path)(error)),
    }
}

/// Keeps room for the next such start, unless it is kept or would be taken from the reserve.
pub(crate) fn keep(dir: &Path, options: &OpenOptions) {
    let path = dir.join(SPARE_FILE);
    let kept = fs::metadata(&path).map_or(0, |facts| facts.len());
    // A snapshot is written beside the former one.
    let wanted = if options.spare_bytes == 0 { 0 } else { options.spare_bytes + 2 * snapshot_bytes(dir) };
    if kept >= wanted || options.available(dir) < wanted + options.reserve_bytes {
        return;
    }
    let hold = || -> std::io::Result<()> {
        let file = File::options().create(true).truncate(false).write(true).open(&path)?;
        rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, wanted).map_err(std::io::Error::from)
    };
    if let Err(error) = hold() {
        // Some file systems promise no room: a start on a full disk is refused there.
        tracing::warn!(%error, "no room is kept for a start on a full disk");
        let _ = fs::remove_file(&path);
    }
}

fn snapshot_bytes(dir: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(dir.join(INDEX_DIR)) else { return 0 };
    let of_snapshots = |entry: &fs::DirEntry| entry.file_name().to_string_lossy().starts_with("snap.");
    entries.flatten().filter(of_snapshots).filter_map(|entry| entry.metadata().ok()).map(|facts| facts.len()).sum()
}
