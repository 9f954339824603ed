//! Cutting polygons into triangles with phantom edges.
//!
//! A diagonal must not be an edge already: two neighbouring polygons that share two vertices would else share a diagonal,
//! and a manifold mesh would become non-manifold. *Source:* paper §6 (phantom edges). *Ours, not the paper's:* quads take
//! the diagonal with the better-shaped worse triangle; larger polygons are cut by their ears; where every diagonal is an
//! edge already, the polygon is cut from a new vertex at its centre.

use super::ears::{self, Point};
use super::surface::{CornerRows, edge_key};
use super::umbrella::Vertices;
use crate::mesh::Vec3;
use crate::mesh::error::MeshError;
use crate::mesh::repair::{RepairKind, Repairs};
use std::collections::HashSet;

/// Triangles with what is known of them.
#[derive(Default)]
pub(super) struct Triangles {
    pub(super) corners: Vec<[u32; 3]>,
    /// Whether the edge from each corner to the next is a phantom.
    pub(super) phantom: Vec<[bool; 3]>,
    /// Face of the upload.
    pub(super) face_of: Vec<u32>,
}

/// Cuts every row; new vertices are appended to `vertices.positions`.
///
/// # Errors
/// [`MeshError::FaceRepeats`] for a polygon that runs through a vertex twice and cannot be cut.
pub(super) fn cut(
    surface: &CornerRows,
    vertices: &mut Vertices,
    repairs: &mut Repairs,
) -> Result<Triangles, MeshError> {
    let mut cutter = Cutter { edges: Edges::new(surface, vertices), triangles: Triangles::default() };
    for r in 0..surface.rows.len() {
        let start = surface.rows.start(r);
        let row = &vertices.of_corner[start..start + surface.rows.face(r).len()];
        let face = surface.face_of[r];
        let done = match *row {
            [a, b, c] => cutter.triangle([a, b, c], face),
            [a, b, c, d] => cutter.quad([a, b, c, d], &vertices.positions, face),
            _ => cutter.polygon(row, &vertices.positions, face),
        };
        if !done {
            let repeated = repeated(row).map(|k| surface.rows.face(r)[k]);
            if let Some(vertex) = repeated {
                return Err(MeshError::FaceRepeats { face, vertex });
            }
            let centre = row.iter().map(|v| vertices.positions[*v as usize]).sum::<Vec3>() / row.len() as f64;
            vertices.positions.push(centre);
            cutter.centred(row, vertices.positions.len() as u32 - 1, face);
            repairs.note(RepairKind::CentredFaces, face);
        }
    }
    Ok(cutter.triangles)
}

/// Index of a corner whose vertex comes again.
fn repeated(row: &[u32]) -> Option<usize> {
    let mut seen = HashSet::with_capacity(row.len());
    row.iter().position(|v| !seen.insert(*v))
}

/// The edges there are.
struct Edges {
    /// Those of the polygons, sorted.
    given: Vec<u64>,
    /// Those added since.
    added: HashSet<u64>,
}

impl Edges {
    fn new(surface: &CornerRows, vertices: &Vertices) -> Self {
        let key = |c: u32| edge_key(vertices.of_corner[c as usize], vertices.of_corner[surface.next(c) as usize]);
        let mut given = Vec::new();
        if surface.rows.iter().any(|row| row.len() > 3) {
            let once = |c: &u32| surface.twins[*c as usize] == u32::MAX || surface.twins[*c as usize] > *c;
            given = (0..surface.corner_count()).filter(once).map(key).collect();
            given.sort_unstable();
        }
        Self { given, added: HashSet::new() }
    }

    fn is_free(&self, a: u32, b: u32) -> bool {
        let key = edge_key(a, b);
        a != b && self.given.binary_search(&key).is_err() && !self.added.contains(&key)
    }

    fn add(&mut self, a: u32, b: u32) {
        self.added.insert(edge_key(a, b));
    }
}

struct Cutter {
    edges: Edges,
    triangles: Triangles,
}

