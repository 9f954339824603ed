//! Jobs of the corpus, as its servers share them.

use std::time::Duration;

use quadmuse_store::StoreError;

use crate::corpus::{SharedCorpus, unreachable};
use crate::engine::Job;

impl SharedCorpus {
    /// Adds a job; whether it was added: of a kind and a name one waits, or is being done, at a time. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`], [`StoreError::EngineFull`].
    pub fn add_job(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, StoreError> {
        self.engine.add_job(kind, name, payload).map_err(unreachable("take a job"))
    }

    /// Takes a job of a kind; `None` if there is none within `wait`. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`].
    pub fn take_job(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, StoreError> {
        self.engine.take_job(kind, wait).map_err(unreachable("give a job"))
    }

    /// Jobs that wait or are being done. Blocks.
    ///
    /// # Errors
    /// [`StoreError::Unreachable`].
    pub fn jobs(&self) -> Result<u64, StoreError> {
        self.engine.jobs().map_err(unreachable("count its jobs"))
    }
}
