//! Seams: the curves along which parts border on each other.

use std::collections::BTreeMap;

use crate::mesh::tri::{NONE, TriMesh};

/// A curve along which two parts meet, as long as it can be: it ends where a third part or the boundary begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seam {
    /// The parts, the lower number first.
    pub parts: [u32; 2],
    /// Its vertices in order, the lower part on the left. A closed seam does not repeat its first vertex.
    pub vertices: Vec<u32>,
    /// Whether it returns to its first vertex.
    pub shape: SeamShape,
}

/// Whether a seam has ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeamShape {
    /// It returns to its first vertex.
    Loop,
    /// It ends at junctions or on the boundary.
    Arc,
}

/// The seams between the triangles' parts, in order of their parts, then of their first vertex.
pub(super) fn between(mesh: &TriMesh, part_of: &[u32]) -> Vec<Seam> {
    let mut edges: BTreeMap<[u32; 2], Vec<(u32, u32)>> = BTreeMap::new();
    for h in 0..mesh.twins.len() as u32 {
        let g = mesh.twin(h);
        if g == NONE {
            continue;
        }
        let (a, b) = (part_of[h as usize / 3], part_of[g as usize / 3]);
        if a < b {
            edges.entry([a, b]).or_default().push((mesh.tail(h), mesh.head(h)));
        }
    }
    edges.into_iter().flat_map(|(parts, edges)| chains(parts, &edges)).collect()
}

/// Directed edges joined to curves. Where a pinched vertex has several edges to go on with, curves end.
fn chains(parts: [u32; 2], edges: &[(u32, u32)]) -> Vec<Seam> {
    let mut leaving: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let mut entering: BTreeMap<u32, u32> = BTreeMap::new();
    for &(a, b) in edges {
        leaving.entry(a).or_default().push(b);
        *entering.entry(b).or_default() += 1;
    }
    let goes_on = |v: u32| leaving.get(&v).is_some_and(|to| to.len() == 1) && entering.get(&v) == Some(&1);
    let mut taken: BTreeMap<(u32, u32), bool> = edges.iter().map(|&e| (e, false)).collect();
    let mut seams = Vec::new();
    let starts = edges.iter().filter(|(a, _)| !goes_on(*a)).chain(edges);
    for &(a, b) in starts {
        let mut edge = (a, b);
        let mut vertices = vec![a];
        while let Some(free) = taken.get_mut(&edge).filter(|t| !**t) {
            *free = true;
            vertices.push(edge.1);
            if !goes_on(edge.1) {
                break;
            }
            let Some(&to) = leaving.get(&edge.1).and_then(|to| to.first()) else { break };
            edge = (edge.1, to);
        }
        if vertices.len() < 2 {
            continue;
        }
        let shape = if vertices.len() > 2 && vertices.last() == Some(&a) { SeamShape::Loop } else { SeamShape::Arc };
        if shape == SeamShape::Loop {
            vertices.pop();
        }
        seams.push(Seam { parts, vertices, shape });
    }
    seams
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn rings_meet_in_loops_and_strips_in_arcs() {
        let ring = grid(8, 6, true, false);
        let halves: Vec<u32> = (0..ring.triangles.len() as u32).map(|t| t / 48).collect();
        let found = between(&ring, &halves);
        assert_eq!((found.len(), found[0].shape, found[0].vertices.len()), (1, SeamShape::Loop, 8));
        let sheet = grid(8, 6, false, false);
        let found = between(&sheet, &halves);
        assert_eq!((found.len(), found[0].shape, found[0].vertices.len()), (1, SeamShape::Arc, 9));
    }

    #[test]
    fn the_lower_part_lies_on_the_left() {
        let sheet = grid(4, 2, false, false);
        let halves: Vec<u32> = (0..sheet.triangles.len() as u32).map(|t| t / 8).collect();
        let seam = &between(&sheet, &halves)[0];
        // Row 0 (below) is part 0; with the sheet seen from above, it lies on the left of a curve that runs to −x.
        let x = |k: usize| sheet.positions[seam.vertices[k] as usize].x;
        assert!(x(0) > x(1), "runs from {} to {}", x(0), x(1));
    }
}
