//! One example for all parts: its own connectivity, whole.
//!
//! Where every part of an input took its map from the part of one example that matches it, nothing is stitched: each
//! vertex goes where its part's map sends it. On a seam the parts' maps agree about the curve but not about the place
//! along it; there a vertex goes to the mean of its places, and what each part's map is off by fades out over the rings of
//! vertices beside the seam. *Source:* paper §6 (phantom edges keep polygons across a cut). *Ours:* the blend.

use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::poly::PolyMesh;
use crate::mesh::tri::{NONE, TriMesh};

/// Rings of vertices over which a seam's correction fades.
const RINGS: usize = 6;
/// Rings that are relaxed afterwards, and how often.
const RELAXED: usize = 3;
const ROUNDS: usize = 4;

/// Why parts could not be joined.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RejoinError {
    /// The parts' meshes are not the example's parts.
    #[error("expected the {expected} vertices of part {part} of the example, found {found}")]
    Vertices {
        /// Number of the part.
        part: usize,
        /// Vertices of the example's part.
        expected: usize,
        /// Vertices of the mapped part.
        found: usize,
    },
    /// Some parts are mirrored and some are not.
    #[error("expected parts that are all mirrored or all not, found both")]
    Mirrored,
}

/// The example at the positions of its mapped parts.
///
/// `part_of` gives the part of each face; `mapped` holds the mesh of each part as [`super::assemble`] made it: the faces
/// of that part in order, with the vertices that they use in order. `input` is the surface they lie on.
///
/// # Errors
/// [`RejoinError`].
pub fn rejoin(
    example: &PolyMesh,
    part_of: &[u32],
    mapped: &[&PolyMesh],
    input: &TriMesh,
) -> Result<PolyMesh, RejoinError> {
    let parts: Vec<Vec<u32>> = (0..mapped.len()).map(|part| vertices_of(example, part_of, part as u32)).collect();
    for (part, (vertices, mesh)) in parts.iter().zip(mapped).enumerate() {
        if vertices.len() != mesh.positions.len() {
            return Err(RejoinError::Vertices { part, expected: vertices.len(), found: mesh.positions.len() });
        }
    }
    let mirrored = winding(example, part_of, mapped)?;
    let pieces: Vec<MappedPart<'_>> =
        parts.iter().zip(mapped).map(|(vertices, mesh)| MappedPart { vertices, positions: &mesh.positions }).collect();
    let net = VertexAdjacency::new(example.positions.len(), example.faces.iter());
    let positions = blend(&example.positions, &net, &pieces, &Bvh::new(input));
    let mut mesh = PolyMesh { positions, faces: example.faces.clone(), attributes: example.attributes.clone() };
    mesh.attributes.normals = None;
    if mirrored {
        super::assemble::reverse(&mut mesh);
    }
    Ok(mesh)
}

/// A mapped part: its vertices among the whole's, and where each goes.
#[derive(Clone, Copy, Debug)]
pub struct MappedPart<'a> {
    /// Vertices of the whole.
    pub vertices: &'a [u32],
    /// Where they go.
    pub positions: &'a [Vec3],
}

/// Tells which vertices of a mesh are neighbours, and which lie on its rim.
#[derive(Clone, Debug)]
pub struct VertexAdjacency {
    around: Vec<Vec<u32>>,
    rim: Vec<bool>,
}

impl VertexAdjacency {
    /// The net of some faces over `count` vertices.
    pub fn new<'a>(count: usize, faces: impl Iterator<Item = &'a [u32]> + Clone) -> Self {
        Self { around: neighbours(count, faces.clone()), rim: rim(count, faces) }
    }

    /// The net of triangles.
    pub fn of(mesh: &TriMesh) -> Self {
        Self::new(mesh.positions.len(), mesh.triangles.iter().map(|t| &t[..]))
    }
}

