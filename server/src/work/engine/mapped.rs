//! Maps as the engine makes them.

use super::{MapExtent, Registration, RoughPlacement, Side};
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::{Beyond, Constraint, Distortion, Landmark, MapEvidence, Verdict};
use std::sync::Arc;

/// An example's segment on a query's segment.
#[derive(Clone, Debug)]
pub struct Mapped {
    /// The example's mesh on the input: the same vertex order, faces, UVs and groups. Segments of the example that
    /// were not mapped are left out.
    pub mesh: Arc<PolyMesh>,
    /// The same as a part to be stitched: the polygons of the segment alone, manifold.
    pub part: Arc<PolyMesh>,
    /// The registration that was used, with the caller's constraints.
    pub registration: Registration,
    /// Whether it is a part of the example that the query was cut alike, where the whole was laid.
    pub is_of_whole: bool,
    /// The pairs of points that fix it.
    pub constraints: Vec<Constraint>,
    /// Faces flipped on the input beyond the example's own.
    pub folds: u64,
    /// How it distorts the example.
    pub distortion: Distortion,
    /// Whether it is worth keeping.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// The judgement of it where it is stitched, if that is another: stitching reaches what it leaves bare.
    pub stitched: Option<Judgement>,
    /// How much of each surface the other reaches.
    pub reach: MapExtent,
    /// The measures behind the verdict, where the example has settled on the input.
    pub evidence: Option<MapEvidence>,
    /// How sure it is then, on one scale for closed and open examples: .1 where it is barely fair, .4 where it is good.
    pub sureness: Option<f64>,
}

impl Mapped {
    /// The mesh without what was extruded from it.
    pub fn unextruded(&self) -> &Arc<PolyMesh> {
        self.reach.unextruded.as_ref().unwrap_or(&self.mesh)
    }
}

/// A verdict, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
}

impl Mapped {
    /// The judgement of it where it is stitched.
    pub fn stitched(&self) -> Judgement {
        let alike = || Judgement { verdict: self.verdict, reasons: self.reasons.clone() };
        self.stitched.clone().unwrap_or_else(alike)
    }

    /// Tells whether it is of no use where it is stitched.
    pub fn is_poor_stitched(&self) -> bool {
        self.stitched.as_ref().map_or(self.verdict, |stitched| stitched.verdict).is_poor()
    }
}

/// How an example is to be laid.
#[derive(Clone, Debug, Default)]
pub struct Wishes {
    /// How the input is treated where it reaches beyond the example.
    pub beyond: Beyond,
    /// Points of the example that are held on points of the input.
    pub landmarks: Vec<Landmark>,
    /// A map of another example on the same segment, which tells where this one belongs.
    pub lead: Option<Lead>,
    /// How it lies when it is laid roughly, where the ranking tried that.
    pub rough: Option<RoughPlacement>,
}

/// A map of an example that lies on a part of others, too.
#[derive(Clone, Debug)]
pub struct Lead {
    /// Its example.
    pub example: Side,
    /// The map.
    pub mapped: Mapped,
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
