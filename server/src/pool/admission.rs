//! Who may come in: a bounded number of jobs, their memory estimated up front, and of both no more than a fair share a user.
//!
//! A user alone may have [`SHARE_ALONE`] of what there is, so that whoever comes next finds room; with others, that is
//! divided by their number. One job of a user who has nothing else is admitted up to the whole. Who is over the share is
//! told so ([`PoolError::OverShare`]), whatever room there is; for the others it is there.

use super::{PoolError, User};
use bytes::Bytes;
use quadmuse_proto::Quota;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// What a user alone may have, as a fraction: three of four parts.
const SHARE_ALONE: (u64, u64) = (3, 4);

/// When to come back for who found no room in memory, or is over the share.
const MEMORY_RETRY: Duration = Duration::from_secs(5);

/// When to come back for who found too many jobs.
const PLACES_RETRY: Duration = Duration::from_secs(2);

/// What may be admitted at the same time. Clones share it.
#[derive(Clone, Debug)]
pub struct Admission(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    limit_bytes: u64,
    places: u64,
    now: Mutex<AdmissionState>,
}

/// The memory and places in use, in all and by user.
#[derive(Debug, Default)]
struct AdmissionState {
    all: Used,
    users: HashMap<User, Used>,
    /// What was said of some users beside the fair share.
    quotas: HashMap<User, Quota>,
}

/// What is in use: by a user, or by all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Used {
    /// Memory, by estimate, in bytes.
    pub bytes: u64,
    /// Jobs that compute or wait for it.
    pub places: u64,
}

/// A place among the running jobs and a share of the memory; both are given back on drop.
#[derive(Debug)]
pub struct Admitted {
    shared: Arc<Shared>,
    user: User,
    bytes: AtomicU64,
    has_place: AtomicBool,
}

fn part(of: u64, others: u64) -> u64 {
    let (parts, whole) = SHARE_ALONE;
    of / whole * parts / (others + 1)
}

impl Admission {
    /// At most `memory_bytes` bytes by estimate, and at most `jobs` jobs that compute or wait for it.
    pub fn new(memory_bytes: u64, jobs: usize) -> Self {
        Self(Arc::new(Shared { limit_bytes: memory_bytes, places: jobs as u64, now: Mutex::default() }))
    }

    /// Admits a job with an estimated need of memory.
    ///
    /// # Errors
    /// [`PoolError::TooLarge`] when it could never be admitted; [`PoolError::OverShare`], [`PoolError::Overloaded`] and
    /// [`PoolError::MemoryFull`] when it can't be now.
    pub fn admit(&self, user: User, bytes: u64) -> Result<Admitted, PoolError> {
        self.enter(user, Used { bytes, places: 1 })
    }

    /// Takes memory for what is no job: a body that comes in, an answer that goes out.
    ///
    /// # Errors
    /// As [`Admission::admit`].
    pub fn hold(&self, user: User, bytes: u64) -> Result<Admitted, PoolError> {
        self.enter(user, Used { bytes, places: 0 })
    }

    fn enter(&self, user: User, wanted: Used) -> Result<Admitted, PoolError> {
        let mut now = super::lock(&self.0.now);
        self.0.check(&now, user, wanted)?;
        now.add(user, wanted);
        let (bytes, has_place) = (AtomicU64::new(wanted.bytes), AtomicBool::new(wanted.places > 0));
        Ok(Admitted { shared: Arc::clone(&self.0), user, bytes, has_place })
    }

    /// Whether `user` would be refused whatever it asked for: worth a look before a body is read.
    ///
    /// # Errors
    /// [`PoolError::OverShare`], [`PoolError::Overloaded`], [`PoolError::MemoryFull`].
    pub fn look(&self, user: User) -> Result<(), PoolError> {
        self.0.check(&super::lock(&self.0.now), user, Used { bytes: 1, places: 1 })
    }

    /// Says what a user may have at most; the fair share holds all the same.
    pub fn set_quota(&self, user: User, quota: Quota) {
        let mut now = super::lock(&self.0.now);
        match quota == Quota::default() {
            true => drop(now.quotas.remove(&user)),
            false => drop(now.quotas.insert(user, quota)),
        }
    }

    /// What all have together.
    pub fn used(&self) -> Used {
        super::lock(&self.0.now).all
    }

    /// Who has something, and what.
    pub fn by_user(&self) -> Vec<(User, Used)> {
        super::lock(&self.0.now).users.iter().map(|(user, used)| (*user, *used)).collect()
    }

