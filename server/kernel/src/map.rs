//! The cross map ψ* = φ₂⁻¹ ∘ ψ̂ ∘ φ₁ of an example onto the input, its editing, and the mesh it makes.
//!
//! *Source:* paper Eq. 7 and §5.3.

pub mod assemble;
pub mod atlas;
pub mod bend;
mod boundary_loop;
pub mod edit;
pub mod parted;
pub mod placed;
pub mod polish;
pub mod reembed;
pub mod rejoin;
pub mod snap;
pub mod untangle;
pub mod walk;

use crate::encode::index::{Location, PlanarIndex};
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::numerics::in_halves;
use crate::register::{Flip, Registration};
use crate::topology::holes::is_filling;
use crate::unfold::{Chart, Uv, signed_area};

/// Where each vertex of an example's patch goes on the input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CrossMap {
    /// The place on the input's chart, one a vertex of the patch.
    pub locations: Vec<Location>,
    /// The same in space.
    pub positions: Vec<Vec3>,
}

/// Maps the vertices of the example's patch. Poles go to poles and boundaries to boundaries, exactly.
pub fn cross_map(registration: &Registration, example: &Chart, input: &Chart, index: &PlanarIndex) -> CrossMap {
    let vertices: Vec<usize> = (0..example.patch_vertices).collect();
    let locate = |v: &usize| index.locate(input, registration.map(example.topology, vertex_uv(example, *v)));
    let locations = in_halves(&vertices, locate);
    let positions: Vec<Vec3> = locations.iter().map(|l| l.point(input)).collect();
    CrossMap { locations, positions }
}

/// Moves vertices that lie on the filling of a hole to the nearest point of the surface, unless that is farther than `reach`:
/// those bridge the hole. Returns how many lay on fillings.
pub fn leave_fillings(cross: &mut CrossMap, input: &Chart, reach: f64) -> usize {
    let on_filling = |l: &Location| is_filling(&input.mesh, l.triangle);
    let count = cross.locations.iter().filter(|l| on_filling(l)).count();
    if count == 0 {
        return 0;
    }
    let own: Vec<u32> = (0..input.mesh.triangles.len() as u32).filter(|&t| !is_filling(&input.mesh, t)).collect();
    let triangles = own.iter().map(|&t| input.mesh.triangles[t as usize]).collect();
    let bvh = Bvh::new(&TriMesh { positions: input.mesh.positions.clone(), triangles, ..TriMesh::default() });
    for (location, position) in cross.locations.iter_mut().zip(&mut cross.positions) {
        if !on_filling(location) {
            continue;
        }
        let closest = bvh.closest(*position);
        if let Some(&triangle) = own.get(closest.triangle as usize).filter(|_| closest.distance <= reach) {
            *location = Location { triangle, barycentric: closest.barycentric };
            *position = closest.point;
        }
    }
    count
}

/// Polygons of the example that the map turns over in the domain, beyond those that are turned over there already, in
/// order. `mesh` is the patch that `example` unfolds. Faces at a pole, where u has no meaning, are left out.
pub fn folded_faces(registration: &Registration, example: &Chart, mesh: &TriMesh) -> Vec<u32> {
    let vertices = mesh.positions.len().min(example.uv.len());
    let images: Vec<Uv> = example.uv[..vertices].iter().map(|&x| registration.map(example.topology, x)).collect();
    let turned = (0..mesh.triangles.len())
        .filter(|&t| turns_over(registration.flip, example, |v| images[v as usize], &mesh.triangles[t]));
    let mut folded: Vec<u32> = turned.map(|t| mesh.polygon_of[t]).collect();
    folded.sort_unstable();
    folded.dedup();
    folded
}

