//! Segments: the topological primitives that are encoded, ranked and mapped.

use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// The topology of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Topology {
    /// One boundary loop, no handle.
    Disc,
    /// Two boundary loops, no handle.
    Annulus,
    /// No boundary, no handle.
    Sphere,
    /// No boundary, one handle.
    Torus,
}

impl Topology {
    /// All topologies, in the order in which they are listed.
    pub const ALL: [Self; 4] = [Self::Disc, Self::Annulus, Self::Sphere, Self::Torus];

    /// The name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Disc => "disc",
            Self::Annulus => "annulus",
            Self::Sphere => "sphere",
            Self::Torus => "torus",
        }
    }

    /// Tells whether a surface has at most one boundary loop and no handle: of two such one may be laid on a part of the other.
    pub fn has_caps(self) -> bool {
        matches!(self, Self::Disc | Self::Sphere)
    }
}

/// How an uploaded mesh is cut into segments (`segments=`).
///
/// A third way, labels a face in the multipart part `segments`, needs no name here: it is used whenever that part is
/// there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Segmentation {
    /// The whole mesh if it is a primitive, else its groups if each is one, else automatic segmentation.
    #[default]
    Auto,
    /// The whole mesh is one segment; refused if it is not a primitive.
    Whole,
    /// One segment a group (OBJ `g`/`usemtl`, PLY face property `segment`).
    Groups,
}

impl Segmentation {
    /// The name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Whole => "whole",
            Self::Groups => "groups",
        }
    }
}

/// What becomes of a mesh of several components (`components=`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Components {
    /// The largest is taken where the others are small components beside it, and a repair says so.
    #[default]
    Largest,
    /// Refused.
    Refuse,
}

impl Components {
    /// The name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Largest => "largest",
            Self::Refuse => "refuse",
        }
    }
}

/// The most segments that `parts=` can ask for.
pub const PARTS_MAX: u32 = 64;

/// How many segments automatic segmentation aims at (`parts=`). Without it an input that is a primitive stays whole, and an
/// example that is one is kept whole and by its parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parts {
    /// No parts of what can stay whole (`none`).
    None,
    /// One for each protrusion, and what is left into as few as can be (`auto`).
    Auto,
    /// Two, cut at the narrowest place that divides much: a figure and its base (`waist`). Where there is no such place, as without
    /// `parts=`; only of a query.
    Waist,
    /// So many, if the topology allows.
    Count(u32),
}

impl FromStr for Parts {
    type Err = UnknownWord;

    fn from_str(text: &str) -> Result<Self, UnknownWord> {
        match text {
            "auto" => return Ok(Self::Auto),
            "none" => return Ok(Self::None),
            "waist" => return Ok(Self::Waist),
            _ => {}
        }
        let count = text.parse().ok().filter(|n| (1..=PARTS_MAX).contains(n));
        count
            .map(Self::Count)
            .ok_or_else(|| UnknownWord { expected: "auto, waist, none, or a number from 1 to 64", found: text.into() })
    }
}

impl fmt::Display for Parts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.pad("none"),
            Self::Waist => f.pad("waist"),
            Self::Auto => f.pad("auto"),
            Self::Count(n) => n.fmt(f),
        }
    }
}

/// A word that is none of those expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected one of {expected}, found `{found}`")]
pub struct UnknownWord {
    /// The words that would do, as a list for people.
    pub expected: &'static str,
    /// What stood there instead.
    pub found: String,
}

impl FromStr for Topology {
    type Err = UnknownWord;

    fn from_str(text: &str) -> Result<Self, UnknownWord> {
        let expected = "disc, annulus, sphere, torus";
        Self::ALL.into_iter().find(|t| t.as_str() == text).ok_or_else(|| UnknownWord { expected, found: text.into() })
    }
}

impl FromStr for Segmentation {
    type Err = UnknownWord;

    fn from_str(text: &str) -> Result<Self, UnknownWord> {
        [Self::Auto, Self::Whole, Self::Groups]
            .into_iter()
            .find(|s| s.as_str() == text)
            .ok_or_else(|| UnknownWord { expected: "auto, whole, groups", found: text.into() })
    }
}

impl FromStr for Components {
    type Err = UnknownWord;

    fn from_str(text: &str) -> Result<Self, UnknownWord> {
        [Self::Largest, Self::Refuse]
            .into_iter()
            .find(|c| c.as_str() == text)
            .ok_or_else(|| UnknownWord { expected: "largest, refuse", found: text.into() })
    }
}

impl fmt::Display for Topology {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Display for Segmentation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_on_the_wire_is_the_name_that_is_parsed() {
        for topology in Topology::ALL {
            assert_eq!(serde_json::to_value(topology).expect("a word"), topology.as_str());
            assert_eq!(topology.as_str().parse::<Topology>(), Ok(topology));
        }
        for what in [Components::Largest, Components::Refuse] {
            assert_eq!(serde_json::to_value(what).expect("a word"), what.as_str());
            assert_eq!(what.as_str().parse::<Components>(), Ok(what));
        }
        for way in [Segmentation::Auto, Segmentation::Whole, Segmentation::Groups] {
            assert_eq!(serde_json::to_value(way).expect("a word"), way.as_str());
            assert_eq!(way.as_str().parse::<Segmentation>(), Ok(way));
        }
    }

    #[test]
    fn a_number_of_parts_is_a_word_or_within_its_limits() {
        for parts in [Parts::None, Parts::Auto, Parts::Count(1), Parts::Count(PARTS_MAX)] {
            assert_eq!(parts.to_string().parse::<Parts>(), Ok(parts));
        }
        for text in ["0", "65", "-1", "many", ""] {
            assert!(text.parse::<Parts>().is_err(), "{text}");
        }
    }

    #[test]
    fn an_unknown_word_is_refused_with_the_words_that_would_do() {
        let error = "klein".parse::<Topology>().expect_err("no such topology");
        assert_eq!(error.to_string(), "expected one of disc, annulus, sphere, torus, found `klein`");
    }
}
