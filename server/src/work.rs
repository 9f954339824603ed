//! What the server does, free of HTTP.
//!
//! Each verb of the service is a module here: [`ingest`] adds examples, [`search`] ranks a query, [`mapping`] lays an
//! example on it, [`composing`] stitches maps, [`retopo`] does both for all of a scan, [`reencode`] rebuilds derived state. They join the kernel (behind
//! [`engine::Engine`]) and the store (behind [`corpus::Corpus`]) on the pool.

pub mod catalogue;
pub mod composing;
pub mod corpus;
mod doubts;
pub mod engine;
pub mod error;
pub mod example_cache;
pub mod follow;
pub mod ingest;
pub mod jobs;
pub mod kept;
pub mod landmarks;
pub mod laying;
pub mod making;
pub mod mapping;
pub mod naming;
pub mod picture;
pub mod pictures;
pub mod queries;
pub mod query;
pub mod ranking;
pub mod reencode;
pub mod resized;
pub mod retopo;
pub mod scrub;
pub mod search;
pub mod shares;
pub mod texts;
pub mod uploads;
pub mod worth;

pub use error::WorkError;

use crate::pool::{Admitted, Job, Pool, PoolError, User};
use catalogue::Catalogue;
use corpus::Corpus;
use engine::Engine;
use quadmuse_proto::Share;
use quadmuse_proto::id::ServerNumber;
use queries::Queries;
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio_util::task::TaskTracker;

/// Longest computation for one request (reading and encoding an upload, a map, a composition).
pub(crate) const REQUEST_TIME_MAX: Duration = Duration::from_secs(120);

/// So many rows made at a start are written down at once, not only at the end.
const ROWS_WORTH_WRITING: usize = 1000;

/// The handles that all verbs share.
pub struct Work {
    /// Where computations run.
    pub pool: Pool,
    /// The geometry.
    pub engine: Arc<dyn Engine>,
    /// The corpus on disk.
    pub corpus: Arc<dyn Corpus>,
    /// What of the corpus is resident.
    pub catalogue: Catalogue,
    /// The queries under way, and after.
    pub queries: Queries,
    /// What the servers that share the corpus do together; unset on one that is alone.
    pub queue: OnceLock<Arc<dyn jobs::Queue>>,
    /// The shares of the corpus that other servers hold in memory.
    pub shares: shares::Shares,
    /// This server, if several share the corpus: what it makes has ids that tell it.
    pub server: Option<ServerNumber>,
    /// Examples that were read.
    pub examples: example_cache::ExampleCache,
    /// Thumbnails that were drawn.
    pub thumbnails: pictures::Thumbnails,
    /// Work that goes on when its request is gone.
    pub background: TaskTracker,
}

/// Who asks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Caller {
    /// Whose turn it is counted as, and whose what it makes is.
    pub user: User,
    /// Of whose queries it may know.
    pub scope: Scope,
}

/// Of whose queries a caller may know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scope {
    /// Its own.
    #[default]
    Own,
    /// Everybody's: an admin, and everybody on an open service.
    All,
}

impl Caller {
    /// Whether it may know of what `owner` made.
    pub fn sees(&self, owner: User) -> bool {
        self.scope == Scope::All || self.user == owner
    }
}

impl Work {
    /// Joins the parts; the catalogue is still empty (see [`Work::load`]).
    pub fn new(pool: Pool, engine: Arc<dyn Engine>, corpus: Arc<dyn Corpus>) -> Arc<Self> {
        Self::on(None, pool, engine, corpus)
    }

    /// The same on one of several servers.
    pub fn on(server: Option<ServerNumber>, pool: Pool, engine: Arc<dyn Engine>, corpus: Arc<dyn Corpus>) -> Arc<Self> {
        Self::holding(None, server, pool, engine, corpus)
    }

    /// The same with one share of the corpus's pictures in memory.
    pub fn holding(
        share: Option<Share>,
        server: Option<ServerNumber>,
        pool: Pool,
        engine: Arc<dyn Engine>,
        corpus: Arc<dyn Corpus>,
    ) -> Arc<Self> {
        let catalogue = Catalogue::new(Arc::clone(&corpus), Arc::clone(&engine)).holding(share);
        let queries = Queries::new();
        let examples = example_cache::ExampleCache::within(pool.admission().limit_bytes());
        Arc::new(Self {
            pool,
            engine,
            corpus,
            catalogue,
            queries,
            queue: OnceLock::new(),
            shares: shares::Shares::default(),
            server,
            examples,
            thumbnails: pictures::Thumbnails::default(),
            background: TaskTracker::new(),
        })
    }

    /// Brings the coarse level of the whole corpus into memory, and writes down what wasn't. Blocks.
    pub fn load(&self) {
        if self.catalogue.load() >= ROWS_WORTH_WRITING {
            self.keep_rows();
        }
    }

    /// Writes down what a start would otherwise have to make anew. Blocks.
    pub fn keep_rows(&self) {
        if let Err(error) = self.catalogue.keep() {
            tracing::warn!(%error, "rows not written: the next start takes longer");
        }
    }

    /// Admits a job of `user` with an estimated need of memory, to end within `time`. Queries that have ended make room
    /// for it, those first that were not asked for the longest.
    ///
    /// # Errors
    /// [`PoolError::Overloaded`], [`PoolError::MemoryFull`] and [`PoolError::TooLarge`].
    pub fn admit(&self, user: User, memory_bytes: u64, time: Duration) -> Result<Job, PoolError> {
        self.making_room(user, || self.pool.admit(user, memory_bytes, Some(time)))
    }

    /// Takes memory for what is no job, as [`Work::admit`] does.
    ///
    /// # Errors
    /// As [`Work::admit`].
    pub fn hold(&self, user: User, memory_bytes: u64) -> Result<Admitted, PoolError> {
        self.making_room(user, || self.pool.admission().hold(user, memory_bytes))
    }

    /// Takes more memory beside what is held, as [`Work::admit`] does.
    ///
    /// # Errors
    /// As [`Work::admit`].
    pub fn grow(&self, held: &Admitted, more_bytes: u64) -> Result<(), PoolError> {
        self.making_room(held.user(), || held.grow(more_bytes))
    }

    /// Whether `user` would be refused whatever it asked for.
    ///
    /// # Errors
    /// As [`Work::admit`].
    pub fn look(&self, user: User) -> Result<(), PoolError> {
        self.making_room(user, || self.pool.admission().look(user))
    }

    fn making_room<T>(&self, user: User, admit: impl Fn() -> Result<T, PoolError>) -> Result<T, PoolError> {
        loop {
            match admit() {
                // Who is over the share makes room for itself, and for nobody else.
                Err(PoolError::OverShare { .. }) if self.queries.make_room_of(user) => {}
                Err(PoolError::MemoryFull { .. }) if self.queries.make_room() => {}
                admitted => return admitted,
            }
        }
    }

    /// Runs blocking work of the store off the tokio workers. It goes on when the caller is gone.
    ///
    /// # Errors
    /// Those of `work`, and [`WorkError::Lost`] when it panicked.
    pub async fn blocking<T, F>(self: &Arc<Self>, work: F) -> Result<T, WorkError>
    where
        T: Send + 'static,
        F: FnOnce(&Self) -> Result<T, WorkError> + Send + 'static,
    {
        let this = Arc::clone(self);
        let task = self.background.spawn_blocking(move || work(&this));
        task.await.map_err(|_| WorkError::Lost)?
    }
}
