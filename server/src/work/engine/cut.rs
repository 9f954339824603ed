//! How a mesh is to be cut.

pub use quadmuse_kernel::pipeline::{ExtraParts, Grain};
use quadmuse_proto::{Components, Parts, Segmentation};

/// How a mesh is to be cut.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// The way asked for, unless there are labels.
    pub way: Segmentation,
    /// The caller's labels, one a face.
    pub labels: Option<Vec<i64>>,
    /// Whether small components beside the largest component may be left out.
    pub components: Components,
    /// How many segments automatic segmentation aims at; `None` leaves a primitive whole.
    pub parts: Option<Parts>,
    /// Where automatic cuts may run.
    pub grain: Grain,
    /// Which parts of a mesh that stays whole are segments, too.
    pub besides: ExtraParts,
}

impl Cut {
    /// Whether the caller said anything of the segments.
    pub fn is_asked_for(&self) -> bool {
        self.way != Segmentation::default() || self.labels.is_some() || self.parts.is_some()
    }
}
