//! One cut, or one cap, on both sides of a case.
//!
//! The example is cut between faces. On the truth, the example's faces at the input's places, the cut is the zero set of
//! a function that is linear on the faces; the input takes its values from the nearest point of the truth, and is cut
//! through its triangles where they are 0. So neither side knows the other's vertices.

use super::case::Case;
use super::loaded::Loaded;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{NONE, PolyMesh, Polygons, TriMesh, Vec3, prepare};
use std::collections::BTreeMap;

/// How near to a vertex of the input the cut may pass, in mean edges.
const SLIVER: f64 = 0.05;

/// The part of a case whose faces (of the example) are `kept`.
///
/// # Errors
/// A sentence, where a side falls apart.
pub fn cut(case: &Case, kept: &[bool]) -> Result<Case, String> {
    let mesh = &case.example.poly;
    let mut sides = vec![[false; 2]; mesh.positions.len()];
    for (face, kept) in mesh.faces.iter().zip(kept) {
        face.iter().for_each(|&v| sides[v as usize][usize::from(*kept)] = true);
    }
    let used: Vec<usize> = (0..sides.len()).filter(|&v| sides[v][1]).collect();
    let mut number = vec![NONE; sides.len()];
    used.iter().enumerate().for_each(|(k, &v)| number[v] = k as u32);
    let mut faces = Polygons::default();
    for (face, _) in mesh.faces.iter().zip(kept).filter(|(_, kept)| **kept) {
        faces.push(&face.iter().map(|&v| number[v as usize]).collect::<Vec<_>>());
    }
    let positions = used.iter().map(|&v| mesh.positions[v]).collect();
    let example = Loaded::cut(PolyMesh { positions, faces, ..PolyMesh::default() })?;
    let input = Loaded::cut(clipped(&case.input.patch.mesh, &heights(case, &sides)?))?;
    Ok(Case { example, input, truth: used.iter().map(|&v| case.truth[v]).collect() })
}

/// For each vertex of the input how far inside the kept part it lies: 0 on the cut.
fn heights(case: &Case, sides: &[[bool; 2]]) -> Result<Vec<f64>, String> {
    let rim: Vec<Vec3> = (0..sides.len()).filter(|&v| sides[v] == [true; 2]).map(|v| case.truth[v]).collect();
    let height = |v: usize| match sides[v] {
        [true, true] => 0.0,
        [_, kept] => {
            let away = rim.iter().map(|r| (r - case.truth[v]).norm()).fold(f64::INFINITY, f64::min);
            if kept { away } else { -away }
        }
    };
    let truth = PolyMesh { positions: case.truth.clone(), ..case.example.poly.clone() };
    let truth = prepare(&truth).map_err(|e| e.to_string())?;
    let mut of_truth = vec![0.0; truth.mesh.positions.len()];
    for (v, &to) in truth.vertex_of.iter().enumerate() {
        if let Some(slot) = of_truth.get_mut(to as usize) {
            *slot = height(v);
        }
    }
    let bvh = Bvh::new(&truth.mesh);
    let at = |p: &Vec3| {
        let near = bvh.closest(*p);
        let corners = truth.mesh.triangles[near.triangle as usize];
        (0..3).map(|k| near.barycentric[k] * of_truth[corners[k] as usize]).sum::<f64>()
    };
    Ok(case.input.patch.mesh.positions.iter().map(at).collect())
}

/// The part of a mesh on which a function, given at the vertices and linear between them, is positive.
fn clipped(mesh: &TriMesh, height: &[f64]) -> PolyMesh {
    let edges = || (0..mesh.twins.len() as u32).map(|h| [mesh.tail(h), mesh.head(h)].map(|v| v as usize));
    let length: f64 = edges().map(|[a, b]| (mesh.positions[a] - mesh.positions[b]).norm()).sum();
    let least = SLIVER * length / mesh.twins.len().max(1) as f64;
    let height: Vec<f64> = height.iter().map(|h| if *h < 0.0 { h.min(-least) } else { h.max(least) }).collect();
    let (mut positions, mut number) = (Vec::new(), vec![NONE; mesh.positions.len()]);
    let mut crossing: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut faces = Polygons::default();
    for triangle in &mesh.triangles {
        let mut face = Vec::new();
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            let (x, y) = (height[a as usize], height[b as usize]);
            if x > 0.0 {
                if number[a as usize] == NONE {
                    number[a as usize] = positions.len() as u32;
                    positions.push(mesh.positions[a as usize]);
                }
                face.push(number[a as usize]);
            }
            if (x > 0.0) != (y > 0.0) {
                let at = *crossing.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    let share = x / (x - y);
                    positions.push(mesh.positions[a as usize].lerp(&mesh.positions[b as usize], share));
                    positions.len() as u32 - 1
                });
                face.push(at);
            }
        }
        if face.len() > 2 {
            faces.push(&face);
        }
    }
    PolyMesh { positions, faces, ..PolyMesh::default() }
}

