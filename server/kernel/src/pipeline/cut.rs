//! How a mesh is to be cut.

use crate::segment::PartCount;
use crate::topology::Components;

/// How a mesh is cut.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CutMethod {
    /// The whole mesh if it is a primitive, else its groups if each is one, else automatic segmentation.
    #[default]
    Auto,
    /// The whole mesh is one segment; refused if it is not a primitive.
    Whole,
    /// One segment a group of the file.
    Groups,
}

/// How a mesh is to be cut.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// The way asked for, unless there are labels.
    pub way: CutMethod,
    /// The caller's labels, one a face.
    pub labels: Option<Vec<i64>>,
    /// The treatment of components beside the largest.
    pub components: Components,
    /// The number of segments that automatic segmentation aims at, where the caller said so.
    pub parts: Option<PartCount>,
    /// Where automatic cuts may run.
    pub grain: Grain,
    /// Which parts of a mesh that stays whole are segments, too.
    pub besides: ExtraParts,
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

/// Says which parts of a mesh are segments besides its whole, which is segment 0.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ExtraParts {
    /// None.
    #[default]
    Nothing,
    /// Those that automatic segmentation finds, where the mesh stays whole: an example that is added.
    Sought,
    /// Those that were found: the part of each face, from 1, and 0 for none.
    Known(Vec<i64>),
}
