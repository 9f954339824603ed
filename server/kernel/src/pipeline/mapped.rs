//! Maps as the pipeline makes them, and what is wished of them.

use super::constraint::{Constraint, Landmark};
use super::registered::Registered;
use super::roughly::RoughPlacement;
use super::side::Side;
use crate::measure::Distortion;
use crate::mesh::PolyMesh;
use crate::register::Flip;
use crate::settle::Evidence;
use std::sync::Arc;

/// A judgement of a map; the better is the less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Use it.
    Good,
    /// It has a flaw that is told.
    Fair,
    /// Another example is better.
    Poor,
    /// Its mesh is of no use as it is.
    Broken,
}

/// How the input is treated where it reaches beyond the example.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Beyond {
    /// It is left bare: the example's faces alone.
    #[default]
    Leave,
    /// Rows of quads continue the example's boundary to where the input ends, and its faces are extruded along protrusions that it
    /// lacks.
    Extend,
}

/// The shares of both surfaces' areas that the other reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covers {
    /// Of the example: less than 1 where it reaches beyond the input.
    pub example: f64,
    /// Of the query's segment: less than 1 where it reaches beyond the example.
    pub input: f64,
}

impl Default for Covers {
    fn default() -> Self {
        Self { example: 1.0, input: 1.0 }
    }
}

/// The extent of a map: the part of an example that lies on an input, and the part of the input that it covers.
#[derive(Clone, Debug, Default)]
pub struct MapExtent {
    /// Shares of the areas.
    pub covers: Covers,
    /// The example's vertices that the mesh has; `None`: all of them.
    pub kept: Option<Vec<u32>>,
    /// The example's own vertices and faces of the mesh, which come first; `None`: all of it.
    pub own: Option<(u64, u64)>,
    /// Share of the mesh's area that its own faces have; `None`: all of it.
    pub inspired: Option<f64>,
    /// True where limbs that the scan lacks are left out of the example, and leave openings in it.
    pub is_open: bool,
    /// Faces of the mesh, in order, for which the scan has nothing: they are spanned flat.
    pub bridging: Vec<u32>,
    /// Share of the example's faces that these are.
    pub spanned: f64,
    /// The mesh before faces of it were extruded along protrusions of the scan that the example lacks; `None`: none were.
    pub unextruded: Option<Arc<PolyMesh>>,
}

/// A verdict, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
}

/// An example's segment on a query's segment.
#[derive(Clone, Debug)]
pub struct Mapped {
    /// The example's mesh on the input: the same vertex order, faces, UVs and groups. Segments of the example that
    /// were not mapped are left out.
    pub mesh: Arc<PolyMesh>,
    /// The same as a part to be stitched: the polygons of the segment alone, manifold.
    pub part: Arc<PolyMesh>,
    /// The registration that was used, with the caller's constraints.
    pub registration: Registered,
    /// How the example was flipped.
    pub flip: Flip,
    /// It is a part of an example that was laid whole, on a query that was cut as that example is.
    pub is_of_whole: bool,
    /// The pairs of points that fix it.
    pub constraints: Vec<Constraint>,
    /// Faces flipped on the input beyond the example's own.
    pub folds: u64,
    /// How it distorts the example.
    pub distortion: Distortion,
    /// The judgement of it.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// The judgement of it where it is stitched, if that is another: stitching reaches what it leaves bare.
    pub stitched: Option<Judgement>,
    /// How much of each surface the other reaches.
    pub reach: MapExtent,
    /// The measures behind the verdict, where the example has settled on the input.
    pub evidence: Option<Evidence>,
    /// How sure it is then, on one scale for closed and open examples: .1 where it is barely fair, .4 where it is good.
    pub sureness: Option<f64>,
}

/// Holds what is kept of a map through an edit: how it was judged before.
#[derive(Clone, Debug)]
pub struct MapBeforeEdit {
    /// Its folds.
    pub folds: u64,
    /// Its verdict.
    pub verdict: Verdict,
    /// Its reasons.
    pub reasons: Vec<String>,
    /// How much of each surface the other reached.
    pub reach: MapExtent,
    /// The measures behind the verdict, where the example had settled.
    pub evidence: Option<Evidence>,
    /// How sure it was then.
    pub sureness: Option<f64>,
}

impl Mapped {
    /// This map as an edit of another: what was kept of the example and how well the shapes agree stays; folds that the map before the
    /// first edit did not have make it worse.
    #[must_use]
    pub(super) fn after(mut self, before: &MapBeforeEdit) -> Self {
        let unedited = self.registration.unedited.get_or_insert_with(|| Arc::new(before.clone()));
        self.reach = MapExtent {
            covers: before.reach.covers,
            kept: before.reach.kept.clone(),
            is_open: before.reach.is_open,
            bridging: before.reach.bridging.clone(),
            ..MapExtent::default()
        };
        if before.evidence.is_some() {
            (self.evidence, self.sureness) = (before.evidence, before.sureness);
            (self.verdict, self.reasons) = (unedited.verdict, unedited.reasons.clone());
            if self.verdict == Verdict::Broken {
                // The edited map is checked anew.
                self.verdict = Verdict::Poor;
            }
            if self.folds > unedited.folds && self.verdict < Verdict::Poor {
                self.verdict = Verdict::Fair;
                self.reasons.push("the edit turns some faces over".into());
            }
        }
        self
    }
}

/// A caller's wishes for how an example is laid.
#[derive(Clone, Debug, Default)]
pub struct Wishes {
    /// The treatment of an input that reaches beyond the example.
    pub beyond: Beyond,
    /// Points of the example that are held on points of the input.
    pub landmarks: Vec<Landmark>,
    /// A map of another example on the same segment, which tells where this one belongs.
    pub lead: Option<Lead>,
    /// Its rough pose, where the ranking tried one.
    pub rough: Option<RoughPlacement>,
}

/// A map of an example that lies on a part of others, too.
#[derive(Clone, Debug)]
pub struct Lead {
    /// Its example.
    pub example: Side,
    /// The example's vertices that its mesh has; `None`: all of them.
    pub kept: Option<Vec<u32>>,
    /// Its mesh.
    pub mesh: Arc<PolyMesh>,
}

/// An example laid where it fits best, with what there is left of either surface.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The map.
    pub mapped: Mapped,
    /// The example, or what is left of it.
    pub example: Side,
    /// The query, or what is left of it.
    pub query: Side,
}
