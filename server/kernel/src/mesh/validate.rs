//! What a [`TriMesh`] must satisfy, as a list of theorems. Written apart from the code that makes one.

use super::tri::{NONE, TriMesh, prev};

/// A theorem that does not hold, and the element for which it does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Violation {
    /// Arrays a halfedge or a triangle have another length.
    #[error("arrays of {0} entries do not belong to the triangles")]
    Length(usize),
    /// A triangle names a vertex that is not there.
    #[error("triangle {0} names a missing vertex")]
    Range(u32),
    /// A triangle names a vertex twice.
    #[error("triangle {0} names a vertex twice")]
    Degenerate(u32),
    /// A used position is not finite.
    #[error("vertex {0} has no finite position")]
    NotFinite(u32),
    /// A twin that is missing, that has another twin, or that runs the same way.
    #[error("halfedge {0} and its twin do not belong together")]
    Twin(u32),
    /// Two edges between the same vertices.
    #[error("halfedge {0} lies on an edge that exists twice")]
    EdgeTwice(u32),
    /// A phantom on the boundary, between different polygons, or on one side only.
    #[error("halfedge {0} cannot be a phantom as it is")]
    Phantom(u32),
    /// A vertex without a triangle.
    #[error("vertex {0} has no triangle")]
    Unused(u32),
    /// A vertex at which several fans touch.
    #[error("vertex {0} joins several fans")]
    Pinched(u32),
}

/// Checks every theorem.
///
/// # Errors
/// The first theorem that does not hold.
pub fn validate(mesh: &TriMesh) -> Result<(), Violation> {
    lengths(mesh)?;
    triangles(mesh)?;
    twins(mesh)?;
    edges_once(mesh)?;
    phantoms(mesh)?;
    one_fan_a_vertex(mesh)
}

fn lengths(mesh: &TriMesh) -> Result<(), Violation> {
    let n = mesh.triangles.len();
    let expected = [(mesh.twins.len(), 3 * n), (mesh.phantom.len(), 3 * n), (mesh.polygon_of.len(), n)];
    match expected.iter().find(|(found, expected)| found != expected) {
        Some((found, _)) => Err(Violation::Length(*found)),
        None => Ok(()),
    }
}

fn triangles(mesh: &TriMesh) -> Result<(), Violation> {
    for (t, corners) in mesh.triangles.iter().enumerate() {
        if corners.iter().any(|v| *v as usize >= mesh.positions.len()) {
            return Err(Violation::Range(t as u32));
        }
        if corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0] {
            return Err(Violation::Degenerate(t as u32));
        }
    }
    match mesh.positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(vertex) => Err(Violation::NotFinite(vertex as u32)),
        None => Ok(()),
    }
}

fn twins(mesh: &TriMesh) -> Result<(), Violation> {
    for h in 0..mesh.twins.len() as u32 {
        let twin = mesh.twin(h);
        if twin == NONE {
            continue;
        }
        let belongs = mesh.twins.get(twin as usize) == Some(&h)
            && twin != h
            && (mesh.tail(twin), mesh.head(twin)) == (mesh.head(h), mesh.tail(h));
        if !belongs {
            return Err(Violation::Twin(h));
        }
    }
    Ok(())
}

fn edges_once(mesh: &TriMesh) -> Result<(), Violation> {
    let once = (0..mesh.twins.len() as u32).filter(|h| mesh.twin(*h) == NONE || mesh.twin(*h) > *h);
    let mut edges: Vec<_> = once
        .map(|h| {
            let (a, b) = (mesh.tail(h), mesh.head(h));
            (a.min(b), a.max(b), h)
        })
        .collect();
    edges.sort_unstable();
    match edges.windows(2).find(|pair| (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1)) {
        Some(pair) => Err(Violation::EdgeTwice(pair[1].2)),
        None => Ok(()),
    }
}

