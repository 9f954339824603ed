//! What the rasteriser needs of a polygon mesh: safe triangles, corner normals, polygon edges, valences.

use nalgebra::Vector3;
use quadmuse_kernel::mesh::{PolyMesh, Vec3};

/// Corner normals follow the vertex normal up to this angle to the face (cosine of 50°); beyond it the edge is sharp.
const SMOOTH_COSINE: f64 = 0.643;

/// A polygon edge, once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    pub(super) vertices: [u32; 2],
    pub(super) kind: EdgeKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EdgeKind {
    /// Two faces meet here.
    Interior,
    /// One face, or more than two.
    Rim,
}

/// Where a mesh seems to come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Origin {
    /// Mostly quads: modelled, in the usual axes.
    Modelled,
    /// Anything else: scanned, in any axes.
    #[default]
    Scanned,
}

/// The drawable part of a mesh, moved and scaled into the unit ball.
#[derive(Clone, Debug, Default)]
pub(super) struct Surface {
    /// Vertices in the unit ball around the origin; non-finite ones stand at the origin and are in no triangle.
    pub(super) points: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Segment number of each triangle; empty where the mesh has none.
    pub(super) segments: Vec<i64>,
    /// One unit normal a corner.
    pub(super) normals: Vec<[Vector3<f32>; 3]>,
    pub(super) edges: Vec<Edge>,
    /// Whether an artist may have laid the faces.
    pub(super) origin: Origin,
    /// Vertices of a mesh of mostly quads whose valence is not 4 (boundary vertices count one edge more).
    pub(super) poles: Vec<(u32, u32)>,
}

impl Surface {
    pub(super) fn of(mesh: &PolyMesh) -> Self {
        let points = into_unit_ball(&mesh.positions);
        let usable = |face: &[u32]| {
            face.len() >= 3
                && face.iter().all(|&v| mesh.positions.get(v as usize).is_some_and(|p| p.iter().all(|x| x.is_finite())))
        };
        let faces: Vec<&[u32]> = mesh.faces.iter().filter(|face| usable(face)).collect();
        let triangles: Vec<[u32; 3]> = faces.iter().flat_map(|face| tessellate(face, &points)).collect();
        let labels = mesh.attributes.segments.as_deref().unwrap_or_default();
        let labelled = mesh.faces.iter().zip(labels).filter(|(face, _)| usable(face));
        let segments =
            labelled.flat_map(|(face, label)| tessellate(face, &points).into_iter().map(|_| *label)).collect();
        let normals = corner_normals(&points, &triangles);
        let edges = polygon_edges(&faces);
        let quads = faces.iter().filter(|face| face.len() == 4).count();
        let origin = if 2 * quads > faces.len() { Origin::Modelled } else { Origin::Scanned };
        let poles = if origin == Origin::Modelled { irregular(&edges, points.len()) } else { Vec::new() };
        Self { points, triangles, segments, normals, edges, origin, poles }
    }
}

fn into_unit_ball(positions: &[Vec3]) -> Vec<Vec3> {
    let finite = |p: &&Vec3| p.iter().all(|x| x.is_finite());
    let mut bounds: Option<(Vec3, Vec3)> = None;
    for p in positions.iter().filter(finite) {
        bounds = Some(bounds.map_or((*p, *p), |(low, high)| (low.inf(p), high.sup(p))));
    }
    let Some((low, high)) = bounds else { return vec![Vec3::zeros(); positions.len()] };
    let centre = low / 2.0 + high / 2.0;
    let reach = positions.iter().filter(finite).map(|p| (p / 2.0 - centre / 2.0).amax()).fold(0.0, f64::max) * 2.0;
    let scale = if reach.is_finite() && reach > 1e-300 { reach * 3f64.sqrt() } else { f64::MAX };
    positions.iter().map(|p| if finite(&p) { p / scale - centre / scale } else { Vec3::zeros() }).collect()
}

/// Fans a polygon; a quad is cut along its shorter diagonal.
fn tessellate(face: &[u32], points: &[Vec3]) -> Vec<[u32; 3]> {
    if let &[a, b, c, d] = face {
        let length = |p: u32, q: u32| (points[p as usize] - points[q as usize]).norm_squared();
        return if length(a, c) <= length(b, d) { vec![[a, b, c], [a, c, d]] } else { vec![[b, c, d], [b, d, a]] };
    }
    (1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]).collect()
}

