//! Unfolding: a primitive surface to the unit square, u periodic, v from boundary to pole.
//!
//! *Source:* paper §4.2. *Ours:* see the parts: [`harmonic`], [`pole`], [`area_fraction`], [`intrinsic`], [`rim`],
//! [`relax`], [`torus`].

pub mod area_fraction;
pub mod harmonic;
pub mod homology;
pub mod intrinsic;
pub mod laplacian;
pub mod linking;
pub mod moebius;
pub mod path;
pub mod pole;
pub mod refine;
pub mod relax;
pub mod rim;
pub mod torus;

use std::sync::Arc;

use crate::mesh::tri::TriMesh;
use crate::numerics::SolveError;
use crate::topology::holes::filled;
use crate::topology::{Patch, Topology};
use area_fraction::{AreaFraction, MODULUS_SHARES};
use harmonic::{Harmonic, HarmonicSolver};
use laplacian::Laplacian;
use moebius::Conformal;
use pole::{Breadth, Smoother};

/// A point of the domain: u (period 1), v in 0–1 (tori: period 1 too).
pub type Uv = [f64; 2];

/// How to unfold.
#[derive(Clone, Debug, Default)]
pub struct UnfoldOptions {
    /// Poles given by the user, as vertices of the patch: one for a disc, two for a sphere. Empty: found.
    pub poles: Vec<u32>,
}

/// Why a surface could not be unfolded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnfoldError {
    /// A linear system could not be solved.
    #[error("expected solvable cotangent systems, found one that is not: {0}")]
    Solve(#[from] SolveError),
    /// The surface has no area.
    #[error("expected a surface of positive area, found area {0:e}")]
    NoArea(f64),
    /// What should be a torus has not two loops that generate it.
    #[error("expected a closed surface of genus 1, found none")]
    NotTorus,
}

/// A pole of a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pole {
    /// Its vertex.
    pub vertex: u32,
    /// Whether it lies at v = 1 (else v = 0).
    pub at_top: bool,
}

/// A surface unfolded: φ : S → D on the vertices and corners of a refined mesh.
#[derive(Clone, Debug)]
pub struct Chart {
    /// What the surface is.
    pub topology: Topology,
    /// The refined mesh: the patch's vertices first, then those that splitting added (in the old triangles).
    pub mesh: Arc<TriMesh>,
    /// How many vertices are the patch's own.
    pub patch_vertices: usize,
    /// (u, v) of each vertex, both in 0–1. At a pole u has no meaning.
    pub uv: Vec<Uv>,
    /// (u, v) of each corner of each triangle, continuous within the triangle; the least u (tori: and v) in 0–1.
    pub corners: Vec<[Uv; 3]>,
    /// The poles.
    pub poles: Vec<Pole>,
    /// Modulus: how deep the surface is for its girth (METHOD §2).
    pub modulus: f64,
    /// What happened.
    pub report: UnfoldReport,
}

/// What unfolding had to do, and how well it went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UnfoldReport {
    /// Vertices added before solving.
    pub vertices_added: usize,
    /// Intrinsic flips.
    pub flips: usize,
    /// Length added to every edge to undo degenerate triangles, in mean edge lengths.
    pub mollified: f64,
    /// Negative weights clamped.
    pub clamped: usize,
    /// Triangles whose orientation is reversed in (u, v).
    pub uv_flips: usize,
    /// Mean |90° − angle(∇u, ∇v)| with v harmonic, weighted by area, in degrees.
    pub angle_deviation_deg: f64,
}

/// v and u for certain poles, before v is re-marginalised.
#[derive(Debug)]
pub struct Solution {
    /// The poles.
    pub poles: Vec<u32>,
    fields: Fields,
}

/// The two coordinates, solved for.
#[derive(Debug)]
enum Fields {
    /// Discs, annuli, spheres: v harmonic, u its conjugate with its jumps along halfedges.
    Conjugate { harmonic: Harmonic, u: Vec<f64>, jumps: Vec<i32> },
    /// Tori.
    Lattice(torus::Lattice),
}

/// A surface with everything factored, from which charts for any poles are made.
#[derive(Debug)]
pub struct Unfolder {
    patch_vertices: usize,
    solver: HarmonicSolver,
}

/// The mesh on which a patch is unfolded: holes filled, chords split, coarse meshes subdivided.
/// The patch's own where nothing of that is needed.
pub fn solve_mesh(patch: &Patch) -> Arc<TriMesh> {
    let mut mesh = match patch.holes.is_empty() {
        true => Arc::clone(&patch.mesh),
        false => Arc::new(filled(&patch.mesh, &patch.holes)),
    };
    mesh = refine::split_chords(mesh);
    while mesh.triangles.len() < TRIANGLES_MIN {
        mesh = Arc::new(refine::split_edges(&mesh, &vec![true; mesh.twins.len()]));
    }
    mesh
}

