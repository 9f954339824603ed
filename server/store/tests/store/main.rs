//! The store from outside: one program, as each would be linked anew.
#![allow(clippy::unwrap_used, reason = "a test")]

mod backup;
mod basics;
mod careful;
mod conformance;
mod damage;
mod faults;
mod full;
mod golden;
mod kill;
mod real_pictures;
#[path = "../support/sample.rs"]
mod sample;
#[path = "../support/golden.rs"]
mod stored;
#[path = "../support/conformance.rs"]
mod suite;
