//! Segments that are composed as one piece: neighbours that keep what they are in an example that was laid whole.
//!
//! Where a query was cut as an example is and takes most of its parts from there, the cuts between these were never needed.

use super::model::{Model, WholeMap};
use super::stitch::Part;
use crate::compose::{Report, part, surface::ComposedSurface};
use crate::map::assemble::Winding;
use crate::mesh::{PolyMesh, Vec3};
use crate::topology::submesh;

/// The pieces of a composition.
pub(crate) struct Pieces {
    /// The segments of each, in order; with what lies on several of them together.
    all: Vec<(Vec<usize>, Option<PolyMesh>)>,
}

impl Pieces {
    /// A piece a segment.
    pub(crate) fn single(segments: usize) -> Self {
        Self { all: (0..segments).map(|segment| (vec![segment], None)).collect() }
    }

    /// One for each set of neighbours that take their parts from the whole.
    pub(crate) fn grouped(query: &Model, parts: &[Part]) -> Self {
        let Some(laid) = &query.laid else { return Self::single(parts.len()) };
        let is_of_whole = |segment: usize| matches!(parts.get(segment), Some(Part::OfWhole(_)));
        let mut seen = vec![false; parts.len()];
        let mut all = Vec::new();
        for first in 0..parts.len() {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let (mut segments, mut next) = (vec![first], 0);
            while let Some(&segment) = segments.get(next).filter(|_| is_of_whole(first)) {
                next += 1;
                for beside in query.segmented.neighbours(segment as u32).into_iter().map(|n| n as usize) {
                    if is_of_whole(beside) && !std::mem::replace(&mut seen[beside], true) {
                        segments.push(beside);
                    }
                }
            }
            segments.sort_unstable();
            let joined = if segments.len() > 1 { joined(laid, &segments) } else { None };
            match joined {
                Some(mesh) => all.push((segments, Some(mesh))),
                None => all.extend(segments.into_iter().map(|segment| (vec![segment], None))),
            }
        }
        Self { all }
    }

    /// Whether a piece lies on several segments.
    pub(crate) fn is_any_joined(&self) -> bool {
        self.all.iter().any(|piece| piece.1.is_some())
    }

    /// The ground with a segment a piece.
    pub(crate) fn ground<'a>(&self, ground: &ComposedSurface<'a>) -> ComposedSurface<'a> {
        let count = self.all.iter().map(|piece| piece.0.len()).sum();
        let mut piece_of = vec![0; count];
        for (piece, (segments, _)) in self.all.iter().enumerate() {
            segments.iter().for_each(|&segment| piece_of[segment] = piece as u32);
        }
        ground.joined(&piece_of, self.all.len())
    }

    /// The first segment of each piece, with what lies on it where they are several.
    pub(crate) fn each(&self) -> impl Iterator<Item = (usize, Option<&PolyMesh>)> {
        self.all.iter().filter_map(|(segments, joined)| segments.first().map(|&first| (first, joined.as_ref())))
    }

    /// Whether something that lies on several segments did not stay as it is, by what the report says of the segments.
    pub(crate) fn is_any_lost(&self, report: &Report) -> bool {
        let several = self.all.iter().filter(|piece| piece.1.is_some());
        let gone = [&report.replaced, &report.too_dense, &report.missing, &report.own];
        several.flat_map(|piece| &piece.0).any(|segment| {
            report.subdivided.get(*segment).is_none_or(|times| *times > 0) || gone.iter().any(|g| g.contains(segment))
        })
    }

    /// A report of pieces as one of segments.
    pub(crate) fn by_segment(&self, report: Report) -> Report {
        let segments = |pieces: &[usize]| {
            let mut all: Vec<usize> =
                pieces.iter().filter_map(|&piece| self.all.get(piece)).flat_map(|piece| piece.0.clone()).collect();
            all.sort_unstable();
            all
        };
        let mut subdivided = vec![0; self.all.iter().map(|piece| piece.0.len()).sum()];
        for ((of_it, _), times) in self.all.iter().zip(&report.subdivided) {
            of_it.iter().for_each(|&segment| subdivided[segment] = *times);
        }
        Report {
            subdivided,
            replaced: segments(&report.replaced),
            too_dense: segments(&report.too_dense),
            missing: segments(&report.missing),
            own: segments(&report.own),
            ..report
        }
    }
}

/// What the example has on some of its segments, where the whole was laid; `None` where a vertex has no place.
fn joined(laid: &WholeMap, segments: &[usize]) -> Option<PolyMesh> {
    let of = &*laid.example;
    let is_in = |t: &u32| of.segmented.part_of.get(*t as usize).is_some_and(|p| segments.contains(&(*p as usize)));
    let triangles: Vec<u32> = (0..of.segmented.mesh.triangles.len() as u32).filter(is_in).collect();
    let (mesh, vertex_of) = submesh(&of.segmented.mesh, &triangles);
    let places: Option<Vec<Vec3>> = vertex_of.iter().map(|&v| laid.places.get(v as usize).copied().flatten()).collect();
    let winding = if laid.mirrored { Winding::Reversed } else { Winding::Kept };
    places.map(|places| part::polygons(&mesh, &places, winding))
}
