//! The engine in earnest: the kernel.

mod around;
mod as_one;
mod constrain;
mod continued;
mod fitted;
mod from_whole;
mod grouped;
mod measured;
mod model;
mod notes;
mod parts;
mod registered;
mod rejoined;
mod rested;
mod roughly;
mod settled;
mod sound;
mod spanned;
mod stitch;
mod transfer;

use super::{
    Allowed, Appraisal, ConstraintEdit, Cut, Encoded, Encoding, Engine, EngineError, Fitted, Mapped, Model, OnePart,
    Opaque, Packed, PackedFeature, Part, Refusal, Registration, Resized, Rough, RoughLead, SegmentFacts, Side,
    Stitched, Stitching, Wanted, Wishes,
};
use crate::pool::Stop;
use model::{ModelInner, format_of, refused};
use quadmuse_kernel as kernel;
use quadmuse_kernel::encode::Feature;
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_kernel::rank::Shape;
use quadmuse_kernel::rank::coarse::CoarseQuery;
use quadmuse_kernel::register::image::Image;
use quadmuse_kernel::register::spectra::Row;
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::settle::{Likeness, Posed};
use quadmuse_kernel::unfold::UnfoldOptions;
use quadmuse_proto::{MeshFormat, Topology, Verdict};
use registered::Registered;
use std::sync::Arc;

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
    Fresh(Arc<Query>),
    Stored(kernel::encode::Encoding),
}

impl Source {
    fn encoding(&self) -> &kernel::encode::Encoding {
        match self {
            Self::Fresh(query) => query.encoding(),
            Self::Stored(encoding) => encoding,
        }
    }
}

fn fresh(encoding: &Encoding) -> Result<&Arc<Query>, EngineError> {
    match encoding.inner.open()? {
        Source::Fresh(query) => Ok(query),
        Source::Stored(_) => Err(EngineError::Internal("expected an unfolded segment, found a stored encoding".into())),
    }
}

