//! Rows taken out: the ends of every edge of a chord become one vertex, and the quads between them go.
//!
//! One end of each such edge must be regular, so that no extraordinary vertex meets another or goes, and what is left must be a
//! surface again.

use super::{Chords, NEAR};
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::NONE;
use crate::mesh::{Attributes, CornerLayer, FaceLabels, PolyMesh, Polygons, Vec3};
use crate::numerics::stop;
use std::collections::HashSet;

/// Fewest faces that are left.
const FACES_MIN: usize = 6;
/// A row with edges this many times as long as the mean edge stays: what can't go is denser, and quads would differ the more.
/// *Untuned.*
const LONG: f64 = 2.0;

/// The mesh without so many of its thinnest rows that it has about `count` faces, or as few as its layout allows.
pub(super) fn merged(mesh: &PolyMesh, tree: &Bvh, count: usize) -> PolyMesh {
    let mut mesh = mesh.clone();
    let least = (count as f64 * (1.0 - NEAR)).max(FACES_MIN as f64) as usize;
    while mesh.faces.len() as f64 > count as f64 * (1.0 + NEAR) {
        stop::ask();
        let chords = Chords::of(&mesh);
        let about = MeshIncidence::of(&mesh, &chords);
        let mut order: Vec<usize> = (0..chords.quads.len()).collect();
        order.sort_by(|&a, &b| chords.lengths[a].total_cmp(&chords.lengths[b]).then(a.cmp(&b)));
        let mean = mean_edge(&mesh, &chords);
        let fits = |chord: &usize| {
            if chords.lengths[*chord] > LONG * mean {
                return false;
            }
            let left = mesh.faces.len() - chords.quads[*chord].len();
            let is_nearer = left >= FACES_MIN && count.saturating_sub(left) < mesh.faces.len() - count;
            left >= least || is_nearer
        };
        let found = order.into_iter().filter(fits).find_map(|chord| without(&mesh, &chords, &about, chord, tree));
        match found {
            Some(fewer) => mesh = fewer,
            None => break,
        }
    }
    mesh
}

fn mean_edge(mesh: &PolyMesh, chords: &Chords) -> f64 {
    let length = |ends: &[u32; 2]| (mesh.positions[ends[0] as usize] - mesh.positions[ends[1] as usize]).norm();
    chords.ends.iter().map(length).sum::<f64>() / chords.ends.len().max(1) as f64
}

/// Counts the faces at vertices, and tells which vertices and edges lie on the boundary.
struct MeshIncidence {
    /// Faces at each vertex.
    faces: Vec<u32>,
    on_boundary: Vec<bool>,
    /// Whether each edge has one face.
    is_boundary: Vec<bool>,
}

impl MeshIncidence {
    fn of(mesh: &PolyMesh, chords: &Chords) -> Self {
        let mut faces = vec![0; mesh.positions.len()];
        mesh.faces.corners().iter().for_each(|&v| faces[v as usize] += 1);
        let mut uses = vec![0; chords.ends.len()];
        chords.edge_of.iter().for_each(|&e| uses[e as usize] += 1);
        let mut on_boundary = vec![false; mesh.positions.len()];
        let is_boundary: Vec<bool> = uses.iter().map(|n| *n == 1).collect();
        let of_boundary = chords.ends.iter().zip(&is_boundary).filter(|(_, is)| **is);
        of_boundary.for_each(|(ends, _)| ends.iter().for_each(|&v| on_boundary[v as usize] = true));
        Self { faces, on_boundary, is_boundary }
    }

    fn is_regular(&self, v: u32) -> bool {
        self.faces[v as usize] == if self.on_boundary[v as usize] { 2 } else { 4 }
    }
}