/// Whether the map turns a triangle of the example over in the domain that was not turned over before; `image` is where
/// it takes a vertex.
fn turns_over(flip: Flip, example: &Chart, image: impl Fn(u32) -> Uv, corners: &[u32; 3]) -> bool {
    if example.poles.iter().any(|p| corners.contains(&p.vertex)) {
        return false;
    }
    let first = example.uv[corners[0] as usize];
    // Whole periods from a vertex's own place to the one beside the first corner; ψ takes them along.
    let periods = corners.map(|v| {
        let [u, v] = example.uv[v as usize];
        let rows = if example.topology.is_periodic_v() { (v - first[1]).round() } else { 0.0 };
        [-(u - first[0]).round(), -rows]
    });
    let moved = |at: [Uv; 3], turn: [f64; 2]| {
        [0, 1, 2].map(|k| [at[k][0] + turn[0] * periods[k][0], at[k][1] + turn[1] * periods[k][1]])
    };
    if signed_area(&moved(corners.map(|v| example.uv[v as usize]), [1.0, 1.0])) <= 0.0 {
        return false;
    }
    let along = |flipped: bool| if flipped { -1.0 } else { 1.0 };
    along(flip.is_mirror()) * signed_area(&moved(corners.map(image), [along(flip.u), along(flip.v)])) < 0.0
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
    use crate::register::{Entry, Flip, Level, LevenbergMarquardt, Query, coarse_flip, query_images};
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

    /// A ring of uneven girth with a lump, of the given numbers of faces around and along.
    fn lumpy_ring(n: u32, m: u32, turned: f64) -> crate::mesh::TriMesh {
        let mut mesh = grid(n, m, true, true);
        for p in &mut mesh.positions {
            // The grid's ring has radius 2 and girth 1; it is turned along itself and about its tube, then shaped.
            let (around, x) = (p.y.atan2(p.x) + turned, p.x.hypot(p.y) - 2.0);
            let along = p.z.atan2(x) + 0.7 * turned;
            // Lumps of several heights on a screw: no mirror image of itself.
            let lump = |a: f64, b: f64, h: f64| {
                h * (-(1.0 - (around - a).cos()) / 0.08 - (1.0 - (along - b).cos()) / 0.2).exp()
            };
            let girth = 0.6
                + 0.15 * around.sin()
                + 0.1 * (2.0 * around).cos()
                + lump(0.0, 0.0, 0.5)
                + lump(0.7, 1.5, 0.7)
                + lump(1.4, 3.0, 0.9)
                + lump(2.4, 4.4, 0.5);
            let r = 2.0 + girth * along.cos();
            *p = crate::mesh::Vec3::new(
                r * around.cos(),
                r * around.sin(),
                girth * along.sin() + 0.3 * (2.0 * around).sin(),
            );
        }
        mesh
    }

    #[test]
    fn a_torus_maps_onto_another_mesh_of_itself_and_its_mirror_image() {
        let example = whole(&lumpy_ring(48, 30, 0.0)).expect("a torus");
        let chart = unfold(&example, &UnfoldOptions::default()).expect("solvable");
        let encoding = encode(&chart);
        let (solver, never) = (LevenbergMarquardt::default(), || false);
        for mirror in [false, true] {
            let mut mesh = lumpy_ring(61, 37, 2.1);
            if mirror {
                mesh.positions.iter_mut().for_each(|p| p.z = -p.z);
                mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
                mesh = crate::mesh::TriMesh::from_triangles(mesh.positions, mesh.triangles).expect("manifold");
            }
            let query = Query::new(&whole(&mesh).expect("a torus"), &UnfoldOptions::default()).expect("solvable");
            let mut entry = Entry::coarse(&query, &encoding, &solver, &never).expect("a torus too");
            while entry.side() < 128 {
                entry.advance(&query, &encoding, &solver, &never).expect("solvable");
            }
            let best = entry.best();
            let map = cross_map(&best.registration, &chart, &query.chart, query.index());
            let z = if mirror { -1.0 } else { 1.0 };
            let error = |(a, b): (&crate::mesh::Vec3, &crate::mesh::Vec3)| {
                (a - crate::mesh::Vec3::new(b.x, b.y, z * b.z)).norm() / query.chart.mesh.total_area().sqrt()
            };
            let mut errors: Vec<f64> = map.positions.iter().zip(&example.mesh.positions).map(error).collect();
            errors.sort_by(f64::total_cmp);
            assert_eq!(best.registration.flip.is_mirror(), mirror, "cost {}", best.cost());
            assert!(folded_faces(&best.registration, &chart, &example.mesh).is_empty());
            let (median, p95) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100]);
            assert!(median < 0.0025, "median {median}, 95th percentile {p95}");
        }
    }

    #[test]
    fn each_flip_of_a_torus_is_told_from_the_others() {
        let encoding = |mesh: &crate::mesh::TriMesh| {
            let patch = whole(mesh).expect("a torus");
            encode(&unfold(&patch, &UnfoldOptions::default()).expect("solvable"))
        };
        let (example, query) = (encoding(&lumpy_ring(48, 30, 0.0)), encoding(&lumpy_ring(61, 37, 2.1)));
        let flips = Flip::all(crate::topology::Topology::Torus);
        let (solver, never) = (LevenbergMarquardt::default(), || false);
        for turned in flips {
            // The query's pictures, flipped by hand.
            let mut flipped = query.clone();
            for (to, from) in flipped.pyramid.iter_mut().zip(&query.pyramid) {
                let n = from.side;
                let at = |k: usize, flip: bool| if flip { n - 1 - k } else { k };
                to.values = (0..n * n).map(|k| from.values[at(k / n, turned.v) * n + at(k % n, turned.u)]).collect();
            }
            let images = query_images(&flipped, 32);
            let level = Level::new(&example, &images[0]).expect("a coarsest level");
            let cost = |flip: &Flip| coarse_flip(&level, *flip, &solver, &never).energy;
            let mut costs: Vec<(f64, Flip)> = flips.iter().map(|f| (cost(f), *f)).collect();
            costs.sort_by(|a, b| a.0.total_cmp(&b.0));
            // Up to (u, v) → (−u, −v), of which no unfolding can tell which is meant, it is the one made by hand.
            assert_eq!(costs[0].1.is_mirror(), turned.is_mirror(), "{costs:?}");
            assert!(costs[1].0 > 10.0 * costs[0].0, "{costs:?}");
        }
    }
}
