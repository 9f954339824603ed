//! Rows: what a search keeps in memory of each segment, written down in one file so that a start reads them in one go.
//!
//! They are derived from the encodings, which stay in the index: a row holds only as long as its segment's encoding is the
//! one it was made of, and one that is lost, damaged or outdated is made anew. So the file is written without a sync, and
//! is no part of the store's schema.
//!
//! `rows`: frames (see `frame`) of `magic ‖ count` entries, each `id 16 ‖ segment u32 LE ‖ generation 16 ‖ length u32 LE ‖
//! bytes`, behind `length u64 LE` of the frame.

use std::fs::{self, File};
use std::io::{BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::Path;

use quadmuse_proto::id::ExampleId;

use crate::error::StoreError;
use crate::frame;
use crate::keys::{GENERATION_BYTES, Generation, SegmentKey};
use crate::{Store, keys};

const ROWS_FILE: &str = "rows";
const ROWS_TEMPORARY: &str = "rows.new";
const MAGIC: [u8; 4] = *b"QMR1";
/// Bytes that are checked together; one that is flipped costs so many.
const FRAME_BYTES: usize = 1 << 20;
/// More than a frame ever has.
const FRAME_BYTES_MAX: u64 = 64 << 20;
const HEAD: usize = 16 + 4 + GENERATION_BYTES + 4;

/// A segment's number and its row, as the server wrote it.
pub type SegmentRow = (u32, Vec<u8>);

impl Store {
    /// The rows that still hold, in no order. What can't be read is left out.
    pub fn rows(&self) -> Vec<(ExampleId, SegmentRow)> {
        let path = self.shared().dir.join(ROWS_FILE);
        let mut found = Vec::new();
        if let Err(error) = read(&path, &mut |key, generation, bytes| {
            let index = self.shared().index();
            if index.pointer(key).is_some_and(|pointer| pointer.generation() == generation) {
                found.push((key.0, (key.1, bytes.to_vec())));
            }
        }) {
            tracing::warn!(%error, "the rows can't be read; they are made anew");
        }
        found
    }

    /// Writes rows in place of those before.
    ///
    /// # Errors
    /// [`StoreError::Full`], [`StoreError::Io`]; those before stay then.
    pub fn put_rows(&self, rows: &mut dyn Iterator<Item = (ExampleId, SegmentRow)>) -> Result<(), StoreError> {
        self.shared().check_space(0)?;
        let path = self.shared().dir.join(ROWS_TEMPORARY);
        let written = write(&path, rows, &|key| self.shared().index().pointer(key).map(|pointer| pointer.generation()));
        let named = written.and_then(|()| fs::rename(&path, self.shared().dir.join(ROWS_FILE)));
        named.map_err(|error| {
            // What is left of it is written over the next time.
            let _ = fs::remove_file(&path);
            StoreError::io("write", &path)(error)
        })
    }
}

fn write(
    path: &Path,
    rows: &mut dyn Iterator<Item = (ExampleId, SegmentRow)>,
    generation_of: &dyn Fn(SegmentKey) -> Option<Generation>,
) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    let mut payload = Vec::with_capacity(FRAME_BYTES + (16 << 10));
    let mut flush = |payload: &mut Vec<u8>| {
        let framed = frame::frame(MAGIC, payload);
        file.write_all(&(framed.len() as u64).to_le_bytes())?;
        file.write_all(&framed)?;
        payload.clear();
        file.flush()
    };
    for (id, (segment, bytes)) in rows {
        let Some(generation) = generation_of((id, segment)) else { continue };
        payload.extend_from_slice(&id.to_bytes());
        payload.extend_from_slice(&segment.to_le_bytes());
        payload.extend_from_slice(&generation.0);
        payload.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
        payload.extend_from_slice(&bytes);
        if payload.len() >= FRAME_BYTES {
            flush(&mut payload)?;
        }
    }
    if payload.is_empty() { Ok(()) } else { flush(&mut payload) }
}

fn read(path: &Path, visit: &mut dyn FnMut(SegmentKey, Generation, &[u8])) -> std::io::Result<()> {
    let mut file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        opened => BufReader::new(opened?),
    };
    let mut length = [0; 8];
    while file.read_exact(&mut length).is_ok() {
        let length = u64::from_le_bytes(length);
        if length > FRAME_BYTES_MAX {
            return Err(std::io::Error::new(ErrorKind::InvalidData, "an impossible length"));
        }
        let mut framed = Vec::new();
        file.by_ref().take(length).read_to_end(&mut framed)?;
        match frame::unframe(MAGIC, &framed) {
            Ok(payload) => entries(payload, visit),
            Err(reason) => tracing::warn!(reason, "a frame of rows is damaged; they are made anew"),
        }
    }
    Ok(())
}

fn entries(mut payload: &[u8], visit: &mut dyn FnMut(SegmentKey, Generation, &[u8])) {
    while let Some((head, rest)) = payload.split_first_chunk::<HEAD>() {
        let (key, tail) = head.split_at(16 + 4);
        let (generation, length) = tail.split_at(GENERATION_BYTES);
        let (Some((id, segment)), Ok(generation), Ok(length)) =
            (key.split_first_chunk::<16>(), generation.try_into(), <[u8; 4]>::try_from(length))
        else {
            return;
        };
        let segment = <[u8; 4]>::try_from(segment).map_or(0, u32::from_le_bytes);
        let Some((bytes, after)) = rest.split_at_checked(u32::from_le_bytes(length) as usize) else { return };
        visit((ExampleId::from_bytes(*id), segment), keys::Generation(generation), bytes);
        payload = after;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_and_a_damaged_frame_takes_only_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rows");
        let rows: Vec<(ExampleId, SegmentRow)> =
            (0..2000u32).map(|k| (ExampleId::generate(), (k, vec![k as u8; 1500]))).collect();
        let made = Generation([5; GENERATION_BYTES]);
        write(&path, &mut rows.clone().into_iter(), &|key| (key.1 != 7).then_some(made)).unwrap();
        let back = || {
            let mut back = Vec::new();
            read(&path, &mut |key, generation, bytes| {
                assert!(generation == made);
                back.push((key.0, (key.1, bytes.to_vec())));
            })
            .unwrap();
            back
        };
        let expected: Vec<_> = rows.iter().filter(|row| row.1.0 != 7).cloned().collect();
        assert_eq!(back(), expected);
        let mut bytes = fs::read(&path).unwrap();
        bytes[1000] ^= 1;
        fs::write(&path, &bytes).unwrap();
        let left = back();
        assert!(left.len() > 1000 && left.len() < 1500 && expected.ends_with(&left));
        fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
        assert!(back().len() < left.len());
    }
}
