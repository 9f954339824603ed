//! The seam to the geometry: what the service asks of the kernel, and nothing more.
//!
//! [`kernel`] answers it in earnest; tests put a small fake in its place, which can be slow, fail and panic on demand.
//! Every method is a plain sequential computation, to be run on the pool.

use crate::pool::{Stop, StopReason};
pub use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_kernel::rank::SegmentShape;
use quadmuse_kernel::rank::coarse::CoarseQuery;
use quadmuse_kernel::register::spectra::Row;
use quadmuse_kernel::settle::Likeness;
use quadmuse_proto::{ConstraintEdit, Flip, MeshFormat, Topology};
use std::any::Any;
use std::fmt;
use std::sync::Arc;

mod cut;
#[cfg(test)]
pub(crate) mod fake;
pub mod kernel;
mod mapped;
mod packed;
mod rough;

pub use cut::{Cut, ExtraParts, Grain};
pub use mapped::{Fitted, Judgement, Lead, Mapped, Wishes};
pub use packed::{PackedEncoding, PackedFeature};
pub use quadmuse_kernel::compose::rows::{Resized, SizeTarget, faces_within_max};
pub use quadmuse_kernel::numerics::stage::{Stage, leave_out};
pub use quadmuse_kernel::pipeline::{
    AS_MAPPED, AllowedFlaws, Appraisal, BARE, BARE_MIN, LayoutOwner, LimbDistances, MapExtent, OnePart, Refusal,
    RoughPlacement, StitchOptions, Stitched,
};
pub use rough::RoughLead;

/// Why the engine refused or gave up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// The mesh, or what was asked of it, can't be taken. The caller's.
    #[error("{detail}")]
    Refused {
        /// Which kind of refusal.
        refusal: Refusal,
        /// Expected, found, way out; with the line or element where the file is wrong.
        detail: String,
    },
    /// It was told to stop.
    #[error(transparent)]
    Stopped(#[from] StopReason),
    /// A bug of ours.
    #[error("the engine failed: {0}")]
    Internal(String),
}

impl EngineError {
    /// A refusal.
    pub fn refused(refusal: Refusal, detail: impl Into<String>) -> Self {
        Self::Refused { refusal, detail: detail.into() }
    }
}

/// Something that the engine made and only the engine can open.
#[derive(Clone)]
pub struct Opaque(Arc<dyn Any + Send + Sync>);

impl Opaque {
    /// Closes a value.
    pub fn new<T: Any + Send + Sync>(value: T) -> Self {
        Self(Arc::new(value))
    }

    /// Opens a value.
    ///
    /// # Errors
    /// [`EngineError::Internal`] if another engine closed it.
    pub fn open<T: Any>(&self) -> Result<&T, EngineError> {
        self.0.downcast_ref().ok_or_else(|| EngineError::Internal("a value of another engine".into()))
    }
}

impl fmt::Debug for Opaque {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Opaque")
    }
}

/// A mesh that was read, checked and cut.
#[derive(Clone, Debug)]
pub struct Model {
    /// The mesh as uploaded.
    pub mesh: Arc<PolyMesh>,
    /// Its format.
    pub format: MeshFormat,
    /// What was repaired, a sentence each.
    pub repairs: Vec<String>,
    /// Its segments, numbered from 0: where it has parts besides its whole, the whole first.
    pub segments: Vec<ModelSegment>,
    /// The segment of each face, where [`Cut::parts`] and [`Grain::Faces`] asked for an automatic cut, or it was cut as an
    /// example is.
    pub labels: Option<Vec<i64>>,
    /// The part of each face besides the whole, from 1, and 0 for none, where [`Cut::besides`] asked for parts and there are some.
    pub besides: Option<Vec<i64>>,
    /// True where it was cut at its waist: its two segments are no parts of a composition, but what one is laid out around.
    pub is_waist: bool,
    /// What the engine needs to go on.
    pub inner: Opaque,
}

