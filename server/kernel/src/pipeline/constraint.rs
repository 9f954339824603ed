//! Constraints of a map: pairs of points that correspond, and how a caller names and edits them.

/// A point of a surface, as a caller names it.
#[derive(Clone, Debug, PartialEq)]
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

/// A point of a surface as it is told: every way to name it at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedPoint {
    /// The point, in the mesh's units.
    pub point: [f64; 3],
    /// Periodic, in periods.
    pub u: f64,
    /// 0 on the boundary, 1 at the pole.
    pub v: f64,
}

/// Where a constraint comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConstraintOrigin {
    /// A feature of the example, placed by the registration.
    Feature,
    /// Set by a caller.
    User,
}

/// A pair of points that fixes a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraint {
    /// Its id, unique in the map.
    pub id: String,
    /// Its end on the example (S₁).
    pub on_example: LocatedPoint,
    /// Its end on the input (S₂).
    pub on_input: LocatedPoint,
    /// Where it comes from.
    pub origin: ConstraintOrigin,
}

/// A constraint to move or add.
#[derive(Clone, Debug, PartialEq)]
pub struct NewConstraint {
    /// The constraint to move; `None` adds one.
    pub id: Option<String>,
    /// Its end on the example; `None` leaves a moved constraint's end where it is.
    pub on_example: Option<Place>,
    /// Its end on the input; `None` leaves a moved constraint's end where it is.
    pub on_input: Option<Place>,
}

/// A point of the example that is held on a point of the input.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// Its end on the example (S₁).
    pub on_example: Place,
    /// Its end on the input (S₂).
    pub on_input: Place,
}

/// An edit of a map's constraints, applied as a whole or not at all; removals first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ConstraintEdit {
    /// Constraints to move or add.
    pub set: Vec<NewConstraint>,
    /// Ids of constraints to remove.
    pub remove: Vec<String>,
    /// Ids of constraints to put back as the registration had them; those that were added go.
    pub undo: Vec<String>,
    /// The answer to an edit that would fold the map.
    pub on_fold: OnFold,
}

/// The answer to an edit that would fold the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnFold {
    /// It is refused.
    #[default]
    Refuse,
    /// Constraints that the edit does not name make room.
    Resolve,
}
