//! The engine in earnest: the kernel's pipeline, behind the words of the service.

#[cfg(test)]
mod tests;
mod translate;

use super::{
    AllowedFlaws, Appraisal, ConstraintEdit, Cut, Encoded, Encoding, Engine, EngineError, Fitted, LimbDistances,
    MapExtent, Mapped, Model, OnePart, Opaque, PackedEncoding, PackedFeature, Part, Refusal, Registration, Resized,
    RoughLead, RoughPlacement, SegmentFacts, Side, SizeTarget, StitchOptions, Stitched, Wishes,
};
use crate::pool::Stop;
use quadmuse_kernel as kernel;
use quadmuse_kernel::encode::Feature;
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_kernel::pipeline::{self, Registered, RegularMesh};
use quadmuse_kernel::rank::SegmentShape;
use quadmuse_kernel::rank::coarse::CoarseQuery;
use quadmuse_kernel::register::image::Image;
use quadmuse_kernel::register::spectra::Row;
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::settle::{Likeness, PosedSurface};
use quadmuse_proto::composition::SMOOTHING_DEFAULT;
use quadmuse_proto::{Distortion, Flip, Histogram, MeshFormat, Topology, Verdict};
use std::sync::Arc;
pub(crate) use translate::topology_in;
use translate::{model_in, outcome, side_in, topology_out};

/// Memory that reading and encoding takes for each byte of an upload, at most (measured: tests/records).
const MEMORY_PER_BYTE: u64 = 40;
/// Memory that it takes at least.
const MEMORY_BASE: u64 = 12 << 20;

/// Memory that each segment but the first takes, however small it is: its pictures at every level.
const MEMORY_PER_SEGMENT: u64 = 6 << 20;

/// The kernel.
#[derive(Debug, Default)]
pub struct KernelEngine {
    limits: kernel::mesh::Limits,
    solver: LevenbergMarquardt,
}

impl KernelEngine {
    /// An engine that refuses meshes whose reading would take more than `memory_bytes`.
    pub fn within_memory(memory_bytes: u64) -> Self {
        let limits = kernel::mesh::Limits::within_memory(usize::try_from(memory_bytes).unwrap_or(usize::MAX));
        Self { limits, ..Self::default() }
    }
}

/// What an [`Encoding`] holds: a segment of an upload with its factored surface, or an encoding from the store.
#[derive(Debug)]
enum Source {
    Fresh(Arc<pipeline::Encoded>),
    Stored(kernel::encode::Encoding),
}

impl Source {
    fn encoding(&self) -> &kernel::encode::Encoding {
        match self {
            Self::Fresh(encoded) => encoded.query.encoding(),
            Self::Stored(encoding) => encoding,
        }
    }
}

fn fresh(encoding: &Encoding) -> Result<&Arc<pipeline::Encoded>, EngineError> {
    match encoding.inner.open()? {
        Source::Fresh(encoded) => Ok(encoded),
        Source::Stored(_) => Err(EngineError::Internal("expected an unfolded segment, found a stored encoding".into())),
    }
}

/// What examples of a topology are compared with.
fn facing(query: &Encoding, example: kernel::topology::Topology) -> Result<&Query, EngineError> {
    let detail = "the surface can't be unfolded with its boundary filled, as closed examples are compared with it";
    fresh(query)?.query.facing(example).ok_or_else(|| EngineError::refused(Refusal::NotEncodable, detail))
}

/// A registration of an entry, unless its computation was stopped half-way.
fn checked(entry: Entry, stop: &Stop) -> Result<Registration, EngineError> {
    going_on(stop)?;
    Ok(translate::registration(Registered::of(entry)))
}

fn going_on(stop: &Stop) -> Result<(), EngineError> {
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))
}

impl Engine for KernelEngine {
    fn version(&self) -> u32 {
        kernel::encode::ENCODER_VERSION
    }

    fn memory_estimate(&self, bytes: u64) -> u64 {
        MEMORY_BASE + bytes.saturating_mul(MEMORY_PER_BYTE)
    }

    fn memory_of_segments(&self, count: usize) -> u64 {
        MEMORY_PER_SEGMENT.saturating_mul(count.saturating_sub(1) as u64)
    }

    fn read(&self, bytes: &[u8], format: Option<MeshFormat>, cut: &Cut, stop: &Stop) -> Result<Model, EngineError> {
        let format = format.map(translate::format_in);
        outcome(pipeline::read(bytes, format, &translate::cut(cut), &self.limits), stop).map(translate::model)
    }

