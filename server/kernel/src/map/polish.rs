//! Surface polish: mapped vertices slide along the input until the example's faces keep their shape.
//!
//! E(y) = Σ_t Σ_k cot α_k |(y_a − y_b) − σ_t R_t (x_a − x_b)|² + β Σ_i m_i |y_i − ŷ_i|², y on the input's surface: each
//! triangle of the example is laid in the plane tangent to the input where it lands, R_t is the rotation and σ_t the
//! size that fit it best there. Local step: R_t, σ_t. Global step: displacements d_i in the tangent planes, one sparse
//! solve; then each vertex walks its d_i along the surface.
//! *Source:* Sorkine and Alexa, *As-rigid-as-possible surface modeling* (2007), local and global step; Liu et al., *A
//! local/global approach to mesh parameterization* (2008), triangles in the plane. *Ours, not the paper's:* on a
//! surface, orientation taken from the input's normal, so that turned faces turn back.

use super::CrossMap;
use super::walk::walk;
use crate::encode::index::Location;
use crate::mesh::tri::TriMesh;
use crate::mesh::{NONE, Vec3};
use crate::numerics::sparse::Pattern;
use crate::unfold::Chart;

/// What the polish weighs.
#[derive(Clone, Copy, Debug)]
pub struct PolishOptions {
    /// Rounds of a local and a global step.
    pub rounds: usize,
    /// β, in units of the mean cotangent weight of a vertex.
    pub anchor: f64,
    /// How far σ_t may follow the size that a triangle has (0: all grow alike; 1: any size is free).
    pub size_freedom: f64,
    /// Longest step of a vertex in a round, in mean edge lengths of the mapped mesh.
    pub step_max: f64,
}

impl Default for PolishOptions {
    fn default() -> Self {
        Self { rounds: 10, anchor: 0.01, size_freedom: 0.5, step_max: 1.0 }
    }
}

/// Cotangents are held between these: slivers of the example must not rule.
const COTANGENT_RANGE: [f64; 2] = [0.05, 10.0];
/// σ_t may differ from the common size by this factor.
const SIZE_RANGE: f64 = 4.0;

/// Moves the map of `mesh` (the example's patch) along the mesh of `input`. `mirror` is −1 for mirrored maps. Boundary
/// vertices stay.
pub fn polish(mesh: &TriMesh, cross: &mut CrossMap, input: &Chart, mirror: f64, options: &PolishOptions) {
    let faces = Faces {
        triangles: &mesh.triangles,
        rest: mesh.triangles.iter().map(|t| flat(corners(mesh, t), mirror)).collect(),
        heights: Vec::new(),
        fixed: mesh.boundary_vertices(),
        area: mesh.total_area(),
    };
    settle(faces, cross, input, options);
}

/// Moves the vertices that are not `fixed` until faces have the shapes again that they have where `before` lays them. Only faces with a
/// corner that moves are looked at: a point that is dragged moves some hundred of them.
pub fn polish_within(
    mesh: &TriMesh,
    before: &CrossMap,
    cross: &mut CrossMap,
    input: &Chart,
    fixed: &[bool],
    options: &PolishOptions,
) {
    let normals = vertex_normals(&input.mesh);
    let moves = |t: &&[u32; 3]| t.iter().any(|&v| !fixed[v as usize]);
    let moving: Vec<&[u32; 3]> = mesh.triangles.iter().filter(moves).collect();
    let mut vertices: Vec<u32> = moving.iter().flat_map(|t| t.iter().copied()).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let mut number = vec![NONE; fixed.len()];
    vertices.iter().zip(0..).for_each(|(&v, k)| number[v as usize] = k);
    let triangles: Vec<[u32; 3]> = moving.iter().map(|t| t.map(|v| number[v as usize])).collect();
    let laid = moving.iter().map(|t| {
        let corners = t.map(|v| before.positions[v as usize]);
        let normal: Vec3 = t.iter().map(|&v| normal_of(input, &normals, before.locations[v as usize])).sum();
        let normal = normal.try_normalize(0.0).unwrap_or_else(Vec3::z);
        let plane = axes(normal);
        let d = corners.map(|p| p - corners[0]);
        (d.map(|d| [d.dot(&plane[0]), d.dot(&plane[1])]), d.map(|d| d.dot(&normal)))
    });
    let (rest, heights) = laid.unzip();
    let faces = Faces {
        triangles: &triangles,
        rest,
        heights,
        fixed: vertices.iter().map(|&v| fixed[v as usize]).collect(),
        area: input.mesh.total_area(),
    };
    let mut part = CrossMap {
        locations: vertices.iter().map(|&v| cross.locations[v as usize]).collect(),
        positions: vertices.iter().map(|&v| cross.positions[v as usize]).collect(),
    };
    settle(faces, &mut part, input, options);
    for (k, &v) in vertices.iter().enumerate() {
        (cross.locations[v as usize], cross.positions[v as usize]) = (part.locations[k], part.positions[k]);
    }
}

