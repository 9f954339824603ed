//! Whether the service is alive and ready.

use serde::{Deserialize, Serialize};

/// The answer of `/healthz`: the process runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Health {
    /// Always `ok`.
    pub status: String,
    /// The server's version.
    pub version: String,
}

/// The answer of `/readyz`: 200 when ready, 503 otherwise.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Readiness {
    /// Whether requests are taken.
    pub ready: bool,
    /// Whether the corpus takes new examples; false when the disk is full or damaged.
    pub writable: bool,
    /// Examples in the corpus.
    pub examples: u64,
    /// Segments in the corpus.
    pub segments: u64,
    /// Segments whose encoding is still to be (re)built; they are not ranked until then.
    pub segments_waiting: u64,
    /// Empty: which examples are damaged is told to admins alone, at `/v1/admin/status`.
    pub quarantined: Vec<String>,
    /// Number of examples set aside because their bytes are damaged.
    #[serde(default)]
    pub quarantined_count: u64,
    /// The version of the encoder in use.
    pub encoder_version: u32,
}
