//! What the service and the kernel's pipeline say to each other, word for word: messages of the wire on one side, the
//! kernel's own types on the other.

use super::super::{
    Cut, Encoded, Encoding, EngineError, Judgement, Mapped, Model, ModelSegment, Opaque, Registration, SegmentFacts,
    Side, Wishes,
};
use super::Source;
use crate::pool::{Stop, StopReason};
use quadmuse_kernel::measure::Distribution;
use quadmuse_kernel::mesh::Format;
use quadmuse_kernel::pipeline::{self, PipelineError, Registered};
use quadmuse_kernel::segment::PartCount;
use quadmuse_kernel::settle::Evidence;
use quadmuse_kernel::{register, topology};
use quadmuse_proto::constraint::Place;
use quadmuse_proto::{
    Beyond, Components, Constraint, ConstraintEdit, ConstraintOrigin, Distortion, Flip, Histogram, Location,
    MapEvidence, MeshFormat, OnFold, Parts, Segmentation, Topology, Verdict,
};
use std::sync::Arc;

/// Turns what the pipeline came to into an answer of the engine, with the reason where it was stopped.
pub(super) fn outcome<T>(result: Result<T, PipelineError>, stop: &Stop) -> Result<T, EngineError> {
    result.map_err(|error| match error {
        PipelineError::Refused { refusal, detail } => EngineError::Refused { refusal, detail },
        PipelineError::Stopped => EngineError::Stopped(stop.reason().unwrap_or(StopReason::Cancelled)),
        PipelineError::Internal(detail) => EngineError::Internal(detail),
    })
}

pub(super) fn cut(of: &Cut) -> pipeline::Cut {
    pipeline::Cut {
        way: match of.way {
            Segmentation::Auto => pipeline::CutMethod::Auto,
            Segmentation::Whole => pipeline::CutMethod::Whole,
            Segmentation::Groups => pipeline::CutMethod::Groups,
        },
        labels: of.labels.clone(),
        components: match of.components {
            Components::Largest => topology::Components::SmallLeftOut,
            Components::Refuse => topology::Components::Refuse,
        },
        parts: of.parts.map(|parts| match parts {
            Parts::None => PartCount::AsNeeded,
            Parts::Auto => PartCount::Protrusions,
            Parts::Waist => PartCount::AtWaist,
            Parts::Count(n) => PartCount::About(n as usize),
        }),
        grain: of.grain,
        besides: of.besides.clone(),
    }
}

pub(super) fn model(inner: pipeline::Model) -> Model {
    let inner = Arc::new(inner);
    Model {
        mesh: Arc::clone(&inner.mesh),
        format: format_out(inner.format),
        repairs: inner.repairs.clone(),
        segments: segments(&inner),
        labels: inner.labels.clone(),
        besides: inner.besides.clone(),
        is_waist: inner.is_at_waist(),
        inner: Opaque::new(inner),
    }
}

fn segments(model: &pipeline::Model) -> Vec<ModelSegment> {
    let segment = |pipeline::Segment { topology, faces, form, holes, share, is_flat, is_main }| ModelSegment {
        topology: topology_out(topology),
        faces,
        form,
        holes,
        share,
        is_flat,
        is_main,
    };
    model.segments().into_iter().map(segment).collect()
}

/// The kernel's model of a mesh that was read.
pub(super) fn model_in(model: &Model) -> Result<&Arc<pipeline::Model>, EngineError> {
    model.inner.open()
}

pub(super) fn side_in(side: &Side) -> Result<pipeline::Side, EngineError> {
    Ok(pipeline::Side {
        model: Arc::clone(model_in(&side.model)?),
        segment: side.segment,
        encoded: Arc::clone(encoded_in(&side.encoded)?),
    })
}

pub(super) fn encoded_in(encoded: &Encoded) -> Result<&Arc<pipeline::Encoded>, EngineError> {
    super::fresh(&encoded.encoding)
}

/// A side that came back: as it was `given`, or what is left of that.
pub(super) fn side(side: pipeline::Side, given: &Side) -> Result<Side, EngineError> {
    if Arc::ptr_eq(&side.model, model_in(&given.model)?) && side.segment == given.segment {
        return Ok(given.clone());
    }
    let model = Model {
        segments: segments(&side.model),
        labels: side.model.labels.clone(),
        inner: Opaque::new(side.model),
        ..(*given.model).clone()
    };
    Ok(Side { model: Arc::new(model), segment: side.segment, encoded: Arc::new(encoded(side.encoded)) })
}

