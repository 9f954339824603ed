//! Keys of the index: big-endian, so that they sort as what they name.

use quadmuse_proto::id::{ExampleId, ID_BYTES_LEN};

use crate::derived::PartKind;

/// Payload of a chunk, in bytes: with its checksum and key a row stays below 16 KiB, and a leaf of the
/// database's tree (17 rows at most) below a quarter of a MiB. A leaf costs some 10 KB beside its rows when it is made (the node
/// above is written anew): with 3,800 bytes that was a third of what was stored.
pub(crate) const CHUNK_BYTES: usize = 15_000;
/// Length of a generation, in bytes.
pub(crate) const GENERATION_BYTES: usize = 16;

/// One writing of a segment's parts; never used twice, so that no key of the bulk tree is ever overwritten.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Generation(pub(crate) [u8; GENERATION_BYTES]);

impl Generation {
    pub(crate) fn fresh() -> Self {
        // Any source of numbers that never repeat will do, over restarts too.
        Self(ExampleId::generate().to_bytes())
    }
}

/// A segment of an example.
pub(crate) type SegmentKey = (ExampleId, u32);

pub(crate) fn record(id: ExampleId) -> [u8; ID_BYTES_LEN] {
    id.to_bytes()
}

pub(crate) fn body(id: ExampleId, revision: u32, chunk: u16) -> Vec<u8> {
    [&id.to_bytes()[..], &revision.to_be_bytes(), &chunk.to_be_bytes()].concat()
}

pub(crate) fn segment((id, segment): SegmentKey) -> Vec<u8> {
    [&id.to_bytes()[..], &segment.to_be_bytes()].concat()
}

pub(crate) fn generation(key: SegmentKey, generation: Generation) -> Vec<u8> {
    [&segment(key)[..], &generation.0].concat()
}

pub(crate) fn part(key: SegmentKey, generation: Generation, kind: PartKind, chunk: u16) -> Vec<u8> {
    [&self::generation(key, generation)[..], &[kind.0], &chunk.to_be_bytes()].concat()
}

/// The id of a key of `manifest`.
pub(crate) fn parse_record(key: &[u8]) -> Option<ExampleId> {
    Some(ExampleId::from_bytes(key.try_into().ok()?))
}

/// The id and revision of a key of `body`.
pub(crate) fn parse_body(key: &[u8]) -> Option<(ExampleId, u32)> {
    let (prefix, _chunk) = key.split_last_chunk::<2>()?;
    parse_segment(prefix)
}

/// The segment of a key of `derived`.
pub(crate) fn parse_segment(key: &[u8]) -> Option<SegmentKey> {
    let (id, segment) = key.split_first_chunk::<ID_BYTES_LEN>()?;
    Some((ExampleId::from_bytes(*id), u32::from_be_bytes(segment.try_into().ok()?)))
}

/// The segment and generation of a key of `pending`.
pub(crate) fn parse_generation(key: &[u8]) -> Option<(SegmentKey, Generation)> {
    let (segment, generation) = key.split_last_chunk::<GENERATION_BYTES>()?;
    Some((parse_segment(segment)?, Generation(*generation)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_sort_as_what_they_name() {
        let id = ExampleId::from_bytes([7; 16]);
        let made = Generation([9; 16]);
        assert!(segment((id, 255)) < segment((id, 256)));
        assert!(body(id, 1, 255) < body(id, 1, 256));
        assert!(part((id, 0), made, PartKind::HEAD, 255) < part((id, 0), made, PartKind::HEAD, 256));
    }

    #[test]
    fn keys_lead_back_to_what_they_name() {
        let key = (ExampleId::generate(), 300);
        let made = Generation::fresh();
        assert_eq!(parse_record(&record(key.0)), Some(key.0));
        assert_eq!(parse_segment(&segment(key)), Some(key));
        assert_eq!(parse_generation(&generation(key, made)), Some((key, made)));
        assert_eq!(parse_segment(b"short"), None);
    }
}
