//! Writing an entry on the condition that nobody else has, and knowing what became of it.
//!
//! The engine takes a write only at the position that the writer has seen. An answer that is lost leaves it open whether
//! the write was kept; the entry is read again then, and knows by the number of its write whose it is.

use std::time::{Duration, Instant};

use quadmuse_proto::id::ExampleId;
use quadmuse_store::{ContentHash, StoreError};

use crate::corpus::{SharedCorpus, unreachable};
use crate::engine::{EngineError, Entry, Written};
use crate::manifest::Manifest;
use crate::state::Known;

/// Longest time to try a write in.
pub(crate) const TRIED: Duration = Duration::from_secs(20);
/// Pause after an answer that was lost: a leader is being elected.
pub(crate) const PAUSE: Duration = Duration::from_millis(100);

/// An entry after a write.
pub(crate) struct Kept {
    /// The example; `None` if there is none under the key.
    pub(crate) known: Option<Known>,
    /// Whether this call wrote it.
    pub(crate) written: bool,
}

/// A number for a write, which no other has: the random end of an id.
fn number() -> u64 {
    let [.., a, b, c, d, e, f, g, h] = ExampleId::generate().to_bytes();
    u64::from_le_bytes([a, b, c, d, e, f, g, h])
}

impl SharedCorpus {
    /// Changes the entry of `identity` to what `decide` makes of it, which is asked again whenever somebody else was faster;
    /// `None` leaves it as it is. `guess` is a position at which there is likely nothing but what was removed: then nothing is
    /// read first.
    pub(crate) fn commit(
        &self,
        identity: ContentHash,
        guess: Option<u64>,
        decide: impl Fn(Option<&Manifest>) -> Result<Option<Manifest>, StoreError>,
    ) -> Result<Kept, StoreError> {
        let key = Manifest::key(identity);
        let write = number();
        let begun = Instant::now();
        let mut seen = guess.map(|position| (Entry { position, ..Entry::NONE }, None));
        let mut failed = None;
        while begun.elapsed() < TRIED {
            let (there, now) = match seen.take() {
                Some(seen) => seen,
                None => match self.read_entry(&key) {
                    Ok(entry) => entry,
                    Err(error @ StoreError::Unreachable { .. }) => {
                        failed = Some(error);
                        std::thread::sleep(PAUSE);
                        continue;
                    }
                    Err(error) => return Err(error),
                },
            };
            if now.as_ref().is_some_and(|now| now.writes.contains(&write)) {
                self.inner.wrote(&key, &there);
                return Ok(Kept { known: self.known(identity), written: true });
            }
            let next = match decide(now.as_ref())? {
                None => return Ok(Kept { known: self.known(identity), written: false }),
                Some(next) => next.written(write, now.as_ref()),
            };
            let bytes = next.to_bytes()?;
            match self.engine.write(&key, there.position, &bytes) {
                Ok(Written::At(position)) => {
                    self.inner.wrote(&key, &Entry { position, bytes });
                    return Ok(Kept { known: self.known(identity), written: true });
                }
                // Read what is there now.
                Ok(Written::Elsewhere) => {}
                Err(error @ EngineError::Silent { .. }) => {
                    failed = Some(unreachable("keep an entry")(error));
                    std::thread::sleep(PAUSE);
                }
                Err(error) => return Err(unreachable("keep an entry")(error)),
            }
        }
        let crowded = || StoreError::Busy;
        Err(failed.unwrap_or_else(crowded))
    }

    /// Reads an entry as it is now, and takes it in; [`Entry::NONE`] if there is none.
    fn read_entry(&self, key: &str) -> Result<(Entry, Option<Manifest>), StoreError> {
        let Some(entry) = self.read_newest(key, "give an entry")? else {
            return Ok((Entry::NONE, None));
        };
        self.inner.take_in(&[(key, &entry)]);
        let manifest = Manifest::from_bytes(&entry.bytes).map_err(|found| StoreError::Invalid {
            field: "an entry of the corpus",
            expected: "that this release can read".into(),
            found,
        })?;
        Ok((entry, Some(manifest)))
    }

    /// The newest value of a key. A node that has just been elected, or still takes itself for the leader, answers with
    /// less than was acknowledged: an answer older than what this server knows counts as none.
    pub(crate) fn read_newest(&self, key: &str, doing: &'static str) -> Result<Option<Entry>, StoreError> {
        let known = self.inner.state().position(key);
        let entry = self.engine.read(key).map_err(unreachable(doing))?;
        let found = entry.as_ref().map_or(0, |entry| entry.position);
        if found < known {
            let reason = format!("its leader stands at {found} where {known} was acknowledged");
            return Err(StoreError::Unreachable { doing, reason });
        }
        Ok(entry)
    }

    fn known(&self, identity: ContentHash) -> Option<Known> {
        self.inner.state().by_identity(identity).cloned()
    }
}
