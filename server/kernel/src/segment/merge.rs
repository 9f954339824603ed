//! Merging parts: small components that no one asked for, and parts beyond the number asked for.

use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;
use crate::topology::{self, Topology};
use std::collections::BTreeMap;

/// Merges each part whose share of the area is below `area_min` into a neighbour, as long as the two are one disc or
/// annulus; then further smallest parts while there are more than `count_max`.
pub(super) fn merge(mesh: &TriMesh, parts: Vec<Vec<u32>>, area_min: f64, count_max: usize) -> Vec<Vec<u32>> {
    let mut merger = Merger::new(mesh, parts);
    let total: f64 = merger.areas.iter().sum();
    let mut stuck = vec![false; merger.parts.len()];
    loop {
        let alive = merger.parts.iter().filter(|p| !p.is_empty()).count();
        let too_many = alive > count_max;
        let wanted =
            |k: &usize| !stuck[*k] && !merger.parts[*k].is_empty() && (too_many || merger.areas[*k] < area_min * total);
        let smallest =
            (0..merger.parts.len()).filter(wanted).min_by(|&a, &b| merger.areas[a].total_cmp(&merger.areas[b]));
        let Some(k) = smallest else { break };
        match merger.neighbour_to_join(k) {
            Some(grown) => stuck[grown] = false,
            None => stuck[k] = true,
        }
    }
    let mut parts: Vec<Vec<u32>> = merger.parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.iter_mut().for_each(|p| p.sort_unstable());
    parts.sort();
    parts
}

/// Gives every piece of a label that is not its largest to the label with which it has the longest border.
pub(super) fn absorb_small_components(mesh: &TriMesh, label_of: &mut [u32]) {
    for _ in 0..ABSORB_ROUNDS {
        let sets = topology::connected(mesh, label_of);
        let set_of = topology::numbers(&sets, label_of.len());
        let mut largest: BTreeMap<u32, usize> = BTreeMap::new();
        for (k, set) in sets.iter().enumerate() {
            let best = largest.entry(label_of[set[0] as usize]).or_insert(k);
            if set.len() > sets[*best].len() {
                *best = k;
            }
        }
        let small: Vec<usize> =
            (0..sets.len()).filter(|&k| largest.get(&label_of[sets[k][0] as usize]) != Some(&k)).collect();
        if small.is_empty() {
            return;
        }
        for k in small {
            let borders = borders(mesh, &sets[k], &set_of);
            if let Some((to, _)) = longest(&borders, k as u32).first() {
                let label = label_of[sets[*to as usize][0] as usize];
                sets[k].iter().for_each(|&t| label_of[t as usize] = label);
            }
        }
    }
}

/// Rounds in which small components change their label, at most.
const ABSORB_ROUNDS: usize = 8;

struct Merger<'a> {
    mesh: &'a TriMesh,
    parts: Vec<Vec<u32>>,
    part_of: Vec<u32>,
    areas: Vec<f64>,
}

impl<'a> Merger<'a> {
    fn new(mesh: &'a TriMesh, parts: Vec<Vec<u32>>) -> Self {
        let part_of = topology::numbers(&parts, mesh.triangles.len());
        let area = |p: &Vec<u32>| p.iter().map(|&t| mesh.area(t as usize)).sum();
        Self { mesh, part_of, areas: parts.iter().map(area).collect(), parts }
    }

    /// Merges part `k` into the neighbour with the longest border that allows it; returns that one.
    fn neighbour_to_join(&mut self, k: usize) -> Option<usize> {
        let borders = borders(self.mesh, &self.parts[k], &self.part_of);
        for (other, _) in longest(&borders, k as u32) {
            let other = other as usize;
            let mut union = self.parts[other].clone();
            union.extend(&self.parts[k]);
            let (mesh, _) = topology::submesh(self.mesh, &union);
            if matches!(topology::classify(&mesh), Ok(Topology::Disc | Topology::Annulus)) {
                self.parts[k].iter().for_each(|&t| self.part_of[t as usize] = other as u32);
                self.areas[other] += self.areas[k];
                self.parts[other] = union;
                self.parts[k].clear();
                return Some(other);
            }
        }
        None
    }
}

/// Length of the border between a set and each other.
fn borders(mesh: &TriMesh, set: &[u32], set_of: &[u32]) -> BTreeMap<u32, f64> {
    stop::pass(set.len());
    let mut borders = BTreeMap::new();
    for h in set.iter().flat_map(|&t| 3 * t..3 * t + 3) {
        let g = mesh.twin(h);
        if g != NONE {
            let length = (mesh.positions[mesh.head(h) as usize] - mesh.positions[mesh.tail(h) as usize]).norm();
            *borders.entry(set_of[g as usize / 3]).or_insert(0.0) += length;
        }
    }
    borders
}

/// The neighbours of set `own`, the longest border first.
fn longest(borders: &BTreeMap<u32, f64>, own: u32) -> Vec<(u32, f64)> {
    let mut sorted: Vec<(u32, f64)> = borders.iter().map(|(k, l)| (*k, *l)).filter(|b| b.0 != own).collect();
    sorted.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    sorted
}
