//! Where the tokens stand.
//!
//! Beside a store they are files: the list, the mark that tokens are required, and the lock under which both change. Where
//! servers share a corpus they are one document: that there is one, even an empty one, says that tokens are required.

mod shared;

use super::AuthError;
use crate::work::query::rfc3339;
use crate::work::texts;
use quadmuse_proto::id::TokenId;
use quadmuse_proto::token::TOKEN_NAME_LENGTH_MAX;
use quadmuse_proto::{NewToken, Quota, Role, Token};
use quadmuse_store::Documents;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// A token without its secret, as it stands in the list.
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
    /// Seconds since 1970 at which it was created.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub created_s: Option<u64>,
    /// Seconds since 1970 from which on it is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires_s: Option<u64>,
    /// Seconds since 1970 at which it was last used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_used_s: Option<u64>,
    /// What it may use at most.
    #[serde(default)]
    pub quota: Quota,
}

impl TokenRecord {
    /// Whether it is accepted at `now_s`, in seconds since 1970.
    pub fn is_valid_at(&self, now_s: u64) -> bool {
        self.expires_s.is_none_or(|expires| now_s < expires)
    }

    /// As it goes over the wire.
    pub fn to_wire(&self) -> Token {
        let time = |seconds: Option<u64>| seconds.map(|s| rfc3339(s.saturating_mul(1000)));
        Token {
            id: self.id,
            name: self.name.clone(),
            role: self.role,
            created: time(self.created_s),
            expires: time(self.expires_s),
            last_used: time(self.last_used_s),
            quota: self.quota,
        }
    }
}

/// The longest that a token may be accepted, in seconds: ten years.
const EXPIRES_IN_MAX_S: u64 = 10 * 366 * 86_400;

/// The record of a new token.
///
/// # Errors
/// [`AuthError::Invalid`].
pub(super) fn record(new: &NewToken, hash: String, now_s: u64) -> Result<TokenRecord, AuthError> {
    check_name(&new.name)?;
    if let Some(seconds) = new.expires_in_s.filter(|seconds| !(1..=EXPIRES_IN_MAX_S).contains(seconds)) {
        let expected = format!("from 1 to {EXPIRES_IN_MAX_S} seconds");
        return Err(AuthError::Invalid { name: "expires_in_s", expected, found: seconds.to_string() });
    }
    Ok(TokenRecord {
        id: TokenId::generate(),
        name: new.name.clone(),
        role: new.role,
        hash,
        created_s: Some(now_s),
        expires_s: new.expires_in_s.map(|seconds| now_s + seconds),
        last_used_s: None,
        quota: new.quota,
    })
}

/// A name that can stand in a list and in a log.
///
/// # Errors
/// [`AuthError::Invalid`].
pub(super) fn check_name(name: &str) -> Result<(), AuthError> {
    let invalid = |expected: String, found: String| Err(AuthError::Invalid { name: "name", expected, found });
    if name.len() > TOKEN_NAME_LENGTH_MAX {
        return invalid(format!("of at most {TOKEN_NAME_LENGTH_MAX} bytes"), format!("{} bytes", name.len()));
    }
    match texts::unprintable(name) {
        None => Ok(()),
        Some(found) => invalid(texts::EXPECTED.into(), found),
    }
}

/// What tells one state of the list from another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// Of a file: renaming brings a new inode.
    File { inode: u64, length: u64, modified: Option<SystemTime> },
    /// Of a document.
    Revision(u64),
}

/// Says where the list of tokens is stored.
pub(super) enum ListStorage {
    Files(Files),
    Shared(Arc<dyn Documents>),
}

impl ListStorage {
    pub(super) fn beside(data: &Path) -> Self {
        Self::Files(Files::beside(data))
    }

    /// The list as it is now; `None` if there is none.
    pub(super) fn read(&self) -> Result<Option<Vec<TokenRecord>>, AuthError> {
        match self {
            Self::Files(files) => files.read(),
            Self::Shared(documents) => shared::read(&**documents),
        }
    }

    /// The list as it was known at the last look, without asking anybody.
    pub(super) fn known(&self) -> Result<Option<Vec<TokenRecord>>, AuthError> {
        match self {
            Self::Files(files) => files.read(),
            Self::Shared(documents) => shared::known(&**documents),
        }
    }

    /// Which state of the list is there; `None` if there is none.
    pub(super) fn mark(&self) -> Result<Option<Mark>, AuthError> {
        match self {
            Self::Files(files) => files.mark(),
            Self::Shared(documents) => Ok(shared::mark(&**documents)),
        }
    }

