//! The queries that the server holds: those under way, and those that ended and may still be asked for.

use super::WorkError;
use super::query::LiveQuery;
use quadmuse_proto::QueryId;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most queries under way at once.
pub const UNDER_WAY_MAX: usize = 512;

/// Most queries held; when one more comes, the oldest that has ended makes room.
pub const HELD_MAX: usize = 1024;

/// The queries held.
#[derive(Default)]
pub struct Queries(Mutex<BTreeMap<QueryId, Arc<LiveQuery>>>);

impl Queries {
    /// None yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<QueryId, Arc<LiveQuery>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a query in.
    ///
    /// # Errors
    /// [`WorkError::QueriesFull`].
    pub fn insert(&self, query: Arc<LiveQuery>) -> Result<(), WorkError> {
        let mut held = self.lock();
        if held.values().filter(|query| !query.is_final()).count() >= UNDER_WAY_MAX {
            return Err(WorkError::QueriesFull { limit: UNDER_WAY_MAX });
        }
        if held.len() >= HELD_MAX {
            remove_oldest_ended(&mut held);
        }
        held.insert(query.id, query);
        Ok(())
    }

    /// A query.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`].
    pub fn get(&self, id: QueryId) -> Result<Arc<LiveQuery>, WorkError> {
        self.lock().get(&id).cloned().ok_or(WorkError::NoSuchQuery(id))
    }

    /// Takes a query out.
    ///
    /// # Errors
    /// [`WorkError::NoSuchQuery`].
    pub fn remove(&self, id: QueryId) -> Result<Arc<LiveQuery>, WorkError> {
        self.lock().remove(&id).ok_or(WorkError::NoSuchQuery(id))
    }

    /// Lets the oldest query go that has ended, for its memory; `false` if there is none.
    pub fn make_room(&self) -> bool {
        remove_oldest_ended(&mut self.lock())
    }

    /// Number of queries held.
    pub fn len(&self) -> usize {
        self.lock().len()
    }

    /// Whether none is held.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All queries held.
    pub fn all(&self) -> Vec<Arc<LiveQuery>> {
        self.lock().values().cloned().collect()
    }
}

fn remove_oldest_ended(held: &mut BTreeMap<QueryId, Arc<LiveQuery>>) -> bool {
    let oldest = held.iter().find(|(_, query)| query.is_final()).map(|(id, _)| *id);
    oldest.is_some_and(|id| held.remove(&id).is_some())
}
