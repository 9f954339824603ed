//! What the server shows of the built-in samples: them as files ([`samples`]), and a tour with pictures ([`tour`]).

pub mod samples;
pub mod tour;

pub use quadmuse_samples::{Sample, corpus, inputs};