    /// Whether a token was ever created; also if that can't be told.
    pub(super) fn is_marked(&self) -> bool {
        match self {
            Self::Files(files) => files.is_marked(),
            Self::Shared(documents) => shared::mark(&**documents).is_some(),
        }
    }

    /// Marks durably that tokens are required from now on.
    pub(super) fn require(&self) -> Result<(), AuthError> {
        match self {
            Self::Files(files) => files.require(),
            Self::Shared(_) => Ok(()),
        }
    }

    /// Changes the list so that no change of anybody else is lost, and makes it durable. `change` may be asked several
    /// times; nothing changes where it or reading fails.
    pub(super) fn change<T>(
        &self,
        change: impl Fn(&mut Vec<TokenRecord>) -> Result<T, AuthError>,
    ) -> Result<T, AuthError> {
        match self {
            Self::Files(files) => files.change(change),
            Self::Shared(documents) => shared::change(&**documents, change),
        }
    }
}

/// The files.
#[derive(Debug)]
pub(super) struct Files {
    dir: PathBuf,
    list: PathBuf,
    required: PathBuf,
    lock: PathBuf,
}

impl Files {
    pub(super) fn beside(data: &Path) -> Self {
        let of = |name: &str| data.join(name);
        Self { dir: data.into(), list: of("tokens.json"), required: of("tokens.required"), lock: of("tokens.lock") }
    }

    /// The list; `None` if there is no file.
    pub(super) fn read(&self) -> Result<Option<Vec<TokenRecord>>, AuthError> {
        let bytes = match std::fs::read(&self.list) {
            Ok(bytes) => bytes,
            Err(source) if source.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(AuthError::File { path: self.list.clone(), source }),
        };
        let list = serde_json::from_slice(&bytes);
        list.map(Some).map_err(|source| AuthError::Format { path: self.list.clone(), source })
    }

    /// Which file the list stands in; `None` if there is none.
    pub(super) fn mark(&self) -> Result<Option<Mark>, AuthError> {
        match std::fs::metadata(&self.list) {
            Ok(facts) => {
                Ok(Some(Mark::File { inode: facts.ino(), length: facts.len(), modified: facts.modified().ok() }))
            }
            Err(source) if source.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => Err(AuthError::File { path: self.list.clone(), source }),
        }
    }

    /// Whether a token was ever created; also if the system doesn't tell.
    pub(super) fn is_marked(&self) -> bool {
        self.required.try_exists().unwrap_or(true)
    }

    /// Marks durably that tokens are required from now on.
    pub(super) fn require(&self) -> Result<(), AuthError> {
        if matches!(self.required.try_exists(), Ok(true)) {
            return Ok(());
        }
        let failed = |source| AuthError::File { path: self.required.clone(), source };
        let words = b"A token was created for this store: only tokens of tokens.json let anybody in.\n";
        let mut file = private(OpenOptions::new().create(true).truncate(true), &self.required).map_err(failed)?;
        file.write_all(words).and_then(|()| file.sync_all()).map_err(failed)?;
        self.sync_dir()
    }

    /// Changes the list under the lock that all processes share, and makes it durable. Nothing changes where `change` or
    /// reading fails.
    pub(super) fn change<T>(
        &self,
        change: impl FnOnce(&mut Vec<TokenRecord>) -> Result<T, AuthError>,
    ) -> Result<T, AuthError> {
        let lock = private(OpenOptions::new().create(true), &self.lock);
        let lock = lock.and_then(|file| file.lock().map(|()| file));
        // Held until the end of this function.
        let _lock = lock.map_err(|source| AuthError::File { path: self.lock.clone(), source })?;
        let mut records = self.read()?.unwrap_or_default();
        let changed = change(&mut records)?;
        self.require()?;
        self.write(&records)?;
        Ok(changed)
    }

    fn write(&self, records: &[TokenRecord]) -> Result<(), AuthError> {
        let failed = |source| AuthError::File { path: self.list.clone(), source };
        let bytes = serde_json::to_vec_pretty(records).map_err(|error| failed(error.into()))?;
        let fresh = self.list.with_extension("json.new");
        let mut file = private(OpenOptions::new().create(true).truncate(true), &fresh).map_err(failed)?;
        file.write_all(&bytes).and_then(|()| file.sync_all()).map_err(failed)?;
        std::fs::rename(&fresh, &self.list).map_err(failed)?;
        self.sync_dir()
    }

    fn sync_dir(&self) -> Result<(), AuthError> {
        let synced = File::open(&self.dir).and_then(|dir| dir.sync_all());
        synced.map_err(|source| AuthError::File { path: self.dir.clone(), source })
    }
}

/// Opens a file that only its owner may read.
fn private(options: &mut OpenOptions, path: &Path) -> std::io::Result<File> {
    options.write(true).mode(0o600).open(path)
}
