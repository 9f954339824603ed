//! The queries that the server holds: those under way, and those that ended and may still be asked for.

use super::WorkError;
use super::query::LiveQuery;
use crate::pool::User;
use quadmuse_proto::QueryId;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most queries under way at once.
pub const UNDER_WAY_MAX: usize = 512;

/// Most queries held; when one more comes, one that has ended makes room.
pub const HELD_MAX: usize = 1024;

/// The queries held.
#[derive(Default)]
pub struct Queries(Mutex<Held>);

#[derive(Default)]
struct Held {
    queries: BTreeMap<QueryId, Slot>,
    /// Counts the times that any query was asked for.
    clock: u64,
}

struct Slot {
    query: Arc<LiveQuery>,
    /// The clock when it was last asked for.
    used: u64,
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
        if held.queries.len() >= HELD_MAX {
            held.let_one_go();
        }
        let used = held.tick();
        held.queries.insert(query.id, Slot { query, used });
        Ok(())
    }

    /// A query.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`].
    pub fn get(&self, id: QueryId) -> Result<Arc<LiveQuery>, WorkError> {
        let mut held = self.lock();
        let now = held.tick();
        let slot = held.queries.get_mut(&id).ok_or(WorkError::NoSuchQuery(id))?;
        slot.used = now;
        Ok(Arc::clone(&slot.query))
    }

    /// Whose a query is, if it is held. Does not count as asking for it.
    pub fn owner(&self, id: QueryId) -> Option<User> {
        self.lock().queries.get(&id).map(|slot| slot.query.caller.user)
    }

    /// Takes a query out.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`].
    pub fn remove(&self, id: QueryId) -> Result<Arc<LiveQuery>, WorkError> {
        self.lock().queries.remove(&id).map(|slot| slot.query).ok_or(WorkError::NoSuchQuery(id))
    }

    /// Of the queries that have ended and that no request is at work on, lets the one go that was not asked for the
    /// longest, for its memory; `false` if there is none.
    pub fn make_room(&self) -> bool {
        self.lock().let_one_go()
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

    fn let_one_go(&mut self) -> bool {
        let is_at_rest = |slot: &Slot| slot.query.is_final() && Arc::strong_count(&slot.query) == 1;
        let at_rest = self.queries.iter().filter(|(_, slot)| is_at_rest(slot));
        let oldest = at_rest.min_by_key(|(_, slot)| slot.used).map(|(id, _)| *id);
        oldest.is_some_and(|id| self.queries.remove(&id).is_some())
    }
}
