//! How a mesh is to be cut.

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
    pub besides: Besides,
}

impl Cut {
    /// Whether the caller said anything of the segments.
    pub fn is_asked_for(&self) -> bool {
        self.way != Segmentation::default() || self.labels.is_some() || self.parts.is_some()
    }
}

/// Where automatic cuts may run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Grain {
    /// Anywhere: an input, whose faces are not wanted back.
    #[default]
    Free,
    /// Between faces: an example, each of whose faces belongs to one segment.
    Faces,
}

/// Which parts of a mesh are segments besides its whole, which is segment 0.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Besides {
    /// None.
    #[default]
    Nothing,
    /// Those that automatic segmentation finds, where the mesh stays whole: an example that is added.
    Sought,
    /// Those that were found: the part of each face, from 1, and 0 for none.
    Known(Vec<i64>),
}
