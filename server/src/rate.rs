//! How often a caller may ask: a bucket of tokens a user, filled at a rate (*Source:* the token bucket of RFC 2697).

use crate::pool::User;
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A bucket holds what comes in so many seconds.
const BURST_S: f64 = 3.0;

/// Most buckets; full ones, which are the same as new ones, are forgotten first.
const BUCKETS_MAX: usize = 65_536;

/// The buckets.
#[derive(Debug)]
pub struct Rates {
    /// Tokens a second for each user who has no quota; 0: no limit.
    per_second: f64,
    buckets: Mutex<Buckets>,
}

#[derive(Debug, Default)]
struct Buckets {
    of: HashMap<User, Bucket>,
    /// Before this none of them is full, and looking for one is in vain: it looks at all of them.
    none_full_before: Option<Instant>,
}

impl Buckets {
    /// Forgets those that are full again, if there is no place for another; whether there is one now.
    fn make_place(&mut self, now: Instant) -> bool {
        if self.of.len() < BUCKETS_MAX {
            return true;
        }
        if self.none_full_before.is_some_and(|first| now < first) {
            return false;
        }
        let refilled = Duration::from_secs_f64(BURST_S);
        self.of.retain(|_, bucket| now.saturating_duration_since(bucket.at) < refilled);
        // A bucket that is asked again is full later still.
        self.none_full_before = self.of.values().map(|bucket| bucket.at + refilled).min();
        self.of.len() < BUCKETS_MAX
    }
}

#[derive(Clone, Copy, Debug)]
struct Bucket {
    tokens: f64,
    at: Instant,
}

impl Rates {
    /// So many requests a second for each user; 0: no limit.
    pub fn new(per_second: u32) -> Self {
        Self { per_second: f64::from(per_second), buckets: Mutex::default() }
    }

    /// Takes `cost` tokens of a user, whose own rate may be given; if there are too few, the time until there are enough.
    ///
    /// # Errors
    /// The time to wait.
    pub fn take(&self, user: User, cost: f64, own_rate: Option<u32>) -> Result<(), Duration> {
        self.take_at(user, cost, own_rate, Instant::now())
    }

    fn take_at(&self, user: User, cost: f64, own_rate: Option<u32>, now: Instant) -> Result<(), Duration> {
        let rate = own_rate.map_or(self.per_second, f64::from);
        if rate <= 0.0 {
            return Ok(());
        }
        // One request always fits.
        let full = (rate * BURST_S).max(cost);
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if !buckets.of.contains_key(&user) && !buckets.make_place(now) {
            return Err(Duration::from_secs_f64(BURST_S));
        }
        let bucket = buckets.of.entry(user).or_insert(Bucket { tokens: full, at: now });
        let came = now.saturating_duration_since(bucket.at).as_secs_f64() * rate;
        *bucket = Bucket { tokens: (bucket.tokens + came).min(full), at: now };
        if bucket.tokens >= cost {
            bucket.tokens -= cost;
            return Ok(());
        }
        Err(Duration::try_from_secs_f64((cost - bucket.tokens) / rate).unwrap_or(Duration::from_secs(60)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_passes_and_then_the_rate_holds() {
        let (rates, begun) = (Rates::new(10), Instant::now());
        let at = |ms: u64| begun + Duration::from_millis(ms);
        let passed = (0..100).filter(|_| rates.take_at(User(1), 1.0, None, begun).is_ok()).count();
        assert_eq!(passed, 30);
        let wait = rates.take_at(User(1), 1.0, None, begun).expect_err("none are left");
        assert!((90..=110).contains(&wait.as_millis()), "{wait:?}");
        assert!(rates.take_at(User(2), 1.0, None, begun).is_ok(), "another has a bucket of its own");
        let later = (1..=1000).filter(|ms| rates.take_at(User(1), 1.0, None, at(*ms)).is_ok()).count();
        assert_eq!(later, 10);
    }

    #[test]
    fn a_quota_is_a_rate_of_its_own_and_none_is_no_limit() {
        let now = Instant::now();
        let rates = Rates::new(0);
        assert!((0..10_000).all(|_| rates.take_at(User(1), 1.0, None, now).is_ok()));
        assert_eq!((0..100).filter(|_| rates.take_at(User(1), 1.0, Some(2), now).is_ok()).count(), 6);
    }

    #[test]
    fn no_number_of_users_makes_it_grow() {
        let (rates, now) = (Rates::new(1), Instant::now());
        (0..2 * BUCKETS_MAX as u64).for_each(|n| _ = rates.take_at(User(n), 1.0, None, now));
        assert!(rates.buckets.lock().expect("not poisoned").of.len() <= BUCKETS_MAX);
    }

    #[test]
    fn a_place_is_free_once_a_bucket_is_full_again_and_not_before() {
        let (rates, begun) = (Rates::new(1), Instant::now());
        let at = |ms: u64| begun + Duration::from_millis(ms);
        (0..BUCKETS_MAX as u64).for_each(|n| _ = rates.take_at(User(n), 1.0, None, at(n % 2 * 1000)));
        let new = User(BUCKETS_MAX as u64);
        assert!(rates.take_at(new, 1.0, None, at(2000)).is_err());
        assert!(rates.take_at(new, 1.0, None, at(2900)).is_err());
        assert!(rates.take_at(new, 1.0, None, at(3000)).is_ok(), "half of them are full again");
        assert_eq!(rates.buckets.lock().expect("not poisoned").of.len(), BUCKETS_MAX / 2 + 1);
    }
}
