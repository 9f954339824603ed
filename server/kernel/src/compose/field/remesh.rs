//! A surface is remeshed to triangles of even size, so that what is solved on it depends on the size of its quads only.
//!
//! Again and again: edges longer than 4/3 ℓ are split, those shorter than 4/5 ℓ are collapsed, edges are flipped towards
//! valence 6, and vertices move to the mean of their neighbours, along the surface, and are put back onto it. *Source:*
//! Botsch, Kobbelt, *A remeshing approach to multiresolution modeling* (2004), §4. *Ours, not the paper's:* vertices of
//! creases and boundaries stay on these, and move along them; no collapse or flip turns a triangle over.

use super::editable::{EditableMesh, Freedom};
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh, next, prev};
use crate::numerics::stop;

/// Edges are split above, and collapsed below, these shares of the wanted length: the paper's.
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;
/// Rounds: *untuned*, the paper takes as many.
const ROUNDS: usize = 5;
/// Passes over all edges in a round: each halves what is too long.
const PASSES_MAX: usize = 24;
/// Edges of a vertex that has more are not collapsed: those about it are first, and leave it fewer. Each would be looked at
/// for each other. *Untuned.*
const EDGES_MAX: usize = 64;
/// Cosine to its old normal that a triangle has to keep where its corners move: *untuned*.
const TURN_MIN: f64 = 0.5;

/// A remeshed surface.
#[derive(Clone, Debug)]
pub(super) struct Remeshed {
    pub(super) mesh: TriMesh,
    /// Its sharp edges, a halfedge of each.
    pub(super) sharp: Vec<u32>,
}

/// Remeshes a surface, given with its tree, with some sharp edges to triangles with edges of about `length`; `None` where they would be more
/// than `triangles_max`.
pub(super) fn remesh(
    (surface, tree): (&TriMesh, &Bvh),
    sharp: &[u32],
    length: f64,
    triangles_max: usize,
) -> Option<Remeshed> {
    // A surface that is finer than that to begin with is made coarser.
    let triangles_max = triangles_max.max(2 * surface.triangles.len());
    let lines = lines_of(surface, sharp);
    let mut state = State::new(surface, sharp);
    if !state.split_long(length * LONG, triangles_max) {
        // The facets of a cable are needles: there are to be fewer around it, and its edges are halved step by step, with flips between.
        state = State::new(surface, sharp);
        let longest = (0..surface.twins.len() as u32).map(|h| state.mesh.length(h)).fold(0.0, f64::max);
        for halvings in (0..(longest / length).log2().ceil() as i32).rev() {
            let long = length * LONG * 2f64.powi(halvings);
            state.collapse_short(length * SHORT, f64::INFINITY);
            if !state.split_long(long, triangles_max) {
                return None;
            }
            state.flip();
        }
    }
    for _ in 0..ROUNDS {
        if !state.split_long(length * LONG, triangles_max) {
            return None;
        }
        state.collapse_short(length * SHORT, length * LONG);
        state.flip();
        state.relax(tree, &lines);
    }
    let (mesh, sharp) = state.mesh.finish();
    (!mesh.triangles.is_empty()).then_some(Remeshed { mesh, sharp })
}

/// The boundary and sharp edges as flat triangles, for finding the nearest point on them.
fn lines_of(surface: &TriMesh, sharp: &[u32]) -> Bvh {
    let border = (0..surface.twins.len() as u32).filter(|&h| surface.twin(h) == NONE);
    let edge = |h: u32| [surface.tail(h), surface.head(h), surface.head(h)];
    let triangles = border.chain(sharp.iter().copied()).map(edge).collect();
    Bvh::new(&TriMesh { positions: surface.positions.clone(), triangles, ..TriMesh::default() })
}

struct State {
    mesh: EditableMesh,
    star: Vec<u32>,
    other: Vec<u32>,
    ring: Vec<u32>,
    beside: Vec<u32>,
    /// Marks of vertices, for comparing two rings.
    mark: Vec<u32>,
}

