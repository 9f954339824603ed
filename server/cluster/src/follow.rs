//! The thread that follows the engine's entries, so that this server knows what others wrote.
//!
//! Deliveries are numbered: those that come too early wait for those before them, and one that stays away begins the
//! following anew after the last entry that came in order. After an election it begins a little before: an engine that
//! lost its end writes other entries there.
//!
//! JetStream 2.9 was seen to pass over an entry and number the next as if there had been none. So keys are counted whenever
//! nothing more comes. Where fewer are known than there are, the stream's leader is asked for the entries of the others:
//! what is delivered comes from any copy, and one copy passed over the same entry for 40 seconds. Where many are missing, all
//! entries are followed again.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use crate::engine::{Deliveries, Delivery, Engine, EngineError};
use crate::inner::Inner;

/// Longest wait for a delivery before the engine is asked whether there should be one.
const QUIET: Duration = Duration::from_millis(500);
/// Pause before a following that failed is begun anew: the first, and the longest.
const PAUSES: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(2));
/// Longest pause before all entries are followed again because keys are missing: 100,000 take some two seconds.
const MISSING_PAUSE_MAX: Duration = Duration::from_secs(60);

/// Positions that are delivered again after an election.
pub(crate) const AGAIN: u64 = 1024;
/// Most missing entries that the leader is asked for, one by one.
const READ_MAX: usize = 1024;
/// Deliveries that wait for one before them, at most.
const EARLY_MAX: usize = 256;

/// Where a following stands.
pub(crate) struct Progress {
    /// Everything up to this position is in.
    pub(crate) position: u64,
    /// The newest position that the engine told of.
    pub(crate) newest: u64,
    /// When everything there was is known to have been in.
    pub(crate) sure: Option<Instant>,
    /// The end of the entries at some moment, until all up to there is in: while others write all the time, the very
    /// newest never is.
    pub(crate) end: Option<(u64, Instant)>,
}

/// Follows until `stopping`; blocks.
pub(crate) fn run(inner: &Inner, engine: &Arc<dyn Engine>, stopping: &AtomicBool) {
    let (mut pause, mut pause_max) = PAUSES;
    while !stopping.load(Ordering::Relaxed) {
        let (before, since) = (inner.progress().position, Instant::now());
        let after = before.saturating_sub(inner.steps_back());
        let begun = engine.follow(after);
        let ended = begun.and_then(|mut deliveries| follow(inner, &**engine, &mut *deliveries, stopping));
        let is_missing = matches!(ended, Ok(Ended::Missing));
        match ended {
            Ok(Ended::Gap) => tracing::debug!(after, "a delivery is missing; following anew"),
            Ok(Ended::Missing) => {
                tracing::warn!("entries of the engine did not come; all are followed again");
                pause_max = MISSING_PAUSE_MAX;
            }
            Ok(Ended::Stopped) => return,
            Err(error) => tracing::warn!(%error, "the engine's entries can't be followed; trying again"),
        }
        if inner.progress().position > before || since.elapsed() > pause_max {
            (pause, pause_max) = PAUSES;
        } else {
            pause = (2 * pause).min(pause_max);
        }
        let until = Instant::now() + pause;
        // The healer may ask for it meanwhile.
        while Instant::now() < until && !inner.is_asked_to_follow_anew() && !stopping.load(Ordering::Relaxed) {
            std::thread::sleep(pause.min(PAUSES.0));
        }
        if is_missing {
            inner.follow_anew(u64::MAX);
        }
    }
}

/// Why a following ended.
enum Ended {
    Gap,
    /// All came that was announced, and there are more keys than are known.
    Missing,
    Stopped,
}

fn follow(
    inner: &Inner,
    engine: &dyn Engine,
    deliveries: &mut dyn Deliveries,
    stopping: &AtomicBool,
) -> Result<Ended, EngineError> {
    let mut number = 0;
    let mut early: BTreeMap<u64, Delivery> = BTreeMap::new();
    let mut late = false;
    // The newest position at which all keys were known.
    let mut complete = None;
    loop {
        if stopping.load(Ordering::Relaxed) {
            return Ok(Ended::Stopped);
        }
        if inner.is_asked_to_follow_anew() {
            return Ok(Ended::Gap);
        }
        match deliveries.next(QUIET)? {
            // Said before.
            Some(delivery) if delivery.number <= number => {}
            Some(delivery) => {
                early.insert(delivery.number, delivery);
                while let Some(delivery) = early.remove(&(number + 1)) {
                    number = delivery.number;
                    late = false;
                    inner.take_in(&[(delivery.key.as_str(), &delivery.entry)]);
                    inner.came(delivery.entry.position, delivery.left);
                }
                if early.len() > EARLY_MAX {
                    return Ok(Ended::Gap);
                }
            }
            None if !early.is_empty() => return Ok(Ended::Gap),
            None => {
                let newest = engine.newest()?;
                let has_all = inner.has_come_to(newest);
                // At first it may be on its way.
                let is_complete = || match late {
                    true => inner.read_missing(engine),
                    false => inner.knows_all_keys(engine),
                };
                if has_all && complete != Some(newest) && is_complete()? {
                    complete = Some(newest);
                }
                if has_all && complete == Some(newest) {
                    inner.note_sure();
                    late = false;
                } else if late {
                    return Ok(if has_all { Ended::Missing } else { Ended::Gap });
                } else {
                    late = true;
                }
            }
        }
    }
}

impl Inner {
    /// Reads the entries of keys that are not known from the stream's leader, unless they are too many; whether all keys
    /// are known then.
    ///
    /// # Errors
    /// [`EngineError`].
    pub(crate) fn read_missing(&self, engine: &dyn Engine) -> Result<bool, EngineError> {
        if self.knows_all_keys(engine)? {
            return Ok(true);
        }
        let mut names = engine.key_names()?;
        let state = self.state();
        names.retain(|key| !state.knows(key));
        drop(state);
        if names.len() > READ_MAX {
            return Ok(false);
        }
        for key in &names {
            if let Some(entry) = engine.read(key)? {
                tracing::warn!(key, position = entry.position, "an entry did not come; the engine's leader gave it");
                self.take_in(&[(key.as_str(), &entry)]);
            }
        }
        self.knows_all_keys(engine)
    }

    /// Tells whether as many keys are known as there are.
    fn knows_all_keys(&self, engine: &dyn Engine) -> Result<bool, EngineError> {
        Ok(self.state().keys() >= engine.keys()?)
    }

    /// Notes that everything up to `position` came, and that `left` are to come.
    fn came(&self, position: u64, left: u64) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        progress.position = progress.position.max(position);
        progress.newest = progress.newest.max(position + left);
        if let Some((_, seen)) = progress.end.take_if(|(end, _)| *end <= position) {
            progress.sure = Some(seen);
        }
        if left == 0 {
            progress.sure = Some(now);
        } else {
            progress.end = progress.end.or(Some((position + left, now)));
        }
        drop(progress);
        self.moved.notify_all();
    }

    /// Tells whether all came up to the engine's newest entry, which stands at `newest`.
    fn has_come_to(&self, newest: u64) -> bool {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        if newest < progress.position {
            // A leader that was just elected may not know all yet; it will.
            tracing::warn!(newest, known = progress.position, "the engine is behind what it delivered");
            return false;
        }
        progress.newest = newest;
        newest == progress.position
    }

    /// Notes that everything there is is in.
    fn note_sure(&self) {
        self.progress().sure = Some(Instant::now());
        self.moved.notify_all();
    }
}
