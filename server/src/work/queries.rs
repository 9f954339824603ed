//! The queries that the server holds: those under way, and those that ended and may still be asked for.

use super::query::LiveQuery;
use super::{Work, WorkError};
use crate::pool::User;
use quadmuse_proto::QueryId;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

/// Most queries under way at once.
pub const UNDER_WAY_MAX: usize = 512;

/// Most queries held; when one more comes, one that has ended makes room.
pub const HELD_MAX: usize = 1024;

/// For so long after its end a query is not let go unread: its reader's next poll finds it.
const UNREAD_TIME: Duration = Duration::from_secs(30);

/// The same where a stream told of the end: whoever reads it has what follows yet to ask for.
const STREAMED_TIME: Duration = Duration::from_secs(2);

/// For so long an ended query is held that nobody asks for: an idle service holds no memory. It can be started again.
const IDLE_TIME: Duration = Duration::from_secs(30 * 60);

/// The same for one with maps or compositions, which somebody may have edited: a working day.
const IDLE_TIME_WITH_RESULTS: Duration = Duration::from_secs(10 * 3600);

/// Time between two looks for idle queries.
const LOOK_EVERY: Duration = Duration::from_secs(60);

/// Most queries let go that are remembered as such.
const EXPIRED_MAX: usize = 16_384;

/// The queries held.
#[derive(Default)]
pub struct Queries(Mutex<QueryTable>);

/// The queries that are held, and the ids of those that made room.
#[derive(Default)]
struct QueryTable {
    queries: BTreeMap<QueryId, Slot>,
    /// Counts the times that any query was asked for.
    clock: u64,
    /// Those that made room, and whose they were.
    expired: HashMap<QueryId, User>,
    expired_order: VecDeque<QueryId>,
}

struct Slot {
    query: Arc<LiveQuery>,
    /// The clock when it was last asked for.
    used: u64,
    /// When that was.
    asked: Instant,
    /// Whether it was asked for after its end.
    is_read: bool,
}

impl Queries {
    /// None yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn lock(&self) -> MutexGuard<'_, QueryTable> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a query in.
    ///
    /// # Errors
    /// [`WorkError::QueriesFull`].
    pub fn insert(&self, query: Arc<LiveQuery>) -> Result<(), WorkError> {
        let mut held = self.lock();
        if held.queries.values().filter(|slot| !slot.query.is_final()).count() >= UNDER_WAY_MAX {
            return Err(WorkError::QueriesFull { limit: UNDER_WAY_MAX });
        }
        if held.queries.len() >= HELD_MAX && !held.let_one_go(|_| true) {
            return Err(WorkError::QueriesFull { limit: HELD_MAX });
        }
        let used = held.tick();
        held.queries.insert(query.id, Slot { query, used, asked: Instant::now(), is_read: false });
        Ok(())
    }

    /// A query.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`], [`WorkError::QueryExpired`].
    pub fn get(&self, id: QueryId) -> Result<Arc<LiveQuery>, WorkError> {
        let mut held = self.lock();
        let now = held.tick();
        let Some(slot) = held.queries.get_mut(&id) else { return Err(held.none(id)) };
        (slot.used, slot.asked) = (now, Instant::now());
        slot.is_read |= slot.query.is_final();
        Ok(Arc::clone(&slot.query))
    }

    /// Whose a query is or was, if it is held or made room. Does not count as asking for it.
    pub fn owner(&self, id: QueryId) -> Option<User> {
        let held = self.lock();
        held.queries.get(&id).map(|slot| slot.query.caller.user).or_else(|| held.expired.get(&id).copied())
    }

    /// Takes a query out.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`], [`WorkError::QueryExpired`].
    pub fn remove(&self, id: QueryId) -> Result<Arc<LiveQuery>, WorkError> {
        let mut held = self.lock();
        let gone = held.queries.remove(&id);
        gone.map(|slot| slot.query).ok_or_else(|| held.none(id))
    }