/// Where the vertices of a mesh go that was mapped in pieces. Those of several pieces go to the mean of their places,
/// those near them follow; `at_rest` is for vertices of none.
pub fn blend(at_rest: &[Vec3], net: &VertexAdjacency, pieces: &[MappedPart<'_>], input: &Bvh) -> Vec<Vec3> {
    let mut sums = vec![(Vec3::zeros(), 0u32); at_rest.len()];
    for piece in pieces {
        for (&v, x) in piece.vertices.iter().zip(piece.positions) {
            sums[v as usize].0 += x;
            sums[v as usize].1 += 1;
        }
    }
    let on_seam: Vec<bool> = sums.iter().map(|s| s.1 > 1).collect();
    let mean = |((sum, n), x): (&(Vec3, u32), &Vec3)| if *n > 0 { sum / f64::from(*n) } else { *x };
    let mut positions: Vec<Vec3> = sums.iter().zip(at_rest).map(mean).collect();
    for piece in pieces {
        correct(piece, &on_seam, &net.around, &mut positions);
    }
    relax(&on_seam, net, input, &mut positions);
    positions
}

/// The vertices that a part's faces use, in order.
fn vertices_of(example: &PolyMesh, part_of: &[u32], part: u32) -> Vec<u32> {
    let mut used = vec![false; example.positions.len()];
    for (face, _) in example.faces.iter().zip(part_of).filter(|(_, p)| **p == part) {
        face.iter().for_each(|&v| used[v as usize] = true);
    }
    (0..used.len() as u32).filter(|&v| used[v as usize]).collect()
}

/// Whether the parts' faces run against the example's, told by the first face of each.
fn winding(example: &PolyMesh, part_of: &[u32], mapped: &[&PolyMesh]) -> Result<bool, RejoinError> {
    let mut found = Vec::new();
    for (part, mesh) in mapped.iter().enumerate() {
        let vertices = vertices_of(example, part_of, part as u32);
        let first = example.faces.iter().zip(part_of).find(|(_, p)| **p == part as u32);
        let (Some((face, _)), false) = (first, mesh.faces.is_empty()) else { continue };
        // The first corner stays first when a face is turned over.
        let second = mesh.faces.face(0).get(1).and_then(|&v| vertices.get(v as usize));
        found.push(second != face.get(1));
    }
    match found.iter().all(|m| Some(m) == found.first()) {
        true => Ok(found.first().copied().unwrap_or(false)),
        false => Err(RejoinError::Mirrored),
    }
}

fn neighbours<'a>(count: usize, faces: impl Iterator<Item = &'a [u32]>) -> Vec<Vec<u32>> {
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); count];
    for face in faces {
        for k in 0..face.len() {
            let (a, b) = (face[k], face[(k + 1) % face.len()]);
            around[a as usize].push(b);
            around[b as usize].push(a);
        }
    }
    for list in &mut around {
        list.sort_unstable();
        list.dedup();
    }
    around
}

/// Vertices on edges of one face.
fn rim<'a>(count: usize, faces: impl Iterator<Item = &'a [u32]>) -> Vec<bool> {
    let mut edges: Vec<[u32; 2]> = Vec::new();
    for face in faces {
        edges.extend((0..face.len()).map(|k| {
            let (a, b) = (face[k], face[(k + 1) % face.len()]);
            [a.min(b), a.max(b)]
        }));
    }
    edges.sort_unstable();
    let mut rim = vec![false; count];
    for run in edges.chunk_by(|a, b| a == b).filter(|run| run.len() == 1) {
        run[0].iter().for_each(|&v| rim[v as usize] = true);
    }
    rim
}

/// Moves the vertices of a part near its seams by what the seam's vertices were moved, less and less.
fn correct(piece: &MappedPart<'_>, on_seam: &[bool], around: &[Vec<u32>], positions: &mut [Vec3]) {
    let (part, own) = (piece.vertices, piece.positions);
    let mut number = vec![NONE; positions.len()];
    part.iter().enumerate().for_each(|(k, &v)| number[v as usize] = k as u32);
    let mut offset: Vec<Option<Vec3>> =
        part.iter().zip(own).map(|(&v, x)| on_seam[v as usize].then(|| positions[v as usize] - x)).collect();
    for ring in 1..=RINGS {
        let mut reached = Vec::new();
        for (k, &v) in part.iter().enumerate().filter(|(k, _)| offset[*k].is_none()) {
            let near =
                around[v as usize].iter().filter_map(|&w| offset.get(number[w as usize] as usize).copied().flatten());
            let (sum, count) = near.fold((Vec3::zeros(), 0.0), |(s, n), d| (s + d, n + 1.0));
            if count > 0.0 {
                reached.push((k, sum / count));
            }
        }
        for (k, mean) in reached {
            offset[k] = Some(mean);
            let fade = 1.0 - ring as f64 / (RINGS + 1) as f64;
            positions[part[k] as usize] = own[k] + mean * (fade * fade);
        }
    }
}

