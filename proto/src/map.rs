//! Maps: one corpus segment laid on one query segment.

use crate::{
    constraint::{Constraint, Landmark, Place},
    id::{ExampleId, MapId, QueryId},
    making::MakingState,
    ranking::Flip,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// `POST /v1/queries/{id}/maps`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NewMap {
    /// The query's segment.
    #[serde(default)]
    pub segment: u32,
    /// The example to lay on it; [`ExampleId::TEMPLATE`] for a regular layout.
    pub example: ExampleId,
    /// The example's segment.
    #[serde(default)]
    pub example_segment: u32,
    /// How the input is treated where it reaches beyond the example.
    #[serde(default)]
    pub beyond: Beyond,
    /// Points of the example that are held on points of the input, at most 32. From three on they fix pose and extent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub landmarks: Vec<Landmark>,
    /// Points of the input by name, at most 128. Where the example has a landmark of the same name, it is held there, as `landmarks`
    /// are; other names are passed over. Of more than 32 in all those are taken that lie farthest apart.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub names: BTreeMap<String, Place>,
}

impl NewMap {
    /// A map that nothing holds, of the example's faces alone.
    pub fn new(segment: u32, example: ExampleId, example_segment: u32) -> Self {
        let (beyond, landmarks, names) = (Beyond::Leave, Vec::new(), BTreeMap::new());
        Self { segment, example, example_segment, beyond, landmarks, names }
    }
}

/// Tells how the input is treated where it reaches beyond the example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Beyond {
    /// It is left bare: the example's faces alone.
    #[default]
    Leave,
    /// Rows of quads continue the example's boundary to where the input ends, and its faces are extruded along protrusions that it
    /// lacks.
    Extend,
}

/// The cross map of one corpus segment onto one query segment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Map {
    /// Its id.
    pub id: MapId,
    /// The query.
    pub query: QueryId,
    /// Where it stands: `done`, as whatever is told whole.
    #[serde(default)]
    pub state: MakingState,
    /// How far it is: 1.
    #[serde(default = "whole")]
    pub progress: f64,
    /// The query's segment.
    pub segment: u32,
    /// The example.
    pub example: ExampleId,
    /// The example's segment.
    pub example_segment: u32,
    /// Grows with every edit of the constraints, from 1.
    pub revision: u64,
    /// How the example is flipped.
    pub flip: Flip,
    /// By how much it is shifted along u, in periods, 0–1.
    pub shift_u: f64,
    /// E: the registered energy.
    pub energy: f64,
    /// The level of the registration, in pixels a side.
    pub resolution: u32,
    /// The pairs of points that fix it.
    pub constraints: Vec<Constraint>,
    /// Vertices of the mapped mesh.
    pub vertices: u64,
    /// Faces of the mapped mesh.
    pub faces: u64,
    /// Of its vertices those that are the example's: they come first, in the example's order.
    #[serde(default)]
    pub own_vertices: u64,
    /// Of its faces those that are the example's: they come first, in the example's order. Those at a tip to which they were extruded
    /// have other vertices around them.
    #[serde(default)]
    pub own_faces: u64,
    /// The example's vertices that the mesh has, by their number from 0 in the example's file; `null` for all of them.
    /// Others lie beyond the input.
    #[serde(default)]
    pub kept: Option<Vec<u32>>,
    /// How much of each surface the other reaches.
    #[serde(default)]
    pub covers: Covers,
    /// Share of the mesh's area whose faces are the example's, 0–1.
    #[serde(default)]
    pub inspired: f64,
    /// Faces that lie flipped on the input, beyond the example's own.
    pub folds: u64,
    /// How it distorts the example.
    pub distortion: Distortion,
    /// Whether it is worth keeping.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// The measures behind the verdict, where the example has settled on the input.
    #[serde(default)]
    pub evidence: Option<MapEvidence>,
    /// Where its time went.
    pub timings: MapTimings,
}

fn whole() -> f64 {
    1.0
}

/// Measures that speak for or against a map. Lengths are in √area of the example as it is laid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MapEvidence {
    /// How sure the map is: relief, less what its bend counts. Below 1; right maps have some 0.3 to 0.9.
    #[serde(default)]
    pub agreement: f64,
    /// Correlation of bumps and hollows on the example and where they lie on the input, −1 to 1.
    pub relief: f64,
    /// The same within small windows, each of which counts as much as the example's bumps vary there. Right maps have .3 and more.
    #[serde(default)]
    pub local_relief: f64,
    /// How much the example is drawn out in one direction against others, as the mean of a logarithm.
    pub shear: f64,
    /// How unevenly it grows, as the deviation of a logarithm.
    pub scale_spread: f64,
    /// How much its stretching changes from place to place.
    pub bend: f64,
    /// Root mean square distance from the input before its vertices were moved onto it.
    pub residual: f64,
    /// Mean of 1 − cos between the normals of the two.
    pub normal_disagreement: f64,
}

/// How much of each surface the other reaches, as shares of their areas.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Covers {
    /// Of the example: less than 1 where it reaches beyond the input.
    pub example: f64,
    /// Of the query's segment: less than 1 where it reaches beyond the example.
    pub input: f64,
}

impl Default for Covers {
    fn default() -> Self {
        Self { example: 1.0, input: 1.0 }
    }
}

/// How a map distorts the example's faces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Distortion {
    /// Change of a face's corner angles, in degrees.
    pub angle: Histogram,
    /// log₂ of the ratio of a face's share of the area, after to before.
    pub area: Histogram,
}

/// A distribution, with its statistics.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Histogram {
    /// Bounds of the bins, increasing: one more than `counts`.
    pub edges: Vec<f64>,
    /// Values in each bin; those beyond the ends are counted in the outermost.
    pub counts: Vec<u64>,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile (of the magnitude).
    pub p95: f64,
    /// Largest (in magnitude).
    pub max: f64,
}

/// Whether a map or a composition is worth keeping; the better is the less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Verdict {
    /// Use it.
    Good,
    /// Look at it first.
    Fair,
    /// Choose another example, or set constraints.
    Poor,
    /// Its mesh is no use as it is: it leaves the input, crosses it, or collapses.
    Broken,
}

impl Verdict {
    /// The word on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
            Self::Broken => "broken",
        }
    }

    /// Whether nobody should get it who did not choose it.
    pub fn is_poor(self) -> bool {
        self >= Self::Poor
    }
}

/// Where a map's time went, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MapTimings {
    /// Finishing the registration at full resolution.
    pub register_ms: f64,
    /// Mapping every vertex, and measuring.
    pub map_ms: f64,
    /// From the request to the answer.
    pub total_ms: f64,
}
