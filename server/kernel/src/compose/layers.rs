//! A mesh subdivided with all its layers: UVs, normals, colours, groups, materials, segment numbers and creases.
//!
//! Each n-gon becomes n quads as in [`subdivide`]. A corner at a middle has the mean of what the face's corners around it
//! have, so that a UV seam stays a seam, and what is shared by two faces stays shared. *Ours, not the paper's.*

use super::net::Net;
use super::subdivide::subdivide;
use crate::mesh::{Attributes, CornerLayer, Crease, FaceLabels, NONE, PolyMesh};
use std::collections::HashMap;

/// Subdivides a mesh once. Old vertices keep their numbers; the quads of a face follow those of the face before it.
pub fn subdivided(mesh: &PolyMesh) -> PolyMesh {
    let net = subdivide(&Net::from_mesh(mesh));
    let faces = net.faces().map(|(_, corners)| corners).collect();
    let fine = PolyMesh { faces, positions: net.positions, attributes: Attributes::default() };
    let old = &mesh.attributes;
    let normalised = |n: [f64; 3]| {
        let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 0.0 { n.map(|x| x / length) } else { n }
    };
    let attributes = Attributes {
        uvs: old.uvs.as_ref().map(|layer| corners(mesh, layer, |uv| uv)),
        normals: old.normals.as_ref().map(|layer| corners(mesh, layer, normalised)),
        colors: old.colors.as_ref().map(|colors| at_vertices(mesh, &fine, colors)),
        groups: old.groups.as_ref().map(|labels| labels_of(mesh, labels)),
        materials: old.materials.as_ref().map(|labels| labels_of(mesh, labels)),
        segments: old.segments.as_ref().map(|numbers| of_faces(mesh, numbers)),
        creases: creases(mesh, &fine, &old.creases),
    };
    PolyMesh { attributes, ..fine }
}

/// What the quads of each face have of it.
fn of_faces<T: Copy>(mesh: &PolyMesh, values: &[T]) -> Vec<T> {
    mesh.faces.iter().zip(values).flat_map(|(face, &value)| std::iter::repeat_n(value, face.len())).collect()
}

fn labels_of(mesh: &PolyMesh, labels: &FaceLabels) -> FaceLabels {
    FaceLabels { names: labels.names.clone(), of_face: of_faces(mesh, &labels.of_face) }
}

/// A layer of corners: of each quad an old corner, the middle after it, the face's middle, and the middle before it.
fn corners<const D: usize>(
    mesh: &PolyMesh,
    layer: &CornerLayer<[f64; D]>,
    finish: impl Fn([f64; D]) -> [f64; D],
) -> CornerLayer<[f64; D]> {
    let mut values = layer.values.clone();
    let mut mean = |of: &[u32]| {
        if of.contains(&NONE) {
            return NONE;
        }
        let sum = of.iter().fold([0.0; D], |sum, &i| std::array::from_fn(|d| sum[d] + layer.values[i as usize][d]));
        values.push(finish(sum.map(|x| x / of.len() as f64)));
        values.len() as u32 - 1
    };
    let mut middle_of: HashMap<(u32, u32), u32> = HashMap::new();
    let mut all = Vec::with_capacity(4 * layer.corners.len());
    for (f, face) in mesh.faces.iter().enumerate() {
        let n = face.len();
        let old = &layer.corners[mesh.faces.start(f)..][..n];
        let middles: Vec<u32> = (0..n)
            .map(|k| {
                let (a, b) = (old[k], old[(k + 1) % n]);
                *middle_of.entry((a.min(b), a.max(b))).or_insert_with(|| if a == b { a } else { mean(&[a, b]) })
            })
            .collect();
        let centre = mean(old);
        all.extend((0..n).flat_map(|k| [old[k], middles[k], centre, middles[(k + n - 1) % n]]));
    }
    CornerLayer { values, corners: all }
}

/// Each quad of the fine mesh, as its four corners, with the old face's corners at and after it, and all of that face.
fn quads<'a>(mesh: &'a PolyMesh, fine: &'a PolyMesh) -> impl Iterator<Item = (&'a [u32], [u32; 2], &'a [u32])> {
    let places = mesh.faces.iter().flat_map(|face| (0..face.len()).map(move |k| (face, k)));
    fine.faces.iter().zip(places).map(|(quad, (face, k))| (quad, [face[k], face[(k + 1) % face.len()]], face))
}

fn at_vertices(mesh: &PolyMesh, fine: &PolyMesh, colors: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let mean = |of: &[u32]| {
        let sum = of.iter().fold([0.0; 4], |sum, &v| std::array::from_fn(|d| sum[d] + colors[v as usize][d]));
        sum.map(|x| x / of.len() as f32)
    };
    let mut all = colors.to_vec();
    all.resize(fine.positions.len(), [0.0; 4]);
    for (quad, ends, face) in quads(mesh, fine) {
        all[quad[1] as usize] = mean(&ends);
        all[quad[2] as usize] = mean(face);
    }
    all
}

