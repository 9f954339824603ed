//! Backups: what is restored into an empty store.

use crate::{damage::damaged, dice::Dice};
use quadmuse_store::{
    ChartRecord, DerivedSegment, Feature, Level, NewExample, NewSegmentation, OpenOptions, SegmentSummary, Store,
    StoreError, Topology,
};
use std::sync::OnceLock;

/// What a restore promises.
pub const PROMISE: &str = "a spoilt backup is refused, and serves nothing, or is restored whole";

/// Examples of the backup.
const EXAMPLES: u8 = 2;
/// One of so many backups is left whole: all others are refused, if each frame is checked.
const WHOLE_EVERY: usize = 6;
/// Side of the only level, in pixels.
const SIDE: u32 = 32;

fn options() -> OpenOptions {
    OpenOptions { cache_bytes: 16 << 20, reserve_bytes: 1 << 20, spare_bytes: 0, ..OpenOptions::default() }
}

fn derived() -> DerivedSegment {
    let lambda = (0..SIDE * SIDE).map(|k| 1.0 + (k % 7) as f32 * 0.1).collect();
    DerivedSegment {
        topology: Topology::Disc,
        modulus: 0.4,
        poles: vec![5],
        levels: vec![Level { side: SIDE, lambda }],
        features: vec![Feature { u: 0.5, v: 0.25, lambda: 4.0, level: SIDE }],
        signature: vec![0.5; 16],
        chart: ChartRecord { uv: vec![[0.5, 0.5]; 9], extra: vec![7; 20] },
    }
}

/// The bytes of a backup of a small store.
fn whole() -> &'static [u8] {
    static WHOLE: OnceLock<Vec<u8>> = OnceLock::new();
    WHOLE.get_or_init(|| made().unwrap_or_else(|error| panic!("a small store is not made: {error}")))
}

fn made() -> Result<Vec<u8>, StoreError> {
    let folder = tempfile::tempdir().unwrap_or_else(|error| panic!("there is no folder: {error}"));
    let (store, _) = Store::open(folder.path(), &options())?;
    let summary = SegmentSummary {
        topology: Topology::Disc,
        vertices: 9,
        faces: 4,
        modulus: 0.4,
        area_share: 1.0,
        pole_override: None,
    };
    for number in 0..EXAMPLES {
        store.add(&NewExample {
            name: "spoilt",
            tags: &["head".into()],
            relevance: 3.0,
            format: "obj",
            mesh: &[number; 200],
            segmentation: NewSegmentation::Auto,
            segments: std::slice::from_ref(&summary),
            vertices: 9,
            faces: 4,
            repairs: &[],
            encoder_version: 1,
            derived: &[derived()],
        })?;
    }
    let mut bytes = Vec::new();
    store.backup(&mut bytes)?;
    Ok(bytes)
}

/// Restores a spoilt backup.
pub fn backup(seed: u64) -> bool {
    let mut dice = Dice::new(seed);
    let bytes = if dice.below(WHOLE_EVERY) == 0 { whole().to_vec() } else { damaged(whole(), &mut dice) };
    let folder = tempfile::tempdir().unwrap_or_else(|error| panic!("there is no folder: {error}"));
    match Store::restore(folder.path(), &options(), &mut &bytes[..]) {
        Ok((store, report)) => {
            assert!(report.quarantined.is_empty(), "{:?}", report.quarantined);
            assert_eq!(store.snapshot().examples.len(), usize::from(EXAMPLES));
            true
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            let opened = Store::open(folder.path(), &options());
            assert!(opened.is_err(), "half a restore is served after: {error}");
            false
        }
    }
}
