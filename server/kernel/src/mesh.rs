//! Meshes: what a file holds ([`PolyMesh`]) and what the solvers need ([`TriMesh`]).

pub mod poly;
pub mod tri;

pub use poly::{Attributes, CornerLayer, Crease, FaceLabels, PolyMesh, Polygons};
pub use tri::{NONE, TriMesh};

/// A point or vector of 3-space.
pub type Vec3 = nalgebra::Vector3<f64>;
