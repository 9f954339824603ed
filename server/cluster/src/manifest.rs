//! The entry of an example: all that is known of it but its objects, in one value, so that it changes at once or not at all.
//!
//! Its key is the example's identity (the hash of its mesh and of the options that matter), so that the same example added
//! on two servers at once is one entry. A removed example leaves an entry without a record.

use quadmuse_store::{ContentHash, ExampleRecord, SegmentRow, StoreError};
use serde::{Deserialize, Serialize};
use serde_bytes::ByteBuf;

/// The shape of the values. A server refuses to follow one that is newer.
pub(crate) const SCHEMA: u32 = 1;
/// Longest value, in bytes: what the engine takes in one message, and answers in one in base64.
pub(crate) const BYTES_MAX: usize = 600 << 10;
/// Writes that an entry remembers.
const WRITES_MAX: usize = 32;
/// What the keys of examples begin with.
pub(crate) const EXAMPLE: &str = "example.";
/// What the keys of documents begin with.
pub(crate) const DOCUMENT: &str = "document.";

/// The encoding of a segment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SegmentEntry {
    pub(crate) encoder_version: u32,
    /// The object that holds it, packed.
    pub(crate) object: ContentHash,
    /// Length of that object, in bytes.
    pub(crate) bytes: u64,
    /// The row that a search keeps of it; opaque here.
    #[serde(default)]
    pub(crate) row: Option<ByteBuf>,
}

/// The value of an example's key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Manifest {
    pub(crate) schema: u32,
    /// The latest writes, newest first: one whose answer was lost knows itself again by its number, also when others have
    /// written since.
    pub(crate) writes: Vec<u64>,
    /// `None`: it was removed.
    pub(crate) record: Option<ExampleRecord>,
    /// One a segment; `None`: it is to be encoded.
    #[serde(default)]
    pub(crate) segments: Vec<Option<SegmentEntry>>,
}

impl Manifest {
    pub(crate) fn key(identity: ContentHash) -> String {
        format!("{EXAMPLE}{identity}")
    }

    pub(crate) fn removed() -> Self {
        Self { schema: SCHEMA, writes: Vec::new(), record: None, segments: Vec::new() }
    }

    /// The same as write number `write` after `now`.
    pub(crate) fn written(self, write: u64, now: Option<&Self>) -> Self {
        let before = now.into_iter().flat_map(|now| now.writes.iter().copied());
        Self { writes: std::iter::once(write).chain(before).take(WRITES_MAX).collect(), ..self }
    }

    /// As bytes. Rows are left out where they would make it too long: then each server makes them from the encodings.
    pub(crate) fn to_bytes(&self) -> Result<Vec<u8>, StoreError> {
        let pack = |manifest: &Self| {
            rmp_serde::to_vec_named(manifest).map_err(|error| StoreError::Invalid {
                field: "an example",
                expected: "to serialise".into(),
                found: error.to_string(),
            })
        };
        let bytes = pack(self)?;
        if bytes.len() <= BYTES_MAX {
            return Ok(bytes);
        }
        let mut bare = self.clone();
        bare.segments.iter_mut().flatten().for_each(|segment| segment.row = None);
        let bytes = pack(&bare)?;
        let expected = format!("to take at most {BYTES_MAX} bytes");
        match bytes.len() {
            found if found > BYTES_MAX => {
                Err(StoreError::Invalid { field: "an example's record", expected, found: found.to_string() })
            }
            _ => Ok(bytes),
        }
    }

    /// The way back, or what is wrong with the bytes.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        #[derive(Deserialize)]
        struct Shape {
            schema: u32,
        }
        let shape: Shape = rmp_serde::from_slice(bytes).map_err(|error| error.to_string())?;
        if shape.schema > SCHEMA {
            return Err(format!("an entry of schema {}, newer than {SCHEMA}: upgrade this server", shape.schema));
        }
        rmp_serde::from_slice(bytes).map_err(|error| error.to_string())
    }

    /// The rows, each with its segment's number.
    pub(crate) fn take_rows(&mut self) -> Vec<SegmentRow> {
        let rows = (0..)
            .zip(self.segments.iter_mut())
            .filter_map(|(number, segment)| Some((number, segment.as_mut()?.row.take()?.into_vec())));
        rows.collect()
    }
}
