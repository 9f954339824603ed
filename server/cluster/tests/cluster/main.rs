//! Servers that share a corpus: one program, as each would be linked anew.

mod access;
mod conformance;
#[path = "../support/fake.rs"]
mod fake;
#[path = "../support/history.rs"]
mod history;
mod jetstream;
#[path = "../support/leader.rs"]
mod leader;
#[path = "../support/nodes.rs"]
mod nodes;
#[path = "../support/queue.rs"]
mod queue;
#[path = "../../../store/tests/support/sample.rs"]
mod sample;
mod split;
#[path = "../../../store/tests/support/conformance.rs"]
mod suite;
