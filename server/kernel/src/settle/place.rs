//! Where the settled vertices lie on the input at full resolution, and which of them lie beyond its end.
//!
//! A vertex is lost where the nearest point of the input lies on its rim and the way there along the surface is more than
//! τ mean edges of the vertex. So is what borders on lost vertices and looks away from the input or lies far off it: the back
//! of a head, of which a scan has the front, is nearest to that front and not to its rim.

use super::input_surface::InputSurface;
use super::rest::{Rest, vertex_normals};
use crate::mesh::Vec3;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::NONE;

/// τ.
const BEYOND: f64 = 0.05;
/// Vertices that lie farther from the input, in √area of the example as it lies, lie off it; so do those about them that are
/// farther than the second.
const OFF: [f64; 2] = [0.05, 0.02];
/// A barycentric coordinate below this is 0.
const ON_EDGE: f64 = 1e-9;

/// Places of the vertices, and whether each is lost. `edges`: mean edge length at each vertex.
pub(super) fn places(
    ground: &InputSurface<'_>,
    tree: &Bvh,
    positions: &[Vec3],
    edges: &[f64],
) -> (Vec<Closest>, Vec<bool>) {
    let places = tree.closest_to_all(positions);
    let lost = (places.iter().zip(positions).zip(edges))
        .map(|((place, x), edge)| {
            let way = x - place.point;
            let normal = normal_at(ground, place);
            on_rim(ground, place) && (way - normal * normal.dot(&way)).norm() > BEYOND * edge
        })
        .collect();
    (places, lost)
}

/// The lost vertices with those that border on them and look away from the input, or lie off it. `positions`: of the settled
/// vertices in the input's frame, before they go to their places; `size`: √area of the example there.
pub(super) fn with_hidden(
    rest: &Rest,
    (ground, size): (&InputSurface<'_>, f64),
    positions: &[Vec3],
    places: &[Closest],
    lost: Vec<bool>,
) -> Vec<bool> {
    let (normals, _) = vertex_normals(positions, &rest.triangles);
    let is_hidden =
        |v: usize| places[v].distance > OFF[0] * size || normals[v].dot(&normal_at(ground, &places[v])) < 0.0;
    rest.grown(lost, is_hidden)
}

/// Vertices that settled off the input, whichever side: it has nothing there, as an animal without horns where one with horns is
/// laid on it, or a scan whose mouth is shut where the example has the inside of one.
pub(super) fn off(rest: &Rest, size: f64, places: &[Closest]) -> Vec<bool> {
    let farther = |v: usize, limit: f64| places[v].distance > limit * size;
    let seeds = (0..places.len()).map(|v| farther(v, OFF[0])).collect();
    rest.grown(seeds, |v| farther(v, OFF[1]))
}

/// The input's normal at a place.
pub(super) fn normal_at(ground: &InputSurface<'_>, place: &Closest) -> Vec3 {
    let Some(corners) = ground.mesh.triangles.get(place.triangle as usize) else { return Vec3::z() };
    let sum: Vec3 = (0..3).map(|k| ground.normals[corners[k] as usize] * place.barycentric[k]).sum();
    sum.try_normalize(0.0).unwrap_or_else(Vec3::z)
}

fn on_rim(ground: &InputSurface<'_>, place: &Closest) -> bool {
    let Some(corners) = ground.mesh.triangles.get(place.triangle as usize) else { return true };
    let w = place.barycentric;
    (0..3).any(|k| {
        let at_corner = w[k] > 1.0 - ON_EDGE && ground.rim[corners[k] as usize];
        let on_edge = w[(k + 2) % 3] < ON_EDGE && ground.mesh.twin(3 * place.triangle + k as u32) == NONE;
        at_corner || on_edge
    })
}
