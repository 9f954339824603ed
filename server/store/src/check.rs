//! Reading everything once, to find damage before somebody needs what is damaged.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

use quadmuse_proto::id::ExampleId;

use crate::engine::Pointer;
use crate::error::StoreError;
use crate::keys::SegmentKey;
use crate::record::ExampleRecord;
use crate::shared::OpenOptions;
use crate::store::{LOCK_FILE, Store};

/// Something a check found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// The ground state of an example is damaged; the example is quarantined.
    Ground {
        /// The example.
        id: ExampleId,
        /// What is wrong.
        reason: String,
    },
    /// The record's file is damaged or missing; scrubbing writes it anew from the index.
    Record {
        /// The example.
        id: ExampleId,
        /// What was wrong.
        reason: String,
    },
    /// An encoding is missing or damaged: to be encoded again from the mesh.
    Derived {
        /// The example.
        id: ExampleId,
        /// The segment.
        segment: u32,
        /// What is wrong.
        reason: String,
    },
    /// The database wrote unsynced side files: compact the store.
    Blobs {
        /// How many.
        count: usize,
    },
}

/// What a check came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CheckReport {
    /// Examples read, quarantined ones included.
    pub examples: usize,
    /// Encodings read.
    pub segments: usize,
    /// Bytes read.
    pub bytes: u64,
    /// What was found; empty if all is well.
    pub problems: Vec<Problem>,
}

impl Store {
    /// Reads every mesh, record and encoding and compares them with their checksums; changes nothing. `progress` is told
    /// after each example how many are done.
    ///
    /// # Errors
    /// [`StoreError::Io`] if a file can't be read for another reason than damage; [`StoreError::ReadOnly`] while there is no open index.
    pub fn check(&self, progress: &mut dyn FnMut(usize)) -> Result<CheckReport, StoreError> {
        let mut report = CheckReport::default();
        let known: Vec<_> = self.shared().index().records().cloned().collect();
        // Quarantined at opening because not even the record could be read.
        let lost = self.quarantined().into_iter().filter(|(id, _)| known.iter().all(|record| record.id != *id));
        report.problems.extend(lost.map(|(id, reason)| Problem::Ground { id, reason }));
        for record in known {
            self.check_example(&record, &mut report)?;
            report.examples += 1;
            progress(report.examples);
        }
        let (_, count) = self.shared().engine()?.size().unwrap_or((0, 0));
        if count > 0 {
            report.problems.push(Problem::Blobs { count });
        }
        Ok(report)
    }

    /// Checks the store in `dir` without changing a byte of it: its records and its index are copied to `scratch`, which is
    /// removed afterwards, and its meshes are read where they are.
    ///
    /// # Errors
    /// As [`Store::check`]; [`StoreError::Locked`] while a service has it open, which can be asked for the same.
    pub fn check_dir(dir: &Path, scratch: &Path, progress: &mut dyn FnMut(usize)) -> Result<CheckReport, StoreError> {
        let _lock = shared_lock(dir)?;
        let copied = Scratch::of(dir, scratch)?;
        let options = OpenOptions { keeps_files: true, reserve_bytes: 0, spare_bytes: 0, ..OpenOptions::default() };
        let (store, _) = Store::open(&copied.dir, &options)?;
        store.check(progress)
    }

    /// Checks one example, and mends what can be: a damaged record is written anew, a damaged mesh sets its example aside.
    ///
    /// # Errors
    /// As [`Store::check`].
    pub fn scrub(&self, id: ExampleId) -> Result<Vec<Problem>, StoreError> {
        let mut report = CheckReport::default();
        let Some(record) = self.shared().index().record(id).cloned() else { return Ok(Vec::new()) };
        self.check_example(&record, &mut report)?;
        for problem in &report.problems {
            match problem {
                Problem::Ground { id, reason } => self.shared().quarantine(*id, reason),
                Problem::Record { .. } => {
                    let ground = &self.shared().ground;
                    ground.put(&record)?;
                    crate::files::sync_dir(ground.dir())?;
                }
                Problem::Derived { .. } | Problem::Blobs { .. } => {}
            }
        }
        Ok(report.problems)
    }

    fn check_example(&self, record: &ExampleRecord, report: &mut CheckReport) -> Result<(), StoreError> {
        self.check_ground(record, report)?;
        (0..record.segments.len() as u32).try_for_each(|segment| self.check_derived((record.id, segment), report))
    }

