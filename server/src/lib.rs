//! The long-running corpus search service of Quadmuse, as a library for its binary, its tests and its examples.

pub mod demo;
pub mod work;