    fn alike(&self, query: &Model, example: &Model, stop: &Stop) -> Result<Model, EngineError> {
        let is_stopped = || stop.reason().is_some();
        let cut = outcome(pipeline::alike(model_in(query)?, model_in(example)?, &is_stopped), stop)?;
        Ok(Model { format: query.format, repairs: query.repairs.clone(), ..translate::model(cut) })
    }

    fn labelled_by_segment(&self, model: &Model) -> Result<Arc<PolyMesh>, EngineError> {
        Ok(Arc::new(model_in(model)?.labelled_by_segment()))
    }

    fn resized(&self, scan: &Model, mesh: &PolyMesh, wanted: SizeTarget, stop: &Stop) -> Result<Resized, EngineError> {
        going_on(stop)?;
        Ok(kernel::compose::rows::resized(mesh, model_in(scan)?.surface(), wanted))
    }

    fn encode(&self, model: &Model, segment: u32, stop: &Stop) -> Result<Encoded, EngineError> {
        let encoded = pipeline::encode(model_in(model)?, segment, &|| stop.reason().is_some());
        Ok(translate::encoded(Arc::new(outcome(encoded, stop)?)))
    }

    fn pack(&self, encoding: &Encoding) -> Result<PackedEncoding, EngineError> {
        let source: &Source = encoding.inner.open()?;
        let from = source.encoding();
        Ok(PackedEncoding {
            facts: encoding.facts,
            features: from
                .features
                .iter()
                .map(|f| PackedFeature { uv: f.uv, lambda: f.lambda, side: f.side as u32 })
                .collect(),
            levels: from.pyramid.iter().map(|p| (p.side as u32, p.values.clone())).collect(),
        })
    }

    fn unpack(&self, packed: &PackedEncoding) -> Result<Encoding, EngineError> {
        let picture = |(side, values): &(u32, Vec<f32>)| {
            let side = *side as usize;
            (values.len() == side * side).then(|| kernel::encode::Picture { side, values: values.clone() })
        };
        let pyramid: Option<Vec<_>> = packed.levels.iter().map(picture).collect();
        let pyramid = pyramid.ok_or_else(|| EngineError::Internal("expected square levels in the store".into()))?;
        let features = packed.features.iter();
        let encoding = kernel::encode::Encoding {
            topology: topology_in(packed.facts.topology),
            modulus: packed.facts.k,
            pyramid,
            features: features.map(|f| Feature { uv: f.uv, lambda: f.lambda, side: f.side as usize }).collect(),
        };
        Ok(Encoding { facts: packed.facts, inner: Opaque::new(Source::Stored(encoding)) })
    }

    fn row(&self, example: &Encoding) -> Result<Row, EngineError> {
        let encoding = example.inner.open::<Source>()?.encoding();
        let torus = encoding.topology == kernel::topology::Topology::Torus;
        let image =
            encoding.pyramid.first().map(|picture| Image::new(picture, kernel::register::Flip::default(), torus));
        let row = image.and_then(|image| Row::new(&image, encoding.topology));
        row.ok_or_else(|| EngineError::Internal("expected the coarsest level first".into()))
    }

    fn coarse_query(&self, query: &Encoding, examples: Topology) -> Result<CoarseQuery, EngineError> {
        let examples = topology_in(examples);
        let query = (fresh(query)?.query.facing(examples), query.facts.bending);
        Ok(match query {
            (Some(facing), bending) => CoarseQuery::new(facing, examples, bending),
            (None, _) => CoarseQuery::from_spectra(examples, Vec::new()),
        })
    }

    fn ready(&self, query: &Encoding) {
        let _ = fresh(query).map(|encoded| encoded.query.protrusions().len());
    }

    fn coarse(&self, example: &Encoding, query: &Encoding, stop: &Stop) -> Result<Registration, EngineError> {
        let source: &Source = example.inner.open()?;
        let stopped = || stop.reason().is_some();
        let query = facing(query, source.encoding().topology)?;
        let entry = Entry::coarse_with_parts(query, source.encoding(), &self.solver, &stopped);
        let entry =
            entry.ok_or_else(|| EngineError::Internal("expected the coarsest level and like topologies".into()))?;
        checked(entry, stop)
    }

    fn refine(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        let source: &Source = example.inner.open()?;
        let mut entry = from.inner.open::<Registered>()?.entry().clone();
        let stopped = || stop.reason().is_some();
        let query = facing(query, source.encoding().topology)?;
        entry.advance(query, source.encoding(), &self.solver, &stopped).map_err(internal)?;
        checked(entry, stop)
    }

