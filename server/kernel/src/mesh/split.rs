//! Splitting triangles at vertices put on their edges.

use super::tri::{NONE, TriMesh};

/// The triangles that replace triangle `t` when the halfedges with a vertex `on` them ([`NONE`] elsewhere) are split
/// there. With two of them a quad a b p q is left beside the corner c, p on bc and q on ca; `along_first` is told
/// `[a, b, c]` and `[p, q]`, and says whether to cut it from a to p instead of from b to q.
pub fn pieces(mesh: &TriMesh, t: u32, on: &[u32], along_first: impl Fn([u32; 3], [u32; 2]) -> bool) -> Vec<[u32; 3]> {
    let m = [0, 1, 2].map(|k| on[(3 * t + k) as usize]);
    let v = mesh.triangles[t as usize];
    match m.iter().filter(|&&x| x != NONE).count() {
        0 => vec![v],
        1 => {
            let k = m.iter().position(|&x| x != NONE).unwrap_or(0);
            let (a, b, c) = (v[k], v[(k + 1) % 3], v[(k + 2) % 3]);
            vec![[a, m[k], c], [m[k], b, c]]
        }
        2 => {
            // k: the edge that stays whole.
            let k = m.iter().position(|&x| x == NONE).unwrap_or(0);
            let (a, b, c) = (v[k], v[(k + 1) % 3], v[(k + 2) % 3]);
            let (p, q) = (m[(k + 1) % 3], m[(k + 2) % 3]);
            match along_first([a, b, c], [p, q]) {
                true => vec![[q, p, c], [a, b, p], [a, p, q]],
                false => vec![[q, p, c], [a, b, q], [b, p, q]],
            }
        }
        _ => vec![[v[0], m[0], m[2]], [m[0], v[1], m[1]], [m[2], m[1], v[2]], [m[0], m[1], m[2]]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;

    #[test]
    fn pieces_cover_the_triangle_whatever_is_split() {
        let corners = [Vec3::zeros(), Vec3::x(), Vec3::y()];
        let points = [0, 1, 2].map(|k| (corners[k] + corners[(k + 1) % 3]) / 2.0);
        let positions = [corners, points].concat();
        let mesh = TriMesh::from_triangles(positions.clone(), vec![[0, 1, 2]]).expect("manifold");
        for split in 0..8u32 {
            let on: Vec<u32> = (0..3).map(|k| if split >> k & 1 == 1 { 3 + k } else { NONE }).collect();
            for first in [true, false] {
                let area = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(|v| positions[v as usize]);
                    0.5 * (b - a).cross(&(c - a)).z
                };
                let pieces = pieces(&mesh, 0, &on, |_, _| first);
                assert!(pieces.iter().all(|t| area(t) > 0.0) && pieces.len() == 1 + split.count_ones() as usize);
                assert!((pieces.iter().map(area).sum::<f64>() - 0.5).abs() < 1e-12);
            }
        }
    }
}
