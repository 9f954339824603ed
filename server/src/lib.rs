//! The long-running corpus search service of Quadmuse, as a library for its binary, its tests and its examples.
//!
//! `http → work → {kernel, store}`: [`work`] never names HTTP, [`http`] never names the kernel or the store.

pub mod demo;
pub mod pool;
pub mod work;
