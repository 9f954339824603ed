//! Access tokens: 256 random bits, of which only a hash is kept.
//!
//! Where servers share a corpus, the list stands beside it on the engine (`list/shared`), and holds for all of them. Else it is
//! a file: they stand in `tokens.json` beside the store, so that a token can be created or revoked while the service runs; the
//! service notices within [`RELOAD`]. The hash needs no salt and no stretching: the tokens are random.
//!
//! Access fails closed. Once a token was created, `tokens.required` stands beside the list, and only a token that the list
//! names lets anybody in: an empty list, a damaged one and none at all let in nobody. Who wants an open service again
//! stops it and removes both files.

mod list;

pub use list::TokenRecord;
pub use quadmuse_proto::Role;

use list::ListStorage;
use quadmuse_proto::id::TokenId;
use quadmuse_proto::{NewToken, TokenPatch};
use quadmuse_store::{Documents, StoreError};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Why tokens can't be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum AuthError {
    /// A file can't be read or written.
    #[error("expected to read and write {}, found {source}", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file holds something else.
    #[error(
        "expected a list of tokens in {}, found another thing ({source}): nobody is let in; \
         put a copy of the list in its place, or move it aside and create new tokens", path.display()
    )]
    Format {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The engine that servers share doesn't answer.
    #[error(transparent)]
    Shared(#[from] StoreError),
    /// No such token.
    #[error("expected the id of a token, found `{0}`; list them first")]
    Unknown(String),
    /// A value is outside its range.
    #[error("expected `{name}` {expected}, found {found}")]
    Invalid {
        /// Which value.
        name: &'static str,
        /// What would do.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The system gives no random bytes.
    #[error("expected random bytes from the system, found none")]
    NoRandomness,
}

/// How old the service's view of the tokens may be.
pub const RELOAD: Duration = Duration::from_secs(1);

/// How often the times of last use are written down.
pub const NOTE_USES_EVERY: Duration = Duration::from_secs(60);

/// Random bytes of a token.
const SECRET_BYTES: usize = 32;

/// Most tokens of a store.
const TOKENS_MAX: usize = 10_000;

/// Whom the service lets in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// No token was ever created: everybody.
    Open,
    /// Who has a token of the list.
    Tokens,
}

/// The tokens of a store.
pub struct Tokens {
    files: ListStorage,
    seen: Mutex<TokenCache>,
}

/// The tokens as they were read last, and when they were used.
#[derive(Debug, Default)]
struct TokenCache {
    by_hash: HashMap<String, TokenRecord>,
    /// Which file was read last; `None` if there was none.
    mark: Option<list::Mark>,
    looked: Option<Instant>,
    /// A token was created at some time: this is never taken back while the process runs.
    required: bool,
    /// Seconds since 1970 at which tokens were used, until they are written down.
    uses: HashMap<TokenId, u64>,
}

impl Tokens {
    /// The tokens beside the store in `data`.
    pub fn beside(data: &Path) -> Self {
        Self { files: ListStorage::beside(data), seen: Mutex::default() }
    }

    /// The tokens of all servers that share a corpus.
    pub fn shared(documents: Arc<dyn Documents>) -> Self {
        Self { files: ListStorage::Shared(documents), seen: Mutex::default() }
    }

    /// All tokens, as they stand in the file.
    ///
    /// # Errors
    /// [`AuthError::File`], [`AuthError::Format`].
    pub fn list(&self) -> Result<Vec<TokenRecord>, AuthError> {
        Ok(self.files.read()?.unwrap_or_default())
    }

    /// Creates a token; returns its secret, which nobody can tell again, and its record. Durable when it returns.
    ///
    /// # Errors
    /// [`AuthError`]; a damaged list is left as it is.
    pub fn create(&self, new: &NewToken) -> Result<(String, TokenRecord), AuthError> {
        let record = |hash: String| list::record(new, hash, now_s());
        let mut random = [0; SECRET_BYTES];
        getrandom::fill(&mut random).map_err(|_| AuthError::NoRandomness)?;
        let secret = format!("qm_{}", random.iter().map(|byte| format!("{byte:02x}")).collect::<String>());
        let record = record(hash_of(&secret))?;
        self.files.change(|records| {
            if records.len() >= TOKENS_MAX {
                let (expected, found) = (format!("to be at most {TOKENS_MAX}"), records.len() + 1);
                return Err(AuthError::Invalid { name: "tokens", expected, found: found.to_string() });
            }
            records.push(record.clone());
            Ok(())
        })?;
        self.look_again();
        Ok((secret, record))
    }

    /// Changes a token's name or quota.
    ///
    /// # Errors
    /// [`AuthError`].
    pub fn annotate(&self, id: &str, patch: &TokenPatch) -> Result<TokenRecord, AuthError> {
        patch.name.as_deref().map_or(Ok(()), list::check_name)?;
        let changed = self.files.change(|records| {
            let record = records.iter_mut().find(|record| record.id.to_string() == id);
            let record = record.ok_or_else(|| AuthError::Unknown(id.into()))?;
            patch.name.iter().for_each(|name| record.name.clone_from(name));
            patch.quota.iter().for_each(|quota| record.quota = *quota);
            Ok(record.clone())
        })?;
        self.look_again();
        Ok(changed)
    }

    /// Revokes a token. Durable when it returns; a service that runs refuses it within [`RELOAD`].
    ///
    /// # Errors
    /// [`AuthError::Unknown`], [`AuthError::File`], [`AuthError::Format`].
    pub fn revoke(&self, id: &str) -> Result<(), AuthError> {
        self.files.change(|records| {
            let before = records.len();
            records.retain(|record| record.id.to_string() != id);
            if records.len() == before { Err(AuthError::Unknown(id.into())) } else { Ok(()) }
        })?;
        self.look_again();
        Ok(())
    }

    /// Whom the service lets in.
    pub fn access(&self) -> Access {
        if self.now().required { Access::Tokens } else { Access::Open }
    }

    /// Whose token this is, unless it has expired. Notes that it was used.
    pub fn find(&self, secret: &str) -> Option<TokenRecord> {
        // Comparing hashes of random tokens gives nothing away, however long it takes.
        let (hash, now) = (hash_of(secret), now_s());
        let mut seen = self.now();
        let record = seen.by_hash.get(&hash).filter(|record| record.is_valid_at(now)).cloned()?;
        seen.uses.insert(record.id, now);
        Some(record)
    }

    /// Writes down when tokens were used last. Blocks.
    ///
    /// # Errors
    /// [`AuthError::File`], [`AuthError::Format`].
    pub fn note_uses(&self) -> Result<(), AuthError> {
        let uses = std::mem::take(&mut self.lock().uses);
        if uses.is_empty() {
            return Ok(());
        }
        // Under the lock of the files: a token that was revoked meanwhile stays so.
        self.files.change(|records| {
            for record in records {
                record.last_used_s = record.last_used_s.max(uses.get(&record.id).copied());
            }
            Ok(())
        })
    }

    fn lock(&self) -> MutexGuard<'_, TokenCache> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn look_again(&self) {
        self.lock().looked = None;
    }

    /// The newest view of the files. What can't be read lets in nobody.
    fn now(&self) -> MutexGuard<'_, TokenCache> {
        let mut seen = self.lock();
        if seen.looked.is_none_or(|looked| looked.elapsed() >= RELOAD) {
            seen.refresh(&self.files);
        }
        seen
    }
}