impl State {
    fn new(surface: &TriMesh, sharp: &[u32]) -> Self {
        Self {
            mesh: EditableMesh::new(surface, sharp),
            star: Vec::new(),
            other: Vec::new(),
            ring: Vec::new(),
            beside: Vec::new(),
            mark: Vec::new(),
        }
    }

    /// False where that makes too many triangles.
    fn split_long(&mut self, long: f64, triangles_max: usize) -> bool {
        for _ in 0..PASSES_MAX {
            let mut splits = 0;
            for h in 0..self.mesh.twins.len() as u32 {
                stop::pass(1);
                if !self.mesh.is_there(h) || self.mesh.length(h) <= long || !self.is_longest(h) {
                    continue;
                }
                let middle = (self.mesh.at(self.mesh.tail(h)) + self.mesh.at(self.mesh.head(h))) / 2.0;
                self.mesh.split(h, middle);
                splits += 1;
                // A pass over needles would make three of each.
                if self.mesh.triangles.len() > triangles_max {
                    return false;
                }
            }
            if splits == 0 {
                break;
            }
        }
        true
    }

    /// True for the longest edge of its triangle: only such edges are split, so that no vertex gets a great many edges.
    fn is_longest(&self, h: u32) -> bool {
        let length = self.mesh.length(h);
        [next(h), prev(h)].iter().all(|&e| self.mesh.length(e) <= length)
    }

    fn collapse_short(&mut self, short: f64, long: f64) {
        self.mark.resize(self.mesh.positions.len(), NONE);
        for _ in 0..PASSES_MAX {
            let mut collapses = 0;
            for h in 0..self.mesh.twins.len() as u32 {
                stop::pass(1);
                if self.mesh.is_there(h) && self.mesh.length(h) < short {
                    collapses += usize::from(self.collapse(h, long));
                }
            }
            if collapses == 0 {
                break;
            }
        }
    }

    /// Collapses an edge, if that changes no topology, leaves lines alone and makes no edge too long.
    fn collapse(&mut self, h: u32, long: f64) -> bool {
        let mesh = &self.mesh;
        let (a, b, g) = (mesh.tail(h), mesh.head(h), mesh.twin(h));
        if mesh.has_more_edges(a, EDGES_MAX) || mesh.has_more_edges(b, EDGES_MAX) {
            return false;
        }
        mesh.star(a, &mut self.star);
        mesh.star(b, &mut self.other);
        let (free_a, free_b) = (mesh.freedom(&self.star), mesh.freedom(&self.other));
        let both_lines = free_a != Freedom::Surface && free_b != Freedom::Surface;
        if (both_lines && !mesh.is_line(h)) || (free_a == Freedom::None && free_b == Freedom::None) {
            return false;
        }
        // Two vertices of one boundary may only meet along it.
        if g != NONE && mesh.is_border(&self.star) && mesh.is_border(&self.other) {
            return false;
        }
        mesh.ring(&self.star, &mut self.ring);
        mesh.ring(&self.other, &mut self.beside);
        self.ring.iter().for_each(|&v| self.mark[v as usize] = h);
        let common = self.beside.iter().filter(|&&v| self.mark[v as usize] == h).count();
        self.ring.iter().for_each(|&v| self.mark[v as usize] = NONE);
        if common != if g == NONE { 1 } else { 2 } || self.ring.len() + self.beside.len() < 9 {
            return false;
        }
        let p = match free_a.cmp(&free_b) {
            std::cmp::Ordering::Greater => mesh.at(a),
            std::cmp::Ordering::Less => mesh.at(b),
            std::cmp::Ordering::Equal => (mesh.at(a) + mesh.at(b)) / 2.0,
        };
        let is_long = |v: &u32| *v != a && *v != b && (mesh.at(*v) - p).norm() > long;
        if self.ring.iter().chain(&self.beside).any(is_long) {
            return false;
        }
        let is_kept = |star: &[u32]| star.iter().all(|&e| stays_turned(mesh, e, p, [h / 3, g / 3]));
        if !is_kept(&self.star) || !is_kept(&self.other) {
            return false;
        }
        self.mesh.collapse(h, p);
        true
    }

