//! What can be computed again from an example's mesh: one encoded segment, and how it is cut into parts for the index.
//!
//! Each part is stored by itself, so that a search reads one level and not the chart beside it.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::codec::{self, LEVEL_SIDE_MAX};
use crate::error::StoreError;
use crate::record::{Topology, at_most, invalid};

/// Most features of a segment.
pub const FEATURES_MAX: usize = 4096;
/// Most poles of a segment, candidates included.
pub const POLES_MAX: usize = 64;
/// Longest signature, in numbers.
pub const SIGNATURE_MAX: usize = 65_536;
/// Most bytes of one packed part.
pub const PART_BYTES_MAX: usize = 128 << 20;
const ZSTD_LEVEL: i32 = 1;
/// The level that isn't stored where it is the mean of 2 × 2 pixels of the one above: that saves a quarter of the bytes.
const MEAN_SIDE: u32 = 256;
/// How closely it must be that mean, relatively.
const MEAN_TOLERANCE: f32 = 1e-5;

/// One level of a pyramid: λ row by row, u along a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// Pixels a side, a power of two up to 512.
    pub side: u32,
    /// side × side values, finite and not negative.
    pub lambda: Vec<f32>,
}

impl Level {
    /// The level below: the mean of each 2 × 2 pixels.
    fn halved(&self) -> Level {
        let half = self.side / 2;
        let rows = self.lambda.chunks_exact(self.side.max(1) as usize);
        let pairs: Vec<&[f32]> = rows.collect();
        let mean = |(upper, lower): (&[f32; 2], &[f32; 2])| {
            let [a, b] = *upper;
            let [c, d] = *lower;
            (0.25 * (f64::from(a) + f64::from(b) + f64::from(c) + f64::from(d))) as f32
        };
        let lambda = pairs
            .as_chunks::<2>()
            .0
            .iter()
            .flat_map(|[upper, lower]| upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0).map(mean));
        Level { side: half, lambda: lambda.collect() }
    }

    fn is_close_to(&self, other: &Level) -> bool {
        let close = |(a, b): (&f32, &f32)| (a - b).abs() <= MEAN_TOLERANCE * a.abs();
        self.side == other.side
            && self.lambda.len() == other.lambda.len()
            && self.lambda.iter().zip(&other.lambda).all(close)
    }
}

/// A feature point of an encoding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Position along the period, 0–1.
    pub u: f64,
    /// Position across, 0–1.
    pub v: f64,
    /// λ there.
    pub lambda: f32,
    /// Side of the level it was found on, in pixels.
    pub level: u32,
}

/// Where the segment's vertices lie in the plane, and what else its mapping needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartRecord {
    /// (u, v) of each vertex, bit for bit as handed in.
    pub uv: Vec<[f64; 2]>,
    /// Whatever the server adds (planar index, MLS terms), opaque to the store.
    pub extra: Vec<u8>,
}

/// One encoded segment.
#[derive(Clone, Debug, PartialEq)]
pub struct DerivedSegment {
    /// Its kind.
    pub topology: Topology,
    /// Its modulus m.
    pub modulus: f64,
    /// Its poles (vertices of the segment), best first.
    pub poles: Vec<u32>,
    /// Its pyramid; each side once.
    pub levels: Vec<Level>,
    /// Its features.
    pub features: Vec<Feature>,
    /// Its shift-invariant signature.
    pub signature: Vec<f32>,
    /// Its chart.
    pub chart: ChartRecord,
}

/// What a search keeps in memory of a segment: everything but the finer levels and the chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Coarse {
    /// Its kind.
    pub topology: Topology,
    /// Its modulus m.
    pub modulus: f64,
    /// Its poles.
    pub poles: Vec<u32>,
    /// Its coarsest level.
    pub level: Level,
    /// Its features.
    pub features: Vec<Feature>,
    /// Its signature.
    pub signature: Vec<f32>,
}

/// The number of a part, as keys hold it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub(crate) struct PartKind(pub(crate) u8);

impl PartKind {
    pub(crate) const HEAD: PartKind = PartKind(1);
    pub(crate) const FEATURES: PartKind = PartKind(2);
    pub(crate) const SIGNATURE: PartKind = PartKind(3);
    pub(crate) const CHART: PartKind = PartKind(4);
    pub(crate) const EXTRA: PartKind = PartKind(5);
    /// No part: rows that keep segments apart.
    pub(crate) const GUARD: PartKind = PartKind(0xff);
    const LEVELS: u8 = 0x10;

    /// The part that holds the level of this side.
    pub(crate) fn level(side: u32) -> PartKind {
        PartKind(Self::LEVELS | (side.checked_ilog2().unwrap_or(0) as u8 & 0x0f))
    }

