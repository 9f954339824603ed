//! What a surface is: its components, boundary loops, genus, and the four primitives that can be unfolded.
//!
//! χ = V − E + F = 2 − 2g − b for one component of genus g with b boundary loops.
//! *Source:* paper §4.1 (discs, cylinders) and §5.1, Fig. 6 (spheres, tori).

pub mod form;
pub mod holes;
pub(crate) mod primitive;

use crate::numerics::stop;
use std::fmt;
use std::sync::Arc;

use crate::mesh::tri::{NONE, TriMesh, pair_halfedges};
pub use primitive::{Components, closed, gapped, primitive, with_gaps_filled, with_two_ends};

/// Below one triangle for so many vertices of the mesh, its triangles are looked at alone and not the mesh.
const SUBMESH_SMALL: usize = 16;

/// A surface that one chart can hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Topology {
    /// One boundary loop: one pole (v = 1), the boundary at v = 0.
    Disc,
    /// Two boundary loops at v = 0 and v = 1, no pole.
    Annulus,
    /// Closed, genus 0: two poles, at v = 0 and v = 1.
    Sphere,
    /// Closed, genus 1: periodic in u and v.
    Torus,
}

impl Topology {
    /// Whether its domain is periodic in v as well as in u.
    pub fn is_periodic_v(self) -> bool {
        self == Self::Torus
    }

    /// The word used on the wire and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Disc => "disc",
            Self::Annulus => "annulus",
            Self::Sphere => "sphere",
            Self::Torus => "torus",
        }
    }
}

impl fmt::Display for Topology {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Euler characteristic, boundary and genus of one component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Invariants {
    /// V − E + F.
    pub euler: i64,
    /// Number of boundary loops.
    pub boundary_loops: usize,
    /// Handles.
    pub genus: i64,
}

/// Why a surface is no primitive.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TopologyError {
    /// Nothing to unfold.
    #[error("expected a surface, found no triangle")]
    Empty,
    /// Several components.
    #[error("expected one connected surface, found {count} components (the largest has {largest} triangles)")]
    Components {
        /// How many.
        count: usize,
        /// Triangles of the largest.
        largest: usize,
    },
    /// One component, but not a disc, annulus, sphere or torus.
    #[error(
        "expected a disc, annulus, sphere or torus, found genus {} with {} boundary loops; cut it into such segments",
        .0.genus, .0.boundary_loops
    )]
    Unsupported(Invariants),
    /// The labels do not fit the mesh.
    #[error("expected one label for each of {expected} faces, found {found}")]
    LabelCount {
        /// Faces of the mesh.
        expected: usize,
        /// Labels given.
        found: usize,
    },
    /// A labelled segment is no primitive.
    #[error("segment {segment} (label {label}): {source}")]
    Segment {
        /// Its number among the segments.
        segment: usize,
        /// Its label.
        label: i64,
        /// What is wrong with it.
        source: Box<TopologyError>,
    },
}

/// A primitive cut from a mesh, ready to be unfolded.
#[derive(Clone, Debug)]
pub struct Patch {
    /// What it is.
    pub topology: Topology,
    /// Its own mesh; its parent's where it is all of that ([`crate::segment::Segmented::sharing`]).
    pub mesh: Arc<TriMesh>,
    /// Vertex of the parent mesh for each vertex of `mesh`.
    pub vertex_of: Vec<u32>,
    /// Triangle of the parent mesh for each triangle of `mesh`.
    pub triangle_of: Vec<u32>,
    /// Boundary loops (halfedges of `mesh`) that are filled when it is unfolded.
    pub holes: Vec<Vec<u32>>,
    /// Components of the parent mesh that were left out as small components beside this one.
    pub left_out: usize,
}

impl Patch {
    /// True if a boundary halfedge of the patch borders on another part of the parent mesh, rather than on nothing.
    pub fn borders_on_another(&self, parent: &TriMesh, halfedge: u32) -> bool {
        borders_on_another(parent, &self.triangle_of, halfedge)
    }
}

