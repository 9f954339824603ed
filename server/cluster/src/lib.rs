//! A corpus that several servers share, on an engine that replicates it: NATS JetStream.
//!
//! ```text
//! entries      one a example, under its identity: record, where its encodings are, rows; written on the condition of a position
//! documents    small values that servers share, such as the list of tokens; beside the entries
//! objects      meshes, labels and packed encodings, under the hash of their bytes; never changed
//! uploads      bytes that are kept for a while, under names: the uploads of queries
//! jobs         what is to be done by any one of the servers, until it is said to be done
//! ```
//!
//! A server holds every entry in memory, follows the entries of others from a position, and fetches objects when it needs
//! them; it caches them on its disk. What it answers as written is replicated and acknowledged by the engine. Consensus,
//! replication, election and membership are the engine's. What it acknowledged and lost all the same, a server that knows
//! of it writes again.
//!
//! Every call blocks; call from a thread that may wait.

mod cache;
mod corpus;
mod documents;
mod engine;
mod follow;
mod heal;
mod inner;
mod jetstream;
mod jobs;
mod manifest;
mod options;
mod state;
mod write;

pub use corpus::{RowMaker, SharedCorpus, SharedOptions, UNSURE_MAX};
pub use documents::SharedDocuments;
pub use engine::{
    Deliveries, Delivery, Engine, EngineError, Entry, JOBS_KEPT_FOR, Job, UPLOADS_BYTES_MAX, UPLOADS_KEPT_FOR, Written,
};
pub use jetstream::JetStream;
pub use options::{Access, ClusterOptions, LEASE};
pub use state::RowKeeper;
