//! `Idempotency-Key`: a `POST` that is sent again with the same key makes nothing new.
//!
//! A key is remembered with the hash of its request and the id of what was made; a second request waits for the first.

use super::caller::RequestCaller;
use super::error::HttpError;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::OwnedMutexGuard;

/// Most keys that are remembered; the oldest is forgotten first.
const KEYS_MAX: usize = 4096;

/// Longest key, in bytes.
const KEY_LENGTH_MAX: usize = 255;

/// The resource that a key stands for once its request has been answered.
#[derive(Clone, Debug)]
struct MadeResource {
    fingerprint: blake3::Hash,
    id: String,
}

type Slot = Arc<tokio::sync::Mutex<Option<MadeResource>>>;

/// The keys seen.
#[derive(Default)]
pub struct Idempotency(Mutex<Keys>);

#[derive(Default)]
struct Keys {
    slots: HashMap<String, Slot>,
    order: VecDeque<String>,
}

/// The caller's key, if there is one.
#[derive(Clone, Debug)]
pub struct Key(Option<String>);

impl<S: Sync> FromRequestParts<S> for Key {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, HttpError> {
        let Some(value) = parts.headers.get("idempotency-key") else { return Ok(Self(None)) };
        let expected = format!("of 1 to {KEY_LENGTH_MAX} visible characters");
        let text = value.to_str().ok().filter(|text| (1..=KEY_LENGTH_MAX).contains(&text.len()));
        match text {
            // The same key on another address, or of another caller, is another key.
            Some(text) => {
                let RequestCaller(caller) = parts.extensions.get::<RequestCaller>().copied().unwrap_or_default();
                Ok(Self(Some(format!("{}:{} {}", caller.user.0, parts.uri.path(), text))))
            }
            None => Err(HttpError::parameter("idempotency-key", expected, String::from_utf8_lossy(value.as_bytes()))),
        }
    }
}

/// A request's turn: either what it would make is there, or it makes it and says so.
pub enum Turn {
    /// Made before: the id.
    Made(String),
    /// To be made.
    Make(Claim),
}

/// The right to make something, held until it is made or given up.
pub struct Claim {
    fingerprint: blake3::Hash,
    slot: Option<OwnedMutexGuard<Option<MadeResource>>>,
}

impl Claim {
    /// Remembers what was made.
    pub fn made(self, id: &impl ToString) {
        if let Some(mut slot) = self.slot {
            *slot = Some(MadeResource { fingerprint: self.fingerprint, id: id.to_string() });
        }
    }
}

impl Idempotency {
    /// The turn of a request; without a key it always makes.
    ///
    /// # Errors
    /// [`HttpError::KeyReused`] when the key came with another request before.
    pub async fn turn(&self, key: Key, fingerprint: blake3::Hash) -> Result<Turn, HttpError> {
        let Some(key) = key.0 else { return Ok(Turn::Make(Claim { fingerprint, slot: None })) };
        let slot = self.slot(&key).lock_owned().await;
        match &*slot {
            Some(made) if made.fingerprint == fingerprint => Ok(Turn::Made(made.id.clone())),
            Some(_) => Err(HttpError::KeyReused(key.split_once(' ').map_or(key.clone(), |(_, key)| key.into()))),
            None => Ok(Turn::Make(Claim { fingerprint, slot: Some(slot) })),
        }
    }

    fn slot(&self, key: &str) -> Slot {
        let mut keys = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(slot) = keys.slots.get(key) {
            return Arc::clone(slot);
        }
        if keys.order.len() >= KEYS_MAX
            && let Some(oldest) = keys.order.pop_front()
        {
            keys.slots.remove(&oldest);
        }
        keys.order.push_back(key.into());
        Arc::clone(keys.slots.entry(key.into()).or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(text: &str) -> Key {
        Key(Some(format!("/v1/queries {text}")))
    }

    #[tokio::test]
    async fn a_key_makes_once_and_is_bound_to_its_request() {
        let keys = Idempotency::default();
        let (one, other) = (blake3::hash(b"one"), blake3::hash(b"other"));
        let Ok(Turn::Make(claim)) = keys.turn(key("k"), one).await else { panic!("expected to make") };
        claim.made(&"id-1");
        assert!(matches!(keys.turn(key("k"), one).await, Ok(Turn::Made(id)) if id == "id-1"));
        assert!(matches!(keys.turn(key("k"), other).await, Err(HttpError::KeyReused(k)) if k == "k"));
    }

    #[tokio::test]
    async fn a_claim_that_is_given_up_leaves_the_key_free() {
        let keys = Idempotency::default();
        let one = blake3::hash(b"one");
        drop(keys.turn(key("k"), one).await);
        assert!(matches!(keys.turn(key("k"), one).await, Ok(Turn::Make(_))));
    }

    #[tokio::test]
    async fn the_oldest_keys_are_forgotten() {
        let keys = Idempotency::default();
        for n in 0..=KEYS_MAX {
            let Ok(Turn::Make(claim)) = keys.turn(key(&n.to_string()), blake3::hash(b"x")).await else {
                panic!("expected to make")
            };
            claim.made(&n);
        }
        assert_eq!(keys.0.lock().expect("not poisoned").slots.len(), KEYS_MAX);
        assert!(matches!(keys.turn(key("0"), blake3::hash(b"x")).await, Ok(Turn::Make(_))));
    }
}
