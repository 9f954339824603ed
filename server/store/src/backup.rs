//! A logical export: every example with its mesh, record and packed encodings, in one stream. It is also the way from one format of the index to another.
//!
//! The stream is a row of frames (see `frame`): a head; for each example its record, its objects in pieces, for each segment a head and its
//! parts in pieces, and an end; a tail that counts the examples and holds the hash of all frames before it, so that a frame that is missing,
//! doubled or out of its place is noticed. Encodings are copied as they are packed: a restored corpus ranks as before, bit for bit.

use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;

use quadmuse_proto::id::ExampleId;
use serde::{Deserialize, Serialize};

use crate::backend::{Backend, Whole};
use crate::derived::{PART_BYTES_MAX, Part, PartKind};
use crate::error::StoreError;
use crate::files;
use crate::frame::{self, FRAME_OVERHEAD};
use crate::packed::PackedSegment;
use crate::record::{ContentHash, ExampleRecord, invalid, validate};
use crate::recover::OpenReport;
use crate::shared::OpenOptions;
use crate::store::{Added, RESTORING, Store};
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

/// Writes the whole of a corpus, as it is at this moment, to `writer`; what is removed while it is written is left out. The
/// service goes on meanwhile.
///
/// # Errors
/// [`StoreError::Io`] if writing or reading fails; [`StoreError::ReadOnly`] while there is no open index;
/// [`StoreError::Unreachable`].
pub(crate) fn write(from: &dyn Backend, writer: &mut dyn Write) -> Result<BackupReport, StoreError> {
    let (skipped, snapshot) = (from.quarantined(), from.snapshot());
    write_these(&snapshot.examples, skipped, &|record| from.whole(record.id), writer)
}

/// Writes these examples to `writer`, as `whole` gives them; one that it doesn't find is left out.
///
/// # Errors
/// As [`write`].
pub fn write_these(
    records: &[Arc<ExampleRecord>],
    skipped: Vec<(ExampleId, String)>,
    whole: &dyn Fn(&ExampleRecord) -> Result<Whole, StoreError>,
    writer: &mut dyn Write,
) -> Result<BackupReport, StoreError> {
    let mut report = BackupReport { skipped, ..BackupReport::default() };
    let mut out = Out { writer, hash: blake3::Hasher::new(), bytes: 0 };
    out.value(HEAD, &Head { format: FORMAT, examples: records.len() as u64 })?;
    for record in records {
        match whole(record) {
            Ok(whole) => out.example(&Whole { record: record.clone(), ..whole }, &mut report)?,
            Err(StoreError::Quarantined { id, reason }) => report.skipped.push((id, reason)),
            // Removed since the snapshot was taken.
            Err(StoreError::NotFound { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    let hash = ContentHash::from_bytes(*out.hash.finalize().as_bytes());
    out.value(TAIL, &Tail { examples: report.examples as u64, hash })?;
    out.writer.flush().map_err(StoreError::io("write", Path::new("the backup")))?;
    report.bytes = out.bytes;
    Ok(report)
}

/// Adds all examples of a backup to a corpus, as they were; how many there are. What was added stays if it fails later.
///
/// # Errors
/// [`StoreError::Backup`] for a damaged or cut one, and whatever adding fails with.
pub fn read(to: &dyn Backend, reader: &mut dyn Read) -> Result<u64, StoreError> {
    In { reader, hash: blake3::Hasher::new(), at: 0 }.restore(to)
}

impl Out<'_> {
    fn example(&mut self, whole: &Whole, report: &mut BackupReport) -> Result<(), StoreError> {
        self.frame(RECORD, &files::encode(&whole.record)?)?;
        for (number, bytes) in (0u8..).zip(&whole.objects) {
            self.pieces(OBJECT, number, bytes)?;
        }
        for (segment, packed) in &whole.segments {
            self.value(SEGMENT, &SegmentHead { segment: *segment, encoder_version: packed.encoder_version })?;
            for part in &packed.parts {
                self.pieces(PART, part.kind.0, &part.bytes)?;
            }
        }
        report.segments += whole.segments.len();
        report.examples += 1;
        self.frame(EXAMPLE_END, &[])
    }
}

impl Store {
    /// Writes the whole corpus, as it is at this moment, to `writer`. The service goes on meanwhile.
    ///
    /// # Errors
    /// [`StoreError::Io`] if writing or reading fails; [`StoreError::ReadOnly`] while there is no open index.
    pub fn backup(&self, writer: &mut dyn Write) -> Result<BackupReport, StoreError> {
        write(self, writer)
    }

    pub(crate) fn whole(&self, id: ExampleId) -> Result<Whole, StoreError> {
        let record = self.get(id)?;
        let objects = record.objects().map(|object| self.object(id, object)).collect::<Result<_, _>>()?;
        let mut segments = Vec::with_capacity(record.segments.len());
        for segment in 0..record.segments.len() as u32 {
            segments.extend(self.packed(id, segment)?.map(|packed| (segment, packed)));
        }
        Ok(Whole { record, objects, segments })
    }

    /// A packed encoding; `None` if it is missing or damaged: then it is computed again where it goes to.
    fn packed(&self, id: ExampleId, segment: u32) -> Result<Option<PackedSegment>, StoreError> {
        let Some(pointer) = self.shared().index().pointer((id, segment)).cloned() else { return Ok(None) };
        let engine = self.shared().engine()?;
        let part = |kind| Some(Part { kind, bytes: engine.part((id, segment), &pointer, kind).ok()?.ok()? });
        let parts = pointer.kinds().map(part).collect::<Option<Vec<_>>>();
        Ok(parts.map(|parts| PackedSegment { encoder_version: pointer.encoder_version, parts }))
    }

    pub(crate) fn put_whole(&self, whole: Whole) -> Result<Added, StoreError> {
        validate(&whole.record)?;
        if let Some(fault) = whole.fault() {
            return Err(invalid("an example", "to match its record".into(), fault));
        }
        let Whole { record, objects, segments } = whole;
        let mut objects = objects.into_iter();
        let mesh = objects.next().unwrap_or_default();
        let packed =
            |(segment, packed): (u32, PackedSegment)| (segment, Packed::new(packed.encoder_version, packed.parts));
        let segments = segments.into_iter().map(packed).collect();
        self.add_packed(Arc::unwrap_or_clone(record), &mesh, objects.next().as_deref(), segments)
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
        let _examples = input.restore(&store)?;
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

    fn restore(&mut self, to: &dyn Backend) -> Result<u64, StoreError> {
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
                    pending.take().map_or(Ok(()), |pending| self.commit(to, pending))?;
                    examples += 1;
                }
                (TAIL, None) => {
                    let tail: Tail = self.parse(&payload)?;
                    return if tail.examples == examples && tail.hash == before {
                        Ok(examples)
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

    fn commit(&self, to: &dyn Backend, pending: Pending) -> Result<(), StoreError> {
        let Pending { record, objects, segments } = pending;
        let packed = |(head, parts): (SegmentHead, _)| {
            (head.segment, PackedSegment { encoder_version: head.encoder_version, parts })
        };
        let segments = segments.into_iter().map(packed).collect();
        let whole = Whole { record: Arc::new(record), objects, segments };
        if let Some(fault) = whole.fault() {
            return self.bad(fault);
        }
        to.put_whole(whole).map(drop)
    }
}
