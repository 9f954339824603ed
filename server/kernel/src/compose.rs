//! Composition: parts laid on the segments of an input become one mesh of quads.
//!
//! *Source:* paper §6: merging along the boundaries, filling of holes, triangles resolved in pairs by surgery, doublets
//! removed, smoothing with back-projection. *Ours, not the paper's:* the boundaries are matched arc by arc ([`seam`]);
//! regular layouts end in their neighbours' vertices ([`plan`]); a part that can't be joined gives way alone ([`site`]),
//! the others stay; and a result that misses the input is subdivided ([`fit`]). Success is certain: at the very end stand
//! the input's own triangles.

mod along_field;
pub mod apart;
pub mod check;
pub mod cover;
pub mod crease;
mod density;
mod field;
pub mod fit;
pub mod fit_surface;
mod following;
pub mod glue;
pub mod layers;
pub mod layout;
mod missing;
pub mod net;
pub mod open;
pub mod optimise;
mod own;
pub mod part;
mod placement;
pub mod plan;
mod reembed;
pub mod resolve;
pub mod rim;
pub mod rows;
pub mod seam;
pub mod simplify_valence;
pub mod site;
pub mod smooth;
pub mod square;
mod stitching;
pub mod subdivide;
pub mod surface;
pub mod surgery;
pub mod template;

#[cfg(test)]
mod tests;

use crate::encode::index::PlanarIndex;
use crate::mesh::PolyMesh;
use crate::mesh::tri::TriMesh;
use crate::numerics::side_by_side;
use crate::numerics::stop::{self, Stop};
use crate::unfold::Chart;
use apart::Component;
use check::{Broken, check_structure, extraordinary};
use fit::{Fit, MeasuredSurface};
use net::Net;
use own::own_quads;
use resolve::Resolved;
use smooth::Target;
use stitching::{InputSize, Stitching};

/// Quads of a whole input of regular layouts, if nothing else is asked for.
const REGULAR_QUADS: f64 = 4000.0;

/// The input, and which segment each of its triangles belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The surface.
    pub surface: &'a TriMesh,
    /// Segment of each triangle; a triangle of none of them is left out.
    pub owner: &'a [u32],
    /// Number of segments.
    pub count: usize,
}

/// What is brought for a segment.
#[derive(Clone, Copy, Debug)]
pub enum Piece<'a> {
    /// A mapped example, subdivided where it misses the input if that is asked for.
    Mapped(&'a PolyMesh),
    /// A mapped example that was chosen for its layout: it is subdivided only where it can't be joined otherwise, and so
    /// is the whole.
    Kept(&'a PolyMesh),
    /// Its chart, for a regular layout.
    Regular(&'a Chart, &'a PlanarIndex),
    /// Nothing: a regular layout, or where it can't be unfolded its own triangles.
    Nothing,
}

/// How close a result has to lie to its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Closeness {
    /// As close as the parts do.
    AsBrought,
    /// Subdivided where it misses the input.
    Followed,
}

/// How to compose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Rounds of smoothing at the seams.
    pub smoothing: u32,
    /// By how much the edges of regular layouts are longer than usual.
    pub edge_scale: f64,
    /// How close the result has to lie.
    pub closeness: Closeness,
}

impl Default for Options {
    fn default() -> Self {
        Self { smoothing: 5, edge_scale: 1.0, closeness: Closeness::Followed }
    }
}

/// How a composition came about, at its worst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// The parts as they are.
    #[default]
    Direct,
    /// Some parts subdivided once or more before stitching.
    PartsSubdivided,
    /// Some parts given up for regular layouts, or for their segment's own triangles.
    PartsReplaced,
    /// Everything subdivided once after stitching, in place of surgery: four times the quads.
    AllSubdivided,
    /// No part could be used: the input's own triangles as quads.
    InputSubdivided,
}

/// What a composition did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// How it came about.
    pub way: Way,
    /// Extraordinary vertices inside the parts, before stitching.
    pub extraordinary_before: usize,
    /// Extraordinary vertices of the result.
    pub extraordinary_after: usize,
    /// Pairs of vertices merged along seams.
    pub merged: usize,
    /// Faces that filled holes.
    pub filled: usize,
    /// What resolving triangles did.
    pub resolved: Resolved,
    /// How often each part was subdivided.
    pub subdivided: Vec<usize>,
    /// Segments whose part was given up for a regular layout, since it could not be joined.
    pub replaced: Vec<usize>,
    /// Segments whose part was given up for a regular layout, since it is far denser than everything else.
    pub too_dense: Vec<usize>,
    /// Segments whose part was given up for a regular layout, since it passes the surface by far.
    pub missing: Vec<usize>,
    /// Segments of which the own triangles were made quads.
    pub own: Vec<usize>,
    /// Holes smaller than a quad that were closed.
    pub closed: usize,
    /// Times the whole was subdivided to follow the input.
    pub refined: usize,
    /// How far the result lies from the input, as shares of the diagonal of its bounding box.
    pub fit: Fit,
}