    /// The memory that may be in use, in bytes.
    pub fn limit_bytes(&self) -> u64 {
        self.0.limit_bytes
    }
}

impl Shared {
    fn check(&self, now: &AdmissionState, user: User, wanted: Used) -> Result<(), PoolError> {
        let quota = now.quotas.get(&user).copied().unwrap_or_default();
        let limit = quota.memory_bytes.map_or(self.limit_bytes, |most| most.min(self.limit_bytes));
        if wanted.bytes > limit {
            return Err(PoolError::TooLarge { estimate: wanted.bytes, limit });
        }
        let mine = now.users.get(&user).copied().unwrap_or_default();
        let others = now.users.keys().filter(|other| **other != user).count() as u64;
        // What a user has nothing of is not refused for the share: one large mesh of somebody alone fits.
        let over = |mine: u64, wanted: u64, all: u64, quota: Option<u64>| {
            let share = part(all, others).min(quota.unwrap_or(u64::MAX));
            (wanted > 0 && mine > 0 && mine.saturating_add(wanted) > share).then_some(share)
        };
        if let Some(share) = over(mine.places, wanted.places, self.places, quota.jobs.map(u64::from)) {
            return Err(PoolError::OverShare { what: "jobs", used: mine.places, share, retry_after: PLACES_RETRY });
        }
        if let Some(share) = over(mine.bytes, wanted.bytes, self.limit_bytes, quota.memory_bytes) {
            let what = "bytes of memory";
            return Err(PoolError::OverShare { what, used: mine.bytes, share, retry_after: MEMORY_RETRY });
        }
        if now.all.places + wanted.places > self.places {
            let waiting = usize::try_from(now.all.places).unwrap_or(usize::MAX);
            return Err(PoolError::Overloaded { waiting, retry_after: PLACES_RETRY });
        }
        if now.all.bytes.saturating_add(wanted.bytes) > self.limit_bytes {
            let (used, limit, needed) = (now.all.bytes, self.limit_bytes, wanted.bytes);
            return Err(PoolError::MemoryFull { used, limit, needed, retry_after: MEMORY_RETRY });
        }
        Ok(())
    }
}

impl AdmissionState {
    fn add(&mut self, user: User, more: Used) {
        for used in [&mut self.all, self.users.entry(user).or_default()] {
            used.bytes = used.bytes.saturating_add(more.bytes);
            used.places += more.places;
        }
    }

    fn give_back(&mut self, user: User, less: Used) {
        let take = |used: &mut Used| {
            used.bytes = used.bytes.saturating_sub(less.bytes);
            used.places = used.places.saturating_sub(less.places);
        };
        take(&mut self.all);
        if let Some(mine) = self.users.get_mut(&user) {
            take(mine);
            if *mine == Used::default() {
                self.users.remove(&user);
            }
        }
    }
}

impl Admitted {
    /// Gives back the place, not the memory.
    pub(super) fn release_place(&self) {
        if self.has_place.swap(false, Ordering::AcqRel) {
            super::lock(&self.shared.now).give_back(self.user, Used { bytes: 0, places: 1 });
        }
    }

    /// Takes another share of the memory in place of its own. More than is left is taken too: what a job has made lies in
    /// the memory already, and refusing it would lose the work; the next job waits until there is room again.
    pub fn take(&self, bytes: u64) {
        let mut now = super::lock(&self.shared.now);
        let before = self.bytes.swap(bytes, Ordering::AcqRel);
        now.give_back(self.user, Used { bytes: before, places: 0 });
        now.add(self.user, Used { bytes, places: 0 });
    }

    /// Takes `more` bytes beside its own.
    ///
    /// # Errors
    /// As [`Admission::hold`]; it keeps what it has then.
    pub fn grow(&self, more: u64) -> Result<(), PoolError> {
        let mut now = super::lock(&self.shared.now);
        let wanted = Used { bytes: more, places: 0 };
        self.shared.check(&now, self.user, wanted)?;
        now.add(self.user, wanted);
        self.bytes.fetch_add(more, Ordering::AcqRel);
        Ok(())
    }

    /// Whose it is.
    pub fn user(&self) -> User {
        self.user
    }

    /// What it has, in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Acquire)
    }
}

/// Bytes that are paid for as long as anybody has them.
struct PaidBytes {
    bytes: Vec<u8>,
    _share: Admitted,
}

