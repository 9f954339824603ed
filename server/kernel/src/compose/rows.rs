//! A mesh of quads with more or fewer rows: its layout stays, and so does every extraordinary vertex.
//!
//! Opposite sides of a quad are in step: all edges that are so linked are one *chord*, and cross the quads of one row. A row is
//! split by giving each edge of its chord more pieces ([`split`]), or taken out by merging the ends of each of its edges
//! ([`merge`]). So a count of quads, or a distance from the surface, is reached without another layout. *Source:* Daniels et al.
//! 2008 (chords, and their collapse). *Ours, not a paper's:* the order in which rows are taken, and when they may be.

mod merge;
mod split;

use super::fit::MeasuredSurface;
use crate::mesh::bvh::Bvh;
use crate::mesh::disjoint::Sets;
use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, diagonal};
use crate::numerics::stop;
use std::collections::HashMap;
use std::sync::Arc;

/// The size that is wanted of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SizeTarget {
    /// About so many faces.
    Quads(usize),
    /// 95 % of the mesh as near to the surface, and of the surface as near to the mesh, as this share of the surface's diagonal.
    Within(f64),
}

/// A mesh of another size.
#[derive(Clone, Debug)]
pub struct Resized {
    /// The mesh. UVs, groups, materials and creases are as they were; normals and colours are left out.
    pub mesh: PolyMesh,
    /// The distance that 95 % of the mesh and of the surface have from each other at most, as a share of the surface's diagonal.
    pub within: f64,
}

/// A mesh has its wanted number of faces when it is off by less than this share.
const NEAR: f64 = 0.03;
/// Faces are so many times more at each step to a distance, until one of them is enough.
const STEP: f64 = 1.5;
/// So many faces are enough, whatever the distance: as many times those that there are, or those of a coarse mesh, and in all.
const TIMES_MAX: usize = 16;
const COARSE: usize = 1000;
const FACES_MAX: usize = 200_000;
/// A step that comes nearer by less than this share helps no more: the rest is bare, or beyond the mesh.
const HELPS: f64 = 0.95;

/// Most faces that a mesh of so many gets to come nearer to its surface.
pub fn faces_within_max(own: usize) -> usize {
    (TIMES_MAX * own.max(COARSE)).min(FACES_MAX).max(own)
}

/// Splits rows of a mesh that lies on a surface, or takes some out.
pub fn resized(mesh: &PolyMesh, surface: &TriMesh, wanted: SizeTarget) -> Resized {
    let tree = Arc::new(Bvh::new(surface));
    let measured = MeasuredSurface::with_tree(surface, Arc::clone(&tree));
    let diagonal = diagonal(&surface.positions).max(f64::MIN_POSITIVE);
    let within =
        |mesh: &PolyMesh| measured.distances(mesh).map(|found| p95(&found)).into_iter().fold(0.0, f64::max) / diagonal;
    let of = |mesh: PolyMesh| Resized { within: within(&mesh), mesh };
    let most = match wanted {
        SizeTarget::Quads(count) => return of(with_faces(mesh, &tree, count)),
        SizeTarget::Within(most) => most,
    };
    let mut best = of(mesh.clone());
    let mut count = mesh.faces.len() as f64;
    let faces_max = faces_within_max(mesh.faces.len());
    while best.within > most && count < faces_max as f64 {
        stop::ask();
        count *= STEP;
        let next = of(with_faces(mesh, &tree, (count as usize).min(faces_max)));
        if next.within > HELPS * best.within {
            break;
        }
        best = next;
    }
    best
}

/// The mesh with about `count` faces, or as near to it as its rows allow.
fn with_faces(mesh: &PolyMesh, tree: &Bvh, count: usize) -> PolyMesh {
    let own = mesh.faces.len() as f64;
    if own > count as f64 * (1.0 + NEAR) {
        let fewer = merge::merged(mesh, tree, count);
        // What had to stay may be over, and what was taken may be too much.
        return if (fewer.faces.len() as f64) < count as f64 * (1.0 - NEAR) {
            split::split(&fewer, tree, count)
        } else {
            fewer
        };
    }
    split::split(mesh, tree, count)
}

fn p95(distances: &[(crate::mesh::Vec3, f64)]) -> f64 {
    let mut all: Vec<f64> = distances.iter().map(|d| d.1).filter(|d| d.is_finite()).collect();
    let at = (all.len() * 95 / 100).min(all.len().saturating_sub(1));
    if all.is_empty() { 0.0 } else { *all.select_nth_unstable_by(at, f64::total_cmp).1 }
}