/// A composed mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Composed {
    /// The mesh: quads only, as [`check`] asks.
    pub mesh: PolyMesh,
    /// What was done.
    pub report: Report,
}

/// Why there is no composition.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ComposeError {
    /// Not one part a segment.
    #[error("expected a part for each of {expected} segments, found {found}")]
    Parts {
        /// Segments.
        expected: usize,
        /// Parts.
        found: usize,
    },
    /// Labels of other triangles.
    #[error("expected a segment for each of {expected} triangles, found {found}")]
    Owners {
        /// Triangles.
        expected: usize,
        /// Labels.
        found: usize,
    },
    /// The caller asked to stop.
    #[error("stitching was stopped")]
    Stopped,
    /// Even the input's own triangles make no such mesh.
    #[error("the surface can't be made of quads: {0}")]
    Surface(#[from] Broken),
}

/// Work that a composition may take, in steps, before it is late: so many, and so many for each triangle of the input and
/// each face brought. Real inputs take a fraction of it; a ragged scan of a hundred pieces took a
/// hundred times as much as its size suggests.
const STEPS_LEAST: u64 = 4_000_000;
const STEPS_PER_FACE: u64 = 200;

/// An input of more segments is ragged, and of its components only so many, those of most area, are worth that work.
const SEGMENTS_FEW: usize = 32;
const WORTH_MAX: usize = 16;

/// A component gets a share of [`STEPS_LEAST`] by its triangles, but no less than this one.
const STEPS_SHARE_MIN: f64 = 1.0 / 16.0;

/// The work that a component is worth, in steps, of an input of so many triangles.
fn steps_for(component: &Component, pieces: &[Piece<'_>], triangles: usize) -> u64 {
    let faces_of = |piece: &Piece<'_>| match piece {
        Piece::Mapped(mesh) | Piece::Kept(mesh) => mesh.faces.len(),
        Piece::Regular(..) | Piece::Nothing => 0,
    };
    let own = component.surface.triangles.len();
    let share = (own as f64 / triangles.max(1) as f64).max(STEPS_SHARE_MIN);
    let faces = own + pieces.iter().map(faces_of).sum::<usize>();
    (STEPS_LEAST as f64 * share) as u64 + STEPS_PER_FACE.saturating_mul(faces as u64)
}

/// Stitches what is brought for the segments, and checks the result. `stopped` is asked before each try.
///
/// # Errors
/// [`ComposeError`]; none but [`ComposeError::Stopped`] for one piece a segment of a valid surface.
pub fn compose(
    input: Input<'_>,
    pieces: &[Piece<'_>],
    options: Options,
    stopped: Stop<'_>,
) -> Result<Composed, ComposeError> {
    if pieces.len() != input.count {
        return Err(ComposeError::Parts { expected: input.count, found: pieces.len() });
    }
    if input.owner.len() != input.surface.triangles.len() {
        return Err(ComposeError::Owners { expected: input.surface.triangles.len(), found: input.owner.len() });
    }
    let scale = apart::scale(&apart::owned(input));
    let components = apart::apart(input);
    let worth = apart::worth(&components, SEGMENTS_FEW, WORTH_MAX);
    let one = |k: usize| {
        let component = &components[k];
        let of_it: Vec<Piece<'_>> = component.segments.iter().map(|&s| pieces[s]).collect();
        let steps = || steps_for(component, &of_it, input.surface.triangles.len());
        // A scrap is late from the start.
        let late_at = if worth[k] { stop::steps().saturating_add(steps()) } else { 0 };
        composed(component.input(), &of_it, options, scale, late_at, stopped)
    };
    let all = |some: &[usize]| some.iter().map(|&k| Ok((k, one(k)?))).collect::<Result<Vec<_>, ComposeError>>();
    let [some, others] = apart::in_two_groups(&components);
    let (some, others) = match others.is_empty() {
        true => (all(&some), Ok(Vec::new())),
        false => side_by_side(|| all(&some), || all(&others)),
    };
    let mut made: Vec<(usize, Composed)> = some?.into_iter().chain(others?).collect();
    made.sort_by_key(|(k, _)| *k);
    let made = made.into_iter().map(|(k, one)| (components[k].segments.clone(), one)).collect();
    let (mesh, mut report) = apart::together(made, pieces.len());
    report.extraordinary_after = extraordinary(&mesh);
    let fit = MeasuredSurface::new(&apart::owned(input)).fit(&mesh);
    report.fit = Fit { out: fit.out / scale.diagonal, back: fit.back / scale.diagonal };
    Ok(Composed { mesh, report })
}

/// How far a mesh lies from an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Miss {
    /// On average, or the input from it: the larger, as a share of the input's diagonal.
    pub mean: f64,
    /// Share of the input's area that it passes over by more than a protrusion or an ear may be passed over.
    pub passed: f64,
}