    fn finish(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        let source: &Source = example.inner.open()?;
        let mut entry = from.inner.open::<Registered>()?.entry().clone();
        if entry.poles_refined() {
            return Ok(from.clone());
        }
        let stopped = || stop.reason().is_some();
        let query = facing(query, source.encoding().topology)?;
        entry.refine_poles(query, source.encoding(), &self.solver, &stopped).map_err(internal)?;
        checked(entry, stop)
    }

    fn score(&self, registration: &Registration, example: &SegmentFacts, query: &Encoding, relevance: f64) -> f64 {
        let best = registration.inner.open::<Registered>().map(|r| r.entry().best().clone());
        best.map_or(f64::MAX, |best| {
            let bending = query.facts.bending.filter(|_| best.unfolded.is_whole());
            let shape = SegmentShape { modulus: best.unfolded.encoding.modulus, bending };
            kernel::rank::score(best.cost(), example.shape(), shape, relevance)
        })
    }

    fn map(&self, from: &Registration, example: &Side, query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
        let is_stopped = || stop.reason().is_some();
        let mapped = pipeline::map(from.inner.open()?, &side_in(example)?, &side_in(query)?, &is_stopped);
        outcome(mapped, stop).map(translate::mapped)
    }

    fn fit(
        &self,
        from: Option<&Registration>,
        example: &Side,
        query: &Side,
        wishes: &Wishes,
        stop: &Stop,
    ) -> Result<Fitted, EngineError> {
        let from: Option<&Registered> = from.map(|from| from.inner.open()).transpose()?;
        let (one, two, wishes) = (side_in(example)?, side_in(query)?, translate::wishes(wishes)?);
        let fitted = outcome(pipeline::fit(from, &one, &two, &wishes, &|| stop.reason().is_some()), stop)?;
        Ok(Fitted {
            mapped: translate::mapped(fitted.mapped),
            example: translate::side(fitted.example, example)?,
            query: translate::side(fitted.query, query)?,
        })
    }

    fn posed(&self, model: &Model, segment: u32) -> Result<Option<Opaque>, EngineError> {
        let model = model_in(model)?;
        let patch = model.patch(segment).map_err(internal)?;
        let has_rim = patch.topology != kernel::topology::Topology::Sphere;
        let is_torus = patch.topology == kernel::topology::Topology::Torus;
        Ok((!is_torus).then(|| Opaque::new(PosedSurface::quick(&patch.mesh, has_rim))))
    }

    fn likeness(&self, one: &Opaque, two: &Opaque, stop: &Stop) -> Result<Likeness, EngineError> {
        let found = one.open::<PosedSurface>()?.likeness(two.open()?, &|| stop.reason().is_some());
        stop.reason().map_or(Ok(found), |reason| Err(EngineError::Stopped(reason)))
    }

    fn limbs(&self, encoding: &Encoding) -> Result<Option<LimbDistances>, EngineError> {
        Ok(LimbDistances::of(&fresh(encoding)?.query))
    }

    fn ready_for_rough(&self, query: &Model, segment: u32) -> Result<Option<Opaque>, EngineError> {
        let ready = pipeline::ready_for_rough(model_in(query)?, segment).map_err(internal)?;
        Ok(ready.map(Opaque::new))
    }

    fn rough(
        &self,
        example: (&Model, u32),
        query: (&Model, u32, &Opaque),
        encodings: Option<[&Encoding; 2]>,
        lead: Option<&RoughLead>,
        stop: &Stop,
    ) -> Result<Option<RoughPlacement>, EngineError> {
        let tips = match encodings {
            Some([one, two]) => Some([&*fresh(one)?.query, &*fresh(two)?.query]),
            None => None,
        };
        let lead = match lead {
            Some(RoughLead { model, segment, rough }) => {
                Some(pipeline::RoughLead { model: model_in(model)?, segment: *segment, rough })
            }
            None => None,
        };
        let ready: &pipeline::RoughInput = query.2.open()?;
        let (one, two) = ((&**model_in(example.0)?, example.1), (&**model_in(query.0)?, query.1, ready));
        outcome(pipeline::rough(one, two, tips, lead, &|| stop.reason().is_some()), stop)
    }

    fn ranked_against(&self, query: Topology, is_most: bool) -> Vec<Topology> {
        pipeline::ranked_against(topology_in(query), is_most).into_iter().map(topology_out).collect()
    }

    fn reaches(&self, example: Topology, query: Topology) -> bool {
        pipeline::reaches(topology_in(example), topology_in(query))
    }

    fn constrain(
        &self,
        from: &Mapped,
        edit: &ConstraintEdit,
        example: &Side,
        query: &Side,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        let (registered, constraints) = (from.registration.inner.open()?, translate::constraints_in(&from.constraints));
        let (edit, is_stopped) = (translate::edit(edit), || stop.reason().is_some());
        let edited = pipeline::constrain::edit(
            registered,
            &constraints,
            &edit,
            &side_in(example)?,
            &side_in(query)?,
            &is_stopped,
        );
        outcome(edited, stop).map(translate::registration)
    }

