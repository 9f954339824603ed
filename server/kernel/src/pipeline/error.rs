//! Why the pipeline refuses or gives up.

use crate::mesh::{MeshError, MeshErrorKind};

pub use crate::numerics::stop::Stop;

/// Why a stage refused or gave up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PipelineError {
    /// The mesh, or what was asked of it, can't be taken. The caller's.
    #[error("{detail}")]
    Refused {
        /// Which kind of refusal.
        refusal: Refusal,
        /// Expected, found, way out; with the line or element where the file is wrong.
        detail: String,
    },
    /// It was told to stop.
    #[error("stopped")]
    Stopped,
    /// A bug of ours.
    #[error("{0}")]
    Internal(String),
}

/// A kind of refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The file is damaged, cut off, or not what its format demands.
    Unreadable,
    /// The file holds no face.
    Empty,
    /// Not manifold, beyond what can be repaired.
    NotManifold,
    /// Neither disc, annulus, sphere nor torus.
    TopologyUnsupported,
    /// Over a limit on vertices, faces or corners.
    TooLarge,
    /// None of the formats that are read, or written.
    FormatUnknown,
    /// Sound, but no encoding could be computed.
    NotEncodable,
    /// The labels given with the mesh don't fit it.
    LabelsInvalid,
    /// The mesh can't be cut as the example named is.
    Unlike,
    /// A constraint names no point of its surface, or there are too many.
    ConstraintInvalid,
    /// No constraint has this id.
    ConstraintUnknown,
    /// The constraints asked for would fold the map over.
    ConstraintFolds,
    /// The parts of a composition can't be stitched.
    CompositionInvalid,
    /// This server does not do it yet.
    Unsupported,
}

impl PipelineError {
    /// A refusal.
    pub fn refused(refusal: Refusal, detail: impl Into<String>) -> Self {
        Self::Refused { refusal, detail: detail.into() }
    }
}

impl From<MeshError> for PipelineError {
    fn from(error: MeshError) -> Self {
        let refusal = match error.code() {
            MeshErrorKind::Unreadable => Refusal::Unreadable,
            MeshErrorKind::Empty => Refusal::Empty,
            MeshErrorKind::NotManifold => Refusal::NotManifold,
            MeshErrorKind::TooLarge => Refusal::TooLarge,
            MeshErrorKind::FormatUnknown => Refusal::FormatUnknown,
            MeshErrorKind::TopologyUnsupported => Refusal::TopologyUnsupported,
        };
        Self::refused(refusal, error.to_string())
    }
}

pub(super) fn internal(error: impl std::fmt::Display) -> PipelineError {
    PipelineError::Internal(error.to_string())
}

pub(super) fn stopped(stop: Stop) -> Result<(), PipelineError> {
    if stop() { Err(PipelineError::Stopped) } else { Ok(()) }
}