/// What examples of a topology are compared with.
fn facing(query: &Encoding, example: kernel::topology::Topology) -> Result<&Query, EngineError> {
    let detail = "the surface can't be unfolded with its boundary filled, as closed examples are compared with it";
    fresh(query)?.facing(example).ok_or_else(|| EngineError::refused(Refusal::NotEncodable, detail))
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

    fn read(&self, bytes: &[u8], format: Option<MeshFormat>, cut: &Cut, _: &Stop) -> Result<Model, EngineError> {
        model::read(bytes, format, cut, &self.limits)
    }

    fn alike(&self, query: &Model, example: &Model, stop: &Stop) -> Result<Model, EngineError> {
        transfer::alike(self, query, example, stop)
    }

    fn told_apart(&self, model: &Model) -> Result<Arc<PolyMesh>, EngineError> {
        model::told_apart(model)
    }

    fn resized(&self, scan: &Model, mesh: &PolyMesh, wanted: Wanted, stop: &Stop) -> Result<Resized, EngineError> {
        let inner: &ModelInner = scan.inner.open()?;
        stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
        Ok(kernel::compose::rows::resized(mesh, &inner.prepared.mesh, wanted))
    }

    fn encode(&self, model: &Model, segment: u32, stop: &Stop) -> Result<Encoded, EngineError> {
        let inner: &ModelInner = model.inner.open()?;
        let patch = inner.patch(segment)?;
        stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
        let query = Query::new(patch, &UnfoldOptions::default())
            .map_err(|e| EngineError::refused(Refusal::NotEncodable, format!("segment {segment}: {e}")))?;
        let bending = kernel::rank::bending::bending(&patch.mesh) as f32;
        let facts = facts(query.encoding(), inner.faces(segment), bending);
        let repairs = unfolding(segment, &query.chart);
        Ok(Encoded { encoding: Encoding { facts, inner: Opaque::new(Source::Fresh(Arc::new(query))) }, repairs })
    }

    fn pack(&self, encoding: &Encoding) -> Result<Packed, EngineError> {
        let source: &Source = encoding.inner.open()?;
        let from = source.encoding();
        Ok(Packed {
            facts: encoding.facts,
            features: from
                .features
                .iter()
                .map(|f| PackedFeature { uv: f.uv, lambda: f.lambda, side: f.side as u32 })
                .collect(),
            levels: from.pyramid.iter().map(|p| (p.side as u32, p.values.clone())).collect(),
        })
    }

    fn unpack(&self, packed: &Packed) -> Result<Encoding, EngineError> {
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
        let query = (fresh(query)?.facing(examples), query.facts.bending);
        Ok(match query {
            (Some(facing), bending) => CoarseQuery::new(facing, examples, bending),
            (None, _) => CoarseQuery::from_spectra(examples, Vec::new()),
        })
    }

    fn ready(&self, query: &Encoding) {
        let _ = fresh(query).map(|query| query.protrusions().len());
    }

    fn coarse(&self, example: &Encoding, query: &Encoding, stop: &Stop) -> Result<Registration, EngineError> {
        let source: &Source = example.inner.open()?;
        let stopped = || stop.reason().is_some();
        let query = facing(query, source.encoding().topology)?;
        let entry = Entry::coarse_with_parts(query, source.encoding(), &self.solver, &stopped);
        let entry =
            entry.ok_or_else(|| EngineError::Internal("expected the coarsest level and like topologies".into()))?;
        registered::checked(entry, stop)
    }

    fn refine(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        let source: &Source = example.inner.open()?;
        let mut entry = from.inner.open::<Registered>()?.entry.clone();
        let stopped = || stop.reason().is_some();
        let query = facing(query, source.encoding().topology)?;
        entry.advance(query, source.encoding(), &self.solver, &stopped).map_err(internal)?;
        registered::checked(entry, stop)
    }

    fn finish(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        let source: &Source = example.inner.open()?;
        let mut entry = from.inner.open::<Registered>()?.entry.clone();
        if entry.poles_refined() {
            return Ok(from.clone());
        }
        let stopped = || stop.reason().is_some();
        let query = facing(query, source.encoding().topology)?;
        entry.refine_poles(query, source.encoding(), &self.solver, &stopped).map_err(internal)?;
        registered::checked(entry, stop)
    }

    fn score(&self, registration: &Registration, example: &SegmentFacts, query: &Encoding, relevance: f64) -> f64 {
        let best = registration.inner.open::<Registered>().map(|r| r.entry.best().clone());
        best.map_or(f64::MAX, |best| {
            let bending = query.facts.bending.filter(|_| best.unfolded.is_whole());
            let shape = Shape { modulus: best.unfolded.encoding.modulus, bending };
            kernel::rank::score(best.cost(), example.shape(), shape, relevance)
        })
    }

    fn map(&self, from: &Registration, example: &Side, query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
        let mut mapped = registered::map(from, example, query, stop)?;
        sound::check(&mut mapped, query)?;
        Ok(mapped)
    }

    fn fit(
        &self,
        from: Option<&Registration>,
        example: &Side,
        query: &Side,
        wishes: &Wishes,
        stop: &Stop,
    ) -> Result<Fitted, EngineError> {
        let mut fitted = fitted::fit(from, example, query, wishes, stop)?;
        let own = continued::own(&fitted.mapped);
        sound::check(&mut fitted.mapped, query)?;
        if let (Verdict::Broken, Some(mut own)) = (fitted.mapped.verdict, own) {
            sound::check(&mut own, query)?;
            if own.verdict != Verdict::Broken {
                fitted.mapped = own;
            }
        }
        Ok(fitted)
    }

    fn posed(&self, model: &Model, segment: u32) -> Result<Option<Opaque>, EngineError> {
        let inner: &ModelInner = model.inner.open()?;
        let patch = inner.patch(segment)?;
        let has_rim = patch.topology == kernel::topology::Topology::Disc;
        let is_closed = patch.topology == kernel::topology::Topology::Sphere;
        Ok((has_rim || is_closed).then(|| Opaque::new(Posed::quick(&patch.mesh, has_rim))))
    }

    fn likeness(&self, one: &Opaque, two: &Opaque, stop: &Stop) -> Result<Likeness, EngineError> {
        let found = one.open::<Posed>()?.likeness(two.open()?, &|| stop.reason().is_some());
        stop.reason().map_or(Ok(found), |reason| Err(EngineError::Stopped(reason)))
    }

    fn rough(
        &self,
        example: (&Model, u32),
        query: (&Model, u32),
        encodings: Option<[&Encoding; 2]>,
        lead: Option<&RoughLead>,
        stop: &Stop,
    ) -> Result<Option<Rough>, EngineError> {
        roughly::lay(example, query, encodings, lead, stop)
    }

    fn ranked_against(&self, query: Topology, is_most: bool) -> Vec<Topology> {
        fitted::ranked_against(query, is_most)
    }

    fn reaches(&self, example: Topology, query: Topology) -> bool {
        fitted::reaches(example, query)
    }

    fn constrain(
        &self,
        from: &Mapped,
        edit: &ConstraintEdit,
        example: &Side,
        query: &Side,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        constrain::edit(from, edit, example, query, stop)
    }

    fn edited(
        &self,
        from: &Registration,
        before: &Mapped,
        example: &Side,
        query: &Side,
        stop: &Stop,
    ) -> Result<Mapped, EngineError> {
        let mut mapped = continued::edited(from, before, example, query, stop)?;
        sound::check(&mut mapped, query)?;
        Ok(mapped)
    }

    fn rejoin(
        &self,
        query: &Model,
        example: &Model,
        parts: &[OnePart],
        stop: &Stop,
    ) -> Result<Option<Stitched>, EngineError> {
        stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
        rejoined::rejoin(query, example, parts)
    }

    fn around(&self, query: &Model, mapped: &Mapped) -> Result<Option<(Model, Arc<PolyMesh>)>, EngineError> {
        around::around(query, mapped)
    }

    fn compose(&self, query: &Model, parts: &[Part], how: Stitching, stop: &Stop) -> Result<Stitched, EngineError> {
        stitch::compose(query, parts, how, stop)
    }

    fn alone(&self, query: &Model) -> Result<Vec<bool>, EngineError> {
        let inner: &ModelInner = query.inner.open()?;
        Ok(kernel::compose::apart::alone(inner.ground().input()))
    }

    fn appraise(&self, query: &Model, made: &Stitched, allowed: Allowed) -> Result<Appraisal, EngineError> {
        sound::appraise(query, made, allowed)
    }

    fn template(&self, query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
        stitch::template(query, stop)
    }

    fn write(&self, mesh: &PolyMesh, format: MeshFormat) -> Result<Vec<u8>, EngineError> {
        kernel::mesh::write(mesh, format_of(format)).map_err(refused)
    }
}