/// How far a mesh lies from an input; `None` where the mesh is not what a composition of it would have to be: quads only,
/// of the input's topology.
pub fn miss(input: Input<'_>, mesh: &PolyMesh) -> Option<Miss> {
    let owned = apart::owned(input);
    check::check(mesh, check::TopologyCounts::of(&owned)).ok()?;
    let diagonal = apart::scale(&owned).diagonal;
    let [out, back] = MeasuredSurface::new(&owned).distances(mesh);
    let passed = back.iter().filter(|(_, away)| *away > following::UNCOVERED_MAX * diagonal).count();
    let mean = Fit::of(&out, &back).worst() / diagonal;
    Some(Miss { mean, passed: passed as f64 / back.len().max(1) as f64 })
}

/// A mesh on an input with each of its faces split at its middle, its new vertices on the input, and those of its boundary on the
/// input's, where that is near. All layers are split with it.
pub fn split(input: Input<'_>, mesh: &PolyMesh) -> PolyMesh {
    let target = Target::new(&apart::owned(input));
    let mut fine = layers::subdivided(mesh);
    let net = Net::from_mesh(&fine);
    // Half of each edge: a rim inside the input, as of an eye, is farther from the input's own.
    let mut reach = vec![0.0; fine.positions.len()];
    for face in fine.faces.iter() {
        let (corner, middles) = (fine.positions[face[0] as usize], [face[1], face[3]]);
        middles.iter().for_each(|&v| reach[v as usize] = (fine.positions[v as usize] - corner).norm());
    }
    for (v, p) in fine.positions.iter_mut().enumerate().skip(mesh.positions.len()) {
        let on_border = net.on_boundary(v as u32).then(|| target.onto_border(*p));
        *p = on_border.filter(|near| (near - *p).norm() <= reach[v]).unwrap_or_else(|| target.onto_surface(*p));
    }
    fine
}

/// One component of an input.
fn composed(
    input: Input<'_>,
    pieces: &[Piece<'_>],
    options: Options,
    scale: InputSize,
    late_at: u64,
    stop: &dyn Fn() -> bool,
) -> Result<Composed, ComposeError> {
    let stitching = Stitching::new(input, options, scale, late_at);
    let mut report = Report { subdivided: vec![0; pieces.len()], ..Report::default() };
    let is_brought = |piece: &Piece<'_>| matches!(piece, Piece::Mapped(_) | Piece::Kept(_));
    let mesh = if input.surface.triangles.len() == 1 && !pieces.iter().any(is_brought) {
        by_input(&stitching, &mut report, LONE_SUBDIVIDED)?
    } else {
        match stitching.run(pieces, &mut report, stop) {
            Some(mesh) => mesh,
            None if stop() => return Err(ComposeError::Stopped),
            None => by_input(&stitching, &mut report, 0)?,
        }
    };
    Ok(Composed { mesh, report })
}

/// A lone triangle has no form that a layout could follow, and a chart of it is folded at a corner: its three quads are split in
/// four so often.
const LONE_SUBDIVIDED: usize = 2;

/// The input's own triangles as quads, and those cut in four `times` times.
fn by_input(stitching: &Stitching<'_>, report: &mut Report, times: usize) -> Result<PolyMesh, ComposeError> {
    let surface = stitching.surface();
    *report = Report { way: Way::InputSubdivided, ..Report::default() };
    report.own = (0..stitching.segments()).collect();
    report.subdivided = vec![0; stitching.segments()];
    let net = (0..times).fold(own_quads(surface), |net, _| subdivide::subdivide(&net));
    let (mesh, _) = net.into_mesh();
    check_structure(&mesh, check::TopologyCounts::of(surface))?;
    Ok(mesh)
}
