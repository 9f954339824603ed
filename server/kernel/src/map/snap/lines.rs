//! The sharp edges of a surface, as lines: chains of edges, with the corners where they meet, end or turn.
//!
//! An edge is sharp where the surface bends by [`SHARP_DEG`] along it, between its two triangles and also where each side's
//! normal is the mean over the triangles around that can be reached without crossing a bent edge. Lines shorter than [`LENGTH_MIN`] are none: a scan's
//! noise bends single edges, and doesn't do so in a row.

use std::collections::{BTreeMap, BTreeSet};

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};
use crate::topology::holes::is_filling;

/// Bend that makes an edge sharp, in degrees.
const SHARP_DEG: f64 = 40.0;
/// Bend at which an edge ends the neighbourhood over which normals are averaged, in degrees.
const BENT_DEG: f64 = 25.0;
/// Triangles of a side's neighbourhood at most.
const NEIGHBOURHOOD: usize = 10;
/// Least length of a connected line, in √area.
const LENGTH_MIN: f64 = 0.08;
/// Least number of edges of a connected line.
const EDGES_MIN: usize = 5;
/// A line has a corner where it turns by this, in degrees.
const CORNER_DEG: f64 = 50.0;
/// With more sharp edges than this share of all edges, the surface is rough or faceted, and has no lines.
const SHARE_MAX: f64 = 0.2;

/// Sharp edges, connected.
#[derive(Clone, Debug, Default)]
pub struct SharpLines {
    /// A halfedge of each edge.
    pub edges: Vec<u32>,
    /// Vertices on the lines, with their neighbours along them.
    pub neighbours: BTreeMap<u32, Vec<u32>>,
    /// By how much the surface bends at each edge, in degrees: positive along a ridge, negative along a valley.
    pub bends: Vec<f64>,
    /// The same at each vertex: the mean of its edges.
    pub bend_at: BTreeMap<u32, f64>,
    /// Vertices where lines meet, end or turn.
    pub corners: BTreeSet<u32>,
}

impl SharpLines {
    /// The lines of a surface. `given` edges are sharp whatever the surface does there.
    pub fn of(mesh: &TriMesh, given: &[[u32; 2]]) -> Self {
        let mut sharp = sharp_edges(mesh, given);
        if sharp.len() as f64 > SHARE_MAX * mesh.twins.len() as f64 / 2.0 {
            sharp.clear();
        }
        Self::connected(mesh, &sharp)
    }

    /// Lines of given edges, the short ones left out.
    fn connected(mesh: &TriMesh, sharp: &[u32]) -> Self {
        let mut at: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for &h in sharp {
            at.entry(mesh.tail(h)).or_default().push(h);
            at.entry(mesh.head(h)).or_default().push(h);
        }
        let length_min = LENGTH_MIN * mesh.total_area().sqrt();
        let mut lines = Self::default();
        let mut seen = BTreeSet::new();
        for &start in sharp {
            if !seen.insert(start) {
                continue;
            }
            let mut line = vec![start];
            let mut next = 0;
            while let Some(&h) = line.get(next) {
                next += 1;
                for v in [mesh.tail(h), mesh.head(h)] {
                    line.extend(at.get(&v).into_iter().flatten().filter(|g| seen.insert(**g)));
                }
            }
            let length: f64 = line.iter().map(|&h| edge(mesh, h).norm()).sum();
            if line.len() >= EDGES_MIN && length >= length_min {
                lines.edges.extend(line);
            }
        }
        lines.edges.sort_unstable();
        lines.bends = lines.edges.iter().map(|&h| signed_bend(mesh, h)).collect();
        for (&h, &bend) in lines.edges.iter().zip(&lines.bends) {
            for v in [mesh.tail(h), mesh.head(h)] {
                *lines.bend_at.entry(v).or_insert(0.0) += bend;
            }
            lines.neighbours.entry(mesh.tail(h)).or_default().push(mesh.head(h));
            lines.neighbours.entry(mesh.head(h)).or_default().push(mesh.tail(h));
        }
        for (v, bend) in &mut lines.bend_at {
            *bend /= lines.neighbours.get(v).map_or(1.0, |around| around.len() as f64);
        }
        lines.corners =
            lines.neighbours.iter().filter(|(v, around)| is_corner(mesh, **v, around)).map(|(v, _)| *v).collect();
        lines
    }
}

