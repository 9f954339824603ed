//! Tori: u and v both periodic, from two harmonic forms.
//!
//! For the harmonic forms du, dv that are dual to two loops (∫_A du = ∫_B dv = 1, ∫_A dv = ∫_B du = 0) the conformal
//! structure is z = u + τv with
//!
//! ```text
//! Im τ = 1 / ∫|∇v|²      Re τ = −∫∇u·∇v / ∫|∇v|²
//! ```
//!
//! (on a flat torus |dz|² = |du + τ dv|² these are its Dirichlet energies). (u, v) is z in lattice coordinates: as
//! conformal as the surface's own conformal structure lets a unit square be.
//!
//! **Which loops.** A torus in space has an inside. A loop that bounds a disc in it, the *meridian*, and one that bounds
//! a surface outside, the *longitude*, are unique up to sign; neither remeshing nor posing changes them. With
//! L_ij = lk(loop i, dual loop j pushed outwards), the meridian is the left kernel of L, the longitude its right kernel.
//! u runs along the meridian, v along the longitude, to which meridians are added until |Re τ| ≤ ½ (a long thin knot
//! would be sheared without). Where the surface cuts through itself and has no inside, the two shortest periods of z
//! take their place. What remains is (u, v) → (−u, −v), which registration tries as a flip.
//! *Ours, not the paper's:* its prototype has no tori (§5.1, Fig. 6 names their flips).

use super::UnfoldError;
use super::harmonic::HarmonicSolver;
use super::homology::{Generator, generators};
use super::linking::linking_number;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::numerics::SolveError;

/// How far dual loops are pushed outwards, in √area of their triangle.
const OUTWARD: f64 = 1e-3;
/// Steps of the reduction to the two shortest periods.
const REDUCTIONS_MAX: usize = 64;

/// u and v of a torus.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// u and v at each vertex, not wrapped.
    pub coordinates: [Vec<f64>; 2],
    /// Their jumps: along halfedge a → b a coordinate grows by x_b − x_a − s.
    pub jumps: [Vec<i32>; 2],
    /// τ: z = u + τv is conformal.
    pub tau: [f64; 2],
}

/// A cohomology class as integer combination of the two generators' crossings.
type Class = [i64; 2];

/// The lattice coordinates of a torus.
///
/// # Errors
/// [`UnfoldError::NotTorus`] when the surface has not exactly two generators.
pub fn lattice(solver: &HarmonicSolver) -> Result<Lattice, UnfoldError> {
    let mesh = &solver.mesh;
    let found = generators(mesh).ok_or(UnfoldError::NotTorus)?;
    let forms = [Form::new(solver, &found[0])?, Form::new(solver, &found[1])?];
    let wedge = wedge(mesh, &found);
    let gram = |a: Class, b: Class| {
        let inner = |i: usize, j: usize| a[i] as f64 * b[j] as f64 * inner(solver, &forms[i], &forms[j]);
        inner(0, 0) + inner(0, 1) + inner(1, 0) + inner(1, 1)
    };
    let (mut u, mut v) = match embedded_classes(mesh, &found) {
        Some(classes) => classes,
        None => shortest_classes(&gram),
    };
    if (u[0] * v[1] - u[1] * v[0]) * wedge < 0 {
        v = [-v[0], -v[1]];
    }
    // Adding k meridians to the longitude takes k·dv from du.
    let k = (gram(u, v) / gram(v, v)).round() as i64;
    u = [u[0] - k * v[0], u[1] - k * v[1]];
    let energy = gram(v, v);
    let tau = [-gram(u, v) / energy, 1.0 / energy];
    let combine = |class: Class| -> (Vec<f64>, Vec<i32>) {
        let [a, b] = class;
        let x = forms[0].x.iter().zip(&forms[1].x).map(|(p, q)| a as f64 * p + b as f64 * q).collect();
        let s = found[0].crossings.iter().zip(&found[1].crossings);
        (x, s.map(|(&p, &q)| -((a * i64::from(p) + b * i64::from(q)) as i32)).collect())
    };
    let ((x, s), (y, r)) = (combine(u), combine(v));
    Ok(Lattice { coordinates: [x, y], jumps: [s, r], tau })
}

/// A harmonic form: x_b − x_a − s along each halfedge of the intrinsic triangulation.
struct Form {
    x: Vec<f64>,
    carried: Vec<i32>,
}

impl Form {
    /// The harmonic form with the periods of a generator's crossings.
    fn new(solver: &HarmonicSolver, generator: &Generator) -> Result<Self, SolveError> {
        let t = &solver.laplacian.triangulation;
        let mut carried: Vec<i32> = generator.crossings.iter().map(|c| -c).collect();
        t.carry(&solver.mesh, &mut carried, &[]);
        let mut right = vec![0.0; solver.mesh.positions.len()];
        for (h, (&w, &s)) in solver.laplacian.half_weights.iter().zip(&carried).enumerate() {
            let flow = w * f64::from(s);
            right[t.tails[h] as usize] -= flow;
            right[t.head(h as u32) as usize] += flow;
        }
        Ok(Self { x: solver.poisson(right)?, carried })
    }

