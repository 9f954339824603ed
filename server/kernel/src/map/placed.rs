//! A part of an example on a part of the input, taken from where the example was laid whole.
//!
//! The whole map knows better where a part belongs than the part does alone, but ends beside the part's curves and not on
//! them. Each vertex goes to the nearest point of the input's part; those on a boundary loop go to the nearest points of the
//! loop that it lies on, as far as they keep their order there: of all ways once around, that for which the sum of the
//! distances is least. *Ours, not the paper's.*

use super::CrossMap;
use super::boundary_loop::BoundaryLoop;
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::topology::Patch;
use crate::unfold::Chart;

/// Places on a loop for each of its vertices that are told apart, and how many more of them the loop's edges may ask for.
const STEPS: usize = 4;
const STEPS_MAX: usize = 16;
/// Least distance of neighbours on a loop, in steps from place to place.
const GAP: f64 = 0.2;
/// A loop of more vertices is not laid: the work grows with their square.
const VERTICES_MAX: usize = 3000;

/// The map that takes the vertices of an example's part near to `points`, one a vertex; `bvh` is the tree of the input's mesh,
/// `mirror` −1 for mirrored maps.
/// `None` where the part has not as many boundary loops as the input's.
pub fn placed(part: &Patch, points: &[Vec3], input: &Chart, bvh: &Bvh, mirror: f64) -> Option<CrossMap> {
    let mut locations: Vec<Location> = points.iter().map(|p| bvh.closest(*p).into()).collect();
    let loops: Vec<Vec<u32>> = part
        .mesh
        .boundary_loops()
        .into_iter()
        .filter(|ring| !part.holes.contains(ring))
        .map(|ring| {
            let mut vertices: Vec<u32> = ring.iter().map(|&h| part.mesh.tail(h)).collect();
            if mirror < 0.0 {
                vertices.reverse();
            }
            vertices
        })
        .collect();
    if loops.iter().any(|vertices| vertices.len() > VERTICES_MAX) {
        return None;
    }
    let mesh = &input.mesh;
    let rings: Vec<BoundaryLoop> = mesh.boundary_loops().into_iter().map(|h| BoundaryLoop::new(mesh, h)).collect();
    for (vertices, ring) in loops.iter().zip(matched(&loops, &rings, mesh, points)?) {
        let at: Vec<Vec3> = vertices.iter().map(|&v| points[v as usize]).collect();
        for (&v, s) in vertices.iter().zip(in_order(ring, mesh, &at)) {
            locations[v as usize] = ring.location(s);
        }
    }
    let positions = locations.iter().map(|l| l.point(input)).collect();
    Some(CrossMap { locations, positions })
}

/// For each loop the ring that it lies on: of all ways to give each its own, that with the least distances. `None` where
/// there are not as many.
fn matched<'r>(
    loops: &[Vec<u32>],
    rings: &'r [BoundaryLoop],
    mesh: &TriMesh,
    points: &[Vec3],
) -> Option<Vec<&'r BoundaryLoop>> {
    let away = |vertices: &Vec<u32>, ring: &BoundaryLoop| {
        vertices.iter().map(|&v| ring.nearest(mesh, points[v as usize]).1).sum::<f64>() / vertices.len() as f64
    };
    match (loops, rings) {
        ([], []) => Some(Vec::new()),
        ([_], [ring]) => Some(vec![ring]),
        ([one, two], [first, second]) => {
            let straight = away(one, first) + away(two, second);
            let crossed = away(one, second) + away(two, first);
            Some(if straight <= crossed { vec![first, second] } else { vec![second, first] })
        }
        _ => None,
    }
}

/// Arc lengths for points that follow each other once around, from that of the point that lies nearest.
fn in_order(ring: &BoundaryLoop, mesh: &TriMesh, points: &[Vec3]) -> Vec<f64> {
    let (n, length) = (points.len(), ring.length);
    let near: Vec<(f64, f64)> = points.iter().map(|&p| ring.nearest(mesh, p)).collect();
    let first = (0..n).min_by(|&a, &b| near[a].1.total_cmp(&near[b].1)).unwrap_or(0);
    let around = |k: usize| (first + k) % n;
    let start = near[around(0)].0;
    let steps = (STEPS * n).max(ring.halfedges.len().min(STEPS_MAX * n));
    let step = length / steps as f64;
    let places: Vec<Vec3> = (0..steps).map(|j| ring.at(mesh, start + j as f64 * step)).collect();
    let rest: Vec<Vec3> = (1..n).map(|k| points[around(k)]).collect();
    let mut at = vec![start; n];
    let mut before = 0.0;
    for (k, j) in (1..n).zip(least_in_order(&rest, &places)) {
        // The nearest point itself, where that lies between the places beside.
        let ahead = (near[around(k)].0 - start).rem_euclid(length.max(f64::MIN_POSITIVE));
        let place = j as f64 * step;
        let here = if (ahead - place).abs() < step { ahead } else { place };
        before = f64::max(here, before + GAP * step).min(length - (n - k) as f64 * GAP * step);
        at[around(k)] = start + before;
    }
    at
}