/// Both halves of a semi-sharp edge are as sharp as it was.
fn creases(mesh: &PolyMesh, fine: &PolyMesh, old: &[Crease]) -> Vec<Crease> {
    if old.is_empty() {
        return Vec::new();
    }
    let key = |[a, b]: [u32; 2]| (a.min(b), a.max(b));
    let middle_of: HashMap<(u32, u32), u32> = quads(mesh, fine).map(|(quad, ends, _)| (key(ends), quad[1])).collect();
    let halves = |crease: &Crease| {
        let middle = middle_of.get(&key(crease.vertices)).copied();
        let sharpness = crease.sharpness;
        let half = move |v: u32| middle.map(|m| Crease { vertices: [v, m], sharpness });
        crease.vertices.map(half)
    };
    old.iter().flat_map(halves).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Polygons, Vec3};

    /// Two quads and a triangle in a row along x, with a UV seam between the quads.
    fn row() -> PolyMesh {
        let at = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [3, 0]];
        let faces: [&[u32]; 3] = [&[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 6, 5]];
        let uvs = CornerLayer {
            values: vec![
                [0.0, 0.0],
                [0.2, 0.0],
                [0.2, 1.0],
                [0.0, 1.0],
                [0.5, 0.0],
                [0.7, 0.0],
                [0.7, 1.0],
                [0.5, 1.0],
            ],
            corners: vec![0, 1, 2, 3, 4, 5, 6, 7, 5, NONE, 6],
        };
        let labels = |of_face: &[u32]| FaceLabels { names: vec!["a".into(), "b".into()], of_face: of_face.to_vec() };
        PolyMesh {
            positions: at.iter().map(|&[x, y]| Vec3::new(f64::from(x), f64::from(y), 0.0)).collect(),
            faces: faces.into_iter().collect::<Polygons>(),
            attributes: Attributes {
                uvs: Some(uvs),
                normals: Some(CornerLayer {
                    values: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                    corners: vec![0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1],
                }),
                colors: Some((0..7).map(|v| [v as f32, 0.0, 0.0, 1.0]).collect()),
                groups: Some(labels(&[0, 1, NONE])),
                materials: Some(labels(&[1, 0, 0])),
                segments: Some(vec![7, 8, 9]),
                creases: vec![Crease { vertices: [4, 1], sharpness: 3.0 }],
            },
        }
    }

    #[test]
    fn every_layer_is_subdivided_with_the_faces() {
        let mesh = row();
        let fine = subdivided(&mesh);
        let layers = &fine.attributes;
        assert_eq!((fine.faces.len(), fine.faces.corners().len()), (11, 44));
        assert_eq!(fine.positions[..7], mesh.positions);
        // A corner of the first quad, of the one after the seam, and of the triangle, one of whose corners has no UV.
        let uvs = layers.uvs.as_ref().expect("uvs");
        let uv = |f: usize| [0, 1, 2, 3].map(|k| uvs.values.get(uvs.corners[4 * f + k] as usize).copied());
        assert_eq!(uv(0), [[0.0, 0.0], [0.1, 0.0], [0.1, 0.5], [0.0, 0.5]].map(Some));
        assert_eq!(uv(4), [[0.5, 0.0], [0.6, 0.0], [0.6, 0.5], [0.5, 0.5]].map(Some));
        assert_eq!(uv(8), [Some([0.7, 0.0]), None, None, Some([0.7, 0.5])]);
        // Shared by the second quad and the triangle: one value, as before.
        assert_eq!(uvs.corners[4 * 5 + 1], uvs.corners[4 * 8 + 3]);
        let normals = layers.normals.as_ref().expect("normals");
        assert!(normals.values.iter().all(|n| (n.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12));
        let [of_groups, of_materials] =
            [&layers.groups, &layers.materials].map(|l| l.as_ref().expect("labels").of_face.clone());
        assert_eq!(of_groups, [0, 0, 0, 0, 1, 1, 1, 1, NONE, NONE, NONE]);
        assert_eq!(of_materials, [1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(layers.segments, Some(vec![7, 7, 7, 7, 8, 8, 8, 8, 9, 9, 9]));
        // Red is linear along the first edge, from 0 to 1, and its mean over the first quad is 2.
        let red = |v: u32| layers.colors.as_ref().expect("colours")[v as usize][0];
        let quad = fine.faces.face(0);
        assert_eq!([red(quad[0]), red(quad[1]), red(quad[2])], [0.0, 0.5, 2.0]);
        let [a, b] = &layers.creases[..] else { panic!("{:?}", layers.creases) };
        let middle = a.vertices[1];
        assert_eq!((a.vertices[0], b.vertices, b.sharpness), (4, [1, middle], 3.0));
        assert_eq!(fine.positions[middle as usize], Vec3::new(1.0, 0.5, 0.0));
    }

    #[test]
    fn what_has_no_layers_gets_none() {
        let bare = PolyMesh { attributes: Attributes::default(), ..row() };
        assert_eq!(subdivided(&bare).attributes, Attributes::default());
    }
}