    /// The part's name, for messages.
    pub(crate) fn name(self) -> &'static str {
        match self {
            PartKind::HEAD => "the head",
            PartKind::FEATURES => "the features",
            PartKind::SIGNATURE => "the signature",
            PartKind::CHART => "the chart",
            PartKind::EXTRA => "the chart's extra bytes",
            _ => "a pyramid level",
        }
    }
}

/// The small facts of a segment, and which levels there are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Head {
    topology: Topology,
    modulus: f64,
    poles: Vec<u32>,
    sides: Vec<u32>,
}

/// One packed part.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    pub(crate) kind: PartKind,
    pub(crate) bytes: Vec<u8>,
}

/// Packed levels by the hash of their pixels: where many segments are packed together, like levels are packed once.
#[derive(Default)]
pub(crate) struct PackedLevels(HashMap<[u8; 32], Vec<u8>>);

impl PackedLevels {
    fn encode(&mut self, level: &Level) -> Result<Vec<u8>, StoreError> {
        let mut hasher = blake3::Hasher::new();
        for pixels in level.lambda.chunks(LEVEL_SIDE_MAX as usize) {
            let bytes: Vec<u8> = pixels.iter().flat_map(|value| value.to_le_bytes()).collect();
            hasher.update(&bytes);
        }
        let hash = *hasher.finalize().as_bytes();
        if let Some(packed) = self.0.get(&hash) {
            return Ok(packed.clone());
        }
        let packed = codec::encode(level)?;
        self.0.insert(hash, packed.clone());
        Ok(packed)
    }
}

/// Packs a segment, part by part, after checking it against the limits of this module.
pub(crate) fn pack(derived: &DerivedSegment) -> Result<Vec<Part>, StoreError> {
    pack_with(derived, &mut codec::encode)
}

/// As [`pack`], beside others.
pub(crate) fn pack_beside(derived: &DerivedSegment, levels: &mut PackedLevels) -> Result<Vec<Part>, StoreError> {
    pack_with(derived, &mut |level| levels.encode(level))
}

fn pack_with(
    derived: &DerivedSegment,
    encode: &mut dyn FnMut(&Level) -> Result<Vec<u8>, StoreError>,
) -> Result<Vec<Part>, StoreError> {
    validate(derived)?;
    let head = Head {
        topology: derived.topology,
        modulus: derived.modulus,
        poles: derived.poles.clone(),
        sides: derived.levels.iter().map(|level| level.side).collect(),
    };
    let head = rmp_serde::to_vec_named(&head)
        .map_err(|error| invalid("a segment's head", "to serialise".into(), error.to_string()))?;
    let mut parts = vec![
        Part { kind: PartKind::HEAD, bytes: head },
        Part { kind: PartKind::FEATURES, bytes: derived.features.iter().flat_map(pack_feature).collect() },
        Part {
            kind: PartKind::SIGNATURE,
            bytes: derived.signature.iter().flat_map(|value| value.to_le_bytes()).collect(),
        },
    ];
    let above = derived.levels.iter().find(|level| level.side == 2 * MEAN_SIDE);
    for level in &derived.levels {
        codec::check(level)?;
        if level.side == MEAN_SIDE && above.is_some_and(|above| above.halved().is_close_to(level)) {
            continue;
        }
        parts.push(Part { kind: PartKind::level(level.side), bytes: encode(level)? });
    }
    parts.push(Part { kind: PartKind::CHART, bytes: pack_chart(&derived.chart.uv)? });
    parts.push(Part { kind: PartKind::EXTRA, bytes: compress(&derived.chart.extra)? });
    for part in &parts {
        at_most(part.kind.name(), "bytes", part.bytes.len(), PART_BYTES_MAX)?;
    }
    Ok(parts)
}

fn validate(derived: &DerivedSegment) -> Result<(), StoreError> {
    at_most("the features", "of them", derived.features.len(), FEATURES_MAX)?;
    at_most("the poles", "of them", derived.poles.len(), POLES_MAX)?;
    at_most("the signature", "numbers", derived.signature.len(), SIGNATURE_MAX)?;
    at_most("the chart", "bytes", derived.chart.uv.len().saturating_mul(16), PART_BYTES_MAX)?;
    at_most("the chart's extra bytes", "of them", derived.chart.extra.len(), PART_BYTES_MAX)?;
    let mut sides: Vec<u32> = derived.levels.iter().map(|level| level.side).collect();
    sides.sort_unstable();
    sides.dedup();
    if sides.is_empty() || sides.len() != derived.levels.len() {
        return Err(invalid(
            "the levels",
            "one or more, each side once".into(),
            format!("{} of them", derived.levels.len()),
        ));
    }
    let finite = derived.modulus.is_finite()
        && derived.features.iter().all(|f| f.u.is_finite() && f.v.is_finite() && f.lambda.is_finite())
        && derived.signature.iter().all(|value| value.is_finite());
    if finite { Ok(()) } else { Err(invalid("every number of an encoding", "to be finite".into(), "another".into())) }
}

