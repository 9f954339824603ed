//! Tips that are too thin for a layout's edges are cut off where two edges between the same vertices go around them.
//!
//! Around a finger or an ear that is narrower than two quads the map closes up: two edges join the same two vertices, and
//! what lies beyond them is a pocket of a few quads. It is left out, and the two edges become one; later the vertices there
//! go to what is not covered. *Ours, not the paper's.*

use super::super::net::Net;
use crate::mesh::poly::sides;
use crate::numerics::stop;
use std::collections::{BTreeMap, BTreeSet};

/// Largest pocket that is left out, as a share of all faces: *untuned*.
const POCKET_MAX: f64 = 0.02;

/// Leaves pockets out; false where an edge has more than two faces afterwards.
pub(super) fn cut_tips(net: &mut Net) -> bool {
    let most = (POCKET_MAX * net.faces().count() as f64) as usize;
    // Where a pocket is left out no edge gets more faces: these are all there will be.
    let mut cut = 0;
    for edge in doubled(net) {
        loop {
            let starts = faces_along(net, edge);
            if starts.len() <= 2 {
                break;
            }
            let pockets = starts.iter().filter_map(|&f| pocket(net, f, edge, most));
            let Some(pocket) = pockets.min_by_key(BTreeSet::len).filter(|_| cut <= most) else { return false };
            pocket.into_iter().for_each(|f| net.remove_face(f));
            cut += 1;
        }
    }
    true
}

/// Leaves out what hangs together with nothing else, but for the largest piece.
pub(super) fn keep_largest(net: &mut Net) {
    let all: Vec<u32> = net.faces().map(|(f, _)| f).collect();
    let mut seen: BTreeSet<u32> = BTreeSet::new();
    let mut pieces: Vec<BTreeSet<u32>> = Vec::new();
    for f in all {
        if !seen.contains(&f) {
            let piece = pocket(net, f, [u32::MAX; 2], usize::MAX).unwrap_or_default();
            seen.extend(&piece);
            pieces.push(piece);
        }
    }
    let largest = (0..pieces.len()).max_by_key(|&k| (pieces[k].len(), std::cmp::Reverse(k)));
    let others = pieces.into_iter().enumerate().filter(|(k, _)| Some(*k) != largest);
    others.flat_map(|(_, piece)| piece).for_each(|f| net.remove_face(f));
}

/// The edges with more than two faces, in order.
fn doubled(net: &Net) -> Vec<[u32; 2]> {
    let mut faces: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for (_, c) in net.faces() {
        stop::pass(c.len());
        edges(c).for_each(|edge| *faces.entry(edge).or_default() += 1);
    }
    faces.into_iter().filter(|(_, count)| *count > 2).map(|(edge, _)| edge).collect()
}

/// The edges of a face, each from its lower vertex.
fn edges(face: &[u32]) -> impl Iterator<Item = [u32; 2]> + '_ {
    sides(face).map(|[a, b]| [a.min(b), a.max(b)])
}

/// The faces along an edge, in order; one that has it twice is there twice.
fn faces_along(net: &Net, edge: [u32; 2]) -> Vec<u32> {
    let mut at: Vec<u32> = net.at(edge[0]).to_vec();
    at.sort_unstable();
    at.dedup();
    let times = |f: u32| edges(net.face(f)).filter(|&own| own == edge).count();
    at.into_iter().flat_map(|f| std::iter::repeat_n(f, times(f))).collect()
}

/// The faces that are joined to one without crossing an edge; `None` where these are more than `most`.
fn pocket(net: &Net, from: u32, edge: [u32; 2], most: usize) -> Option<BTreeSet<u32>> {
    let (mut found, mut todo) = (BTreeSet::from([from]), vec![from]);
    while let Some(f) = todo.pop() {
        stop::poll();
        let c = net.face(f);
        for (k, &a) in c.iter().enumerate() {
            let b = c[(k + 1) % c.len()];
            if [a.min(b), a.max(b)] == edge {
                continue;
            }
            for &g in net.at(a).iter().filter(|&&g| net.beside(g, a).is_some_and(|[before, _]| before == b)) {
                if found.insert(g) {
                    todo.push(g);
                }
            }
        }
        if found.len() > most {
            return None;
        }
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;

    /// A tube of n rings with 6 vertices around it, closed at its lower end by two quads, and drawn together at its upper
    /// to two edges between the same vertices, with a pillow of two quads beyond.
    fn tube(n: u32) -> Net {
        let at = |ring: u32, k: u32| 6 * ring + k % 6;
        let place = |v: u32| Vec3::new(f64::from(v % 6), 0.0, f64::from(v / 6));
        let mut faces: Vec<Vec<u32>> = Vec::new();
        for ring in 0..n {
            faces.extend((0..6).map(|k| vec![at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k)]));
        }
        faces.extend([vec![0, 5, 4, 3], vec![0, 3, 2, 1]]);
        // Two quads close the upper end but for two edges between its vertices 0 and 3, and two more stand on these.
        let (a, b) = (at(n, 0), at(n, 3));
        faces.extend([vec![a, at(n, 1), at(n, 2), b], vec![b, at(n, 4), at(n, 5), a]]);
        let (c, d) = (6 * n + 6, 6 * n + 7);
        faces.extend([vec![a, b, c, d], vec![b, a, d, c]]);
        Net::new((0..6 * n + 8).map(place).collect(), faces)
    }

    #[test]
    fn a_pocket_beyond_two_edges_is_left_out_and_they_become_one() {
        let mut net = tube(40);
        let before = net.faces().count();
        assert_eq!(doubled(&net).len(), 1);
        assert!(cut_tips(&mut net));
        assert_eq!(net.faces().count(), before - 2);
        assert_eq!(net.loops(), Some(Vec::new()));
    }

    #[test]
    fn of_two_pieces_the_larger_stays() {
        let square = |k: u32| vec![k, k + 1, k + 2, k + 3];
        let mut net = Net::new(vec![Vec3::zeros(); 12], vec![square(0), vec![4, 5, 6, 7], vec![6, 5, 8, 9]]);
        keep_largest(&mut net);
        assert_eq!(net.faces().map(|(f, _)| f).collect::<Vec<u32>>(), [1, 2]);
    }

    #[test]
    fn a_pocket_that_is_much_of_it_is_not_left_out() {
        assert!(!cut_tips(&mut tube(4)));
    }
}
