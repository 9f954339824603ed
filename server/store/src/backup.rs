//! A logical export: every example with its mesh, record and packed encodings, in one stream. It is also the way from one format of the index to another.
//!
//! The stream is a row of frames (see `frame`): a head; for each example its record, its objects in pieces, for each segment a head and its
//! parts in pieces, and an end; a tail that counts the examples and holds the hash of all frames before it, so that a frame that is missing,
//! doubled or out of its place is noticed. Encodings are copied as they are packed: a restored corpus ranks as before, bit for bit.

use std::io::{Read, Write};
use std::path::Path;

use quadmuse_proto::id::ExampleId;
use serde::{Deserialize, Serialize};

use crate::derived::{PART_BYTES_MAX, Part, PartKind};
use crate::error::StoreError;
use crate::files;
use crate::frame::{self, FRAME_OVERHEAD};
use crate::record::{ContentHash, ExampleRecord, validate};
use crate::recover::OpenReport;
use crate::shared::OpenOptions;
use crate::store::{RESTORING, Store};
use crate::writer::Packed;

const FORMAT: u32 = 1;
const HEAD: [u8; 4] = *b"QMBH";
const RECORD: [u8; 4] = *b"QMBR";
const OBJECT: [u8; 4] = *b"QMBO";
const SEGMENT: [u8; 4] = *b"QMBS";
const PART: [u8; 4] = *b"QMBP";
const EXAMPLE_END: [u8; 4] = *b"QMBX";
const TAIL: [u8; 4] = *b"QMBE";
/// Bytes of an object or part in one frame.
const PIECE: usize = 1 << 20;
/// More bytes than any frame's payload has.
const PAYLOAD_MAX: u64 = 32 << 20;

#[derive(Serialize, Deserialize)]
struct Head {
    format: u32,
    examples: u64,
}

#[derive(Serialize, Deserialize)]
struct SegmentHead {
    segment: u32,
    encoder_version: u32,
}

#[derive(Serialize, Deserialize)]
struct Tail {
    examples: u64,
    hash: ContentHash,
}

/// What a backup came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BackupReport {
    /// Examples written.
    pub examples: usize,
    /// Encodings written.
    pub segments: usize,
    /// Bytes written.
    pub bytes: u64,
    /// Examples left out because their ground state is damaged, and how.
    pub skipped: Vec<(ExampleId, String)>,
}

struct Out<'a> {
    writer: &'a mut dyn Write,
    hash: blake3::Hasher,
    bytes: u64,
}

impl Out<'_> {
    fn frame(&mut self, magic: [u8; 4], payload: &[u8]) -> Result<(), StoreError> {
        let bytes = frame::frame(magic, payload);
        self.hash.update(&bytes);
        self.bytes += bytes.len() as u64;
        self.writer.write_all(&bytes).map_err(StoreError::io("write", Path::new("the backup")))
    }

    fn value(&mut self, magic: [u8; 4], value: &impl Serialize) -> Result<(), StoreError> {
        let bytes = rmp_serde::to_vec_named(value)
            .map_err(|error| StoreError::Backup { found: error.to_string(), at: self.bytes })?;
        self.frame(magic, &bytes)
    }

    /// Writes `bytes` in pieces, each with `tag` before it; at least one piece.
    fn pieces(&mut self, magic: [u8; 4], tag: u8, bytes: &[u8]) -> Result<(), StoreError> {
        let mut rest = bytes;
        loop {
            let (piece, next) = rest.split_at(rest.len().min(PIECE));
            self.frame(magic, &[&[tag], piece].concat())?;
            if next.is_empty() {
                return Ok(());
            }
            rest = next;
        }
    }
}

impl Store {
    /// Writes the whole corpus, as it is at this moment, to `writer`. The service goes on meanwhile.
    ///
    /// # Errors
    /// [`StoreError::Io`] if writing or reading fails; [`StoreError::ReadOnly`] while there is no open index.
    pub fn backup(&self, writer: &mut dyn Write) -> Result<BackupReport, StoreError> {
        let mut report = BackupReport { skipped: self.quarantined(), ..BackupReport::default() };
        let snapshot = self.snapshot();
        let mut out = Out { writer, hash: blake3::Hasher::new(), bytes: 0 };
        out.value(HEAD, &Head { format: FORMAT, examples: snapshot.examples.len() as u64 })?;
        for record in &snapshot.examples {
            self.backup_example(record, &mut out, &mut report)?;
        }
        let hash = ContentHash::from_bytes(*out.hash.finalize().as_bytes());
        out.value(TAIL, &Tail { examples: report.examples as u64, hash })?;
        out.writer.flush().map_err(StoreError::io("write", Path::new("the backup")))?;
        report.bytes = out.bytes;
        Ok(report)
    }