/// The chords of a mesh.
#[derive(Debug)]
struct Chords {
    /// The edge of each corner: that to the next corner of its face.
    edge_of: Vec<u32>,
    /// The ends of each edge, the lower first.
    ends: Vec<[u32; 2]>,
    /// The chord of each edge, from 0.
    chord_of: Vec<u32>,
    /// The quads that each chord crosses; one that it crosses twice is there twice.
    quads: Vec<Vec<u32>>,
    /// The mean length of each chord's edges.
    lengths: Vec<f64>,
    /// Chords of an edge of a face that is no quad, which can't be split or merged.
    is_fixed: Vec<bool>,
}

impl Chords {
    fn of(mesh: &PolyMesh) -> Self {
        stop::pass(mesh.faces.len());
        let mut number: HashMap<[u32; 2], u32> = HashMap::new();
        let (mut edge_of, mut ends) = (Vec::with_capacity(mesh.faces.corners().len()), Vec::new());
        for face in mesh.faces.iter() {
            for (k, &a) in face.iter().enumerate() {
                let b = face[(k + 1) % face.len()];
                let edge = [a.min(b), a.max(b)];
                let found = *number.entry(edge).or_insert_with(|| {
                    ends.push(edge);
                    ends.len() as u32 - 1
                });
                edge_of.push(found);
            }
        }
        let mut sets = Sets::new(ends.len());
        let sides = |f: usize| {
            let start = mesh.faces.start(f);
            &edge_of[start..start + mesh.faces.face(f).len()]
        };
        for f in (0..mesh.faces.len()).filter(|&f| mesh.faces.face(f).len() == 4) {
            let side = sides(f);
            for [a, b] in [[side[0], side[2]], [side[1], side[3]]] {
                sets.join(a, b);
            }
        }
        let mut chord_of = vec![u32::MAX; ends.len()];
        let mut count = 0;
        for edge in 0..ends.len() as u32 {
            let first = sets.root(edge) as usize;
            if chord_of[first] == u32::MAX {
                chord_of[first] = count;
                count += 1;
            }
            chord_of[edge as usize] = chord_of[first];
        }
        let mut found = Self {
            quads: vec![Vec::new(); count as usize],
            lengths: vec![0.0; count as usize],
            is_fixed: vec![false; count as usize],
            edge_of: Vec::new(),
            ends,
            chord_of,
        };
        for (f, face) in mesh.faces.iter().enumerate() {
            let side = sides(f);
            match face.len() {
                4 => side[..2].iter().for_each(|&e| found.quads[found.chord_of[e as usize] as usize].push(f as u32)),
                _ => side.iter().for_each(|&e| found.is_fixed[found.chord_of[e as usize] as usize] = true),
            }
        }
        let mut edges = vec![0u32; count as usize];
        for (ends, &chord) in found.ends.iter().zip(&found.chord_of) {
            let [a, b] = ends.map(|v| mesh.positions[v as usize]);
            found.lengths[chord as usize] += (a - b).norm();
            edges[chord as usize] += 1;
        }
        found.lengths.iter_mut().zip(edges).for_each(|(length, edges)| *length /= f64::from(edges.max(1)));
        found.edge_of = edge_of;
        found
    }

