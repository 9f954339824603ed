//! What the service and the store call the same things.

use super::pack_counts;
use crate::work::corpus::NewExample;
use crate::work::engine::{Cut, ExtraParts, PackedEncoding, PackedFeature};
use quadmuse_proto::{ExamplePatch, MeshCounts, NamedPoint, Segmentation, Topology};
use quadmuse_store::{
    ChartRecord, DerivedSegment, Feature, LandmarkRecord, Level, NewSegmentation, Patch, SegmentSummary,
};

pub(super) fn topology_out(topology: quadmuse_store::Topology) -> Topology {
    match topology {
        quadmuse_store::Topology::Disc => Topology::Disc,
        quadmuse_store::Topology::Annulus => Topology::Annulus,
        quadmuse_store::Topology::Sphere => Topology::Sphere,
        quadmuse_store::Topology::Torus => Topology::Torus,
    }
}

pub(super) fn topology_in(topology: Topology) -> quadmuse_store::Topology {
    match topology {
        Topology::Disc => quadmuse_store::Topology::Disc,
        Topology::Annulus => quadmuse_store::Topology::Annulus,
        Topology::Sphere => quadmuse_store::Topology::Sphere,
        Topology::Torus => quadmuse_store::Topology::Torus,
    }
}

/// An annotation, whose landmarks were found on the surface.
pub(super) fn patch_in(patch: &ExamplePatch) -> Patch {
    let landmark = |named: &NamedPoint| {
        let (name, vertex) = (named.name.clone(), named.vertex);
        named.point.map(|point| LandmarkRecord { name, point, vertex })
    };
    Patch {
        name: patch.name.clone(),
        tags: patch.tags.clone(),
        relevance: patch.relevance.map(|relevance| relevance as f32),
        author: patch.author.clone(),
        licence: patch.licence.clone(),
        notes: patch.notes.clone(),
        landmarks: patch.landmarks.as_ref().map(|all| all.iter().filter_map(landmark).collect()),
        from_revision: patch.revision,
    }
}

pub(super) fn landmark_out(record: &LandmarkRecord) -> NamedPoint {
    NamedPoint { name: record.name.clone(), vertex: record.vertex, point: Some(record.point) }
}

/// The labels as numbers from 0, in the order of the labels: only which faces share one matters.
pub(super) fn dense(labels: &[i64]) -> Vec<u32> {
    let mut sorted = labels.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    labels.iter().map(|label| sorted.partition_point(|other| other < label) as u32).collect()
}

/// How the store is told of a cut, whose labels, or parts besides the whole, are `labels`.
pub(super) fn segmentation_in<'a>(cut: &Cut, labels: Option<&'a [u32]>) -> NewSegmentation<'a> {
    match (labels, cut.way) {
        (Some(parts), _) if cut.labels.is_none() => NewSegmentation::Parted(parts),
        (Some(labels), _) => NewSegmentation::Labels(labels),
        (None, Segmentation::Auto) => NewSegmentation::Auto,
        (None, Segmentation::Whole) => NewSegmentation::Whole,
        (None, Segmentation::Groups) => NewSegmentation::Groups,
    }
}

/// The labels of a cut, or the part of each face besides the whole.
pub(super) fn labels_in(cut: &Cut) -> Option<Vec<u32>> {
    match (&cut.labels, &cut.besides) {
        (Some(labels), _) => Some(dense(labels)),
        (None, ExtraParts::Known(parts)) => Some(parts.iter().map(|&part| u32::try_from(part).unwrap_or(0)).collect()),
        (None, ExtraParts::Nothing | ExtraParts::Sought) => None,
    }
}

pub(super) fn derived_in(packed: &PackedEncoding, counts: MeshCounts) -> DerivedSegment {
    let level = |(side, lambda): &(u32, Vec<f32>)| Level { side: *side, lambda: lambda.clone() };
    DerivedSegment {
        topology: topology_in(packed.facts.topology),
        modulus: packed.facts.k,
        poles: Vec::new(),
        levels: packed.levels.iter().map(level).collect(),
        features: packed.features.iter().map(feature_in).collect(),
        // What no translation and no remeshing changes.
        signature: packed.facts.bending.into_iter().collect(),
        chart: ChartRecord { uv: Vec::new(), extra: pack_counts(counts) },
    }
}

pub(super) fn feature_in(feature: &PackedFeature) -> Feature {
    Feature { u: feature.uv[0], v: feature.uv[1], lambda: feature.lambda, level: feature.side }
}

pub(super) fn feature_out(feature: &Feature) -> PackedFeature {
    PackedFeature { uv: [feature.u, feature.v], lambda: feature.lambda, side: feature.level }
}

/// Counts beyond 4 × 10⁹ are beyond every limit on meshes.
pub(super) fn short(count: u64) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// An example in the shapes of the store.
pub(super) struct ShapedExample {
    pub(super) new: NewExample,
    labels: Option<Vec<u32>>,
    segments: Vec<SegmentSummary>,
    derived: Vec<DerivedSegment>,
}

impl ShapedExample {
    pub(super) fn of(new: NewExample) -> Self {
        let summary = |packed: &PackedEncoding| SegmentSummary {
            topology: topology_in(packed.facts.topology),
            vertices: 0,
            faces: short(packed.facts.faces),
            modulus: packed.facts.k,
            area_share: 0.0,
            pole_override: None,
        };
        Self {
            labels: labels_in(&new.cut),
            segments: new.segments.iter().map(summary).collect(),
            derived: new.segments.iter().map(|packed| derived_in(packed, new.counts)).collect(),
            new,
        }
    }

    /// Its encodings.
    pub(super) fn derived(&self) -> &[DerivedSegment] {
        &self.derived
    }

    pub(super) fn for_store(&self) -> quadmuse_store::NewExample<'_> {
        let new = &self.new;
        quadmuse_store::NewExample {
            name: &new.name,
            tags: &new.tags,
            relevance: new.relevance as f32,
            format: &new.format,
            mesh: &new.bytes,
            segmentation: segmentation_in(&new.cut, self.labels.as_deref()),
            segments: &self.segments,
            vertices: short(new.counts.vertices),
            faces: short(new.counts.faces),
            repairs: &new.repairs,
            encoder_version: new.encoder_version,
            derived: &self.derived,
        }
    }
}