    fn edited(
        &self,
        from: &Registration,
        before: &Mapped,
        example: &Side,
        query: &Side,
        stop: &Stop,
    ) -> Result<Mapped, EngineError> {
        let (before, is_stopped) = (translate::before(before), || stop.reason().is_some());
        let mapped = pipeline::edited(from.inner.open()?, &before, &side_in(example)?, &side_in(query)?, &is_stopped);
        outcome(mapped, stop).map(translate::mapped)
    }

    fn rejoin(
        &self,
        query: &Model,
        example: &Model,
        parts: &[OnePart],
        stop: &Stop,
    ) -> Result<Option<Stitched>, EngineError> {
        going_on(stop)?;
        Ok(pipeline::rejoin(model_in(query)?, model_in(example)?, parts))
    }

    fn around(
        &self,
        query: &Model,
        segment: u32,
        mapped: &Mapped,
    ) -> Result<Option<(Model, Arc<PolyMesh>)>, EngineError> {
        let cut = pipeline::around(model_in(query)?, segment, mapped.unextruded(), mapped.reach.own);
        let model = |cut| Model { format: query.format, repairs: query.repairs.clone(), ..translate::model(cut) };
        Ok(cut.map(|(cut, own)| (model(cut), own)))
    }

    fn recut(&self, query: &Model) -> Result<Model, EngineError> {
        let cut = outcome(pipeline::in_primitives(model_in(query)?), &Stop::new(None))?;
        Ok(Model { format: query.format, ..translate::model(cut) })
    }

    fn compose(&self, query: &Model, parts: &[Part], how: StitchOptions, stop: &Stop) -> Result<Stitched, EngineError> {
        let parts: Vec<pipeline::Part> = parts.iter().map(translate::part).collect::<Result<_, _>>()?;
        outcome(pipeline::compose(model_in(query)?, &parts, how, &|| stop.reason().is_some()), stop)
    }

    fn alone(&self, query: &Model) -> Result<Vec<bool>, EngineError> {
        Ok(model_in(query)?.alone())
    }

    fn of_segments(
        &self,
        query: &Model,
        made: &Stitched,
        segments: &[u32],
    ) -> Result<(Arc<PolyMesh>, Vec<u32>), EngineError> {
        let (mesh, bridging) = pipeline::of_segments(model_in(query)?, made, segments);
        Ok((Arc::new(mesh), bridging))
    }

    fn appraise(&self, query: &Model, made: &Stitched, allowed: AllowedFlaws) -> Result<Appraisal, EngineError> {
        Ok(pipeline::appraise(model_in(query)?, made, allowed))
    }

    fn split(&self, query: &Model, made: &Stitched, splits: u32) -> Result<Option<Stitched>, EngineError> {
        Ok(pipeline::split(model_in(query)?, made, splits))
    }

    fn template(&self, query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
        let made = pipeline::template(&side_in(query)?, SMOOTHING_DEFAULT, &|| stop.reason().is_some());
        let RegularMesh { mesh, flaws } = outcome(made, stop)?;
        let verdict = if flaws.is_empty() { Verdict::Fair } else { Verdict::Broken };
        let no_example = "no example was used: a regular layout was made for this segment".into();
        let none = || Histogram { edges: vec![0.0, 1.0], counts: vec![0], ..Histogram::default() };
        let (flip, inner) = (Flip::default(), Opaque::new(()));
        Ok(Mapped {
            part: Arc::clone(&mesh),
            mesh,
            registration: Registration { level: 0, energy: 0.0, flip, shift_u: 0.0, inner },
            is_of_whole: false,
            constraints: Vec::new(),
            folds: 0,
            distortion: Distortion { angle: none(), area: none() },
            verdict,
            reasons: flaws.into_iter().chain([no_example]).collect(),
            stitched: None,
            reach: MapExtent::default(),
            evidence: None,
            sureness: None,
        })
    }

    fn write(&self, mesh: &PolyMesh, format: MeshFormat) -> Result<Vec<u8>, EngineError> {
        kernel::mesh::write(mesh, translate::format_in(format)).map_err(|error| {
            let refused = pipeline::PipelineError::from(error);
            match refused {
                pipeline::PipelineError::Refused { refusal, detail } => EngineError::Refused { refusal, detail },
                other => internal(other),
            }
        })
    }
}

fn internal(error: impl std::fmt::Display) -> EngineError {
    EngineError::Internal(error.to_string())
}
