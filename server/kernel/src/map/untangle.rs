//! Turning faces back that a blended map turned over.
//!
//! Where charts disagree their mean may fold. The vertices of a folded face, and then of its surroundings, move to the
//! mean of their neighbours and back onto the surface, until no face looks inward or the rounds are spent. *Ours.*

use super::CrossMap;
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::unfold::Chart;

/// Rounds at most.
const ROUNDS_MAX: usize = 60;
/// Rounds after which the neighbours of a folded face's vertices move too.
const ROUNDS_ALONE: usize = 15;

/// Untangles a map of `mesh` (the example's patch) onto the mesh of `input`. `mirror` is −1 for mirrored maps, which
/// turn every face. Boundary vertices stay. Returns how many polygons still look inward.
pub fn untangle(mesh: &TriMesh, cross: &mut CrossMap, input: &Chart, mirror: f64) -> usize {
    // Most maps are sound: the tree is built only where there is something to mend.
    if inward(mesh, cross, input, mirror).is_empty() {
        return 0;
    }
    let fixed = mesh.boundary_vertices();
    let bvh = Bvh::new(&input.mesh);
    let neighbours = neighbours(mesh);
    let mut best: Option<(usize, CrossMap)> = None;
    for round in 0..ROUNDS_MAX {
        let folded = inward(mesh, cross, input, mirror);
        if folded.is_empty() {
            return 0;
        }
        if best.as_ref().is_none_or(|(count, _)| folded.len() < *count) {
            best = Some((folded.len(), cross.clone()));
        }
        let mut moving = vec![false; mesh.positions.len()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            if folded.binary_search(&mesh.polygon_of[t]).is_ok() {
                corners.iter().for_each(|&v| moving[v as usize] = true);
            }
        }
        if round >= ROUNDS_ALONE {
            let first = moving.clone();
            for v in (0..first.len()).filter(|&v| first[v]) {
                neighbours[v].iter().for_each(|&w| moving[w as usize] = true);
            }
        }
        let before = cross.positions.clone();
        for v in (0..moving.len()).filter(|&v| moving[v] && !fixed[v] && !neighbours[v].is_empty()) {
            let sum: Vec3 = neighbours[v].iter().map(|&w| before[w as usize]).sum();
            let closest = bvh.closest(sum / neighbours[v].len() as f64);
            if (closest.triangle as usize) < input.mesh.triangles.len() {
                cross.locations[v] = Location { triangle: closest.triangle, barycentric: closest.barycentric };
                cross.positions[v] = closest.point;
            }
        }
    }
    let last = inward(mesh, cross, input, mirror).len();
    match best {
        Some((count, state)) if count < last => {
            *cross = state;
            count
        }
        _ => last,
    }
}

/// Polygons that look into the input, in order.
pub fn inward(mesh: &TriMesh, cross: &CrossMap, input: &Chart, mirror: f64) -> Vec<u32> {
    let count = mesh.polygon_of.iter().max().map_or(0, |&f| f as usize + 1);
    let mut facing = vec![0.0; count];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|v| cross.positions[v as usize]);
        let outward: Vec3 = corners.iter().map(|&v| normal_at(input, cross.locations[v as usize])).sum();
        facing[mesh.polygon_of[t] as usize] += mirror * (b - a).cross(&(c - a)).dot(&outward);
    }
    (0..count as u32).filter(|&f| facing[f as usize] < 0.0).collect()
}

/// Normal of the input's triangle at a place.
fn normal_at(input: &Chart, place: Location) -> Vec3 {
    let [a, b, c] = input.mesh.triangles[place.triangle as usize].map(|v| input.mesh.positions[v as usize]);
    (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
}

/// Neighbours along edges of polygons (phantom edges left out).
fn neighbours(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); mesh.positions.len()];
    for h in (0..mesh.twins.len() as u32).filter(|&h| !mesh.phantom[h as usize]) {
        around[mesh.tail(h) as usize].push(mesh.head(h));
        around[mesh.head(h) as usize].push(mesh.tail(h));
    }
    for list in &mut around {
        list.sort_unstable();
        list.dedup();
    }
    around
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn a_vertex_dragged_over_its_neighbours_comes_back() {
        let mesh = grid(12, 12, false, false);
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let place = |p: Vec3| {
            let c = bvh.closest(p);
            Location { triangle: c.triangle, barycentric: c.barycentric }
        };
        let mut positions = mesh.positions.clone();
        positions[13 * 6 + 6] += Vec3::new(0.2, 0.03, 0.0);
        let mut cross = CrossMap { locations: positions.iter().map(|p| place(*p)).collect(), positions };
        assert!(!inward(&mesh, &cross, &chart, 1.0).is_empty());
        assert_eq!(untangle(&mesh, &mut cross, &chart, 1.0), 0);
    }
}
