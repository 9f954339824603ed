//! Extraordinary vertices beside seams and in regular layouts are made fewer by local changes.
//!
//! With d(v) the number of edges at v, a change is made where it lowers Σ(d(v) − 4)² over the inner vertices (on the
//! boundary what is above 3): an edge between two quads is turned within their hexagon; a quad is closed over a diagonal, whose
//! ends become one; a vertex of six edges or more is opened to a quad between two of its edges. Only free faces are
//! changed, never those inside a mapped example, and no quad's angles may get worse than those around it were, or than
//! [`DEVIATION_MAX_DEG`]. *Ours, not the paper's;* the operations are those of quad simplification at large.

use super::net::{Net, Step};
use super::resolve::worst_deviation_deg;
use super::smooth::Target;
use crate::mesh::Vec3;
use crate::numerics::stage::Stage;

/// Rounds over the whole net at most.
const ROUNDS: usize = 6;
/// The largest deviation from a right angle that a changed quad may have, in degrees, before it is smoothed.
const DEVIATION_MAX_DEG: f64 = 62.0;
/// What a vertex with too few edges adds to the sum.
const NEVER: i64 = 1000;
/// Edges at a vertex from which on it may be opened.
const OPENED_MIN: usize = 6;
/// Share of the way to its neighbours that each half of an opened vertex goes.
const OPENING: f64 = 0.35;

/// What a change has to gain at least, in turn: a change that does much may be barred by one that does little.
const GAINS: [i64; 2] = [4, 1];

/// A net with the faces that may be changed.
pub struct ValenceSimplifier<'a> {
    /// The net, of quads only.
    pub net: Net,
    /// Vertices that were changed.
    pub touched: Vec<u32>,
    free: Vec<bool>,
    target: &'a Target,
    /// What is asked of every vertex in every round, kept up to date: its edges, and whether it lies on a boundary.
    stars: Vec<Star>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Star {
    edges: i64,
    is_border: bool,
}

impl Star {
    fn of(net: &Net, v: u32) -> Self {
        Self { edges: net.neighbours(v).len() as i64, is_border: net.on_boundary(v) }
    }
}

impl<'a> ValenceSimplifier<'a> {
    /// A net of quads on the input; `free` tells whether a face may be changed (one that is beyond its end may), `touched`
    /// is what was changed before.
    pub fn new(net: Net, free: Vec<bool>, target: &'a Target, touched: Vec<u32>) -> Self {
        let stars = (0..net.positions.len() as u32).map(|v| Star::of(&net, v)).collect();
        Self { net, touched, free, target, stars }
    }

    /// Makes changes until none helps; gives how many were made.
    pub fn run(&mut self) -> usize {
        if !Stage::Valence.is_on() {
            return 0;
        }
        let mut changes = 0;
        for least in GAINS {
            for _ in 0..ROUNDS {
                let made = self.round(least);
                changes += made;
                if made == 0 {
                    break;
                }
            }
        }
        changes
    }

    fn round(&mut self, least: i64) -> usize {
        let mut changes = 0;
        for f in 0..self.net.face_slots() as u32 {
            changes += usize::from(self.close(f, least));
        }
        for v in 0..self.net.positions.len() as u32 {
            changes += usize::from(self.open(v, least));
        }
        for f in 0..self.net.face_slots() as u32 {
            for k in 0..self.net.face(f).len() {
                changes += usize::from(self.turn(f, k, least));
            }
        }
        changes
    }

    fn is_free(&self, f: u32) -> bool {
        self.free.get(f as usize).copied().unwrap_or(true) && self.net.face(f).len() == 4
    }

    fn all_free(&self, v: u32) -> bool {
        self.net.at(v).iter().all(|&f| self.is_free(f))
    }

    /// What a vertex adds to the sum if it had so many edges more.
    fn cost(&self, v: u32, more: i64) -> i64 {
        let star = self.stars[v as usize];
        let d = star.edges + more;
        match star.is_border {
            false if d < 3 => NEVER,
            false => (d - 4) * (d - 4),
            // A corner of the boundary has two.
            true if d < 2 => NEVER,
            true => (d - 3).max(0).pow(2),
        }
    }

    fn is_border(&self, v: u32) -> bool {
        self.stars[v as usize].is_border
    }

    /// Notes a change at some vertices: of no others the edges are more or fewer.
    fn changed(&mut self, vertices: &[u32]) {
        for &v in vertices {
            self.stars[v as usize] = Star::of(&self.net, v);
        }
        self.touched.extend(vertices);
    }

    fn worst_at(&self, faces: &[u32]) -> f64 {
        faces.iter().map(|&f| self.shape_of(self.net.face(f), None)).fold(0.0, f64::max)
    }

    /// The worst deviation of a quad, with one of its corners elsewhere if told.
    fn shape_of(&self, face: &[u32], moved: Option<(u32, Vec3)>) -> f64 {
        let Ok(c) = <[u32; 4]>::try_from(face) else { return 180.0 };
        worst_deviation_deg(c.map(|v| match moved {
            Some((w, p)) if w == v => p,
            _ => self.net.positions[v as usize],
        }))
    }