/// Flips of so large a share of the edges are worth a word: a clean mesh needs fewer.
const FLIPS_SHARE_TOLD: f64 = 0.05;

/// What unfolding had to do beyond the usual, in numbers.
fn unfolding(segment: u32, chart: &kernel::unfold::Chart) -> Vec<String> {
    let (report, edges) = (&chart.report, 1.5 * chart.mesh.triangles.len() as f64);
    let mut steps = Vec::new();
    if report.flips as f64 > FLIPS_SHARE_TOLD * edges {
        steps.push(format!("{} edges flipped to Delaunay", report.flips));
    }
    if report.mollified > 0.0 {
        steps.push(format!("edges lengthened by {:.0e} of their mean", report.mollified));
    }
    if report.clamped > 0 {
        steps.push(format!("{} negative weights clamped", report.clamped));
    }
    if report.uv_flips > 0 {
        steps.push(format!("{} of {} triangles turned over in the plane", report.uv_flips, chart.corners.len()));
    }
    if steps.is_empty() { Vec::new() } else { vec![format!("unfolding segment {segment}: {}", steps.join(", "))] }
}

fn internal(error: impl std::fmt::Display) -> EngineError {
    EngineError::Internal(error.to_string())
}

fn facts(encoding: &kernel::encode::Encoding, faces: u64, bending: f32) -> SegmentFacts {
    SegmentFacts {
        topology: topology_out(encoding.topology),
        k: encoding.modulus,
        faces,
        features: encoding.features.len() as u32,
        bending: Some(bending),
    }
}

fn topology_out(topology: kernel::topology::Topology) -> Topology {
    match topology {
        kernel::topology::Topology::Disc => Topology::Disc,
        kernel::topology::Topology::Annulus => Topology::Annulus,
        kernel::topology::Topology::Sphere => Topology::Sphere,
        kernel::topology::Topology::Torus => Topology::Torus,
    }
}

/// The kernel's word for a topology.
pub(crate) fn topology_in(topology: Topology) -> kernel::topology::Topology {
    match topology {
        Topology::Disc => kernel::topology::Topology::Disc,
        Topology::Annulus => kernel::topology::Topology::Annulus,
        Topology::Sphere => kernel::topology::Topology::Sphere,
        Topology::Torus => kernel::topology::Topology::Torus,
    }
}
