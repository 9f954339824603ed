//! Encodings as the store keeps them.

use super::SegmentFacts;

/// An encoding as bytes: a head that is read as a whole and its levels, each on its own.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedEncoding {
    /// What is known of the segment.
    pub facts: SegmentFacts,
    /// Feature points.
    pub features: Vec<PackedFeature>,
    /// λ, level by level from the coarsest: the side in pixels and the pixels, row after row.
    pub levels: Vec<(u32, Vec<f32>)>,
}

/// A feature point, as it is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PackedFeature {
    /// Where it lies in the domain.
    pub uv: [f64; 2],
    /// λ there.
    pub lambda: f32,
    /// Side of the level it was found at, in pixels.
    pub side: u32,
}
