//! The flag that stops a job: set by hand, or by a deadline.

use super::taken;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

/// Why a job stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StopReason {
    /// The caller cancelled it or went away.
    #[error("the computation was cancelled")]
    Cancelled,
    /// It took far more memory than it was admitted with.
    #[error(
        "expected the computation to take the memory that meshes of its size do, found it taking far more; send a simpler mesh"
    )]
    Memory,
    /// Its time was over.
    #[error(
        "expected the computation to end in its time, found it still running at its deadline; allow it more, or send a smaller mesh"
    )]
    Deadline,
}

/// A stop flag; clones share it. Polled once an iteration by whoever computes.
#[derive(Clone, Debug)]
pub struct Stop(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    cancelled: AtomicBool,
    cancelled_at: OnceLock<Instant>,
    wake: CancellationToken,
    deadline: Option<Instant>,
}

impl Stop {
    /// A flag that sets itself after `time`, if one is given.
    pub fn new(time: Option<Duration>) -> Self {
        let deadline = time.and_then(|time| Instant::now().checked_add(time));
        let (cancelled, cancelled_at) = (AtomicBool::new(false), OnceLock::new());
        Self(Arc::new(Inner { cancelled, cancelled_at, wake: CancellationToken::new(), deadline }))
    }

    /// Sets the flag.
    pub fn cancel(&self) {
        self.0.cancelled_at.get_or_init(Instant::now);
        self.0.cancelled.store(true, Ordering::Relaxed);
        self.0.wake.cancel();
    }

    /// Why to stop; `None`: go on. Costs some 30 ns.
    pub fn reason(&self) -> Option<StopReason> {
        if self.0.cancelled.load(Ordering::Relaxed) {
            return Some(StopReason::Cancelled);
        }
        if taken::is_too_much() {
            return Some(StopReason::Memory);
        }
        self.0.deadline.is_some_and(|deadline| Instant::now() >= deadline).then_some(StopReason::Deadline)
    }

    /// For how long it has been cancelled; zero where it is not.
    pub fn since_cancelled(&self) -> Duration {
        self.0.cancelled_at.get().map_or(Duration::ZERO, Instant::elapsed)
    }

    /// Waits until it is time to stop.
    pub async fn stopped(&self) -> StopReason {
        match self.0.deadline {
            None => self.0.wake.cancelled().await,
            Some(deadline) => {
                let _ = tokio::time::timeout_at(deadline.into(), self.0.wake.cancelled()).await;
            }
        }
        self.reason().unwrap_or(StopReason::Deadline)
    }
}
