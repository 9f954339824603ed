//! The built-in samples as files ([`samples`]), and a tour of them with pictures ([`tour`]).

pub mod samples;
pub mod tour;

pub use quadmuse_samples::{Sample, corpus, inputs};