/// Averages the vertices around the seams with their neighbours and puts all of them back on the input. The example's
/// boundary stays where it is.
fn relax(on_seam: &[bool], VertexAdjacency { around, rim }: &VertexAdjacency, bvh: &Bvh, positions: &mut [Vec3]) {
    let mut ring: Vec<usize> = on_seam.iter().map(|s| if *s { 0 } else { usize::MAX }).collect();
    for depth in 1..=RINGS {
        for v in 0..ring.len() {
            if ring[v] == usize::MAX && around[v].iter().any(|&w| ring[w as usize] == depth - 1) {
                ring[v] = depth;
            }
        }
    }
    let moved: Vec<usize> = (0..ring.len()).filter(|&v| ring[v] <= RINGS && !rim[v]).collect();
    let on_input = |x: Vec3| {
        let closest = bvh.closest(x);
        if closest.triangle == NONE { x } else { closest.point }
    };
    for _ in 0..ROUNDS {
        let mean = |v: usize| {
            let sum: Vec3 = around[v].iter().map(|&w| positions[w as usize]).sum();
            0.5 * (positions[v] + sum / around[v].len().max(1) as f64)
        };
        let next: Vec<(usize, Vec3)> =
            moved.iter().filter(|&&v| ring[v] <= RELAXED).map(|&v| (v, on_input(mean(v)))).collect();
        next.into_iter().for_each(|(v, x)| positions[v] = x);
    }
    moved.iter().filter(|&&v| ring[v] > RELAXED).for_each(|&v| positions[v] = on_input(positions[v]));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::assemble::select;

    /// A sheet of 10 × 10 quads, its left and right half as parts, and the surface that it lies on.
    fn sheet() -> (PolyMesh, Vec<u32>, TriMesh) {
        let positions: Vec<Vec3> =
            (0..121).map(|v| Vec3::new(f64::from(v % 11) / 10.0, f64::from(v / 11) / 10.0, 0.0)).collect();
        let quads: Vec<[u32; 4]> =
            (0..100).map(|f| (f % 10) + 11 * (f / 10)).map(|a| [a, a + 1, a + 12, a + 11]).collect();
        let faces = quads.iter().map(|q| &q[..]).collect();
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        let surface = TriMesh::from_triangles(positions.clone(), triangles).expect("a sheet");
        let part_of = (0..100).map(|f| u32::from(f % 10 >= 5)).collect();
        (PolyMesh { positions, faces, ..PolyMesh::default() }, part_of, surface)
    }

    #[test]
    fn parts_that_slid_along_their_seam_meet_half_way_and_keep_the_faces() {
        let (example, part_of, surface) = sheet();
        let mut parts: Vec<PolyMesh> =
            [0, 1].map(|p| select(&example, &part_of.iter().map(|x| *x == p).collect::<Vec<_>>())).to_vec();
        for x in &mut parts[0].positions {
            x.y += 0.03 * x.y * (1.0 - x.y);
        }
        let joined = rejoin(&example, &part_of, &[&parts[0], &parts[1]], &surface).expect("two halves");
        assert_eq!(joined.faces, example.faces);
        let off = |v: usize| (joined.positions[v] - example.positions[v]).norm();
        let worst = (0..121).map(off).fold(0.0, f64::max);
        assert!(worst < 0.012, "{worst}");
        let step = |v: usize| (joined.positions[v + 1] - joined.positions[v]).norm();
        assert!((step(59) - 0.1).abs() < 0.01 && (step(60) - 0.1).abs() < 0.01);
    }

    #[test]
    fn a_mirrored_part_beside_an_unmirrored_one_is_refused() {
        let (example, part_of, surface) = sheet();
        let mut parts: Vec<PolyMesh> =
            [0, 1].map(|p| select(&example, &part_of.iter().map(|x| *x == p).collect::<Vec<_>>())).to_vec();
        crate::map::assemble::reverse(&mut parts[1]);
        let error = rejoin(&example, &part_of, &[&parts[0], &parts[1]], &surface).expect_err("one is mirrored");
        assert_eq!(error, RejoinError::Mirrored);
    }

    #[test]
    fn a_part_of_another_example_is_refused() {
        let (example, part_of, surface) = sheet();
        let part = select(&example, &part_of.iter().map(|x| *x == 0).collect::<Vec<_>>());
        let error = rejoin(&example, &part_of, &[&part, &example], &surface).expect_err("the whole is no part");
        assert_eq!(error, RejoinError::Vertices { part: 1, expected: 66, found: 121 });
    }
}
