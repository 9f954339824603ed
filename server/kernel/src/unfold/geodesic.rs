//! Geodesic distances along a triangle mesh, true to the surface and not to its edges.
//!
//! Fast marching: vertices are settled nearest first; a triangle with two settled corners tells the third its distance
//! to the virtual source that its plane sees beyond the two. Exact on planes and developable surfaces until the front
//! meets an obtuse angle. *Source:* Kimmel and Sethian, *Computing geodesic paths on manifolds* (1998); the virtual
//! source: Novotni and Klein, *Computing geodesic distances on triangular meshes* (2002).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::mesh::tri::{NONE, TriMesh};

use super::path::for_each_spoke;

/// Distance of each vertex from the nearest source; infinite where none can be reached.
pub fn geodesics(mesh: &TriMesh, sources: &[u32]) -> Vec<f64> {
    let mut distance = vec![f64::INFINITY; mesh.positions.len()];
    let mut settled = vec![false; distance.len()];
    let out = mesh.outgoing();
    let mut heap = BinaryHeap::new();
    for &s in sources {
        distance[s as usize] = 0.0;
        heap.push(Reverse((0u64, s)));
    }
    while let Some(Reverse((_, v))) = heap.pop() {
        if std::mem::replace(&mut settled[v as usize], true) || out[v as usize] == NONE {
            continue;
        }
        let mut told: Vec<(u32, f64)> = Vec::new();
        for_each_spoke(mesh, out[v as usize], |h, w| {
            told.push((w, distance[v as usize] + edge(mesh, v, w)));
            // The triangles on both sides of the edge, each seen from it.
            for side in [h, mesh.twin(h)] {
                if side != NONE && settled[w as usize] {
                    let c = opposite(mesh, side);
                    told.push((c, through(mesh, [v, w, c], [distance[v as usize], distance[w as usize]])));
                }
            }
        });
        for (w, d) in told {
            if !settled[w as usize] && d < distance[w as usize] {
                distance[w as usize] = d;
                // Positive finite floats order like their bits.
                heap.push(Reverse((d.to_bits(), w)));
            }
        }
    }
    distance
}

fn edge(mesh: &TriMesh, a: u32, b: u32) -> f64 {
    (mesh.positions[a as usize] - mesh.positions[b as usize]).norm()
}

/// The corner of a halfedge's triangle that the halfedge does not touch.
fn opposite(mesh: &TriMesh, h: u32) -> u32 {
    mesh.triangles[h as usize / 3][(h as usize + 2) % 3]
}

/// Distance of corner c by the triangle (a, b, c), given those of a and b: straight from the virtual source if that line
/// crosses the edge a b, else along an edge.
fn through(mesh: &TriMesh, [a, b, c]: [u32; 3], [da, db]: [f64; 2]) -> f64 {
    let (ab, ac, bc) = (edge(mesh, a, b), edge(mesh, a, c), edge(mesh, b, c));
    let along = (da + ac).min(db + bc);
    // a at the origin, b at (ab, 0), c above, the source below.
    let source_x = (da * da - db * db + ab * ab) / (2.0 * ab);
    let below = da * da - source_x * source_x;
    let c_x = (ac * ac - bc * bc + ab * ab) / (2.0 * ab);
    let above = ac * ac - c_x * c_x;
    if !(ab > 0.0 && below >= 0.0 && above > 0.0) {
        return along;
    }
    let (below, above) = (below.sqrt(), above.sqrt());
    let crossing = source_x + (c_x - source_x) * below / (below + above);
    if (0.0..=ab).contains(&crossing) { (c_x - source_x).hypot(above + below).max(da.max(db)) } else { along }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::tests::grid;

    #[test]
    fn on_a_plane_distances_are_euclidean() {
        let mesh = grid(40, 40, false, false);
        let source = 20 * 41 + 13;
        let origin = mesh.positions[source as usize];
        let worst = geodesics(&mesh, &[source])
            .iter()
            .zip(&mesh.positions)
            .map(|(d, p)| (d - (p - origin).norm()).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.004, "off by {worst}");
    }

    #[test]
    fn bending_does_not_change_distances() {
        let flat = grid(40, 40, false, false);
        let mut bent = flat.clone();
        for p in &mut bent.positions {
            let angle = 3.0 * p.x;
            *p = Vec3::new(angle.sin() / 3.0, p.y, angle.cos() / 3.0);
        }
        let (one, two) = (geodesics(&flat, &[5]), geodesics(&bent, &[5]));
        let worst = one.iter().zip(&two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 0.006, "off by {worst}");
    }
}