    fn backup_example(
        &self,
        record: &ExampleRecord,
        out: &mut Out<'_>,
        report: &mut BackupReport,
    ) -> Result<(), StoreError> {
        let id = record.id;
        let objects: Result<Vec<_>, StoreError> = record.objects().map(|object| self.object(id, object)).collect();
        let objects = match objects {
            Ok(objects) => objects,
            Err(StoreError::Quarantined { reason, .. }) => {
                report.skipped.push((id, reason));
                return Ok(());
            }
            // Removed since the snapshot was taken.
            Err(StoreError::NotFound { .. }) => return Ok(()),
            Err(error) => return Err(error),
        };
        out.frame(RECORD, &files::encode(record)?)?;
        for (number, bytes) in (0u8..).zip(&objects) {
            out.pieces(OBJECT, number, bytes)?;
        }
        for segment in 0..record.segments.len() as u32 {
            report.segments += usize::from(self.backup_segment(id, segment, out)?);
        }
        report.examples += 1;
        out.frame(EXAMPLE_END, &[])
    }

    /// Writes an encoding, unless it is damaged: then it is computed again where it is restored. Whether it was written.
    fn backup_segment(&self, id: ExampleId, segment: u32, out: &mut Out<'_>) -> Result<bool, StoreError> {
        let Some(pointer) = self.shared().index().pointer((id, segment)).cloned() else { return Ok(false) };
        let engine = self.shared().engine()?;
        let part = |kind| Some((kind, engine.part((id, segment), &pointer, kind).ok()?.ok()?));
        let Some(parts) = pointer.kinds().map(part).collect::<Option<Vec<(PartKind, Vec<u8>)>>>() else {
            return Ok(false);
        };
        out.value(SEGMENT, &SegmentHead { segment, encoder_version: pointer.encoder_version })?;
        for (kind, bytes) in parts {
            out.pieces(PART, kind.0, &bytes)?;
        }
        Ok(true)
    }

    /// Restores a backup into `dir`, which must hold no examples yet: all of it or nothing. Until it is whole a mark stands
    /// there that no service starts beside; a restore into the same directory begins anew.
    ///
    /// # Errors
    /// [`StoreError::Backup`] for a damaged or cut one, [`StoreError::NotEmpty`], and whatever opening and adding fail with.
    pub fn restore(
        dir: &Path,
        options: &OpenOptions,
        reader: &mut dyn Read,
    ) -> Result<(Store, OpenReport), StoreError> {
        let mark = dir.join(RESTORING);
        if mark.exists() {
            // What an interrupted restore left, and nothing else: it began in an empty store.
            for name in ["objects", "ground", "index", "quarantined"] {
                crate::recover::remove_tree(&dir.join(name))?;
            }
        }
        let restoring = OpenOptions { restores: true, ..options.clone() };
        let (store, report) = Store::open(dir, &restoring)?;
        let examples = report.examples + report.quarantined.len();
        if examples > 0 {
            return Err(StoreError::NotEmpty { examples });
        }
        std::fs::write(&mark, "A restore into this store has not ended.\n").map_err(StoreError::io("write", &mark))?;
        files::sync_dir(dir)?;
        let mut input = In { reader, hash: blake3::Hasher::new(), at: 0 };
        input.restore(&store)?;
        // A first opening after many writes replays them: do it here, not in the service.
        drop(store);
        let opened = Store::open(dir, &restoring)?;
        std::fs::remove_file(&mark).map_err(StoreError::io("remove", &mark))?;
        files::sync_dir(dir)?;
        Ok(opened)
    }
}

struct In<'a> {
    reader: &'a mut dyn Read,
    hash: blake3::Hasher,
    at: u64,
}

/// An example while it is read.
struct Pending {
    record: ExampleRecord,
    objects: Vec<Vec<u8>>,
    segments: Vec<(SegmentHead, Vec<Part>)>,
}

