//! Small documents beside the corpus, for those who need no more of it than these.

use std::sync::Arc;
use std::time::Instant;

use quadmuse_store::{Document, Documents, StoreError};

use crate::corpus::unreachable;
use crate::engine::{Engine, Entry, Written};
use crate::manifest::DOCUMENT;
use crate::write::{PAUSE, TRIED};

/// Longest document, in bytes.
const BYTES_MAX: usize = 512 << 10;

/// The documents of a corpus, each asked of the engine when it is needed.
pub struct SharedDocuments {
    engine: Arc<dyn Engine>,
}

impl SharedDocuments {
    /// Those on this engine.
    pub fn on(engine: Arc<dyn Engine>) -> Self {
        Self { engine }
    }
}

impl Documents for SharedDocuments {
    /// Nothing is known without asking.
    fn known(&self, _name: &str) -> Option<Document> {
        None
    }

    fn read(&self, name: &str) -> Result<Option<Document>, StoreError> {
        let found = self.engine.read(&format!("{DOCUMENT}{name}")).map_err(unreachable("give a document"))?;
        Ok(found.map(document))
    }

    fn write(&self, name: &str, expected: u64, bytes: &[u8]) -> Result<bool, StoreError> {
        Ok(write(&*self.engine, name, expected, bytes)?.is_some())
    }
}

/// A document from its entry.
pub(crate) fn document(entry: Entry) -> Document {
    Document { revision: entry.position, bytes: entry.bytes.into() }
}

/// Writes a document; its revision, or `None` if it has another one than expected.
pub(crate) fn write(engine: &dyn Engine, name: &str, expected: u64, bytes: &[u8]) -> Result<Option<u64>, StoreError> {
    if bytes.len() > BYTES_MAX {
        let (expected, found) = (format!("of at most {BYTES_MAX} bytes"), bytes.len().to_string());
        return Err(StoreError::Invalid { field: "a document", expected, found });
    }
    let key = format!("{DOCUMENT}{name}");
    let begun = Instant::now();
    let mut is_repeated = false;
    loop {
        let silent = match engine.write(&key, expected, bytes) {
            Ok(Written::At(position)) => return Ok(Some(position)),
            // The first of two may have been kept, and its answer lost.
            Ok(Written::Elsewhere) if is_repeated => match engine.read(&key) {
                Ok(found) => {
                    let own = found.filter(|entry| entry.position > expected && entry.bytes == bytes);
                    return Ok(own.map(|entry| entry.position));
                }
                Err(error) => unreachable("give a document")(error),
            },
            Ok(Written::Elsewhere) => return Ok(None),
            Err(error) => unreachable("keep a document")(error),
        };
        if begun.elapsed() > TRIED {
            return Err(silent);
        }
        is_repeated = true;
        std::thread::sleep(PAUSE);
    }
}
