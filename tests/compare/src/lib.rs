//! Comparisons: the kernel against the truth, against the paper's own method, and against itself without one of its
//! means. Each binary prints a table; `tests/records/` keeps them.

pub mod ground_truth;
pub mod parts;