/// For points in order the numbers of places in order, each higher than the one before and none the first, for which the sum
/// of the distances is least. There are more places than points.
fn least_in_order(points: &[Vec3], places: &[Vec3]) -> Vec<usize> {
    let m = places.len();
    // Least sum up to each place, the last point on it or before; and on which it is then.
    let mut least = vec![0.0; m];
    let mut chosen: Vec<Vec<u32>> = Vec::with_capacity(points.len());
    for (k, p) in points.iter().enumerate() {
        let mut now = vec![f64::INFINITY; m];
        let mut on = vec![0u32; m];
        for j in k + 1..m {
            let here = least[j - 1] + (p - places[j]).norm();
            (now[j], on[j]) = if here < now[j - 1] { (here, j as u32) } else { (now[j - 1], on[j - 1]) };
        }
        least = now;
        chosen.push(on);
    }
    let mut end = m;
    let mut found: Vec<usize> = chosen
        .iter()
        .rev()
        .map(|on| {
            end = on[end - 1] as usize;
            end
        })
        .collect();
    found.reverse();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    fn chart(nu: u32, nv: u32, is_tube: bool) -> (Patch, Chart) {
        let patch = whole(&grid(nu, nv, is_tube, false)).expect("a primitive");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        (patch, chart)
    }

    #[test]
    fn vertices_that_end_beside_the_border_are_put_onto_it_in_order() {
        let (part, _) = chart(6, 6, false);
        let (_, input) = chart(15, 15, false);
        // Shrunk, so that the border ends inside, and shaken out of order along one side.
        let mut points: Vec<Vec3> = part
            .mesh
            .positions
            .iter()
            .map(|p| Vec3::new(0.5, 0.5, 0.0) + (p - Vec3::new(0.5, 0.5, 0.0)) * 0.93)
            .collect();
        points.iter_mut().filter(|p| p.y < 0.1 && p.x > 0.3 && p.x < 0.4).for_each(|p| p.x += 0.25);
        let cross = placed(&part, &points, &input, &Bvh::new(&input.mesh), 1.0).expect("one loop each");
        let on_border = |p: &Vec3| p.x.min(p.y).min(1.0 - p.x).min(1.0 - p.y).abs() < 1e-9;
        for (v, is_border) in part.mesh.boundary_vertices().into_iter().enumerate() {
            assert_eq!(on_border(&cross.positions[v]), is_border, "{v}");
            assert!((cross.locations[v].point(&input) - cross.positions[v]).norm() < 1e-12);
            assert!(is_border || (cross.positions[v] - points[v]).norm() < 1e-9);
        }
        let ring: Vec<u32> = part.mesh.boundary_loops().remove(0).iter().map(|&h| part.mesh.tail(h)).collect();
        let angle = |v: u32| {
            let p = cross.positions[v as usize] - Vec3::new(0.5, 0.5, 0.0);
            p.y.atan2(p.x)
        };
        let turns = (0..ring.len()).map(|k| angle(ring[(k + 1) % ring.len()]) - angle(ring[k]));
        let turns: Vec<f64> = turns.map(|d| d.rem_euclid(std::f64::consts::TAU)).collect();
        assert!(turns.iter().all(|d| *d > 0.0 && *d < 1.0), "{turns:?}");
        assert!((turns.iter().sum::<f64>() - std::f64::consts::TAU).abs() < 1e-9);
    }

    #[test]
    fn each_end_of_a_tube_goes_to_its_own_and_a_disc_is_no_tube() {
        let (part, _) = chart(8, 3, true);
        let (disc, _) = chart(4, 4, false);
        let (_, input) = chart(16, 9, true);
        let points: Vec<Vec3> = part.mesh.positions.clone();
        let cross = placed(&part, &points, &input, &Bvh::new(&input.mesh), 1.0).expect("two loops each");
        for (p, q) in points.iter().zip(&cross.positions) {
            assert!((p - q).norm() < 0.12, "{p} {q}");
        }
        assert!(placed(&disc, &disc.mesh.positions, &input, &Bvh::new(&input.mesh), 1.0).is_none());
    }

    #[test]
    fn a_point_across_a_narrow_place_does_not_take_the_others_along() {
        let line = |xs: &[f64]| -> Vec<Vec3> { xs.iter().map(|&x| Vec3::new(x, 0.0, 0.0)).collect() };
        let places = line(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
        assert_eq!(least_in_order(&line(&[1.0, 2.2, 4.0]), &places), [1, 2, 4]);
        // The second lies nearest to the seventh place, and has to stay between its neighbours.
        assert_eq!(least_in_order(&line(&[1.0, 7.0, 3.0, 4.0]), &places), [1, 2, 3, 4]);
        assert_eq!(least_in_order(&line(&[9.0, 9.0, 9.0]), &places), [6, 7, 8]);
        assert!(least_in_order(&[], &places).is_empty());
    }
}
