//! Curvature at the vertices of a mesh, averaged over their neighbourhoods, and how much smaller quads are where it is large.
//!
//! With β_e the angle at edge e, |e| its length and e its direction as a complex number in the plane of a vertex, about an
//! area A: κ₁ + κ₂ = Σ β|e| / A, and (κ₁ − κ₂) e^{2iθ} = Σ β|e| e² / A, θ a direction of curvature. *Source:* Cohen-Steiner,
//! Morvan, *Restricted Delaunay triangulations and normal cycle* (2003). *Ours, not the paper's:* quads have edges of at
//! most the radius of curvature, so that a limb has six of them around it, but no less than a share of the others'.

use super::cross::edges;
use super::plane::{Complex, Planes};
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;

/// Rounds in which the curvature that makes quads smaller is averaged: a crease, which is narrow, counts little. *Untuned.*
const SIZE_ROUNDS: usize = 16;
/// Rounds in which sizes are evened out: *untuned*.
const EVEN_ROUNDS: usize = 8;
/// Quads have edges shorter by this factor at most: *untuned*.
const FINER_MAX: f64 = 2.5;

/// Curvature at a vertex.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Curvature {
    /// κ₁ + κ₂.
    pub(super) sum: f64,
    /// (κ₁ − κ₂) e^{2iθ}.
    pub(super) difference: Complex,
}

/// Curvature at each vertex, averaged in some rounds.
pub(super) fn curvature(mesh: &TriMesh, planes: &Planes, transport: &[f64], rounds: usize) -> Vec<Curvature> {
    let n = mesh.positions.len();
    let (mut of, mut area) = (vec![Curvature::default(); n], vec![0.0; n]);
    for t in 0..mesh.triangles.len() {
        mesh.triangles[t].iter().for_each(|&v| area[v as usize] += mesh.area(t) / 3.0);
    }
    for e in edges(mesh).filter(|&e| mesh.twin(e) != NONE) {
        let (i, j) = (mesh.tail(e), mesh.head(e));
        let along = mesh.positions[j as usize] - mesh.positions[i as usize];
        let [left, right] = [e, mesh.twin(e)].map(|h| mesh.area_vector(h as usize / 3));
        let bend = left.cross(&right).dot(&along).atan2(left.dot(&right) * along.norm());
        for v in [i, j] {
            // Half of the edge belongs to each end.
            let (flat, weight) = (planes.flat(v, along).unit(), 0.5 * bend * along.norm());
            let at = &mut of[v as usize];
            *at = Curvature { sum: at.sum + weight, difference: at.difference + flat * flat * weight };
        }
    }
    for _ in 0..rounds {
        stop::ask();
        let (mut sums, mut areas) = (of.clone(), area.clone());
        let mut add = |to: usize, from: usize, r: Complex| {
            sums[to].sum += of[from].sum;
            sums[to].difference = sums[to].difference + r * of[from].difference;
            areas[to] += area[from];
        };
        for e in edges(mesh) {
            let (i, j) = (mesh.tail(e) as usize, mesh.head(e) as usize);
            let r = Complex::from_angle(2.0 * transport[e as usize]);
            add(i, j, r);
            add(j, i, r.conj());
        }
        // Divided by about the valence, so that numbers stay of one size.
        of = sums.into_iter().map(|s| Curvature { sum: s.sum / 7.0, difference: s.difference * (1.0 / 7.0) }).collect();
        area = areas.into_iter().map(|a| a / 7.0).collect();
    }
    let per_area = |(c, a): (&Curvature, &f64)| {
        let share = 1.0 / a.max(f64::MIN_POSITIVE);
        Curvature { sum: c.sum * share, difference: c.difference * share }
    };
    of.iter().zip(&area).map(per_area).collect()
}

/// For each vertex the factor, at least 1, by which edges of quads of length `h` are to be shorter there.
pub(super) fn finer(mesh: &TriMesh, planes: &Planes, h: f64) -> Vec<f64> {
    let transport: Vec<f64> = (0..mesh.twins.len() as u32).map(|e| planes.transport(mesh, e)).collect();
    let largest = |c: &Curvature| 0.5 * (c.sum.abs() + c.difference.norm());
    let mut factor: Vec<f64> = curvature(mesh, planes, &transport, SIZE_ROUNDS)
        .iter()
        .map(|c| (h * largest(c)).clamp(1.0, FINER_MAX).ln())
        .collect();
    for _ in 0..EVEN_ROUNDS {
        let mut sums: Vec<(f64, f64)> = factor.iter().map(|f| (*f, 1.0)).collect();
        for e in edges(mesh) {
            let (i, j) = (mesh.tail(e) as usize, mesh.head(e) as usize);
            sums[i] = (sums[i].0 + factor[j], sums[i].1 + 1.0);
            sums[j] = (sums[j].0 + factor[i], sums[j].1 + 1.0);
        }
        factor = sums.into_iter().map(|(sum, count)| sum / count).collect();
    }
    factor.into_iter().map(f64::exp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_tube_bends_by_its_radius_and_has_six_quads_around_it() {
        // A torus with radii 2 and 1: outside κ₁ = 1 and κ₂ = 1/3, inside 1 and −1.
        let mesh = grid(96, 48, true, true);
        let planes = Planes::new(&mesh);
        let transport: Vec<f64> = (0..mesh.twins.len() as u32).map(|e| planes.transport(&mesh, e)).collect();
        let of = curvature(&mesh, &planes, &transport, 2);
        for (c, p) in of.iter().zip(&mesh.positions) {
            let around = (p.x.hypot(p.y) - 2.0) / p.x.hypot(p.y);
            assert!((c.sum - (1.0 + around)).abs() < 0.1, "{} {}", c.sum, 1.0 + around);
            assert!((c.difference.norm() - (1.0 - around)).abs() < 0.1);
        }
        assert!(finer(&mesh, &planes, 0.5).iter().all(|f| (f - 1.0).abs() < 1e-9));
        assert!(finer(&mesh, &planes, 2.0).iter().all(|f| (1.8..2.5).contains(f)));
    }
}
