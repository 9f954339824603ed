//! Compositions and templates.

use super::as_one::as_one;
use super::error::{PipelineError, Refusal, Stop, stopped};
use super::grouped::Pieces;
use super::model::Model;
use super::notes;
use super::side::{Encoded, Side};
use super::sound::{AllowedFlaws, appraise};
use super::stitched::{LayoutOwner, Stitched};
use crate::compose::{
    self, Closeness, Options, Piece, layers, net::Net, subdivide, surface::ComposedSurface, template,
};
use crate::mesh::{PolyMesh, TriMesh};
use crate::register::Query;
use std::sync::Arc;

/// What a segment takes in a composition.
#[derive(Clone, Debug)]
pub enum Part {
    /// A mapped example.
    Mapped {
        /// [`Mapped::part`](super::Mapped::part).
        part: Arc<PolyMesh>,
        /// [`Mapped::mesh`](super::Mapped::mesh): where it is the only part and follows the input, it is the composition.
        whole: Arc<PolyMesh>,
    },
    /// The part of a map, to be subdivided no further than joining it needs.
    Kept(Arc<PolyMesh>),
    /// The same of a map that [is of the whole](super::Mapped::is_of_whole): with neighbours of its kind it hangs together as
    /// in the example.
    OfWhole(Arc<PolyMesh>),
    /// A regular layout in place of a map that nobody chose and that is poor.
    Poor(Arc<Encoded>),
    /// A regular layout at the density of its neighbours, on this unfolded segment.
    Template(Arc<Encoded>),
}

/// Says how to stitch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StitchOptions {
    /// Rounds of smoothing.
    pub smoothing: u32,
    /// Times each part is subdivided (above 0) or coarsened where its layout allows (below 0).
    pub density: i32,
}

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

/// Holds what is brought for a segment, to be composed.
enum SegmentSource<'a> {
    /// A mapped example.
    Mesh(Box<PolyMesh>, Choice),
    /// A segment for a regular layout.
    Unfolded(&'a Query),
}

impl SegmentSource<'_> {
    fn piece(&self) -> Piece<'_> {
        match self {
            Self::Mesh(mesh, Choice::Open) => Piece::Mapped(mesh),
            Self::Mesh(mesh, Choice::Chosen) => Piece::Kept(mesh),
            Self::Unfolded(query) => Piece::Regular(&query.chart, query.index()),
        }
    }
}

/// Stitches one part a segment, in their order, to one mesh of quads, smoothed and projected back onto the input.
///
/// # Errors
/// [`Refusal::CompositionInvalid`], [`PipelineError::Stopped`].
pub fn compose(query: &Model, parts: &[Part], how: StitchOptions, stop: Stop) -> Result<Stitched, PipelineError> {
    let ground = query.ground();
    let grouped = Pieces::grouped(query, parts);
    if grouped.is_any_joined() {
        let whole = stitched(&grouped.ground(&ground), parts, &grouped, how, stop)?;
        if !grouped.is_any_lost(&whole.report) {
            return Ok(whole.with_notes());
        }
    }
    let single = Pieces::single(parts.len());
    if let [Part::Mapped { whole, .. }] = parts
        && how.density == 0
        && let Some(made) = as_one(&ground, whole, how, stop)?
    {
        return Ok(made);
    }
    Ok(stitched(&ground, parts, &single, how, stop)?.with_notes())
}

/// A composition with its report, and notes on what was brought.
pub(crate) struct StitchResult {
    pub(crate) mesh: PolyMesh,
    pub(crate) report: compose::Report,
    brought: notes::SegmentNotes,
}

impl StitchResult {
    /// Tells what stands on each segment: what was brought, if it did not give way.
    fn standing(&self) -> Vec<LayoutOwner> {
        let report = &self.report;
        let is_input = report.way == compose::Way::InputSubdivided;
        let regular = [&self.brought.poor, &self.brought.regular, &report.replaced, &report.too_dense, &report.missing];
        let on = |segment: usize| {
            if is_input || report.own.contains(&segment) {
                LayoutOwner::Own
            } else if regular.iter().any(|list| list.contains(&segment)) {
                LayoutOwner::Regular
            } else {
                LayoutOwner::Example
            }
        };
        (0..report.subdivided.len()).map(on).collect()
    }

    /// The composition as it is returned, with what stands on each segment and the notes.
    pub(crate) fn with_notes(self) -> Stitched {
        let standing = self.standing();
        let mut notes = notes::brought(&self.brought);
        notes.extend(notes::made(&self.report, self.mesh.faces.len()));
        Stitched {
            bridging: Vec::new(),
            standing,
            extraordinary_vertices: self.report.extraordinary_after as u64,
            extraordinary_before: self.report.extraordinary_before as u64,
            mesh: Arc::new(self.mesh),
            notes,
        }
    }
}

