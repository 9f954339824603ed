//! What a corpus needs of the engine that its servers share, in the words of the corpus.
//!
//! [`crate::jetstream`] does it on NATS JetStream. Replication, election and membership are the engine's own.

use std::time::{Duration, SystemTime};

/// Longest time for which bytes are kept that belong to no example.
pub const UPLOADS_KEPT_FOR: Duration = Duration::from_secs(24 * 3600);

/// Longest time for which a job waits: one that nobody does is forgotten.
pub const JOBS_KEPT_FOR: Duration = Duration::from_secs(24 * 3600);

/// Most bytes that are kept so, on each node.
pub const UPLOADS_BYTES_MAX: u64 = 1 << 30;

/// Why the engine did not do it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// It could not be reached, or did not answer in time. What was to be written may be written all the same.
    #[error("expected the engine to {doing}, found that it does not ({reason})")]
    Silent {
        /// What was attempted.
        doing: &'static str,
        /// What it, or the network, said.
        reason: String,
    },
    /// It has no room left.
    #[error("expected the engine to {doing}, found it full ({reason})")]
    Full {
        /// What was attempted.
        doing: &'static str,
        /// What it said.
        reason: String,
    },
    /// It refused, and would again.
    #[error("expected the engine to {doing}, found that it refuses ({reason})")]
    Refused {
        /// What was attempted.
        doing: &'static str,
        /// What it said.
        reason: String,
    },
}

/// What came of a conditional write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    /// It is kept, replicated and acknowledged, at this position.
    At(u64),
    /// The entry is at another position than expected; nothing was written.
    Elsewhere,
}

/// The newest value of a key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Where it stands among all entries: each newer one has a greater position.
    pub position: u64,
    /// Its value.
    pub bytes: Vec<u8>,
}

impl Entry {
    /// Stands for an entry where there is none.
    pub(crate) const NONE: Self = Self { position: 0, bytes: Vec::new() };
}

/// An entry as a follower gets it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Delivery {
    /// Counts what this following delivered, from 1: where one is left out, something was lost.
    pub number: u64,
    /// The key.
    pub key: String,
    /// The value.
    pub entry: Entry,
    /// Entries that are still to come, as far as the engine knew.
    pub left: u64,
}

/// Entries as they come.
pub trait Deliveries: Send {
    /// The next one; `None` if there is none within `wait`.
    ///
    /// # Errors
    /// [`EngineError`]: the following has ended, begin another.
    fn next(&mut self, wait: Duration) -> Result<Option<Delivery>, EngineError>;
}

/// A job that was taken. Nobody else gets it for a while; then somebody does, unless it was said meanwhile that work on it
/// goes on. So a job whose taker dies is done by another, and may be done twice: its effect has to be the same then.
pub trait Job: Send {
    /// The name under which it was added.
    fn name(&self) -> &str;

    /// What is to be done.
    fn payload(&self) -> &[u8];

    /// How often it was taken, this time included.
    fn times_taken(&self) -> u64;

    /// Says that work on it goes on.
    ///
    /// # Errors
    /// [`EngineError`].
    fn goes_on(&self) -> Result<(), EngineError>;

    /// Says that it is done: nobody gets it again. A moment may pass until one of its name can be added.
    ///
    /// # Errors
    /// [`EngineError`]; it may be taken again then.
    fn done(&self) -> Result<(), EngineError>;

    /// Gives it back: somebody gets it after `pause`.
    ///
    /// # Errors
    /// [`EngineError`]; it is given to somebody else later then.
    fn give_back(&self, pause: Duration) -> Result<(), EngineError>;
}

/// The engine. Every call blocks until the engine has answered, for some seconds at most.
pub trait Engine: Send + Sync + 'static {
    /// Keeps an object under its name. The same name always means the same bytes.
    ///
    /// # Errors
    /// [`EngineError`] unless it is replicated and acknowledged.
    fn put_object(&self, name: &str, bytes: &[u8]) -> Result<(), EngineError>;

    /// An object; `None` if there is none of this name, or not all of it.
    ///
    /// # Errors
    /// [`EngineError`].
    fn object(&self, name: &str) -> Result<Option<Vec<u8>>, EngineError>;

    /// Keeps bytes under a name for a while: for [`UPLOADS_KEPT_FOR`] at most, and while all that is kept so takes at most
    /// [`UPLOADS_BYTES_MAX`] bytes, unless told otherwise. The oldest goes first, and what takes a quarter of it alone is refused.
    ///
    /// # Errors
    /// [`EngineError`] unless it is replicated and acknowledged.
    fn keep_upload(&self, name: &str, bytes: &[u8]) -> Result<(), EngineError>;

    /// What was kept so; `None` if nothing was, or if its time is over.
    ///
    /// # Errors
    /// [`EngineError`].
    fn upload(&self, name: &str) -> Result<Option<Vec<u8>>, EngineError>;

    /// Removes what was kept so, if it is there.
    ///
    /// # Errors
    /// [`EngineError`].
    fn remove_upload(&self, name: &str) -> Result<(), EngineError>;

    /// Writes the entry of `key`, unless it stands at another position than `expected` (0: there is none).
    ///
    /// # Errors
    /// [`EngineError`] unless it is replicated and acknowledged.
    fn write(&self, key: &str, expected: u64, bytes: &[u8]) -> Result<Written, EngineError>;

    /// The newest entry of `key`, as of now.
    ///
    /// # Errors
    /// [`EngineError`].
    fn read(&self, key: &str) -> Result<Option<Entry>, EngineError>;

    /// The position of the newest entry of all; 0 if there is none.
    ///
    /// # Errors
    /// [`EngineError`].
    fn newest(&self) -> Result<u64, EngineError>;

    /// How many keys have an entry.
    ///
    /// # Errors
    /// [`EngineError`].
    fn keys(&self) -> Result<u64, EngineError>;

    /// Names the keys that have an entry, as the leader has them.
    ///
    /// # Errors
    /// [`EngineError`].
    fn key_names(&self) -> Result<Vec<String>, EngineError>;

    /// Which nodes lead: another text whenever others do.
    ///
    /// # Errors
    /// [`EngineError`], also while there is no leader.
    fn leader(&self) -> Result<String, EngineError>;

    /// Follows the entries after a position: of each key its newest one at least, in order of their positions.
    ///
    /// # Errors
    /// [`EngineError`].
    fn follow(&self, after: u64) -> Result<Box<dyn Deliveries>, EngineError>;

    /// Adds a job of a kind, to be taken by one of those who do such; whether it was added: of a kind and a name one waits, or
    /// is being done, at a time.
    ///
    /// # Errors
    /// [`EngineError`] unless it is replicated and acknowledged.
    fn add_job(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, EngineError>;

    /// Takes a job of a kind; `None` if there is none within `wait`.
    ///
    /// # Errors
    /// [`EngineError`].
    fn take_job(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, EngineError>;

    /// Jobs of all kinds that wait or are being done.
    ///
    /// # Errors
    /// [`EngineError`].
    fn jobs(&self) -> Result<u64, EngineError>;

    /// The time of the engine's clock when it kept the newest entry or object: no later than now by that clock, whatever
    /// this machine's says.
    ///
    /// # Errors
    /// [`EngineError`].
    fn clock(&self) -> Result<SystemTime, EngineError>;

    /// Removes objects that were put before `before`, by the engine's clock, and that `is_used` doesn't know; how many. One that was put again
    /// since stays.
    ///
    /// # Errors
    /// [`EngineError`]; some may be removed then.
    fn collect(&self, before: SystemTime, is_used: &dyn Fn(&str) -> bool) -> Result<u64, EngineError>;
}