pub(super) fn encoded(inner: Arc<pipeline::Encoded>) -> Encoded {
    let pipeline::SegmentFacts { topology, modulus, faces, features, bending } = inner.facts;
    let facts = SegmentFacts { topology: topology_out(topology), k: modulus, faces, features, bending: Some(bending) };
    let repairs = inner.repairs.clone();
    Encoded { encoding: Encoding { facts, inner: Opaque::new(Source::Fresh(inner)) }, repairs }
}

pub(super) fn registration(registered: Registered) -> Registration {
    let best = registered.registration();
    Registration {
        level: registered.entry().side() as u32,
        energy: best.energy,
        flip: flip(best.flip),
        shift_u: best.shift_u(),
        inner: Opaque::new(registered),
    }
}

fn flip(of: register::Flip) -> Flip {
    Flip { u: of.u, v: of.v }
}

pub(super) fn mapped(of: pipeline::Mapped) -> Mapped {
    Mapped {
        mesh: of.mesh,
        part: of.part,
        registration: Registration { flip: flip(of.flip), ..registration(of.registration) },
        is_of_whole: of.is_of_whole,
        constraints: of.constraints.into_iter().map(constraint).collect(),
        folds: of.folds,
        distortion: Distortion {
            angle: histogram(&of.distortion.angle_deg, of.distortion.faces),
            area: histogram(&of.distortion.area_log2, of.distortion.faces),
        },
        verdict: verdict(of.verdict),
        reasons: of.reasons,
        stitched: of.stitched.map(|of| Judgement { verdict: verdict(of.verdict), reasons: of.reasons }),
        reach: of.reach,
        evidence: of.evidence.map(|found| MapEvidence {
            agreement: found.agreement(),
            relief: found.relief,
            local_relief: found.local_relief,
            shear: found.shear,
            scale_spread: found.scale_spread,
            bend: found.bend,
            residual: found.residual,
            normal_disagreement: found.normal_disagreement,
        }),
        sureness: of.sureness,
    }
}

/// What an edit keeps of a map; of the evidence what was told of it. What it left bare is measured anew.
pub(super) fn before(of: &Mapped) -> pipeline::MapBeforeEdit {
    let kept = of.stitched();
    pipeline::MapBeforeEdit {
        folds: of.folds,
        verdict: match kept.verdict {
            Verdict::Good => pipeline::Verdict::Good,
            Verdict::Fair => pipeline::Verdict::Fair,
            Verdict::Poor => pipeline::Verdict::Poor,
            Verdict::Broken => pipeline::Verdict::Broken,
        },
        reasons: kept.reasons,
        reach: of.reach.clone(),
        evidence: of.evidence.map(|evidence| Evidence {
            relief: evidence.relief,
            local_relief: evidence.local_relief,
            shear: evidence.shear,
            scale_spread: evidence.scale_spread,
            bend: evidence.bend,
            residual: evidence.residual,
            normal_disagreement: evidence.normal_disagreement,
            ..Evidence::default()
        }),
        sureness: of.sureness,
    }
}

fn verdict(of: pipeline::Verdict) -> Verdict {
    match of {
        pipeline::Verdict::Good => Verdict::Good,
        pipeline::Verdict::Fair => Verdict::Fair,
        pipeline::Verdict::Poor => Verdict::Poor,
        pipeline::Verdict::Broken => Verdict::Broken,
    }
}

fn histogram(from: &Distribution, faces: usize) -> Histogram {
    let n = from.shares.len();
    let edge = |k: usize| from.low + (from.high - from.low) * k as f64 / n as f64;
    Histogram {
        edges: (0..=n).map(edge).collect(),
        counts: from.shares.iter().map(|share| (share * faces as f64).round() as u64).collect(),
        mean: from.mean,
        median: from.median,
        p95: from.p95,
        max: from.max,
    }
}

pub(super) fn wishes(of: &Wishes) -> Result<pipeline::Wishes, EngineError> {
    let landmark = |l: &quadmuse_proto::Landmark| pipeline::Landmark {
        on_example: place(&l.on_example),
        on_input: place(&l.on_input),
    };
    let lead = of.lead.as_ref().map(|lead| -> Result<pipeline::Lead, EngineError> {
        let (kept, mesh) = (lead.mapped.reach.kept.clone(), Arc::clone(lead.mapped.unextruded()));
        Ok(pipeline::Lead { example: side_in(&lead.example)?, kept, mesh })
    });
    Ok(pipeline::Wishes {
        beyond: match of.beyond {
            Beyond::Leave => pipeline::Beyond::Leave,
            Beyond::Extend => pipeline::Beyond::Extend,
        },
        landmarks: of.landmarks.iter().map(landmark).collect(),
        lead: lead.transpose()?,
        rough: of.rough.clone(),
    })
}

