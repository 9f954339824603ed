//! The mapped mesh: the example as uploaded, with other positions.
//!
//! Vertex order, faces, UVs, groups, materials, colours and creases stay. Normals of the example would be wrong on the
//! input and are left out. A mirrored map reverses each face, so that normals point outward.

use crate::mesh::Vec3;
use crate::mesh::poly::{Attributes, CornerLayer, Crease, FaceLabels, PolyMesh, Polygons};
use crate::mesh::tri::{NONE, TriMesh};
use crate::topology::Patch;

/// Which way the faces of the result turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Winding {
    /// As in the example.
    Kept,
    /// Reversed: the map mirrors.
    Reversed,
}

/// The example's mesh at new positions.
///
/// `surface` and `vertex_of` are what [`crate::mesh`] made of `example`; `patch` is the part of `surface` that was
/// mapped and `positions` where its vertices went. Faces of other parts are left out, with the vertices only they use.
pub fn assemble(
    example: &PolyMesh,
    surface: &TriMesh,
    vertex_of: &[u32],
    patch: &Patch,
    positions: &[Vec3],
    winding: Winding,
) -> PolyMesh {
    let placed = place(example, surface, vertex_of, patch, positions);
    let mut mapped = vec![false; example.faces.len()];
    for &t in &patch.triangle_of {
        mapped[surface.polygon_of[t as usize] as usize] = true;
    }
    let mut present = vec![false; example.faces.len()];
    surface.polygon_of.iter().for_each(|&f| present[f as usize] = true);
    // Faces that preparing dropped (doubles, faces without area) are the example's own and come back with it.
    let whole = patch.triangle_of.len() == surface.triangles.len();
    let keep: Vec<bool> = (0..mapped.len()).map(|f| mapped[f] || (whole && !present[f])).collect();
    let mesh = PolyMesh { positions: placed, faces: example.faces.clone(), attributes: example.attributes.clone() };
    let mut mesh = if keep.iter().all(|k| *k) { mesh } else { select(&mesh, &keep) };
    mesh.attributes.normals = None;
    if winding == Winding::Reversed {
        reverse(&mut mesh);
    }
    mesh
}

/// A position for every vertex of the example; unused ones take that of the nearest mapped vertex.
fn place(example: &PolyMesh, surface: &TriMesh, vertex_of: &[u32], patch: &Patch, positions: &[Vec3]) -> Vec<Vec3> {
    let mut at = vec![NONE; surface.positions.len()];
    for (k, &v) in patch.vertex_of.iter().enumerate() {
        if at[v as usize] == NONE {
            at[v as usize] = k as u32;
        }
    }
    let nearest = |x: &Vec3| {
        let order = |a: &usize, b: &usize| {
            let d = |k: usize| (patch.mesh.positions[k] - x).norm_squared();
            d(*a).total_cmp(&d(*b))
        };
        (0..positions.len()).min_by(order)
    };
    let mut fallback: Option<Vec3> = None;
    example
        .positions
        .iter()
        .zip(vertex_of)
        .map(|(x, &v)| {
            let k = if v == NONE { NONE } else { at[v as usize] };
            if k != NONE {
                return positions[k as usize];
            }
            // One search serves all: nothing hangs on these vertices.
            *fallback.get_or_insert_with(|| {
                let finite = x.iter().all(|c| c.is_finite());
                nearest(if finite { x } else { &patch.mesh.positions[0] }).map_or(Vec3::zeros(), |k| positions[k])
            })
        })
        .collect()
}

/// The faces kept, with the vertices they use, all in their old order.
pub fn select(mesh: &PolyMesh, keep: &[bool]) -> PolyMesh {
    let kept: Vec<usize> = (0..mesh.faces.len()).filter(|&f| keep[f]).collect();
    let mut number = vec![NONE; mesh.positions.len()];
    kept.iter().for_each(|&f| mesh.faces.face(f).iter().for_each(|&v| number[v as usize] = 0));
    let mut vertices = Vec::new();
    for (v, n) in number.iter_mut().enumerate().filter(|(_, n)| **n != NONE) {
        *n = vertices.len() as u32;
        vertices.push(v);
    }
    let mut faces = Polygons::default();
    let mut face = Vec::new();
    for &f in &kept {
        face.clear();
        face.extend(mesh.faces.face(f).iter().map(|&v| number[v as usize]));
        faces.push(&face);
    }
    let a = &mesh.attributes;
    let labels =
        |l: &FaceLabels| FaceLabels { names: l.names.clone(), of_face: kept.iter().map(|&f| l.of_face[f]).collect() };
    let attributes = Attributes {
        uvs: a.uvs.as_ref().map(|l| select_corners(mesh, l, &kept)),
        normals: a.normals.as_ref().map(|l| select_corners(mesh, l, &kept)),
        colors: a.colors.as_ref().map(|c| vertices.iter().map(|&v| c[v]).collect()),
        groups: a.groups.as_ref().map(labels),
        materials: a.materials.as_ref().map(labels),
        segments: a.segments.as_ref().map(|s| kept.iter().map(|&f| s[f]).collect()),
        creases: a
            .creases
            .iter()
            .map(|c| Crease { vertices: c.vertices.map(|v| number[v as usize]), ..*c })
            .filter(|c| !c.vertices.contains(&NONE))
            .collect(),
    };
    PolyMesh { positions: vertices.iter().map(|&v| mesh.positions[v]).collect(), faces, attributes }
}