/// The edges at which a surface bends sharply, and those `given`, as the lower halfedge of each; on noise there are some
/// too, in no row.
pub fn sharp_edges(mesh: &TriMesh, given: &[[u32; 2]]) -> Vec<u32> {
    let normals: Vec<Vec3> = (0..mesh.triangles.len()).map(|t| mesh.area_vector(t)).collect();
    let given: BTreeSet<[u32; 2]> = given.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
    let is_given = |h: u32| {
        let (a, b) = (mesh.tail(h), mesh.head(h));
        given.contains(&[a.min(b), a.max(b)])
    };
    let inner = |h: &u32| {
        let g = mesh.twin(*h);
        g != NONE && *h < g && !is_filling(mesh, *h / 3) && !is_filling(mesh, g / 3)
    };
    let bent = |h: u32| bend(normals[h as usize / 3], normals[mesh.twin(h) as usize / 3]) >= SHARP_DEG;
    (0..mesh.twins.len() as u32)
        .filter(inner)
        .filter(|&h| is_given(h) || (bent(h) && smooth_bend(mesh, &normals, h) >= SHARP_DEG))
        .collect()
}

/// Whether lines meet, end or turn at a vertex.
fn is_corner(mesh: &TriMesh, v: u32, around: &[u32]) -> bool {
    let [a, b] = *around else { return true };
    let at = |v: u32| mesh.positions[v as usize];
    bend(at(v) - at(a), at(b) - at(v)) >= CORNER_DEG
}

fn edge(mesh: &TriMesh, h: u32) -> Vec3 {
    mesh.positions[mesh.head(h) as usize] - mesh.positions[mesh.tail(h) as usize]
}

/// Angle between two directions, in degrees; 0 where one has no length.
pub fn bend(a: Vec3, b: Vec3) -> f64 {
    a.cross(&b).norm().atan2(a.dot(&b)).to_degrees()
}

/// Angle between the triangles at an edge, positive along a ridge.
fn signed_bend(mesh: &TriMesh, h: u32) -> f64 {
    let g = mesh.twin(h);
    if g == NONE {
        return 0.0;
    }
    let (left, right) = (mesh.area_vector(h as usize / 3), mesh.area_vector(g as usize / 3));
    bend(left, right).copysign(left.cross(&right).dot(&edge(mesh, h)))
}

/// Angle between the mean normals of an edge's sides.
fn smooth_bend(mesh: &TriMesh, normals: &[Vec3], h: u32) -> f64 {
    let side = |h: u32| {
        let mut around = vec![h / 3];
        let mut next = 0;
        while next < around.len() && around.len() < NEIGHBOURHOOD {
            let t = around[next];
            next += 1;
            for k in 0..3 {
                let g = mesh.twin(3 * t + k);
                let flat = g != NONE && bend(normals[t as usize], normals[g as usize / 3]) < BENT_DEG;
                if flat && !around.contains(&(g / 3)) {
                    around.push(g / 3);
                }
            }
        }
        around.iter().map(|&t| normals[t as usize]).sum::<Vec3>()
    };
    bend(side(h), side(mesh.twin(h)))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A sheet folded upright along x = 1/2; `noise` shakes it, in edges.
    pub(in crate::map::snap) fn folded(n: u32, noise: f64) -> TriMesh {
        let mut mesh = grid(n, n, false, false);
        for (v, p) in mesh.positions.iter_mut().enumerate() {
            if p.x > 0.5 {
                *p = Vec3::new(0.5, p.y, p.x - 0.5);
            }
            let (sin, cos) = (v as f64 * 12.9898).sin_cos();
            *p += noise / f64::from(n) * Vec3::new((sin * 437.5).fract(), (cos * 375.3).fract(), (sin * 913.1).fract());
        }
        mesh
    }

    #[test]
    fn a_fold_is_a_line_with_two_ends() {
        let mesh = folded(20, 0.0);
        let lines = SharpLines::of(&mesh, &[]);
        assert_eq!((lines.edges.len(), lines.corners.len()), (20, 2));
        // The right half stands up: seen from above it is a valley.
        assert!(lines.bend_at.values().all(|bend| (bend + 90.0).abs() < 1e-9), "{:?}", lines.bend_at);
        assert!(lines.neighbours.keys().all(|&v| (mesh.positions[v as usize].x - 0.5).abs() < 1e-12));
    }

    #[test]
    fn noise_makes_no_lines_and_given_edges_are_lines() {
        let mut mesh = folded(20, 0.35);
        mesh.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x + p.z, p.y, 0.3 * (p.x * 40.0).fract() / 20.0));
        assert!(SharpLines::of(&mesh, &[]).edges.is_empty());
        let given: Vec<[u32; 2]> = (0..20).map(|k| [21 * k + 4, 21 * (k + 1) + 4]).collect();
        assert_eq!(SharpLines::of(&mesh, &given).edges.len(), 20);
    }
}
