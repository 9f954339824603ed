//! What the work refuses or fails with, free of HTTP.

use super::corpus::CorpusError;
use super::engine::EngineError;
use super::uploads::UploadError;
use crate::pool::{PoolError, StopReason};
use quadmuse_proto::{CompositionId, ExampleId, MapId, QueryId, RetopoId, Topology};
use std::sync::Arc;

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum WorkError {
    /// The geometry refused or failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The corpus refused or failed.
    #[error(transparent)]
    Corpus(#[from] CorpusError),
    /// The pool refused, or the computation was stopped or panicked.
    #[error(transparent)]
    Pool(#[from] PoolError),
    /// An upload is not made, continued or used.
    #[error(transparent)]
    Upload(#[from] UploadError),
    /// A value is outside its range.
    #[error("expected `{name}` {expected}, found {found}")]
    Parameter {
        /// Its name on the wire.
        name: &'static str,
        /// What would do.
        expected: String,
        /// What was given.
        found: String,
    },
    /// No such segment.
    #[error("expected a segment of {of} below {count}, found {segment}")]
    NoSuchSegment {
        /// Of what.
        of: &'static str,
        /// Number of segments there.
        count: usize,
        /// The number asked for.
        segment: u32,
    },
    /// No such query (never posted, or freed).
    #[error(
        "expected a query of this server, found none with the id {0}; it was removed, or never posted here: post it again"
    )]
    NoSuchQuery(QueryId),
    /// It ended, and made room for newer ones.
    #[error("expected a query that is held, found that {0} made room for newer ones after its end; post it again")]
    QueryExpired(QueryId),
    /// No such map.
    #[error("expected a map of the query, found none with the id {0}")]
    NoSuchMap(MapId),
    /// No such composition.
    #[error("expected a composition of the query, found none with the id {0}")]
    NoSuchComposition(CompositionId),
    /// No such retopology.
    #[error("expected a retopology of the query, found none with the id {0}")]
    NoSuchRetopo(RetopoId),
    /// The example has no encoding yet.
    #[error("expected segment {segment} of the example {example} to be encoded, found it waiting; try again shortly")]
    NotEncodedYet {
        /// The example.
        example: ExampleId,
        /// Its segment.
        segment: u32,
    },
    /// The query was cancelled or failed, so that nothing can be mapped on it.
    #[error("expected a query that was encoded, found it {state}; post it again")]
    QueryEnded {
        /// Its state.
        state: &'static str,
    },
    /// Example and query differ in topology.
    #[error("expected an example segment of topology {expected}, found {found}; choose one of the query's ranking")]
    TopologyDiffers {
        /// The query segment's.
        expected: Topology,
        /// The example segment's.
        found: Topology,
    },
    /// Nothing to rank against.
    #[error("expected examples {wanted} in the corpus, found none; add some, or ask for other tags")]
    CorpusEmpty {
        /// What they would have to be.
        wanted: String,
    },
    /// Too many things of one query.
    #[error("expected at most {limit} {of} a query; remove the query and post it again")]
    TooMany {
        /// Of what.
        of: &'static str,
        /// How many there may be.
        limit: usize,
    },
    /// It is not there yet, or never will be.
    #[error("expected a {product} that was made, found {id} {state}; {}", way_out(state))]
    NotMade {
        /// What it is.
        product: &'static str,
        /// Its id.
        id: String,
        /// Its state.
        state: &'static str,
    },
    /// Too many maps, compositions and retopologies of one query under way.
    #[error(
        "expected fewer than {limit} maps, compositions and retopologies of a query under way, found {limit}; try again shortly"
    )]
    MakingsFull {
        /// How many there may be.
        limit: usize,
    },
    /// Too many queries under way.
    #[error("expected fewer than {limit} queries under way, found {limit}; try again shortly")]
    QueriesFull {
        /// How many there may be.
        limit: usize,
    },
    /// Why a query ended, told to those who ask later.
    #[error("{0}")]
    Query(Arc<WorkError>),
    /// A task of ours ended without a result: a bug.
    #[error("a task ended without a result")]
    Lost,
}

/// What helps where something is not there.
fn way_out(state: &str) -> &'static str {
    if ["queued", "running"].contains(&state) { "ask for it with `wait`, or later" } else { "make it again" }
}

impl WorkError {
    /// Why the computation was stopped, if that is what this says.
    pub fn stop_reason(&self) -> Option<StopReason> {
        match self {
            Self::Pool(PoolError::Stopped(reason)) | Self::Engine(EngineError::Stopped(reason)) => Some(*reason),
            _ => None,
        }
    }

    /// Tells whether one example is to blame: it was removed meanwhile, is damaged, or the computation on it failed. Others can be
    /// tried.
    pub fn is_of_one_example(&self) -> bool {
        use CorpusError::{Damaged, NoEncoding, NotFound};
        match self {
            Self::Corpus(error) => matches!(error, NotFound(_) | Damaged(_) | NoEncoding(_)),
            Self::Engine(error) => !matches!(error, EngineError::Stopped(_)),
            Self::Pool(error) => matches!(error, PoolError::Panicked { .. }),
            Self::NotEncodedYet { .. } | Self::TopologyDiffers { .. } => true,
            _ => false,
        }
    }

    /// Joins the failure of a computation and that of the pool it ran in.
    ///
    /// # Errors
    /// Either's.
    pub fn joined<T>(found: Result<Result<T, EngineError>, PoolError>) -> Result<T, Self> {
        Ok(found??)
    }

    /// A value outside its range.
    pub fn parameter(name: &'static str, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Parameter { name, expected: expected.into(), found: found.to_string() }
    }
}
