//! Compositions and templates.

use super::super::{
    Encoded, EngineError, Mapped, Model, Opaque, Part, Refusal, Registration, Side, Stitched, Stitching,
};
use super::fresh;
use super::grouped::Pieces;
use super::model::ModelInner;
use super::told::{self, MISS_TOLD_PCT};
use crate::pool::Stop;
use quadmuse_kernel::compose::{self, Closeness, Options, Piece, ground::Ground, net::Net, subdivide, template};
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_kernel::register::Query;
use quadmuse_proto::{Distortion, Flip, Histogram, Verdict, composition::AS_MAPPED};
use std::sync::Arc;

/// Most faces that a density may ask for.
const FACES_MAX: usize = 4_000_000;
/// Quads of a template on an input of which nothing else tells a density.
const TEMPLATE_QUADS: f64 = 4000.0;

/// A single map that misses its input by no more than this, in percent of the diagonal, stays as it is.
const CLOSE_PCT: f64 = 0.15;
/// What is told where its vertices were moved.
const MOVED: &str = "the map's vertices were moved so that its faces lie on the input; its layout is the example's own";

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
    if let [Part::Mapped { whole, .. } | Part::Poor { whole, .. }] = parts
        && how.density == 0
        && let Some(made) = as_one(&ground, whole, how, stop)?
    {
        return Ok(Stitched { is_poor_kept: matches!(parts, [Part::Poor { .. }]), ..made });
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
struct Made {
    mesh: PolyMesh,
    report: compose::Report,
    brought: told::Brought,
}

impl Made {
    fn told(self) -> Stitched {
        let mut notes = told::brought(&self.brought);
        notes.extend(told::made(&self.report, self.mesh.faces.len()));
        Stitched {
            is_poor_kept: false,
            extraordinary_vertices: self.report.extraordinary_after as u64,
            extraordinary_before: self.report.extraordinary_before as u64,
            mesh: Arc::new(self.mesh),
            notes,
        }
    }
}

/// One piece for each group of segments.
fn stitched(
    ground: &Ground<'_>,
    parts: &[Part],
    pieces: &Pieces,
    how: Stitching,
    stop: &Stop,
) -> Result<Made, EngineError> {
    let mut told = told::Brought::default();
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
        edge_scale: 0.5f64.powi(how.density),
        // Who asks for a coarser layout wants it as coarse as that.
        closeness: if how.density < 0 { Closeness::AsBrought } else { Closeness::Followed },
    };
    let made = compose::compose(ground.input(), &all, options, &|| stop.reason().is_some());
    stopped(stop)?;
    let made = made.map_err(|e| EngineError::refused(Refusal::CompositionInvalid, e.to_string()))?;
    Ok(Made { mesh: made.mesh, report: pieces.by_segment(made.report), brought: told })
}

/// A map of a whole input that follows it: as it is where it lies close, else with its vertices moved until its faces, not
/// the vertices alone, lie on the input. All of the example comes with it. `None` for one that does not follow.
fn as_one(
    ground: &Ground<'_>,
    whole: &Arc<PolyMesh>,
    how: Stitching,
    stop: &Stop,
) -> Result<Option<Stitched>, EngineError> {
    let miss_pct = compose::miss(ground.input(), whole).map_or(f64::INFINITY, |miss| 100.0 * miss);
    if miss_pct > MISS_TOLD_PCT {
        return Ok(None);
    }
    if miss_pct <= CLOSE_PCT {
        return Ok(Some(as_mapped(whole)));
    }
    let part = [Part::Mapped { part: Arc::clone(whole), whole: Arc::clone(whole) }];
    let mut made = stitched(ground, &part, &Pieces::single(1), how, stop)?;
    if made.mesh.faces != whole.faces {
        return Ok(Some(as_mapped(whole)));
    }
    made.mesh.attributes = whole.attributes.clone();
    let mut told = made.told();
    told.notes.push(MOVED.into());
    Ok(Some(told))
}

