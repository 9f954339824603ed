//! A row as bytes: what a start needs of a segment beside the example's record.
//!
//! Little-endian: `version 2 u8 ‖ symmetric u8 ‖ features u32 ‖ triangles u64 ‖ quads u64 ‖ bending f32 (NaN: unknown) ‖
//! scale f32 ‖ mean f32 ‖ variance f64 ‖ codes i16 …`. A server that holds another share of the corpus keeps of it, in memory
//! alone, what stands before the scale, as version 3.

use super::shaped::topology_out;
use crate::work::corpus::KeptRow;
use crate::work::engine::SegmentFacts;
use quadmuse_kernel::register::spectra::{Row, VALUES};
use quadmuse_store::SegmentSummary;

const VERSION: u8 = 2;
/// Of one without its picture.
const VERSION_BARE: u8 = 3;
/// Length of one without its picture, in bytes.
const BARE_BYTES: usize = 26;

/// A row that was written down.
pub(super) struct WrittenRow {
    pub(super) segment: u32,
    pub(super) features: u32,
    /// Triangles and quads of the mesh.
    pub(super) counts: (u64, u64),
    bending: Option<f32>,
    row: Option<Row>,
}

impl WrittenRow {
    /// With what the example's record says of the segment.
    pub(super) fn kept(self, summary: &SegmentSummary) -> KeptRow {
        let facts = SegmentFacts {
            topology: topology_out(summary.topology),
            k: summary.modulus,
            faces: u64::from(summary.faces),
            features: self.features,
            bending: self.bending,
        };
        KeptRow { segment: self.segment, facts, row: self.row }
    }
}

/// What a server keeps of a row, as bytes, that belongs to another share of the corpus.
pub fn without_picture(mut bytes: Vec<u8>) -> Vec<u8> {
    if bytes.first() == Some(&VERSION) && bytes.len() > BARE_BYTES {
        bytes.truncate(BARE_BYTES);
        bytes.shrink_to_fit();
        bytes[..2].copy_from_slice(&[VERSION_BARE, 0]);
    }
    bytes
}

pub(super) fn write(kept: &KeptRow, (triangles, quads): (u64, u64)) -> Vec<u8> {
    let row = kept.row.as_ref();
    let version = if row.is_some() { VERSION } else { VERSION_BARE };
    let mut out = vec![version, u8::from(row.is_some_and(|row| row.symmetric))];
    out.extend_from_slice(&kept.facts.features.to_le_bytes());
    out.extend_from_slice(&triangles.to_le_bytes());
    out.extend_from_slice(&quads.to_le_bytes());
    out.extend_from_slice(&kept.facts.bending.unwrap_or(f32::NAN).to_le_bytes());
    let Some(row) = row else { return out };
    out.extend_from_slice(&row.scale.to_le_bytes());
    out.extend_from_slice(&row.mean.to_le_bytes());
    out.extend_from_slice(&row.variance.to_le_bytes());
    row.codes.iter().for_each(|code| out.extend_from_slice(&code.to_le_bytes()));
    out
}

pub(super) fn read(segment: u32, bytes: &[u8]) -> Option<WrittenRow> {
    let (&[version, symmetric], rest) = bytes.split_first_chunk::<2>()?;
    let (features, rest) = rest.split_first_chunk::<4>()?;
    let (triangles, rest) = rest.split_first_chunk::<8>()?;
    let (quads, rest) = rest.split_first_chunk::<8>()?;
    let (bending, rest) = rest.split_first_chunk::<4>()?;
    let read = |row: Option<Row>| WrittenRow {
        segment,
        features: u32::from_le_bytes(*features),
        counts: (u64::from_le_bytes(*triangles), u64::from_le_bytes(*quads)),
        bending: Some(f32::from_le_bytes(*bending)).filter(|bending| bending.is_finite()),
        row,
    };
    if version == VERSION_BARE {
        return rest.is_empty().then(|| read(None));
    }
    let (scale, rest) = rest.split_first_chunk::<4>()?;
    let (mean, rest) = rest.split_first_chunk::<4>()?;
    let (variance, rest) = rest.split_first_chunk::<8>()?;
    let (pairs, odd) = rest.as_chunks::<2>();
    let codes: Box<[i16; VALUES]> =
        pairs.iter().map(|&pair| i16::from_le_bytes(pair)).collect::<Vec<_>>().try_into().ok()?;
    let (scale, mean, variance) =
        (f32::from_le_bytes(*scale), f32::from_le_bytes(*mean), f64::from_le_bytes(*variance));
    let sound = version == VERSION && odd.is_empty() && scale.is_finite() && mean.is_finite() && variance.is_finite();
    sound.then(|| read(Some(Row { codes, scale, mean, variance, symmetric: symmetric == 1 })))
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_proto::Topology;

    #[test]
    fn a_row_comes_back_bit_for_bit() {
        let codes = Box::new(std::array::from_fn(|k| (k as i16).wrapping_mul(77)));
        let row = Row { codes, scale: 1e-3, mean: 0.97, variance: 0.123, symmetric: true };
        let facts = SegmentFacts { topology: Topology::Annulus, k: 0.4, faces: 12, features: 3, bending: Some(2.5) };
        let kept = KeptRow { segment: 4, facts, row: Some(row) };
        let bytes = write(&kept, (5, 6));
        let back = read(4, &bytes).expect("a row");
        assert_eq!((back.counts, back.features, back.bending), ((5, 6), 3, Some(2.5)));
        assert_eq!(back.row, kept.row);
        assert!(read(4, &bytes[..bytes.len() - 1]).is_none());

        let bare = without_picture(bytes.clone());
        let back = read(4, &bare).expect("a row");
        assert_eq!((back.counts, back.features, back.bending, back.row), ((5, 6), 3, Some(2.5), None));
        assert_eq!(bare, write(&KeptRow { row: None, ..kept }, (5, 6)));
        assert_eq!(without_picture(bare.clone()), bare);
        assert!(read(4, &bare[..bare.len() - 1]).is_none());
    }
}
