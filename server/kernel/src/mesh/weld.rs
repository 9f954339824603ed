//! Points that coincide.

use super::{Polygons, Vec3};
use std::collections::HashMap;

/// For each point, the first one with the same coordinates (−0 is 0).
pub(super) fn equal_points(points: &[Vec3]) -> Vec<u32> {
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(points.len());
    let bits = |p: &Vec3| [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits());
    points.iter().enumerate().map(|(k, p)| *first.entry(bits(p)).or_insert(k as u32)).collect()
}

/// For each point, an earlier one within `tolerance` that stands for itself, or the point itself.
pub(super) fn near_points(points: &[Vec3], tolerance: f64) -> Vec<u32> {
    if tolerance <= 0.0 {
        return equal_points(points);
    }
    // Points that stand for themselves are at least `tolerance` apart, so that a cell holds only a few.
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::with_capacity(points.len());
    let Some(origin) = points.first() else { return Vec::new() };
    let cell = |p: &Vec3, d: f64| {
        let p = p - origin;
        [p.x, p.y, p.z].map(|x| ((x + d) / (4.0 * tolerance)).floor() as i64)
    };
    let mut class_of = Vec::with_capacity(points.len());
    for (k, p) in points.iter().enumerate() {
        let (low, high) = (cell(p, -tolerance), cell(p, tolerance));
        let mut found = None;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let near = cells.get(&[x, y, z]).into_iter().flatten();
                    let near = near.filter(|q| (points[**q as usize] - p).norm() <= tolerance);
                    found = found.into_iter().chain(near.copied()).min();
                }
            }
        }
        let class = found.unwrap_or(k as u32);
        if class == k as u32 {
            cells.entry(cell(p, 0.0)).or_default().push(class);
        }
        class_of.push(class);
    }
    class_of
}

/// Joins equal points of a soup, numbered by first use in the points' order, unless that makes an edge with more than two
/// faces: the points at such edges stay apart. Returns for each point its vertex, and for each vertex its first point.
pub(super) fn weld(points: &[Vec3], faces: &Polygons) -> (Vec<u32>, Vec<u32>) {
    const ROUNDS_MAX: usize = 6;
    let mut class_of = equal_points(points);
    for round in 0.. {
        let apart = crowded(&class_of, faces);
        if apart.iter().all(|apart| !apart) {
            break;
        }
        let mut changed = false;
        for k in 0..class_of.len() {
            if (apart[class_of[k] as usize] || round >= ROUNDS_MAX) && class_of[k] != k as u32 {
                class_of[k] = k as u32;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    let (mut vertex_of, mut first) = (vec![0; points.len()], Vec::new());
    for k in 0..points.len() {
        if class_of[k] == k as u32 {
            vertex_of[k] = first.len() as u32;
            first.push(k as u32);
        } else {
            vertex_of[k] = vertex_of[class_of[k] as usize];
        }
    }
    (vertex_of, first)
}

/// Classes at edges with more than two faces.
fn crowded(class_of: &[u32], faces: &Polygons) -> Vec<bool> {
    let mut edges = Vec::with_capacity(faces.corners().len());
    for face in faces.iter() {
        for (a, b) in face.iter().zip(face.iter().cycle().skip(1)) {
            let (a, b) = (class_of[*a as usize], class_of[*b as usize]);
            if a != b {
                edges.push((u64::from(a.min(b)) << 32) | u64::from(a.max(b)));
            }
        }
    }
    edges.sort_unstable();
    let mut crowded = vec![false; class_of.len()];
    for three in edges.windows(3).filter(|three| three[0] == three[2]) {
        crowded[(three[0] >> 32) as usize] = true;
        crowded[three[0] as u32 as usize] = true;
    }
    crowded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signed_zeros_are_equal() {
        let points = [Vec3::new(0.0, 1.0, 2.0), Vec3::new(-0.0, 1.0, 2.0), Vec3::new(1.0, 1.0, 2.0)];
        assert_eq!(equal_points(&points), [0, 0, 2]);
    }

    #[test]
    fn near_points_join_across_cells_and_do_not_chain() {
        let points: Vec<Vec3> = [0.0, 0.39, 0.41, 0.45, 0.8, -0.05].map(|x| Vec3::new(x, 0.0, 0.0)).into();
        assert_eq!(near_points(&points, 0.1), [0, 1, 1, 1, 4, 0]);
    }

    #[test]
    fn a_million_points_in_one_place_are_no_trouble() {
        let points = vec![Vec3::new(1.0, 2.0, 3.0); 1_000_000];
        assert!(near_points(&points, 1e-3).iter().all(|class| *class == 0));
    }

    #[test]
    fn points_at_an_edge_of_three_faces_stay_apart() {
        let at = |x: f64, y: f64, z: f64| Vec3::new(x, y, z);
        let edge = [at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0)];
        let points: Vec<Vec3> = [at(0.0, 1.0, 0.0), at(0.0, 0.0, 1.0), at(0.0, -1.0, 0.0)]
            .iter()
            .flat_map(|tip| [edge[0], edge[1], *tip])
            .collect();
        let faces: Polygons = [[0, 1, 2].as_slice(), &[3, 4, 5], &[6, 7, 8]].into_iter().collect();
        assert_eq!(weld(&points, &faces).1.len(), 9);
        let two: Polygons = [[0, 1, 2].as_slice(), &[3, 4, 5]].into_iter().collect();
        assert_eq!(weld(&points[..6], &two).1.len(), 4);
    }
}
