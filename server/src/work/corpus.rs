//! The seam to the corpus: get, put, list by id and by content, and follow what changes.
//!
//! [`stored::StoredCorpus`] is it in earnest, on any backend of `quadmuse-store`: a store on this machine's disk, or a corpus
//! that servers share.
//!
//! All methods block and are called from a blocking thread or from the pool, never from a tokio worker.

use super::engine::{Cut, PackedEncoding, SegmentFacts};
use bytes::Bytes;
use quadmuse_kernel::register::spectra::Row;
use quadmuse_proto::{Example, ExampleId, ExamplePatch, MeshCounts};
use quadmuse_store::{Changes, Following};
use std::collections::HashMap;
use std::sync::Arc;
use tokio::sync::watch;

#[cfg(test)]
pub(crate) mod memory;
pub mod stored;

/// Why the corpus refused or failed.
#[derive(Debug, thiserror::Error)]
pub enum CorpusError {
    /// No such example (never added, or removed).
    #[error("expected an example of the corpus, found none with the id {0}; list the corpus for the ids it holds")]
    NotFound(ExampleId),
    /// A value is outside the corpus's limits.
    #[error("{0}")]
    Invalid(String),
    /// The disk is full; reads go on.
    #[error("{0}")]
    Full(String),
    /// The disk is failing; reads go on.
    #[error("{0}")]
    ReadOnly(String),
    /// Too many writes are waiting.
    #[error("expected room in the queue of writes, found it full; try again shortly")]
    Busy,
    /// The bytes of an example are damaged; the others are served.
    #[error("{0}")]
    Damaged(String),
    /// An encoding is missing or damaged; it is made anew in the background.
    #[error("{0}")]
    NoEncoding(String),
    /// The record was changed since the caller read it.
    #[error("{0}")]
    Conflict(String),
    /// The engine that servers share doesn't answer; reads go on.
    #[error("{0}")]
    Unreachable(String),
    /// The store failed.
    #[error("expected the store to answer; see the cause")]
    Failed(#[source] Box<dyn std::error::Error + Send + Sync>),
}

/// An example to add, whole.
#[derive(Clone, Debug)]
pub struct NewExample {
    /// Its name.
    pub name: String,
    /// Its tags.
    pub tags: Vec<String>,
    /// Its relevance, 0–5.
    pub relevance: f64,
    /// The bytes as uploaded.
    pub bytes: Bytes,
    /// Its format, as in `?format=`.
    pub format: String,
    /// How it was cut.
    pub cut: Cut,
    /// What it is made of.
    pub counts: MeshCounts,
    /// What was repaired.
    pub repairs: Vec<String>,
    /// Its segments, encoded.
    pub segments: Vec<PackedEncoding>,
    /// The version of the encoder.
    pub encoder_version: u32,
}

/// Tells whether an example was added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PutOutcome {
    /// It is new.
    Added,
    /// The same bytes, cut the same way, were there already.
    There,
}

/// A segment as it is resident.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptRow {
    /// Its number.
    pub segment: u32,
    /// What is known of it.
    pub facts: SegmentFacts,
    /// Its coarsest picture; `None` where the server holds another share of the corpus.
    pub row: Option<Row>,
}

/// How the corpus is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CorpusHealth {
    /// Why writes are refused, if they are.
    pub read_only: Option<String>,
    /// Examples set aside because their bytes are damaged.
    pub quarantined: Vec<ExampleId>,
}

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CorpusCheck {
    /// Examples read.
    pub examples: u64,
    /// Encodings read.
    pub segments: u64,
    /// Bytes read.
    pub bytes: u64,
    /// What is wrong, a sentence each.
    pub problems: Vec<String>,
}