fn corners(mesh: &TriMesh, triangle: &[u32; 3]) -> [Vec3; 3] {
    triangle.map(|v| mesh.positions[v as usize])
}

/// Faces with the shape that each would have.
#[derive(Debug)]
pub struct Faces<'a> {
    /// Corners, as vertices of the map.
    pub triangles: &'a [[u32; 3]],
    /// The corners of each in the plane, turned as they are to lie on the input.
    pub rest: Vec<[[f64; 2]; 3]>,
    /// How far above that plane the corners of each keep; empty where all lie in it.
    pub heights: Vec<[f64; 3]>,
    /// Whether a vertex stays.
    pub fixed: Vec<bool>,
    /// The area in the plane for which the input has room: each point counted once.
    pub area: f64,
}

/// Moves vertices along the mesh of `input` until the faces have the shapes that they would have.
pub fn settle(faces: Faces<'_>, cross: &mut CrossMap, input: &Chart, options: &PolishOptions) {
    let Some(mut state) = State::new(faces, cross, input, options) else { return };
    for _ in 0..options.rounds {
        if !state.round(cross, input) {
            break;
        }
    }
}

struct State<'a> {
    triangles: &'a [[u32; 3]],
    options: &'a PolishOptions,
    /// As in [`Faces::rest`], and the cotangents of the angles.
    rest: Vec<[[f64; 2]; 3]>,
    heights: Vec<[f64; 3]>,
    cotangents: Vec<[f64; 3]>,
    /// √(area₂/area₁).
    size: f64,
    fixed: Vec<bool>,
    start: Vec<Vec3>,
    masses: Vec<f64>,
    pattern: Pattern,
    vertex_normals: Vec<Vec3>,
    step_max: f64,
}

impl<'a> State<'a> {
    fn new(faces: Faces<'a>, cross: &CrossMap, input: &Chart, options: &'a PolishOptions) -> Option<Self> {
        let (n, triangles, rest) = (cross.positions.len(), faces.triangles, faces.rest);
        let cotangents: Vec<[f64; 3]> = rest.iter().map(cotangents).collect();
        let fixed: Vec<bool> = (0..2 * n).map(|i| faces.fixed[i / 2]).collect();
        let mut masses = vec![0.0; n];
        for (t, corners) in triangles.iter().enumerate() {
            for k in 0..3 {
                masses[corners[(k + 1) % 3] as usize] += cotangents[t][k];
                masses[corners[(k + 2) % 3] as usize] += cotangents[t][k];
            }
        }
        let pairs = triangles.iter().flat_map(|t| (0..3).flat_map(move |k| couplings(t[k], t[(k + 1) % 3])));
        let own = (0..n as u32).map(|v| (2 * v, 2 * v + 1));
        let pattern = Pattern::new(2 * n, pairs.chain(own)).ok()?;
        let size = (input.mesh.total_area() / faces.area).sqrt();
        let length: f64 = rest.iter().flat_map(|p| (0..3).map(|k| length(difference(p[(k + 1) % 3], p[k])))).sum();
        let step_max = options.step_max * size * length / (3 * rest.len()).max(1) as f64;
        let (start, vertex_normals) = (cross.positions.clone(), vertex_normals(&input.mesh));
        Some(Self {
            triangles,
            options,
            rest,
            heights: faces.heights,
            cotangents,
            size,
            fixed,
            start,
            masses,
            pattern,
            vertex_normals,
            step_max,
        })
    }

