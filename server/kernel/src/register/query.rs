//! A query segment, ready to be registered against: unfolded for each pole worth trying.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::image::Image;
use super::query_images;
use super::tips::Tips;
use super::trial::Trials;
use super::view::View;
use crate::encode::index::PlanarIndex;
use crate::encode::{Encoding, SIDE_FINEST, encode, encode_to};
use crate::mesh::bvh::Bvh;
use crate::topology::primitive::length as loop_length;
use crate::topology::{Patch, Topology};
use crate::unfold::moebius::Conformal;
use crate::unfold::pole::Breadth;
use crate::unfold::{Chart, UnfoldError, UnfoldOptions, Unfolder, solve_mesh};

/// Unfoldings for poles that were tried which are kept, some 100 KiB each.
const TRIED_MAX: usize = 96;
/// Shares of the area of the sub-discs that a ranking compares: an example that ends a tenth off is still found (METHOD §9).
const PART_SHARES: [f64; 6] = [0.8, 0.64, 0.51, 0.41, 0.33, 0.26];
/// Pixels a side of the views that they are cut from.
const VIEW_SIDE: usize = 256;
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
    /// Share of the surface's area that it shows: less than 1 for the sub-disc about the last pole.
    pub share: f64,
}

impl Unfolded {
    fn new(poles: &[u32], encoding: Encoding) -> Self {
        let images = query_images(&encoding, usize::MAX);
        Self { poles: poles.to_vec(), encoding, images, share: 1.0 }
    }

    /// Whether it shows all of the surface.
    pub fn is_whole(&self) -> bool {
        self.share >= 1.0
    }

    /// √λ₂ at a level.
    pub fn image(&self, side: usize) -> Option<&Image> {
        self.images.iter().find(|i| i.side == side)
    }
}

/// Caches what was made for some poles; what doesn't fit is made anew.
#[derive(Debug)]
pub(super) struct PoleCache<T>(Mutex<BTreeMap<Vec<u32>, Arc<OnceLock<T>>>>);

impl<T> Default for PoleCache<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Clone> PoleCache<T> {
    pub(super) fn get_or(&self, poles: &[u32], most: usize, make: impl FnOnce() -> T) -> T {
        let slot = {
            let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let has_room = kept.len() < most || kept.contains_key(poles);
            has_room.then(|| Arc::clone(kept.entry(poles.to_vec()).or_default()))
        };
        match slot {
            Some(slot) => slot.get_or_init(make).clone(),
            None => make(),
        }
    }
}

/// A query segment: its factored surface, and its unfoldings for the poles to try.
#[derive(Debug)]
pub struct Query {
    unfolder: Unfolder,
    /// The poles worth trying, best first.
    pole_sets: Vec<Vec<u32>>,
    /// Whether the user gave the poles, which are then kept.
    pub poles_given: bool,
    /// The chart of the best pole.
    pub chart: Arc<Chart>,
    best: Arc<Unfolded>,
    index: OnceLock<PlanarIndex>,
    tree: OnceLock<Arc<Bvh>>,
    limbs: OnceLock<Vec<u32>>,
    fingers: OnceLock<Vec<u32>>,
    /// Tips with all that they are matched by: of limbs, and of fingers.
    matched_by: [OnceLock<Arc<Tips>>; 2],
    /// From which the unfoldings for other poles follow; `None` where poles are fixed.
    conformal: Option<Conformal>,
    candidates: OnceLock<Vec<Arc<Unfolded>>>,
    parts: OnceLock<Vec<Arc<Unfolded>>>,
    /// A disc with its boundary filled, or an annulus with the shorter of its boundaries; `None` where that can't be unfolded.
    filled: OnceLock<Option<Box<Query>>>,
    trials: OnceLock<Trials>,
    tried: PoleCache<Option<Arc<Unfolded>>>,
    solved: PoleCache<Result<Arc<Unfolded>, UnfoldError>>,
}