/// A map of a whole input that needs nothing done.
fn as_mapped(whole: &Arc<PolyMesh>) -> Stitched {
    let extraordinary = compose::check::extraordinary(whole) as u64;
    Stitched {
        is_poor_kept: false,
        mesh: Arc::clone(whole),
        extraordinary_vertices: extraordinary,
        extraordinary_before: extraordinary,
        notes: vec![AS_MAPPED.into()],
    }
}

fn stopped(stop: &Stop) -> Result<(), EngineError> {
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))
}

/// A part, subdivided or coarsened; its faces are counted before the work.
fn at_density(
    mesh: &PolyMesh,
    segment: usize,
    density: i32,
    told: &mut told::Brought,
) -> Result<PolyMesh, EngineError> {
    if density == 0 {
        return Ok(mesh.clone());
    }
    let mut net = Net::from_mesh(mesh);
    if density > 0 {
        let faces = 4usize.saturating_pow(density as u32 - 1).saturating_mul(mesh.faces.corners().len());
        if faces > FACES_MAX {
            let detail = format!(
                "expected a density at which segment {segment} has at most {FACES_MAX} faces, found {density}, at which it has {faces}; ask for less"
            );
            return Err(EngineError::refused(Refusal::CompositionInvalid, detail));
        }
        (0..density).for_each(|_| net = subdivide::subdivide(&net));
    }
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
    let edge = (inner.segmented.mesh.total_area() / TEMPLATE_QUADS).sqrt();
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
        distance_max: 0.0,
        distortion: Distortion { angle: none(), area: none() },
        verdict: Verdict::Fair,
        reasons: vec!["a regular layout, made for this segment: no example was laid on it".into()],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_kernel::mesh::{Polygons, Vec3, prepare};
    use quadmuse_kernel::segment::Segmented;
    use quadmuse_kernel::topology::Components;

    /// A dome of n × n quads over a square.
    fn dome(n: usize) -> PolyMesh {
        let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        let point =
            |(i, j): (usize, usize)| Vec3::new(at(i), at(j), 0.8 * (1.0 - at(i).powi(2)) * (1.0 - at(j).powi(2)));
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(point).collect();
        let quad = |i: usize, j: usize| [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        let faces = (0..n)
            .flat_map(|j| (0..n).map(move |i| quad(i, j).map(|(i, j)| (j * (n + 1) + i) as u32).to_vec()))
            .collect::<Vec<_>>();
        PolyMesh { positions, faces: faces.iter().map(Vec::as_slice).collect::<Polygons>(), ..PolyMesh::default() }
    }

    #[test]
    fn a_map_of_few_faces_is_moved_until_they_lie_on_the_input_and_keeps_all_else() {
        let surface = prepare(&dome(60)).expect("a disc").mesh;
        let segmented = Segmented::primitive(&surface, Components::Crumbs).expect("a disc");
        let ground = Ground::of(&segmented);
        let how = Stitching { smoothing: 5, density: 0 };
        let miss_pct = |mesh: &PolyMesh| 100.0 * compose::miss(ground.input(), mesh).expect("a disc of quads");
        let made = |n: usize| {
            let map = Arc::new(dome(n));
            let made = as_one(&ground, &map, how, &Stop::new(None)).expect("a layout");
            (map, made)
        };
        let needs = |n: &usize| (CLOSE_PCT..MISS_TOLD_PCT).contains(&miss_pct(&dome(*n)));
        let (coarse, moved) = made((4..30).find(needs).expect("some dome misses by so much"));
        let moved = moved.expect("it follows");
        assert_eq!((&moved.mesh.faces, &moved.notes[..]), (&coarse.faces, &[MOVED.to_owned()][..]));
        assert!(miss_pct(&moved.mesh) < CLOSE_PCT);
        let (fine, kept) = made(30);
        let kept = kept.expect("it follows");
        assert_eq!((&kept.mesh, &kept.notes[..]), (&fine, &[AS_MAPPED.to_owned()][..]));
        assert!(made(4).1.is_none(), "so few faces do not follow");
    }
}