    /// Flips edges where that brings valences nearer to 6, 4 on lines.
    fn flip(&mut self) {
        let mut valence = vec![0i32; self.mesh.positions.len()];
        let mut wanted = vec![6i32; self.mesh.positions.len()];
        for h in (0..self.mesh.twins.len() as u32).filter(|&h| self.mesh.is_there(h)) {
            let (a, b) = (self.mesh.tail(h) as usize, self.mesh.head(h) as usize);
            valence[a] += 1;
            if self.mesh.twin(h) == NONE {
                valence[b] += 1;
                (wanted[a], wanted[b]) = (4, 4);
            }
        }
        for h in 0..self.mesh.twins.len() as u32 {
            stop::pass(1);
            if !self.mesh.is_there(h) || self.mesh.is_line(h) || self.mesh.twin(h) < h {
                continue;
            }
            let g = self.mesh.twin(h);
            let ends = [self.mesh.tail(h), self.mesh.tail(g), self.mesh.tail(prev(h)), self.mesh.tail(prev(g))];
            let off = |k: usize, by: i32| (valence[ends[k] as usize] + by - wanted[ends[k] as usize]).pow(2);
            let before: i32 = (0..4).map(|k| off(k, 0)).sum();
            let after = off(0, -1) + off(1, -1) + off(2, 1) + off(3, 1);
            if after >= before || valence[ends[0] as usize] <= 3 || valence[ends[1] as usize] <= 3 {
                continue;
            }
            if !self.may_flip(ends) {
                continue;
            }
            self.mesh.flip(h);
            for (k, by) in [-1, -1, 1, 1].into_iter().enumerate() {
                valence[ends[k] as usize] += by;
            }
        }
    }

    fn may_flip(&mut self, [a, b, c, d]: [u32; 4]) -> bool {
        let mesh = &self.mesh;
        mesh.star(c, &mut self.star);
        mesh.ring(&self.star, &mut self.ring);
        if c == d || self.ring.contains(&d) {
            return false;
        }
        let [a, b, c, d] = [a, b, c, d].map(|v| mesh.at(v));
        let normal = |x: Vec3, y: Vec3, z: Vec3| (y - x).cross(&(z - x));
        let old = [normal(a, b, c), normal(b, a, d)];
        let new = [normal(d, c, a), normal(c, d, b)];
        let sum = old[0] + old[1];
        new.iter().all(|n| n.dot(&sum) > TURN_MIN * n.norm() * sum.norm())
    }

    /// Moves vertices to the mean of their neighbours, those on lines along these.
    fn relax(&mut self, bvh: &Bvh, lines: &Bvh) {
        let mut moved = self.mesh.positions.clone();
        for v in 0..self.mesh.positions.len() as u32 {
            let mesh = &self.mesh;
            mesh.star(v, &mut self.star);
            let freedom = mesh.freedom(&self.star);
            if freedom == Freedom::None {
                continue;
            }
            mesh.ring(&self.star, &mut self.ring);
            if freedom == Freedom::Line {
                let last = *self.star.last().unwrap_or(&NONE);
                let mut along: Vec<u32> =
                    self.star.iter().filter(|&&h| mesh.is_line(h)).map(|&h| mesh.head(h)).collect();
                if mesh.twin(prev(last)) == NONE {
                    along.push(mesh.tail(prev(last)));
                }
                self.ring = along;
            }
            let mean = self.ring.iter().map(|&w| mesh.at(w)).sum::<Vec3>() / self.ring.len().max(1) as f64;
            let p = if freedom == Freedom::Line { lines.closest(mean).point } else { bvh.closest(mean).point };
            let is_kept = self.star.iter().all(|&e| stays_turned(mesh, e, p, [NONE; 2]));
            if is_kept {
                moved[v as usize] = p;
            }
        }
        self.mesh.positions = moved;
    }
}