impl Query {
    /// Unfolds and encodes a patch.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn new(patch: &Patch, options: &UnfoldOptions) -> Result<Self, UnfoldError> {
        let (mesh, own) = (solve_mesh(patch), patch.mesh.positions.len());
        let (unfolder, pole_sets) = Unfolder::with_poles(mesh, patch.topology, own, options)?;
        let solution = unfolder.first_solution(&pole_sets)?;
        let chart = unfolder.chart_of(&solution);
        let conformal = unfolder.conformal(&solution);
        let best = Arc::new(Unfolded::new(&solution.poles, encode(&chart)));
        Ok(Self {
            unfolder,
            pole_sets,
            poles_given: !options.poles.is_empty(),
            chart: Arc::new(chart),
            best,
            index: OnceLock::new(),
            tree: OnceLock::new(),
            limbs: OnceLock::new(),
            fingers: OnceLock::new(),
            matched_by: Default::default(),
            conformal,
            candidates: OnceLock::new(),
            parts: OnceLock::new(),
            filled: OnceLock::new(),
            trials: OnceLock::new(),
            tried: PoleCache::default(),
            solved: PoleCache::default(),
        })
    }

    /// The unfoldings worth trying, that of the best pole first.
    pub fn candidates(&self) -> &[Arc<Unfolded>] {
        self.candidates.get_or_init(|| {
            let mut all = vec![Arc::clone(&self.best)];
            let rivals = self.pole_sets.iter().filter(|poles| **poles != self.best.poles);
            all.extend(rivals.filter_map(|poles| self.try_poles(poles)).map(Arc::new));
            all
        })
    }

    /// Sub-discs of the surface: about the best pole of a disc, about either pole of a sphere. None of others.
    pub fn parts(&self) -> &[Arc<Unfolded>] {
        self.parts.get_or_init(|| {
            let poles = &self.best.poles;
            let about: Vec<Vec<u32>> = match self.best.encoding.topology {
                Topology::Disc => vec![poles.clone()],
                Topology::Sphere => vec![poles.clone(), poles.iter().rev().copied().collect()],
                Topology::Annulus | Topology::Torus => Vec::new(),
            };
            let views = about.iter().filter_map(|poles| self.view(poles, VIEW_SIDE));
            let part = |view: View, share: f64| {
                Arc::new(Unfolded { share, ..Unfolded::new(&view.poles, view.encoding(share, SEARCH_SIDE)) })
            };
            views.flat_map(|view| PART_SHARES.map(|share| part(view.clone(), share))).collect()
        })
    }

    /// The unfoldings that examples of a topology are compared with, that of the best pole first.
    pub fn candidates_for(&self, topology: Topology) -> Vec<Arc<Unfolded>> {
        let same = topology == self.best.encoding.topology;
        let whole = if same { self.candidates() } else { &[] };
        let parts = if topology == Topology::Disc { self.parts() } else { &[] };
        whole.iter().chain(parts).cloned().collect()
    }

    /// The surface that examples of a topology are compared with: this one, or, for examples with fewer boundaries, this one with
    /// boundaries filled, the shortest first. `None` where that can't be unfolded. *Ours, not the paper's.*
    pub fn facing(&self, example: Topology) -> Option<&Self> {
        match (self.best.encoding.topology, example) {
            (Topology::Disc, Topology::Sphere) => self.filled(),
            (Topology::Annulus, Topology::Disc | Topology::Sphere) => self.filled()?.facing(example),
            _ => Some(self),
        }
    }

    fn filled(&self) -> Option<&Self> {
        self.filled.get_or_init(|| self.with_rim_filled().map(Box::new)).as_deref()
    }

    /// The same surface with its shortest boundary filled.
    fn with_rim_filled(&self) -> Option<Self> {
        let mesh = Arc::clone(self.unfolder.mesh());
        let shorter = |a: &Vec<u32>, b: &Vec<u32>| loop_length(&mesh, a).total_cmp(&loop_length(&mesh, b));
        let shortest = mesh.boundary_loops().into_iter().min_by(shorter)?;
        let patch = Patch {
            topology: if self.best.encoding.topology == Topology::Disc { Topology::Sphere } else { Topology::Disc },
            vertex_of: (0..mesh.positions.len() as u32).collect(),
            triangle_of: (0..mesh.triangles.len() as u32).collect(),
            holes: vec![shortest],
            left_out: 0,
            mesh,
        };
        Self::new(&patch, &UnfoldOptions::default()).ok()
    }

    /// An unfolding that has the level `side` too.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn refined(&self, unfolded: &Unfolded, side: usize) -> Result<Arc<Unfolded>, UnfoldError> {
        if unfolded.is_whole() {
            return self.unfolded_for(&unfolded.poles);
        }
        let view = self.view(&unfolded.poles, side.max(VIEW_SIDE));
        let encoding = view.map_or_else(|| unfolded.encoding.clone(), |view| view.encoding(unfolded.share, side));
        Ok(Arc::new(Unfolded { share: unfolded.share, ..Unfolded::new(&unfolded.poles, encoding) }))
    }

    /// u, in periods, of some vertices in the chart for other poles; `None` where poles are fixed.
    pub fn angles(&self, poles: &[u32], at: &[u32]) -> Option<Vec<f64>> {
        Some(self.conformal.as_ref()?.angles(poles, at))
    }

    /// The mesh on which poles are vertices.
    pub fn unfolder(&self) -> &Unfolder {
        &self.unfolder
    }

    /// The planar index of [`Self::chart`].
    pub fn index(&self) -> &PlanarIndex {
        self.index.get_or_init(|| PlanarIndex::new(&self.chart))
    }

    /// The tree of boxes of the mesh of [`Self::chart`].
    pub fn tree(&self) -> &Arc<Bvh> {
        self.tree.get_or_init(|| Arc::new(Bvh::new(&self.chart.mesh)))
    }

    /// Tips of the surface's protrusions, most prominent first.
    pub fn protrusions(&self) -> &[u32] {
        self.tips(Breadth::Limbs)
    }

    /// The same, of protrusions of some breadth.
    pub fn tips(&self, breadth: Breadth) -> &[u32] {
        let kept = match breadth {
            Breadth::Limbs => &self.limbs,
            Breadth::Fingers => &self.fingers,
        };
        kept.get_or_init(|| self.unfolder.protrusions(&self.best.poles, breadth).unwrap_or_default())
    }

    /// Its tips of some breadth, with all that they are matched by.
    pub fn matched_by(&self, breadth: Breadth) -> Arc<Tips> {
        let kept = match breadth {
            Breadth::Limbs => &self.matched_by[0],
            Breadth::Fingers => &self.matched_by[1],
        };
        Arc::clone(kept.get_or_init(|| Arc::new(Tips::new(self, breadth))))
    }

    /// The query's encoding with its best pole.
    pub fn encoding(&self) -> &Encoding {
        &self.best.encoding
    }

    /// A quick unfolding for other poles, to the search's level; `None` where poles are fixed.
    pub fn try_poles(&self, poles: &[u32]) -> Option<Unfolded> {
        let conformal = self.conformal.as_ref()?;
        let encoding = if conformal.is_precise_at(poles) {
            let trials = self.trials.get_or_init(|| Trials::new(conformal.mesh()));
            trials.encoding(conformal, poles, SEARCH_SIDE)
        } else {
            encode_to(&self.unfolder.chart(poles).ok()?, SEARCH_SIDE)
        };
        Some(Unfolded::new(poles, encoding))
    }

    /// The view about some poles, `side` pixels a side; `None` where poles are fixed, or so near the boundary that the
    /// conformal map tells nothing there.
    pub fn view(&self, poles: &[u32], side: usize) -> Option<View> {
        let conformal = self.conformal.as_ref().filter(|conformal| conformal.is_precise_at(poles))?;
        Some(self.trials.get_or_init(|| Trials::new(conformal.mesh())).view(conformal, poles, side))
    }

    /// The same as [`Self::try_poles`], kept for the next who tries them: the best examples' searches begin at the same
    /// poles.
    pub fn tried(&self, poles: &[u32]) -> Option<Arc<Unfolded>> {
        self.tried.get_or(poles, TRIED_MAX, || self.try_poles(poles).map(Arc::new))
    }

    /// A chart for other poles: by a Möbius transformation where that is precise, else solved for; `None` where poles
    /// are fixed.
    pub fn quick_chart(&self, poles: &[u32]) -> Option<Chart> {
        let conformal = self.conformal.as_ref()?;
        if conformal.is_precise_at(poles) { Some(conformal.chart(poles)) } else { self.unfolder.chart(poles).ok() }
    }

    /// The exact chart for some poles.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn chart_for(&self, poles: &[u32]) -> Result<Arc<Chart>, UnfoldError> {
        if self.best.poles == poles {
            return Ok(Arc::clone(&self.chart));
        }
        Ok(Arc::new(self.unfolder.chart(poles)?))
    }

    /// The exact unfolding for some poles, to a level.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn unfolded_to(&self, poles: &[u32], finest: usize) -> Result<Arc<Unfolded>, UnfoldError> {
        if self.best.poles == poles {
            return Ok(Arc::clone(&self.best));
        }
        Ok(Arc::new(Unfolded::new(poles, encode_to(&self.unfolder.chart(poles)?, finest))))
    }

    /// The exact unfolding to all levels for some poles; for rival poles, which many examples take, it is kept.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn unfolded_for(&self, poles: &[u32]) -> Result<Arc<Unfolded>, UnfoldError> {
        let most = if self.pole_sets.iter().any(|rivals| rivals == poles) { self.pole_sets.len() } else { 0 };
        self.solved.get_or(poles, most, || self.unfolded_to(poles, SIDE_FINEST))
    }
}
