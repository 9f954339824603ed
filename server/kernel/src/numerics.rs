//! Linear algebra that the geometry leans on: sparse symmetric systems factored once and solved often, and small
//! dense ones.

pub mod dense;
pub mod pair;
pub mod sparse;
pub mod stop;
pub mod wide;

pub use pair::{in_halves, side_by_side};
pub use sparse::{Factored, Pattern, SolveError};
