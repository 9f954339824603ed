//! Compositions and templates.

use super::super::{
    Encoded, EngineError, Mapped, Model, Opaque, Part, Reach, Refusal, Registration, Side, Stitched, Stitching,
};
use super::as_one::as_one;
use super::fresh;
use super::grouped::Pieces;
use super::model::ModelInner;
use super::notes;
use crate::pool::Stop;
use quadmuse_kernel::compose::{
    self, Closeness, Options, Piece, layers, net::Net, subdivide, surface::ComposedSurface, template,
};
use quadmuse_kernel::mesh::{PolyMesh, TriMesh};
use quadmuse_kernel::register::Query;
use quadmuse_proto::{Distortion, Flip, Histogram, Verdict};
use std::sync::Arc;

/// Most faces that a density may ask for.
const FACES_MAX: usize = 4_000_000;
/// Quads of a template on an input of which nothing else tells a density.
const TEMPLATE_QUADS: f64 = 4000.0;
/// Of them, so many for each triangle of the input, and so many at least: what has a handful has no more form than those follow.
const QUADS_PER_TRIANGLE: f64 = 64.0;
const QUADS_LEAST: f64 = 256.0;

/// Quads of a whole of regular layouts.
fn quads_for(surface: &TriMesh) -> f64 {
    (QUADS_PER_TRIANGLE * surface.triangles.len() as f64).clamp(QUADS_LEAST, TEMPLATE_QUADS)
}

/// Whether a part was chosen for its layout.
#[derive(Clone, Copy)]
enum Choice {
    Open,
    Chosen,
}

/// What is brought for a segment.
enum Brought<'a> {
    /// A mapped example.
    Mesh(Box<PolyMesh>, Choice),
    /// A segment for a regular layout.
    Unfolded(&'a Query),
}

impl Brought<'_> {
    fn piece(&self) -> Piece<'_> {
        match self {
            Self::Mesh(mesh, Choice::Open) => Piece::Mapped(mesh),
            Self::Mesh(mesh, Choice::Chosen) => Piece::Kept(mesh),
            Self::Unfolded(query) => Piece::Regular(&query.chart, query.index()),
        }
    }
}

/// Stitches one part a segment.
pub(super) fn compose(query: &Model, parts: &[Part], how: Stitching, stop: &Stop) -> Result<Stitched, EngineError> {
    let inner: &ModelInner = query.inner.open()?;
    let ground = inner.ground();
    let grouped = Pieces::grouped(inner, parts)?;
    if grouped.is_any_joined() {
        let whole = stitched(&grouped.ground(&ground), parts, &grouped, how, stop)?;
        if !grouped.is_any_lost(&whole.report) {
            return Ok(whole.told());
        }
    }
    let single = Pieces::single(parts.len());
    if let [part @ (Part::Mapped { whole, .. } | Part::Poor { whole, .. })] = parts
        && how.density == 0
    {
        let is_poor_kept = matches!(part, Part::Poor { .. });
        if let Some(made) = as_one(&ground, whole, is_poor_kept, how, stop)? {
            return Ok(Stitched { is_poor_kept, ..made });
        }
    }
    let made = stitched(&ground, parts, &single, how, stop)?;
    let [Part::Poor { part, whole, .. }] = parts else { return Ok(made.told()) };
    // Nobody chose the map, and it is poor: what follows the input better is taken.
    let as_it_is = [Part::Mapped { part: Arc::clone(part), whole: Arc::clone(whole) }];
    let kept = stitched(&ground, &as_it_is, &single, how, stop)?;
    let is_poor_kept = kept.report.fit.worst() < made.report.fit.worst();
    Ok(if is_poor_kept { Stitched { is_poor_kept, ..kept.told() } } else { made.told() })
}

/// A composition, and what is to be told of what was brought.
pub(super) struct Made {
    pub(super) mesh: PolyMesh,
    pub(super) report: compose::Report,
    brought: notes::Brought,
}

impl Made {
    /// Whether what was brought for each segment stands there, and is an example's.
    fn is_example(&self) -> Vec<bool> {
        let report = &self.report;
        let without = [&self.brought.poor, &self.brought.regular];
        let gone = [&report.replaced, &report.too_dense, &report.missing, &report.own];
        let is_in = |lists: &[&Vec<usize>], segment: usize| lists.iter().any(|list| list.contains(&segment));
        let stands = |segment: usize| !is_in(&without, segment) && !is_in(&gone, segment);
        let is_input = report.way == compose::Way::InputSubdivided;
        (0..report.subdivided.len()).map(|segment| !is_input && stands(segment)).collect()
    }

    pub(super) fn told(self) -> Stitched {
        let is_example = self.is_example();
        let mut notes = notes::brought(&self.brought);
        notes.extend(notes::made(&self.report, self.mesh.faces.len()));
        Stitched {
            is_poor_kept: false,
            bridging: Vec::new(),
            is_example,
            extraordinary_vertices: self.report.extraordinary_after as u64,
            extraordinary_before: self.report.extraordinary_before as u64,
            mesh: Arc::new(self.mesh),
            notes,
        }
    }
}

