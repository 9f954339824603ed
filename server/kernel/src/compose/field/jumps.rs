//! The unknown whole numbers of an integer-grid map, and by which of them coordinates jump at each edge.
//!
//! The frame of vertex j, seen from i, is turned by k_ij quarters and shifted by t_ij: u_i = R(k_ij) u_j + t_ij. Around a
//! regular triangle the three compose to the identity, around a singular one to the turn about a grid point c:
//!
//! t_ab + R_ab t_bc + R_ab R_bc t_ca = (I − R_ab R_bc R_ca) c
//!
//! A tree of the dual graph crosses the edges at which these are solved for t, from its leaves up; on a tree of the other
//! edges frames are turned so that k = 0, t = 0; what edges are left are free. So each t is a combination, with whole
//! coefficients, of singular points c, which are grid points, and of free shifts. *Source:* trees and cotrees: Eppstein,
//! *Dynamic generators of topologically embedded graphs* (2003); the map: Bommes, Zimmer, Kobbelt, *Mixed-integer
//! quadrangulation* (2009), §5. *Ours, not the paper's:* frames at vertices, singular points in triangles, and the whole
//! numbers as combinations: there is no cut, and nothing to eliminate.

use super::cross::{CrossField, edges, from, indices};
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;
use std::collections::VecDeque;

/// A 2 × 2 matrix of whole numbers, row by row.
pub(super) type Matrix = [i32; 4];

/// A combination of pairs of whole numbers: Σ M x.
pub(super) type Form = Vec<(u32, Matrix)>;

/// The turn by some quarters.
pub(super) fn quarter_turn(k: u8) -> Matrix {
    match k % 4 {
        0 => [1, 0, 0, 1],
        1 => [0, -1, 1, 0],
        2 => [-1, 0, 0, -1],
        _ => [0, 1, -1, 0],
    }
}

pub(super) fn product(a: Matrix, b: Matrix) -> Matrix {
    [a[0] * b[0] + a[1] * b[2], a[0] * b[1] + a[1] * b[3], a[2] * b[0] + a[3] * b[2], a[2] * b[1] + a[3] * b[3]]
}

pub(super) fn applied(a: Matrix, x: [i64; 2]) -> [i64; 2] {
    let [p, q, r, s] = a.map(i64::from);
    [p * x[0] + q * x[1], r * x[0] + s * x[1]]
}

/// Frames and jumps.
#[derive(Clone, Debug)]
pub(super) struct Jumps {
    /// Quarters by which each vertex's frame is turned from its cross.
    pub(super) gauge: Vec<u8>,
    /// k of each halfedge between the turned frames.
    pub(super) turn: Vec<u8>,
    /// t of each halfedge.
    pub(super) shift: Vec<Form>,
    /// Number of pairs.
    pub(super) pairs: usize,
    /// Singular triangles, with the halfedge at whose tail the pair of c is measured; the root has no pair of its own.
    pub(super) singular: Vec<(u32, Option<u32>)>,
}

/// A tree over triangles and boundary loops: for each the halfedge that leads to its parent (for a loop, that of the
/// triangle on it), in the order in which they were found.
struct DualTree {
    order: Vec<u32>,
    parent: Vec<u32>,
    is_crossed: Vec<bool>,
}

/// The jumps of a field; `None` where whole numbers depend on more than `entries_max` others in all.
pub(super) fn jumps(mesh: &TriMesh, field: &CrossField, entries_max: usize) -> Option<Jumps> {
    let index = indices(mesh, &field.turn);
    let loops = mesh.boundary_loops();
    let tree = dual_tree(mesh, &index, &loops);
    let (gauge, is_in_tree) = primal_tree(mesh, field, &tree.is_crossed);
    let turn: Vec<u8> = (0..mesh.twins.len() as u32)
        .map(|h| {
            let [g, k] = [mesh.tail(h), mesh.head(h)].map(|v| gauge[v as usize]);
            (field.turn[h as usize] + 4 - g + k) % 4
        })
        .collect();
    let mut jumps = Jumps { gauge, turn, shift: vec![Form::new(); mesh.twins.len()], pairs: 0, singular: Vec::new() };
    for h in edges(mesh).filter(|&h| !is_in_tree[h as usize] && !tree.is_crossed[h as usize]) {
        let form = jumps.free();
        jumps.put(mesh, h, form);
    }
    let mut entries = 0;
    for &node in tree.order.iter().rev() {
        let h = tree.parent[node as usize];
        let form = match index.get(node as usize) {
            None if h == NONE => continue,
            None => jumps.free(),
            Some(&k) => {
                let at = if h == NONE { 3 * node } else { h };
                let pair = (k != 0 && h != NONE).then_some(jumps.pairs as u32);
                if k != 0 {
                    jumps.singular.push((at, pair));
                    jumps.pairs += usize::from(pair.is_some());
                }
                if h == NONE {
                    continue;
                }
                jumps.closing(h, pair.map(|c| (c, k)))
            }
        };
        entries += form.len();
        if entries > entries_max {
            return None;
        }
        stop::pass(1 + form.len());
        jumps.put(mesh, h, form);
    }
    Some(jumps)
}

impl Jumps {
    fn free(&mut self) -> Form {
        self.pairs += 1;
        vec![(self.pairs as u32 - 1, quarter_turn(0))]
    }

