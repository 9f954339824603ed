//! Rows split evenly: every edge of a chord gets as many pieces, and every quad a grid.

use super::Chords;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::NONE;
use crate::mesh::{Attributes, CornerLayer, Crease, FaceLabels, PolyMesh, Polygons, Vec3};
use crate::numerics::stop;
use std::collections::HashMap;

/// A count may be passed by this share for a row that is worth it.
const OVER: f64 = 0.03;
/// A new vertex goes to the surface unless that is farther away than this share of its edge: a face over a gap stays flat.
const REACH: f64 = 0.5;

/// The mesh with its rows split until it has about `count` faces.
pub(super) fn split(mesh: &PolyMesh, tree: &Bvh, count: usize) -> PolyMesh {
    let chords = Chords::of(mesh);
    let pieces = pieces(mesh, &chords, count);
    if pieces.iter().all(|n| *n == 1) {
        return mesh.clone();
    }
    let mut grid = Grids::new(mesh, &chords, &pieces);
    for f in 0..mesh.faces.len() {
        grid.face(f);
    }
    grid.finish(tree)
}

/// The pieces that each chord's edges get: all alike as often as that fits, then those whose pieces are longest, one more each.
fn pieces(mesh: &PolyMesh, chords: &Chords, count: usize) -> Vec<u32> {
    let own = mesh.faces.len().max(1);
    let all = ((count as f64 / own as f64).sqrt() * (1.0 + 1e-9)).floor().max(1.0) as u32;
    let mut pieces: Vec<u32> = chords.is_fixed.iter().map(|fixed| if *fixed { 1 } else { all }).collect();
    let of = |f: u32, pieces: &[u32]| {
        let [a, b] = chords.of_quad(mesh, f);
        u64::from(pieces[a as usize]) * u64::from(pieces[b as usize])
    };
    let is_quad = |f: &u32| mesh.faces.face(*f as usize).len() == 4;
    let mut total: u64 =
        (0..own.min(mesh.faces.len()) as u32).map(|f| if is_quad(&f) { of(f, &pieces) } else { 1 }).sum();
    let mut open: Vec<usize> =
        (0..pieces.len()).filter(|&c| !chords.is_fixed[c] && !chords.quads[c].is_empty()).collect();
    while total < count as u64 {
        stop::pass(open.len());
        let length = |c: usize| chords.lengths[c] / f64::from(pieces[c]);
        let longest =
            (0..open.len()).max_by(|&a, &b| length(open[a]).total_cmp(&length(open[b])).then(open[b].cmp(&open[a])));
        let Some(place) = longest else { break };
        let chord = open[place];
        let mut quads = chords.quads[chord].clone();
        quads.dedup();
        let before: u64 = quads.iter().map(|&f| of(f, &pieces)).sum();
        pieces[chord] += 1;
        let after: u64 = quads.iter().map(|&f| of(f, &pieces)).sum();
        if (total + after - before) as f64 > count as f64 * (1.0 + OVER) {
            pieces[chord] -= 1;
            open.swap_remove(place);
            continue;
        }
        total = total + after - before;
    }
    pieces
}

/// The mesh that is being made.
struct Grids<'a> {
    mesh: &'a PolyMesh,
    chords: &'a Chords,
    pieces: &'a [u32],
    positions: Vec<Vec3>,
    /// The length that each new vertex may be moved by.
    reach: Vec<f64>,
    /// The first new vertex of each edge.
    first_of: Vec<u32>,
    faces: Polygons,
    /// The face of the mesh of each face.
    face_of: Vec<u32>,
    uvs: Option<Uvs<'a>>,
}

struct Uvs<'a> {
    from: &'a CornerLayer<[f64; 2]>,
    values: Vec<[f64; 2]>,
    number: HashMap<[u64; 2], u32>,
    corners: Vec<u32>,
}

impl Uvs<'_> {
    /// The number of a value, which may be new.
    fn number(&mut self, uv: [f64; 2]) -> u32 {
        let values = &mut self.values;
        *self.number.entry(uv.map(f64::to_bits)).or_insert_with(|| {
            values.push(uv);
            values.len() as u32 - 1
        })
    }
}

fn lerp2(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [0, 1].map(|k| a[k] + (b[k] - a[k]) * t)
}

impl<'a> Grids<'a> {
    fn new(mesh: &'a PolyMesh, chords: &'a Chords, pieces: &'a [u32]) -> Self {
        let mut positions = mesh.positions.clone();
        let mut reach = vec![0.0; positions.len()];
        let mut first_of = Vec::with_capacity(chords.ends.len());
        for (ends, &chord) in chords.ends.iter().zip(&chords.chord_of) {
            let ([a, b], n) = (ends.map(|v| mesh.positions[v as usize]), pieces[chord as usize]);
            first_of.push(positions.len() as u32);
            positions.extend((1..n).map(|k| a.lerp(&b, f64::from(k) / f64::from(n))));
            reach.resize(positions.len(), REACH * (b - a).norm());
        }
        let uvs = mesh.attributes.uvs.as_ref().map(|from| Uvs {
            from,
            values: Vec::new(),
            number: HashMap::new(),
            corners: Vec::new(),
        });
        let (faces, face_of) = (Polygons::default(), Vec::new());
        Self { mesh, chords, pieces, positions, reach, first_of, faces, face_of, uvs }
    }