/// True where the triangle of a halfedge keeps its side if the vertex that it leaves goes to a point; the triangles that go
/// don't count.
fn stays_turned(mesh: &EditableMesh, h: u32, p: Vec3, without: [u32; 2]) -> bool {
    if without.contains(&(h / 3)) {
        return true;
    }
    let (b, c) = (mesh.at(mesh.head(h)), mesh.at(mesh.tail(prev(h))));
    let old = (b - mesh.at(mesh.tail(h))).cross(&(c - mesh.at(mesh.tail(h))));
    let new = (b - p).cross(&(c - p));
    // A triangle without an area has no side to keep.
    old.norm() == 0.0 || new.dot(&old) > TURN_MIN * new.norm() * old.norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tri::pair_halfedges;
    use crate::topology::invariants;
    use crate::topology::tests::grid;

    #[test]
    fn edges_come_out_even_on_the_surface_with_its_topology() {
        for (surface, length) in [(grid(12, 60, true, true), 0.15), (grid(200, 9, false, false), 0.04)] {
            let made = remesh((&surface, &Bvh::new(&surface)), &[], length, 1_000_000).expect("not too large");
            assert_eq!(pair_halfedges(&made.mesh.triangles).as_ref(), Ok(&made.mesh.twins));
            assert_eq!(invariants(&made.mesh), invariants(&surface));
            let lengths = (0..made.mesh.twins.len() as u32).map(|h| {
                (made.mesh.positions[made.mesh.head(h) as usize] - made.mesh.positions[made.mesh.tail(h) as usize])
                    .norm()
            });
            let good = lengths.clone().filter(|l| (0.6 * length..1.5 * length).contains(l)).count();
            let all = lengths.count();
            assert!(good as f64 > 0.85 * all as f64, "{good} of {all}");
            let (area, before) = (made.mesh.total_area(), surface.total_area());
            assert!((area - before).abs() < 0.03 * before, "{area} {before}");
        }
    }

    #[test]
    fn a_border_stays_where_it_is_and_its_corners_stay_corners() {
        let surface = grid(30, 30, false, false);
        let made = remesh((&surface, &Bvh::new(&surface)), &[], 0.05, 1_000_000).expect("not too large").mesh;
        assert!((made.total_area() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_cable_of_many_long_facets_has_few_around_it() {
        const AROUND: u32 = 64;
        let tube = grid(AROUND, 1, true, false);
        let ends = [Vec3::zeros(), Vec3::new(0.0, 0.0, 60.0)];
        let positions = tube.positions.iter().map(|p| Vec3::new(p.x, p.y, 20.0 * p.z)).chain(ends).collect();
        let caps = (0..AROUND).flat_map(|k| {
            let next = (k + 1) % AROUND;
            [[next, k, 2 * AROUND], [AROUND + k, AROUND + next, 2 * AROUND + 1]]
        });
        let cable =
            TriMesh::from_triangles(positions, tube.triangles.into_iter().chain(caps).collect()).expect("closed");
        let length = std::f64::consts::TAU / 8.0;
        let made = remesh((&cable, &Bvh::new(&cable)), &[], length, 10_000).expect("not too large").mesh;
        assert!(made.triangles.len() < 3_000, "{}", made.triangles.len());
        assert_eq!(invariants(&made), invariants(&cable));
    }

    #[test]
    fn what_would_be_too_large_is_refused() {
        let sheet = grid(4, 4, false, false);
        assert!(remesh((&sheet, &Bvh::new(&sheet)), &[], 1e-4, 10_000).is_none());
    }
}
