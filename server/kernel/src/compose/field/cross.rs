//! A cross at each vertex, smooth over the surface, along its creases, boundaries and directions of curvature.
//!
//! With z_i = e^{4iθ_i} for a cross at angle θ_i in the tangent plane of vertex i, and φ_ij the angle by which the tangent
//! plane of j is turned when it is laid on that of i:
//!
//! E(z) = Σ_ij w_ij |z_i − e^{4iφ_ij} z_j|² + Σ_i s_i |z_i − q_i|²
//!
//! q_i is the cross of a line, or of the curvature, with strength s_i. *Source:* Knöppel, Crane, Pinkall, Schröder,
//! *Globally optimal direction fields* (2013), §4 and 6.1; renormalised between solves as in Viertel, Osting, *An approach
//! to quad meshing based on harmonic cross-valued maps* (2019), §3. *Ours, not the paper's:* the strength by curvature.

use super::curvature::curvature;
use super::plane::{Complex, Planes};
use crate::mesh::tri::{NONE, TriMesh, next, prev};
use crate::numerics::sparse::Pattern;
use std::f64::consts::FRAC_PI_2;

/// Strength of a line against the smoothness of one edge.
const LINE_STRENGTH: f64 = 1e3;
/// Strength of curvature where it is as different in its directions as 1/h: *untuned*.
const CURVATURE_STRENGTH: f64 = 0.1;
/// Rounds in which curvature is averaged over neighbours: some edges of the quads: *untuned*.
const CURVATURE_ROUNDS: usize = 6;
/// Strength that holds the field at its last values, against the smoothness of one edge: first next to nothing, so that the whole comes
/// to agree, then over some two edges of the quads: *untuned*.
const HOLDS: [(f64, usize); 2] = [(1e-5, 4), (2e-2, 4)];

/// The field.
#[derive(Clone, Debug)]
pub(super) struct CrossField {
    /// Angle of one direction of the cross at each vertex, in its plane.
    pub(super) angle: Vec<f64>,
    /// For halfedge i → j: by how many quarters the frame of j is turned against that of i.
    pub(super) turn: Vec<u8>,
}

/// The smoothest field on a mesh of even triangles, for quads with edges of length `h`; `None` where it can't be solved.
pub(super) fn cross_field(mesh: &TriMesh, planes: &Planes, sharp: &[u32], h: f64) -> Option<CrossField> {
    let n = mesh.positions.len();
    let transport: Vec<f64> = (0..mesh.twins.len() as u32).map(|e| planes.transport(mesh, e)).collect();
    let (wish, strength) = wishes(mesh, planes, &transport, sharp, h);
    let pairs = edges(mesh).flat_map(|e| {
        let (i, j) = (2 * mesh.tail(e), 2 * mesh.head(e));
        [(i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)]
    });
    let pattern = Pattern::new(2 * n, pairs).ok()?;
    let mut z: Vec<Complex> =
        wish.iter().zip(&strength).map(|(q, s)| *q * s.min(1.0) + Complex::new(1e-3, 0.0)).collect();
    for (hold, rounds) in HOLDS {
        let mut diagonal = vec![0.0; 2 * n];
        let mut entries = Vec::new();
        for (i, s) in strength.iter().enumerate() {
            diagonal[2 * i] += s + hold;
            diagonal[2 * i + 1] += s + hold;
        }
        for e in edges(mesh) {
            let (i, j) = (2 * mesh.tail(e), 2 * mesh.head(e));
            for v in [i, i + 1, j, j + 1] {
                diagonal[v as usize] += 1.0;
            }
            // −(a b; −b a)ᵀ z_j in the row of z_i.
            let r = Complex::from_angle(4.0 * transport[e as usize]);
            entries.extend([(i, j, -r.re), (i, j + 1, r.im), (i + 1, j, -r.im), (i + 1, j + 1, -r.re)]);
        }
        let factored = pattern.factor(&diagonal, entries.into_iter(), &vec![false; 2 * n]).ok()?;
        let is_last = hold == HOLDS[HOLDS.len() - 1].0;
        for _ in 0..rounds {
            let norm = (z.iter().map(|z| z.norm_squared()).sum::<f64>() / n as f64).sqrt().max(f64::MIN_POSITIVE);
            let mut x = vec![0.0; 2 * n];
            for i in 0..n {
                let held = if is_last { z[i].unit() } else { z[i] * norm.recip() };
                let b = wish[i] * strength[i] + held * hold;
                (x[2 * i], x[2 * i + 1]) = (b.re, b.im);
            }
            factored.solve(&mut x);
            z = (0..n).map(|i| Complex::new(x[2 * i], x[2 * i + 1])).collect();
        }
    }
    let angle: Vec<f64> = z.iter().map(|z| z.angle() / 4.0).collect();
    Some(CrossField { turn: turns(mesh, &transport, &angle), angle })
}

