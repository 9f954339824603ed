//! The cross map ψ* = φ₂⁻¹ ∘ ψ̂ ∘ φ₁ of an example onto the input, its editing, and the mesh it makes.
//!
//! *Source:* paper Eq. 7 and §5.3.

pub mod assemble;
pub mod atlas;
pub mod edit;
pub mod polish;
pub mod untangle;
pub mod walk;

use crate::encode::index::{Location, PlanarIndex};
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::register::Registration;
use crate::unfold::{Chart, Uv, signed_area};

/// Where each vertex of an example's patch goes on the input.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossMap {
    /// The place on the input's chart, one a vertex of the patch.
    pub locations: Vec<Location>,
    /// The same in space.
    pub positions: Vec<Vec3>,
}

/// Maps the vertices of the example's patch. Poles go to poles and boundaries to boundaries, exactly.
pub fn cross_map(registration: &Registration, example: &Chart, input: &Chart, index: &PlanarIndex) -> CrossMap {
    let locations: Vec<Location> = (0..example.patch_vertices)
        .map(|v| index.locate(input, registration.map(example.topology, vertex_uv(example, v))))
        .collect();
    let positions = locations.iter().map(|l| l.point(input)).collect();
    CrossMap { locations, positions }
}

/// Polygons of the example that the map turns over in the domain, beyond those that are turned over there already, in
/// order. `mesh` is the patch that `example` unfolds. Faces at a pole, where u has no meaning, are left out.
pub fn folded_faces(registration: &Registration, example: &Chart, mesh: &TriMesh) -> Vec<u32> {
    let turned = (0..mesh.triangles.len()).filter(|&t| turns_over(registration, example, &mesh.triangles[t]));
    let mut folded: Vec<u32> = turned.map(|t| mesh.polygon_of[t]).collect();
    folded.sort_unstable();
    folded.dedup();
    folded
}

/// Whether the map turns a triangle of the example over in the domain that was not turned over before.
fn turns_over(registration: &Registration, example: &Chart, corners: &[u32; 3]) -> bool {
    if example.poles.iter().any(|p| corners.contains(&p.vertex)) {
        return false;
    }
    let first = example.uv[corners[0] as usize];
    let before = corners.map(|v| {
        let [u, v] = example.uv[v as usize];
        [u - (u - first[0]).round(), v]
    });
    if signed_area(&before) <= 0.0 {
        return false;
    }
    let sign = if registration.flip.is_mirror() { -1.0 } else { 1.0 };
    sign * signed_area(&before.map(|x| registration.map(example.topology, x))) < 0.0
}

/// (u, v) of a vertex, a pole's v made exact.
fn vertex_uv(chart: &Chart, v: usize) -> Uv {
    let pole = chart.poles.iter().find(|p| p.vertex as usize == v);
    let [u, height] = chart.uv[v];
    [u, pole.map_or(height, |p| if p.at_top { 1.0 } else { 0.0 })]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::encode;
    use crate::register::{Entry, LevenbergMarquardt, Query};
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    /// A bumpy sheet: a disc with two unlike hills.
    fn bumpy(n: u32) -> crate::mesh::TriMesh {
        let mut mesh = grid(n, n, false, false);
        for p in &mut mesh.positions {
            let hill = |x: f64, y: f64, s: f64| (-((p.x - x).powi(2) + (p.y - y).powi(2)) / (s * s)).exp();
            p.z = 0.45 * hill(0.35, 0.4, 0.12) + 0.3 * hill(0.7, 0.6, 0.1) + 0.15 * hill(0.6, 0.25, 0.08);
        }
        mesh
    }

    #[test]
    fn a_shape_maps_onto_another_mesh_of_itself() {
        let example = whole(&bumpy(30)).expect("a disc");
        let chart = unfold(&example, &UnfoldOptions::default()).expect("solvable");
        let encoding = encode(&chart);
        let query = Query::new(&whole(&bumpy(43)).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let (solver, never) = (LevenbergMarquardt::default(), || false);
        let mut entry = Entry::coarse(&query, &encoding, &solver, &never).expect("a disc too");
        while entry.side() < 128 {
            entry.advance(&query, &encoding, &solver, &never).expect("solvable");
        }
        let best = entry.best();
        let input = query.chart_for(&best.unfolded.poles).expect("solvable");
        let map = cross_map(&best.registration, &chart, &input, &PlanarIndex::new(&input));
        let mut errors: Vec<f64> =
            map.positions.iter().zip(&example.mesh.positions).map(|(a, b)| (a - b).norm()).collect();
        errors.sort_by(f64::total_cmp);
        assert!(!best.registration.flip.is_mirror());
        assert!(folded_faces(&best.registration, &chart, &example.mesh).is_empty());
        assert!(errors[errors.len() / 2] < 0.01, "median {}", errors[errors.len() / 2]);
        // Boundary on boundary, exactly.
        for (p, on) in map.positions.iter().zip(example.mesh.boundary_vertices()) {
            let off = p.x.min(1.0 - p.x).min(p.y).min(1.0 - p.y);
            assert!(!on || off < 1e-9, "a boundary vertex is {off} inside");
        }
    }
}