/// The same for any part of a mesh; `triangle_of` gives the parent's triangle for each of the part's. Triangles that fill a hole
/// have none.
pub fn borders_on_another(parent: &TriMesh, triangle_of: &[u32], halfedge: u32) -> bool {
    let in_parent = |t: &u32| parent.twin(3 * t + halfedge % 3) != NONE;
    triangle_of.get(halfedge as usize / 3).is_some_and(in_parent)
}

/// The connected sets of triangles of one label each, in order of their lowest triangle; each in order. Triangles that
/// share an edge are connected. `label_of` holds one label a triangle.
pub fn connected<L: PartialEq>(mesh: &TriMesh, label_of: &[L]) -> Vec<Vec<u32>> {
    connected_across(mesh, |a, b| label_of[a as usize] == label_of[b as usize])
}

/// The sets of triangles that are connected across edges, where `joins` says so of the two at an edge, in order of their
/// lowest triangle; each in order.
fn connected_across(mesh: &TriMesh, joins: impl Fn(u32, u32) -> bool) -> Vec<Vec<u32>> {
    let mut seen = vec![false; mesh.triangles.len()];
    let mut sets = Vec::new();
    for seed in 0..mesh.triangles.len() as u32 {
        if std::mem::replace(&mut seen[seed as usize], true) {
            continue;
        }
        let (mut set, mut next) = (vec![seed], 0);
        while let Some(&t) = set.get(next) {
            next += 1;
            stop::pass(1);
            for k in 0..3 {
                let g = mesh.twin(3 * t + k);
                if g == NONE || seen[g as usize / 3] || !joins(t, g / 3) {
                    continue;
                }
                seen[g as usize / 3] = true;
                set.push(g / 3);
            }
        }
        set.sort_unstable();
        sets.push(set);
    }
    sets
}

/// The components as sets of triangles; see [`connected`].
pub fn pieces(mesh: &TriMesh) -> Vec<Vec<u32>> {
    connected(mesh, &vec![(); mesh.triangles.len()])
}

/// A number for each of so many triangles: that of the set that holds it.
pub fn numbers(sets: &[Vec<u32>], triangles: usize) -> Vec<u32> {
    let mut of = vec![0; triangles];
    for (k, set) in sets.iter().enumerate() {
        set.iter().for_each(|&t| of[t as usize] = k as u32);
    }
    of
}

/// Component number of each triangle (numbered by lowest triangle), and how many there are.
pub fn components(mesh: &TriMesh) -> (Vec<u32>, usize) {
    let sets = pieces(mesh);
    (numbers(&sets, mesh.triangles.len()), sets.len())
}

/// Marks the triangles that share a vertex with one that is marked, so many times over.
pub fn widen(mesh: &TriMesh, marked: &mut [bool], rings: usize) {
    let mut touched = vec![false; mesh.positions.len()];
    for _ in 0..rings {
        for (corners, _) in mesh.triangles.iter().zip(marked.iter()).filter(|(_, marked)| **marked) {
            corners.iter().for_each(|&v| touched[v as usize] = true);
        }
        for (corners, marked) in mesh.triangles.iter().zip(marked.iter_mut()) {
            *marked |= corners.iter().any(|&v| touched[v as usize]);
        }
    }
}

/// Invariants of a connected mesh without isolated vertices.
pub fn invariants(mesh: &TriMesh) -> Invariants {
    let boundary_halfedges = mesh.twins.iter().filter(|&&g| g == NONE).count();
    let edges = (mesh.twins.len() + boundary_halfedges) / 2;
    let euler = mesh.positions.len() as i64 - edges as i64 + mesh.triangles.len() as i64;
    let boundary_loops = mesh.boundary_loops().len();
    Invariants { euler, boundary_loops, genus: (2 - boundary_loops as i64 - euler) / 2 }
}

/// The primitive that a connected mesh is.
///
/// # Errors
/// [`TopologyError`] for an empty mesh, several components, or another topology.
pub fn classify(mesh: &TriMesh) -> Result<Topology, TopologyError> {
    if mesh.triangles.is_empty() {
        return Err(TopologyError::Empty);
    }
    let (component, count) = components(mesh);
    if count > 1 {
        let mut sizes = vec![0; count];
        component.iter().for_each(|&c| sizes[c as usize] += 1);
        return Err(TopologyError::Components { count, largest: sizes.into_iter().max().unwrap_or(0) });
    }
    let found = invariants(mesh);
    with_ends(found, found.boundary_loops)
}