/// One halfedge of each edge.
pub(super) fn edges(mesh: &TriMesh) -> impl Iterator<Item = u32> + Clone {
    (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE || h < mesh.twin(h))
}

fn turns(mesh: &TriMesh, transport: &[f64], angle: &[f64]) -> Vec<u8> {
    let mut turn = vec![0u8; mesh.twins.len()];
    for e in edges(mesh) {
        let (i, j) = (mesh.tail(e) as usize, mesh.head(e) as usize);
        let quarters = ((transport[e as usize] + angle[j] - angle[i]) / FRAC_PI_2).round() as i64;
        turn[e as usize] = quarters.rem_euclid(4) as u8;
        if mesh.twin(e) != NONE {
            turn[mesh.twin(e) as usize] = (-quarters).rem_euclid(4) as u8;
        }
    }
    turn
}

/// The cross that each vertex is to have, and how strongly.
fn wishes(mesh: &TriMesh, planes: &Planes, transport: &[f64], sharp: &[u32], h: f64) -> (Vec<Complex>, Vec<f64>) {
    let curvature: Vec<Complex> =
        curvature(mesh, planes, transport, CURVATURE_ROUNDS).into_iter().map(|c| c.difference).collect();
    let mut wish: Vec<Complex> = curvature.iter().map(|c| (*c * *c).unit()).collect();
    let mut strength: Vec<f64> =
        curvature.iter().map(|c| CURVATURE_STRENGTH * (c.norm_squared() * h * h).min(1.0)).collect();
    let mut lines = vec![Complex::default(); wish.len()];
    let border = (0..mesh.twins.len() as u32).filter(|&e| mesh.twin(e) == NONE);
    for e in border.chain(sharp.iter().copied()) {
        for v in [mesh.tail(e), mesh.head(e)] {
            let along = planes.flat(v, mesh.positions[mesh.head(e) as usize] - mesh.positions[mesh.tail(e) as usize]);
            lines[v as usize] = lines[v as usize] + Complex::from_angle(4.0 * along.angle());
        }
    }
    for (v, line) in lines.into_iter().enumerate().filter(|(_, line)| line.norm_squared() > 1e-12) {
        (wish[v], strength[v]) = (line.unit(), LINE_STRENGTH);
    }
    (wish, strength)
}

/// By how many quarters the field turns around each triangle: 0 where it is regular.
pub(super) fn indices(mesh: &TriMesh, turn: &[u8]) -> Vec<u8> {
    (0..mesh.triangles.len()).map(|t| (turn[3 * t] + turn[3 * t + 1] + turn[3 * t + 2]) % 4).collect()
}

/// The halfedges of a triangle from one on.
pub(super) fn from(h: u32) -> [u32; 3] {
    [h, next(h), prev(h)]
}

#[cfg(test)]
mod tests {
    use super::super::remesh::remesh;
    use super::*;
    use crate::mesh::Vec3;
    use crate::mesh::bvh::Bvh;
    use crate::topology::tests::grid;

    #[test]
    fn on_a_torus_the_field_follows_the_curvature_and_has_no_singularity() {
        let torus = grid(60, 30, true, true);
        let mesh = remesh((&torus, &Bvh::new(&torus)), &[], 0.15, 100_000).expect("not too large").mesh;
        let planes = Planes::new(&mesh);
        let field = cross_field(&mesh, &planes, &[], 0.3).expect("it is solved");
        assert!(indices(&mesh, &field.turn).iter().all(|&k| k == 0));
        for (v, p) in mesh.positions.iter().enumerate() {
            let around = planes.flat(v as u32, Vec3::new(-p.y, p.x, 0.0)).angle();
            let off = (field.angle[v] - around).rem_euclid(FRAC_PI_2);
            assert!(off.min(FRAC_PI_2 - off) < 0.2, "{v}: {off}");
        }
    }

    #[test]
    fn on_a_square_it_runs_along_the_sides() {
        let mesh = grid(12, 12, false, false);
        let planes = Planes::new(&mesh);
        let field = cross_field(&mesh, &planes, &[], 0.2).expect("it is solved");
        assert!(indices(&mesh, &field.turn).iter().all(|&k| k == 0));
        for v in 0..mesh.positions.len() {
            let off = (field.angle[v] - planes.flat(v as u32, Vec3::x()).angle()).rem_euclid(FRAC_PI_2);
            assert!(off.min(FRAC_PI_2 - off) < 1e-3, "{v}: {off}");
        }
    }
}
