//! The cotangent Laplacian of the intrinsic Delaunay triangulation, and the systems built from it.
//!
//! L = Σ over triangles of ½ cot; pattern and ordering are shared by every matrix of the surface.

use super::intrinsic::Intrinsic;
use crate::mesh::tri::{NONE, TriMesh, prev};
use crate::numerics::{Factored, Pattern, SolveError};

/// Laplacian of one surface: weights, masses, analysed pattern.
#[derive(Clone, Debug)]
pub struct Laplacian {
    /// The intrinsic Delaunay triangulation.
    pub triangulation: Intrinsic,
    /// ½ cot of the angle opposite to each halfedge, in its triangle (an edge's weight is the sum of both sides).
    pub half_weights: Vec<f64>,
    /// Barycentric lumped mass of each vertex; they sum to the area.
    pub masses: Vec<f64>,
    /// Edges whose weight was negative beyond rounding and was clamped to 0.
    pub clamped: usize,
    pattern: Pattern,
}

impl Laplacian {
    /// Builds the Laplacian of a mesh.
    ///
    /// # Errors
    /// [`SolveError::TooLarge`] when the pattern cannot be analysed.
    pub fn new(mesh: &TriMesh) -> Result<Self, SolveError> {
        let mut triangulation = Intrinsic::of(mesh);
        triangulation.make_delaunay();
        let n = mesh.positions.len();
        let halfedges = triangulation.tails.len() as u32;
        let mut half_weights: Vec<f64> = (0..halfedges).map(|h| 0.5 * triangulation.cotangent(h)).collect();
        let clamped = clamp_negative(&triangulation.twins, &mut half_weights);
        let mut masses = vec![0.0; n];
        for t in 0..halfedges as usize / 3 {
            let third = triangulation.area(t) / 3.0;
            (0..3).for_each(|k| masses[triangulation.tails[3 * t + k] as usize] += third);
        }
        let pairs = (0..halfedges).filter(|&h| is_first(&triangulation, h));
        let pattern = Pattern::new(n, pairs.map(|h| (triangulation.tails[h as usize], triangulation.head(h))))?;
        Ok(Self { triangulation, half_weights, masses, clamped, pattern })
    }

    /// Factors `mass_weight·M + L` with the `fixed` unknowns taken out; triangles for which `skip` holds are left out
    /// of L.
    ///
    /// # Errors
    /// [`SolveError::NotPositiveDefinite`] when the remaining system is singular.
    pub fn factor(
        &self,
        fixed: &[bool],
        mass_weight: f64,
        skip: impl Fn(usize) -> bool,
    ) -> Result<Factored, SolveError> {
        let weights = self.weights_without(skip);
        let mut diagonal: Vec<f64> = self.masses.iter().map(|m| mass_weight * m).collect();
        for (h, &w) in weights.iter().enumerate() {
            let (a, b) = (self.triangulation.tails[h], self.triangulation.head(h as u32));
            if a != b {
                diagonal[a as usize] += w;
                diagonal[b as usize] += w;
            }
        }
        // The weights go with the iterator: they are not held while the matrix is factored.
        let entries = weights
            .into_iter()
            .enumerate()
            .filter(|(_, w)| *w != 0.0)
            .map(|(h, w)| (self.triangulation.tails[h], self.triangulation.head(h as u32), -w));
        self.pattern.factor(&diagonal, entries, fixed)
    }

    /// The half weights with those of some triangles set to 0.
    pub fn weights_without(&self, skip: impl Fn(usize) -> bool) -> Vec<f64> {
        let mut weights = self.half_weights.clone();
        for t in (0..weights.len() / 3).filter(|&t| skip(t)) {
            weights[3 * t..3 * t + 3].fill(0.0);
        }
        weights
    }

    /// L x, over all triangles.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for (h, &w) in self.half_weights.iter().enumerate() {
            let (a, b) = (self.triangulation.tails[h] as usize, self.triangulation.head(h as u32) as usize);
            let flow = w * (x[a] - x[b]);
            y[a] += flow;
            y[b] -= flow;
        }
        y
    }

    /// ∫|∇x|² within one triangle.
    pub fn energy_within(&self, triangle: usize, x: &[f64]) -> f64 {
        let edge = |h: usize| {
            let d = x[self.triangulation.tails[h] as usize] - x[self.triangulation.head(h as u32) as usize];
            self.half_weights[h] * d * d
        };
        (3 * triangle..3 * triangle + 3).map(edge).sum::<f64>().max(0.0)
    }

    /// ∫|∇x|².
    pub fn energy(&self, x: &[f64]) -> f64 {
        let edge = |(h, w): (usize, &f64)| {
            let d = x[self.triangulation.tails[h] as usize] - x[self.triangulation.head(h as u32) as usize];
            w * d * d
        };
        self.half_weights.iter().enumerate().map(edge).sum()
    }
}

/// Whether `h` is the halfedge that stands for its edge.
fn is_first(t: &Intrinsic, h: u32) -> bool {
    let g = t.twins[h as usize];
    g == NONE || h < g
}

/// Makes every edge weight ≥ 0 (last resort where flipping could not), and returns how many were clamped.
fn clamp_negative(twins: &[u32], half_weights: &mut [f64]) -> usize {
    let typical = half_weights.iter().map(|w| w.abs().min(1e3)).sum::<f64>() / half_weights.len().max(1) as f64;
    let mut clamped = 0;
    for h in 0..half_weights.len() {
        let g = twins[h];
        let both = half_weights[h] + if g == NONE { 0.0 } else { half_weights[g as usize] };
        // A boundary edge opposite an obtuse angle has a negative weight too; flips cannot help there.
        if both < -1e-9 * typical && (g == NONE || (h as u32) < g) {
            clamped += usize::from(g != NONE);
            half_weights[h] = if g == NONE { half_weights[h] } else { 0.0 };
            if g != NONE {
                half_weights[g as usize] = 0.0;
            }
        }
    }
    clamped
}

/// The corner opposite to halfedge `h`.
pub fn opposite(t: &Intrinsic, h: u32) -> u32 {
    t.tails[prev(h) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn constants_are_in_the_kernel_and_masses_sum_to_the_area() {
        let mesh = grid(9, 7, true, false);
        let laplacian = Laplacian::new(&mesh).expect("small");
        assert!(laplacian.apply(&vec![1.0; mesh.positions.len()]).iter().all(|y| y.abs() < 1e-12));
        assert!((laplacian.masses.iter().sum::<f64>() - mesh.total_area()).abs() < 1e-9);
    }

    #[test]
    fn a_linear_function_on_a_flat_sheet_is_harmonic_inside() {
        let mesh = grid(9, 7, false, false);
        let laplacian = Laplacian::new(&mesh).expect("small");
        let x: Vec<f64> = mesh.positions.iter().map(|p| 2.0 * p.x - 0.5 * p.y).collect();
        let on = mesh.boundary_vertices();
        let y = laplacian.apply(&x);
        assert!(y.iter().zip(&on).all(|(y, on)| *on || y.abs() < 1e-12));
        assert!((laplacian.energy(&x) - 4.25).abs() < 1e-12);
    }
}
