//! The corpus on disk.
//!
//! **Ground state** is what the user supplied: the mesh as uploaded in a content-addressed file (`objects/`), and a small record
//! (`ground/`). **Derived state** is what can be computed again, the encodings: in an embedded database (`index/`), in chunks of at
//! most 4 KiB. The database also holds a copy of the records, whose row, written last, is the commit mark.
mod codec;
mod derived;
mod error;
mod frame;
mod record;

pub use codec::LEVEL_SIDE_MAX;
pub use derived::{ChartRecord, Coarse, DerivedSegment, Feature, Level};
pub use error::StoreError;
pub use record::{ContentHash, ExampleRecord, NewSegmentation, Patch, Segmentation, SegmentSummary, Topology};
