//! Compositions: the maps of a query's segments, stitched into one mesh of quads.

use crate::{
    id::{CompositionId, MapId, QueryId},
    making::MakingState,
    map::{Beyond, Covers, Verdict},
};
use serde::{Deserialize, Serialize};

/// The largest `smoothing` that is accepted.
pub const SMOOTHING_MAX: u32 = 100;

/// The `smoothing` when the caller names none.
pub const SMOOTHING_DEFAULT: u32 = 5;

fn whole() -> f64 {
    1.0
}

pub(crate) fn extend() -> Beyond {
    Beyond::Extend
}

pub(crate) fn smoothing_default() -> u32 {
    SMOOTHING_DEFAULT
}

/// `POST /v1/queries/{id}/compositions`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NewComposition {
    /// The map of each segment. A segment that is not named takes the best example of its ranking, or, where there is
    /// none or its map is poor, a regular layout at the density of its neighbours. So does one that is named with a regular
    /// layout, unless that was edited or is to be kept.
    #[serde(default)]
    pub parts: Vec<CompositionPart>,
    /// Rounds of smoothing, with projection back onto the input.
    #[serde(default = "smoothing_default")]
    pub smoothing: u32,
    /// How much denser than the examples the quads are to be: each step doubles the rows and columns of every part
    /// (four times the faces), each step below 0 halves them where a part's layout is a regular subdivision. A density that
    /// would give too many faces is refused, and the refusal tells their number.
    #[serde(default)]
    pub density: i32,
    /// Segments whose parts keep their density, as parts chosen by hand for their layout should: these are subdivided only
    /// where they can't be joined otherwise, and `density` beyond that is asked for in steps. Where none is kept, parts that
    /// miss the input are subdivided until the result follows it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keep: Vec<u32>,
    /// How the input is treated where it reaches beyond the examples of segments that are not named.
    #[serde(default = "extend")]
    pub beyond: Beyond,
}

/// The largest step of `density`, to either side.
pub const DENSITY_MAX: i32 = 4;

/// One part of a composition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompositionPart {
    /// The query's segment.
    pub segment: u32,
    /// Its map.
    pub map: MapId,
}

/// A stitched mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Composition {
    /// Its id.
    pub id: CompositionId,
    /// The query.
    pub query: QueryId,
    /// Where it stands: `done`, as whatever is told whole.
    #[serde(default)]
    pub state: MakingState,
    /// How far it is: 1.
    #[serde(default = "whole")]
    pub progress: f64,
    /// Whether it is worth keeping: the worst of the maps that make up a share of it worth telling; `poor` where no example
    /// was used.
    pub verdict: Verdict,
    /// Share of its area whose quads are an example's, 0–1.
    pub inspired: f64,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// How much of the examples and of the input it reaches.
    #[serde(default)]
    pub covers: Covers,
    /// Its parts.
    pub parts: Vec<CompositionPart>,
    /// Segments that are regular layouts.
    #[serde(default)]
    pub templates: Vec<u32>,
    /// Rounds of smoothing.
    pub smoothing: u32,
    /// Steps of density.
    #[serde(default)]
    pub density: i32,
    /// Vertices.
    pub vertices: u64,
    /// Quads.
    pub quads: u64,
    /// Triangles left: 0.
    pub triangles: u64,
    /// Inner vertices with another number of edges than four.
    pub extraordinary_vertices: u64,
    /// Those that the parts had inside before they were stitched.
    #[serde(default)]
    pub extraordinary_before: u64,
    /// What was done beyond plain stitching, a sentence each.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Milliseconds it took.
    pub total_ms: f64,
}