    /// The shift at a halfedge that closes its triangle.
    fn closing(&self, h: u32, c: Option<(u32, u8)>) -> Form {
        let [h, second, third] = from(h);
        let first = quarter_turn(self.turn[h as usize]);
        let both = product(first, quarter_turn(self.turn[second as usize]));
        let mut form = Form::new();
        if let Some((pair, k)) = c {
            let r = quarter_turn(k);
            form.push((pair, [1 - r[0], -r[1], -r[2], 1 - r[3]]));
        }
        for (matrix, of) in [(first, second), (both, third)] {
            form.extend(self.shift[of as usize].iter().map(|&(v, m)| (v, product(matrix, m).map(|x| -x))));
        }
        summed(form)
    }

    /// Sets the shift of a halfedge, and with it that of its twin.
    fn put(&mut self, mesh: &TriMesh, h: u32, form: Form) {
        let g = mesh.twin(h);
        if g != NONE {
            let back = quarter_turn(4 - self.turn[h as usize]);
            self.shift[g as usize] = form.iter().map(|&(v, m)| (v, product(back, m).map(|x| -x))).collect();
        }
        self.shift[h as usize] = form;
    }

    /// The shift of a halfedge for some pairs.
    pub(super) fn shift_at(&self, h: u32, pairs: &[[i64; 2]]) -> [i64; 2] {
        self.shift[h as usize].iter().fold([0, 0], |sum, &(v, m)| {
            let [x, y] = applied(m, pairs[v as usize]);
            [sum[0] + x, sum[1] + y]
        })
    }
}

fn summed(mut form: Form) -> Form {
    form.sort_by_key(|(v, _)| *v);
    let mut sum = Form::new();
    for (v, m) in form {
        match sum.last_mut() {
            Some((last, n)) if *last == v => (0..4).for_each(|k| n[k] += m[k]),
            _ => sum.push((v, m)),
        }
    }
    sum.retain(|(_, m)| *m != [0; 4]);
    sum
}

fn dual_tree(mesh: &TriMesh, index: &[u8], loops: &[Vec<u32>]) -> DualTree {
    let triangles = mesh.triangles.len();
    let mut loop_of = vec![NONE; mesh.twins.len()];
    for (l, ring) in loops.iter().enumerate() {
        ring.iter().for_each(|&h| loop_of[h as usize] = (triangles + l) as u32);
    }
    let longest = (0..loops.len()).max_by_key(|&l| (loops[l].len(), std::cmp::Reverse(l)));
    // A turn by a quarter at the root is about a grid point where all others are: turns keep the colours of a chessboard.
    let odd = || index.iter().position(|k| k % 2 == 1).or_else(|| index.iter().position(|k| *k != 0));
    let root = longest.map_or_else(|| odd().unwrap_or(0), |l| triangles + l) as u32;
    let mut parent = vec![NONE; triangles + loops.len()];
    let mut seen = vec![false; triangles + loops.len()];
    let mut is_crossed = vec![false; mesh.twins.len()];
    let (mut order, mut queue) = (Vec::new(), VecDeque::from([root]));
    seen[root as usize] = true;
    while let Some(node) = queue.pop_front() {
        stop::pass(1);
        order.push(node);
        let own: Vec<u32> = match (node as usize).checked_sub(triangles) {
            Some(l) => loops[l].clone(),
            None => (3 * node..3 * node + 3).collect(),
        };
        for h in own {
            // The halfedge on the other side; a loop has none, and takes that of the triangle.
            let is_loop = node as usize >= triangles;
            let (to, back) = match mesh.twin(h) {
                NONE if is_loop => (h / 3, h),
                NONE => (loop_of[h as usize], h),
                g => (g / 3, g),
            };
            if !std::mem::replace(&mut seen[to as usize], true) {
                parent[to as usize] = back;
                is_crossed[h as usize] = true;
                is_crossed[back as usize] = true;
                queue.push_back(to);
            }
        }
    }
    DualTree { order, parent, is_crossed }
}

/// A tree over the vertices along edges that are not crossed: the turns that make its frames agree, and its halfedges.
fn primal_tree(mesh: &TriMesh, field: &CrossField, is_crossed: &[bool]) -> (Vec<u8>, Vec<bool>) {
    let n = mesh.positions.len();
    let mut starts = vec![0u32; n + 1];
    let both = |h: u32| [(mesh.tail(h), h, false), (mesh.head(h), h, true)];
    for h in edges(mesh) {
        both(h).iter().for_each(|(v, ..)| starts[*v as usize + 1] += 1);
    }
    (0..n).for_each(|v| starts[v + 1] += starts[v]);
    let mut at = starts.clone();
    let mut around = vec![(0u32, false); starts[n] as usize];
    for (v, h, is_back) in edges(mesh).flat_map(both) {
        around[at[v as usize] as usize] = (h, is_back);
        at[v as usize] += 1;
    }
    let (mut gauge, mut seen, mut is_in_tree) = (vec![0u8; n], vec![false; n], vec![false; mesh.twins.len()]);
    let mut queue = VecDeque::new();
    for start in 0..n as u32 {
        if std::mem::replace(&mut seen[start as usize], true) {
            continue;
        }
        queue.push_back(start);
        while let Some(v) = queue.pop_front() {
            for &(h, is_back) in &around[starts[v as usize] as usize..starts[v as usize + 1] as usize] {
                let (w, k) = if is_back {
                    (mesh.tail(h), 4 - field.turn[h as usize])
                } else {
                    (mesh.head(h), field.turn[h as usize])
                };
                if is_crossed[h as usize] || std::mem::replace(&mut seen[w as usize], true) {
                    continue;
                }
                gauge[w as usize] = (gauge[v as usize] + 4 - k % 4) % 4;
                is_in_tree[h as usize] = true;
                if mesh.twin(h) != NONE {
                    is_in_tree[mesh.twin(h) as usize] = true;
                }
                queue.push_back(w);
            }
        }
    }
    (gauge, is_in_tree)
}
