//! u along the boundary: the flux of v through it.
//!
//! ∇u = R∇v/P, so that along the boundary u grows by ∂v/∂n ds / P. On the intrinsic Delaunay triangulation the flux
//! through a boundary vertex is f_i = |Σ_j w_ij (v_j − v_i)|; all w_ij ≥ 0 and v is constant on the loop, so that no f_i
//! turns back, and Σ f_i = P: u grows by (f_i + f_{i+1})/2P from one vertex to the next. With that given inside holds
//! what Tutte's theorem asks for: every inner vertex is a convex combination of its neighbours, and no intrinsic triangle
//! turns over, however ragged the boundary is. *Source:* METHOD §2 (u as the conjugate); Floater, *One-to-one piecewise
//! linear mappings over triangulations* (2003). *Ours, not the paper's:* u left free on the boundary runs backwards where
//! a scan's boundary is ragged.

use super::intrinsic::Intrinsic;
use super::laplacian::Laplacian;
use crate::mesh::tri::NONE;

/// u on the boundary, by vertex. Each loop begins at an arbitrary u; `None` where there is no boundary, or nothing flows
/// through a loop. `jumps` are those of the intrinsic halfedges.
pub fn flux(laplacian: &Laplacian, v: &[f64], jumps: &[i32]) -> Option<Vec<(u32, f64)>> {
    let t = &laplacian.triangulation;
    let mut through = vec![0.0; v.len()];
    for (h, w) in laplacian.half_weights.iter().enumerate() {
        let (a, b) = (t.tails[h] as usize, t.head(h as u32) as usize);
        let flow = w * (v[b] - v[a]);
        through[a] += flow;
        through[b] -= flow;
    }
    let mut rim = Vec::new();
    for ring in rings(t, v.len()) {
        let total: f64 = ring.iter().map(|&h| through[t.tails[h as usize] as usize]).sum();
        let period: f64 = ring.iter().map(|&h| -f64::from(jumps[h as usize])).sum();
        if total == 0.0 || period == 0.0 {
            return None;
        }
        let mut u = 0.0;
        for &h in &ring {
            let (a, b) = (t.tails[h as usize], t.head(h));
            rim.push((a, u));
            let share = 0.5 * (through[a as usize] + through[b as usize]) / total;
            u += f64::from(jumps[h as usize]) + period * share;
        }
    }
    (!rim.is_empty()).then_some(rim)
}

/// The halfedges of each boundary loop, in order. The surface lies to their left.
fn rings(t: &Intrinsic, vertices: usize) -> Vec<Vec<u32>> {
    let mut leaving = vec![NONE; vertices];
    for h in (0..t.tails.len()).filter(|&h| t.twins[h] == NONE) {
        leaving[t.tails[h] as usize] = h as u32;
    }
    let mut rings = Vec::new();
    for start in 0..vertices {
        let mut ring = Vec::new();
        let mut h = std::mem::replace(&mut leaving[start], NONE);
        while h != NONE {
            ring.push(h);
            h = std::mem::replace(&mut leaving[t.head(h) as usize], NONE);
        }
        if !ring.is_empty() {
            rings.push(ring);
        }
    }
    rings
}

#[cfg(test)]
mod tests {
    use crate::mesh::Vec3;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    /// A sheet whose boundary goes in and out.
    fn ragged(n: u32) -> crate::mesh::TriMesh {
        let mut mesh = grid(n, n, false, false);
        for (v, on) in mesh.boundary_vertices().into_iter().enumerate() {
            let p = mesh.positions[v];
            let out = if on && v % 2 == 0 { 1.4 } else { 0.7 };
            let middle = Vec3::new(0.5, 0.5, 0.0);
            if on {
                mesh.positions[v] = middle + out * (p - middle);
            }
        }
        mesh
    }

    #[test]
    fn u_never_runs_backwards_along_a_ragged_boundary() {
        let patch = whole(&ragged(24)).expect("a disc");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let mut whole_turn = 0.0;
        for h in (0..chart.mesh.twins.len()).filter(|&h| chart.mesh.twin(h as u32) == crate::mesh::tri::NONE) {
            let corners = chart.corners[h / 3];
            let step = corners[(h % 3 + 1) % 3][0] - corners[h % 3][0];
            assert!(step >= 0.0, "u goes back by {step}");
            whole_turn += step;
        }
        assert!((whole_turn - 1.0).abs() < 1e-9, "{whole_turn}");
    }
}