const FEATURE_BYTES: usize = 24;

fn pack_feature(feature: &Feature) -> [u8; FEATURE_BYTES] {
    let mut out = [0; FEATURE_BYTES];
    let fields = [
        &feature.u.to_le_bytes()[..],
        &feature.v.to_le_bytes(),
        &feature.lambda.to_le_bytes(),
        &feature.level.to_le_bytes(),
    ];
    for (to, from) in out.iter_mut().zip(fields.into_iter().flatten()) {
        *to = *from;
    }
    out
}

fn unpack_feature(bytes: &[u8; FEATURE_BYTES]) -> Feature {
    let [u0, u1, u2, u3, u4, u5, u6, u7, v0, v1, v2, v3, v4, v5, v6, v7, l0, l1, l2, l3, s0, s1, s2, s3] = *bytes;
    Feature {
        u: f64::from_le_bytes([u0, u1, u2, u3, u4, u5, u6, u7]),
        v: f64::from_le_bytes([v0, v1, v2, v3, v4, v5, v6, v7]),
        lambda: f32::from_le_bytes([l0, l1, l2, l3]),
        level: u32::from_le_bytes([s0, s1, s2, s3]),
    }
}

/// Features out of their part.
pub(crate) fn unpack_features(bytes: &[u8]) -> Result<Vec<Feature>, &'static str> {
    let (chunks, rest) = bytes.as_chunks::<FEATURE_BYTES>();
    if rest.is_empty() { Ok(chunks.iter().map(unpack_feature).collect()) } else { Err("a part of a feature") }
}

/// A signature out of its part.
pub(crate) fn unpack_signature(bytes: &[u8]) -> Result<Vec<f32>, &'static str> {
    let (chunks, rest) = bytes.as_chunks::<4>();
    if rest.is_empty() {
        Ok(chunks.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
    } else {
        Err("a part of a number")
    }
}

/// `count u64 LE`, then the bytes of all u and v, plane by plane, compressed: lossless.
fn pack_chart(uv: &[[f64; 2]]) -> Result<Vec<u8>, StoreError> {
    let values: Vec<[u8; 8]> = (0..2)
        .flat_map(|axis| uv.iter().map(move |point| point.get(axis).map_or([0; 8], |value| value.to_le_bytes())))
        .collect();
    let planes: Vec<u8> =
        (0..8).flat_map(|byte| values.iter().map(move |value| value.get(byte).copied().unwrap_or(0))).collect();
    compress(&planes)
}

fn unpack_chart(bytes: &[u8]) -> Result<Vec<[f64; 2]>, &'static str> {
    let planes = decompress(bytes)?;
    if !planes.len().is_multiple_of(16) {
        return Err("a part of a point");
    }
    let count = planes.len() / 16;
    let value = |i: usize| {
        let byte = |plane: usize| planes.get(plane * 2 * count + i).copied().unwrap_or(0);
        f64::from_le_bytes(std::array::from_fn(byte))
    };
    Ok((0..count).map(|i| [value(i), value(count + i)]).collect())
}

/// `length u64 LE ‖ zstd`.
pub(crate) fn compress(bytes: &[u8]) -> Result<Vec<u8>, StoreError> {
    let packed = zstd::bulk::compress(bytes, ZSTD_LEVEL)
        .map_err(|error| invalid("bytes", "to compress".into(), error.to_string()))?;
    let mut out = (bytes.len() as u64).to_le_bytes().to_vec();
    out.extend_from_slice(&packed);
    Ok(out)
}

/// The way back from [`compress`]; never more than [`PART_BYTES_MAX`].
pub(crate) fn decompress(bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
    let (length, packed) = bytes.split_first_chunk::<8>().ok_or("too few bytes for a compressed part")?;
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| "an impossible length")?;
    if length > PART_BYTES_MAX {
        return Err("an impossible length");
    }
    let out = zstd::bulk::decompress(packed, length).map_err(|_| "bytes that don't decompress")?;
    if out.len() == length { Ok(out) } else { Err("fewer bytes than promised") }
}

/// Where the parts of one segment come from, when it is read.
pub(crate) trait PartSource {
    /// The bytes of a part, whole.
    fn part(&self, kind: PartKind) -> Result<Vec<u8>, StoreError>;
    /// Whether there is such a part.
    fn has(&self, kind: PartKind) -> bool;
    /// The error that says this part is damaged.
    fn damaged(&self, kind: PartKind, reason: &str) -> StoreError;
}

fn read<T>(
    source: &impl PartSource,
    kind: PartKind,
    unpack: impl FnOnce(&[u8]) -> Result<T, &'static str>,
) -> Result<T, StoreError> {
    let bytes = source.part(kind)?;
    unpack(&bytes).map_err(|reason| source.damaged(kind, reason))
}

