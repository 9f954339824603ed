//! The long-running corpus search service of Quadmuse, as a library for its binary and its tests.
//!
//! `http → work → {kernel, store}`: [`work`] never names HTTP, [`http`] never names the kernel or the store.

pub mod pool;
pub mod work;
