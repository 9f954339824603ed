//! Splitting edges of a triangle mesh at their midpoints, conformingly. New vertices come after the old ones, lie in
//! the old triangles, and so leave the surface as it is.

use std::sync::Arc;

use crate::mesh::split;
use crate::mesh::tri::{NONE, TriMesh, pair_halfedges};

/// Splits the marked edges (by halfedge; either side's mark counts) at their midpoints.
pub fn split_edges(mesh: &TriMesh, marked: &[bool]) -> TriMesh {
    split_edges_telling(mesh, marked).0
}

/// The same, with the two ends of the edge of each new vertex, in their order.
pub fn split_edges_telling(mesh: &TriMesh, marked: &[bool]) -> (TriMesh, Vec<[u32; 2]>) {
    let mut ends = Vec::new();
    let mut out = TriMesh { positions: mesh.positions.clone(), ..TriMesh::default() };
    let mut midpoint = vec![NONE; mesh.twins.len()];
    for h in 0..mesh.twins.len() as u32 {
        let g = mesh.twin(h);
        let wanted = marked[h as usize] || (g != NONE && marked[g as usize]);
        if wanted && (g == NONE || h < g) {
            let middle = 0.5 * (mesh.positions[mesh.tail(h) as usize] + mesh.positions[mesh.head(h) as usize]);
            midpoint[h as usize] = out.positions.len() as u32;
            if g != NONE {
                midpoint[g as usize] = midpoint[h as usize];
            }
            out.positions.push(middle);
            ends.push([mesh.tail(h), mesh.head(h)]);
        }
    }
    for t in 0..mesh.triangles.len() as u32 {
        for triangle in pieces(mesh, t, &midpoint) {
            out.triangles.push(triangle);
            out.polygon_of.push(mesh.polygon_of[t as usize]);
        }
    }
    (finish(out), ends)
}

/// The triangles that replace triangle `t`.
fn pieces(mesh: &TriMesh, t: u32, midpoint: &[u32]) -> Vec<[u32; 3]> {
    let length = |x: u32, y: u32| (mesh.positions[x as usize] - mesh.positions[y as usize]).norm_squared();
    // Along the shorter diagonal: |ap| ≤ |bq| exactly when |ac| ≤ |bc|, as p and q are midpoints.
    split::pieces(mesh, t, midpoint, |[a, b, c], _| length(a, c) <= length(b, c))
}

/// Puts a vertex into the middle of each marked triangle.
pub fn split_triangles(mesh: &TriMesh, marked: impl Fn(u32) -> bool) -> TriMesh {
    let mut out = TriMesh { positions: mesh.positions.clone(), ..TriMesh::default() };
    for t in 0..mesh.triangles.len() as u32 {
        let [a, b, c] = mesh.triangles[t as usize];
        let polygon = mesh.polygon_of[t as usize];
        if marked(t) {
            let m = out.positions.len() as u32;
            let sum = mesh.positions[a as usize] + mesh.positions[b as usize] + mesh.positions[c as usize];
            out.positions.push(sum / 3.0);
            out.triangles.extend([[a, b, m], [b, c, m], [c, a, m]]);
            out.polygon_of.extend([polygon; 3]);
        } else {
            out.triangles.push([a, b, c]);
            out.polygon_of.push(polygon);
        }
    }
    finish(out)
}

/// Splits what Dirichlet conditions would flatten: interior edges that join two boundary vertices, and triangles
/// whose three vertices stay on the boundary. *Source:* METHOD §1 ("before solving").
pub fn split_chords(mesh: Arc<TriMesh>) -> Arc<TriMesh> {
    let on_boundary = mesh.boundary_vertices();
    let both = |h: u32| on_boundary[mesh.tail(h) as usize] && on_boundary[mesh.head(h) as usize];
    let marked: Vec<bool> = (0..mesh.twins.len() as u32).map(|h| mesh.twin(h) != NONE && both(h)).collect();
    let mesh = if marked.contains(&true) { Arc::new(split_edges(&mesh, &marked)) } else { mesh };
    let on_boundary = mesh.boundary_vertices();
    let lone = |t: u32| mesh.triangles[t as usize].iter().all(|&v| on_boundary[v as usize]);
    if (0..mesh.triangles.len() as u32).any(lone) { Arc::new(split_triangles(&mesh, lone)) } else { mesh }
}

fn finish(mut mesh: TriMesh) -> TriMesh {
    // Splitting a manifold mesh conformingly leaves it manifold.
    mesh.twins = pair_halfedges(&mesh.triangles).unwrap_or_else(|_| vec![NONE; 3 * mesh.triangles.len()]);
    mesh.phantom = vec![false; mesh.twins.len()];
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn splitting_keeps_the_area_and_the_topology() {
        let mesh = grid(5, 4, true, false);
        let every_fifth: Vec<bool> = (0..mesh.twins.len()).map(|h| h % 5 == 0).collect();
        let split = split_edges(&mesh, &every_fifth);
        assert!((split.total_area() - mesh.total_area()).abs() < 1e-12);
        assert_eq!(crate::topology::classify(&split), crate::topology::classify(&mesh));
    }

    #[test]
    fn no_chord_is_left() {
        let split = split_chords(Arc::new(grid(1, 1, false, false)));
        let on = split.boundary_vertices();
        for h in 0..split.twins.len() as u32 {
            let chord = split.twin(h) != NONE && on[split.tail(h) as usize] && on[split.head(h) as usize];
            assert!(!chord);
        }
        assert!(split.triangles.iter().all(|t| t.iter().any(|&v| !on[v as usize])));
    }
}