fn read_head(source: &impl PartSource) -> Result<Head, StoreError> {
    let head = read(source, PartKind::HEAD, |bytes| rmp_serde::from_slice::<Head>(bytes).map_err(|_| "no head"))?;
    let plausible = |side: &u32| side.is_power_of_two() && *side <= LEVEL_SIDE_MAX;
    if head.sides.iter().all(plausible) { Ok(head) } else { Err(source.damaged(PartKind::HEAD, "an impossible side")) }
}

/// Reads one level.
pub(crate) fn read_level(source: &impl PartSource, side: u32) -> Result<Level, StoreError> {
    let above = PartKind::level(2 * MEAN_SIDE);
    if side == MEAN_SIDE && !source.has(PartKind::level(side)) && source.has(above) {
        return Ok(read(source, above, codec::decode)?.halved());
    }
    read(source, PartKind::level(side), codec::decode)
}

/// Whether a level of this side can be read.
pub(crate) fn has_level(has: impl Fn(PartKind) -> bool, side: u32) -> bool {
    side.is_power_of_two() && (has(PartKind::level(side)) || (side == MEAN_SIDE && has(PartKind::level(2 * side))))
}

/// Reads the chart.
pub(crate) fn read_chart(source: &impl PartSource) -> Result<ChartRecord, StoreError> {
    let uv = read(source, PartKind::CHART, unpack_chart)?;
    let extra = read(source, PartKind::EXTRA, decompress)?;
    Ok(ChartRecord { uv, extra })
}

/// Reads what a search keeps in memory.
pub(crate) fn read_coarse(source: &impl PartSource) -> Result<Coarse, StoreError> {
    let head = read_head(source)?;
    let side = head.sides.iter().copied().min().unwrap_or(0);
    Ok(Coarse {
        topology: head.topology,
        modulus: head.modulus,
        poles: head.poles,
        level: read_level(source, side)?,
        features: read(source, PartKind::FEATURES, unpack_features)?,
        signature: read(source, PartKind::SIGNATURE, unpack_signature)?,
    })
}

/// Reads a whole segment.
pub(crate) fn read_all(source: &impl PartSource) -> Result<DerivedSegment, StoreError> {
    let head = read_head(source)?;
    Ok(DerivedSegment {
        topology: head.topology,
        modulus: head.modulus,
        poles: head.poles,
        levels: head.sides.iter().map(|&side| read_level(source, side)).collect::<Result<_, _>>()?,
        features: read(source, PartKind::FEATURES, unpack_features)?,
        signature: read(source, PartKind::SIGNATURE, unpack_signature)?,
        chart: read_chart(source)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_features_and_signatures_come_back_bit_for_bit() {
        let uv = vec![[0.1, 0.7], [f64::MIN_POSITIVE, 1.0 - f64::EPSILON], [-0.0, 3.25]];
        let back = unpack_chart(&pack_chart(&uv).unwrap()).unwrap();
        assert_eq!(
            back.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>(),
            uv.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>()
        );
        let feature = Feature { u: 0.3, v: 0.9, lambda: 4.5, level: 512 };
        assert_eq!(unpack_features(&pack_feature(&feature)), Ok(vec![feature]));
        assert!(unpack_features(&[0; 25]).is_err());
        assert_eq!(unpack_chart(&pack_chart(&[]).unwrap()), Ok(vec![]));
    }

    #[test]
    fn a_level_that_is_the_mean_of_the_one_above_is_not_stored() {
        let finest = codec::tests::picture(512, 5, 0.001);
        let pyramid = codec::tests::pyramid(finest);
        let mut derived = DerivedSegment {
            topology: Topology::Disc,
            modulus: 0.4,
            poles: vec![],
            levels: pyramid,
            features: vec![],
            signature: vec![],
            chart: ChartRecord::default(),
        };
        let has = |parts: &[Part], side| parts.iter().any(|part| part.kind == PartKind::level(side));
        let parts = pack(&derived).unwrap();
        assert!(has(&parts, 512) && has(&parts, 128) && !has(&parts, 256));
        assert!(has_level(|kind| parts.iter().any(|part| part.kind == kind), 256));
        derived.levels[3].lambda[77] *= 1.001;
        assert!(has(&pack(&derived).unwrap(), 256));
    }

    #[test]
    fn a_claim_of_more_bytes_than_there_are_is_refused() {
        let mut bytes = compress(&[7; 1000]).unwrap();
        assert_eq!(decompress(&bytes), Ok(vec![7; 1000]));
        bytes[7] = 0xff;
        assert_eq!(decompress(&bytes), Err("an impossible length"));
        assert!(decompress(&[1, 2, 3]).is_err());
    }
}
