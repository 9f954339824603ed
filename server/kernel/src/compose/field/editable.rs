//! A triangle mesh under local change: edges are split, collapsed and flipped in place.
//!
//! Halfedge `h = 3t + k` runs from corner `k` of triangle `t` to the next, as in [`TriMesh`]. A removed triangle has no
//! corners ([`NONE`]). An edge may be *sharp*: it is part of a crease, and is neither flipped nor crossed by a collapse.

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh, next, prev};

/// Cosine of the angle from which on a line turns at a corner: that of `map/snap`, 40°.
const CORNER_COS: f64 = 0.766;

/// How freely a vertex moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Freedom {
    Surface,
    Line,
    None,
}

/// The mesh, and what is kept up to date with it.
#[derive(Clone, Debug)]
pub(super) struct EditableMesh {
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) twins: Vec<u32>,
    /// True for the halfedges of sharp edges.
    pub(super) sharp: Vec<bool>,
    /// A halfedge that leaves each vertex; [`NONE`] where there is none any more.
    pub(super) out: Vec<u32>,
}

impl EditableMesh {
    /// A copy of a mesh with some sharp edges, a halfedge of each.
    pub(super) fn new(mesh: &TriMesh, sharp_edges: &[u32]) -> Self {
        let mut sharp = vec![false; mesh.twins.len()];
        for &h in sharp_edges {
            sharp[h as usize] = true;
            if mesh.twin(h) != NONE {
                sharp[mesh.twin(h) as usize] = true;
            }
        }
        Self {
            positions: mesh.positions.clone(),
            triangles: mesh.triangles.clone(),
            twins: mesh.twins.clone(),
            sharp,
            out: mesh.outgoing(),
        }
    }

    pub(super) fn tail(&self, h: u32) -> u32 {
        self.triangles[h as usize / 3][h as usize % 3]
    }

    pub(super) fn head(&self, h: u32) -> u32 {
        self.tail(next(h))
    }

    pub(super) fn twin(&self, h: u32) -> u32 {
        self.twins[h as usize]
    }

    pub(super) fn is_there(&self, h: u32) -> bool {
        self.triangles[h as usize / 3][0] != NONE
    }

    /// True for an edge of the boundary or a crease.
    pub(super) fn is_line(&self, h: u32) -> bool {
        self.twin(h) == NONE || self.sharp[h as usize]
    }

    pub(super) fn at(&self, v: u32) -> Vec3 {
        self.positions[v as usize]
    }

    pub(super) fn length(&self, h: u32) -> f64 {
        (self.at(self.head(h)) - self.at(self.tail(h))).norm()
    }

    fn pair(&mut self, g: u32, h: u32) {
        if g != NONE {
            self.twins[g as usize] = h;
        }
        if h != NONE {
            self.twins[h as usize] = g;
        }
    }

    /// Writes the halfedges that leave a vertex, counter-clockwise; on a boundary from the one on it.
    pub(super) fn star(&self, v: u32, star: &mut Vec<u32>) {
        star.clear();
        let first = self.out[v as usize];
        if first == NONE {
            return;
        }
        let mut start = first;
        loop {
            let g = self.twin(start);
            if g == NONE {
                break;
            }
            start = next(g);
            if start == first {
                break;
            }
        }
        let mut h = start;
        loop {
            star.push(h);
            h = self.twin(prev(h));
            if h == NONE || h == start {
                break;
            }
        }
    }

    /// True where more than `most` halfedges leave a vertex. Looks at no more of them.
    pub(super) fn has_more_edges(&self, v: u32, most: usize) -> bool {
        let first = self.out[v as usize];
        let mut left = most;
        let mut h = first;
        while h != NONE {
            if left == 0 {
                return true;
            }
            left -= 1;
            h = self.twin(prev(h));
            if h == first {
                return false;
            }
        }
        // A boundary ends the walk: the rest lies on the other side of the first.
        let mut g = if first == NONE { NONE } else { self.twin(first) };
        while g != NONE {
            if left == 0 {
                return true;
            }
            left -= 1;
            g = self.twin(next(g));
        }
        false
    }