fn place(of: &Place) -> pipeline::Place {
    match of {
        Place::Point(point) => pipeline::Place::Point(*point),
        Place::OnFace { face, barycentric } => {
            pipeline::Place::OnFace { face: *face, barycentric: barycentric.clone() }
        }
        Place::OnVertex { vertex } => pipeline::Place::OnVertex { vertex: *vertex },
        Place::Domain { u, v } => pipeline::Place::Domain { u: *u, v: *v },
    }
}

fn constraint(of: pipeline::Constraint) -> Constraint {
    let at = |l: pipeline::LocatedPoint| Location { point: l.point, u: l.u, v: l.v };
    Constraint {
        id: of.id,
        on_example: at(of.on_example),
        on_input: at(of.on_input),
        origin: match of.origin {
            pipeline::ConstraintOrigin::Feature => ConstraintOrigin::Feature,
            pipeline::ConstraintOrigin::User => ConstraintOrigin::User,
        },
    }
}

pub(super) fn constraints_in(of: &[Constraint]) -> Vec<pipeline::Constraint> {
    let at = |l: &Location| pipeline::LocatedPoint { point: l.point, u: l.u, v: l.v };
    let constraint = |c: &Constraint| pipeline::Constraint {
        id: c.id.clone(),
        on_example: at(&c.on_example),
        on_input: at(&c.on_input),
        origin: match c.origin {
            ConstraintOrigin::Feature => pipeline::ConstraintOrigin::Feature,
            ConstraintOrigin::User => pipeline::ConstraintOrigin::User,
        },
    };
    of.iter().map(constraint).collect()
}

pub(super) fn edit(of: &ConstraintEdit) -> pipeline::ConstraintEdit {
    let new = |n: &quadmuse_proto::NewConstraint| pipeline::NewConstraint {
        id: n.id.clone(),
        on_example: n.on_example.as_ref().map(place),
        on_input: n.on_input.as_ref().map(place),
    };
    pipeline::ConstraintEdit {
        set: of.set.iter().map(new).collect(),
        remove: of.remove.clone(),
        undo: of.undo.clone(),
        on_fold: match of.on_fold {
            OnFold::Refuse => pipeline::OnFold::Refuse,
            OnFold::Resolve => pipeline::OnFold::Resolve,
        },
    }
}

pub(super) fn part(of: &super::super::Part) -> Result<pipeline::Part, EngineError> {
    use super::super::Part;
    Ok(match of {
        Part::Mapped { part, whole } => pipeline::Part::Mapped { part: Arc::clone(part), whole: Arc::clone(whole) },
        Part::Kept(part) => pipeline::Part::Kept(Arc::clone(part)),
        Part::OfWhole(part) => pipeline::Part::OfWhole(Arc::clone(part)),
        Part::Poor(instead) => pipeline::Part::Poor(Arc::clone(encoded_in(instead)?)),
        Part::Template(encoded) => pipeline::Part::Template(Arc::clone(encoded_in(encoded)?)),
    })
}

/// The kernel's name of a format.
pub(super) fn format_in(format: MeshFormat) -> Format {
    match format {
        MeshFormat::Obj => Format::Obj,
        MeshFormat::Ply => Format::Ply,
        MeshFormat::Off => Format::Off,
        MeshFormat::Stl => Format::Stl,
        MeshFormat::Glb => Format::Glb,
    }
}

fn format_out(format: Format) -> MeshFormat {
    match format {
        Format::Obj => MeshFormat::Obj,
        Format::Ply => MeshFormat::Ply,
        Format::Off => MeshFormat::Off,
        Format::Stl => MeshFormat::Stl,
        Format::Glb => MeshFormat::Glb,
    }
}

pub(super) fn topology_out(topology: topology::Topology) -> Topology {
    match topology {
        topology::Topology::Disc => Topology::Disc,
        topology::Topology::Annulus => Topology::Annulus,
        topology::Topology::Sphere => Topology::Sphere,
        topology::Topology::Torus => Topology::Torus,
    }
}

/// The kernel's word for a topology.
pub(crate) fn topology_in(topology: Topology) -> topology::Topology {
    match topology {
        Topology::Disc => topology::Topology::Disc,
        Topology::Annulus => topology::Topology::Annulus,
        Topology::Sphere => topology::Topology::Sphere,
        Topology::Torus => topology::Topology::Torus,
    }
}