/// A case whose boundary is closed by a cone on both sides: to the middle of the example's boundary, and to that of the
/// truth's.
///
/// # Errors
/// A sentence, where what comes of it is no surface.
pub fn capped(case: &Case) -> Result<Case, String> {
    let (mut example, mut truth) = (case.example.poly.clone(), case.truth.clone());
    let surface = &case.example.prepared;
    let mut in_file = vec![NONE; surface.mesh.positions.len()];
    for (v, &to) in surface.vertex_of.iter().enumerate() {
        if let Some(slot) = in_file.get_mut(to as usize) {
            *slot = v as u32;
        }
    }
    let rim: Vec<u32> = rim(&surface.mesh).into_iter().map(|v| in_file[v as usize]).collect();
    let middle = |all: &[Vec3]| rim.iter().map(|&v| all[v as usize]).sum::<Vec3>() / rim.len() as f64;
    let (own, there) = (middle(&example.positions), middle(&truth));
    let rings = rings(&rim, &example.positions, own);
    cone(&rim, rings, &mut example, own);
    let mut faceless = PolyMesh { positions: truth, ..PolyMesh::default() };
    cone(&rim, rings, &mut faceless, there);
    truth = faceless.positions;
    let mesh = &case.input.patch.mesh;
    let faces = mesh.triangles.iter().map(|t| &t[..]).collect();
    let mut input = PolyMesh { positions: mesh.positions.clone(), faces, ..PolyMesh::default() };
    let edge = self::rim(mesh);
    let count = self::rings(&edge, &input.positions, there);
    cone(&edge, count, &mut input, there);
    Ok(Case { example: Loaded::cut(example)?, input: Loaded::cut(input)?, truth })
}

/// The vertices of the only boundary loop, in order.
fn rim(mesh: &TriMesh) -> Vec<u32> {
    mesh.boundary_loops().first().into_iter().flatten().map(|&h| mesh.tail(h)).collect()
}

/// How many rings make a cone's faces about square.
fn rings(rim: &[u32], positions: &[Vec3], tip: Vec3) -> usize {
    let at = |k: usize| positions[rim[k % rim.len()] as usize];
    let edge: f64 = (0..rim.len()).map(|k| (at(k + 1) - at(k)).norm()).sum();
    let radius: f64 = (0..rim.len()).map(|k| (at(k) - tip).norm()).sum();
    ((radius / edge).round() as usize).max(2)
}

/// Adds a cone over a loop (the surface to its left), its rings from the loop to the tip.
fn cone(rim: &[u32], rings: usize, mesh: &mut PolyMesh, tip: Vec3) {
    let n = rim.len();
    let mut outer = rim.to_vec();
    for ring in 1..rings {
        let share = ring as f64 / rings as f64;
        let first = mesh.positions.len() as u32;
        mesh.positions
            .extend(rim.iter().map(|&v| v as usize).map(|v| mesh.positions[v].lerp(&tip, share)).collect::<Vec<_>>());
        let inner: Vec<u32> = (first..first + n as u32).collect();
        for k in 0..n {
            let l = (k + 1) % n;
            mesh.faces.push(&[outer[l], outer[k], inner[k], inner[l]]);
        }
        outer = inner;
    }
    let middle = mesh.positions.len() as u32;
    mesh.positions.push(tip);
    (0..n).for_each(|k| mesh.faces.push(&[outer[(k + 1) % n], outer[k], middle]));
}
