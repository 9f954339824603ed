//! What a composed mesh must be, as a list of theorems.
//!
//! Quads only, of four distinct corners; each directed edge at most once (so it is oriented, and no edge has more than
//! two faces); each vertex one fan; no inner vertex of two edges; no face without area; finite; and components, boundary
//! loops and Euler characteristic as asked. *Source:* paper §6 (quad-only, manifold).

use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, Vec3, diagonal};
use crate::topology;

/// A face whose area is below this share of the squared diagonal of the mesh has none.
const AREA_MIN: f64 = 1e-13;

/// The topology that a composition must have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopologyCounts {
    /// Connected components.
    pub components: usize,
    /// Boundary loops.
    pub boundary_loops: usize,
    /// V − E + F.
    pub euler: i64,
}

impl TopologyCounts {
    /// That of a surface.
    pub fn of(mesh: &TriMesh) -> Self {
        let found = topology::invariants(mesh);
        let components = topology::components(mesh).1;
        Self { components, boundary_loops: found.boundary_loops, euler: found.euler }
    }
}

/// The first theorem that a mesh breaks.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Broken {
    /// A face is no quad.
    #[error("expected quads, found a face {face} of {corners} corners")]
    NoQuad {
        /// The face.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// A face has a corner twice, or one that is no vertex.
    #[error("expected four distinct vertices, found face {0} with one twice or missing")]
    Corner(usize),
    /// Two faces run along an edge the same way.
    #[error("expected an oriented manifold, found two faces from vertex {0} to {1}")]
    EdgeTwice(u32, u32),
    /// The faces at a vertex form several fans.
    #[error("expected one fan of faces a vertex, found several at {0}")]
    Pinched(u32),
    /// No face uses a vertex.
    #[error("expected every vertex in a face, found {0} in none")]
    Unused(u32),
    /// An inner vertex has two edges.
    #[error("expected no doublet, found one at vertex {0}")]
    Doublet(u32),
    /// A face has no area.
    #[error("expected faces with an area, found face {0} without")]
    NoArea(usize),
    /// A position is no number.
    #[error("expected finite positions, found vertex {0} without one")]
    NotFinite(u32),
    /// Not the topology asked for.
    #[error("expected {expected:?}, found {found:?}")]
    Shape {
        /// What was asked for.
        expected: TopologyCounts,
        /// What is there.
        found: TopologyCounts,
    },
}

/// Edges of a mesh as sorted (low, high, face, whether it runs low → high).
fn edges(mesh: &PolyMesh) -> Vec<(u32, u32, u32, u8)> {
    let mut all = Vec::with_capacity(mesh.faces.corners().len());
    for (f, c) in mesh.faces.iter().enumerate() {
        for k in 0..c.len() {
            let (a, b) = (c[k], c[(k + 1) % c.len()]);
            all.push((a.min(b), a.max(b), f as u32, u8::from(a < b)));
        }
    }
    all.sort_unstable();
    all
}

/// Whether every edge has at most two faces, which run along it in opposite ways.
pub fn edges_are_sound(mesh: &PolyMesh) -> bool {
    edges(mesh).chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)).all(|run| match run {
        [_] => true,
        [x, y] => x.3 != y.3,
        _ => false,
    })
}

fn find(parent: &mut [u32], mut x: u32) -> u32 {
    while parent[x as usize] != x {
        parent[x as usize] = parent[parent[x as usize] as usize];
        x = parent[x as usize];
    }
    x
}

fn groups(parent: &mut [u32], of: impl Iterator<Item = u32>) -> usize {
    let mut roots: Vec<u32> = of.map(|x| find(parent, x)).collect();
    roots.sort_unstable();
    roots.dedup();
    roots.len()
}

/// Checks the theorems on connectivity and topology; [`check`] adds those on geometry.
///
/// # Errors
/// The first [`Broken`] theorem.
pub fn check_structure(mesh: &PolyMesh, expected: TopologyCounts) -> Result<(), Broken> {
    let n = mesh.positions.len();
    for (face, c) in mesh.faces.iter().enumerate() {
        if c.len() != 4 {
            return Err(Broken::NoQuad { face, corners: c.len() });
        }
        if c.iter().enumerate().any(|(k, v)| *v as usize >= n || c[..k].contains(v)) {
            return Err(Broken::Corner(face));
        }
    }
    let edges = edges(mesh);
    let (mut degree, mut on_border) = (vec![0u32; n], vec![false; n]);
    let mut vertex_roots: Vec<u32> = (0..n as u32).collect();
    let mut border_roots = vertex_roots.clone();
    let mut distinct = 0;
    for run in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        let (a, b, _, way) = run[0];
        match run {
            [_] => {
                on_border[a as usize] = true;
                on_border[b as usize] = true;
                let (x, y) = (find(&mut border_roots, a), find(&mut border_roots, b));
                border_roots[x as usize] = y;
            }
            [_, other] if other.3 != way => {}
            _ => return Err(Broken::EdgeTwice(a, b)),
        }
        distinct += 1;
        degree[a as usize] += 1;
        degree[b as usize] += 1;
        let (x, y) = (find(&mut vertex_roots, a), find(&mut vertex_roots, b));
        vertex_roots[x as usize] = y;
    }
    one_fan_each(mesh, &degree, &on_border)?;
    let border: Vec<u32> = (0..n as u32).filter(|&v| on_border[v as usize]).collect();
    let found = TopologyCounts {
        components: groups(&mut vertex_roots, 0..n as u32),
        boundary_loops: groups(&mut border_roots, border.into_iter()),
        euler: n as i64 - distinct + mesh.faces.len() as i64,
    };
    if found == expected { Ok(()) } else { Err(Broken::Shape { expected, found }) }
}