impl Cutter {
    fn triangle(&mut self, corners: [u32; 3], face: u32) -> bool {
        let [a, b, c] = corners;
        let proper = a != b && b != c && c != a;
        if proper {
            self.push(corners, [false; 3], face);
        }
        proper
    }

    fn push(&mut self, corners: [u32; 3], phantom: [bool; 3], face: u32) {
        self.triangles.corners.push(corners);
        self.triangles.phantom.push(phantom);
        self.triangles.face_of.push(face);
    }

    fn quad(&mut self, row: [u32; 4], positions: &[Vec3], face: u32) -> bool {
        let [p, q, r, s] = row.map(|v| positions[v as usize]);
        let normal = (r - p).cross(&(s - q));
        let quality = |t: [Vec3; 3]| shape(t, &normal);
        let first = quality([p, q, r]).min(quality([p, r, s]));
        let second = quality([q, r, s]).min(quality([q, s, p]));
        let [a, b, c, d] = row;
        let turned = [b, c, d, a];
        // Ties, as in squares, go to the diagonal from the first corner.
        let order = if second > first + 1e-9 * first.abs() { [turned, row] } else { [row, turned] };
        for [a, b, c, d] in order {
            if self.edges.is_free(a, c) && a != b && b != c && c != d && d != a && b != d {
                self.edges.add(a, c);
                self.push([a, b, c], [false, false, true], face);
                self.push([a, c, d], [true, false, false], face);
                return true;
            }
        }
        false
    }

    fn polygon(&mut self, row: &[u32], positions: &[Vec3], face: u32) -> bool {
        let n = row.len();
        let points = flattened(row, positions);
        let edges = std::cell::RefCell::new(&mut self.edges);
        let mut taken = Vec::new();
        let triangles = ears::cut(
            &points,
            |a, b| edges.borrow().is_free(row[a], row[b]),
            |a, b| {
                edges.borrow_mut().add(row[a], row[b]);
                taken.push([row[a], row[b]]);
            },
        );
        let proper = |t: &[usize; 3]| row[t[0]] != row[t[1]] && row[t[1]] != row[t[2]] && row[t[2]] != row[t[0]];
        let Some(triangles) = triangles.filter(|triangles| triangles.iter().all(proper)) else {
            for [a, b] in taken {
                self.edges.added.remove(&edge_key(a, b));
            }
            return false;
        };
        for t in triangles {
            let phantom = [0, 1, 2].map(|k| (t[k] + 1) % n != t[(k + 1) % 3]);
            self.push(t.map(|k| row[k]), phantom, face);
        }
        true
    }

    /// Cuts a row from a vertex at its centre.
    fn centred(&mut self, row: &[u32], centre: u32, face: u32) {
        for (a, b) in row.iter().zip(row.iter().cycle().skip(1)) {
            self.push([*a, *b, centre], [false, true, true], face);
        }
    }
}

/// How well-shaped a triangle is, seen along `normal`: 1 equilateral, 0 flat, negative inverted.
fn shape([a, b, c]: [Vec3; 3], normal: &Vec3) -> f64 {
    let (length, cross) = (normal.norm(), (b - a).cross(&(c - a)));
    let sides = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
    if sides <= 0.0 {
        return 0.0;
    }
    let area = if length > 0.0 { cross.dot(normal) / length } else { cross.norm() };
    // 2√3: an equilateral triangle of side 1 has a cross product of √3/2 and sides of 3.
    2.0 * 3f64.sqrt() * area / sides
}

/// The corners in the plane of the polygon (Newell's normal), counter-clockwise, around the first corner.
fn flattened(row: &[u32], positions: &[Vec3]) -> Vec<Point> {
    let at = |k: usize| positions[row[k % row.len()] as usize] - positions[row[0] as usize];
    let normal: Vec3 = (0..row.len()).map(|k| at(k).cross(&at(k + 1))).sum();
    let axis = normal.iamax();
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let sign = if normal[axis] < 0.0 { -1.0 } else { 1.0 };
    (0..row.len()).map(|k| [sign * at(k)[u], at(k)[v]]).collect()
}
