//! Spoilt input against whatever reads it: each reader, the messages of the wire, backups, and composition.
//!
//! All of it is made from a seed, so that a find is a number: it is run again by its target and seed, and kept in
//! `tests/finds.rs`. No coverage guides it, and nothing but stable Rust is needed. A target that breaks a promise panics.

pub mod composition;
pub mod damage;
pub mod dice;
pub mod messages;
pub mod readers;
pub mod store;

/// Something that reads.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it promises, in a sentence.
    pub promise: &'static str,
    /// Seeds that a short run tries.
    pub short: u64,
    /// Tries a seed: whether what it made was taken rather than refused. Panics where a promise is broken.
    pub run: fn(u64) -> bool,
}

/// All targets.
pub const TARGETS: [Target; 9] = [
    Target { name: "obj", promise: readers::PROMISE, short: 2000, run: readers::obj },
    Target { name: "ply", promise: readers::PROMISE, short: 2000, run: readers::ply },
    Target { name: "off", promise: readers::PROMISE, short: 2000, run: readers::off },
    Target { name: "stl", promise: readers::PROMISE, short: 2000, run: readers::stl },
    Target { name: "glb", promise: readers::PROMISE, short: 2000, run: readers::glb },
    Target { name: "json", promise: messages::PROMISE, short: 4000, run: messages::json },
    Target { name: "messagepack", promise: messages::PROMISE, short: 4000, run: messages::messagepack },
    Target { name: "backup", promise: store::PROMISE, short: 12, run: store::backup },
    Target { name: "composition", promise: composition::PROMISE, short: 4, run: composition::composition },
];

/// The target of a name.
pub fn target(name: &str) -> Option<Target> {
    TARGETS.into_iter().find(|target| target.name == name)
}
