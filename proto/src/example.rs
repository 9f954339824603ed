//! Examples: the meshes of the corpus.

use crate::{id::ExampleId, segment::Topology};
use serde::{Deserialize, Serialize};

/// The lowest and highest relevance.
pub const RELEVANCE_RANGE: std::ops::RangeInclusive<f64> = 0.0..=5.0;

/// Longest name, in bytes of UTF-8.
pub const NAME_LENGTH_MAX: usize = 256;

/// Longest tag, in bytes of UTF-8.
pub const TAG_LENGTH_MAX: usize = 64;

/// Most tags an example.
pub const TAGS_MAX: usize = 32;

/// Longest author and longest licence, in bytes of UTF-8.
pub const CREDIT_LENGTH_MAX: usize = 256;

/// Longest notes, in bytes of UTF-8.
pub const NOTES_LENGTH_MAX: usize = 4096;

/// Most named landmarks an example, and most names that a caller gives points of an input.
pub const NAMED_MAX: usize = 128;

/// Longest name of a landmark, in bytes of UTF-8.
pub const LANDMARK_NAME_LENGTH_MAX: usize = 64;

/// A mesh of the corpus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Example {
    /// Its id.
    pub id: ExampleId,
    /// Counts its annotations; 1 when it was added.
    #[serde(default)]
    pub revision: u32,
    /// Its name; empty if none was given.
    pub name: String,
    /// Its tags, sorted.
    pub tags: Vec<String>,
    /// Its relevance, 0–5.
    pub relevance: f64,
    /// The name of who made it; empty if nobody said.
    #[serde(default)]
    pub author: String,
    /// The licence it is under; empty if nobody said.
    #[serde(default)]
    pub licence: String,
    /// What else there is to say of it; may have several lines.
    #[serde(default)]
    pub notes: String,
    /// Points of its surface that have a name, in the order in which they were given.
    #[serde(default)]
    pub landmarks: Vec<NamedPoint>,
    /// BLAKE3 of the uploaded bytes, in hex.
    pub hash: String,
    /// The format of the uploaded bytes, as in `?format=`.
    pub format: String,
    /// Size of the uploaded bytes.
    pub bytes: u64,
    /// What the mesh is made of.
    pub counts: MeshCounts,
    /// Its segments, numbered from 0.
    pub segments: Vec<ExampleSegment>,
    /// What was repaired while reading, a sentence each.
    pub repairs: Vec<String>,
    /// Why it may be no artist's layout, a sentence each: few quads, or few vertices with four edges. Told to whoever adds it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubts: Vec<String>,
    /// When it was added: RFC 3339, UTC.
    pub created: String,
    /// The name of the built-in regular layout, if it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub template: Option<String>,
}

/// A point of a surface that has a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NamedPoint {
    /// Its name, which no other landmark of the example has.
    pub name: String,
    /// The vertex where it is, from 0 in the order of the file; absent where it is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertex: Option<u32>,
    /// The point, in the mesh's units. Always answered; where a vertex is given it may be absent and is not looked at, else the
    /// nearest point of the surface is taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<[f64; 3]>,
}

/// What a mesh is made of, as uploaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MeshCounts {
    /// Vertices.
    pub vertices: u64,
    /// Faces of any degree.
    pub faces: u64,
    /// Faces with three corners.
    pub triangles: u64,
    /// Faces with four corners.
    pub quads: u64,
}

/// A segment of an example.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ExampleSegment {
    /// Its number in the example.
    pub segment: u32,
    /// True for a part of segment 0, which then is the whole example. The field is left out where it is false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_part: bool,
    /// Its topology.
    pub topology: Topology,
    /// Its modulus (the paper's k, made independent of the mesh size).
    pub k: f64,
    /// Faces of the mesh that belong to it.
    pub faces: u64,
    /// Feature points found on it.
    pub features: u32,
}

/// `PATCH /v1/examples/{id}`: what is absent stays as it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ExamplePatch {
    /// A new name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// New tags, in place of all the old ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tags: Option<Vec<String>>,
    /// A new relevance, 0–5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relevance: Option<f64>,
    /// The revision that this was made for: if the example has another by now, nothing is changed, and the answer is 409
    /// `conflict`, which names the revision there is. Without it, whichever there is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revision: Option<u32>,
    /// The name of who made it; empty for nobody.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub author: Option<String>,
    /// The licence it is under; empty for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub licence: Option<String>,
    /// New notes; empty for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
    /// New named landmarks, in place of all the old ones, at most 128. Each has a vertex or a point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub landmarks: Option<Vec<NamedPoint>>,
}
