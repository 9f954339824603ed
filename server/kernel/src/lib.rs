//! Pure geometry of *Inspired Quadrangulation*.
//!
//! The modules stand in the order in which a mesh passes through them; a module uses only those before it.
//! No I/O, no async, no clock, no randomness that is not seeded.

pub mod numerics;

pub mod mesh;

pub mod topology;

pub mod segment;

pub mod unfold;

pub mod encode;

pub mod register;

pub mod rank;

pub mod map;

pub mod compose;

pub mod measure;

pub mod settle;

pub mod fit;

pub mod pipeline;
