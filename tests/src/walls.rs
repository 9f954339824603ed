//! The walls: what may import what, and the habits that hold everywhere, checked by reading manifests and sources.
//!
//! Each check is a pure function from a path and a text to complaints, so that it can be fed a broken sample; a
//! complaint is a sentence that names the file, the wall and the way out.

pub mod guides;
pub mod habits;
pub mod manifest;
pub mod modules;
pub mod source;
pub mod tree;