/// What a connected mesh is when so many of its loops are its ends and the others are filled.
fn with_ends(found: Invariants, ends: usize) -> Result<Topology, TopologyError> {
    match (found.genus, ends) {
        (0, 0) => Ok(Topology::Sphere),
        (0, 1) => Ok(Topology::Disc),
        (0, 2) => Ok(Topology::Annulus),
        (1, 0) => Ok(Topology::Torus),
        _ => Err(TopologyError::Unsupported(found)),
    }
}

/// The whole mesh as one patch.
///
/// # Errors
/// See [`classify`].
pub fn whole(mesh: &TriMesh) -> Result<Patch, TopologyError> {
    let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let (mesh, vertex_of) = submesh(mesh, &all);
    let topology = classify(&mesh)?;
    Ok(Patch { topology, mesh: Arc::new(mesh), vertex_of, triangle_of: all, holes: Vec::new(), left_out: 0 })
}

/// One patch a label, in order of label. `labels` holds one label a polygon.
///
/// # Errors
/// [`TopologyError::LabelCount`], or [`TopologyError::Segment`] naming the segment that is no primitive.
pub fn by_labels(mesh: &TriMesh, labels: &[i64]) -> Result<Vec<Patch>, TopologyError> {
    let faces = mesh.polygon_of.iter().max().map_or(0, |&f| f as usize + 1);
    if labels.len() < faces {
        return Err(TopologyError::LabelCount { expected: faces, found: labels.len() });
    }
    let mut distinct: Vec<i64> = mesh.polygon_of.iter().map(|&f| labels[f as usize]).collect();
    let of_triangle = distinct.clone();
    distinct.sort_unstable();
    distinct.dedup();
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); distinct.len()];
    for (t, label) in of_triangle.iter().enumerate() {
        if let Ok(s) = distinct.binary_search(label) {
            members[s].push(t as u32);
        }
    }
    let patch = |(segment, triangle_of): (usize, Vec<u32>)| {
        let (mesh, vertex_of) = submesh(mesh, &triangle_of);
        let topology = classify(&mesh).map_err(|source| TopologyError::Segment {
            segment,
            label: distinct[segment],
            source: Box::new(source),
        })?;
        Ok(Patch { topology, mesh: Arc::new(mesh), vertex_of, triangle_of, holes: Vec::new(), left_out: 0 })
    };
    members.into_iter().enumerate().map(patch).collect()
}

/// The mesh of some triangles, vertices renumbered in order; a vertex at which they meet only in a point is split.
/// Returns the parent vertex of each vertex beside it.
pub fn submesh(mesh: &TriMesh, triangles: &[u32]) -> (TriMesh, Vec<u32>) {
    stop::ask();
    let (mut vertex_of, corners) = renumbered(mesh, triangles);
    let twins = pair_halfedges(&corners).unwrap_or_else(|_| vec![NONE; 3 * corners.len()]);
    let phantom = triangles.iter().flat_map(|&t| (0..3).map(move |k| mesh.phantom[3 * t as usize + k])).collect();
    let polygon_of = triangles.iter().map(|&t| mesh.polygon_of[t as usize]).collect();
    let positions = vertex_of.iter().map(|&v| mesh.positions[v as usize]).collect();
    let mut part = TriMesh { positions, triangles: corners, twins, phantom, polygon_of };
    for copied in split_pinched(&mut part) {
        vertex_of.push(vertex_of[copied as usize]);
    }
    (part, vertex_of)
}

/// The vertices of some triangles, in order, and the triangles' corners as numbers among these. For a few triangles the
/// cost grows with them and not with the mesh: a mesh can have a component a triangle.
fn renumbered(mesh: &TriMesh, triangles: &[u32]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let corners = || triangles.iter().map(|&t| mesh.triangles[t as usize]);
    if triangles.len() < mesh.positions.len() / SUBMESH_SMALL {
        let mut vertex_of: Vec<u32> = corners().flatten().collect();
        vertex_of.sort_unstable();
        vertex_of.dedup();
        let number = |v: u32| vertex_of.partition_point(|&other| other < v) as u32;
        let corners = corners().map(|c| c.map(number)).collect();
        return (vertex_of, corners);
    }
    let mut number = vec![NONE; mesh.positions.len()];
    corners().flatten().for_each(|v| number[v as usize] = 0);
    let mut vertex_of = Vec::new();
    for (v, n) in number.iter_mut().enumerate().filter(|(_, n)| **n != NONE) {
        *n = vertex_of.len() as u32;
        vertex_of.push(v as u32);
    }
    let corners = corners().map(|c| c.map(|v| number[v as usize])).collect();
    (vertex_of, corners)
}

