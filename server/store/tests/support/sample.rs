//! Examples made by code, for the tests of the store.
#![allow(dead_code, reason = "each test uses a part of it")]

use quadmuse_store::{
    ChartRecord, DerivedSegment, Feature, Level, NewExample, NewSegmentation, OpenOptions, SegmentSummary, Topology,
};

/// Options for tests: a small cache and a small reserve.
pub(crate) fn options() -> OpenOptions {
    OpenOptions { cache_bytes: 16 << 20, reserve_bytes: 1 << 20, spare_bytes: 0, ..OpenOptions::default() }
}

/// A number in 0–1, from a seed and a counter.
pub(crate) fn random(seed: u64, i: u64) -> f64 {
    let mut x =
        seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(i.wrapping_mul(0xbf58_476d_1ce4_e5b9)).wrapping_add(1);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

fn level(seed: u64, side: u32) -> Level {
    let value = |i: u32| {
        let (u, v) = (f64::from(i % side) / f64::from(side), f64::from(i / side) / f64::from(side));
        let wave = |k: u64| {
            random(seed, k)
                * ((1.0 + 3.0 * random(seed, k + 50)).floor() * std::f64::consts::TAU * u
                    + 5.0 * v * random(seed, k + 90))
                .sin()
        };
        (0.8 * (0..5).map(wave).sum::<f64>()).exp() as f32
    };
    Level { side, lambda: (0..side * side).map(value).collect() }
}

/// The encoding of a segment, different for each seed, with the levels of these sides.
pub(crate) fn segment_of(seed: u64, sides: &[u32], vertices: u64) -> DerivedSegment {
    let feature = |i| Feature { u: random(seed, i), v: random(seed, i + 7), lambda: 2.0 + i as f32, level: 512 };
    DerivedSegment {
        topology: Topology::Disc,
        modulus: 0.4 + random(seed, 3),
        poles: vec![5, 17],
        levels: sides.iter().map(|&side| level(seed, side)).collect(),
        features: (0..12).map(feature).collect(),
        signature: (0..544).map(|i| random(seed, i) as f32).collect(),
        chart: ChartRecord {
            uv: (0..vertices).map(|i| [random(seed, 2 * i), random(seed, 2 * i + 1)]).collect(),
            extra: vec![seed as u8; 999],
        },
    }
}

/// The encoding of a segment with the pyramid up to 128².
pub(crate) fn segment(seed: u64) -> DerivedSegment {
    segment_of(seed, &[32, 64, 128], 700)
}

/// An example and what it borrows.
pub(crate) struct Sample {
    pub(crate) name: String,
    pub(crate) tags: Vec<String>,
    pub(crate) mesh: Vec<u8>,
    pub(crate) segments: Vec<SegmentSummary>,
    pub(crate) derived: Vec<DerivedSegment>,
    pub(crate) repairs: Vec<String>,
}

impl Sample {
    /// The example number `seed`, with one segment.
    pub(crate) fn new(seed: u64) -> Self {
        Self::with(seed, vec![segment(seed)])
    }

    /// The example number `seed` with these segments.
    pub(crate) fn with(seed: u64, derived: Vec<DerivedSegment>) -> Self {
        let line = |i| format!("v {} {} {}\n", random(seed, i), random(seed, i + 1), random(seed, i + 2));
        let summary = SegmentSummary {
            topology: Topology::Disc,
            vertices: 700,
            faces: 680,
            modulus: 0.4,
            area_share: 1.0,
            pole_override: None,
        };
        Self {
            name: format!("sample {seed}"),
            tags: vec!["sample".into(), "head".into()],
            mesh: (0..300).map(line).collect::<String>().into_bytes(),
            segments: vec![summary; derived.len()],
            derived,
            repairs: vec!["2 duplicate faces dropped".into()],
        }
    }

    pub(crate) fn example(&self) -> NewExample<'_> {
        NewExample {
            name: &self.name,
            tags: &self.tags,
            relevance: 3.0,
            format: "obj",
            mesh: &self.mesh,
            segmentation: NewSegmentation::Auto,
            segments: &self.segments,
            vertices: 700,
            faces: 680,
            repairs: &self.repairs,
            encoder_version: 1,
            derived: &self.derived,
        }
    }
}
