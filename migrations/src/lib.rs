//! Upgrades of a store: one file a step, each with frozen copies of the shapes it reads and writes.
//!
//! A store directory names its schema in the file [`SCHEMA_FILE`], which is read before anything else is touched, so that a newer
//! store is refused without changing a byte. Its index names, in a row, the last step that was carried out on it. An upgrade
//! marks the file first (an older release refuses from then on), then carries out the missing steps, each ending in its row; every
//! step may be killed at any point and carried out again.

mod file;
mod v1;
mod v2;
mod v3;
mod v4;

use std::path::{Path, PathBuf};

pub use file::{SCHEMA_FILE, read_schema};

/// The newest schema this release knows, and the one it writes.
pub const CURRENT: u32 = 4;
const META_TREE: &str = "meta";
const SCHEMA_ROW: &[u8] = b"schema";

/// Why an upgrade was refused or failed.
#[derive(Debug, thiserror::Error)]
pub enum MigrationError {
    /// The store was written by a newer release.
    #[error(
        "expected schema {supported} or older, found schema {found}; use the release that wrote the store or a newer one"
    )]
    Newer {
        /// Schema of the store.
        found: u32,
        /// Newest schema known here.
        supported: u32,
    },
    /// No line of the schema file is intact.
    #[error("expected the schema in {}, found it damaged; restore a backup", path.display())]
    Damaged {
        /// The schema file.
        path: PathBuf,
    },
    /// There is a store's content, but no schema file.
    #[error("expected {} beside the store's content, found none; restore the file or a backup", path.display())]
    Missing {
        /// The schema file.
        path: PathBuf,
    },
    /// A file operation failed.
    #[error("expected to {doing} {}; see the cause", path.display())]
    Io {
        /// What was attempted.
        doing: &'static str,
        /// On which file or directory.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// The index failed.
    #[error("expected the index to carry out step {step}; see the cause")]
    Index {
        /// The step's number.
        step: u32,
        /// The database's answer.
        source: sled::Error,
    },
}

/// A step of an upgrade, as it is reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The step's number: the schema it leads to.
    pub step: u32,
    /// The step in a few words.
    pub name: &'static str,
    /// Rows or files done so far.
    pub done: u64,
}

/// A step: brings a store from schema `to - 1` to schema `to`. It must be possible to carry it out again on its own result.
struct Step {
    to: u32,
    name: &'static str,
    run: fn(&Path, &sled::Db, &mut dyn FnMut(u64)) -> Result<(), sled::Error>,
}

const STEPS: &[Step] = &[
    Step { to: 1, name: "a new store", run: v1::run },
    Step { to: 2, name: "longer chunks from here on", run: v2::run },
    Step { to: 3, name: "examples whole and by their parts from here on", run: v3::run },
    Step { to: 4, name: "authors, licences, notes and named landmarks from here on", run: v4::run },
];

/// Numbers and names of the steps that a store of this schema (0: a new one) still needs, in order.
pub fn pending(schema: u32) -> Vec<(u32, &'static str)> {
    STEPS.iter().filter(|step| step.to > schema).map(|step| (step.to, step.name)).collect()
}

/// The schema that a directory is in: 0 for a new one. Touches nothing.
///
/// # Errors
/// [`MigrationError::Newer`] if it is newer than [`CURRENT`], [`MigrationError::Damaged`] and [`MigrationError::Missing`] if it can't be told.
pub fn check(dir: &Path) -> Result<u32, MigrationError> {
    let found = read_schema(dir)?;
    if found > CURRENT { Err(MigrationError::Newer { found, supported: CURRENT }) } else { Ok(found) }
}

/// What `run` would do, without doing it.
///
/// # Errors
/// As [`check`].
pub fn dry_run(dir: &Path) -> Result<Vec<(u32, &'static str)>, MigrationError> {
    check(dir).map(pending)
}

