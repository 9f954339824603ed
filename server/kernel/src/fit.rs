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

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::{NONE, TriMesh, nearest_share};
use crate::register::Query;
use crate::segment::{Segmented, segment_labels};
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

/// A surface that was cut in two, and the part of it that stays.
#[derive(Debug)]
pub struct CroppedSurface {
    /// The surface cut in two: the part that stays, and the rest.
    pub segmented: Segmented,
    /// The part that stays, unfolded.
    pub surface: UnfoldedPatch,
}

/// What is left of an example's surface without the polygons most of whose vertices are `lost`; `None` where that is no
/// disc, or no more goes than a share `least` of the area. Lost pieces that are surrounded by what stays, stay.
pub fn without(surface: &UnfoldedPatch, lost: &[bool], least: f64) -> Option<CroppedSurface> {
    let mesh = &surface.patch.mesh;
    let mut counts: BTreeMap<u32, [u32; 2]> = BTreeMap::new();
    for (corners, f) in mesh.triangles.iter().zip(&mesh.polygon_of) {
        let count = counts.entry(*f).or_default();
        corners.iter().for_each(|&v| count[usize::from(lost.get(v as usize) == Some(&true))] += 1);
    }
    let is_gone: Vec<bool> =
        mesh.polygon_of.iter().map(|f| counts.get(f).is_some_and(|[kept, gone]| gone > kept)).collect();
    let area = |set: &Vec<u32>| set.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
    let mut pieces: Vec<Vec<u32>> =
        connected(mesh, &is_gone).into_iter().filter(|set| is_gone[set[0] as usize]).collect();
    // A closed surface opens where its largest piece goes.
    pieces.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.cmp(b)));
    let is_closed = mesh.twins.iter().all(|twin| *twin != NONE);
    let has_rim = |set: &[u32]| set.iter().any(|t| (0..3).any(|side| mesh.twin(3 * t + side) == NONE));
    // What stays is 0, each piece that goes has a number of its own.
    let mut label_of = vec![0; mesh.triangles.len()];
    let goes = |(k, set): &(usize, &Vec<u32>)| (is_closed && *k == 0) || has_rim(set);
    if pieces.iter().enumerate().filter(goes).map(|(_, set)| area(set)).sum::<f64>() <= least * mesh.total_area() {
        return None;
    }
    for ((_, set), label) in pieces.iter().enumerate().filter(goes).zip(1..) {
        set.iter().for_each(|&t| label_of[t as usize] = label);
    }
    let mut segmented = segment_labels(mesh, label_of);
    let part = segmented.parts.first()?;
    let found = primitive(&part.mesh, Components::SmallLeftOut).ok().filter(|p| p.topology == Topology::Disc)?;
    let patch = Patch { topology: found.topology, holes: found.holes, ..part.clone() };
    segmented.parts[0] = patch.clone();
    Some(CroppedSurface { segmented, surface: UnfoldedPatch::new(patch).ok()? })
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
