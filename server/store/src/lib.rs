//! The corpus on disk.
//!
//! **Ground state** is what the user supplied: the mesh as uploaded in a content-addressed file (`objects/`), and a small record
//! (`ground/`). **Derived state** is what can be computed again, the encodings: in an embedded database (`index/`), in chunks of at
//! most 16 KiB. The database also holds a copy of the records, whose row, written last, is the commit mark.
//!
//! ```text
//! schema                     three lines: the schema of the store, read before anything else
//! lock                       held by the process that has the store open
//! objects/<blake3>           meshes and labels, as uploaded; the parts that were found of an example
//! ground/<id>.<revision>     records: what an index is built anew from
//! quarantined/<id>           why an example is damaged
//! objects.keep               there while objects may belong to records that are missing: none is collected
//! restoring                  there while a restore has not ended: nothing is served
//! spare                      room for a start on a full disk, which needs some
//! index/                     the database (trees: see quadmuse-migrations, `v1`)
//! ```
//!
//! Every call blocks; call from a thread that may wait.

mod backend;
mod backup;
mod changes;
mod check;
mod codec;
mod compact;
mod derived;
mod engine;
mod error;
mod files;
mod frame;
mod index;
mod keys;
mod packed;
mod quarantine;
mod record;
mod recover;
mod rows;
mod shared;
mod spare;
mod stats;
mod store;
mod writer;

pub use backend::{Backend, Document, Documents, Following, Listener, Whole};
pub use backup::{BackupReport, read as read_backup, write_these as write_backup_of};
pub use changes::{ChangeLog, Changed, Changes};
pub use check::{CheckReport, Problem};
pub use codec::LEVEL_SIDE_MAX;
pub use derived::{
    ChartRecord, Coarse, DerivedSegment, FEATURES_MAX, Feature, Level, PART_BYTES_MAX, POLES_MAX, SIGNATURE_MAX,
};
pub use error::StoreError;
pub use index::{Filter, Page, Snapshot};
pub use packed::{PackedSegment, SegmentReader, coarse_when_kept};
pub use record::{
    ContentHash, ExampleRecord, FORMAT_BYTES_MAX, LANDMARKS_MAX, LandmarkRecord, NAME_BYTES_MAX, NOTES_BYTES_MAX,
    NewSegmentation, Patch, RELEVANCE_MAX, REPAIR_BYTES_MAX, REPAIRS_MAX, SEGMENTS_MAX, SegmentSummary, Segmentation,
    TAG_BYTES_MAX, TAGS_MAX, Topology, identity, validate,
};
pub use recover::OpenReport;
pub use rows::SegmentRow;
pub use shared::{FreeSpace, OpenOptions};
pub use stats::Stats;
pub use store::{Added, LIST_MAX, NewExample, Store, new_record};