/// Coarser meshes are subdivided before solving: the surface is the same, v and u are smoother.
const TRIANGLES_MIN: usize = 4000;

impl Unfolder {
    /// Prepares `mesh` = [`solve_mesh`] of a patch with `patch_vertices` vertices, and tells the poles to use, best first;
    /// each entry is a full set (disc one, sphere two, annulus and torus none). Poles of the user's that fit the
    /// topology are the only ones.
    ///
    /// # Errors
    /// [`UnfoldError`] for surfaces without area and unsolvable systems.
    pub fn with_poles(
        mesh: Arc<TriMesh>,
        topology: Topology,
        patch_vertices: usize,
        options: &UnfoldOptions,
    ) -> Result<(Self, Vec<Vec<u32>>), UnfoldError> {
        let area = mesh.total_area();
        if !(area > 0.0 && area.is_finite()) {
            return Err(UnfoldError::NoArea(area));
        }
        let wanted = match topology {
            Topology::Disc => 1,
            Topology::Sphere => 2,
            Topology::Annulus | Topology::Torus => 0,
        };
        let given = wanted > 0 && options.poles.len() == wanted;
        let seeks = topology == Topology::Disc && !given;
        let smoother = |laplacian: &Laplacian| seeks.then(|| Smoother::for_poles(laplacian));
        let (solver, smoother) = HarmonicSolver::beside(mesh, topology, smoother)?;
        let smoother = smoother.flatten().transpose()?;
        let poles = match topology {
            _ if given => vec![options.poles.clone()],
            Topology::Disc => pole::disc_candidates(&solver, smoother)?.into_iter().map(|p| vec![p]).collect(),
            Topology::Sphere => vec![pole::sphere_poles(&solver).to_vec()],
            Topology::Annulus | Topology::Torus => vec![Vec::new()],
        };
        Ok((Self { patch_vertices, solver }, poles))
    }

    /// Tips of the surface's protrusions, most prominent first; none for annuli and tori. See [`pole::protrusions`].
    ///
    /// # Errors
    /// [`UnfoldError::Solve`].
    pub fn protrusions(&self, poles: &[u32], breadth: Breadth) -> Result<Vec<u32>, UnfoldError> {
        match self.solver.topology {
            Topology::Disc | Topology::Sphere => Ok(pole::protrusions(&self.solver, poles, breadth)?),
            Topology::Annulus | Topology::Torus => Ok(Vec::new()),
        }
    }

    /// The solution for the first poles for which there is one.
    ///
    /// # Errors
    /// The last [`UnfoldError`] where there is none.
    pub fn first_solution(&self, candidates: &[Vec<u32>]) -> Result<Solution, UnfoldError> {
        let mut result = Err(UnfoldError::Solve(SolveError::NotPositiveDefinite));
        for poles in candidates {
            result = self.solve(poles);
            if result.is_ok() {
                break;
            }
        }
        result
    }