fn corner_normals(points: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[Vector3<f32>; 3]> {
    let face_normal = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| points[v as usize]);
        (b - a).cross(&(c - a))
    };
    let unit = |n: Vec3| n.try_normalize(1e-30).unwrap_or_else(Vec3::zeros);
    let mut of_vertex = vec![Vec3::zeros(); points.len()];
    for t in triangles {
        let n = face_normal(t);
        t.iter().for_each(|&v| of_vertex[v as usize] += n);
    }
    let corner = |v: u32, flat: Vec3| {
        let smooth = unit(of_vertex[v as usize]);
        if smooth.dot(&flat) > SMOOTH_COSINE { smooth.cast::<f32>() } else { flat.cast::<f32>() }
    };
    triangles
        .iter()
        .map(|t| {
            let flat = unit(face_normal(t));
            t.map(|v| corner(v, flat))
        })
        .collect()
}

fn polygon_edges(faces: &[&[u32]]) -> Vec<Edge> {
    let mut keys: Vec<[u32; 2]> = Vec::with_capacity(4 * faces.len());
    for face in faces {
        for (k, &a) in face.iter().enumerate() {
            let b = face[(k + 1) % face.len()];
            keys.push([a.min(b), a.max(b)]);
        }
    }
    keys.sort_unstable();
    keys.chunk_by(|x, y| x == y)
        .map(|run| Edge { vertices: run[0], kind: if run.len() == 2 { EdgeKind::Interior } else { EdgeKind::Rim } })
        .collect()
}

fn irregular(edges: &[Edge], vertices: usize) -> Vec<(u32, u32)> {
    let mut valence = vec![0u32; vertices];
    let mut on_rim = vec![false; vertices];
    for edge in edges {
        for v in edge.vertices {
            valence[v as usize] += 1;
            on_rim[v as usize] |= edge.kind == EdgeKind::Rim;
        }
    }
    let counted = valence.iter().zip(&on_rim).map(|(&n, &rim)| n + u32::from(rim && n > 0));
    counted.enumerate().filter(|&(_, n)| n != 0 && n != 4).map(|(v, n)| (v as u32, n)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_kernel::mesh::Polygons;

    fn grid(n: u32) -> PolyMesh {
        let positions = (0..(n + 1) * (n + 1)).map(|k| Vec3::new(f64::from(k % (n + 1)), f64::from(k / (n + 1)), 0.0));
        let mut faces = Polygons::default();
        for k in 0..n * n {
            let v = k / n * (n + 1) + k % n;
            faces.push(&[v, v + 1, v + n + 2, v + n + 1]);
        }
        PolyMesh { positions: positions.collect(), faces, ..PolyMesh::default() }
    }

    #[test]
    fn a_grid_is_irregular_only_at_its_corners_and_has_no_diagonals() {
        let surface = Surface::of(&grid(3));
        assert_eq!(surface.poles, [(0, 3), (3, 3), (12, 3), (15, 3)]);
        assert_eq!(surface.edges.len(), 24);
        assert_eq!(surface.edges.iter().filter(|e| e.kind == EdgeKind::Rim).count(), 12);
        assert_eq!(surface.triangles.len(), 18);
    }

    #[test]
    fn every_point_lands_in_the_unit_ball_whatever_the_units() {
        for scale in [1e-200, 1.0, 1e300] {
            let mut mesh = grid(2);
            mesh.positions.iter_mut().for_each(|p| *p *= scale);
            let reach = Surface::of(&mesh).points.iter().map(|p| p.norm()).fold(0.0, f64::max);
            assert!(reach > 0.5 && reach <= 1.0, "scale {scale}: {reach}");
        }
    }

    #[test]
    fn faces_that_name_missing_or_infinite_vertices_are_left_out() {
        let mut mesh = grid(2);
        mesh.positions[0].x = f64::NAN;
        mesh.faces.push(&[1, 2, 99]);
        assert_eq!(Surface::of(&mesh).triangles.len(), 6);
    }
}