/// One piece for each group of segments.
pub(crate) fn stitched(
    ground: &ComposedSurface<'_>,
    parts: &[Part],
    pieces: &Pieces,
    how: StitchOptions,
    stop: Stop,
) -> Result<StitchResult, PipelineError> {
    let mut for_notes = notes::SegmentNotes::default();
    let mut brought: Vec<SegmentSource<'_>> = Vec::new();
    for (segment, joined) in pieces.each() {
        let mut mesh = |part| at_density(part, segment, how.density, &mut for_notes).map(Box::new);
        brought.push(match &parts[segment] {
            Part::OfWhole(part) => SegmentSource::Mesh(mesh(joined.unwrap_or(part))?, Choice::Chosen),
            Part::Mapped { part, .. } => SegmentSource::Mesh(mesh(part)?, Choice::Open),
            Part::Kept(part) => SegmentSource::Mesh(mesh(part)?, Choice::Chosen),
            Part::Poor(instead) => {
                for_notes.poor.push(segment);
                SegmentSource::Unfolded(&instead.query)
            }
            Part::Template(encoded) => {
                for_notes.regular.push(segment);
                SegmentSource::Unfolded(&encoded.query)
            }
        });
    }
    stopped(stop)?;
    let all: Vec<Piece<'_>> = brought.iter().map(SegmentSource::piece).collect();
    let options = Options {
        smoothing: how.smoothing,
        edge_scale: 0.5f64.powi(how.density) * (TEMPLATE_QUADS / quads_for(ground.input().surface)).sqrt(),
        // Who asks for a coarser layout wants it as coarse as that.
        closeness: if how.density < 0 { Closeness::AsBrought } else { Closeness::Followed },
    };
    let made = compose::compose(ground.input(), &all, options, stop);
    stopped(stop)?;
    let mut made = made.map_err(|e| PipelineError::refused(Refusal::CompositionInvalid, e.to_string()))?;
    if let [SegmentSource::Mesh(mesh, _)] = &brought[..]
        && made.mesh.faces == mesh.faces
    {
        made.mesh.attributes = mesh.attributes.clone();
    }
    Ok(StitchResult { mesh: made.mesh, report: pieces.by_segment(made.report), brought: for_notes })
}

/// A part, subdivided or coarsened; its faces are counted before the work.
fn at_density(
    mesh: &PolyMesh,
    segment: usize,
    density: i32,
    for_notes: &mut notes::SegmentNotes,
) -> Result<PolyMesh, PipelineError> {
    if density == 0 {
        return Ok(mesh.clone());
    }
    if density > 0 {
        let faces = 4usize.saturating_pow(density as u32 - 1).saturating_mul(mesh.faces.corners().len());
        if faces > FACES_MAX {
            let detail = format!(
                "expected a density at which segment {segment} has at most {FACES_MAX} faces, found {density}, at which it has {faces}; ask for less"
            );
            return Err(PipelineError::refused(Refusal::CompositionInvalid, detail));
        }
        return Ok((0..density).fold(mesh.clone(), |mesh, _| layers::subdivided(&mesh)));
    }
    let mut net = Net::from_mesh(mesh);
    for step in 0..-density {
        let Some(coarser) = subdivide::coarsen(&net) else {
            for_notes.too_fine.push((segment, step));
            break;
        };
        net = coarser;
    }
    Ok(net.into_mesh().0)
}

/// A regular layout of one segment, as a mesh.
#[derive(Clone, Debug)]
pub struct RegularMesh {
    /// The layout.
    pub mesh: Arc<PolyMesh>,
    /// What makes it no use as a layout of the whole input, a sentence each; empty where it is one of several segments.
    pub flaws: Vec<String>,
}

/// A regular layout on an unfolded segment, in place of a mapped example. On an input of one segment it is composed, so that it
/// follows the input, and measured; on one of several it is as the segment's chart has it.
///
/// # Errors
/// [`Refusal::CompositionInvalid`], [`PipelineError::Stopped`].
pub fn template(query: &Side, smoothing: u32, stop: Stop) -> Result<RegularMesh, PipelineError> {
    stopped(stop)?;
    if query.model.is_whole(query.segment) {
        let how = StitchOptions { smoothing, density: 0 };
        let made = compose(&query.model, &[Part::Template(Arc::clone(&query.encoded))], how, stop)?;
        let flaws = appraise(&query.model, &made, AllowedFlaws::default()).flaws;
        return Ok(RegularMesh { mesh: made.mesh, flaws });
    }
    let surface = &query.model.segmented.mesh;
    let edge = (surface.total_area() / quads_for(surface)).sqrt();
    let unfolded = &query.encoded.query;
    let mesh = Arc::new(template::template(&unfolded.chart, unfolded.index(), edge));
    Ok(RegularMesh { mesh, flaws: Vec::new() })
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