/// Marks the directory with [`CURRENT`], durably, before anything in it is changed: from here on an older release refuses it.
///
/// # Errors
/// As [`check`], and [`MigrationError::Io`].
pub fn mark(dir: &Path) -> Result<(), MigrationError> {
    if check(dir)? == CURRENT { file::repair(dir, CURRENT) } else { file::write_schema(dir, CURRENT) }
}

/// Carries out on the index what is still missing, in order, and reports each step when it begins and as it proceeds. Returns the steps
/// carried out. To be called after [`mark`]; killed at any point, it goes on where it was.
///
/// # Errors
/// [`MigrationError::Newer`] if the index is newer than [`CURRENT`]; [`MigrationError::Index`] if a step fails.
pub fn run(dir: &Path, db: &sled::Db, report: &mut dyn FnMut(Progress)) -> Result<Vec<u32>, MigrationError> {
    let index = |step| move |source| MigrationError::Index { step, source };
    let meta = db.open_tree(META_TREE).map_err(index(0))?;
    let row = meta.get(SCHEMA_ROW).map_err(index(0))?;
    let found = row.and_then(|row| <[u8; 4]>::try_from(&*row).ok()).map_or(0, u32::from_be_bytes);
    if found > CURRENT {
        return Err(MigrationError::Newer { found, supported: CURRENT });
    }
    let mut carried_out = Vec::new();
    for step in STEPS.iter().filter(|step| step.to > found) {
        let mut tell = |done| report(Progress { step: step.to, name: step.name, done });
        tell(0);
        (step.run)(dir, db, &mut tell).map_err(index(step.to))?;
        db.flush().map_err(index(step.to))?;
        meta.insert(SCHEMA_ROW, &step.to.to_be_bytes()).map_err(index(step.to))?;
        db.flush().map_err(index(step.to))?;
        carried_out.push(step.to);
    }
    Ok(carried_out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn database(dir: &Path) -> sled::Db {
        sled::Config::new().path(dir.join("index")).flush_every_ms(None).open().unwrap()
    }

    #[test]
    fn steps_are_numbered_without_a_gap_and_lead_to_the_current_schema() {
        let numbers: Vec<u32> = pending(0).into_iter().map(|(number, _)| number).collect();
        assert_eq!(numbers, (1..=CURRENT).collect::<Vec<_>>());
        assert!(pending(CURRENT).is_empty());
    }

    #[test]
    fn a_new_directory_is_brought_to_the_current_schema_once() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(dry_run(dir.path()).unwrap(), pending(0));
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "a dry run writes nothing");
        mark(dir.path()).unwrap();
        let db = database(dir.path());
        let mut seen = Vec::new();
        assert_eq!(run(dir.path(), &db, &mut |progress| seen.push(progress.step)).unwrap(), vec![1, 2, 3, 4]);
        seen.dedup();
        assert_eq!(seen, vec![1, 2, 3, 4]);
        assert_eq!(run(dir.path(), &db, &mut |_| ()).unwrap(), Vec::<u32>::new());
        assert_eq!(check(dir.path()).unwrap(), CURRENT);
    }

    #[test]
    fn every_step_can_be_carried_out_again_after_it_was_killed_before_its_row() {
        let dir = tempfile::tempdir().unwrap();
        mark(dir.path()).unwrap();
        let db = database(dir.path());
        for step in STEPS {
            for _ in 0..3 {
                (step.run)(dir.path(), &db, &mut |_| ()).unwrap();
            }
        }
        assert_eq!(run(dir.path(), &db, &mut |_| ()).unwrap(), vec![1, 2, 3, 4]);
        let rows: Vec<_> = db.open_tree("manifest").unwrap().iter().collect();
        assert!(rows.is_empty());
    }

    #[test]
    fn a_newer_index_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let db = database(dir.path());
        db.open_tree(META_TREE).unwrap().insert(SCHEMA_ROW, &(CURRENT + 1).to_be_bytes()).unwrap();
        let refused = run(dir.path(), &db, &mut |_| ());
        assert!(matches!(refused, Err(MigrationError::Newer { found, .. }) if found == CURRENT + 1));
    }
}