    fn along(&self, a: u32, b: u32, h: usize) -> f64 {
        self.x[b as usize] - self.x[a as usize] - f64::from(self.carried[h])
    }
}

/// ∫ ∇f·∇g.
fn inner(solver: &HarmonicSolver, f: &Form, g: &Form) -> f64 {
    let t = &solver.laplacian.triangulation;
    let weights = solver.laplacian.half_weights.iter().enumerate();
    let term = |(h, w): (usize, &f64)| {
        let (a, b) = (t.tails[h], t.head(h as u32));
        w * f.along(a, b, h) * g.along(a, b, h)
    };
    weights.map(term).sum()
}

/// The sign of ∫ f ∧ g of the generators' cochains.
fn wedge(mesh: &TriMesh, [f, g]: &[Generator; 2]) -> i64 {
    let twice: i32 = (0..mesh.triangles.len())
        .map(|t| {
            let (f, g) = (&f.crossings[3 * t..3 * t + 3], &g.crossings[3 * t..3 * t + 3]);
            // Along the first edge, and along the third backwards.
            f[0] * -g[2] + f[2] * g[0]
        })
        .sum();
    i64::from(twice.signum())
}

/// du and dv that are dual to the meridian and the longitude; `None` where linking numbers tell no inside.
fn embedded_classes(mesh: &TriMesh, found: &[Generator; 2]) -> Option<(Class, Class)> {
    let cycles = [0, 1].map(|i| points(mesh, &found[i].cycle));
    let duals = [0, 1].map(|j| pushed(mesh, &found[j].crossed));
    let l = [0, 1].map(|i| [0, 1].map(|j| linking_number(&cycles[i], &duals[j])));
    if l[0][0] * l[1][1] != l[0][1] * l[1][0] {
        return None;
    }
    let column = if l[0][0] != 0 || l[1][0] != 0 { [l[0][0], l[1][0]] } else { [l[0][1], l[1][1]] };
    let row = if l[0] != [0, 0] { l[0] } else { l[1] };
    let meridian = primitive([-column[1], column[0]])?;
    // The right kernel is a sum of dual loops r₁b₁ + r₂b₂; b₁ runs like loop 2 and b₂ like loop 1 backwards.
    let [r1, r2] = primitive([-row[1], row[0]])?;
    let longitude = [-r2, r1];
    let det = meridian[0] * longitude[1] - meridian[1] * longitude[0];
    // Rows of the inverse of [meridian longitude] are the forms dual to them.
    (det.abs() == 1).then(|| ([det * longitude[1], -det * longitude[0]], [-det * meridian[1], det * meridian[0]]))
}

/// Divided by the greatest common divisor; `None` for zero.
fn primitive([a, b]: Class) -> Option<Class> {
    let (mut x, mut y) = (a.abs(), b.abs());
    while y != 0 {
        (x, y) = (y, x % y);
    }
    (x != 0).then(|| [a / x, b / x])
}

/// The forms dual to the two shortest periods of z: the two of least energy, the lesser of which is dv.
fn shortest_classes(gram: &impl Fn(Class, Class) -> f64) -> (Class, Class) {
    let (mut u, mut v): (Class, Class) = ([1, 0], [0, 1]);
    for _ in 0..REDUCTIONS_MAX {
        if gram(u, u) < gram(v, v) {
            (u, v) = (v, u);
        }
        let k = (gram(u, v) / gram(v, v)).round() as i64;
        if k == 0 {
            break;
        }
        u = [u[0] - k * v[0], u[1] - k * v[1]];
    }
    (u, v)
}

fn points(mesh: &TriMesh, cycle: &[u32]) -> Vec<Vec3> {
    cycle.iter().map(|&v| mesh.positions[v as usize]).collect()
}