/// Gives each fan of faces around a vertex its own vertex; returns the vertex that each new one copies.
pub(crate) fn split_pinched(mesh: &mut TriMesh) -> Vec<u32> {
    let mut owner = vec![false; mesh.positions.len()];
    let mut seen = vec![false; mesh.twins.len()];
    let mut copies = Vec::new();
    for start in 0..mesh.twins.len() as u32 {
        if seen[start as usize] {
            continue;
        }
        let v = mesh.tail(start);
        let fan = fan_of(mesh, start);
        fan.iter().for_each(|&h| seen[h as usize] = true);
        if std::mem::replace(&mut owner[v as usize], true) {
            let copy = mesh.positions.len() as u32;
            mesh.positions.push(mesh.positions[v as usize]);
            owner.push(true);
            copies.push(v);
            fan.iter().for_each(|&h| mesh.triangles[h as usize / 3][h as usize % 3] = copy);
        }
    }
    copies
}

/// Outgoing halfedges of the fan of faces that holds `start`.
fn fan_of(mesh: &TriMesh, start: u32) -> Vec<u32> {
    use crate::mesh::tri::{next, prev};
    let mut fan = vec![start];
    let mut h = start;
    loop {
        h = mesh.twin(prev(h));
        if h == start {
            return fan;
        }
        if h == NONE {
            break;
        }
        fan.push(h);
    }
    h = start;
    while mesh.twin(h) != NONE {
        h = next(mesh.twin(h));
        fan.push(h);
    }
    fan
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::mesh::{PolyMesh, Vec3};
    use std::collections::BTreeMap;

    /// A sphere of n meridians and n rows, row by row from the north pole.
    pub(crate) fn ball(n: u32) -> TriMesh {
        let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(n);
        let point = |row: u32, k: u32| {
            let (t, u) = (0.5 * angle(row), angle(k));
            Vec3::new(t.sin() * u.cos(), t.sin() * u.sin(), t.cos())
        };
        let mut positions = vec![point(0, 0), point(n, 0)];
        positions.extend((1..n).flat_map(|row| (0..n).map(move |k| point(row, k))));
        let at = |row: u32, k: u32| match row {
            0 => 0,
            row if row == n => 1,
            row => 2 + (row - 1) * n + k % n,
        };
        let quads = (0..n).flat_map(|row| (0..n).map(move |k| (row, k)));
        let triangles = quads.flat_map(|(row, k)| {
            let [a, b, c, d] = [at(row, k), at(row + 1, k), at(row + 1, k + 1), at(row, k + 1)];
            [[a, b, c], [a, c, d]]
        });
        let proper = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
        TriMesh::from_triangles(positions, proper).expect("a sphere")
    }

    /// A grid of `n × m` quads wrapped as asked, cut into triangles; wrapping both ways gives a torus.
    pub(crate) fn grid(n: u32, m: u32, wrap_u: bool, wrap_v: bool) -> TriMesh {
        let (columns, rows) = (if wrap_u { n } else { n + 1 }, if wrap_v { m } else { m + 1 });
        let at = |i: u32, j: u32| (j % rows) * columns + i % columns;
        let mut positions = Vec::new();
        for j in 0..rows {
            for i in 0..columns {
                let (a, b) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(m));
                let (ta, tb) = (std::f64::consts::TAU * a, std::f64::consts::TAU * b);
                positions.push(match (wrap_u, wrap_v) {
                    (false, _) => Vec3::new(a, b, 0.0),
                    (true, false) => Vec3::new(ta.cos(), ta.sin(), 3.0 * b),
                    (true, true) => Vec3::new((2.0 + tb.cos()) * ta.cos(), (2.0 + tb.cos()) * ta.sin(), tb.sin()),
                });
            }
        }
        let mut triangles = Vec::new();
        for j in 0..m {
            for i in 0..n {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        TriMesh::from_triangles(positions, triangles).expect("a grid is manifold")
    }

    /// The surface of the solid cells of a grid, a quad a side.
    pub(crate) fn voxels(is_solid: &dyn Fn([i32; 3]) -> bool, size: [i32; 3]) -> PolyMesh {
        let (mut number, mut mesh) = (BTreeMap::<[i32; 3], u32>::new(), PolyMesh::default());
        let cells = (0..size[0]).flat_map(|x| (0..size[1]).flat_map(move |y| (0..size[2]).map(move |z| [x, y, z])));
        for (cell, axis, side) in cells
            .filter(|cell| is_solid(*cell))
            .flat_map(|cell| (0..6usize).map(move |k| (cell, k / 2, (k % 2) as i32)))
        {
            let mut beside = cell;
            beside[axis] += 2 * side - 1;
            if is_solid(beside) {
                continue;
            }
            let mut corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[du, dv]| {
                let mut p = cell;
                p[axis] += side;
                p[(axis + 1) % 3] += du;
                p[(axis + 2) % 3] += dv;
                *number.entry(p).or_insert_with(|| {
                    mesh.positions.push(Vec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2])));
                    mesh.positions.len() as u32 - 1
                })
            });
            if side == 0 {
                corners.reverse();
            }
            mesh.faces.push(&corners);
        }
        mesh
    }

    #[test]
    fn grids_are_classified_by_how_they_are_wrapped() {
        assert_eq!(classify(&grid(6, 5, false, false)), Ok(Topology::Disc));
        assert_eq!(classify(&grid(6, 5, true, false)), Ok(Topology::Annulus));
        assert_eq!(classify(&grid(6, 5, true, true)), Ok(Topology::Torus));
    }

    #[test]
    fn a_label_cuts_an_annulus_into_two() {
        let mesh = grid(8, 6, true, false);
        let labels: Vec<i64> = (0..mesh.triangles.len() as i64).map(|t| t / 48).collect();
        let patches = by_labels(&mesh, &labels).expect("two rings");
        assert_eq!(patches.iter().map(|p| p.topology).collect::<Vec<_>>(), [Topology::Annulus; 2]);
    }

    #[test]
    fn a_segment_in_two_pieces_is_named() {
        let mesh = grid(8, 6, true, false);
        let labels: Vec<i64> = (0..mesh.triangles.len() as i64).map(|t| (t / 32) % 2).collect();
        let error = by_labels(&mesh, &labels).expect_err("label 0 is in two pieces");
        assert!(error.to_string().contains("segment 0"), "{error}");
    }

    #[test]
    fn a_submesh_of_few_triangles_is_made_as_one_of_many() {
        let mesh = grid(40, 40, true, true);
        let few = [1_640, 7, 8, 9];
        let many: Vec<u32> = few.into_iter().chain(2_000..3_000).collect();
        for set in [&few[..], &many[..]] {
            let (part, vertex_of) = submesh(&mesh, set);
            for (corners, &t) in part.triangles.iter().zip(set) {
                assert_eq!(corners.map(|v| vertex_of[v as usize]), mesh.triangles[t as usize]);
            }
            let positions: Vec<Vec3> = vertex_of.iter().map(|&v| mesh.positions[v as usize]).collect();
            assert_eq!(part.positions, positions);
        }
    }

    #[test]
    fn rings_widen_over_vertices() {
        let mesh = grid(20, 20, false, false);
        let mut marked = vec![false; mesh.triangles.len()];
        marked[2 * (10 * 20 + 10)] = true;
        widen(&mesh, &mut marked, 2);
        let sets = connected(&mesh, &marked);
        let inside: Vec<&Vec<u32>> = sets.iter().filter(|set| marked[set[0] as usize]).collect();
        // Two rings about one triangle of a square: five squares by five without two of the corners' triangles each.
        assert_eq!(inside.len(), 1);
        assert_eq!(inside[0].len(), marked.iter().filter(|m| **m).count());
        assert!(inside[0].len() > 30 && inside[0].len() < 50, "{}", inside[0].len());
    }
}
