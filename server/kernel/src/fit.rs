//! Fitting: an example laid on an input that may end elsewhere than it does.
//!
//! Rough places are tried, and the best settle ([`places`]); limbs match in several [`ways`]. What the input has nothing for is
//! left out, and folds are mended ([`mend`]); what the input has beyond the example is continued ([`beyond`]).

pub mod beyond;
mod crescent;
pub mod extrude;
pub mod flat;
pub mod limbs;
pub mod mend;
pub mod openings;
pub mod places;
pub mod rough;
pub mod ways;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::{NONE, TriMesh, nearest_share};
use crate::register::Query;
use crate::segment::segment_labels;
use crate::topology::{Components, Patch, Topology, connected, primitive};
use crate::unfold::{UnfoldError, UnfoldOptions};

/// A patch with its unfolding: a surface that can be fitted.
#[derive(Clone, Debug)]
pub struct UnfoldedPatch {
    /// Its mesh.
    pub patch: Arc<Patch>,
    /// The same, unfolded.
    pub query: Arc<Query>,
}

impl UnfoldedPatch {
    /// Unfolds a patch.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn new(patch: Patch) -> Result<Self, UnfoldError> {
        let query = Arc::new(Query::new(&patch, &UnfoldOptions::default())?);
        Ok(Self { patch: Arc::new(patch), query })
    }
}

/// What is left of an example's surface without the polygons most of whose vertices are `lost`; `None` where that is no
/// disc, or no more goes than a share `least` of the area. Lost pieces that are surrounded by what stays, stay.
pub fn without(surface: &UnfoldedPatch, lost: &[bool], least: f64) -> Option<UnfoldedPatch> {
    let mesh = &surface.patch.mesh;
    let mut counts: BTreeMap<u32, [u32; 2]> = BTreeMap::new();
    for (corners, f) in mesh.triangles.iter().zip(&mesh.polygon_of) {
        let count = counts.entry(*f).or_default();
        corners.iter().for_each(|&v| count[usize::from(lost.get(v as usize) == Some(&true))] += 1);
    }
    let is_gone = |f: &u32| counts.get(f).is_some_and(|[kept, gone]| gone > kept);
    let mut pieces = pieces(mesh, &is_gone, &|_| true);
    // A closed surface opens where its largest piece goes.
    let is_closed = mesh.twins.iter().all(|twin| *twin != NONE);
    let mut is_first = true;
    pieces.retain(|piece| (is_closed && std::mem::take(&mut is_first)) || piece.has_rim);
    if pieces.iter().map(|piece| piece.area).sum::<f64>() <= least * mesh.total_area() {
        return None;
    }
    let part = without_pieces(mesh, &pieces)?;
    let found = primitive(&part.mesh, Components::SmallLeftOut).ok().filter(|p| p.topology == Topology::Disc)?;
    UnfoldedPatch::new(Patch { topology: found.topology, holes: found.holes, ..part }).ok()
}

/// Takes from an example's surface its limbs that the input lacks: pieces of polygons with a vertex that is `missing`,
/// surrounded by what stays, each more than a share `least` of the area. The openings that they leave count as holes. `None` where no
/// piece is so large, or the rest falls apart.
pub fn without_limbs(surface: &UnfoldedPatch, missing: &[bool], least: f64) -> Option<UnfoldedPatch> {
    let (patch, mesh) = (&surface.patch, &surface.patch.mesh);
    let is_missing = |corners: &[u32; 3]| corners.iter().any(|&v| missing[v as usize]);
    let gone: BTreeSet<u32> =
        mesh.triangles.iter().zip(&mesh.polygon_of).filter(|(t, _)| is_missing(t)).map(|(_, f)| *f).collect();
    let ends: Vec<Vec<u32>> = mesh.boundary_loops().into_iter().filter(|edges| !patch.holes.contains(edges)).collect();
    let mut is_at_end = vec![false; mesh.positions.len()];
    ends.iter().flatten().for_each(|&h| is_at_end[mesh.tail(h) as usize] = true);
    // A head that is open at its eyes goes all the same.
    let mut limbs = pieces(mesh, &|f| gone.contains(f), &|h| is_at_end[mesh.tail(h) as usize]);
    limbs.retain(|piece| !piece.has_rim && piece.area > least * mesh.total_area());
    if limbs.is_empty() {
        return None;
    }
    let part = without_pieces(mesh, &limbs)?;
    let mut holes = part.mesh.boundary_loops();
    let is_end =
        |edges: &Vec<u32>| edges.iter().all(|&h| is_at_end[part.vertex_of[part.mesh.tail(h) as usize] as usize]);
    holes.retain(|edges| !is_end(edges));
    let topology = primitive::with_ends(&part.mesh, ends.len()).ok().filter(|topology| *topology == patch.topology)?;
    UnfoldedPatch::new(Patch { topology, holes, ..part }).ok()
}

/// A connected piece of a surface.
struct Piece {
    triangles: Vec<u32>,
    area: f64,
    /// True where it reaches the surface's rim.
    has_rim: bool,
}

/// The connected pieces of some polygons of a surface, the largest first. `is_rim`: whether a boundary halfedge counts as the rim.
fn pieces(mesh: &TriMesh, is_of: &impl Fn(&u32) -> bool, is_rim: &impl Fn(u32) -> bool) -> Vec<Piece> {
    let label_of: Vec<bool> = mesh.polygon_of.iter().map(is_of).collect();
    let piece = |triangles: Vec<u32>| {
        let area = triangles.iter().map(|&t| mesh.area(t as usize)).sum();
        let has_rim = triangles.iter().flat_map(|t| 3 * t..3 * t + 3).any(|h| mesh.twin(h) == NONE && is_rim(h));
        Piece { triangles, area, has_rim }
    };
    let mut all: Vec<Piece> =
        connected(mesh, &label_of).into_iter().filter(|set| label_of[set[0] as usize]).map(piece).collect();
    all.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.triangles.cmp(&b.triangles)));
    all
}