/// The mesh without the row that a chord crosses; `None` where that may not be.
fn without(mesh: &PolyMesh, chords: &Chords, about: &MeshIncidence, chord: usize, tree: &Bvh) -> Option<PolyMesh> {
    let row = &chords.quads[chord];
    if chords.is_fixed[chord] || row.is_empty() {
        return None;
    }
    let gone: HashSet<u32> = row.iter().copied().collect();
    if gone.len() < row.len() {
        return None;
    }
    stop::pass(mesh.faces.len());
    let mut becomes: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    let mut positions = mesh.positions.clone();
    let mut is_merged = HashSet::new();
    for edge in (0..chords.ends.len()).filter(|&e| chords.chord_of[e] as usize == chord) {
        let [a, b] = chords.ends[edge];
        let rim = [a, b].map(|v| about.on_boundary[v as usize]);
        if rim == [true; 2] && !about.is_boundary[edge] || !is_merged.insert(a) || !is_merged.insert(b) {
            return None;
        }
        // Who stays where it is: on the boundary before within, extraordinary before regular.
        let weight = |v: u32, rim: bool| (rim, !about.is_regular(v));
        let (of_a, of_b) = (weight(a, rim[0]), weight(b, rim[1]));
        let (kept, other) = if of_b > of_a { (b, a) } else { (a, b) };
        if !about.is_regular(other) {
            return None;
        }
        becomes[other as usize] = kept;
        if of_a == of_b {
            let middle: Vec3 = positions[a as usize].lerp(&positions[b as usize], 0.5);
            let near = tree.closest(middle);
            let reach = (positions[a as usize] - positions[b as usize]).norm();
            positions[kept as usize] =
                if near.triangle != NONE && near.distance <= reach { near.point } else { middle };
        }
    }
    let kept: Vec<usize> = (0..mesh.faces.len()).filter(|f| !gone.contains(&(*f as u32))).collect();
    let mut sides = HashSet::new();
    for &f in &kept {
        let face = mesh.faces.face(f);
        for (k, &v) in face.iter().enumerate() {
            let (a, b) = (becomes[v as usize], becomes[face[(k + 1) % face.len()] as usize]);
            if a == b || !sides.insert([a, b]) {
                return None;
            }
        }
        let own: HashSet<u32> = face.iter().map(|&v| becomes[v as usize]).collect();
        if own.len() < face.len() {
            return None;
        }
    }
    Some(rebuilt(mesh, positions, &becomes, &kept))
}

/// The faces that are kept, with the vertices that they use.
fn rebuilt(mesh: &PolyMesh, positions: Vec<Vec3>, becomes: &[u32], kept: &[usize]) -> PolyMesh {
    let mut number = vec![NONE; positions.len()];
    for &f in kept {
        mesh.faces.face(f).iter().for_each(|&v| number[becomes[v as usize] as usize] = 0);
    }
    for (count, slot) in number.iter_mut().filter(|slot| **slot == 0).enumerate() {
        *slot = count as u32;
    }
    let used = positions.into_iter().zip(&number).filter(|(_, number)| **number != NONE).map(|(p, _)| p).collect();
    let mut faces = Polygons::default();
    for &f in kept {
        let face: Vec<u32> = mesh.faces.face(f).iter().map(|&v| number[becomes[v as usize] as usize]).collect();
        faces.push(&face);
    }
    let from = &mesh.attributes;
    let corner = |layer: &CornerLayer<[f64; 2]>| CornerLayer {
        values: layer.values.clone(),
        corners: kept
            .iter()
            .flat_map(|&f| {
                let start = mesh.faces.start(f);
                layer.corners[start..start + mesh.faces.face(f).len()].iter().copied()
            })
            .collect(),
    };
    let labels = |labels: &FaceLabels| FaceLabels {
        names: labels.names.clone(),
        of_face: kept.iter().map(|&f| labels.of_face[f]).collect(),
    };
    let crease = |crease: &crate::mesh::Crease| {
        let ends = crease.vertices.map(|v| number[becomes[v as usize] as usize]);
        let is_there = ends[0] != ends[1] && !ends.contains(&NONE);
        is_there.then_some(crate::mesh::Crease { vertices: ends, ..*crease })
    };
    let attributes = Attributes {
        uvs: from.uvs.as_ref().map(corner),
        groups: from.groups.as_ref().map(labels),
        materials: from.materials.as_ref().map(labels),
        segments: from.segments.as_ref().map(|all| kept.iter().map(|&f| all[f]).collect()),
        creases: from.creases.iter().filter_map(crease).collect(),
        ..Attributes::default()
    };
    PolyMesh { positions: used, faces, attributes }
}