impl Model {
    /// The share of the model's faces that a segment has.
    pub fn share_of(&self, segment: u32) -> f64 {
        let all: u64 = self.segments.iter().map(|segment| segment.faces).sum();
        let of = self.segments.get(segment as usize).map_or(0, |segment| segment.faces);
        of as f64 / all.max(1) as f64
    }
}

/// A segment of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelSegment {
    /// Its topology.
    pub topology: Topology,
    /// Polygons that belong to it.
    pub faces: u64,
    /// How many of them tell of its form: of needles, of a strip or of noise few.
    pub form: u64,
    /// Small holes in it that are counted as filled.
    pub holes: u32,
    /// Its share of the surface's area.
    pub share: f64,
    /// Tells whether it is flat.
    pub is_flat: bool,
    /// Tells whether it borders on no other, and makes up most of the surface.
    pub is_main: bool,
}

impl ModelSegment {
    /// One of so many faces, all of which tell of its form, beside nothing else.
    #[cfg(test)]
    pub fn of(topology: Topology, faces: u64) -> Self {
        Self { topology, faces, form: faces, holes: 0, share: 1.0, is_flat: false, is_main: false }
    }
}

/// What is known of an encoded segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentFacts {
    /// Its topology.
    pub topology: Topology,
    /// Its modulus.
    pub k: f64,
    /// Polygons that belong to it.
    pub faces: u64,
    /// Feature points found.
    pub features: u32,
    /// How its surface bends, as ∫ mean curvature / √area; `None` of an encoding that was made before this was measured.
    pub bending: Option<f32>,
}

impl SegmentFacts {
    /// What is compared of it beside its picture.
    pub fn shape(&self) -> SegmentShape {
        SegmentShape { modulus: self.k, bending: self.bending }
    }
}

/// A segment, encoded for ranking. It may hold all levels of its pyramid or only the coarse ones.
#[derive(Clone, Debug)]
pub struct Encoding {
    /// What is known of it.
    pub facts: SegmentFacts,
    /// What the engine needs to go on.
    pub inner: Opaque,
}

/// A segment, encoded for ranking and unfolded for mapping.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// With all levels.
    pub encoding: Encoding,
    /// What unfolding had to mend, a sentence each.
    pub repairs: Vec<String>,
}

/// An example laid on a query segment, at some level.
#[derive(Clone, Debug)]
pub struct Registration {
    /// The level, in pixels a side.
    pub level: u32,
    /// E.
    pub energy: f64,
    /// How the example is flipped.
    pub flip: Flip,
    /// By how much it is shifted along u, in periods, 0–1.
    pub shift_u: f64,
    /// What the engine needs to go on.
    pub inner: Opaque,
}

/// One side of a map.
#[derive(Clone, Debug)]
pub struct Side {
    /// The mesh.
    pub model: Arc<Model>,
    /// Which segment of it.
    pub segment: u32,
    /// That segment, encoded.
    pub encoded: Arc<Encoded>,
}

/// What a segment takes in a composition.
#[derive(Clone, Debug)]
pub enum Part {
    /// A mapped example.
    Mapped {
        /// [`Mapped::part`].
        part: Arc<PolyMesh>,
        /// [`Mapped::mesh`]: where it is the only part and follows the input, it is the composition.
        whole: Arc<PolyMesh>,
    },
    /// [`Mapped::part`], to be subdivided no further than joining it needs.
    Kept(Arc<PolyMesh>),
    /// The same of a map that [is of the whole](Mapped::is_of_whole): with neighbours of its kind it hangs together as in the
    /// example.
    OfWhole(Arc<PolyMesh>),
    /// A regular layout in place of a map that nobody chose and that is poor.
    Poor(Arc<Encoded>),
    /// A regular layout at the density of its neighbours, on this unfolded segment.
    Template(Arc<Encoded>),
}