impl In<'_> {
    fn bad<T>(&self, found: impl Into<String>) -> Result<T, StoreError> {
        Err(StoreError::Backup { found: found.into(), at: self.at })
    }

    fn parse<T: for<'de> Deserialize<'de>>(&self, payload: &[u8]) -> Result<T, StoreError> {
        rmp_serde::from_slice(payload).or_else(|error| self.bad(error.to_string()))
    }

    /// The next frame, and its bytes as they are hashed.
    fn frame(&mut self) -> Result<([u8; 4], Vec<u8>), StoreError> {
        let mut head = [0; 12];
        self.reader.read_exact(&mut head).or_else(|error| self.bad(format!("its end too soon ({error})")))?;
        let [m0, m1, m2, m3, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if length > PAYLOAD_MAX {
            return self.bad(format!("a frame of {length} bytes"));
        }
        let rest = length + (FRAME_OVERHEAD - head.len()) as u64;
        let mut bytes = head.to_vec();
        let read = self.reader.take(rest).read_to_end(&mut bytes).or_else(|error| self.bad(error.to_string()))?;
        if read as u64 != rest {
            return self.bad("its end too soon");
        }
        Ok(([m0, m1, m2, m3], bytes))
    }

    /// The payload of the next frame, and the hash of all frames before it.
    fn payload(&mut self) -> Result<([u8; 4], Vec<u8>, ContentHash), StoreError> {
        let (magic, bytes) = self.frame()?;
        let before = ContentHash::from_bytes(*self.hash.finalize().as_bytes());
        let payload = frame::unframe(magic, &bytes).or_else(|reason| self.bad(reason))?.to_vec();
        self.hash.update(&bytes);
        self.at += bytes.len() as u64;
        Ok((magic, payload, before))
    }

    fn restore(&mut self, store: &Store) -> Result<(), StoreError> {
        let (magic, head, _) = self.payload()?;
        if magic != HEAD {
            return self.bad("no head of a backup");
        }
        let head: Head = self.parse(&head)?;
        if head.format > FORMAT {
            return self.bad(format!("a backup of format {}, newer than {FORMAT}", head.format));
        }
        let mut pending: Option<Pending> = None;
        let mut examples = 0;
        loop {
            let (magic, payload, before) = self.payload()?;
            match (magic, &mut pending) {
                (RECORD, None) => {
                    let record: ExampleRecord = self.parse(&payload)?;
                    validate(&record)?;
                    pending = Some(Pending { record, objects: Vec::new(), segments: Vec::new() });
                }
                (OBJECT, Some(pending)) => self.object(pending, &payload)?,
                (SEGMENT, Some(pending)) => pending.segments.push((self.parse(&payload)?, Vec::new())),
                (PART, Some(pending)) => self.part(pending, &payload)?,
                (EXAMPLE_END, Some(_)) => {
                    pending.take().map_or(Ok(()), |pending| self.commit(store, pending))?;
                    examples += 1;
                }
                (TAIL, None) => {
                    let tail: Tail = self.parse(&payload)?;
                    return if tail.examples == examples && tail.hash == before {
                        Ok(())
                    } else {
                        self.bad("a part missing or out of place")
                    };
                }
                _ => return self.bad("a frame out of place"),
            }
        }
    }

    fn object(&self, pending: &mut Pending, payload: &[u8]) -> Result<(), StoreError> {
        let Some((&number, piece)) = payload.split_first() else { return self.bad("an empty piece") };
        if pending.objects.len() == usize::from(number) {
            pending.objects.push(Vec::new());
        }
        match pending.objects.get_mut(usize::from(number)) {
            Some(object) => object.extend_from_slice(piece),
            None => return self.bad("a piece out of place"),
        }
        Ok(())
    }

    fn part(&self, pending: &mut Pending, payload: &[u8]) -> Result<(), StoreError> {
        let (Some((&kind, piece)), Some((_, parts))) = (payload.split_first(), pending.segments.last_mut()) else {
            return self.bad("a piece out of place");
        };
        match parts.last_mut().filter(|part| part.kind == PartKind(kind)) {
            Some(part) if part.bytes.len() + piece.len() <= PART_BYTES_MAX => part.bytes.extend_from_slice(piece),
            Some(_) => return self.bad("too long a part"),
            None => parts.push(Part { kind: PartKind(kind), bytes: piece.to_vec() }),
        }
        Ok(())
    }

    fn commit(&self, store: &Store, pending: Pending) -> Result<(), StoreError> {
        let Pending { record, objects, segments } = pending;
        let hashes: Vec<ContentHash> = record.objects().collect();
        if hashes != objects.iter().map(|object| ContentHash::of(object)).collect::<Vec<_>>() {
            return self.bad(format!("the mesh of {} not matching its hash", record.id));
        }
        if segments.iter().any(|(head, _)| head.segment as usize >= record.segments.len()) {
            return self.bad(format!("an encoding of a segment {} doesn't have", record.id));
        }
        let mut objects = objects.into_iter();
        let mesh = objects.next().unwrap_or_default();
        let packed = |(head, parts): (SegmentHead, _)| (head.segment, Packed::new(head.encoder_version, parts));
        store.add_packed(record, &mesh, objects.next().as_deref(), segments.into_iter().map(packed).collect())?;
        Ok(())
    }
}
