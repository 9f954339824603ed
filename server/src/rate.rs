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
    buckets: Mutex<HashMap<User, Bucket>>,
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
        if buckets.len() >= BUCKETS_MAX && !buckets.contains_key(&user) {
            let refilled = Duration::from_secs_f64(BURST_S);
            buckets.retain(|_, bucket| now.saturating_duration_since(bucket.at) < refilled);
            if buckets.len() >= BUCKETS_MAX {
                return Err(refilled);
            }
        }
        let bucket = buckets.entry(user).or_insert(Bucket { tokens: full, at: now });
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
        assert!(rates.buckets.lock().expect("not poisoned").len() <= BUCKETS_MAX);
    }
}