/// What the service asks of the geometry.
pub trait Engine: Send + Sync + 'static {
    /// The version of the encoder; encodings of another version are made anew.
    fn version(&self) -> u32;

    /// An upper estimate of the memory that reading and encoding an upload of `bytes` bytes takes, in bytes.
    fn memory_estimate(&self, bytes: u64) -> u64;

    /// An upper estimate of the memory that `count` segments take beside what their bytes do, in bytes.
    fn memory_of_segments(&self, count: usize) -> u64 {
        let _ = count;
        0
    }

    /// An upper estimate of the memory that a map of an example of `bytes` bytes takes as long as it is held, in bytes.
    fn memory_of_map(&self, bytes: u64) -> u64 {
        self.memory_estimate(bytes) / 2
    }

    /// Reads, checks, repairs and cuts a mesh.
    ///
    /// # Errors
    /// [`EngineError::Refused`], [`EngineError::Stopped`].
    fn read(&self, bytes: &[u8], format: Option<MeshFormat>, cut: &Cut, stop: &Stop) -> Result<Model, EngineError>;

    /// A query's model cut as an example is: segment k lies where segment k of the example does. `labels` tell the
    /// segment of each face.
    ///
    /// # Errors
    /// [`EngineError::Refused`] where either is no primitive when whole, or the parts would not be alike;
    /// [`EngineError::Stopped`].
    fn alike(&self, query: &Model, example: &Model, stop: &Stop) -> Result<Model, EngineError> {
        let _ = (query, example);
        let refused = EngineError::refused(Refusal::Unlike, "this engine does not cut inputs as examples are");
        stop.reason().map_or(Err(refused), |reason| Err(reason.into()))
    }

    /// A mesh that lies on a scan with more or fewer rows of quads; as it is where the engine can't.
    ///
    /// # Errors
    /// [`EngineError::Stopped`], [`EngineError::Internal`].
    fn resized(&self, scan: &Model, mesh: &PolyMesh, wanted: SizeTarget, stop: &Stop) -> Result<Resized, EngineError> {
        let _ = (scan, wanted, stop);
        Ok(Resized { mesh: mesh.clone(), within: 0.0 })
    }

    /// A model's mesh, whose faces tell the segment that they belong to.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn labelled_by_segment(&self, model: &Model) -> Result<Arc<PolyMesh>, EngineError> {
        Ok(Arc::clone(&model.mesh))
    }

    /// Unfolds and encodes a segment.
    ///
    /// # Errors
    /// [`EngineError::Refused`], [`EngineError::Stopped`].
    fn encode(&self, model: &Model, segment: u32, stop: &Stop) -> Result<Encoded, EngineError>;

    /// An encoding as it is stored.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn pack(&self, encoding: &Encoding) -> Result<PackedEncoding, EngineError>;

    /// An encoding from storage, with those levels that are there.
    ///
    /// # Errors
    /// [`EngineError::Internal`] when it is not one that [`Engine::pack`] made.
    fn unpack(&self, packed: &PackedEncoding) -> Result<Encoding, EngineError>;

    /// What is kept in memory of an example, from its coarsest level.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn row(&self, example: &Encoding) -> Result<Row, EngineError>;

    /// A query, prepared for sweeps over rows of examples of a topology.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn coarse_query(&self, query: &Encoding, examples: Topology) -> Result<CoarseQuery, EngineError>;

    /// Makes what finishing needs of a query whatever the example, so that whoever finishes first needn't.
    fn ready(&self, query: &Encoding) {
        let _ = query;
    }

    /// Registers an example on a query at the coarsest level: all flips and translations.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn coarse(&self, example: &Encoding, query: &Encoding, stop: &Stop) -> Result<Registration, EngineError>;

    /// Refines a registration at the next level, which both encodings must hold.
    ///
    /// # Errors
    /// [`EngineError::Stopped`], [`EngineError::Internal`].
    fn refine(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError>;

    /// Finishes a registration of the best: what costs too much to do for all. `example` holds all levels up to the
    /// one reached.
    ///
    /// # Errors
    /// [`EngineError::Stopped`], [`EngineError::Internal`].
    fn finish(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError>;

    /// E′ of a registration (eq. 8): the lower the better.
    fn score(&self, registration: &Registration, example: &SegmentFacts, query: &Encoding, relevance: f64) -> f64;

    /// Maps every vertex of the example's segment onto the query's.
    ///
    /// # Errors
    /// [`EngineError::Stopped`], [`EngineError::Internal`].
    fn map(&self, from: &Registration, example: &Side, query: &Side, stop: &Stop) -> Result<Mapped, EngineError>;

    /// Lays an example's segment on the query's wherever it fits best: on all of it, on a part of it, or a part of the example on
    /// it. `from` is the registration of both as wholes, where there is one. Landmarks are held on their places.
    ///
    /// # Errors
    /// [`EngineError::Refused`] where the two can't be compared, or a landmark names no point; [`EngineError::Stopped`].
    fn fit(
        &self,
        from: Option<&Registration>,
        example: &Side,
        query: &Side,
        wishes: &Wishes,
        stop: &Stop,
    ) -> Result<Fitted, EngineError> {
        let _ = wishes;
        let from = from.ok_or_else(|| EngineError::Internal("expected surfaces of one topology".into()))?;
        let mapped = self.map(from, example, query, stop)?;
        Ok(Fitted { mapped, example: example.clone(), query: query.clone() })
    }

    /// A segment made ready for [`Engine::likeness`]; `None` where it can't be compared so.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn posed(&self, model: &Model, segment: u32) -> Result<Option<Opaque>, EngineError> {
        let _ = (model, segment);
        Ok(None)
    }

    /// How well one surface lies on the other in its best rigid pose: the shapes themselves, not their pictures.
    ///
    /// # Errors
    /// [`EngineError::Stopped`], [`EngineError::Internal`].
    fn likeness(&self, one: &Opaque, two: &Opaque, stop: &Stop) -> Result<Likeness, EngineError> {
        let _ = (one, two);
        stop.reason().map_or(Ok(Likeness::default()), |reason| Err(reason.into()))
    }

    /// Measures the distances between the limbs of an unfolded segment; `None` where it has too few.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn limbs(&self, encoding: &Encoding) -> Result<Option<LimbDistances>, EngineError> {
        let _ = encoding;
        Ok(None)
    }

    /// A query's segment made ready for all examples that are laid on it roughly; `None` where none can be.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn ready_for_rough(&self, query: &Model, segment: u32) -> Result<Option<Opaque>, EngineError> {
        let _ = (query, segment);
        Ok(None)
    }

    /// Lays an example's segment on the query's, which is ready for it, roughly, at a tenth of what a map costs. `encodings`: of
    /// both, where tips are to be matched. `lead`: an example that lies on the query, and tells where this one belongs. `None` where it can't be laid so.
    ///
    /// # Errors
    /// [`EngineError::Stopped`], [`EngineError::Internal`].
    fn rough(
        &self,
        example: (&Model, u32),
        query: (&Model, u32, &Opaque),
        encodings: Option<[&Encoding; 2]>,
        lead: Option<&RoughLead>,
        stop: &Stop,
    ) -> Result<Option<RoughPlacement>, EngineError> {
        let _ = (example, query, encodings, lead);
        stop.reason().map_or(Ok(None), |reason| Err(reason.into()))
    }

    /// The topologies of the examples that a query of some topology is ranked against, its own first; `is_most`: whether it is much
    /// of a scan.
    fn ranked_against(&self, query: Topology, is_most: bool) -> Vec<Topology> {
        let _ = is_most;
        vec![query]
    }

    /// Whether examples of one topology can be laid on inputs of another.
    fn reaches(&self, example: Topology, query: Topology) -> bool {
        example == query
    }

    /// A registration with other constraints.
    ///
    /// # Errors
    /// [`EngineError::Refused`] when a constraint is unknown, names no point of its surface, or folds the map.
    fn constrain(
        &self,
        from: &Mapped,
        edit: &ConstraintEdit,
        example: &Side,
        query: &Side,
        stop: &Stop,
    ) -> Result<Registration, EngineError>;

    /// Maps once more after an edit of the constraints of `before`.
    ///
    /// # Errors
    /// As [`Engine::map`].
    fn edited(
        &self,
        from: &Registration,
        before: &Mapped,
        example: &Side,
        query: &Side,
        stop: &Stop,
    ) -> Result<Mapped, EngineError> {
        let _ = before;
        self.map(from, example, query, stop)
    }

    /// Puts one example whose segments were mapped on all of a query's segments together again, whole. `None` where the
    /// segments do not border on each other alike, so that they have to be stitched.
    ///
    /// # Errors
    /// [`EngineError`].
    fn rejoin(
        &self,
        query: &Model,
        example: &Model,
        parts: &[OnePart],
        stop: &Stop,
    ) -> Result<Option<Stitched>, EngineError> {
        let _ = (query, example, parts);
        stop.reason().map_or(Ok(None), |reason| Err(reason.into()))
    }

    /// The input of one segment, or one cut at its waist, cut along the rim of a map that lies on a part of it, and the map's own
    /// faces. Segment 0 is what the map covers, the others are the rest. `None` where nothing lies beyond the map, or the rest is
    /// ragged. `segment`: the segment that the map lies on.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn around(
        &self,
        query: &Model,
        segment: u32,
        mapped: &Mapped,
    ) -> Result<Option<(Model, Arc<PolyMesh>)>, EngineError> {
        let _ = (query, segment, mapped);
        Ok(None)
    }

    /// An input that was cut at its waist, cut into primitives instead.
    ///
    /// # Errors
    /// [`EngineError::Refused`] where it can't be cut.
    fn recut(&self, query: &Model) -> Result<Model, EngineError> {
        Ok(query.clone())
    }

    /// Stitches maps into one mesh of quads, smoothed and projected back onto the input.
    ///
    /// # Errors
    /// [`EngineError::Refused`] when the parts can't be stitched, [`EngineError::Stopped`].
    ///
    /// There is one part a segment, in their order.
    fn compose(&self, query: &Model, parts: &[Part], how: StitchOptions, stop: &Stop) -> Result<Stitched, EngineError>;

    /// Tells of each segment whether it has its components of the input to itself, so that it needs no stitching.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn alone(&self, query: &Model) -> Result<Vec<bool>, EngineError> {
        Ok(vec![false; query.segments.len()])
    }

    /// The faces of a composition that stand on some segments, and which of them, in order, bridge a gap.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn of_segments(
        &self,
        _query: &Model,
        _made: &Stitched,
        _segments: &[u32],
    ) -> Result<(Arc<PolyMesh>, Vec<u32>), EngineError> {
        Ok((Arc::default(), Vec::new()))
    }

    /// Measures a composition against its input.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn appraise(&self, query: &Model, made: &Stitched, allowed: AllowedFlaws) -> Result<Appraisal, EngineError>;

    /// Splits the faces of maps that stand as they are, and were split so many times before; `None` where they would be too many.
    ///
    /// # Errors
    /// [`EngineError::Internal`].
    fn split(&self, query: &Model, made: &Stitched, splits: u32) -> Result<Option<Stitched>, EngineError>;

    /// A regular layout on a query's segment, in place of an example; measured where it is the only segment.
    ///
    /// # Errors
    /// [`EngineError::Refused`] where none can be made, [`EngineError::Stopped`], [`EngineError::Internal`].
    fn template(&self, query: &Side, stop: &Stop) -> Result<Mapped, EngineError>;

    /// A mesh as a file.
    ///
    /// # Errors
    /// [`EngineError::Refused`] when the format can't hold it.
    fn write(&self, mesh: &PolyMesh, format: MeshFormat) -> Result<Vec<u8>, EngineError>;
}
