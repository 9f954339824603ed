//! Reading everything once, to find damage before somebody needs what is damaged.

use quadmuse_proto::id::ExampleId;

use crate::engine::{Failure, Pointer};
use crate::error::StoreError;
use crate::keys::SegmentKey;
use crate::record::ExampleRecord;
use crate::store::Store;

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
    /// The record's file was damaged or missing; it was written anew from the index.
    RecordMended {
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
    /// Reads every mesh, record and encoding and compares them with their checksums. `progress` is told after each example how many are done.
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
            self.check_ground(&record, &mut report)?;
            for segment in 0..record.segments.len() as u32 {
                self.check_derived((record.id, segment), &mut report)?;
            }
            report.examples += 1;
            progress(report.examples);
        }
        let (_, count) = self.shared().engine()?.size().unwrap_or((0, 0));
        if count > 0 {
            report.problems.push(Problem::Blobs { count });
        }
        Ok(report)
    }

    fn check_ground(&self, record: &ExampleRecord, report: &mut CheckReport) -> Result<(), StoreError> {
        let id = record.id;
        for object in record.objects() {
            match self.object(id, object) {
                Ok(bytes) => report.bytes += bytes.len() as u64,
                Err(StoreError::Quarantined { reason, .. }) => report.problems.push(Problem::Ground { id, reason }),
                // Removed meanwhile.
                Err(StoreError::NotFound { .. }) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        let ground = &self.shared().ground;
        let reason = match ground.get(id, record.revision) {
            Ok(Ok(found)) if &found == record => return Ok(()),
            Ok(Ok(_)) => "another record than the index".to_owned(),
            Ok(Err(reason)) => reason,
            Err(error) => error.to_string(),
        };
        let current = self.shared().index().record(id).is_some_and(|now| now.revision == record.revision);
        if current {
            ground.put(record)?;
            crate::files::sync_dir(ground.dir())?;
            report.problems.push(Problem::RecordMended { id, reason });
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
                    let (Failure::Damaged(reason) | Failure::Panic(reason) | Failure::Io(reason)) = failure;
                    reason
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
