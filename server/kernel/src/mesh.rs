//! Meshes: what a file holds ([`PolyMesh`]) and what the solvers need ([`TriMesh`]).
//!
//! [`read`] turns bytes of any [`Format`] into a [`PolyMesh`] within [`Limits`]; [`prepare`] turns that into an oriented
//! manifold [`TriMesh`] and reports each [`Repair`]; [`validate`] checks one independently; [`write`] turns a
//! [`PolyMesh`] into bytes again.

pub mod bvh;
pub(crate) mod disjoint;
pub mod error;
pub(crate) mod facing;
mod format;
pub mod geodesic;
mod gltf;
mod limits;
mod obj;
mod off;
mod ply;
pub mod poly;
mod prepare;
mod read;
mod repair;
pub mod split;
mod stl;
mod text;
pub mod tri;
mod validate;
mod weld;
mod write;

pub use error::{FileLocation, MeshError, MeshErrorKind};
pub use format::Format;
pub use limits::Limits;
pub use poly::{Attributes, CornerLayer, Crease, FaceLabels, PolyMesh, Polygons};
pub use prepare::{Prepared, prepare, prepare_scan};
pub use read::read;
pub use repair::{Repair, RepairKind};
pub use tri::{NONE, TriMesh};
pub use validate::{Violation, validate};
pub use write::write;

use std::borrow::Borrow;

/// A point or vector of 3-space.
pub type Vec3 = nalgebra::Vector3<f64>;

/// The lowest and highest coordinates of some points; `None` without points.
pub fn bounding_box<P: Borrow<Vec3>>(points: impl IntoIterator<Item = P>) -> Option<[Vec3; 2]> {
    let widen = |[low, high]: [Vec3; 2], p: [Vec3; 2]| [low.inf(&p[0]), high.sup(&p[1])];
    points.into_iter().map(|p| [*p.borrow(); 2]).reduce(widen)
}

/// The diagonal of the bounding box of some points; 0 without points.
pub fn diagonal<P: Borrow<Vec3>>(points: impl IntoIterator<Item = P>) -> f64 {
    bounding_box(points).map_or(0.0, |[low, high]| (high - low).norm())
}