fn phantoms(mesh: &TriMesh) -> Result<(), Violation> {
    for h in (0..mesh.twins.len() as u32).filter(|h| mesh.phantom[*h as usize]) {
        let twin = mesh.twin(h);
        let inside = twin != NONE
            && mesh.phantom[twin as usize]
            && mesh.polygon_of[h as usize / 3] == mesh.polygon_of[twin as usize / 3];
        if !inside {
            return Err(Violation::Phantom(h));
        }
    }
    Ok(())
}

/// Each vertex is used, and turning around it from one of its corners visits all of them.
fn one_fan_a_vertex(mesh: &TriMesh) -> Result<(), Violation> {
    let mut corners = vec![0u32; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|v| corners[*v as usize] += 1);
    if let Some(vertex) = corners.iter().position(|corners| *corners == 0) {
        return Err(Violation::Unused(vertex as u32));
    }
    let mut start = vec![NONE; mesh.positions.len()];
    for h in 0..mesh.twins.len() as u32 {
        let slot = &mut start[mesh.tail(h) as usize];
        // On the boundary: the corner from which turning by `twin(prev)` reaches all others.
        if *slot == NONE || mesh.twin(h) == NONE {
            *slot = h;
        }
    }
    for (vertex, first) in start.into_iter().enumerate() {
        let (mut h, mut visited) = (first, 1);
        loop {
            h = mesh.twin(prev(h));
            if h == NONE || h == first || visited > corners[vertex] {
                break;
            }
            visited += 1;
        }
        if visited != corners[vertex] {
            return Err(Violation::Pinched(vertex as u32));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;

    /// A pyramid over a square that is cut by a phantom diagonal, open at one side.
    fn mesh() -> TriMesh {
        let positions =
            [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1]].map(|p| Vec3::from(p.map(f64::from))).into();
        let triangles = vec![[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4]];
        let mut mesh = TriMesh::from_triangles(positions, triangles).expect("manifold");
        mesh.polygon_of = vec![0, 0, 1, 2, 3];
        mesh.phantom[0] = true;
        mesh.phantom[5] = true;
        mesh
    }

    #[test]
    fn a_valid_mesh_passes() {
        assert_eq!(validate(&mesh()), Ok(()));
    }

    #[test]
    fn each_theorem_bites() {
        let broken = |change: fn(&mut TriMesh)| {
            let mut mesh = mesh();
            change(&mut mesh);
            validate(&mesh).expect_err("broken on purpose")
        };
        assert_eq!(broken(|m| m.phantom.truncate(3)), Violation::Length(3));
        assert_eq!(broken(|m| m.triangles[2][2] = 5), Violation::Range(2));
        assert_eq!(broken(|m| m.triangles[2][2] = 1), Violation::Degenerate(2));
        assert_eq!(broken(|m| m.positions[3].y = f64::NAN), Violation::NotFinite(3));
        assert_eq!(broken(|m| m.twins[0] = 7), Violation::Twin(0));
        assert_eq!(broken(|m| m.twins[0] = 99), Violation::Twin(0));
        assert_eq!(
            broken(|m| {
                m.twins[0] = NONE;
                m.twins[5] = NONE;
                m.phantom = vec![false; 15];
            }),
            Violation::EdgeTwice(5)
        );
        assert_eq!(broken(|m| m.phantom[0] = false), Violation::Phantom(5));
        assert_eq!(broken(|m| m.polygon_of[1] = 7), Violation::Phantom(0));
        assert_eq!(broken(|m| m.positions.push(Vec3::zeros())), Violation::Unused(5));
    }

    #[test]
    fn a_pinched_vertex_is_found() {
        let positions = vec![Vec3::zeros(); 5];
        let mesh = TriMesh::from_triangles(positions, vec![[0, 1, 2], [0, 3, 4]]).expect("edges are manifold");
        assert_eq!(validate(&mesh), Err(Violation::Pinched(0)));
    }
}