    /// One local and one global step; whether to go on.
    fn round(&mut self, cross: &mut CrossMap, input: &Chart) -> bool {
        let n = cross.positions.len();
        let normals: Vec<Vec3> = cross.locations.iter().map(|l| self.normal(input, *l)).collect();
        let frames: Vec<[Vec3; 2]> = normals.iter().map(|n| axes(*n)).collect();
        let mut diagonal = vec![0.0; 2 * n];
        let mut entries: Vec<(u32, u32, f64)> = Vec::with_capacity(self.triangles.len() * 12);
        let mut right = vec![0.0; 2 * n];
        for (t, corners) in self.triangles.iter().enumerate() {
            let targets = self.targets(t, corners, cross, &normals);
            for k in 0..3 {
                let (a, b) = (corners[(k + 1) % 3] as usize, corners[(k + 2) % 3] as usize);
                let w = self.cotangents[t][k];
                // Residual of edge a → b: what is missing.
                let r = targets[k] - (cross.positions[b] - cross.positions[a]);
                for i in 0..2 {
                    right[2 * b + i] += w * frames[b][i].dot(&r);
                    right[2 * a + i] -= w * frames[a][i].dot(&r);
                    diagonal[2 * a + i] += w;
                    diagonal[2 * b + i] += w;
                    for j in 0..2 {
                        entries.push(((2 * a + i) as u32, (2 * b + j) as u32, -w * frames[a][i].dot(&frames[b][j])));
                    }
                }
            }
        }
        for v in 0..n {
            let w = self.options.anchor * self.masses[v];
            let back = self.start[v] - cross.positions[v];
            for i in 0..2 {
                diagonal[2 * v + i] += w + 1e-9;
                right[2 * v + i] += w * frames[v][i].dot(&back);
            }
        }
        for (x, fixed) in right.iter_mut().zip(&self.fixed) {
            if *fixed {
                *x = 0.0;
            }
        }
        let Ok(factor) = self.pattern.factor(&diagonal, entries.into_iter(), &self.fixed) else { return false };
        factor.solve(&mut right);
        let mut moved = 0.0f64;
        for v in (0..n).filter(|&v| !self.fixed[2 * v]) {
            let mut step = frames[v][0] * right[2 * v] + frames[v][1] * right[2 * v + 1];
            let length = step.norm();
            if length > self.step_max {
                step *= self.step_max / length;
            }
            moved = moved.max(length / self.step_max);
            cross.locations[v] = walk(&input.mesh, cross.locations[v], step);
            cross.positions[v] = cross.locations[v].point(input);
        }
        moved > 0.01
    }

    /// Where each edge of a triangle (opposite to corner k) should point.
    fn targets(&self, t: usize, corners: &[u32; 3], cross: &CrossMap, normals: &[Vec3]) -> [Vec3; 3] {
        let normal = corners.iter().map(|&v| normals[v as usize]).sum::<Vec3>();
        let normal = normal.try_normalize(0.0).unwrap_or(normals[corners[0] as usize]);
        let plane = axes(normal);
        let heights = self.heights.get(t).copied().unwrap_or_default();
        let at = corners.map(|v| cross.positions[v as usize]);
        let mapped = at.map(|p| [(p - at[0]).dot(&plane[0]), (p - at[0]).dot(&plane[1])]);
        let (rotation, fit) = best_rotation(&self.rest[t], &mapped, &self.cotangents[t]);
        let free = (fit / self.size).clamp(1.0 / SIZE_RANGE, SIZE_RANGE).powf(self.options.size_freedom);
        let (c, s) = (self.size * free * rotation[0], self.size * free * rotation[1]);
        [0, 1, 2].map(|k| {
            let (a, b) = (self.rest[t][(k + 1) % 3], self.rest[t][(k + 2) % 3]);
            let e = [b[0] - a[0], b[1] - a[1]];
            let rise = heights[(k + 2) % 3] - heights[(k + 1) % 3];
            plane[0] * (c * e[0] - s * e[1]) + plane[1] * (s * e[0] + c * e[1]) + normal * rise
        })
    }

    fn normal(&self, input: &Chart, at: Location) -> Vec3 {
        normal_of(input, &self.vertex_normals, at)
    }
}

/// The input's normal at a place, from those of its vertices.
fn normal_of(input: &Chart, vertex_normals: &[Vec3], at: Location) -> Vec3 {
    let corners = input.mesh.triangles[at.triangle as usize];
    let sum: Vec3 = (0..3).map(|k| vertex_normals[corners[k] as usize] * at.barycentric[k]).sum();
    sum.try_normalize(0.0).unwrap_or(vertex_normals[corners[0] as usize])
}

/// Unknowns of two vertices that meet in an edge.
fn couplings(a: u32, b: u32) -> [(u32, u32); 4] {
    [(2 * a, 2 * b), (2 * a, 2 * b + 1), (2 * a + 1, 2 * b), (2 * a + 1, 2 * b + 1)]
}

/// cos and sin of the rotation that carries `rest` to `mapped` best, and the size that does so with it.
fn best_rotation(rest: &[[f64; 2]; 3], mapped: &[[f64; 2]; 3], weights: &[f64; 3]) -> ([f64; 2], f64) {
    let (mut dot, mut cross, mut norm) = (0.0, 0.0, 0.0);
    for k in 0..3 {
        let edge = |p: &[[f64; 2]; 3]| {
            let (a, b) = (p[(k + 1) % 3], p[(k + 2) % 3]);
            [b[0] - a[0], b[1] - a[1]]
        };
        let (e, f) = (edge(rest), edge(mapped));
        dot += weights[k] * (e[0] * f[0] + e[1] * f[1]);
        cross += weights[k] * (e[0] * f[1] - e[1] * f[0]);
        norm += weights[k] * (e[0] * e[0] + e[1] * e[1]);
    }
    let length = dot.hypot(cross);
    if length <= 0.0 || norm <= 0.0 {
        return ([1.0, 0.0], 0.0);
    }
    ([dot / length, cross / length], length / norm)
}