/// The largest part of a surface without some pieces.
fn without_pieces(mesh: &TriMesh, pieces: &[Piece]) -> Option<Patch> {
    // What stays is 0, each piece that goes has a number of its own.
    let mut label_of = vec![0; mesh.triangles.len()];
    for (piece, label) in pieces.iter().zip(1..) {
        piece.triangles.iter().for_each(|&t| label_of[t as usize] = label);
    }
    segment_labels(mesh, label_of).parts.into_iter().next()
}

/// Where an input goes on beyond an example that was laid on it: a value a vertex of the input, positive within the example,
/// about as large as the distance from the example's rim. Beyond are vertices that are nearest to the rim, and what borders on these
/// and has no face near it that looks its way: the front of a thin neck is near to its back. `None` for an example without a rim.
pub fn within(example: &TriMesh, positions: &[Vec3], input: &TriMesh) -> Option<Vec<f64>> {
    let laid = TriMesh { positions: positions.to_vec(), ..example.clone() };
    let rim: Vec<[Vec3; 2]> = (0..laid.twins.len() as u32)
        .filter(|&h| laid.twin(h) == NONE)
        .map(|h| [laid.tail(h), laid.head(h)].map(|v| laid.positions[v as usize]))
        .collect();
    if rim.is_empty() {
        return None;
    }
    let (tree, on_rim) = (Bvh::new(&laid), laid.boundary_vertices());
    let away = |x: Vec3| {
        let of = |edge: &[Vec3; 2]| (edge[0].lerp(&edge[1], nearest_share(*edge, x)) - x).norm();
        rim.iter().map(of).fold(f64::INFINITY, f64::min)
    };
    let nearest = tree.closest_to_all(&input.positions);
    let normals = input.vertex_area_vectors();
    let alike = |v: usize| laid.area_vector(nearest[v].triangle as usize).dot(&normals[v]);
    // An example may lie mirrored.
    let way = (0..nearest.len()).map(alike).sum::<f64>();
    let size = |t: u32| {
        let [a, b, c] = laid.triangles[t as usize].map(|v| laid.positions[v as usize]);
        (b - a).norm().max((c - b).norm()).max((a - c).norm())
    };
    let is_apart = |v: usize| alike(v) * way < 0.0 || nearest[v].distance > size(nearest[v].triangle);
    let mut is_beyond: Vec<bool> = nearest.iter().map(|near| is_on_rim(&laid, &on_rim, near)).collect();
    let neighbours = input.neighbours();
    let mut todo: Vec<usize> = (0..is_beyond.len()).filter(|&v| is_beyond[v]).collect();
    while let Some(v) = todo.pop() {
        for &next in &neighbours[v] {
            let next = next as usize;
            if !is_beyond[next] && is_apart(next) {
                is_beyond[next] = true;
                todo.push(next);
            }
        }
    }
    let signed = |(v, &x): (usize, &Vec3)| if is_beyond[v] { -away(x) } else { away(x) };
    Some(input.positions.iter().enumerate().map(signed).collect())
}

/// Tells whether a point of a mesh lies on its boundary, or on that part of it whose vertices are `on_rim`: on one of its edges, or
/// at one of its vertices, whose triangle may have no such edge.
fn is_on_rim(mesh: &TriMesh, on_rim: &[bool], at: &Closest) -> bool {
    let corners = mesh.triangles[at.triangle as usize];
    let is_at_vertex = |k: usize| at.barycentric[k] > 1.0 - 1e-9 && on_rim[corners[k] as usize];
    (0..3).any(is_at_vertex)
        || (0..3u32).any(|k| {
            // The edge opposite the third corner is the halfedge of the first.
            let ends = [k, (k + 1) % 3].map(|k| on_rim[corners[k as usize] as usize]);
            at.barycentric[(k as usize + 2) % 3] < 1e-9 && mesh.twin(3 * at.triangle + k) == NONE && ends == [true; 2]
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::{ball, grid};

    fn unfolded(mesh: &TriMesh) -> UnfoldedPatch {
        UnfoldedPatch::new(crate::topology::whole(mesh).expect("a primitive")).expect("solvable")
    }

    /// Returns the topology of a surface without the vertices about a point, and the number of its holes.
    fn without_about(surface: &UnfoldedPatch, at: Vec3, radius: f64) -> Option<(Topology, usize)> {
        let missing: Vec<bool> = surface.patch.mesh.positions.iter().map(|x| (x - at).norm() < radius).collect();
        without_limbs(surface, &missing, 0.01).map(|left| (left.patch.topology, left.patch.holes.len()))
    }

    #[test]
    fn limbs_that_are_missing_leave_openings_unless_they_are_small_or_reach_the_rim() {
        let sheet = unfolded(&grid(20, 20, false, false));
        let mesh = &sheet.patch.mesh;
        let [low, high] = [mesh.positions[0], mesh.positions[mesh.positions.len() - 1]];
        let (middle, size) = ((low + high) / 2.0, (high - low).norm());
        assert_eq!(without_about(&sheet, middle, 0.15 * size), Some((Topology::Disc, 1)));
        assert_eq!(without_about(&sheet, middle, 0.01 * size), None, "one vertex");
        assert_eq!(without_about(&sheet, low, 0.2 * size), None, "at a corner");
        let ball = unfolded(&ball(24));
        let top = ball.patch.mesh.positions[0];
        assert_eq!(without_about(&ball, top, 0.5), Some((Topology::Sphere, 1)));
    }
}
