//! One encoded segment as it is kept and carried: packed, part by part.

use quadmuse_proto::id::ExampleId;
use serde::{Deserialize, Serialize};

use crate::codec;
use crate::derived::{self, ChartRecord, Coarse, DerivedSegment, Level, PART_BYTES_MAX, Part, PartKind, PartSource};
use crate::error::StoreError;
use crate::frame;

/// What a run of bytes that holds a packed segment begins with.
const MAGIC: [u8; 4] = *b"QMS1";

/// A packed encoding, which goes from one corpus to another without being made anew: it ranks there as before, bit for bit.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedSegment {
    /// The version of the encoder that made it.
    pub encoder_version: u32,
    pub(crate) parts: Vec<Part>,
}

#[derive(Serialize, Deserialize)]
struct Carried {
    encoder_version: u32,
    parts: Vec<(u8, serde_bytes::ByteBuf)>,
}

impl PackedSegment {
    /// Packs an encoding.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] outside the limits.
    pub fn pack(encoder_version: u32, derived: &DerivedSegment) -> Result<Self, StoreError> {
        Ok(Self { encoder_version, parts: derived::pack(derived)? })
    }

    /// As one run of bytes, with a checksum. The same encoding gives the same bytes.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] if it can't be written, which doesn't happen within the limits.
    pub fn to_bytes(&self) -> Result<Vec<u8>, StoreError> {
        let parts = self.parts.iter().map(|part| (part.kind.0, serde_bytes::ByteBuf::from(part.bytes.clone())));
        let carried = Carried { encoder_version: self.encoder_version, parts: parts.collect() };
        let bytes = rmp_serde::to_vec_named(&carried)
            .map_err(|error| crate::record::invalid("an encoding", "to serialise".into(), error.to_string()))?;
        Ok(frame::frame(MAGIC, &bytes))
    }

    /// The way back from [`PackedSegment::to_bytes`], or what is wrong with the bytes.
    ///
    /// # Errors
    /// A sentence that says what was found.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let payload = frame::unframe(MAGIC, bytes)?;
        let carried: Carried = rmp_serde::from_slice(payload).map_err(|error| error.to_string())?;
        let parts =
            carried.parts.into_iter().map(|(kind, bytes)| Part { kind: PartKind(kind), bytes: bytes.into_vec() });
        let parts: Vec<Part> = parts.collect();
        if parts.iter().any(|part| part.bytes.len() > PART_BYTES_MAX) {
            return Err("too long a part".into());
        }
        Ok(Self { encoder_version: carried.encoder_version, parts })
    }

    /// The encoding of segment `segment` of `id`, to be read; both are for messages alone.
    pub fn of(&self, id: ExampleId, segment: u32) -> SegmentReader<'_> {
        SegmentReader { packed: self, id, segment }
    }
}

/// A packed encoding that is read.
pub struct SegmentReader<'a> {
    packed: &'a PackedSegment,
    id: ExampleId,
    segment: u32,
}

impl PartSource for SegmentReader<'_> {
    fn part(&self, kind: PartKind) -> Result<Vec<u8>, StoreError> {
        let found = self.packed.parts.iter().find(|part| part.kind == kind);
        found.map(|part| part.bytes.clone()).ok_or_else(|| self.damaged(kind, "part missing"))
    }

    fn has(&self, kind: PartKind) -> bool {
        self.packed.parts.iter().any(|part| part.kind == kind)
    }

    fn damaged(&self, kind: PartKind, reason: &str) -> StoreError {
        StoreError::DamagedDerived { id: self.id, segment: self.segment, part: kind.name(), reason: reason.to_owned() }
    }
}

impl SegmentReader<'_> {
    /// What a search keeps in memory.
    ///
    /// # Errors
    /// [`StoreError::DamagedDerived`].
    pub fn coarse(&self) -> Result<Coarse, StoreError> {
        derived::read_coarse(self)
    }

    /// One level of the pyramid, of `side` pixels a side.
    ///
    /// # Errors
    /// [`StoreError::NoSuchLevel`], [`StoreError::DamagedDerived`].
    pub fn level(&self, side: u32) -> Result<Level, StoreError> {
        if !derived::has_level(|kind| self.has(kind), side) {
            return Err(StoreError::NoSuchLevel { id: self.id, segment: self.segment, side });
        }
        derived::read_level(self, side)
    }

    /// The chart.
    ///
    /// # Errors
    /// [`StoreError::DamagedDerived`].
    pub fn chart(&self) -> Result<ChartRecord, StoreError> {
        derived::read_chart(self)
    }

    /// All of it.
    ///
    /// # Errors
    /// [`StoreError::DamagedDerived`].
    pub fn all(&self) -> Result<DerivedSegment, StoreError> {
        derived::read_all(self)
    }
}

/// What a search keeps in memory of an encoding, as it will be read once it was packed: levels are stored rounded.
///
/// # Errors
/// [`StoreError::Invalid`] outside the limits.
pub fn coarse_when_kept(derived: &DerivedSegment) -> Result<Coarse, StoreError> {
    let coarsest = derived.levels.iter().min_by_key(|level| level.side);
    let coarsest = coarsest.ok_or_else(|| {
        crate::record::invalid("the levels", "one or more, each side once".into(), "0 of them".into())
    })?;
    codec::check(coarsest)?;
    let rounded = codec::decode(&codec::encode(coarsest)?);
    Ok(Coarse {
        topology: derived.topology,
        modulus: derived.modulus,
        poles: derived.poles.clone(),
        level: rounded.map_err(|reason| crate::record::invalid("a level", "to be packed".into(), reason.into()))?,
        features: derived.features.clone(),
        signature: derived.signature.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Topology;

    fn sample() -> DerivedSegment {
        DerivedSegment {
            topology: Topology::Annulus,
            modulus: 0.4,
            poles: vec![3],
            levels: codec::tests::pyramid(codec::tests::picture(128, 5, 0.001)),
            features: vec![derived::Feature { u: 0.3, v: 0.9, lambda: 4.5, level: 128 }],
            signature: vec![1.5, 2.5],
            chart: ChartRecord { uv: vec![[0.1, 0.2]], extra: vec![7; 99] },
        }
    }

    #[test]
    fn what_is_carried_is_read_as_it_was_packed_and_damage_is_noticed() {
        let id = ExampleId::generate();
        let packed = PackedSegment::pack(3, &sample()).unwrap();
        let bytes = packed.to_bytes().unwrap();
        assert_eq!(PackedSegment::from_bytes(&bytes).unwrap(), packed);
        assert_eq!(packed.of(id, 0).chart().unwrap(), sample().chart);
        assert_eq!(packed.of(id, 0).coarse().unwrap(), coarse_when_kept(&sample()).unwrap());
        assert_eq!(packed.of(id, 0).level(64).unwrap().side, 64);
        assert!(matches!(packed.of(id, 0).level(512), Err(StoreError::NoSuchLevel { side: 512, .. })));
        let mut bad = bytes.clone();
        bad[40] ^= 1;
        assert!(PackedSegment::from_bytes(&bad).is_err() && PackedSegment::from_bytes(&bytes[1..]).is_err());
    }
}