    /// The vertices beside a vertex whose star this is.
    pub(super) fn ring(&self, star: &[u32], ring: &mut Vec<u32>) {
        ring.clear();
        ring.extend(star.iter().map(|&h| self.head(h)));
        if let Some(&last) = star.last()
            && self.twin(prev(last)) == NONE
        {
            ring.push(self.tail(prev(last)));
        }
    }

    /// True where a vertex whose star this is lies on the boundary.
    pub(super) fn is_border(&self, star: &[u32]) -> bool {
        star.first().is_some_and(|&h| self.twin(h) == NONE)
    }

    /// How freely a vertex moves whose star this is: one where lines end, meet or turn does not.
    pub(super) fn freedom(&self, star: &[u32]) -> Freedom {
        let mut lines = [Vec3::zeros(); 2];
        let mut count = 0;
        let Some(&last) = star.last() else { return Freedom::None };
        let v = self.at(self.tail(last));
        for &h in star.iter().filter(|&&h| self.is_line(h)) {
            if count < 2 {
                lines[count] = self.at(self.head(h)) - v;
            }
            count += 1;
        }
        if self.twin(prev(last)) == NONE {
            if count < 2 {
                lines[count] = self.at(self.tail(prev(last))) - v;
            }
            count += 1;
        }
        let is_straight = || -lines[0].dot(&lines[1]) >= CORNER_COS * lines[0].norm() * lines[1].norm();
        match count {
            0 => Freedom::Surface,
            2 if is_straight() => Freedom::Line,
            _ => Freedom::None,
        }
    }

    /// Splits an edge at a point; gives the new vertex, whose `out` is the second half of `h`. The first half stays `h`.
    pub(super) fn split(&mut self, h: u32, p: Vec3) -> u32 {
        let m = self.positions.len() as u32;
        self.positions.push(p);
        let g = self.twin(h);
        let second = self.split_side(h, m);
        self.out.push(second);
        if g == NONE {
            self.pair(h, NONE);
            return m;
        }
        let other = self.split_side(g, m);
        self.pair(h, other);
        self.pair(second, g);
        m
    }

    /// Splits the triangle of a halfedge a → b at `m`: it keeps a → m, a new one has m → b, which is given.
    fn split_side(&mut self, h: u32, m: u32) -> u32 {
        let (b, c) = (self.head(h), self.tail(prev(h)));
        let t = self.triangles.len() as u32;
        self.triangles.push([m, b, c]);
        self.twins.extend([NONE; 3]);
        let sharp = [self.sharp[h as usize], self.sharp[next(h) as usize], false];
        self.sharp.extend(sharp);
        self.pair(3 * t + 1, self.twin(next(h)));
        self.triangles[h as usize / 3][next(h) as usize % 3] = m;
        self.sharp[next(h) as usize] = false;
        self.pair(next(h), 3 * t + 2);
        self.out[b as usize] = 3 * t + 1;
        self.out[c as usize] = 3 * t + 2;
        3 * t
    }

    /// Splits a triangle at a point within; gives the new vertex.
    pub(super) fn split_triangle(&mut self, t: u32, p: Vec3) -> u32 {
        let [a, b, c] = self.triangles[t as usize];
        let m = self.positions.len() as u32;
        let (t1, t2) = (self.triangles.len() as u32, self.triangles.len() as u32 + 1);
        let (bc, ca) = (self.twin(3 * t + 1), self.twin(3 * t + 2));
        let (sharp_bc, sharp_ca) = (self.sharp[3 * t as usize + 1], self.sharp[3 * t as usize + 2]);
        self.positions.push(p);
        self.triangles[t as usize] = [a, b, m];
        self.triangles.extend([[b, c, m], [c, a, m]]);
        self.twins.extend([NONE; 6]);
        self.sharp.extend([sharp_bc, false, false, sharp_ca, false, false]);
        (self.sharp[3 * t as usize + 1], self.sharp[3 * t as usize + 2]) = (false, false);
        self.pair(3 * t1, bc);
        self.pair(3 * t2, ca);
        self.pair(3 * t + 1, 3 * t1 + 2);
        self.pair(3 * t1 + 1, 3 * t2 + 2);
        self.pair(3 * t2 + 1, 3 * t + 2);
        self.out.push(3 * t + 2);
        (self.out[b as usize], self.out[c as usize]) = (3 * t1, 3 * t2);
        self.out[a as usize] = 3 * t;
        m
    }

