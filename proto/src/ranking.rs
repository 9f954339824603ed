//! Rankings: the corpus segments in increasing score.

use crate::{
    id::{ExampleId, QueryId},
    query::QueryState,
    share::Share,
};
use serde::{Deserialize, Serialize};

/// Entries of a ranking when the caller names no `limit`, and in streams.
pub const ENTRIES_DEFAULT: u32 = 200;

/// For one query segment, the corpus segments in increasing score, at some revision.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Ranking {
    /// The query.
    pub query: QueryId,
    /// Its segment.
    pub segment: u32,
    /// The name that the segment was given, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segment_name: Option<String>,
    /// Grows with every ranking of the query, whichever the segment; 0 before the first.
    pub revision: u64,
    /// The level just ranked, in pixels a side; 0 before the first.
    pub level: u32,
    /// The finest level asked for, in pixels a side.
    pub resolution: u32,
    /// Where the query stands.
    pub state: QueryState,
    /// The best entries, best first.
    pub entries: Vec<Entry>,
    /// Corpus segments ranked, of which `entries` are the best; an example that is there whole and by its parts counts once.
    pub corpus_size: u64,
    /// Shares of the corpus that no server answered for: their examples are not among the entries.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub incomplete: Vec<Share>,
}

/// A corpus segment in a ranking.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Entry {
    /// Its place, from 1.
    pub rank: u32,
    /// The example.
    pub example: ExampleId,
    /// The example's segment.
    pub example_segment: u32,
    /// The example's name.
    pub name: String,
    /// E′ (eq. 8): the lower the better. Scores of different levels can't be compared, so those of locked entries are
    /// lifted, all by the same amount, until none is better than an entry that went on.
    pub score: f64,
    /// E: the registered energy.
    pub energy: f64,
    /// The modulus of the example's segment.
    pub k: f64,
    /// The example's relevance, 0–5.
    pub relevance: f64,
    /// How the example is flipped before it is laid on the input.
    pub flip: Flip,
    /// By how much it is shifted along u, in periods, 0–1.
    pub shift_u: f64,
    /// The level at which it was registered last, in pixels a side.
    pub resolution: u32,
    /// Whether it goes on.
    pub state: EntryState,
    /// How well the surface itself lies on the input in its best rough pose, 0–1; absent where the pictures are sure. Where
    /// it is far better of one than of the first, entries stand in its order, each with the score of its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub likeness: Option<f64>,
    /// How sure it is when it is laid on the input roughly, below 1; absent where that was not tried. Entries with more than 0 stand
    /// first, by this times the share of the input that they cover.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agreement: Option<f64>,
    /// The rank of an entry above that it nearly duplicates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub similar_to: Option<u32>,
    /// The name of the built-in regular layout, if it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub template: Option<String>,
    /// In which turn it is laid where nobody chooses, from 1; absent where it is not: it nearly duplicates another, or lay badly
    /// when it was laid roughly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<u32>,
}

/// A flip of the parameter domain, per axis. Exactly one of both set means a mirror image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Flip {
    /// u → −u.
    pub u: bool,
    /// v → 1 − v.
    pub v: bool,
}

impl Flip {
    /// Whether the flip turns the surface into its mirror image, so that the winding of every face is reversed.
    pub fn is_mirror(self) -> bool {
        self.u != self.v
    }
}

/// Whether an entry goes on to finer levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum EntryState {
    /// It goes on to the next level.
    Refining,
    /// It was passed over at a finer level; it is resumed when it is selected for mapping.
    Locked,
    /// It was registered at the finest level asked for.
    Done,
}