    /// Turns the edge from corner k of a face on, if that gains enough.
    fn turn(&mut self, f: u32, k: usize, least: i64) -> bool {
        if !self.is_free(f) {
            return false;
        }
        let c = self.net.face(f);
        let (u, v) = (c[k], c[(k + 1) % 4]);
        let (p, q) = (c[(k + 2) % 4], c[(k + 3) % 4]);
        let Some(g) = self.net.face_along(v, u).filter(|&g| g > f && self.is_free(g)) else { return false };
        let Some([_, r]) = self.net.beside(g, u) else { return false };
        let Some([s, _]) = self.net.beside(g, v) else { return false };
        // The hexagon runs v, p, q, u, r, s.
        let choices = [(p, r, [[p, q, u, r], [r, s, v, p]]), (q, s, [[q, u, r, s], [s, v, p, q]])];
        let allowed = self.worst_at(&[f, g]).max(DEVIATION_MAX_DEG);
        for (x, y, faces) in choices {
            let gain = self.cost(u, 0) + self.cost(v, 0) + self.cost(x, 0) + self.cost(y, 0)
                - self.cost(u, -1)
                - self.cost(v, -1)
                - self.cost(x, 1)
                - self.cost(y, 1);
            if gain < least || x == y || self.net.joined(x, y) {
                continue;
            }
            if faces.iter().any(|c| self.shape_of(c, None) > allowed) {
                continue;
            }
            self.net.set_face(f, faces[0].to_vec());
            self.net.set_face(g, faces[1].to_vec());
            self.changed(&[u, v, x, y]);
            return true;
        }
        false
    }

    /// Closes a face over one of its diagonals, if that gains enough.
    fn close(&mut self, f: u32, least: i64) -> bool {
        if !self.is_free(f) || self.net.face(f).iter().any(|&v| self.is_border(v)) {
            return false;
        }
        let c = [0, 1, 2, 3].map(|k| self.net.face(f)[k]);
        for [a, b, c, d] in [c, [c[1], c[2], c[3], c[0]]] {
            let merged = self.stars[a as usize].edges + self.stars[c as usize].edges - 2;
            let gain = [a, b, c, d].iter().map(|&v| self.cost(v, 0)).sum::<i64>()
                - (merged - 4) * (merged - 4)
                - self.cost(b, -1)
                - self.cost(d, -1);
            if gain < least || !self.all_free(a) || !self.all_free(c) {
                continue;
            }
            let around = self.net.neighbours(c);
            let common: Vec<u32> = self.net.neighbours(a).into_iter().filter(|v| around.contains(v)).collect();
            let is_simple = common.len() == 2 && common.contains(&b) && common.contains(&d) && !self.net.joined(a, c);
            if !is_simple {
                continue;
            }
            let middle = 0.5 * (self.net.positions[a as usize] + self.net.positions[c as usize]);
            let to = self.target.onto_surface(middle);
            let changed: Vec<u32> = self.net.at(a).iter().chain(self.net.at(c)).copied().filter(|&g| g != f).collect();
            let allowed = self.worst_at(&changed).max(DEVIATION_MAX_DEG);
            let shape = |g: &u32| {
                let moved = if self.net.face(*g).contains(&a) { a } else { c };
                self.shape_of(self.net.face(*g), Some((moved, to)))
            };
            // Two faces that meet in a face's four corners would become one on another.
            let is_doubled = self.net.at(a).iter().filter(|g| **g != f).any(|&g| {
                let other = self.net.face(g).iter().copied().filter(|&v| v != a);
                let rest: Vec<u32> = other.collect();
                self.net.at(c).iter().any(|&h| h != f && rest.iter().all(|v| self.net.face(h).contains(v)))
            });
            if is_doubled || changed.iter().any(|g| shape(g) > allowed) {
                continue;
            }
            self.net.remove_face(f);
            for g in self.net.at(c).to_vec() {
                let corners = self.net.face(g).iter().map(|&v| if v == c { a } else { v }).collect();
                self.net.set_face(g, corners);
            }
            self.net.positions[a as usize] = to;
            self.changed(&[a, b, c, d]);
            return true;
        }
        false
    }

