//! Moving some vertices of a map, and what is around them along.
//!
//! The displacement d of the moved vertices is continued over some rings, d_v = mean of the neighbours' R d_w, R the
//! rotation that takes the input's normal at w to that at v, so that what moves across an edge goes on down the other
//! side. 0 beyond. Then each vertex walks its d along the surface.

use super::{CrossMap, Targets};
use crate::map::untangle::normal_at;
use crate::map::walk::walk;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::unfold::Chart;

/// Rings that move along.
const RINGS: usize = 4;
/// Sweeps of the continuation.
const SWEEPS: usize = 12;
/// A triangle may not become smaller than this share of its area.
const COLLAPSE: f64 = 0.03;

/// The map with its vertices at their targets, and those within some rings moved along.
pub fn spread(mesh: &TriMesh, cross: &CrossMap, input: &Chart, targets: &Targets) -> CrossMap {
    let mut out = cross.clone();
    let mut moves = vec![Vec3::zeros(); mesh.positions.len()];
    for (&v, place) in targets {
        moves[v as usize] = place.point(input) - cross.positions[v as usize];
        out.locations[v as usize] = *place;
        out.positions[v as usize] = place.point(input);
    }
    let mut reached: Vec<bool> = (0..mesh.positions.len() as u32).map(|v| targets.contains_key(&v)).collect();
    grow(mesh, &mut reached, RINGS);
    let fixed = mesh.boundary_vertices();
    let free = |v: &u32| reached[*v as usize] && !fixed[*v as usize] && !targets.contains_key(v);
    let free: Vec<u32> = (0..mesh.positions.len() as u32).filter(free).collect();
    let around = neighbours(mesh, &free);
    for _ in 0..SWEEPS {
        for (&v, around) in free.iter().zip(&around) {
            let to = normal_at(input, cross.locations[v as usize]);
            let carried = |&w: &u32| turned(moves[w as usize], normal_at(input, cross.locations[w as usize]), to);
            moves[v as usize] = around.iter().map(carried).sum::<Vec3>() / around.len().max(1) as f64;
        }
    }
    for &v in free.iter().filter(|v| moves[**v as usize] != Vec3::zeros()) {
        let place = walk(&input.mesh, cross.locations[v as usize], moves[v as usize]);
        (out.locations[v as usize], out.positions[v as usize]) = (place, place.point(input));
    }
    out
}

/// Vertices within some rings of some polygons (sorted).
pub fn near(mesh: &TriMesh, polygons: &[u32], rings: usize) -> Vec<bool> {
    let mut near = vec![false; mesh.positions.len()];
    for (corners, _) in mesh.triangles.iter().zip(&mesh.polygon_of).filter(|(_, f)| polygons.binary_search(f).is_ok()) {
        corners.iter().for_each(|&v| near[v as usize] = true);
    }
    grow(mesh, &mut near, rings);
    near
}

/// Polygons of which a triangle has lost nearly all of its area.
pub fn collapsed(mesh: &TriMesh, before: &CrossMap, after: &CrossMap) -> Vec<u32> {
    let area = |cross: &CrossMap, corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| cross.positions[v as usize]);
        (b - a).cross(&(c - a)).norm()
    };
    let is_less = |t: &usize| area(after, &mesh.triangles[*t]) < COLLAPSE * area(before, &mesh.triangles[*t]);
    (0..mesh.triangles.len()).filter(is_less).map(|t| mesh.polygon_of[t]).collect()
}

fn grow(mesh: &TriMesh, marked: &mut [bool], rings: usize) {
    for _ in 0..rings {
        let touched: Vec<u32> =
            mesh.triangles.iter().filter(|t| t.iter().any(|&v| marked[v as usize])).flatten().copied().collect();
        touched.into_iter().for_each(|v| marked[v as usize] = true);
    }
}

/// Neighbours of some vertices (sorted) along edges.
pub(crate) fn neighbours(mesh: &TriMesh, vertices: &[u32]) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); vertices.len()];
    for t in &mesh.triangles {
        for k in 0..3 {
            if let Ok(i) = vertices.binary_search(&t[k]) {
                around[i].extend([t[(k + 1) % 3], t[(k + 2) % 3]]);
            }
        }
    }
    for list in &mut around {
        list.sort_unstable();
        list.dedup();
    }
    around
}

/// `d` turned by the least rotation that takes unit vector `from` to `to`.
pub(crate) fn turned(d: Vec3, from: Vec3, to: Vec3) -> Vec3 {
    let (axis, cos) = (from.cross(&to), from.dot(&to));
    if cos <= -0.999 {
        return d;
    }
    // Rodrigues, with sin² / (1 + cos) in place of 1 − cos.
    d * cos + axis.cross(&d) + axis * (axis.dot(&d) / (1.0 + cos))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_takes_one_normal_to_the_other_and_keeps_lengths() {
        let (from, to) = (Vec3::new(0.0, 0.6, 0.8), Vec3::new(1.0, 0.0, 0.0));
        let d = Vec3::new(0.3, -0.2, 0.9);
        assert!((turned(from, from, to) - to).norm() < 1e-12);
        assert!((turned(d, from, to).norm() - d.norm()).abs() < 1e-12);
    }
}
