//! The sharp edges that are creases: long enough, and in rows.
//!
//! Sharp edges that meet are one line. A line counts where it is long and few of its vertices are loose ends or
//! branchings: on noise sharp edges are many, and in no row. *Ours, not the paper's.*

use crate::mesh::disjoint::Sets;
use crate::mesh::tri::TriMesh;
use std::collections::BTreeMap;

/// Most of a line's vertices that may be ends or branchings: *untuned*.
const ENDS_MAX: f64 = 0.2;

/// Filters sharp edges, a halfedge of each: keeps those that are part of a line of at least this length.
pub(super) fn long(mesh: &TriMesh, sharp: &[u32], length_min: f64) -> Vec<u32> {
    let mut degree: BTreeMap<u32, usize> = BTreeMap::new();
    let mut sets = Sets::new(mesh.positions.len());
    for &h in sharp {
        let (a, b) = (mesh.tail(h), mesh.head(h));
        *degree.entry(a).or_default() += 1;
        *degree.entry(b).or_default() += 1;
        sets.join(a, b);
    }
    let mut length: BTreeMap<u32, f64> = BTreeMap::new();
    for &h in sharp {
        let (a, b) = (mesh.tail(h), mesh.head(h));
        *length.entry(sets.root(a)).or_default() += (mesh.positions[b as usize] - mesh.positions[a as usize]).norm();
    }
    let mut ends: BTreeMap<u32, [usize; 2]> = BTreeMap::new();
    for (&v, &d) in &degree {
        let count = ends.entry(sets.root(v)).or_default();
        count[usize::from(d != 2)] += 1;
    }
    let is_long = |root: u32| {
        let [rows, ends] = ends.get(&root).copied().unwrap_or_default();
        length.get(&root).is_some_and(|l| *l >= length_min) && ends as f64 <= ENDS_MAX * (rows + ends) as f64
    };
    sharp.iter().copied().filter(|&h| is_long(sets.root(mesh.tail(h)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_long_row_counts_and_scattered_edges_do_not() {
        let mesh = grid(20, 20, false, false);
        let row: Vec<u32> = (0..mesh.twins.len() as u32)
            .filter(|&h| {
                let [a, b] = [mesh.tail(h), mesh.head(h)].map(|v| mesh.positions[v as usize]);
                a.y == 0.5 && b.y == 0.5 && a.x < b.x
            })
            .collect();
        assert_eq!(row.len(), 20);
        assert_eq!(long(&mesh, &row, 0.9), row);
        assert!(long(&mesh, &row, 1.1).is_empty());
        let scattered: Vec<u32> = row.iter().copied().step_by(2).collect();
        assert!(long(&mesh, &scattered, 0.2).is_empty());
    }
}