/// A triangle laid flat; mirrored if `mirror` is negative.
pub fn flat(p: [Vec3; 3], mirror: f64) -> [[f64; 2]; 3] {
    let (e, f) = (p[1] - p[0], p[2] - p[0]);
    let length = e.norm();
    let along = if length > 0.0 { e.dot(&f) / length } else { 0.0 };
    [[0.0, 0.0], [length, 0.0], [along, mirror * (f.norm_squared() - along * along).max(0.0).sqrt()]]
}

fn cotangents(p: &[[f64; 2]; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let (e, f) = (difference(p[(k + 1) % 3], p[k]), difference(p[(k + 2) % 3], p[k]));
        let area = (e[0] * f[1] - e[1] * f[0]).abs().max(1e-300);
        (0.5 * (e[0] * f[0] + e[1] * f[1]) / area).clamp(COTANGENT_RANGE[0], COTANGENT_RANGE[1])
    })
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn length(a: [f64; 2]) -> f64 {
    a[0].hypot(a[1])
}

/// Two directions that span the plane with this unit normal.
fn axes(normal: Vec3) -> [Vec3; 2] {
    let other = if normal.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    let x = other.cross(&normal).try_normalize(0.0).unwrap_or_else(Vec3::x);
    [x, normal.cross(&x)]
}

fn vertex_normals(mesh: &TriMesh) -> Vec<Vec3> {
    mesh.vertex_area_vectors().into_iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vec3::z)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::bvh::Bvh;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    /// A grid laid on a finer one with its inner vertices shaken.
    fn shaken() -> (TriMesh, Chart, CrossMap) {
        let mesh = grid(14, 14, false, false);
        let chart =
            unfold(&whole(&grid(33, 33, false, false)).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let boundary = mesh.boundary_vertices();
        let shake = |v: usize| {
            let (sin, cos) = (v as f64 * 2.4).sin_cos();
            mesh.positions[v] + if boundary[v] { Vec3::zeros() } else { Vec3::new(0.03 * cos, 0.03 * sin, 0.0) }
        };
        let locations: Vec<Location> = (0..mesh.positions.len()).map(|v| bvh.closest(shake(v)).into()).collect();
        let positions = locations.iter().map(|l| l.point(&chart)).collect();
        (mesh, chart, CrossMap { locations, positions })
    }

    fn off(mesh: &TriMesh, cross: &CrossMap) -> f64 {
        mesh.positions.iter().zip(&cross.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn a_shaken_map_of_a_sheet_onto_itself_comes_to_rest() {
        let (mesh, chart, mut cross) = shaken();
        let before = off(&mesh, &cross);
        let options = PolishOptions { anchor: 0.0, ..PolishOptions::default() };
        polish(&mesh, &mut cross, &chart, 1.0, &options);
        assert!(off(&mesh, &cross) < 0.05 * before, "{before} became {}", off(&mesh, &cross));
    }

    #[test]
    fn within_the_boundary_all_comes_to_rest_as_it_does_alone_and_what_is_fixed_stays() {
        let (mesh, chart, cross) = shaken();
        let options = PolishOptions { step_max: 100.0, ..PolishOptions::default() };
        let bvh = Bvh::new(&chart.mesh);
        let locations: Vec<Location> = mesh.positions.iter().map(|p| bvh.closest(*p).into()).collect();
        let whole = CrossMap { positions: mesh.positions.clone(), locations };
        let polished = |fixed: &[bool]| {
            let mut within = cross.clone();
            polish_within(&mesh, &whole, &mut within, &chart, fixed, &options);
            within
        };
        let mut all = cross.clone();
        polish(&mesh, &mut all, &chart, 1.0, &options);
        let within = polished(&mesh.boundary_vertices());
        assert!(all.positions.iter().zip(&within.positions).all(|(a, b)| (a - b).norm() < 1e-9));
        let fixed: Vec<bool> = mesh.positions.iter().map(|p| p.x < 0.5).collect();
        let half = polished(&fixed);
        let moved = |v: usize| half.positions[v] != cross.positions[v];
        assert!((0..fixed.len()).all(|v| !fixed[v] || !moved(v)) && (0..fixed.len()).any(moved));
        assert_eq!(polished(&vec![true; fixed.len()]), cross);
    }

    #[test]
    fn the_boundary_stays_and_every_vertex_stays_on_the_surface() {
        let (mesh, chart, mut cross) = shaken();
        polish(&mesh, &mut cross, &chart, 1.0, &PolishOptions::default());
        for (v, on) in mesh.boundary_vertices().iter().enumerate() {
            assert!((cross.locations[v].point(&chart) - cross.positions[v]).norm() < 1e-12);
            assert!(!on || (cross.positions[v] - mesh.positions[v]).norm() < 1e-9);
        }
    }
}