    /// Solves for v and u with given poles.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn solve(&self, poles: &[u32]) -> Result<Solution, UnfoldError> {
        let fields = if self.solver.topology == Topology::Torus {
            Fields::Lattice(torus::lattice(&self.solver)?)
        } else {
            let harmonic = self.solver.v(poles)?;
            let (u, jumps) = self.solver.conjugate(&harmonic, poles)?;
            Fields::Conjugate { harmonic, u, jumps }
        };
        Ok(Solution { poles: poles.to_vec(), fields })
    }

    /// The (refined) mesh that is unfolded.
    pub fn mesh(&self) -> &Arc<TriMesh> {
        &self.solver.mesh
    }

    /// The conformal map from which charts for other poles follow without a solve; `None` for annuli and tori.
    pub fn conformal(&self, solution: &Solution) -> Option<Conformal> {
        let Fields::Conjugate { harmonic, u, .. } = &solution.fields else { return None };
        let mesh = Arc::clone(&self.solver.mesh);
        Conformal::new(mesh, self.solver.topology, self.patch_vertices, harmonic, u, &solution.poles)
    }

    /// The chart for given poles.
    ///
    /// # Errors
    /// [`UnfoldError`].
    pub fn chart(&self, poles: &[u32]) -> Result<Chart, UnfoldError> {
        Ok(self.chart_of(&self.solve(poles)?))
    }

    /// The chart that a solution gives.
    pub fn chart_of(&self, solution: &Solution) -> Chart {
        let (harmonic, u, s) = match &solution.fields {
            Fields::Lattice(lattice) => return self.torus_chart(lattice),
            Fields::Conjugate { harmonic, u, jumps } => (harmonic, u, jumps),
        };
        let fraction = AreaFraction::new(&self.solver.mesh, &harmonic.v);
        let v: Vec<f64> = match self.solver.topology {
            Topology::Annulus | Topology::Torus => harmonic.v.clone(),
            Topology::Disc | Topology::Sphere => harmonic.v.iter().map(|&x| fraction.at(x)).collect(),
        };
        let modulus = match self.solver.topology {
            Topology::Disc => fraction.level(MODULUS_SHARES[1]) / harmonic.energy,
            Topology::Sphere => {
                (fraction.level(MODULUS_SHARES[1]) - fraction.level(MODULUS_SHARES[0])) / harmonic.energy
            }
            Topology::Annulus | Topology::Torus => 1.0 / harmonic.energy,
        };
        self.assemble(&solution.poles, harmonic, u, s, &v, modulus)
    }

    fn assemble(&self, poles: &[u32], harmonic: &Harmonic, u: &[f64], s: &[i32], v: &[f64], modulus: f64) -> Chart {
        let mesh = &self.solver.mesh;
        let (u, v) = relax::relaxed(&relax::ChartStructure { mesh, jumps: s, poles }, u, v);
        let corners: Vec<[Uv; 3]> = (0..mesh.triangles.len())
            .map(|t| corner_uvs(mesh.triangles[t], &u, &s[3 * t..3 * t + 3], &v, poles))
            .collect();
        let uv = u.iter().zip(&v).map(|(&u, &v)| [u.rem_euclid(1.0), v]).collect();
        let poles: Vec<Pole> = match self.solver.topology {
            Topology::Disc => poles.iter().map(|&vertex| Pole { vertex, at_top: true }).collect(),
            _ => poles.iter().enumerate().map(|(k, &vertex)| Pole { vertex, at_top: k == 1 }).collect(),
        };
        let conformal = |t: usize| {
            let du = [1, 2].map(|k| corners[t][k][0] - corners[t][0][0]);
            (du, [1, 2].map(|k| harmonic.v[mesh.triangles[t][k] as usize] - harmonic.v[mesh.triangles[t][0] as usize]))
        };
        let angle_deviation_deg = angle_deviation(mesh, &poles, conformal);
        self.finish(uv, corners, poles, modulus, angle_deviation_deg)
    }

    fn torus_chart(&self, lattice: &torus::Lattice) -> Chart {
        let mesh = &self.solver.mesh;
        let torus::Lattice { coordinates: [x, y], jumps: [r, s], tau } = lattice;
        let corners: Vec<[Uv; 3]> = (0..mesh.triangles.len())
            .map(|t| {
                let along = |x: &[f64], s: &[i32]| wrapped(continued(mesh.triangles[t], x, &s[3 * t..3 * t + 3], &[]));
                let (u, v) = (along(x, r), along(y, s));
                [0, 1, 2].map(|k| [u[k], v[k]])
            })
            .collect();
        let uv = x.iter().zip(y).map(|(u, v)| [u.rem_euclid(1.0), v.rem_euclid(1.0)]).collect();
        // z = u + τv is what is conformal.
        let conformal = |t: usize| {
            let d = [1, 2].map(|k| [corners[t][k][0] - corners[t][0][0], corners[t][k][1] - corners[t][0][1]]);
            (d.map(|d| d[0] + tau[0] * d[1]), d.map(|d| tau[1] * d[1]))
        };
        let angle_deviation_deg = angle_deviation(mesh, &[], conformal);
        self.finish(uv, corners, Vec::new(), tau[1], angle_deviation_deg)
    }

    fn finish(&self, uv: Vec<Uv>, corners: Vec<[Uv; 3]>, poles: Vec<Pole>, modulus: f64, deviation: f64) -> Chart {
        let mesh = &self.solver.mesh;
        let t = &self.solver.laplacian.triangulation;
        let mean_length = t.lengths.iter().sum::<f64>() / t.lengths.len().max(1) as f64;
        let report = UnfoldReport {
            vertices_added: mesh.positions.len() - self.patch_vertices,
            flips: t.flips.len(),
            mollified: t.mollified / mean_length,
            clamped: self.solver.laplacian.clamped,
            uv_flips: corners.iter().filter(|c| signed_area(c) < 0.0).count(),
            angle_deviation_deg: deviation,
        };
        Chart {
            topology: self.solver.topology,
            mesh: Arc::clone(mesh),
            patch_vertices: self.patch_vertices,
            uv,
            corners,
            poles,
            modulus,
            report,
        }
    }
}

/// Unfolds a patch with the given or the best poles.
///
/// # Errors
/// [`UnfoldError`].
pub fn unfold(patch: &Patch, options: &UnfoldOptions) -> Result<Chart, UnfoldError> {
    let (unfolder, poles) =
        Unfolder::with_poles(solve_mesh(patch), patch.topology, patch.mesh.positions.len(), options)?;
    Ok(unfolder.chart_of(&unfolder.first_solution(&poles)?))
}