    /// The chords across which a quad has its first and its second side.
    fn of_quad(&self, mesh: &PolyMesh, f: u32) -> [u32; 2] {
        let start = mesh.faces.start(f as usize);
        [0, 1].map(|k| self.chord_of[self.edge_of[start + k] as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{CornerLayer, FaceLabels, Polygons, Vec3, prepare};

    /// A cube of n × n quads a side, pushed out to a ball: eight vertices of three edges.
    fn ball(n: usize) -> PolyMesh {
        let mut number: HashMap<[i64; 3], u32> = HashMap::new();
        let (mut positions, mut faces) = (Vec::new(), Polygons::default());
        let n = n as i64;
        for axis in 0..3 {
            for side in [0, n] {
                for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
                    let mut corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(a, b)| {
                        let mut at = [0; 3];
                        (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, a, b);
                        *number.entry(at).or_insert_with(|| {
                            let p = Vec3::from_iterator(at.map(|x| 2.0 * x as f64 / n as f64 - 1.0));
                            positions.push(p / p.norm());
                            positions.len() as u32 - 1
                        })
                    });
                    if side == 0 {
                        corners.reverse();
                    }
                    faces.push(&corners);
                }
            }
        }
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    fn surface() -> TriMesh {
        TriMesh::clone(&prepare(&ball(40)).expect("a ball").mesh)
    }

    fn extraordinary(mesh: &PolyMesh) -> Vec<usize> {
        let mut valence = vec![0; mesh.positions.len()];
        mesh.faces.corners().iter().for_each(|&v| valence[v as usize] += 1);
        let mut found: Vec<usize> = valence.into_iter().filter(|v| *v != 4).collect();
        found.sort_unstable();
        found
    }

    #[test]
    fn any_count_is_reached_and_the_layout_stays() {
        let (mesh, surface) = (ball(8), surface());
        for count in [70, 96, 200, 384, 500, 1000, 1700, 5000] {
            let found = resized(&mesh, &surface, SizeTarget::Quads(count)).mesh;
            let off = found.faces.len() as f64 / count as f64 - 1.0;
            assert!(off.abs() <= 0.1, "{count}: {}", found.faces.len());
            assert_eq!(extraordinary(&found), [3; 8], "{count}");
            assert!(found.faces.iter().all(|face| face.len() == 4));
            let prepared = prepare(&found).expect("a surface");
            assert!(prepared.repairs.is_empty(), "{count}: {:?}", prepared.repairs);
            let worst = found.positions.iter().map(|p| (p.norm() - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst < 0.01, "{count}: {worst}");
        }
    }

    #[test]
    fn rows_are_split_until_the_mesh_is_near_enough() {
        let (mesh, surface) = (ball(3), surface());
        let [coarse, fine] = [0.02, 0.002].map(|most| resized(&mesh, &surface, SizeTarget::Within(most)));
        assert!(coarse.within <= 0.02 && fine.within <= 0.002, "{} {}", coarse.within, fine.within);
        assert!(coarse.mesh.faces.len() < fine.mesh.faces.len() && fine.mesh.faces.len() < 4000);
        // What is near enough stays as it is.
        assert!(resized(&mesh, &surface, SizeTarget::Within(1.0)).mesh == mesh);
    }

    #[test]
    fn uvs_and_groups_go_with_their_quads() {
        let mut mesh = ball(4);
        let faces = mesh.faces.len();
        let corners = (0..4 * faces as u32).collect();
        let values = mesh
            .faces
            .corners()
            .iter()
            .map(|&v| {
                let p = mesh.positions[v as usize];
                [p.x, p.y]
            })
            .collect();
        mesh.attributes.uvs = Some(CornerLayer { values, corners });
        let of_face = (0..faces as u32).map(|f| f % 2).collect();
        mesh.attributes.groups = Some(FaceLabels { names: vec!["a".into(), "b".into()], of_face });
        let found = resized(&mesh, &surface(), SizeTarget::Quads(4 * faces)).mesh;
        let (uvs, groups) = (found.attributes.uvs.expect("uvs"), found.attributes.groups.expect("groups"));
        assert_eq!((found.faces.len(), uvs.corners.len(), groups.of_face.len()), (4 * faces, 16 * faces, 4 * faces));
        for (&v, &uv) in found.faces.corners().iter().zip(&uvs.corners) {
            let (p, uv) = (found.positions[v as usize], uvs.values[uv as usize]);
            assert!((p.x - uv[0]).abs() < 0.1 && (p.y - uv[1]).abs() < 0.1, "{p} {uv:?}");
        }
        let fewer = resized(&mesh, &surface(), SizeTarget::Quads(60)).mesh;
        let uvs = fewer.attributes.uvs.expect("uvs");
        assert!((54..=66).contains(&fewer.faces.len()), "{}", fewer.faces.len());
        assert_eq!(uvs.corners.len(), 4 * fewer.faces.len());
    }

    #[test]
    fn what_is_no_quad_keeps_its_edges() {
        let mut mesh = ball(4);
        let kept: Vec<Vec<u32>> = mesh.faces.iter().map(<[u32]>::to_vec).collect();
        let triangles = kept[1..].iter().map(Vec::as_slice).chain([&kept[0][..3]]).chain([]);
        let last = [kept[0][0], kept[0][2], kept[0][3]];
        mesh.faces = triangles.chain([&last[..]]).collect();
        let found = resized(&mesh, &surface(), SizeTarget::Quads(300)).mesh;
        assert!(found.faces.len() > 200);
        assert_eq!(found.faces.iter().filter(|face| face.len() == 3).count(), 2);
        assert!(prepare(&found).expect("a surface").repairs.is_empty());
    }
}
