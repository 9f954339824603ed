//! Stitching open boundaries that lie on each other.
//!
//! Many programs split vertices along UV seams or sharp edges, and soups have no shared vertices at all. Two open edges
//! between equal positions are joined when they are the only two there, or the only two there of one component. A stitch
//! that would contradict the surface's two sides, or lead to two edges between the same vertices, is not made.

use super::surface::{CornerRows, edge_key};
use super::umbrella::fans;
use crate::mesh::disjoint::Sides;
use crate::mesh::weld::{equal_points, near_points};
use crate::mesh::{NONE, Vec3};

/// Points nearer than this fraction of the bounding box's diagonal count as equal where exact equality leads to nothing.
/// It is above the rounding of single precision and far below anything drawn on purpose.
const NEAR: f64 = 1e-6;
/// Rounds of taking back stitches before all are taken back.
const ROUNDS_MAX: usize = 6;

/// Stitches equal, then nearly equal boundaries.
pub(super) fn stitch(surface: &mut CornerRows, sides: &mut Sides, positions: &[Vec3], diagonal: f64) {
    for near in [None, Some(NEAR * diagonal)] {
        let open = open_vertices(surface);
        if open.is_empty() {
            return;
        }
        let points: Vec<Vec3> = open.iter().map(|v| positions[*v as usize]).collect();
        let class_of_point = match near {
            None => equal_points(&points),
            Some(tolerance) => near_points(&points, tolerance),
        };
        if class_of_point.iter().enumerate().all(|(k, class)| *class == k as u32) {
            continue;
        }
        let mut class_of: Vec<u32> = (0..positions.len() as u32).collect();
        open.iter().zip(&class_of_point).for_each(|(v, class)| class_of[*v as usize] = open[*class as usize]);
        let mut made = join_edges(surface, sides, &class_of, |_, _| 0);
        made.extend(join_edges(surface, sides, &class_of, |sides, row| sides.root(row).0));
        take_back_bad(surface, sides, made);
    }
}

/// Vertices of the upload on open edges, sorted.
fn open_vertices(surface: &CornerRows) -> Vec<u32> {
    let open = (0..surface.corner_count()).filter(|c| surface.twins[*c as usize] == NONE);
    let mut vertices: Vec<u32> = open.flat_map(|c| [surface.tail(c), surface.head(c)]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// Joins open edges that are the only two of their group between two classes of points; returns the joined halfedges.
fn join_edges(
    surface: &mut CornerRows,
    sides: &mut Sides,
    class_of: &[u32],
    mut group: impl FnMut(&mut Sides, u32) -> u32,
) -> Vec<[u32; 2]> {
    let ends = |surface: &CornerRows, c| [surface.tail(c), surface.head(c)].map(|v| class_of[v as usize]);
    let mut keyed: Vec<(u64, u32, u32)> = (0..surface.corner_count())
        .filter(|c| surface.twins[*c as usize] == NONE)
        .filter_map(|c| {
            let [a, b] = ends(surface, c);
            (a != b).then(|| (edge_key(a, b), group(sides, surface.row_of[c as usize]), c))
        })
        .collect();
    keyed.sort_unstable();
    let mut made = Vec::new();
    for run in keyed.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        let [(_, _, c), (_, _, d)] = *run else { continue };
        let (row_c, row_d) = (surface.row_of[c as usize], surface.row_of[d as usize]);
        let same_way = ends(surface, c) == ends(surface, d);
        if row_c != row_d && sides.join(row_c, row_d, same_way) {
            surface.twins[c as usize] = d;
            surface.twins[d as usize] = c;
            made.push([c, d]);
        }
    }
    made
}

/// Takes back the stitches at vertices that they made bad, until none is.
pub(super) fn take_back_bad(surface: &mut CornerRows, sides: &mut Sides, mut made: Vec<[u32; 2]>) {
    for round in 0.. {
        let fan_of = fans(surface, |c, d| sides.opposed(surface.row_of[c as usize], surface.row_of[d as usize]));
        let bad = bad_fans(surface, &fan_of);
        if made.is_empty() || bad.iter().all(|bad| !bad) {
            return;
        }
        let is_bad = |surface: &CornerRows, c: u32| {
            [c, surface.next(c)].iter().any(|corner| bad[fan_of[*corner as usize] as usize])
        };
        made.retain(|[c, d]| {
            let keep = round < ROUNDS_MAX && !is_bad(surface, *c);
            if !keep {
                surface.twins[*c as usize] = NONE;
                surface.twins[*d as usize] = NONE;
            }
            keep
        });
    }
}

/// Fans with two edges to the same other fan, fans that meet a row twice, and fans of triangles that coincide.
fn bad_fans(surface: &CornerRows, fan_of: &[u32]) -> Vec<bool> {
    let mut bad = vec![false; fan_of.len()];
    let ends = |c: u32| [fan_of[c as usize], fan_of[surface.next(c) as usize]];
    let mut edges: Vec<u64> = (0..surface.corner_count())
        .filter(|c| surface.twins[*c as usize] == NONE || surface.twins[*c as usize] > *c)
        .map(|c| edge_key(ends(c)[0], ends(c)[1]))
        .collect();
    edges.sort_unstable();
    for pair in edges.windows(2).filter(|pair| pair[0] == pair[1]) {
        bad[(pair[0] >> 32) as usize] = true;
        bad[pair[0] as u32 as usize] = true;
    }
    let mut triangles = Vec::new();
    let (mut by_fan, mut by_vertex) = (Vec::new(), Vec::new());
    for (r, row) in surface.rows.iter().enumerate() {
        let start = surface.rows.start(r);
        by_fan.clear();
        by_fan.extend_from_slice(&fan_of[start..start + row.len()]);
        by_fan.sort_unstable();
        if let [a, b, c] = by_fan[..] {
            triangles.push([a, b, c]);
        }
        if by_fan.windows(2).any(|pair| pair[0] == pair[1]) {
            by_vertex.clear();
            by_vertex.extend_from_slice(row);
            by_vertex.sort_unstable();
            if by_vertex.windows(2).all(|pair| pair[0] != pair[1]) {
                by_fan.windows(2).filter(|pair| pair[0] == pair[1]).for_each(|pair| bad[pair[0] as usize] = true);
            }
        }
    }
    triangles.sort_unstable();
    for pair in triangles.windows(2).filter(|pair| pair[0] == pair[1]) {
        pair[0].iter().for_each(|fan| bad[*fan as usize] = true);
    }
    bad
}
