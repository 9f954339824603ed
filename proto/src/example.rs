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
    /// When it was added: RFC 3339, UTC.
    pub created: String,
    /// The name of the built-in regular layout, if it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub template: Option<String>,
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
}