    /// Turns an inner edge a → b of the triangles (a, b, c), (b, a, d) to d → c; `h` becomes that.
    pub(super) fn flip(&mut self, h: u32) {
        let g = self.twin(h);
        let (hn, hp, gn, gp) = (next(h), prev(h), next(g), prev(g));
        let (a, b, c, d) = (self.tail(h), self.tail(g), self.tail(hp), self.tail(gp));
        let outer = [hn, hp, gn, gp].map(|e| (self.twin(e), self.sharp[e as usize]));
        // (d, c, a) in place of (a, b, c), and (c, d, b) in place of (b, a, d).
        self.triangles[h as usize / 3][h as usize % 3] = d;
        self.triangles[h as usize / 3][hn as usize % 3] = c;
        self.triangles[h as usize / 3][hp as usize % 3] = a;
        self.triangles[g as usize / 3][g as usize % 3] = c;
        self.triangles[g as usize / 3][gn as usize % 3] = d;
        self.triangles[g as usize / 3][gp as usize % 3] = b;
        for (edge, from) in [(gp, outer[0]), (hn, outer[1]), (hp, outer[2]), (gn, outer[3])] {
            self.pair(edge, from.0);
            self.sharp[edge as usize] = from.1;
        }
        self.out[a as usize] = hp;
        self.out[b as usize] = gp;
        self.out[c as usize] = hn;
        self.out[d as usize] = gn;
    }

    /// Collapses an edge: its head goes into its tail, which goes to a point. The caller has checked that this is no
    /// change of topology.
    pub(super) fn collapse(&mut self, h: u32, p: Vec3) {
        let (a, b, g) = (self.tail(h), self.head(h), self.twin(h));
        let mut star = Vec::new();
        self.star(b, &mut star);
        star.iter().for_each(|&e| self.triangles[e as usize / 3][e as usize % 3] = a);
        for side in [h, g] {
            if side == NONE {
                continue;
            }
            let (n, l) = (next(side), prev(side));
            let (c, left, right) = (self.tail(l), self.twin(n), self.twin(l));
            let is_sharp = self.sharp[n as usize] || self.sharp[l as usize];
            for e in [left, right] {
                if e != NONE {
                    self.sharp[e as usize] = is_sharp;
                }
            }
            if left != NONE {
                self.twins[left as usize] = right;
            }
            if right != NONE {
                self.twins[right as usize] = left;
            }
            self.triangles[side as usize / 3] = [NONE; 3];
            // `left` runs c → a, and `right` a → c.
            self.out[a as usize] = if right != NONE { right } else { next(left) };
            self.out[c as usize] = if left != NONE { left } else { next(right) };
        }
        self.out[b as usize] = NONE;
        self.positions[a as usize] = p;
    }

