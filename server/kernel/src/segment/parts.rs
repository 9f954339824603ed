//! The parts of one connected surface, as labels on its triangles.

use super::merge::{absorb_small_components, merge};
use super::necks::{Necks, Prominence};
use super::region::Region;
use super::split::{decompose, halve};
use crate::mesh::tri::TriMesh;
use crate::topology;

/// Protrusions that are cut off where no number of parts is asked for.
const NECKS_MAX: usize = 24;
/// Parts with a smaller share of the area are merged into neighbours.
const AREA_MIN: f64 = 0.0012;

/// How many parts a connected surface is cut into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Count {
    /// One for each protrusion, and what the rest needs to be primitives.
    Natural,
    /// This many if its topology allows, else as few as can be.
    Wanted(usize),
}

/// The part of each triangle of a connected surface.
pub(super) fn parts(mesh: &TriMesh, count: Count) -> Vec<u32> {
    let sets = match count {
        Count::Natural => {
            let necks = Necks::of(mesh, Prominence::LIMBS);
            cut_at(mesh, &necks, necks.found.len().min(NECKS_MAX), usize::MAX)
        }
        Count::Wanted(n) => wanted(mesh, &Necks::of(mesh, Prominence::STUBS), n.max(1)),
    };
    topology::numbers(&sets, mesh.triangles.len())
}

/// Cuts at the first `necks_count` necks and makes primitives of what is left.
fn cut_at(mesh: &TriMesh, necks: &Necks, necks_count: usize, count_max: usize) -> Vec<Vec<u32>> {
    let of_vertex = necks.labels(necks_count);
    let majority = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| of_vertex[v as usize]);
        if b == c { b } else { a }
    };
    let mut label_of: Vec<u32> = mesh.triangles.iter().map(majority).collect();
    absorb_small_components(mesh, &mut label_of);
    let regions = topology::connected(mesh, &label_of);
    let primitives: Vec<Vec<u32>> = regions.into_iter().flat_map(|r| decompose(mesh, r)).collect();
    merge(mesh, primitives, AREA_MIN, count_max)
}

fn wanted(mesh: &TriMesh, necks: &Necks, n: usize) -> Vec<Vec<u32>> {
    let mut count = necks.found.len().min(n - 1);
    let mut sets = loop {
        let sets = cut_at(mesh, necks, count, usize::MAX);
        if sets.len() <= n || count == 0 {
            break sets;
        }
        // Each neck less is at least one part less, as a rule.
        count = count.saturating_sub((sets.len() - n).div_ceil(2));
    };
    if sets.len() > n {
        sets = merge(mesh, sets, 0.0, n);
    }
    while sets.len() < n {
        let area = |s: &Vec<u32>| s.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
        let largest =
            (0..sets.len()).filter(|&k| sets[k].len() > 1).max_by(|&a, &b| area(&sets[a]).total_cmp(&area(&sets[b])));
        let Some(largest) = largest else { break };
        let region = Region::new(mesh, sets.swap_remove(largest));
        let halves: Vec<Vec<u32>> = halve(&region).into_iter().flat_map(|h| decompose(mesh, h)).collect();
        let before = sets.len();
        sets.extend(merge(mesh, halves, AREA_MIN, n - before));
        if sets.len() <= before + 1 {
            break;
        }
    }
    sets.sort();
    sets
}