impl TokenCache {
    fn refresh(&mut self, files: &ListStorage) {
        let first = self.looked.replace(Instant::now()).is_none();
        let mark = match files.mark() {
            Ok(mark) => mark,
            Err(error) => {
                tracing::error!(%error, "the tokens can't be read: nobody is let in");
                (self.by_hash, self.mark, self.required) = (HashMap::new(), None, true);
                return;
            }
        };
        self.required |= files.is_marked() || mark.is_some();
        if mark == self.mark && !first {
            return;
        }
        self.mark = mark;
        self.by_hash = match files.known() {
            Ok(records) => {
                let records = records.into_iter().flatten();
                records.map(|record| (record.hash.clone(), record)).collect()
            }
            Err(error) => {
                tracing::error!(%error, "the tokens can't be read: nobody is let in");
                HashMap::new()
            }
        };
        if self.required {
            if self.by_hash.is_empty() {
                tracing::warn!("no token is valid: nobody is let in until one is created");
            }
            // An older release did not leave the mark.
            if let Err(error) = files.require() {
                tracing::warn!(%error, "not marked that tokens are required");
            }
        }
    }
}

fn now_s() -> u64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

fn hash_of(secret: &str) -> String {
    blake3::hash(secret.as_bytes()).to_hex().to_string()
}

#[cfg(test)]
mod tests;