/// One piece for each group of segments.
pub(super) fn stitched(
    ground: &ComposedSurface<'_>,
    parts: &[Part],
    pieces: &Pieces,
    how: Stitching,
    stop: &Stop,
) -> Result<Made, EngineError> {
    let mut told = notes::Brought::default();
    let mut brought: Vec<Brought<'_>> = Vec::new();
    for (segment, joined) in pieces.each() {
        let mut mesh = |part| at_density(part, segment, how.density, &mut told).map(Box::new);
        brought.push(match &parts[segment] {
            Part::OfWhole(part) => Brought::Mesh(mesh(joined.unwrap_or(part))?, Choice::Chosen),
            Part::Mapped { part, .. } => Brought::Mesh(mesh(part)?, Choice::Open),
            Part::Kept(part) => Brought::Mesh(mesh(part)?, Choice::Chosen),
            Part::Poor { instead, .. } => {
                told.poor.push(segment);
                Brought::Unfolded(fresh(&instead.encoding)?)
            }
            Part::Template(encoded) => {
                told.regular.push(segment);
                Brought::Unfolded(fresh(&encoded.encoding)?)
            }
        });
    }
    stopped(stop)?;
    let all: Vec<Piece<'_>> = brought.iter().map(Brought::piece).collect();
    let options = Options {
        smoothing: how.smoothing,
        edge_scale: 0.5f64.powi(how.density) * (TEMPLATE_QUADS / quads_for(ground.input().surface)).sqrt(),
        // Who asks for a coarser layout wants it as coarse as that.
        closeness: if how.density < 0 { Closeness::AsBrought } else { Closeness::Followed },
    };
    let made = compose::compose(ground.input(), &all, options, &|| stop.reason().is_some());
    stopped(stop)?;
    let mut made = made.map_err(|e| EngineError::refused(Refusal::CompositionInvalid, e.to_string()))?;
    if let [Brought::Mesh(mesh, _)] = &brought[..]
        && made.mesh.faces == mesh.faces
    {
        made.mesh.attributes = mesh.attributes.clone();
    }
    Ok(Made { mesh: made.mesh, report: pieces.by_segment(made.report), brought: told })
}

fn stopped(stop: &Stop) -> Result<(), EngineError> {
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))
}

/// A part, subdivided or coarsened; its faces are counted before the work.
fn at_density(
    mesh: &PolyMesh,
    segment: usize,
    density: i32,
    told: &mut notes::Brought,
) -> Result<PolyMesh, EngineError> {
    if density == 0 {
        return Ok(mesh.clone());
    }
    if density > 0 {
        let faces = 4usize.saturating_pow(density as u32 - 1).saturating_mul(mesh.faces.corners().len());
        if faces > FACES_MAX {
            let detail = format!(
                "expected a density at which segment {segment} has at most {FACES_MAX} faces, found {density}, at which it has {faces}; ask for less"
            );
            return Err(EngineError::refused(Refusal::CompositionInvalid, detail));
        }
        return Ok((0..density).fold(mesh.clone(), |mesh, _| layers::subdivided(&mesh)));
    }
    let mut net = Net::from_mesh(mesh);
    for step in 0..-density {
        let Some(coarser) = subdivide::coarsen(&net) else {
            told.too_fine.push((segment, step));
            break;
        };
        net = coarser;
    }
    Ok(net.into_mesh().0)
}

/// A regular layout on an unfolded segment.
fn layout(encoded: &Encoded, edge: f64) -> Result<PolyMesh, EngineError> {
    let query = fresh(&encoded.encoding)?;
    Ok(template::template(&query.chart, query.index(), edge))
}

/// A regular layout in place of a mapped example.
pub(super) fn template(query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
    stopped(stop)?;
    let inner: &ModelInner = query.model.inner.open()?;
    let edge = (inner.segmented.mesh.total_area() / quads_for(&inner.segmented.mesh)).sqrt();
    let mesh = Arc::new(layout(&query.encoded, edge)?);
    let none = || Histogram { edges: vec![0.0, 1.0], counts: vec![0], ..Histogram::default() };
    Ok(Mapped {
        part: Arc::clone(&mesh),
        mesh,
        registration: Registration {
            level: 0,
            energy: 0.0,
            flip: Flip::default(),
            shift_u: 0.0,
            inner: Opaque::new(()),
        },
        is_of_whole: false,
        constraints: Vec::new(),
        folds: 0,
        distortion: Distortion { angle: none(), area: none() },
        verdict: Verdict::Fair,
        reasons: vec!["no example was used: a regular layout was made for this segment".into()],
        reach: Reach::default(),
        evidence: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_handful_of_triangles_asks_for_few_quads_and_a_scan_for_as_many_as_ever() {
        let quads = |count: usize| quads_for(&TriMesh { triangles: vec![[0; 3]; count], ..TriMesh::default() });
        assert_eq!([1, 4, 12, 62, 63, 100_000].map(quads), [256.0, 256.0, 768.0, 3968.0, 4000.0, 4000.0]);
    }
}
