//! Ways along a surface, from edge to edge: whether two points are about as near on it as they are in space.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use crate::mesh::Vec3;
use crate::mesh::bvh::Closest;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;

/// The edges of a surface. Vertices at the same place are one, so that ways cross from a surface to what fills its gaps.
#[derive(Clone, Debug)]
pub(super) struct Ways {
    /// Edges of vertex v, each by its other end and length: `beside[starts[v]..starts[v + 1]]`.
    starts: Vec<u32>,
    beside: Vec<(u32, f64)>,
    /// The vertex that stands for each of the surface.
    one_of: Vec<u32>,
}

impl Ways {
    pub(super) fn new(surface: &TriMesh) -> Self {
        let mut at: HashMap<[u64; 3], u32> = HashMap::new();
        let key = |p: &Vec3| [p.x, p.y, p.z].map(f64::to_bits);
        let one_of: Vec<u32> = (0u32..).zip(&surface.positions).map(|(v, p)| *at.entry(key(p)).or_insert(v)).collect();
        let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let both = |[a, b]: [u32; 2]| [[a, b], [b, a]];
        let ends = surface.triangles.iter().flat_map(sides).map(|side| side.map(|v| one_of[v as usize]));
        let mut edges: Vec<[u32; 2]> = ends.flat_map(both).collect();
        edges.sort_unstable();
        edges.dedup();
        let mut starts = vec![0u32; one_of.len() + 1];
        edges.iter().for_each(|edge| starts[edge[0] as usize + 1] += 1);
        (0..one_of.len()).for_each(|v| starts[v + 1] += starts[v]);
        let length = |[a, b]: [u32; 2]| (surface.positions[a as usize] - surface.positions[b as usize]).norm();
        let beside = edges.iter().map(|edge| (edge[1], length(*edge))).collect();
        Self { starts, beside, one_of }
    }

    /// Tells whether the shortest way along the edges of the surface is no longer than `limit`. *Source:* Dijkstra 1959.
    pub(super) fn is_within(&self, surface: &TriMesh, [from, to]: [&Closest; 2], limit: f64) -> bool {
        let corners = |place: &Closest| -> Vec<(u32, f64)> {
            let Some(corners) = surface.triangles.get(place.triangle as usize) else { return Vec::new() };
            let away = |v: &u32| (surface.positions[*v as usize] - place.point).norm();
            corners.iter().map(|v| (self.one_of[*v as usize], away(v))).collect()
        };
        if from.triangle != NONE && from.triangle == to.triangle {
            return true;
        }
        let ends = corners(to);
        let mut reached: HashMap<u32, f64> = HashMap::new();
        // Positive finite floats order like their bits, so the heap needs no float wrapper.
        let mut heap: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
        for (v, d) in corners(from) {
            reached.insert(v, d);
            heap.push(Reverse((d.to_bits(), v)));
        }
        while let Some(Reverse((key, v))) = heap.pop() {
            stop::pass(1);
            let d = f64::from_bits(key);
            if d > limit {
                return false;
            }
            if reached.get(&v).is_some_and(|known| d > *known) {
                continue;
            }
            if ends.iter().any(|(end, rest)| *end == v && d + rest <= limit) {
                return true;
            }
            for &(u, length) in &self.beside[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize] {
                let way = d + length;
                if way <= limit && reached.get(&u).is_none_or(|known| way < *known) {
                    reached.insert(u, way);
                    heap.push(Reverse((way.to_bits(), u)));
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::bvh::Bvh;
    use crate::topology::tests::grid;

    #[test]
    fn a_way_leads_round_a_bend_and_across_what_is_glued_on() {
        // A sheet bent to a U with legs .2 apart.
        let mut bent = grid(4, 40, false, false);
        let (high, radius) = (bent.positions.iter().map(|p| p.y).fold(0.0, f64::max), 0.1);
        for p in &mut bent.positions {
            let along = (p.y - high / 2.0) / high * 2.0;
            let angle = along.clamp(-0.2, 0.2) / 0.2 * std::f64::consts::FRAC_PI_2;
            let leg = along.abs() - along.abs().min(0.2);
            *p = Vec3::new(radius * angle.sin(), p.x, radius * (1.0 - angle.cos()) + leg);
        }
        let (tree, ways) = (Bvh::new(&bent), Ways::new(&bent));
        let ends = [tree.closest(Vec3::new(-radius, 0.5, 0.9)), tree.closest(Vec3::new(radius, 0.5, 0.9))];
        let is_within = |limit: f64| ways.is_within(&bent, [&ends[0], &ends[1]], limit);
        assert!(!is_within(0.6) && is_within(3.0));
        // A lid over the opening, of vertices of its own.
        let rim: Vec<Vec3> = bent.positions.iter().filter(|p| p.z > 0.79).copied().collect();
        let first = bent.positions.len() as u32;
        let count = rim.len() as u32;
        bent.positions.extend(rim);
        bent.triangles.extend((0..count / 2 - 1).flat_map(|k| {
            let (a, b, c, d) = (first + k, first + k + 1, first + count / 2 + k, first + count / 2 + k + 1);
            [[a, b, c], [b, d, c]]
        }));
        let ways = Ways::new(&bent);
        assert!(ways.is_within(&bent, [&ends[0], &ends[1]], 0.6));
    }
}
