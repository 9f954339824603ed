//! Intrinsic Delaunay triangulation by edge flips on lengths; the surface itself does not change.
//!
//! On it the cotangent weights are ≥ 0, so harmonic functions obey the maximum principle on any mesh.
//! *Source:* Fisher, Springborn, Bobenko, Schröder 2006; METHOD §1. *Ours:* lengths are mollified where a triangle
//! is degenerate (Sharp & Crane 2020), and flips are recorded so that a cochain can be carried along afterwards.

use crate::mesh::tri::{NONE, TriMesh, next, prev};
use crate::numerics::stop;

/// A triangulation that is known by its connectivity and edge lengths alone.
#[derive(Clone, Debug)]
pub struct Intrinsic {
    /// Vertex at which each halfedge starts.
    pub tails: Vec<u32>,
    /// Opposite halfedge or [`NONE`].
    pub twins: Vec<u32>,
    /// Length of each halfedge's edge.
    pub lengths: Vec<f64>,
    /// The flips made, in order, each by its two halfedges.
    pub flips: Vec<[u32; 2]>,
    /// Largest amount added to all lengths to undo degenerate triangles; 0 for a clean mesh.
    pub mollified: f64,
}

/// How flat a triangle may be, in mean edge lengths, before lengths are mollified.
const FLATNESS: f64 = 1e-7;
/// Flips allowed per edge before giving up (Delaunay flipping ends; rounding may not).
const FLIPS_PER_EDGE_MAX: usize = 40;
/// Tolerance of the Delaunay test on the sum of cotangents.
const DELAUNAY_SLACK: f64 = 1e-9;

impl Intrinsic {
    /// The mesh's own triangulation, lengths mollified where needed.
    pub fn of(mesh: &TriMesh) -> Self {
        let halfedges = mesh.twins.len() as u32;
        let tails: Vec<u32> = (0..halfedges).map(|h| mesh.tail(h)).collect();
        let length = |h: u32| (mesh.positions[mesh.head(h) as usize] - mesh.positions[mesh.tail(h) as usize]).norm();
        let mut lengths: Vec<f64> = (0..halfedges).map(length).collect();
        let mean = lengths.iter().sum::<f64>() / f64::from(halfedges.max(1));
        let mut added = 0.0f64;
        for l in lengths.chunks_exact(3) {
            let longest = l[0].max(l[1]).max(l[2]);
            added = added.max(FLATNESS * mean + 2.0 * longest - (l[0] + l[1] + l[2]));
        }
        if added > 0.0 {
            lengths.iter_mut().for_each(|l| *l += added);
        }
        Self { tails, twins: mesh.twins.clone(), lengths, flips: Vec::new(), mollified: added.max(0.0) }
    }

    /// Vertex at which halfedge `h` ends.
    #[inline]
    pub fn head(&self, h: u32) -> u32 {
        self.tails[next(h) as usize]
    }

    /// Cotangent of the angle opposite to halfedge `h` in its triangle.
    #[inline]
    pub fn cotangent(&self, h: u32) -> f64 {
        let (a, b, c) = (self.lengths[h as usize], self.lengths[next(h) as usize], self.lengths[prev(h) as usize]);
        (b * b + c * c - a * a) / (4.0 * heron(a, b, c))
    }

    /// Area of triangle `t`.
    pub fn area(&self, t: usize) -> f64 {
        heron(self.lengths[3 * t], self.lengths[3 * t + 1], self.lengths[3 * t + 2])
    }

    /// Flips edges until all are Delaunay (or the flip budget is spent, which only rounding can cause).
    pub fn make_delaunay(&mut self) {
        let mut queue: Vec<u32> = (0..self.tails.len() as u32)
            .filter(|&h| self.twins[h as usize] != NONE && h < self.twins[h as usize])
            .collect();
        queue.reverse();
        let mut queued = vec![false; self.tails.len()];
        queue.iter().for_each(|&h| queued[h as usize] = true);
        let budget = FLIPS_PER_EDGE_MAX * queue.len();
        while let Some(h) = queue.pop() {
            stop::pass(1);
            queued[h as usize] = false;
            let g = self.twins[h as usize];
            if g == NONE || self.cotangent(h) + self.cotangent(g) >= -DELAUNAY_SLACK || self.flips.len() >= budget {
                continue;
            }
            if !self.flip(h) {
                continue;
            }
            for x in [next(h), prev(h), next(g), prev(g)] {
                let y = self.twins[x as usize];
                let key = if y == NONE { continue } else { x.min(y) };
                if !std::mem::replace(&mut queued[key as usize], true) {
                    queue.push(key);
                }
            }
        }
    }

    /// Flips the edge of `h`; false where it cannot be (the edge borders one triangle twice, or the new edge would
    /// have no length).
    fn flip(&mut self, h: u32) -> bool {
        let g = self.twins[h as usize];
        if g == NONE || g / 3 == h / 3 {
            return false;
        }
        let Some(length) = self.flipped_length(h, g) else { return false };
        let (tail_c, tail_d) = (self.tails[prev(h) as usize], self.tails[prev(g) as usize]);
        rotate(&mut self.tails, h, g);
        rotate(&mut self.lengths, h, g);
        self.rotate_twins(h, g);
        self.tails[h as usize] = tail_d;
        self.tails[g as usize] = tail_c;
        self.lengths[h as usize] = length;
        self.lengths[g as usize] = length;
        self.flips.push([h, g]);
        true
    }

