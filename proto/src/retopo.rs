//! Retopologies: quads for all of a scan in one go, cut otherwise where the corpus has nothing for the whole of it.

use crate::{
    composition::{SMOOTHING_DEFAULT, extend, smoothing_default},
    id::{CompositionId, MapId, QueryId, RetopoId},
    making::MakingState,
    map::{Beyond, Covers, Verdict},
};
use serde::{Deserialize, Serialize};

/// `POST /v1/queries/{id}/retopos`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NewRetopo {
    /// How the scan is treated where it reaches beyond an example.
    #[serde(default = "extend")]
    pub beyond: Beyond,
    /// Rounds of smoothing, as a composition has them.
    #[serde(default = "smoothing_default")]
    pub smoothing: u32,
    /// Steps of density, as a composition has them. A result with such steps is always a composition.
    #[serde(default)]
    pub density: Option<i32>,
}

impl Default for NewRetopo {
    fn default() -> Self {
        Self { beyond: Beyond::Extend, smoothing: SMOOTHING_DEFAULT, density: None }
    }
}

/// The map or the composition that a retopology came to: under `/v1/queries/{query}` of [`Retopo::result_query`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum RetopoResult {
    /// A map as it is, with the example's own vertex order, faces, UVs and groups.
    Map(MapId),
    /// A composition.
    Composition(CompositionId),
}

/// The best quads for all of a scan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Retopo {
    /// Its id.
    pub id: RetopoId,
    /// The query that it was asked of.
    pub query: QueryId,
    /// Where it stands: `done`, as whatever is told whole.
    pub state: MakingState,
    /// How far it is: 1.
    pub progress: f64,
    /// The query that has the result: this one, or another of the same scan, which was cut otherwise.
    pub result_query: QueryId,
    /// The result.
    pub result: RetopoResult,
    /// Tells whether it is worth keeping.
    pub verdict: Verdict,
    /// Share of its area whose quads are an example's, 0–1.
    pub inspired: f64,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// How much of the examples and of the scan it reaches.
    pub covers: Covers,
    /// Tells what was tried on the way, a sentence each.
    pub notes: Vec<String>,
    /// Milliseconds it took.
    pub total_ms: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_request_asks_for_the_defaults_and_a_result_names_its_kind() {
        assert_eq!(serde_json::from_str::<NewRetopo>("{}").expect("parses"), NewRetopo::default());
        let map = RetopoResult::Map(MapId::from_bytes([1; 16]));
        let text = serde_json::to_string(&map).expect("prints");
        assert!(text.starts_with(r#"{"map":""#), "{text}");
        let packed = rmp_serde::to_vec_named(&map).expect("packs");
        assert_eq!(rmp_serde::from_slice::<RetopoResult>(&packed).expect("unpacks"), map);
    }
}