impl AsRef<[u8]> for PaidBytes {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Admitted {
    /// Bytes that this share pays for, from now on no more and no less, until the last who has them lets go.
    pub fn held(self, mut bytes: Vec<u8>) -> Bytes {
        bytes.shrink_to_fit();
        self.take(bytes.capacity() as u64);
        Bytes::from_owner(PaidBytes { bytes, _share: self })
    }
}

impl Drop for Admitted {
    fn drop(&mut self) {
        let less = Used { bytes: *self.bytes.get_mut(), places: u64::from(*self.has_place.get_mut()) };
        super::lock(&self.shared.now).give_back(self.user, less);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: User = User(1);
    const B: User = User(2);

    #[test]
    fn memory_is_given_back_and_never_overdrawn() {
        let admission = Admission::new(100, 10);
        let first = admission.admit(A, 60).expect("room");
        assert!(matches!(admission.admit(B, 41), Err(PoolError::MemoryFull { .. })));
        let second = admission.admit(B, 40).expect("just enough");
        drop(first);
        assert!(admission.admit(A, 60).is_ok());
        let too_large = admission.admit(A, 101).err();
        assert_eq!(too_large, Some(PoolError::TooLarge { estimate: 101, limit: 100 }));
        drop(second);
        assert_eq!((admission.used(), admission.by_user()), (Used::default(), Vec::new()));
    }

    #[test]
    fn a_job_keeps_what_it_made_and_gives_back_the_rest() {
        let admission = Admission::new(100, 10);
        let job = admission.admit(A, 60).expect("room");
        let other = admission.admit(B, 30).expect("room");
        job.take(10);
        assert!(matches!(admission.admit(User(3), 61), Err(PoolError::MemoryFull { .. })));
        drop(admission.admit(User(3), 60).expect("room again"));
        job.take(90);
        let refused = admission.admit(User(3), 0);
        assert!(matches!(refused, Err(PoolError::MemoryFull { .. })), "overdrawn: the next one waits");
        drop((job, other));
        assert!(admission.admit(A, 100).is_ok());
    }

    #[test]
    fn places_are_bounded_and_a_resting_job_frees_its_own() {
        let admission = Admission::new(100, 1);
        let first = admission.admit(A, 1).expect("room");
        assert!(matches!(admission.admit(B, 1), Err(PoolError::Overloaded { .. })));
        first.release_place();
        first.release_place();
        assert!(admission.admit(B, 1).is_ok());
    }

    #[test]
    fn one_user_never_has_all_and_who_comes_next_finds_room() {
        let admission = Admission::new(100, 1000);
        let mut held = Vec::new();
        let refused = loop {
            match admission.admit(A, 1) {
                Ok(admitted) => held.push(admitted),
                Err(error) => break error,
            }
        };
        assert!(matches!(refused, PoolError::OverShare { used: 75, share: 75, .. }), "{refused:?}");
        let theirs: Vec<_> = (0..25).map(|_| admission.admit(B, 1).expect("their share")).collect();
        // With another the share is less, and nobody who is over it gets more.
        held.truncate(38);
        assert!(matches!(admission.admit(A, 1), Err(PoolError::OverShare { share: 37, .. })));
        held.truncate(36);
        assert!(admission.admit(A, 1).is_ok());
        drop(theirs);
    }

    #[test]
    fn what_is_no_job_counts_as_memory_alone_and_grows_within_the_share() {
        let admission = Admission::new(100, 1);
        let body = admission.hold(A, 10).expect("room");
        body.grow(60).expect("room");
        assert!(matches!(body.grow(10), Err(PoolError::OverShare { .. })));
        assert_eq!((body.bytes(), admission.used()), (70, Used { bytes: 70, places: 0 }));
        assert!(admission.admit(B, 30).is_ok());
    }

    #[test]
    fn a_quota_is_less_than_the_share() {
        let admission = Admission::new(100, 10);
        admission.set_quota(A, Quota { jobs: Some(2), memory_bytes: Some(20), requests_per_second: None });
        let _two = [admission.admit(A, 5), admission.admit(A, 5)].map(|a| a.expect("within it"));
        assert!(matches!(admission.admit(A, 5), Err(PoolError::OverShare { what: "jobs", share: 2, .. })));
        assert!(matches!(admission.hold(A, 11), Err(PoolError::OverShare { share: 20, .. })));
        assert!(matches!(admission.hold(A, 21), Err(PoolError::TooLarge { limit: 20, .. })));
    }
}
