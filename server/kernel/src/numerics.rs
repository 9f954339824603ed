//! Linear algebra that the geometry leans on: sparse symmetric systems factored once and solved often, and small
//! dense ones.

pub mod dense;
pub mod sparse;

pub use sparse::{Factored, Pattern, SolveError};
pub mod wide;
