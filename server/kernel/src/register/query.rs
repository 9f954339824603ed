//! A query segment, ready to be registered against: unfolded for each pole worth trying.

use std::sync::Arc;

use super::image::Image;
use super::query_images;
use crate::encode::{Encoding, encode, encode_to};
use crate::topology::Patch;
use crate::unfold::moebius::Conformal;
use crate::unfold::{Chart, UnfoldError, UnfoldOptions, Unfolder, solve_mesh};

/// Finest level at which rival poles are compared.
pub const SEARCH_SIDE: usize = 64;

/// The query unfolded with certain poles.
#[derive(Clone, Debug)]
pub struct Unfolded {
    /// The poles.
    pub poles: Vec<u32>,
    /// The encoding, to all levels or (rivals, while searching) to the search's level.
    pub encoding: Encoding,
    /// √λ₂ at each level of the encoding, coarse to fine.
    pub images: Vec<Image>,
}

impl Unfolded {
    fn new(poles: &[u32], encoding: Encoding) -> Self {
        let images = query_images(&encoding, usize::MAX);
        Self { poles: poles.to_vec(), encoding, images }
    }

    /// √λ₂ at a level.
    pub fn image(&self, side: usize) -> Option<&Image> {
        self.images.iter().find(|i| i.side == side)
    }
}

/// A query segment: its factored surface, and its unfoldings for the poles to try.
#[derive(Debug)]
pub struct Query {
    unfolder: Unfolder,
    conformal: Option<Conformal>,
    /// Whether the user gave the poles, which are then kept.
    pub poles_given: bool,
    /// The best pole first.
    pub candidates: Vec<Arc<Unfolded>>,
    /// The chart of the best pole.
    pub chart: Arc<Chart>,
}

impl Query {
    /// Unfolds and encodes a patch.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn new(patch: &Patch, options: &UnfoldOptions) -> Result<Self, UnfoldError> {
        let unfolder = Unfolder::new(solve_mesh(patch), patch.topology, patch.mesh.positions.len())?;
        let candidates = unfolder.poles_to_try(options)?;
        let (first, chart) = unfolder.first_chart(&candidates)?;
        let conformal = unfolder.conformal(&first)?;
        let mut unfolded = vec![Arc::new(Unfolded::new(&first, encode(&chart)))];
        if let Some(conformal) = &conformal {
            for poles in candidates.iter().filter(|p| **p != first) {
                unfolded.push(Arc::new(Unfolded::new(poles, encode_to(&conformal.chart(poles), SEARCH_SIDE))));
            }
        }
        let poles_given = !options.poles.is_empty();
        Ok(Self { unfolder, conformal, poles_given, candidates: unfolded, chart: Arc::new(chart) })
    }

    /// The mesh on which poles are vertices.
    pub fn unfolder(&self) -> &Unfolder {
        &self.unfolder
    }

    /// The query's encoding with its best pole.
    pub fn encoding(&self) -> &Encoding {
        &self.candidates[0].encoding
    }

    /// A quick unfolding for other poles, to the search's level; `None` where poles are fixed.
    pub fn try_poles(&self, poles: &[u32]) -> Option<Unfolded> {
        let conformal = self.conformal.as_ref()?;
        Some(Unfolded::new(poles, encode_to(&conformal.chart(poles), SEARCH_SIDE)))
    }

    /// The exact chart for some poles.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn chart_for(&self, poles: &[u32]) -> Result<Arc<Chart>, UnfoldError> {
        if self.candidates[0].poles == poles {
            return Ok(Arc::clone(&self.chart));
        }
        Ok(Arc::new(self.unfolder.chart(poles)?))
    }

    /// The exact unfolding to all levels for some poles.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn unfolded_for(&self, poles: &[u32]) -> Result<Arc<Unfolded>, UnfoldError> {
        if self.candidates[0].poles == poles {
            return Ok(Arc::clone(&self.candidates[0]));
        }
        Ok(Arc::new(Unfolded::new(poles, encode(&self.unfolder.chart(poles)?))))
    }
}
