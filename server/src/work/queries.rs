//! The queries that the server holds: those under way, and those that ended and may still be asked for.

use super::WorkError;
use super::query::LiveQuery;
use crate::pool::User;
use quadmuse_proto::QueryId;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Most queries under way at once.
pub const UNDER_WAY_MAX: usize = 512;

/// Most queries held; when one more comes, one that has ended makes room.
pub const HELD_MAX: usize = 1024;

/// For so long after its end a query is not let go unread: its reader's next poll finds it.
const UNREAD_TIME: Duration = Duration::from_secs(30);

/// Most queries let go that are remembered as such.
const EXPIRED_MAX: usize = 16_384;

/// The queries held.
#[derive(Default)]
pub struct Queries(Mutex<Held>);

#[derive(Default)]
struct Held {
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
    /// Whether it was asked for after its end.
    is_read: bool,
}

impl Queries {
    /// None yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
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
        held.queries.insert(query.id, Slot { query, used, is_read: false });
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
        slot.used = now;
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

impl Held {
    fn tick(&mut self) -> u64 {
        self.clock += 1;
        self.clock
    }

    /// Why there is no such query.
    fn none(&self, id: QueryId) -> WorkError {
        if self.expired.contains_key(&id) { WorkError::QueryExpired(id) } else { WorkError::NoSuchQuery(id) }
    }

    fn let_one_go(&mut self, may_go: impl Fn(&LiveQuery) -> bool) -> bool {
        let is_at_rest = |slot: &Slot| {
            let is_due = slot.is_read || slot.query.ended_since().is_some_and(|time| time >= UNREAD_TIME);
            is_due && slot.query.is_final() && Arc::strong_count(&slot.query) == 1 && may_go(&slot.query)
        };
        let at_rest = self.queries.iter().filter(|(_, slot)| is_at_rest(slot));
        let oldest = at_rest.min_by_key(|(_, slot)| (!slot.is_read, slot.used)).map(|(id, _)| *id);
        let Some((id, gone)) = oldest.and_then(|id| Some((id, self.queries.remove(&id)?))) else { return false };
        self.expired.insert(id, gone.query.caller.user);
        self.expired_order.push_back(id);
        if self.expired_order.len() > EXPIRED_MAX
            && let Some(forgotten) = self.expired_order.pop_front()
        {
            self.expired.remove(&forgotten);
        }
        true
    }
}