fn select_corners<T: Clone>(mesh: &PolyMesh, layer: &CornerLayer<T>, kept: &[usize]) -> CornerLayer<T> {
    let of_face = |f: &usize| {
        let start = mesh.faces.start(*f);
        layer.corners[start..start + mesh.faces.face(*f).len()].to_vec()
    };
    CornerLayer { values: layer.values.clone(), corners: kept.iter().flat_map(of_face).collect() }
}

/// Turns every face over; its first corner stays first.
pub fn reverse(mesh: &mut PolyMesh) {
    let faces = std::mem::take(&mut mesh.faces);
    let flip = |layer: &mut Vec<u32>| {
        for f in 0..faces.len() {
            let (start, n) = (faces.start(f), faces.face(f).len());
            if let Some(rest) = layer.get_mut(start + 1..start + n) {
                rest.reverse();
            }
        }
    };
    let mut corners = faces.corners().to_vec();
    flip(&mut corners);
    if let Some(layer) = &mut mesh.attributes.uvs {
        flip(&mut layer.corners);
    }
    if let Some(layer) = &mut mesh.attributes.normals {
        flip(&mut layer.corners);
    }
    mesh.faces = (0..faces.len()).map(|f| &corners[faces.start(f)..faces.start(f) + faces.face(f).len()]).collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology;

    fn two_quads() -> (PolyMesh, TriMesh, Vec<u32>) {
        let positions: Vec<Vec3> =
            [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)].map(|(x, y)| Vec3::new(x.into(), y.into(), 0.0)).to_vec();
        let faces = [[0u32, 1, 4, 3], [1, 2, 5, 4]];
        let poly = PolyMesh {
            positions: positions.clone(),
            faces: faces.iter().map(|f| &f[..]).collect(),
            attributes: Attributes {
                uvs: Some(CornerLayer { values: vec![[0.0; 2]; 8], corners: (0..8).collect() }),
                ..Attributes::default()
            },
        };
        let triangles = vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]];
        let mut surface = TriMesh::from_triangles(positions, triangles).expect("manifold");
        surface.polygon_of = vec![0, 0, 1, 1];
        (poly, surface, (0..6).collect())
    }

    #[test]
    fn a_whole_example_keeps_order_faces_and_uvs() {
        let (poly, surface, vertex_of) = two_quads();
        let patch = topology::whole(&surface).expect("a disc");
        let moved: Vec<Vec3> = patch.mesh.positions.iter().map(|p| p * 2.0).collect();
        let out = assemble(&poly, &surface, &vertex_of, &patch, &moved, Winding::Kept);
        assert_eq!((&out.faces, &out.attributes.uvs), (&poly.faces, &poly.attributes.uvs));
        assert_eq!(out.positions[5], Vec3::new(4.0, 2.0, 0.0));
    }

    #[test]
    fn a_mirrored_example_turns_faces_with_their_uvs() {
        let (poly, surface, vertex_of) = two_quads();
        let patch = topology::whole(&surface).expect("a disc");
        let positions = patch.mesh.positions.clone();
        let out = assemble(&poly, &surface, &vertex_of, &patch, &positions, Winding::Reversed);
        assert_eq!(out.faces.face(1), [1, 4, 5, 2]);
        assert_eq!(out.attributes.uvs.expect("kept").corners[4..], [4, 7, 6, 5]);
    }

    #[test]
    fn a_part_of_an_example_comes_alone() {
        let (poly, surface, vertex_of) = two_quads();
        let patch = topology::by_labels(&surface, &[0, 1]).expect("two quads").remove(1);
        let positions = patch.mesh.positions.clone();
        let out = assemble(&poly, &surface, &vertex_of, &patch, &positions, Winding::Kept);
        assert_eq!((out.positions.len(), out.faces.len()), (4, 1));
        assert_eq!(out.faces.face(0), [0, 1, 3, 2]);
    }
}