    fn check_ground(&self, record: &ExampleRecord, report: &mut CheckReport) -> Result<(), StoreError> {
        let id = record.id;
        let is_current = || self.shared().index().record(id).is_some_and(|now| now.revision == record.revision);
        for object in record.objects() {
            match self.shared().objects.get(object)? {
                Ok(bytes) => report.bytes += bytes.len() as u64,
                Err(reason) if is_current() => report.problems.push(Problem::Ground { id, reason }),
                // Removed meanwhile.
                Err(_) => return Ok(()),
            }
        }
        let reason = match self.shared().ground.get(id, record.revision) {
            Ok(Ok(found)) if &found == record => return Ok(()),
            Ok(Ok(_)) => "another record than the index".to_owned(),
            Ok(Err(reason)) => reason,
            Err(error) => error.to_string(),
        };
        if is_current() {
            report.problems.push(Problem::Record { id, reason });
        }
        Ok(())
    }

    fn check_derived(&self, key: SegmentKey, report: &mut CheckReport) -> Result<(), StoreError> {
        let (id, segment) = key;
        let pointer = self.shared().index().pointer(key).cloned();
        let reason = match pointer {
            None => Some("no encoding".to_owned()),
            Some(pointer) => {
                report.segments += 1;
                report.bytes += pointer.bytes();
                self.damage(key, &pointer)?
            }
        };
        report.problems.extend(reason.map(|reason| Problem::Derived { id, segment, reason }));
        Ok(())
    }

    /// What is wrong with the parts of a segment.
    fn damage(&self, key: SegmentKey, pointer: &Pointer) -> Result<Option<String>, StoreError> {
        let engine = self.shared().engine()?;
        for kind in pointer.kinds() {
            let reason = match engine.part(key, pointer, kind) {
                Ok(Ok(_)) => continue,
                Ok(Err(reason)) => reason,
                Err(failure) => {
                    self.shared().failed(&failure);
                    failure.reason().to_owned()
                }
            };
            // Replaced or removed meanwhile: not damaged.
            let current =
                self.shared().index().pointer(key).is_some_and(|now| now.generation() == pointer.generation());
            if current {
                return Ok(Some(format!("{}: {reason}", kind.name())));
            }
        }
        Ok(None)
    }
}

/// Holds the store against a service that would change it; creates nothing.
fn shared_lock(dir: &Path) -> Result<Option<File>, StoreError> {
    let path = dir.join(LOCK_FILE);
    let Ok(file) = File::open(&path) else { return Ok(None) };
    match file.try_lock_shared() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Err(StoreError::Locked { dir: dir.to_path_buf() }),
        Err(TryLockError::Error(error)) => Err(StoreError::io("lock", &path)(error)),
    }
}

/// A copy of all of a store but its objects, which are linked; removed on drop.
struct Scratch {
    dir: PathBuf,
}

impl Scratch {
    fn of(store: &Path, parent: &Path) -> Result<Self, StoreError> {
        let made = Self { dir: parent.join(format!("quadmuse-check-{}", ExampleId::generate())) };
        let dir = &made.dir;
        fs::create_dir_all(dir).map_err(StoreError::io("create", dir))?;
        for entry in fs::read_dir(store).map_err(StoreError::io("list", store))?.flatten() {
            let (from, name) = (entry.path(), entry.file_name());
            if name == "objects" {
                let link = std::os::unix::fs::symlink(&from, dir.join(&name));
                link.map_err(StoreError::io("link", &from))?;
            } else if [LOCK_FILE, "index.damaged"].iter().all(|left_out| name != *left_out) {
                copy_all(&from, &dir.join(&name))?;
            }
        }
        Ok(made)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // The link first: what it leads to is not ours.
        let _ = fs::remove_file(self.dir.join("objects"));
        let _ = fs::remove_dir_all(&self.dir);
    }
}

fn copy_all(from: &Path, to: &Path) -> Result<(), StoreError> {
    if !from.is_dir() {
        return fs::copy(from, to).map(drop).map_err(StoreError::io("copy", from));
    }
    fs::create_dir_all(to).map_err(StoreError::io("create", to))?;
    let entries = fs::read_dir(from).map_err(StoreError::io("list", from))?;
    entries.flatten().try_for_each(|entry| copy_all(&entry.path(), &to.join(entry.file_name())))
}
