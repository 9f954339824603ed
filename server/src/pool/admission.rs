//! Who may come in: a bounded number of jobs, and their memory estimated up front.

use super::PoolError;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// What may be admitted at the same time.
pub struct Admission {
    memory: Arc<Memory>,
    places: Arc<Semaphore>,
    places_all: usize,
}

#[derive(Debug)]
struct Memory {
    used: AtomicU64,
    limit: u64,
}

/// A place among the running jobs and a share of the memory; both are given back on drop.
#[derive(Debug)]
pub struct Admitted {
    memory: Arc<Memory>,
    bytes: AtomicU64,
    place: Mutex<Option<OwnedSemaphorePermit>>,
}

impl Admission {
    /// At most `memory_bytes` bytes by estimate, and at most `jobs` jobs that compute or wait for it.
    pub fn new(memory_bytes: u64, jobs: usize) -> Self {
        let memory = Arc::new(Memory { used: AtomicU64::new(0), limit: memory_bytes });
        Self { memory, places: Arc::new(Semaphore::new(jobs)), places_all: jobs }
    }

    /// Admits a job with an estimated need of memory.
    ///
    /// # Errors
    /// [`PoolError::TooLarge`] when it could never be admitted; [`PoolError::Overloaded`] and [`PoolError::MemoryFull`]
    /// when it can't be now.
    pub fn admit(&self, bytes: u64) -> Result<Admitted, PoolError> {
        let limit = self.memory.limit;
        if bytes > limit {
            return Err(PoolError::TooLarge { estimate: bytes, limit });
        }
        let place = Arc::clone(&self.places)
            .try_acquire_owned()
            .map_err(|_| PoolError::Overloaded { waiting: self.places_all, retry_after: Duration::from_secs(2) })?;
        let fits = |used: u64| used.checked_add(bytes).filter(|sum| *sum <= limit);
        let taken = self.memory.used.fetch_update(Ordering::AcqRel, Ordering::Acquire, fits);
        if let Err(used) = taken {
            return Err(PoolError::MemoryFull { used, limit, needed: bytes, retry_after: Duration::from_secs(5) });
        }
        let memory = Arc::clone(&self.memory);
        Ok(Admitted { memory, bytes: AtomicU64::new(bytes), place: Mutex::new(Some(place)) })
    }
}

impl Admitted {
    /// Gives back the place, not the memory.
    pub(super) fn release_place(&self) {
        drop(super::lock(&self.place).take());
    }

    /// Takes another share of the memory in place of its own. More than is left is taken too: what a job has made lies in
    /// the memory already, and refusing it would lose the work; the next job waits until there is room again.
    pub(super) fn take(&self, bytes: u64) {
        let before = self.bytes.swap(bytes, Ordering::AcqRel);
        // Never below what others hold: what is given back was taken before.
        if bytes >= before {
            self.memory.used.fetch_add(bytes - before, Ordering::AcqRel);
        } else {
            self.memory.used.fetch_sub(before - bytes, Ordering::AcqRel);
        }
    }
}

impl Drop for Admitted {
    fn drop(&mut self) {
        self.memory.used.fetch_sub(*self.bytes.get_mut(), Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_given_back_and_never_overdrawn() {
        let admission = Admission::new(100, 10);
        let first = admission.admit(60).expect("room");
        assert!(matches!(admission.admit(41), Err(PoolError::MemoryFull { .. })));
        let _second = admission.admit(40).expect("just enough");
        drop(first);
        assert!(admission.admit(60).is_ok());
        assert_eq!(admission.admit(101).err(), Some(PoolError::TooLarge { estimate: 101, limit: 100 }));
    }

    #[test]
    fn a_job_keeps_what_it_made_and_gives_back_the_rest() {
        let admission = Admission::new(100, 10);
        let job = admission.admit(60).expect("room");
        let other = admission.admit(30).expect("room");
        job.take(10);
        assert!(matches!(admission.admit(61), Err(PoolError::MemoryFull { .. })));
        drop(admission.admit(60).expect("room again"));
        job.take(90);
        assert!(matches!(admission.admit(0), Err(PoolError::MemoryFull { .. })), "overdrawn: the next one waits");
        drop((job, other));
        assert!(admission.admit(100).is_ok());
    }

    #[test]
    fn places_are_bounded_and_a_resting_job_frees_its_own() {
        let admission = Admission::new(100, 1);
        let first = admission.admit(1).expect("room");
        assert!(matches!(admission.admit(1), Err(PoolError::Overloaded { .. })));
        first.release_place();
        assert!(admission.admit(1).is_ok());
    }
}
