//! The messages that Quadmuse's server and its clients exchange: plain serde types, one file a resource.
//!
//! The same types travel as JSON and as MessagePack (maps with string keys). Field names are the contract: readers
//! ignore fields they do not know, so fields may be added, never renamed or removed. Lengths and angles carry their
//! unit in the name or in the docstring; times are milliseconds.

pub mod admin;
pub mod composition;
pub mod constraint;
pub mod example;
pub mod format;
pub mod health;
pub mod id;
pub mod making;
pub mod map;
pub mod paging;
pub mod problem;
pub mod query;
pub mod ranking;
pub mod retopo;
pub mod sample;
pub mod segment;
pub mod share;
pub mod stream;
pub mod token;
pub mod upload;

#[cfg(feature = "openapi")]
mod schema;

pub use composition::{Composition, CompositionPart, NewComposition};
pub use constraint::{Constraint, ConstraintEdit, ConstraintOrigin, Landmark, Location, NewConstraint, OnFold, Place};
pub use example::{Example, ExamplePatch, ExampleSegment, MeshCounts, NamedPoint};
pub use format::MeshFormat;
pub use health::{Health, Readiness};
pub use id::{CompositionId, ExampleId, MapId, QueryId, RetopoId, UploadId};
pub use making::{CompositionOrMaking, Making, MakingEvent, MakingState, MapOrMaking, Product, RetopoOrMaking};
pub use map::{Beyond, Covers, Distortion, Histogram, Map, MapEvidence, MapTimings, NewMap, Verdict};
pub use paging::Page;
pub use problem::{Code, Problem};
pub use query::{LevelTiming, Progress, Query, QueryPatch, QuerySegment, QueryState, QueryTimings, SegmentName};
pub use ranking::{Entry, EntryState, Flip, Ranking};
pub use retopo::{NewRetopo, Retopo, RetopoResult};
pub use sample::{Sample, SampleKind};
pub use segment::{Components, Parts, Segmentation, Topology};
pub use share::Share;
pub use stream::{Begin, End, EndState, Event, StreamError};
pub use token::{CreatedToken, NewToken, Quota, Role, Token, TokenPatch};