    /// Of the queries that have ended and that no request is at work on, lets one go for its memory: of those that were
    /// read after their end the one that was not asked for the longest, else one that nobody came for; `false` if there is
    /// none.
    pub fn make_room(&self) -> bool {
        self.lock().let_one_go(|_| true)
    }

    /// The same among the queries of `user`.
    pub fn make_room_of(&self, user: User) -> bool {
        self.lock().let_one_go(|query| query.caller.user == user)
    }

    /// Lets those go that have ended and that nobody asked for during `idle`, or, where there are maps or compositions of
    /// them, during `with_results`; how many.
    pub fn let_idle_go(&self, idle: Duration, with_results: Duration) -> usize {
        let mut held = self.lock();
        let is_idle = |slot: &&Slot| {
            let has_results = !slot.query.maps().is_empty() || !slot.query.compositions().is_empty();
            slot.asked.elapsed() >= if has_results { with_results } else { idle }
        };
        let at_rest = held.queries.values().filter(|slot| slot.is_at_rest());
        let idle: Vec<QueryId> = at_rest.filter(is_idle).map(|slot| slot.query.id).collect();
        let gone: Vec<Slot> = idle.into_iter().filter_map(|id| held.let_go(id)).collect();
        // Freeing hundreds of them takes a while; others ask meanwhile.
        drop(held);
        gone.len()
    }

    /// Number of queries held.
    pub fn len(&self) -> usize {
        self.lock().queries.len()
    }

    /// Whether none is held.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All queries held.
    pub fn all(&self) -> Vec<Arc<LiveQuery>> {
        self.lock().queries.values().map(|slot| Arc::clone(&slot.query)).collect()
    }
}

impl QueryTable {
    fn tick(&mut self) -> u64 {
        self.clock += 1;
        self.clock
    }

    /// Why there is no such query.
    fn none(&self, id: QueryId) -> WorkError {
        if self.expired.contains_key(&id) { WorkError::QueryExpired(id) } else { WorkError::NoSuchQuery(id) }
    }

    fn let_one_go(&mut self, may_go: impl Fn(&LiveQuery) -> bool) -> bool {
        let is_due = |slot: &Slot| {
            let unread_time = if slot.query.end_was_streamed() { STREAMED_TIME } else { UNREAD_TIME };
            let was_left = || slot.query.ended_since().is_some_and(|time| time >= unread_time);
            slot.is_at_rest() && (slot.is_read || was_left()) && may_go(&slot.query)
        };
        let due = self.queries.values().filter(|slot| is_due(slot));
        let oldest = due.min_by_key(|slot| (!slot.is_read, slot.used)).map(|slot| slot.query.id);
        if let Some(id) = oldest {
            self.let_go(id);
        }
        oldest.is_some()
    }

    /// Lets a query go, and remembers that it was there.
    fn let_go(&mut self, id: QueryId) -> Option<Slot> {
        let gone = self.queries.remove(&id)?;
        self.expired.insert(id, gone.query.caller.user);
        self.expired_order.push_back(id);
        if self.expired_order.len() > EXPIRED_MAX
            && let Some(forgotten) = self.expired_order.pop_front()
        {
            self.expired.remove(&forgotten);
        }
        Some(gone)
    }
}

impl Slot {
    /// The query has ended, and no request and nothing that is made of it is at work on it.
    fn is_at_rest(&self) -> bool {
        self.query.is_final() && Arc::strong_count(&self.query) == 1
    }
}

/// Lets idle queries go, now and then, until `stopping`.
pub async fn run(work: Arc<Work>, stopping: CancellationToken) {
    while stopping.run_until_cancelled(tokio::time::sleep(LOOK_EVERY)).await.is_some() {
        let looked = work.blocking(|work| Ok(work.queries.let_idle_go(IDLE_TIME, IDLE_TIME_WITH_RESULTS)));
        let gone = looked.await.unwrap_or_default();
        if gone > 0 {
            tracing::info!(gone, held = work.queries.len(), "idle queries let go");
        }
    }
}