/// The corners of a triangle with u made continuous along its edges. A pole's corner takes the mean u of the others.
fn corner_uvs(triangle: [u32; 3], u: &[f64], s: &[i32], v: &[f64], poles: &[u32]) -> [Uv; 3] {
    let x = wrapped(continued(triangle, u, s, poles));
    [0, 1, 2].map(|k| [x[k], v[triangle[k] as usize]])
}

/// A coordinate at a triangle's corners, made continuous along its edges by the jumps `s` of its halfedges. A pole's
/// corner takes the mean of the others.
fn continued(triangle: [u32; 3], u: &[f64], s: &[i32], poles: &[u32]) -> [f64; 3] {
    let is_pole = triangle.map(|x| poles.contains(&x));
    let k0 = is_pole.iter().position(|p| !p).unwrap_or(0);
    let (k1, k2) = ((k0 + 1) % 3, (k0 + 2) % 3);
    let at = |k: usize| u[triangle[k] as usize];
    let mut x = [0.0; 3];
    x[k0] = at(k0).rem_euclid(1.0);
    if is_pole[k1] {
        // Backwards along the edge k2 → k0, which is no pole's.
        x[k2] = x[k0] - (at(k0) - at(k2) - f64::from(s[k2]));
        x[k1] = 0.5 * (x[k0] + x[k2]);
    } else {
        x[k1] = x[k0] + at(k1) - at(k0) - f64::from(s[k0]);
        x[k2] = match is_pole[k2] {
            true => 0.5 * (x[k0] + x[k1]),
            false => x[k1] + at(k2) - at(k1) - f64::from(s[k1]),
        };
    }
    x
}

/// Moved by a whole number so that the least is in 0–1.
fn wrapped(x: [f64; 3]) -> [f64; 3] {
    let shift = x[0].min(x[1]).min(x[2]).floor();
    x.map(|x| x - shift)
}

/// Area of a triangle of the domain, positive when it is oriented as on the surface.
pub fn signed_area(c: &[Uv; 3]) -> f64 {
    0.5 * ((c[1][0] - c[0][0]) * (c[2][1] - c[0][1]) - (c[2][0] - c[0][0]) * (c[1][1] - c[0][1]))
}

/// Area-weighted mean of |90° − angle(∇x, ∇y)| over faces without a pole. `differences` gives of x and of y, which
/// should be conformal, how much greater they are at a triangle's second and third corner than at its first.
/// *Source:* paper Fig. 3.
fn angle_deviation(mesh: &TriMesh, poles: &[Pole], differences: impl Fn(usize) -> ([f64; 2], [f64; 2])) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        if triangle.iter().any(|x| poles.iter().any(|p| p.vertex == *x)) {
            continue;
        }
        let [a, b, c] = triangle.map(|x| mesh.positions[x as usize]);
        let (e1, e2) = (b - a, c - a);
        let (g11, g12, g22) = (e1.dot(&e1), e1.dot(&e2), e2.dot(&e2));
        let det = g11 * g22 - g12 * g12;
        if det <= 0.0 {
            continue;
        }
        let (du, dv) = differences(t);
        let dot = |x: [f64; 2], y: [f64; 2]| g22 * x[0] * y[0] - g12 * (x[0] * y[1] + x[1] * y[0]) + g11 * x[1] * y[1];
        let norm = (dot(du, du) * dot(dv, dv)).sqrt();
        if norm > 0.0 {
            let area = 0.5 * det.sqrt();
            sum += area * (dot(du, dv) / norm).clamp(-1.0, 1.0).asin().abs().to_degrees();
            total += area;
        }
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{Components, primitive, submesh, tests::grid, whole};

    #[test]
    fn a_sheet_with_holes_unfolds_like_the_sheet() {
        let sheet = grid(24, 24, false, false);
        let kept: Vec<u32> =
            (0..sheet.triangles.len() as u32).filter(|t| ![200, 333, 500, 611, 777, 905].contains(t)).collect();
        let patch = primitive(&submesh(&sheet, &kept).0, Components::default()).expect("a disc");
        let pole = UnfoldOptions { poles: vec![25 * 12 + 12] };
        let chart = unfold(&patch, &pole).expect("solvable");
        let sound = unfold(&whole(&sheet).expect("a disc"), &pole).expect("solvable");
        assert!((chart.modulus - sound.modulus).abs() < 0.01 * sound.modulus, "{} {}", chart.modulus, sound.modulus);
        let area = |chart: &Chart| chart.corners.iter().map(signed_area).sum::<f64>();
        assert!((area(&chart) - area(&sound)).abs() < 0.01);
        assert_eq!(chart.patch_vertices, patch.mesh.positions.len());
    }
}
