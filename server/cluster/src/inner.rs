//! What the callers and the follower of a shared corpus have in common.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::{Duration, Instant};

use quadmuse_store::{Following, Listener};

use crate::engine::Entry;
use crate::follow::Progress;
use crate::heal::Recent;
use crate::state::{RowKeeper, State};

pub(crate) struct Inner {
    state: RwLock<State>,
    pub(crate) progress: Mutex<Progress>,
    pub(crate) moved: Condvar,
    pub(crate) recent: Recent,
    /// By how many positions before where they are the entries are to be followed anew; 0: they are not.
    anew: AtomicU64,
    listeners: Mutex<Vec<Listener>>,
    /// When it was opened.
    begun: Instant,
}

impl Inner {
    pub(crate) fn new(row_keeper: Option<RowKeeper>) -> Self {
        Self {
            state: RwLock::new(State::keeping(row_keeper)),
            progress: Mutex::new(Progress { position: 0, newest: 0, sure: None, end: None }),
            moved: Condvar::new(),
            recent: Recent::default(),
            anew: AtomicU64::new(0),
            listeners: Mutex::default(),
            begun: Instant::now(),
        }
    }

    pub(crate) fn state(&self) -> RwLockReadGuard<'_, State> {
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn state_mut(&self) -> RwLockWriteGuard<'_, State> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes an entry in that this server wrote, and that the engine acknowledged.
    pub(crate) fn wrote(&self, key: &str, entry: &Entry) {
        self.recent.wrote(key, entry);
        self.change(|state| {
            state.apply(key, entry);
        });
    }

    /// Takes entries in that the engine delivered, and tells who listens.
    pub(crate) fn take_in(&self, entries: &[(&str, &Entry)]) {
        self.change(|state| {
            for (key, entry) in entries {
                if state.apply(key, entry) {
                    self.recent.came(key, entry);
                }
            }
        });
    }

    /// Changes the state, and tells who listens if something changed.
    pub(crate) fn change(&self, change: impl FnOnce(&mut State)) {
        let (before, after) = {
            let mut state = self.state_mut();
            let before = state.log().newest();
            change(&mut state);
            (before, state.log().newest())
        };
        if after != before {
            let listeners = self.listeners.lock().unwrap_or_else(PoisonError::into_inner);
            listeners.iter().for_each(|tell| tell(after));
        }
    }

    pub(crate) fn subscribe(&self, listener: Listener) {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner).push(listener);
    }

    /// Has the entries followed anew, from so many positions before where they are.
    pub(crate) fn follow_anew(&self, before: u64) {
        self.anew.fetch_max(before, Ordering::Relaxed);
    }

    /// Whether they are to be.
    pub(crate) fn is_asked_to_follow_anew(&self) -> bool {
        self.anew.load(Ordering::Relaxed) > 0
    }

    /// From how many positions before, and takes it as done.
    pub(crate) fn steps_back(&self) -> u64 {
        self.anew.swap(0, Ordering::Relaxed)
    }

    /// Waits until everything up to `position` is in, at most for `timeout`; whether it is.
    pub(crate) fn wait_for(&self, position: u64, timeout: Duration) -> bool {
        let until = Instant::now() + timeout;
        let mut progress = self.progress();
        while progress.position < position {
            let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) else {
                return false;
            };
            progress = self.moved.wait_timeout(progress, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    pub(crate) fn following(&self) -> Following {
        let progress = self.progress();
        let unsure = progress.sure.unwrap_or(self.begun).elapsed().as_millis();
        let behind = progress.newest.saturating_sub(progress.position);
        Following { behind, unsure_ms: u64::try_from(unsure).unwrap_or(u64::MAX) }
    }
}
