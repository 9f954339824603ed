//! Queries: an input mesh while it is ranked against the corpus, and after.

use crate::{example::MeshCounts, id::QueryId, making::Making, problem::Problem, segment::Topology, share::Share};
use serde::{Deserialize, Serialize};

/// Entries a segment that go on to the full resolution when the caller names no `top`.
pub const TOP_DEFAULT: u32 = 4;

/// The largest `top` that is accepted.
pub const TOP_MAX: u32 = 64;

/// The finest level when the caller names no `resolution`, in pixels a side.
pub const RESOLUTION_DEFAULT: u32 = 128;

/// The levels of the pyramid, in pixels a side; each is a `resolution` that is accepted.
pub const LEVELS: [u32; 5] = [32, 64, 128, 256, 512];

/// Longest `deadline_ms` that is accepted: one hour.
pub const DEADLINE_MS_MAX: u64 = 3_600_000;

/// Longest `wait_ms` of a long poll.
pub const WAIT_MS_MAX: u64 = 60_000;

/// Most characters of a segment's name.
pub const SEGMENT_NAME_LENGTH_MAX: usize = 60;

/// Most segments of a query that have names.
pub const SEGMENTS_NAMED_MAX: usize = 256;

/// Where a query stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum QueryState {
    /// Waiting for a core.
    Queued,
    /// Its segments are being unfolded and encoded.
    Encoding,
    /// Its ranking is being refined.
    Ranking,
    /// Its ranking is final (also when its deadline ended it: see [`Query::deadline_reached`]).
    Done,
    /// It was cancelled.
    Cancelled,
    /// It failed; [`Query::problem`] says why.
    Failed,
}

impl QueryState {
    /// Whether nothing more will change.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::Cancelled | Self::Failed)
    }

    /// The name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Encoding => "encoding",
            Self::Ranking => "ranking",
            Self::Done => "done",
            Self::Cancelled => "cancelled",
            Self::Failed => "failed",
        }
    }
}

/// A query.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Query {
    /// Its id.
    pub id: QueryId,
    /// Where it stands.
    pub state: QueryState,
    /// Whether its deadline ended it before the last level.
    pub deadline_reached: bool,
    /// Entries a segment that go on to the full resolution.
    pub top: u32,
    /// The finest level asked for, in pixels a side.
    pub resolution: u32,
    /// Its deadline, counted from the upload, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deadline_ms: Option<u64>,
    /// Only examples with all these tags are ranked.
    pub tags: Vec<String>,
    /// What the input mesh is made of.
    pub counts: MeshCounts,
    /// What was repaired while reading, a sentence each.
    pub repairs: Vec<String>,
    /// True where it was cut at its waist, into two segments, as `parts=waist` asks for.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub waist: bool,
    /// Its segments, numbered from 0.
    pub segments: Vec<QuerySegment>,
    /// How far it has come.
    pub progress: Progress,
    /// Where its time went.
    pub timings: QueryTimings,
    /// The revision of its newest ranking; 0 before the first.
    pub revision: u64,
    /// Corpus segments it is ranked against, all its segments together.
    pub corpus_size: u64,
    /// Shares of the corpus that no server answered for, for one segment at least: the rankings are without their examples.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub incomplete: Vec<Share>,
    /// When it was uploaded: RFC 3339, UTC.
    pub created: String,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<Problem>,
    /// Its maps, compositions and retopologies that are being made, and those that failed or were cancelled, the oldest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub making: Vec<Making>,
}

/// A segment of a query.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QuerySegment {
    /// Its number in the query.
    pub segment: u32,
    /// The name that it was given, if any. Two of a query may have the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its topology.
    pub topology: Topology,
    /// Faces of the input that belong to it.
    pub faces: u64,
    /// Small holes in it that are counted as filled; left out where there are none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub holes: u32,
    /// Entries of its ranking that are worth laying on it where nobody chose one, until one is not poor; 0: it has too little
    /// form, and takes a regular layout. A composition without named maps tries as many.
    pub tries: u32,
    /// Its modulus, once it is encoded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k: Option<f64>,
    /// Feature points found on it, once it is encoded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub features: Option<u32>,
    /// The level its ranking has reached, in pixels a side; absent before the first ranking.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<u32>,
    /// Corpus segments that it is ranked against; an example that is there whole and by its parts counts once.
    pub corpus_size: u64,
}

/// `PATCH /v1/queries/{id}`: all of it or nothing; what is absent stays as it is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QueryPatch {
    /// New names of segments, each segment once; the others keep theirs. At most 256 segments of a query have names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<SegmentName>,
}

/// The name of a segment of a query.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SegmentName {
    /// The segment's number in the query.
    pub segment: u32,
    /// Its name: at most 60 characters, not only blanks, without control and direction characters; empty takes it off.
    pub name: String,
}

fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// How far a query has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Progress {
    /// Segments encoded.
    pub segments_encoded: u32,
    /// Segments in all.
    pub segments: u32,
    /// Levels ranked, over all segments.
    pub levels_done: u32,
    /// Levels to rank, over all segments.
    pub levels: u32,
}

/// Where a query's time went, in milliseconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QueryTimings {
    /// Reading, checking and cutting the mesh.
    pub read_ms: f64,
    /// Waiting for a core.
    pub queued_ms: f64,
    /// Unfolding and encoding, all segments together.
    pub encode_ms: f64,
    /// From the upload to the first ranking; absent before it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_ranking_ms: Option<f64>,
    /// Ranking, level by level, in the order of computation; finishing the best comes last, under the last level.
    pub levels: Vec<LevelTiming>,
    /// From the upload to the end, or to now.
    pub total_ms: f64,
}

/// The time one level of one segment took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct LevelTiming {
    /// The query's segment.
    pub segment: u32,
    /// The level, in pixels a side.
    pub level: u32,
    /// Corpus segments registered at this level.
    pub entries: u64,
    /// Milliseconds.
    pub ms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patch_travels_as_it_was_and_what_it_does_not_know_is_refused() {
        let name = SegmentName { segment: 2, name: "left arm".into() };
        let patch = QueryPatch { segments: vec![name] };
        let text = serde_json::to_string(&patch).expect("prints");
        assert_eq!(text, r#"{"segments":[{"segment":2,"name":"left arm"}]}"#);
        assert_eq!(serde_json::from_str::<QueryPatch>(&text).expect("reads"), patch);
        let packed = rmp_serde::to_vec_named(&patch).expect("packs");
        assert_eq!(rmp_serde::from_slice::<QueryPatch>(&packed).expect("unpacks"), patch);
        assert_eq!(serde_json::from_str::<QueryPatch>("{}").expect("reads"), QueryPatch::default());
        for wrong in
            [r#"{"names":[]}"#, r#"{"segments":[{"segment":2}]}"#, r#"{"segments":[{"segment":2,"name":"a","x":1}]}"#]
        {
            assert!(serde_json::from_str::<QueryPatch>(wrong).is_err(), "{wrong}");
        }
    }
}