/// With E edges at a vertex of F faces in one fan: E = F inside, E = F + 1 on a boundary. Every further fan, closed or
/// open, is told by walking one.
fn one_fan_each(mesh: &PolyMesh, degree: &[u32], on_border: &[bool]) -> Result<(), Broken> {
    let mut faces_at: Vec<Vec<[u32; 2]>> = vec![Vec::new(); mesh.positions.len()];
    for c in mesh.faces.iter() {
        for k in 0..4 {
            faces_at[c[k] as usize].push([c[(k + 3) % 4], c[(k + 1) % 4]]);
        }
    }
    for (v, wedges) in faces_at.iter().enumerate() {
        let Some(first) = wedges.first() else { return Err(Broken::Unused(v as u32)) };
        let start = wedges.iter().find(|w| !wedges.iter().any(|x| x[0] == w[1])).unwrap_or(first);
        let (mut end, mut reached) = (start[0], 1);
        while let Some(w) = wedges.iter().find(|w| w[1] == end && *w != start) {
            end = w[0];
            reached += 1;
            if reached > wedges.len() {
                break;
            }
        }
        if reached != wedges.len() {
            return Err(Broken::Pinched(v as u32));
        }
        if degree[v] == 2 && !on_border[v] {
            return Err(Broken::Doublet(v as u32));
        }
    }
    Ok(())
}

/// Checks all theorems.
///
/// # Errors
/// The first [`Broken`] theorem.
pub fn check(mesh: &PolyMesh, expected: TopologyCounts) -> Result<(), Broken> {
    check_structure(mesh, expected)?;
    if let Some(v) = mesh.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(Broken::NotFinite(v as u32));
    }
    let flat = flat_faces(mesh);
    flat.first().map_or(Ok(()), |&f| Err(Broken::NoArea(f)))
}

/// The quads of a mesh that have no area.
pub fn flat_faces(mesh: &PolyMesh) -> Vec<usize> {
    let least = no_area(diagonal(&mesh.positions));
    let area = |c: &[u32]| <[u32; 4]>::try_from(c).map(|c| quad_area(c.map(|v| mesh.positions[v as usize])));
    let faces = mesh.faces.iter().enumerate();
    faces.filter(|(_, c)| area(c).is_ok_and(|area| area <= least)).map(|(f, _)| f).collect()
}

/// The area up to which a face of a mesh of so long a diagonal has none.
pub fn no_area(diagonal: f64) -> f64 {
    AREA_MIN * diagonal.powi(2)
}

/// Normal of a quad, as long as its area.
pub fn quad_area_vector(p: [Vec3; 4]) -> Vec3 {
    0.5 * (p[2] - p[0]).cross(&(p[3] - p[1]))
}

/// Length of the area vector of a quad.
pub fn quad_area(p: [Vec3; 4]) -> f64 {
    quad_area_vector(p).norm()
}

/// Inner vertices of a polygon mesh with another number of edges than four.
pub fn extraordinary(mesh: &PolyMesh) -> usize {
    let (mut degree, mut on_border) = (vec![0u32; mesh.positions.len()], vec![false; mesh.positions.len()]);
    for run in edges(mesh).chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        for v in [run[0].0, run[0].1] {
            degree[v as usize] += 1;
            on_border[v as usize] |= run.len() == 1;
        }
    }
    degree.iter().zip(&on_border).filter(|(d, b)| **d > 0 && **d != 4 && !**b).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::{Net, tests::sheet};

    const DISC: TopologyCounts = TopologyCounts { components: 1, boundary_loops: 1, euler: 1 };

    fn checked(net: Net, shape: TopologyCounts) -> Result<(), Broken> {
        check(&net.into_mesh().0, shape)
    }

    #[test]
    fn a_sheet_passes_as_a_disc_and_as_nothing_else() {
        assert_eq!(checked(sheet(3, 2), DISC), Ok(()));
        let other = TopologyCounts { boundary_loops: 2, ..DISC };
        assert!(matches!(checked(sheet(3, 2), other), Err(Broken::Shape { .. })));
    }

    #[test]
    fn each_theorem_bites() {
        let broken = |change: fn(&mut Net)| {
            let mut net = sheet(3, 3);
            change(&mut net);
            checked(net, DISC).expect_err("broken on purpose")
        };
        assert!(matches!(broken(|n| n.set_face(0, vec![0, 1, 5])), Broken::NoQuad { face: 0, corners: 3 }));
        assert_eq!(broken(|n| n.set_face(0, vec![0, 1, 5, 1])), Broken::Corner(0));
        assert_eq!(broken(|n| n.set_face(0, vec![0, 4, 5, 1])), Broken::EdgeTwice(1, 5));
        assert_eq!(
            broken(|n| {
                n.remove_face(1);
                n.remove_face(3);
                n.remove_face(7);
                n.remove_face(5);
            }),
            Broken::Pinched(5)
        );
        assert_eq!(broken(|n| n.positions[5].x = f64::NAN), Broken::NotFinite(5));
        assert_eq!(broken(|n| (0..16).for_each(|v| n.positions[v].y = 0.0)), Broken::NoArea(0));
        assert_eq!(
            broken(|n| {
                let v = n.add_vertex(Vec3::new(0.5, 0.5, 0.0));
                n.set_face(0, vec![0, 1, 5, v]);
                n.add_face(vec![0, v, 5, 4]);
            }),
            Broken::Doublet(16)
        );
    }
}