/// The corpus.
pub trait Corpus: Send + Sync + 'static {
    /// Adds an example; durable when it returns.
    ///
    /// # Errors
    /// [`CorpusError::Invalid`], [`CorpusError::ReadOnly`], [`CorpusError::Busy`], [`CorpusError::Failed`].
    fn put(&self, new: NewExample) -> Result<(Arc<Example>, PutOutcome), CorpusError>;

    /// The example that these bytes, cut this way, are already.
    fn find(&self, bytes: &[u8], cut: &Cut) -> Option<Arc<Example>>;

    /// An example.
    ///
    /// # Errors
    /// [`CorpusError::NotFound`].
    fn get(&self, id: ExampleId) -> Result<Arc<Example>, CorpusError>;

    /// All examples, in order of creation.
    fn list(&self) -> Vec<Arc<Example>>;

    /// Annotates an example.
    ///
    /// # Errors
    /// As [`Corpus::put`], [`CorpusError::NotFound`], and [`CorpusError::Conflict`] if the patch names another revision.
    fn annotate(&self, id: ExampleId, patch: &ExamplePatch) -> Result<Arc<Example>, CorpusError>;

    /// Removes an example.
    ///
    /// # Errors
    /// [`CorpusError::NotFound`], [`CorpusError::Failed`].
    fn remove(&self, id: ExampleId) -> Result<(), CorpusError>;

    /// The bytes as uploaded.
    ///
    /// # Errors
    /// [`CorpusError::NotFound`], [`CorpusError::Damaged`], [`CorpusError::Failed`].
    fn bytes(&self, id: ExampleId) -> Result<Bytes, CorpusError>;

    /// How an example was cut.
    ///
    /// # Errors
    /// As [`Corpus::bytes`].
    fn cut(&self, id: ExampleId) -> Result<Cut, CorpusError>;

    /// An encoding with one level of its pyramid, of `level` pixels a side.
    ///
    /// # Errors
    /// [`CorpusError::NotFound`], [`CorpusError::NoEncoding`], [`CorpusError::Failed`].
    fn encoding(&self, id: ExampleId, segment: u32, level: u32) -> Result<PackedEncoding, CorpusError>;

    /// Stores an encoding made anew, with the counts of its mesh.
    ///
    /// # Errors
    /// As [`Corpus::put`], and [`CorpusError::NotFound`].
    fn put_encoding(
        &self,
        id: ExampleId,
        segment: u32,
        packed: &PackedEncoding,
        counts: MeshCounts,
        version: u32,
    ) -> Result<(), CorpusError>;

    /// The rows that were written down and still hold, by example; only once, when the corpus is brought in.
    fn take_rows(&self) -> HashMap<ExampleId, Vec<KeptRow>> {
        HashMap::new()
    }

    /// The rows that came with a change of an example, if all of them did; only once.
    fn rows_of(&self, _id: ExampleId) -> Option<Vec<KeptRow>> {
        None
    }

    /// Writes rows down for the next start, in place of those before. What is lost of them is made from the encodings.
    ///
    /// # Errors
    /// [`CorpusError::ReadOnly`], [`CorpusError::Failed`].
    fn keep_rows(&self, _rows: &mut dyn Iterator<Item = (ExampleId, KeptRow)>) -> Result<(), CorpusError> {
        Ok(())
    }

    /// Reads everything, and changes nothing.
    ///
    /// # Errors
    /// [`CorpusError::Failed`].
    fn check(&self) -> Result<CorpusCheck, CorpusError> {
        Ok(CorpusCheck::default())
    }

    /// Checks one example, mends what can be and sets aside what can't; what was found, a sentence each.
    ///
    /// # Errors
    /// [`CorpusError::Failed`].
    fn scrub(&self, _id: ExampleId) -> Result<Vec<String>, CorpusError> {
        Ok(Vec::new())
    }

    /// Writes the corpus as it is at this moment; which examples were left out, and why.
    ///
    /// # Errors
    /// [`CorpusError::Failed`].
    fn backup(&self, _to: &mut dyn std::io::Write) -> Result<Vec<(ExampleId, String)>, CorpusError> {
        Ok(Vec::new())
    }

    /// Segments without an encoding of the encoder's version.
    fn stale(&self, version: u32) -> Vec<(ExampleId, u32)>;

    /// What changed after `position`, whoever changed it.
    fn changes(&self, position: u64) -> Changes;

    /// The position of the newest change; 0 before the first.
    fn watch(&self) -> watch::Receiver<u64>;

    /// The newest change that is known here, by a number that all servers count alike; 0 where nobody else writes.
    fn reached(&self) -> u64 {
        0
    }

    /// Waits until a change with such a number is known here, for `time` at most. Blocks.
    fn wait_for(&self, _position: u64, _time: std::time::Duration) {}

    /// How well it knows what other servers changed.
    fn following(&self) -> Following {
        Following::default()
    }

    /// How it is.
    fn health(&self) -> CorpusHealth;
}
