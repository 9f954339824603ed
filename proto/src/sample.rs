//! The samples that a server can make by itself: examples to begin with, and scans to try them on.

use serde::{Deserialize, Serialize};

/// What a sample is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SampleKind {
    /// Quads, to be added to the corpus.
    Example,
    /// Triangles, to be sent as a query.
    Scan,
}

/// A sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Sample {
    /// Its number in the list.
    pub number: u32,
    /// What it is good for.
    pub kind: SampleKind,
    /// Its name.
    pub name: String,
    /// Tags for it.
    pub tags: Vec<String>,
    /// A relevance for it, 0–5.
    pub relevance: f64,
    /// Its faces.
    pub faces: u64,
}
