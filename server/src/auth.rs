//! Access tokens: 256 random bits, of which only a hash is kept.
//!
//! They stand in `tokens.json` beside the store, so that a token can be created or revoked while the service runs; the
//! service notices within [`RELOAD`]. The hash needs no salt and no stretching: the tokens are random.

use clap::ValueEnum;
use quadmuse_proto::id::TokenId;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// What a token may do; each role may do what those before it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Ask queries.
    Reader,
    /// Add, annotate and remove examples.
    Contributor,
    /// Everything.
    Admin,
}

/// A token without its secret.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TokenRecord {
    /// Its public id.
    pub id: TokenId,
    /// Whose it is.
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// BLAKE3 of its secret, in hex.
    pub hash: String,
}

/// Why tokens can't be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum AuthError {
    /// The file can't be read or written.
    #[error("expected to read and write {}, found {source}", path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file holds something else.
    #[error("expected a list of tokens in {}, found another thing: {source}", path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// No such token.
    #[error("expected the id of a token, found `{0}`; list them first")]
    Unknown(String),
    /// The system gives no random bytes.
    #[error("expected random bytes from the system, found none")]
    NoRandomness,
}

/// How old the service's view of the tokens may be.
pub const RELOAD: Duration = Duration::from_secs(1);

/// Random bytes of a token.
const SECRET_BYTES: usize = 32;

/// The tokens of a store.
#[derive(Debug)]
pub struct Tokens {
    path: PathBuf,
    seen: Mutex<Seen>,
}

#[derive(Debug, Default)]
struct Seen {
    records: Vec<TokenRecord>,
    modified: Option<SystemTime>,
    looked: Option<Instant>,
}

impl Tokens {
    /// The tokens beside the store in `data`.
    pub fn beside(data: &Path) -> Self {
        Self { path: data.join("tokens.json"), seen: Mutex::default() }
    }

    /// All tokens, as they stand in the file.
    ///
    /// # Errors
    /// [`AuthError`].
    pub fn list(&self) -> Result<Vec<TokenRecord>, AuthError> {
        let bytes = match std::fs::read(&self.path) {
            Ok(bytes) => bytes,
            Err(source) if source.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(source) => return Err(AuthError::File { path: self.path.clone(), source }),
        };
        serde_json::from_slice(&bytes).map_err(|source| AuthError::Format { path: self.path.clone(), source })
    }

    /// Creates a token; returns it, which nobody can do again, and its record.
    ///
    /// # Errors
    /// [`AuthError`].
    pub fn create(&self, role: Role, name: &str) -> Result<(String, TokenRecord), AuthError> {
        let mut secret = [0; SECRET_BYTES];
        getrandom::fill(&mut secret).map_err(|_| AuthError::NoRandomness)?;
        let token = format!("qm_{}", secret.iter().map(|byte| format!("{byte:02x}")).collect::<String>());
        let record = TokenRecord { id: TokenId::generate(), name: name.into(), role, hash: hash_of(&token) };
        let mut records = self.list()?;
        records.push(record.clone());
        self.write(&records)?;
        Ok((token, record))
    }

    /// Revokes a token.
    ///
    /// # Errors
    /// [`AuthError::Unknown`], [`AuthError::File`].
    pub fn revoke(&self, id: &str) -> Result<(), AuthError> {
        let mut records = self.list()?;
        let before = records.len();
        records.retain(|record| record.id.to_string() != id);
        if records.len() == before {
            return Err(AuthError::Unknown(id.into()));
        }
        self.write(&records)
    }

    fn write(&self, records: &[TokenRecord]) -> Result<(), AuthError> {
        let failed = |source| AuthError::File { path: self.path.clone(), source };
        let bytes = serde_json::to_vec_pretty(records).map_err(|error| failed(error.into()))?;
        let fresh = self.path.with_extension("json.new");
        let mut file = std::fs::File::create(&fresh).map_err(failed)?;
        file.write_all(&bytes).and_then(|()| file.sync_all()).map_err(failed)?;
        std::fs::rename(&fresh, &self.path).map_err(failed)
    }

    /// The records, read again when the file changed. A file that can't be read keeps what was known: nobody is let
    /// in by breaking it.
    fn now<T>(&self, look: impl FnOnce(&[TokenRecord]) -> T) -> T {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if seen.looked.is_none_or(|looked| looked.elapsed() >= RELOAD) {
            let modified = std::fs::metadata(&self.path).and_then(|meta| meta.modified()).ok();
            if seen.looked.is_none() || modified != seen.modified {
                match self.list() {
                    Ok(records) => (seen.records, seen.modified) = (records, modified),
                    Err(error) => tracing::error!(%error, "the tokens stay as they were"),
                }
            }
            seen.looked = Some(Instant::now());
        }
        look(&seen.records)
    }

    /// Whether there is none, so that the service is open.
    pub fn is_empty(&self) -> bool {
        self.now(<[_]>::is_empty)
    }

    /// Whose token this is.
    pub fn find(&self, token: &str) -> Option<TokenRecord> {
        // Comparing hashes of random tokens gives nothing away, however long it takes.
        let hash = hash_of(token);
        self.now(|records| records.iter().find(|record| record.hash == hash).cloned())
    }
}

fn hash_of(token: &str) -> String {
    blake3::hash(token.as_bytes()).to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_found_until_it_is_revoked_and_never_stored() {
        let dir = tempfile::tempdir().expect("a directory");
        let tokens = Tokens::beside(dir.path());
        assert!(tokens.is_empty());
        let (token, record) = tokens.create(Role::Contributor, "ada").expect("created");
        let fresh = Tokens::beside(dir.path());
        assert_eq!(fresh.find(&token), Some(record.clone()));
        assert_eq!(fresh.find("qm_other"), None);
        let file = std::fs::read_to_string(dir.path().join("tokens.json")).expect("a file");
        assert!(!file.contains(&token[3..]));
        tokens.revoke(&record.id.to_string()).expect("revoked");
        assert_eq!(Tokens::beside(dir.path()).find(&token), None);
        assert!(matches!(tokens.revoke("nobody"), Err(AuthError::Unknown(_))));
    }

    #[test]
    fn roles_include_those_below() {
        assert!(Role::Reader < Role::Contributor && Role::Contributor < Role::Admin);
    }
}
