//! The corpus' segments of one topology, side by side for sweeps.
//!
//! A blocks is cheap to clone: who changes it copies the one chunk that changes, and who ranks against an older clone
//! goes on seeing what was there.

use super::Resident;
use quadmuse_kernel::rank::SegmentShape;
use quadmuse_kernel::rank::coarse::RowFacts;
use quadmuse_kernel::register::spectra::{Block, LANES, Row};
use std::sync::Arc;

/// Where a segment stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slot {
    chunk: u32,
    lane: u8,
}

/// [`LANES`] segments, some of them perhaps gone.
#[derive(Clone, Debug, Default)]
pub struct Chunk {
    block: Block,
    facts: [Option<RowFacts>; LANES],
    residents: [Option<Arc<Resident>>; LANES],
}

impl Chunk {
    /// Their pictures.
    pub fn block(&self) -> &Block {
        &self.block
    }

    /// What else a sweep needs of each.
    pub fn facts(&self) -> &[Option<RowFacts>; LANES] {
        &self.facts
    }

    /// The segments.
    pub fn residents(&self) -> &[Option<Arc<Resident>>; LANES] {
        &self.residents
    }

    /// The picture in a lane, and whose it is.
    pub fn row(&self, lane: usize) -> Option<(Row, &Arc<Resident>)> {
        let (facts, resident) = (self.facts.get(lane)?.as_ref()?, self.residents.get(lane)?.as_ref()?);
        let (codes, scale) = self.block.codes(lane);
        let RowFacts { mean, variance, symmetric, .. } = *facts;
        Some((Row { codes, scale, mean: mean as f32, variance, symmetric }, resident))
    }
}

/// All segments of a topology.
#[derive(Clone, Debug, Default)]
pub struct RowBlocks {
    chunks: Vec<Arc<Chunk>>,
    free: Vec<Slot>,
}

impl RowBlocks {
    /// Its chunks.
    pub fn chunks(&self) -> &[Arc<Chunk>] {
        &self.chunks
    }

    /// Puts a segment in: `resident` is made once its place is known.
    pub(super) fn put(
        &mut self,
        row: &Row,
        shape: SegmentShape,
        resident: impl FnOnce(Slot) -> Resident,
    ) -> Arc<Resident> {
        let place = self.free.pop().unwrap_or_else(|| {
            let chunk = self.chunks.len() as u32;
            self.chunks.push(Arc::default());
            self.free.extend((1..LANES as u8).rev().map(|lane| Slot { chunk, lane }));
            Slot { chunk, lane: 0 }
        });
        let resident = Arc::new(resident(place));
        if let Some((chunk, lane)) = self.at(place) {
            chunk.block.put(lane, row);
            chunk.facts[lane] = Some(RowFacts::of(row, shape));
            chunk.residents[lane] = Some(Arc::clone(&resident));
        }
        resident
    }

    /// Replaces what is known of a segment, its picture staying the same.
    pub(super) fn replace(&mut self, resident: &Arc<Resident>) {
        if let Some((chunk, lane)) = self.at(resident.place) {
            chunk.residents[lane] = Some(Arc::clone(resident));
        }
    }

    /// Takes a segment out.
    pub(super) fn remove(&mut self, place: Slot) {
        if let Some((chunk, lane)) = self.at(place) {
            (chunk.facts[lane], chunk.residents[lane]) = (None, None);
            self.free.push(place);
        }
    }

    fn at(&mut self, place: Slot) -> Option<(&mut Chunk, usize)> {
        let chunk = self.chunks.get_mut(place.chunk as usize)?;
        Some((Arc::make_mut(chunk), usize::from(place.lane)))
    }
}
