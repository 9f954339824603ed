//! A smooth intrinsic function whose maxima are the tips of protrusions.
//!
//! f(x) = ∫ d(x, y) dy / area^{3/2}, the mean geodesic distance to the rest of the surface in units of √area. Along a
//! limb it grows by the share of the surface that lies behind, so that its level sets run around limbs; poses and
//! remeshing leave it as it is. *Source:* Hilaga, Shinagawa, Kohmura and Kunii (2001). The integral is a sum over
//! vertices spread far apart, each with the area nearest to it.

use super::distance::spread;
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::TriMesh;
use crate::numerics::stop;

/// Terms of the sum.
const SAMPLES: usize = 20;
/// Rounds of averaging with the neighbours.
const ROUNDS: usize = 8;

/// f at each vertex of a connected surface.
pub(super) fn centrality(mesh: &TriMesh) -> Vec<f64> {
    let marcher = Marcher::new(mesh);
    let samples = spread(&marcher, SAMPLES);
    let masses = vertex_areas(mesh);
    let mut weights = vec![0.0; samples.len()];
    for (v, mass) in masses.iter().enumerate() {
        let nearest = (0..samples.len()).min_by(|&a, &b| samples[a].1[v].total_cmp(&samples[b].1[v]));
        if let Some(nearest) = nearest {
            weights[nearest] += mass;
        }
    }
    let scale = mesh.total_area().powf(-1.5);
    let mut f = vec![0.0; mesh.positions.len()];
    for ((_, distance), weight) in samples.iter().zip(&weights) {
        f.iter_mut().zip(distance).for_each(|(f, d)| *f += scale * weight * d);
    }
    let neighbours = mesh.neighbours();
    for _ in 0..ROUNDS {
        stop::ask();
        let mean = |v: usize| {
            let around: f64 = neighbours[v].iter().map(|&w| f[w as usize]).sum();
            0.5 * (f[v] + around / neighbours[v].len().max(1) as f64)
        };
        f = (0..f.len()).map(mean).collect();
    }
    f
}

/// A third of the area of the triangles at each vertex.
pub(super) fn vertex_areas(mesh: &TriMesh) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.positions.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let third = mesh.area(t) / 3.0;
        corners.iter().for_each(|&v| areas[v as usize] += third);
    }
    areas
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn the_middle_of_a_tube_is_central_and_its_ends_are_not() {
        let mesh = grid(12, 30, true, false);
        let f = centrality(&mesh);
        let low = (0..f.len()).min_by(|&a, &b| f[a].total_cmp(&f[b])).unwrap_or(0);
        let high = (0..f.len()).max_by(|&a, &b| f[a].total_cmp(&f[b])).unwrap_or(0);
        assert!((mesh.positions[low].z - 1.5).abs() < 0.4, "{}", mesh.positions[low]);
        assert!((mesh.positions[high].z - 1.5).abs() > 1.3, "{}", mesh.positions[high]);
    }
}
