//! The events of `GET /v1/queries/{id}/stream`.
//!
//! As SSE, `event:` is the tag, `id:` the revision and `data:` the object as JSON; as NDJSON, one object a line; as
//! MessagePack, one object after the other. Blank NDJSON lines, SSE comments and MessagePack nils are heartbeats.
//! The latest ranking wins: a slow reader may miss a level, never the last one.

use crate::{id::QueryId, problem::Problem, query::Query, ranking::Ranking};
use serde::{Deserialize, Serialize};

/// One event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Event {
    /// Once, first (not again on a resumed stream).
    Begin(Begin),
    /// After each level of each segment: a whole ranking.
    Level(Ranking),
    /// Once, last.
    End(Box<End>),
    /// Once, last, in place of `end`: the stream broke off, the query may go on.
    Error(StreamError),
}

impl Event {
    /// The tag.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Begin(_) => "begin",
            Self::Level(_) => "level",
            Self::End(_) => "end",
            Self::Error(_) => "error",
        }
    }

    /// The revision after which a resumed stream goes on; `None` where resuming makes no sense.
    pub fn revision(&self) -> Option<u64> {
        match self {
            Self::Begin(_) => Some(0),
            Self::Level(ranking) => Some(ranking.revision),
            Self::End(end) => Some(end.revision),
            Self::Error(_) => None,
        }
    }

    /// Whether nothing follows.
    pub fn is_last(&self) -> bool {
        matches!(self, Self::End(_) | Self::Error(_))
    }
}

/// The first event: the query as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Begin {
    /// The query.
    pub query: QueryId,
    /// Its segments.
    pub segments: u32,
    /// The finest level asked for, in pixels a side.
    pub resolution: u32,
    /// Corpus segments it is ranked against, all its segments together.
    pub corpus_size: u64,
}

/// How a stream ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum EndState {
    /// Every level was ranked.
    Done,
    /// The query was cancelled.
    Cancelled,
    /// The query failed; `summary.problem` says why.
    Failed,
    /// The deadline came first; the last ranking is the best so far.
    Deadline,
}

/// The last event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct End {
    /// The query.
    pub query: QueryId,
    /// How it ended.
    pub state: EndState,
    /// The revision of the last ranking.
    pub revision: u64,
    /// The query as `GET /v1/queries/{id}` answers from now on.
    pub summary: Query,
}

/// Why a stream broke off.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StreamError {
    /// The query.
    pub query: QueryId,
    /// What happened.
    pub problem: Problem,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{problem::Code, query::QueryState};

    fn ranking() -> Ranking {
        let query = QueryId::generate();
        let (state, entries) = (QueryState::Ranking, Vec::new());
        let (incomplete, corpus_size) = (Vec::new(), 3);
        Ranking {
            query,
            segment: 1,
            segment_name: Some("arm".into()),
            revision: 7,
            level: 32,
            resolution: 128,
            state,
            entries,
            corpus_size,
            incomplete,
        }
    }

    #[test]
    fn a_level_is_a_whole_ranking_beside_its_tag() {
        let ranking = ranking();
        let mut expected = serde_json::to_value(&ranking).expect("an object");
        expected["event"] = "level".into();
        assert_eq!(serde_json::to_value(Event::Level(ranking)).expect("an object"), expected);
    }

    #[test]
    fn events_are_the_same_in_both_encodings() {
        let problem = Problem::new(Code::Unavailable, 503, "the service is stopping");
        for event in [Event::Level(ranking()), Event::Error(StreamError { query: QueryId::generate(), problem })] {
            let packed = rmp_serde::to_vec_named(&event).expect("packs");
            assert_eq!(rmp_serde::from_slice::<Event>(&packed).expect("unpacks"), event);
            let text = serde_json::to_string(&event).expect("prints");
            assert_eq!(serde_json::from_str::<Event>(&text).expect("parses"), event);
        }
    }
}
