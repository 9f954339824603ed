//! Constraints of a map: pairs of points, one on the example and one on the input.

use serde::{Deserialize, Serialize};

/// Most constraints a map, features included.
pub const CONSTRAINTS_MAX: usize = 256;

/// A point of a surface, as a caller names it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Place {
    /// `[x, y, z]`, in the mesh's units; the nearest point of the surface is taken.
    Point([f64; 3]),
    /// A point of a face of the mesh as uploaded.
    OnFace {
        /// The face's number, from 0.
        face: u32,
        /// One weight a corner of the face, non-negative, their sum 1.
        barycentric: Vec<f64>,
    },
    /// A vertex of the mesh as uploaded.
    OnVertex {
        /// The vertex's number, from 0.
        vertex: u32,
    },
    /// A point of the segment's parameter domain.
    Domain {
        /// Periodic, in periods.
        u: f64,
        /// 0 on the boundary, 1 at the pole.
        v: f64,
    },
}

/// A point of a surface, as the service answers: every way to name it at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Location {
    /// The point, in the mesh's units.
    pub point: [f64; 3],
    /// Periodic, in periods.
    pub u: f64,
    /// 0 on the boundary, 1 at the pole.
    pub v: f64,
}

/// Where a constraint comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum ConstraintOrigin {
    /// A feature of the example, placed by the registration.
    Feature,
    /// Set by a caller.
    User,
}

/// A constraint of a map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Constraint {
    /// Its id, unique in the map.
    pub id: String,
    /// Its end on the example (S₁).
    pub on_example: Location,
    /// Its end on the input (S₂).
    pub on_input: Location,
    /// Where it comes from.
    pub origin: ConstraintOrigin,
}

/// A constraint to set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct NewConstraint {
    /// The constraint to move; absent to add one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// Its end on the example (S₁); absent to leave a moved constraint's end where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on_example: Option<Place>,
    /// Its end on the input (S₂); absent to leave a moved constraint's end where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on_input: Option<Place>,
}

/// A point of the example that a caller holds on a point of the input before the map is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Landmark {
    /// Its end on the example (S₁).
    pub on_example: Place,
    /// Its end on the input (S₂).
    pub on_input: Place,
    /// What it is called, for the caller's own use.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// Most landmarks a map.
pub const LANDMARKS_MAX: usize = 32;

/// `PATCH …/maps/{map}/constraints`: applied as a whole or not at all; removals first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ConstraintEdit {
    /// Constraints to move or add.
    #[serde(default)]
    pub set: Vec<NewConstraint>,
    /// Ids of constraints to remove.
    #[serde(default)]
    pub remove: Vec<String>,
    /// Ids of constraints to put back as the registration had them; those that were added go.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub undo: Vec<String>,
    /// What to do where the map would fold.
    #[serde(default)]
    pub on_fold: OnFold,
}

/// What to do where constraints would fold the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum OnFold {
    /// Refuse the edit.
    #[default]
    Refuse,
    /// Let constraints that the edit does not name make room.
    Resolve,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_read_in_each_of_its_forms() {
        let read = |text: &str| serde_json::from_str::<Place>(text).expect("a place");
        assert_eq!(read("[1, 2, 3.5]"), Place::Point([1.0, 2.0, 3.5]));
        assert_eq!(
            read(r#"{"face": 7, "barycentric": [0.5, 0.25, 0.25]}"#),
            Place::OnFace { face: 7, barycentric: vec![0.5, 0.25, 0.25] }
        );
        assert_eq!(read(r#"{"vertex": 12}"#), Place::OnVertex { vertex: 12 });
        assert_eq!(read(r#"{"u": 0.25, "v": 0.5}"#), Place::Domain { u: 0.25, v: 0.5 });
        assert!(serde_json::from_str::<Place>(r#"{"u": 0.25}"#).is_err());
    }

    #[test]
    fn an_edit_is_the_same_in_both_encodings() {
        let edit = ConstraintEdit {
            set: vec![NewConstraint { id: None, on_example: Some(Place::Point([0.0; 3])), on_input: None }],
            remove: vec!["f3".into()],
            undo: vec!["f4".into()],
            on_fold: OnFold::Resolve,
        };
        let packed = rmp_serde::to_vec_named(&edit).expect("packs");
        assert_eq!(rmp_serde::from_slice::<ConstraintEdit>(&packed).expect("unpacks"), edit);
        let text = serde_json::to_string(&edit).expect("prints");
        assert_eq!(serde_json::from_str::<ConstraintEdit>(&text).expect("parses"), edit);
    }
}
