//! Loops of a torus: two closed curves on edges that generate its homology, and two across edges that are dual to them.
//!
//! A spanning tree of the vertices and one of the faces that avoids it (tree–cotree) leave two edges. Each closes a loop
//! of tree edges, and its dual a loop of faces; loop i and dual loop j cross δ_ij times. The crossings of a dual loop
//! are a closed cochain, from which a harmonic form follows. *Source:* Eppstein 2003; Erickson, Whittlesey 2005.
//! *Ours, not the paper's* (which has no tori in its prototype).

use super::path::{distances, trace};
use crate::mesh::tri::{NONE, TriMesh};

/// A generator of a torus's homology.
#[derive(Clone, Debug, PartialEq)]
pub struct Generator {
    /// A closed curve on edges: its vertices in order, the first not repeated.
    pub cycle: Vec<u32>,
    /// The dual closed curve: the halfedges it crosses, in order; it enters the triangle of each from its twin's.
    pub crossed: Vec<u32>,
    /// Signed crossings of each halfedge with the dual curve; closed, and 1 along `cycle` (0 along the other's).
    pub crossings: Vec<i32>,
}

/// Two generators of a closed surface of genus 1; `None` where the mesh is none.
pub fn generators(mesh: &TriMesh) -> Option<[Generator; 2]> {
    let (_, reached_by) = distances(mesh, &[0]);
    let mut taken = vec![false; mesh.twins.len()];
    let mut take = |h: u32| {
        taken[h as usize] = true;
        if mesh.twin(h) != NONE {
            taken[mesh.twin(h) as usize] = true;
        }
    };
    reached_by.iter().filter(|h| **h != NONE).for_each(|&h| take(h));
    let parent = cotree(mesh, &mut taken);
    let mut left = (0..mesh.twins.len() as u32).filter(|&h| !taken[h as usize] && h < mesh.twin(h));
    let (first, second) = (left.next()?, left.next()?);
    if left.next().is_some() || mesh.twins.contains(&NONE) {
        return None;
    }
    Some([first, second].map(|h| generator(mesh, &reached_by, &parent, h)))
}

/// A spanning tree of the faces (breadth first from face 0) across edges that are not `taken`, which it takes. For each
/// face the halfedge, its own, across which it was reached.
fn cotree(mesh: &TriMesh, taken: &mut [bool]) -> Vec<u32> {
    let mut parent = vec![NONE; mesh.triangles.len()];
    let mut seen = vec![false; mesh.triangles.len()];
    let mut queue = std::collections::VecDeque::from([0u32]);
    seen[0] = true;
    while let Some(t) = queue.pop_front() {
        for h in 3 * t..3 * t + 3 {
            let g = mesh.twin(h);
            if g == NONE || taken[h as usize] || seen[g as usize / 3] {
                continue;
            }
            (taken[h as usize], taken[g as usize], seen[g as usize / 3]) = (true, true, true);
            parent[g as usize / 3] = g;
            queue.push_back(g / 3);
        }
    }
    parent
}

fn generator(mesh: &TriMesh, reached_by: &[u32], parent: &[u32], h: u32) -> Generator {
    let cycle = closed(&trace(mesh, reached_by, mesh.tail(h)), &trace(mesh, reached_by, mesh.head(h)));
    // From the face of the twin across h into its own, and home along the tree of faces.
    let up = |mut t: u32| {
        let mut entered = Vec::new();
        while parent[t as usize] != NONE {
            entered.push(parent[t as usize]);
            t = mesh.twin(parent[t as usize]) / 3;
        }
        entered
    };
    let (mut out, mut home) = (up(mesh.twin(h) / 3), up(h / 3));
    while out.last().is_some() && out.last() == home.last() {
        out.pop();
        home.pop();
    }
    let back = home.iter().map(|&g| mesh.twin(g));
    let crossed: Vec<u32> = out.iter().rev().copied().chain([h]).chain(back).collect();
    let mut crossings = vec![0; mesh.twins.len()];
    for &g in &crossed {
        crossings[g as usize] += 1;
        crossings[mesh.twin(g) as usize] -= 1;
    }
    Generator { cycle, crossed, crossings }
}

/// The loop of two paths from one root: out along the first, across, and back along the second, what they share cut.
fn closed(out: &[u32], home: &[u32]) -> Vec<u32> {
    let shared = out.iter().zip(home).take_while(|(a, b)| a == b).count();
    let from = shared.saturating_sub(1);
    let mut cycle: Vec<u32> = out[from..].to_vec();
    cycle.extend(home[shared..].iter().rev());
    cycle
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;
    use crate::unfold::path::for_each_spoke;

    #[test]
    fn each_loop_crosses_its_dual_once_and_the_others_not() {
        let mesh = grid(13, 9, true, true);
        let found = generators(&mesh).expect("a torus");
        let out = mesh.outgoing();
        for (i, one) in found.iter().enumerate() {
            for (j, other) in found.iter().enumerate() {
                let mut sum = 0;
                for (k, &a) in one.cycle.iter().enumerate() {
                    let b = one.cycle[(k + 1) % one.cycle.len()];
                    for_each_spoke(&mesh, out[a as usize], |h, w| {
                        sum += if w == b { other.crossings[h as usize] } else { 0 }
                    });
                }
                assert_eq!(sum, i32::from(i == j));
            }
            for t in 0..mesh.triangles.len() {
                assert_eq!(one.crossings[3 * t..3 * t + 3].iter().sum::<i32>(), 0);
            }
        }
    }

    #[test]
    fn other_surfaces_have_no_such_pair() {
        assert_eq!(generators(&grid(6, 5, true, false)), None);
        assert_eq!(generators(&grid(6, 5, false, false)), None);
    }
}
