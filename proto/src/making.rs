//! Maps, compositions and retopologies while they are made: how far they are, and what became of those that failed.

use crate::{composition::Composition, id::QueryId, map::Map, problem::Problem, retopo::Retopo};
use serde::{Deserialize, Serialize};

/// The longest `wait` of a request, in seconds.
pub const WAIT_MAX: u64 = 240;

/// Where a map, a composition or a retopology stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum MakingState {
    /// It waits for the query, or for its turn.
    Queued,
    /// It is computed.
    Running,
    /// It is there.
    #[default]
    Done,
    /// It could not be made: `problem` tells why.
    Failed,
    /// Somebody cancelled it.
    Cancelled,
}

impl MakingState {
    /// The word on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// Whether nothing more will change.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::Failed | Self::Cancelled)
    }
}

/// What is being made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Product {
    /// A map.
    Map,
    /// A composition.
    Composition,
    /// A retopology: maps and compositions of all of a scan, of which the best is kept.
    Retopo,
}

impl Product {
    /// The word on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Map => "map",
            Self::Composition => "composition",
            Self::Retopo => "retopo",
        }
    }
}

/// A map, a composition or a retopology that is not there yet, or never will be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Making {
    /// The id that the map or composition has, too, once it is there.
    pub id: String,
    /// What it is.
    pub product: Product,
    /// The query it is made of.
    pub query: QueryId,
    /// Where it stands.
    pub state: MakingState,
    /// How far it is, 0–1: by steps, not by time.
    pub progress: f64,
    /// What is being done, in words.
    pub stage: String,
    /// When it was asked for: RFC 3339, UTC.
    pub created: String,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<Problem>,
}

/// A map, or how far it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum MapOrMaking {
    /// It is there.
    There(Box<Map>),
    /// It is made, or could not be.
    Making(Making),
}

/// A composition, or how far it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum CompositionOrMaking {
    /// It is there.
    There(Box<Composition>),
    /// It is made, or could not be.
    Making(Making),
}

/// A retopology, or how far it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum RetopoOrMaking {
    /// It is there.
    There(Box<Retopo>),
    /// It is made, or could not be.
    Making(Making),
}

/// An event of the stream of a map or composition that is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum MakingEvent {
    /// It got further.
    Progress(Making),
    /// It is over; the last event.
    End(Making),
}

impl MakingEvent {
    /// The name of the event.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Progress(_) => "progress",
            Self::End(_) => "end",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_is_the_same_in_both_encodings() {
        let making = Making {
            id: "01ARZ3NDEKTSV4RRFFQ69G5FAV".into(),
            product: Product::Composition,
            query: QueryId::from_bytes([7; 16]),
            state: MakingState::Running,
            progress: 0.25,
            stage: "laying examples".into(),
            created: "2025-01-01T00:00:00Z".into(),
            problem: None,
        };
        let event = MakingEvent::Progress(making);
        let text = serde_json::to_string(&event).expect("prints");
        assert!(text.contains(r#""event":"progress""#) && text.contains(r#""state":"running""#), "{text}");
        assert_eq!(serde_json::from_str::<MakingEvent>(&text).expect("parses"), event);
        let packed = rmp_serde::to_vec_named(&event).expect("packs");
        assert_eq!(rmp_serde::from_slice::<MakingEvent>(&packed).expect("unpacks"), event);
    }
}