    /// Vertex `k` of `n` pieces along corner `corner`'s side, from that corner on.
    fn along(&self, corner: usize, from: u32, k: u32) -> u32 {
        let edge = self.chords.edge_of[corner] as usize;
        let ([low, high], n) = (self.chords.ends[edge], self.pieces[self.chords.chord_of[edge] as usize]);
        let k = if from == low { k } else { n - k };
        match k {
            0 => low,
            k if k == n => high,
            k => self.first_of[edge] + k - 1,
        }
    }

    fn face(&mut self, f: usize) {
        let (mesh, start) = (self.mesh, self.mesh.faces.start(f));
        let face = mesh.faces.face(f);
        if face.len() != 4 {
            self.faces.push(face);
            self.face_of.push(f as u32);
            if let Some(uvs) = &mut self.uvs {
                for k in 0..face.len() {
                    let corner = uvs.from.corners[start + k];
                    let number = if corner == NONE { NONE } else { uvs.number(uvs.from.values[corner as usize]) };
                    uvs.corners.push(number);
                }
            }
            return;
        }
        let [across, down] = self.chords.of_quad(mesh, f as u32).map(|chord| self.pieces[chord as usize]);
        let corners = [0, 1, 2, 3].map(|k| mesh.positions[face[k] as usize]);
        let share = |k: u32, n: u32| f64::from(k) / f64::from(n);
        let mut at = vec![0; ((across + 1) * (down + 1)) as usize];
        for (i, j) in (0..=down).flat_map(|j| (0..=across).map(move |i| (i, j))) {
            at[(j * (across + 1) + i) as usize] = if j == 0 {
                self.along(start, face[0], i)
            } else if j == down {
                self.along(start + 2, face[2], across - i)
            } else if i == 0 {
                self.along(start + 3, face[3], down - j)
            } else if i == across {
                self.along(start + 1, face[1], j)
            } else {
                let (s, t) = (share(i, across), share(j, down));
                let place = corners[0].lerp(&corners[1], s).lerp(&corners[3].lerp(&corners[2], s), t);
                self.positions.push(place);
                self.reach.push(REACH * (corners[2] - corners[0]).norm());
                self.positions.len() as u32 - 1
            };
        }
        let uv_of = self.uvs.as_ref().and_then(|uvs| {
            let of = |k: usize| uvs.from.values.get(uvs.from.corners[start + k] as usize).copied();
            Some([of(0)?, of(1)?, of(2)?, of(3)?])
        });
        for (i, j) in (0..down).flat_map(|j| (0..across).map(move |i| (i, j))) {
            let cell = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            self.faces.push(&cell.map(|(i, j)| at[(j * (across + 1) + i) as usize]));
            self.face_of.push(f as u32);
            let Some(uvs) = &mut self.uvs else { continue };
            for (i, j) in cell {
                let number = uv_of.map_or(NONE, |[a, b, c, d]| {
                    let (s, t) = (share(i, across), share(j, down));
                    uvs.number(lerp2(lerp2(a, b, s), lerp2(d, c, s), t))
                });
                uvs.corners.push(number);
            }
        }
    }

    fn finish(mut self, tree: &Bvh) -> PolyMesh {
        for v in self.mesh.positions.len()..self.positions.len() {
            stop::pass(1);
            let near = tree.closest(self.positions[v]);
            if near.triangle != NONE && near.distance <= self.reach[v] {
                self.positions[v] = near.point;
            }
        }
        let from = &self.mesh.attributes;
        let labels = |labels: &FaceLabels| FaceLabels {
            names: labels.names.clone(),
            of_face: self.face_of.iter().map(|&f| labels.of_face[f as usize]).collect(),
        };
        let segments = |all: &Vec<i64>| self.face_of.iter().map(|&f| all[f as usize]).collect();
        let attributes = Attributes {
            groups: from.groups.as_ref().map(labels),
            materials: from.materials.as_ref().map(labels),
            segments: from.segments.as_ref().map(segments),
            creases: self.creases(&from.creases),
            uvs: self.uvs.map(|uvs| CornerLayer { values: uvs.values, corners: uvs.corners }),
            ..Attributes::default()
        };
        PolyMesh { positions: self.positions, faces: self.faces, attributes }
    }

    /// Creases along the pieces of their edges.
    fn creases(&self, from: &[Crease]) -> Vec<Crease> {
        if from.is_empty() {
            return Vec::new();
        }
        let numbered = self.chords.ends.iter().enumerate().map(|(k, ends)| (*ends, k));
        let edges: HashMap<[u32; 2], usize> = numbered.collect();
        let mut found = Vec::new();
        for crease in from {
            let [a, b] = crease.vertices;
            let Some(&edge) = edges.get(&[a.min(b), a.max(b)]) else { continue };
            let ([low, high], n) = (self.chords.ends[edge], self.pieces[self.chords.chord_of[edge] as usize]);
            let at = |k: u32| {
                if k == 0 {
                    low
                } else if k == n {
                    high
                } else {
                    self.first_of[edge] + k - 1
                }
            };
            found.extend((0..n).map(|k| Crease { vertices: [at(k), at(k + 1)], sharpness: crease.sharpness }));
        }
        found
    }
}