    /// The mesh without what was removed, and its sharp edges, a halfedge of each.
    pub(super) fn finish(self) -> (TriMesh, Vec<u32>) {
        let mut number = vec![NONE; self.positions.len()];
        let mut mesh = TriMesh::default();
        let mut sharp = Vec::new();
        let mut place = vec![NONE; self.triangles.len()];
        for (t, corners) in self.triangles.iter().enumerate().filter(|(_, c)| c[0] != NONE) {
            place[t] = mesh.triangles.len() as u32;
            mesh.triangles.push(corners.map(|v| {
                if number[v as usize] == NONE {
                    number[v as usize] = mesh.positions.len() as u32;
                    mesh.positions.push(self.positions[v as usize]);
                }
                number[v as usize]
            }));
        }
        let moved = |h: u32| if h == NONE { NONE } else { 3 * place[h as usize / 3] + h % 3 };
        for h in (0..self.twins.len() as u32).filter(|&h| self.is_there(h)) {
            let g = self.twin(h);
            mesh.twins.push(moved(g));
            if self.sharp[h as usize] && (g == NONE || h < g) {
                sharp.push(moved(h));
            }
        }
        mesh.phantom = vec![false; mesh.twins.len()];
        mesh.polygon_of = (0..mesh.triangles.len() as u32).collect();
        (mesh, sharp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tri::pair_halfedges;
    use crate::topology::invariants;
    use crate::topology::tests::grid;

    fn assert_whole(mesh: EditableMesh, euler: i64) {
        let mut star = Vec::new();
        for v in 0..mesh.positions.len() as u32 {
            mesh.star(v, &mut star);
            assert!(star.iter().all(|&h| mesh.is_there(h) && mesh.tail(h) == v), "{v}");
        }
        let (mesh, _) = mesh.finish();
        assert_eq!(pair_halfedges(&mesh.triangles).as_ref(), Ok(&mesh.twins));
        assert_eq!(invariants(&mesh).euler, euler);
    }

    #[test]
    fn splits_flips_and_collapses_keep_twins_stars_and_topology() {
        for (mesh, euler) in [(grid(6, 6, false, false), 1), (grid(6, 6, true, true), 0)] {
            let mut mesh = EditableMesh::new(&mesh, &[]);
            for h in (0..mesh.twins.len() as u32).step_by(7) {
                let middle = (mesh.at(mesh.tail(h)) + mesh.at(mesh.head(h))) / 2.0;
                let m = mesh.split(h, middle);
                assert_eq!(mesh.head(h), m);
            }
            assert_whole(mesh.clone(), euler);
            for t in (0..mesh.triangles.len() as u32).step_by(5) {
                let middle = mesh.triangles[t as usize].iter().map(|&v| mesh.at(v)).sum::<Vec3>() / 3.0;
                mesh.split_triangle(t, middle);
            }
            assert_whole(mesh.clone(), euler);
            let inner: Vec<u32> = (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) != NONE).collect();
            for h in inner.into_iter().step_by(11) {
                if mesh.twin(h) == NONE {
                    continue;
                }
                let (c, d) = (mesh.tail(prev(h)), mesh.tail(prev(mesh.twin(h))));
                let (mut star, mut ring) = (Vec::new(), Vec::new());
                mesh.star(c, &mut star);
                mesh.ring(&star, &mut ring);
                if c == d || ring.contains(&d) {
                    continue;
                }
                mesh.flip(h);
                assert_eq!([mesh.tail(h), mesh.head(h)], [d, c]);
            }
            assert_whole(mesh, euler);
        }
    }

    #[test]
    fn edges_are_counted_up_to_a_number_wherever_the_walk_starts() {
        let mut mesh = EditableMesh::new(&grid(3, 3, false, false), &[]);
        let mut star = Vec::new();
        for v in 0..mesh.positions.len() as u32 {
            mesh.star(v, &mut star);
            for &first in &star {
                mesh.out[v as usize] = first;
                let counted = (0..9).find(|&most| !mesh.has_more_edges(v, most));
                assert_eq!(counted, Some(star.len()), "{v}");
            }
        }
    }

    #[test]
    fn a_new_vertex_collapses_again() {
        let before = grid(4, 4, false, false);
        let mut mesh = EditableMesh::new(&before, &[]);
        for h in [0, 5, 20] {
            let (p, tail) = (mesh.at(mesh.tail(h)), mesh.tail(h));
            mesh.split(h, p);
            mesh.collapse(h, p);
            assert!(mesh.out[tail as usize] != NONE);
        }
        assert_whole(mesh, 1);
    }
}