    /// Length of the other diagonal of the quad around `h`, by unfolding it into the plane.
    fn flipped_length(&self, h: u32, g: u32) -> Option<f64> {
        let l = |x: u32| self.lengths[x as usize];
        let ab = l(h);
        let place = |from_a: f64, from_b: f64| {
            let x = (ab * ab + from_a * from_a - from_b * from_b) / (2.0 * ab);
            (x, (from_a * from_a - x * x).max(0.0).sqrt())
        };
        let (cx, cy) = place(l(prev(h)), l(next(h)));
        let (dx, dy) = place(l(next(g)), l(prev(g)));
        let length = (cx - dx).hypot(cy + dy);
        (length > 0.0 && length.is_finite()).then_some(length)
    }

    /// Moves the twins of the four outer halfedges with them; some may be glued to each other.
    fn rotate_twins(&mut self, h: u32, g: u32) {
        let moved = |x: u32| match x {
            _ if x == prev(h) => next(h),
            _ if x == next(g) => prev(h),
            _ if x == prev(g) => next(g),
            _ if x == next(h) => prev(g),
            _ => x,
        };
        rotate(&mut self.twins, h, g);
        for x in [next(h), prev(h), next(g), prev(g)] {
            let y = self.twins[x as usize];
            if y != NONE {
                self.twins[x as usize] = moved(y);
            }
        }
        for x in [next(h), prev(h), next(g), prev(g)] {
            let y = self.twins[x as usize];
            if y != NONE {
                self.twins[y as usize] = x;
            }
        }
    }

    /// Carries a cochain (one integer a halfedge, `s(twin) = −s`) from the mesh it was made on through all flips.
    /// `tails` are those of that mesh. A flip inside the star of a vertex of `avoid` goes round on the other side.
    pub fn carry(&self, mesh: &TriMesh, cochain: &mut [i32], avoid: &[u32]) {
        let mut tails: Vec<u32> = (0..mesh.twins.len() as u32).map(|h| mesh.tail(h)).collect();
        for &[h, g] in &self.flips {
            let (tail_c, tail_d) = (tails[prev(h) as usize], tails[prev(g) as usize]);
            let through_a = -cochain[next(g) as usize] - cochain[prev(h) as usize];
            let through_b = cochain[prev(g) as usize] + cochain[next(h) as usize];
            let jump = if avoid.contains(&tails[h as usize]) { through_b } else { through_a };
            rotate(&mut tails, h, g);
            rotate(cochain, h, g);
            tails[h as usize] = tail_d;
            tails[g as usize] = tail_c;
            cochain[h as usize] = jump;
            cochain[g as usize] = -jump;
        }
    }
}

/// The four outer halfedges of a flipped quad change places: c→a, a→d close the first triangle, d→b, b→c the second.
fn rotate<T: Copy>(data: &mut [T], h: u32, g: u32) {
    let (hn, hp) = (data[next(h) as usize], data[prev(h) as usize]);
    let (gn, gp) = (data[next(g) as usize], data[prev(g) as usize]);
    data[next(h) as usize] = hp;
    data[prev(h) as usize] = gn;
    data[next(g) as usize] = gp;
    data[prev(g) as usize] = hn;
}

/// Area from lengths, stable for thin triangles (Kahan).
fn heron(a: f64, b: f64, c: f64) -> f64 {
    let (mut x, mut y, mut z) = (a, b, c);
    if x < y {
        std::mem::swap(&mut x, &mut y);
    }
    if y < z {
        std::mem::swap(&mut y, &mut z);
    }
    if x < y {
        std::mem::swap(&mut x, &mut y);
    }
    let product = (x + (y + z)) * (z - (x - y)) * (z + (x - y)) * (x + (y - z));
    0.25 * product.max(0.0).sqrt().max(1e-150)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::tests::grid;

    fn sheared(n: u32) -> TriMesh {
        let mut mesh = grid(n, n, false, false);
        for p in &mut mesh.positions {
            *p = Vec3::new(p.x + 3.0 * p.y, p.y, 0.2 * (5.0 * p.x).sin());
        }
        mesh
    }

    #[test]
    fn flipping_ends_delaunay_and_keeps_the_area_of_a_flat_sheet() {
        let mut mesh = sheared(12);
        mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
        let mut t = Intrinsic::of(&mesh);
        t.make_delaunay();
        assert!(!t.flips.is_empty());
        for h in 0..t.tails.len() as u32 {
            let g = t.twins[h as usize];
            if g != NONE {
                assert!(t.cotangent(h) + t.cotangent(g) >= -1e-6);
                assert_eq!((t.tails[h as usize], t.head(h)), (t.head(g), t.tails[g as usize]));
                assert_eq!(t.twins[g as usize], h);
            }
        }
        let area: f64 = (0..t.tails.len() / 3).map(|k| t.area(k)).sum();
        assert!((area - mesh.total_area()).abs() < 1e-9);
    }

    #[test]
    fn an_exact_cochain_stays_exact_through_flips() {
        let mesh = sheared(10);
        let mut t = Intrinsic::of(&mesh);
        t.make_delaunay();
        let potential = |v: u32| (v as i32 * 7919) % 23;
        let mut cochain: Vec<i32> =
            (0..mesh.twins.len() as u32).map(|h| potential(mesh.head(h)) - potential(mesh.tail(h))).collect();
        t.carry(&mesh, &mut cochain, &[]);
        for h in 0..t.tails.len() as u32 {
            assert_eq!(cochain[h as usize], potential(t.head(h)) - potential(t.tails[h as usize]));
        }
    }
}
