//! Joining the ends of edges without length.
//!
//! A triangle without area cannot simply be left out: that would open a hole. Where its trouble is an edge without length,
//! the edge's ends are joined, unless the surface would then no longer be a manifold; then they stay.

use super::surface::edge_key;
use super::tessellate::Triangles;
use crate::mesh::disjoint::Sets;
use crate::mesh::error::MeshError;
use crate::mesh::repair::{RepairKind, Repairs};
use crate::mesh::tri::pair_halfedges;
use crate::mesh::{NONE, Vec3};
use std::collections::HashMap;

/// Edges shorter than this fraction of the bounding box's diagonal have no length.
const LENGTH_MIN: f64 = 1e-12;
/// Triangles with less than this fraction of their longest side squared as area are flat.
const FLAT: f64 = 1e-12;
/// Rounds of setting vertices apart again before all are.
const ROUNDS_MAX: usize = 6;

/// Joins the ends of edges without length; returns for each old vertex the new one ([`NONE`] where all faces vanished).
///
/// # Errors
/// [`MeshError::NoExtent`] where no triangle is left.
pub(super) fn collapse(
    triangles: &mut Triangles,
    positions: &mut Vec<Vec3>,
    diagonal: f64,
    repairs: &mut Repairs,
) -> Result<Vec<u32>, MeshError> {
    let class_of = classes(triangles, positions, diagonal);
    let joined = (0..positions.len()).filter(|v| class_of[*v] != *v as u32).count();
    if joined == 0 {
        return Ok((0..positions.len() as u32).collect());
    }
    let first = (0..positions.len()).find(|v| class_of[*v] != *v as u32).unwrap_or(0);
    repairs.note_many(RepairKind::CollapsedEdges, joined as u64, first as u32);
    merge(triangles, &class_of);
    if triangles.corners.is_empty() {
        return Err(MeshError::NoExtent {
            diagonal,
            remedy: "its faces are specks of its own size: remove stray vertices",
        });
    }
    let mut used = vec![false; positions.len()];
    triangles.corners.iter().flatten().for_each(|v| used[*v as usize] = true);
    let mut kept = 0;
    let number_of: Vec<u32> = used
        .iter()
        .map(|used| {
            kept += u32::from(*used);
            if *used { kept - 1 } else { NONE }
        })
        .collect();
    triangles.corners.iter_mut().flatten().for_each(|v| *v = number_of[*v as usize]);
    let mut used = used.into_iter();
    positions.retain(|_| used.next().unwrap_or(false));
    Ok(class_of.into_iter().map(|class| number_of[class as usize]).collect())
}

/// Notes triangles without area that are left.
pub(super) fn report_flat(triangles: &Triangles, positions: &[Vec3], repairs: &mut Repairs) {
    for (corners, face) in triangles.corners.iter().zip(&triangles.face_of) {
        let [a, b, c] = corners.map(|v| positions[v as usize]);
        let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        if (b - a).cross(&(c - a)).norm() <= 2.0 * FLAT * longest {
            repairs.note(RepairKind::FlatTriangles, *face);
        }
    }
}

/// For each vertex the smallest one that it is joined with.
fn classes(triangles: &Triangles, positions: &[Vec3], diagonal: f64) -> Vec<u32> {
    let mut sets = Sets::new(positions.len());
    let mut any = false;
    for corners in &triangles.corners {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if (positions[a as usize] - positions[b as usize]).norm() <= LENGTH_MIN * diagonal {
                sets.join(a, b);
                any = true;
            }
        }
    }
    let mut class_of: Vec<u32> = (0..positions.len() as u32).map(|v| sets.root(v)).collect();
    if !any {
        return class_of;
    }
    for round in 0.. {
        let bad = bad_classes(triangles, &class_of);
        if bad.iter().all(|bad| !bad) {
            break;
        }
        let mut changed = false;
        for v in (0..class_of.len()).rev() {
            let class = class_of[v];
            if class != v as u32 && (bad[class as usize] || round >= ROUNDS_MAX) {
                class_of[v] = v as u32;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    class_of
}

/// Classes that would not be manifold vertices, or lie on edges that would not be manifold.
fn bad_classes(triangles: &Triangles, class_of: &[u32]) -> Vec<bool> {
    let mut bad = vec![false; class_of.len()];
    let quotient: Vec<[u32; 3]> = triangles.corners.iter().filter_map(|corners| joined(corners, class_of)).collect();
    let mut edges: Vec<(u64, bool)> = Vec::with_capacity(3 * quotient.len());
    for t in &quotient {
        edges.extend((0..3).map(|k| (edge_key(t[k], t[(k + 1) % 3]), t[k] < t[(k + 1) % 3])));
    }
    edges.sort_unstable();
    for pair in edges.windows(2).filter(|pair| pair[0] == pair[1]) {
        bad[(pair[0].0 >> 32) as usize] = true;
        bad[pair[0].0 as u32 as usize] = true;
    }
    let Ok(twins) = pair_halfedges(&quotient) else { return bad };
    let mut fans = Sets::new(twins.len());
    for (h, twin) in twins.iter().enumerate().filter(|(_, twin)| **twin != NONE) {
        fans.join(h as u32, crate::mesh::tri::next(*twin));
    }
    let mut fan_of = vec![NONE; class_of.len()];
    for h in 0..twins.len() as u32 {
        let (vertex, fan) = (quotient[h as usize / 3][h as usize % 3] as usize, fans.root(h));
        bad[vertex] |= fan_of[vertex] != NONE && fan_of[vertex] != fan;
        fan_of[vertex] = fan;
    }
    bad
}

/// A triangle over classes, unless it vanishes.
fn joined(corners: &[u32; 3], class_of: &[u32]) -> Option<[u32; 3]> {
    let [a, b, c] = corners.map(|v| class_of[v as usize]);
    (a != b && b != c && c != a).then_some([a, b, c])
}

/// Puts classes for vertices. An edge that swallowed others is a phantom only if all of them were.
fn merge(triangles: &mut Triangles, class_of: &[u32]) {
    let mut is_phantom: HashMap<u64, bool> = HashMap::new();
    let vanished = |corners: &[u32; 3]| joined(corners, class_of).is_none();
    for (corners, phantom) in triangles.corners.iter().zip(&triangles.phantom).filter(|(corners, _)| vanished(corners))
    {
        for k in 0..3 {
            let key = edge_key(class_of[corners[k] as usize], class_of[corners[(k + 1) % 3] as usize]);
            *is_phantom.entry(key).or_insert(true) &= phantom[k];
        }
    }
    let mut kept = Triangles::default();
    for t in 0..triangles.corners.len() {
        let Some(corners) = joined(&triangles.corners[t], class_of) else { continue };
        kept.corners.push(corners);
        kept.phantom.push(triangles.phantom[t]);
        kept.face_of.push(triangles.face_of[t]);
        for k in 0..3 {
            if let Some(phantom) = is_phantom.get_mut(&edge_key(corners[k], corners[(k + 1) % 3])) {
                *phantom &= triangles.phantom[t][k];
            }
        }
    }
    for (corners, phantom) in kept.corners.iter().zip(&mut kept.phantom) {
        for k in 0..3 {
            if let Some(merged) = is_phantom.get(&edge_key(corners[k], corners[(k + 1) % 3])) {
                phantom[k] = *merged;
            }
        }
    }
    *triangles = kept;
}