    /// Opens a vertex of many edges to a quad, if that gains enough.
    fn open(&mut self, v: u32, least: i64) -> bool {
        if self.net.at(v).len() < OPENED_MIN || self.is_border(v) || !self.all_free(v) {
            return false;
        }
        let Some(fan) = self.net.fan(v) else { return false };
        let edges: Vec<u32> = fan.iter().filter_map(|s| if let Step::Edge(w) = s { Some(*w) } else { None }).collect();
        let n = edges.len();
        let mut best: Option<(i64, usize, usize)> = None;
        for i in 0..n {
            for j in i + 2..n.min(i + n - 1) {
                // Those strictly between, and the two that are split, on each side.
                let (one, two) = ((j - i - 1 + 2) as i64, (n - (j - i) - 1 + 2) as i64);
                let (x, y) = (edges[i], edges[j]);
                let gain = self.cost(v, 0) + self.cost(x, 0) + self.cost(y, 0)
                    - (one - 4).pow(2)
                    - (two - 4).pow(2)
                    - self.cost(x, 1)
                    - self.cost(y, 1);
                if gain >= least && best.is_none_or(|b| gain > b.0) {
                    best = Some((gain, i, j));
                }
            }
        }
        let Some((_, i, j)) = best else { return false };
        let here = self.net.positions[v as usize];
        let towards = |ends: &[u32]| {
            let mean = ends.iter().map(|&w| self.net.positions[w as usize]).sum::<Vec3>() / ends.len().max(1) as f64;
            self.target.onto_surface(here + (mean - here) * OPENING)
        };
        let others: Vec<u32> = (j + 1..i + n).map(|k| edges[k % n]).collect();
        let (stays, goes) = (towards(&others), towards(&edges[i + 1..j]));
        let (x, y) = (edges[i], edges[j]);
        let copy = self.net.add_vertex(goes);
        self.net.positions[v as usize] = stays;
        // The faces between edge i and edge j, counter-clockwise, go to the copy.
        let faces: Vec<u32> = fan
            .iter()
            .skip_while(|s| **s != Step::Edge(x))
            .take_while(|s| **s != Step::Edge(y))
            .filter_map(|s| if let Step::Face(f) = s { Some(*f) } else { None })
            .collect();
        for f in faces {
            let corners = self.net.face(f).iter().map(|&w| if w == v { copy } else { w }).collect();
            self.net.set_face(f, corners);
        }
        // The copy's faces leave x → copy and copy → y without a face on their right.
        self.net.add_face(vec![v, x, copy, y]);
        self.stars.push(Star::of(&self.net, copy));
        self.changed(&[v, copy, x, y]);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check, extraordinary};
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    const DISC: TopologyCounts = TopologyCounts { components: 1, boundary_loops: 1, euler: 1 };

    fn flat() -> (Net, Target) {
        let mut net = sheet(8, 8);
        net.positions.iter_mut().for_each(|p| *p /= 8.0);
        (net, Target::new(&grid(12, 12, false, false)))
    }

    fn simplified(net: Net, free: Vec<bool>, target: &Target) -> (Net, usize) {
        let mut simplifier = ValenceSimplifier::new(net, free, target, Vec::new());
        let changes = simplifier.run();
        let anew: Vec<Star> =
            (0..simplifier.net.positions.len() as u32).map(|v| Star::of(&simplifier.net, v)).collect();
        assert_eq!(simplifier.stars, anew);
        (simplifier.net, changes)
    }

    #[test]
    fn a_turned_edge_is_turned_back_unless_its_faces_are_held() {
        let (mut net, target) = flat();
        // Cells 27 and 28 share the edge 31–40.
        assert_eq!((net.face(27), net.face(28)), (&[30, 31, 40, 39][..], &[31, 32, 41, 40][..]));
        net.set_face(27, vec![30, 31, 32, 39]);
        net.set_face(28, vec![39, 32, 41, 40]);
        assert_eq!(extraordinary(&net.clone().into_mesh().0), 4);
        let held = vec![false; 64];
        assert_eq!(simplified(net.clone(), held, &target).1, 0);
        let (net, changes) = simplified(net, Vec::new(), &target);
        let mesh = net.into_mesh().0;
        assert_eq!((changes, extraordinary(&mesh), check(&mesh, DISC)), (1, 0, Ok(())));
    }

    #[test]
    fn a_quad_too_many_is_closed_and_one_too_few_is_opened() {
        let (net, target) = flat();
        let mut net = net;
        // Open the middle by hand: two vertices of three edges, two of five.
        let [x, v, y] = [39, 40, 41];
        let copy = net.add_vertex(net.positions[v as usize] + Vec3::new(0.0, 0.03, 0.0));
        net.positions[v as usize].y -= 0.03;
        for f in [35, 36] {
            let corners = net.face(f).iter().map(|&w| if w == v { copy } else { w }).collect();
            net.set_face(f, corners);
        }
        net.add_face(vec![x, v, y, copy]);
        assert_eq!(extraordinary(&net.clone().into_mesh().0), 4);
        let (mut net, changes) = simplified(net, Vec::new(), &target);
        assert_eq!(changes, 1);
        let mesh = net.clone().into_mesh().0;
        assert_eq!((extraordinary(&mesh), check(&mesh, DISC)), (0, Ok(())));
        // A quad closed over its diagonal at 30 and 40: one vertex of six edges, two of three.
        net.remove_face(27);
        for f in net.at(40).to_vec() {
            let corners = net.face(f).iter().map(|&w| if w == 40 { 30 } else { w }).collect();
            net.set_face(f, corners);
        }
        assert_eq!(extraordinary(&net.clone().into_mesh().0), 3);
        let (net, changes) = simplified(net, Vec::new(), &target);
        assert_eq!(changes, 1);
        let mesh = net.into_mesh().0;
        assert_eq!((extraordinary(&mesh), check(&mesh, DISC)), (0, Ok(())));
    }
}
