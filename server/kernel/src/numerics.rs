//! Linear algebra that the geometry leans on: sparse symmetric systems factored once and solved often, and small
//! dense ones; how a computation is stopped, split between two threads, and which of its stages are left out.

pub mod dense;
pub mod pair;
pub mod sparse;
pub mod stage;
pub mod stop;
pub mod wide;

pub use pair::{go_first, in_halves, many_in_halves, side_by_side};
pub use sparse::{Factored, Pattern, SolveError};
