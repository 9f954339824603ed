//! The long-running corpus search service of Quadmuse, as a library for its binary and its tests.
//!
//! `http → work → {kernel, store}`: [`work`] never names HTTP, [`http`] never names the kernel or the store.

/// glibc's keeps what was freed; this one gives it back within seconds, and counts by thread.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

pub mod app;
pub mod audit;
pub mod auth;
pub mod bench_corpus;
pub mod commands;
pub mod config;
pub mod connections;
pub mod demo;
pub mod http;
pub mod peers;
pub mod pool;
pub mod rate;
pub mod service;
pub mod shutdown;
pub mod telemetry;
pub mod work;