/// A dual loop just outside the surface: above the middle of each edge it crosses and of each triangle between.
fn pushed(mesh: &TriMesh, crossed: &[u32]) -> Vec<Vec3> {
    let outward = |t: u32| {
        let normal = mesh.area_vector(t as usize);
        let area = normal.norm();
        if area > 0.0 { (normal / area, OUTWARD * area.sqrt()) } else { (Vec3::zeros(), 0.0) }
    };
    let mut loop_points = Vec::with_capacity(2 * crossed.len());
    for &h in crossed {
        let middle = 0.5 * (mesh.positions[mesh.tail(h) as usize] + mesh.positions[mesh.head(h) as usize]);
        let centre = points(mesh, &mesh.triangles[h as usize / 3]).iter().sum::<Vec3>() / 3.0;
        let ((n, height), (m, other)) = (outward(h / 3), outward(mesh.twin(h) / 3));
        // Above both triangles, however sharp the edge: equal shares of both normals.
        loop_points.push(middle + (n + m) * height.min(other));
        loop_points.push(centre + n * height);
    }
    loop_points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tri::TriMesh;
    use crate::topology::{Topology, tests::grid, whole};
    use crate::unfold::{Chart, UnfoldOptions, signed_area, unfold};
    use std::f64::consts::TAU;

    /// A tube of radius `r` around a closed curve: `n` around the tube, `m` along. Its faces look outwards.
    fn tube(n: u32, m: u32, r: f64, curve: impl Fn(f64) -> Vec3) -> TriMesh {
        let mut mesh = grid(n, m, true, true);
        for j in 0..m {
            let t = f64::from(j) / f64::from(m);
            let along = (curve(t + 1e-4) - curve(t - 1e-4)).normalize();
            let x = along.cross(&Vec3::new(0.3, 0.4, 0.866)).normalize();
            let y = along.cross(&x);
            for i in 0..n {
                let a = TAU * f64::from(i) / f64::from(n);
                mesh.positions[(j * n + i) as usize] = curve(t) + r * (a.cos() * x + a.sin() * y);
            }
        }
        mesh
    }

    fn ring(t: f64) -> Vec3 {
        2.0 * Vec3::new((TAU * t).cos(), (TAU * t).sin(), 0.0)
    }

    fn trefoil(t: f64) -> Vec3 {
        let a = TAU * t;
        Vec3::new(a.sin() + 2.0 * (2.0 * a).sin(), a.cos() - 2.0 * (2.0 * a).cos(), -(3.0 * a).sin())
    }

    fn chart_of(mesh: &TriMesh) -> Chart {
        let patch = whole(mesh).expect("one component");
        assert_eq!(patch.topology, Topology::Torus);
        unfold(&patch, &UnfoldOptions::default()).expect("solvable")
    }

    /// How often u and v run around along a closed row of vertices.
    fn turns(chart: &Chart, cycle: &[u32]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (k, &a) in cycle.iter().enumerate() {
            let b = cycle[(k + 1) % cycle.len()];
            for c in 0..2 {
                let d = chart.uv[b as usize][c] - chart.uv[a as usize][c];
                sum[c] += d - d.round();
            }
        }
        sum
    }

    #[test]
    fn u_runs_around_the_tube_and_v_along_it_whatever_its_proportions() {
        // With a tube of radius 1.9 the longitude at the hole is the shorter loop.
        for (r, curve) in [(0.3, ring as fn(f64) -> Vec3), (1.9, ring), (0.4, trefoil)] {
            let chart = chart_of(&tube(24, 90, r, curve));
            let around: Vec<u32> = (0..24).collect();
            let along: Vec<u32> = (0..90).map(|j| 24 * j).collect();
            let (a, b) = (turns(&chart, &around), turns(&chart, &along));
            assert!((a[0].abs() - 1.0).abs() < 1e-9 && a[1].abs() < 1e-9, "r = {r}: {a:?}");
            assert!((b[1].abs() - 1.0).abs() < 1e-9, "r = {r}: {b:?}");
        }
    }

    #[test]
    fn the_modulus_of_a_round_torus_is_the_known_one() {
        // τ = i·√(R² − r²)/r.
        let (big, small) = (2.0f64, 0.7f64);
        let chart = chart_of(&tube(60, 170, small, ring));
        let expected = (big * big - small * small).sqrt() / small;
        assert!((chart.modulus / expected - 1.0).abs() < 0.004, "{} for {expected}", chart.modulus);
        assert_eq!(chart.report.uv_flips, 0);
        assert!(chart.report.angle_deviation_deg < 1.0, "{}", chart.report.angle_deviation_deg);
    }

    #[test]
    fn the_unit_square_is_covered_once() {
        let chart = chart_of(&tube(20, 70, 0.5, trefoil));
        let area: f64 = chart.corners.iter().map(signed_area).sum();
        assert!((area - 1.0).abs() < 1e-9, "{area}");
    }

    #[test]
    fn a_torus_that_cuts_through_itself_takes_its_shortest_periods() {
        let figure_eight = |t: f64| Vec3::new((TAU * t).sin(), (2.0 * TAU * t).sin(), 0.0);
        let chart = chart_of(&tube(16, 80, 0.2, figure_eight));
        assert!(chart.modulus >= 3f64.sqrt() / 2.0 - 1e-9);
        assert!((chart.corners.iter().map(signed_area).sum::<f64>() - 1.0).abs() < 1e-9);
    }
}
