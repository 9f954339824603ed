//! Scans made from shapes: the quads' layout is destroyed by random collapses, flips and relaxation, then noise and a
//! pose are added.

use super::random::Random;
use nalgebra::{Rotation3, Unit};
use quadmuse_kernel::mesh::{NONE, PolyMesh, Vec3};

/// Deviation of the noise along the normal against the shortest edge of a vertex (at most the mean edge).
const NOISE: f64 = 0.06;
/// Passes over all edges before the thinning gives up.
const PASSES_MAX: usize = 60;
/// A collapse may turn no triangle's normal further than this (cosine): sharp folds keep their small triangles.
const KEEP: f64 = 0.9;
/// Vertices whose triangles differ more than this (cosine) from their mean are not relaxed.
const CALM: f64 = 0.8;
/// Edges at other vertices are thinned to this part of the usual length.
const FINE: f64 = 0.4;
/// Rounds of flips and relaxation at the end.
const ROUNDS: usize = 5;

/// How a scan is made.
pub(super) struct Scan {
    /// Seed of every random choice.
    pub(super) seed: u64,
    /// Triangles to keep, about.
    pub(super) triangles: usize,
    /// Largest tilt of the pose, in radians; the turn around the upright axis is any.
    pub(super) tilt: f64,
    /// Factor from the shape's units to the scan's.
    pub(super) scale: f64,
}

/// An irregular triangle mesh of the surface that the quads cover.
pub(super) fn scan(positions: &[Vec3], quads: &[[u32; 4]], scan: &Scan) -> PolyMesh {
    let mut random = Random::new(scan.seed);
    let mut soup = Soup::of(positions, quads, &mut random);
    soup.thin(scan.triangles, &mut random);
    for _ in 0..ROUNDS {
        soup.flip();
        soup.relax();
    }
    soup.flip();
    soup.roughen(&mut random);
    soup.finish(scan, &mut random)
}

/// An edge: its vertices in ascending order, and its triangles.
struct Edge {
    ends: [u32; 2],
    left: u32,
    right: u32,
}

/// Triangles with the triangles around each vertex; dead ones are empty.
struct Soup {
    points: Vec<Vec3>,
    triangles: Vec<Option<[u32; 3]>>,
    around: Vec<Vec<u32>>,
    on_rim: Vec<bool>,
    alive: usize,
}

impl Soup {
    /// Cuts every quad along a random diagonal.
    fn of(positions: &[Vec3], quads: &[[u32; 4]], random: &mut Random) -> Self {
        let mut triangles = Vec::with_capacity(2 * quads.len());
        for &[a, b, c, d] in quads {
            let cut = if random.unit() < 0.5 { [[a, b, c], [a, c, d]] } else { [[b, c, d], [b, d, a]] };
            triangles.extend(cut.map(Some));
        }
        let mut soup = Self {
            points: positions.to_vec(),
            alive: triangles.len(),
            around: vec![Vec::new(); positions.len()],
            on_rim: vec![false; positions.len()],
            triangles,
        };
        for t in 0..soup.triangles.len() {
            soup.triangles[t].into_iter().flatten().for_each(|v| soup.around[v as usize].push(t as u32));
        }
        for edge in soup.edges().iter().filter(|e| e.right == NONE) {
            edge.ends.iter().for_each(|&v| soup.on_rim[v as usize] = true);
        }
        soup
    }

    /// The edges by vertex numbers, each with its one or two triangles ([`NONE`] for a missing second).
    fn edges(&self) -> Vec<Edge> {
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * self.alive);
        for (t, corners) in self.triangles.iter().enumerate() {
            let Some(c) = corners else { continue };
            for k in 0..3 {
                let (a, b) = (c[k], c[(k + 1) % 3]);
                sides.push(([a.min(b), a.max(b)], t as u32));
            }
        }
        sides.sort_unstable();
        let edge =
            |run: &[([u32; 2], u32)]| Edge { ends: run[0].0, left: run[0].1, right: run.get(1).map_or(NONE, |s| s.1) };
        sides.chunk_by(|x, y| x.0 == y.0).map(edge).collect()
    }

    fn normal(&self, corners: [u32; 3]) -> Vec3 {
        let [a, b, c] = corners.map(|v| self.points[v as usize]);
        (b - a).cross(&(c - a))
    }

    fn neighbours(&self, v: u32) -> Vec<u32> {
        let fan = self.around[v as usize].iter().filter_map(|&t| self.triangles[t as usize]);
        let mut all: Vec<u32> = fan.flatten().filter(|&w| w != v).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Collapses short edges in random order, longer ones from pass to pass, until few enough triangles are left.
    fn thin(&mut self, target: usize, random: &mut Random) {
        let area: f64 = self.triangles.iter().flatten().map(|&t| 0.5 * self.normal(t).norm()).sum();
        // The edge of an even triangulation of that many triangles.
        let mut limit = 0.55 * (area / target.max(1) as f64 * 4.0 / 3f64.sqrt()).sqrt();
        for _ in 0..PASSES_MAX {
            let mut edges = self.edges();
            random.shuffle(&mut edges);
            for Edge { ends: [a, b], .. } in edges {
                if self.alive <= target {
                    return;
                }
                let length = (self.points[a as usize] - self.points[b as usize]).norm();
                let limit = if self.calm(a) && self.calm(b) { limit } else { FINE * limit };
                if length < limit * random.between(0.8, 1.2) {
                    let t = random.between(0.15, 0.85);
                    self.collapse(a, b, t, 1.7 * limit);
                }
            }
            self.flip();
            limit *= 1.10;
        }
    }

    /// Merges `a` into `b` at the part `t` of the way, if the surface stays a manifold and nothing folds over.
    fn collapse(&mut self, a: u32, b: u32, t: f64, longest: f64) {
        let (a, b) = if self.on_rim[a as usize] && !self.on_rim[b as usize] { (b, a) } else { (a, b) };
        let shared: Vec<u32> =
            self.around[a as usize].iter().copied().filter(|t| self.around[b as usize].contains(t)).collect();
        let rims = (self.on_rim[a as usize], self.on_rim[b as usize]);
        let wanted = if rims == (true, true) { 1 } else { 2 };
        let (ring, other) = (self.neighbours(a), self.neighbours(b));
        let common = ring.iter().filter(|v| other.contains(v)).count();
        if shared.len() != wanted || common != wanted || ring.len() + other.len() > 16 {
            return;
        }
        let (p, q) = (self.points[a as usize], self.points[b as usize]);
        let place = if rims == (false, true) { q } else { p + (q - p) * t };
        if ring.iter().chain(&other).any(|&v| (self.points[v as usize] - place).norm() > longest) {
            return;
        }
        let moved = |v: u32| if v == a || v == b { place } else { self.points[v as usize] };
        let kept = self.around[a as usize].iter().chain(&self.around[b as usize]).filter(|t| !shared.contains(t));
        for corners in kept.filter_map(|&t| self.triangles[t as usize]) {
            let [x, y, z] = corners.map(moved);
            let (old, new) = (self.normal(corners), (y - x).cross(&(z - x)));
            if new.dot(&old) < KEEP * new.norm() * old.norm() || new.norm() < 1e-12 {
                return;
            }
        }
        for &t in &shared {
            for v in self.triangles[t as usize].take().into_iter().flatten() {
                self.around[v as usize].retain(|&s| s != t);
            }
            self.alive -= 1;
        }
        for t in std::mem::take(&mut self.around[a as usize]) {
            if let Some(corners) = &mut self.triangles[t as usize] {
                corners.iter_mut().filter(|v| **v == a).for_each(|v| *v = b);
                self.around[b as usize].push(t);
            }
        }
        self.points[b as usize] = place;
    }

    /// Flips the edges whose opposite angles sum to more than π.
    fn flip(&mut self) {
        for Edge { ends: [a, b], left: s, right: t } in self.edges().into_iter().filter(|e| e.right != NONE) {
            let (Some(left), Some(right)) = (self.triangles[s as usize], self.triangles[t as usize]) else { continue };
            let apex = |corners: [u32; 3]| corners.into_iter().find(|&v| v != a && v != b);
            let holds = |corners: &[u32; 3]| corners.contains(&a) && corners.contains(&b);
            let (Some(c), Some(d)) = (apex(left), apex(right)) else { continue };
            if !holds(&left) || !holds(&right) || c == d || self.neighbours(c).contains(&d) {
                continue;
            }
            let angle = |v: u32| {
                let (x, y) = (
                    self.points[a as usize] - self.points[v as usize],
                    self.points[b as usize] - self.points[v as usize],
                );
                x.cross(&y).norm().atan2(x.dot(&y))
            };
            if angle(c) + angle(d) < std::f64::consts::PI + 1e-3 {
                continue;
            }
            // `left` runs a → b or b → a; the new triangles keep its sense.
            let forward = (0..3).any(|k| left[k] == a && left[(k + 1) % 3] == b);
            let (x, y) = if forward { (a, b) } else { (b, a) };
            let (first, second) = ([x, d, c], [y, c, d]);
            let (n, m) = (self.normal(first), self.normal(second));
            let old = (self.normal(left).normalize() + self.normal(right).normalize()).normalize();
            if n.dot(&old) < CALM * n.norm() || m.dot(&old) < CALM * m.norm() {
                continue;
            }
            (self.triangles[s as usize], self.triangles[t as usize]) = (Some(first), Some(second));
            self.around[y as usize].retain(|&k| k != s);
            self.around[x as usize].retain(|&k| k != t);
            self.around[d as usize].push(s);
            self.around[c as usize].push(t);
        }
    }

    fn vertex_normal(&self, v: u32) -> Vec3 {
        let fan = self.around[v as usize].iter().filter_map(|&t| self.triangles[t as usize]);
        fan.map(|c| self.normal(c)).sum::<Vec3>().try_normalize(1e-30).unwrap_or_else(Vec3::zeros)
    }

    /// Whether the surface is smooth at a vertex: its triangles face nearly the same way.
    fn calm(&self, v: u32) -> bool {
        let n = self.vertex_normal(v);
        let fan = self.around[v as usize].iter().filter_map(|&t| self.triangles[t as usize]);
        fan.map(|c| self.normal(c)).all(|m| m.dot(&n) > CALM * m.norm())
    }

    /// Moves inner vertices half way to their neighbours' mean, in the tangent plane.
    fn relax(&mut self) {
        let moves: Vec<Vec3> = (0..self.points.len() as u32)
            .map(|v| {
                let ring = self.neighbours(v);
                if ring.is_empty() || self.on_rim[v as usize] {
                    return Vec3::zeros();
                }
                let here = self.points[v as usize];
                let step = ring.iter().map(|&w| self.points[w as usize]).sum::<Vec3>() / ring.len() as f64 - here;
                let n = self.vertex_normal(v);
                (step - n * n.dot(&step)) * if self.calm(v) { 0.5 } else { 0.0 }
            })
            .collect();
        self.points.iter_mut().zip(moves).for_each(|(p, step)| *p += step);
    }

    fn roughen(&mut self, random: &mut Random) {
        let edges = self.edges();
        let length = |e: &[u32; 2]| (self.points[e[0] as usize] - self.points[e[1] as usize]).norm();
        let mean = edges.iter().map(|e| length(&e.ends)).sum::<f64>() / edges.len().max(1) as f64;
        let normals: Vec<Vec3> = (0..self.points.len() as u32).map(|v| self.vertex_normal(v)).collect();
        let mut shortest = vec![mean; self.points.len()];
        for e in &edges {
            e.ends.iter().for_each(|&v| shortest[v as usize] = shortest[v as usize].min(length(&e.ends)));
        }
        for (v, n) in normals.into_iter().enumerate() {
            self.points[v] += n * (NOISE * shortest[v] * random.normal());
        }
    }

    /// Poses, scales and renumbers; nothing of the order survives.
    fn finish(self, scan: &Scan, random: &mut Random) -> PolyMesh {
        let turn = Rotation3::from_axis_angle(&Vec3::y_axis(), random.between(-3.1, 3.1));
        let level = random.between(-3.1, 3.1);
        let axis = Unit::new_normalize(Vec3::new(level.cos(), 0.0, level.sin()));
        let pose = Rotation3::from_axis_angle(&axis, scan.tilt * random.between(0.6, 1.0)) * turn;
        let shift = Vec3::from_fn(|_, _| random.between(-3.0, 3.0) * scan.scale);
        let mut order: Vec<u32> =
            (0..self.points.len() as u32).filter(|&v| !self.around[v as usize].is_empty()).collect();
        random.shuffle(&mut order);
        let mut number = vec![0u32; self.points.len()];
        order.iter().enumerate().for_each(|(k, &v)| number[v as usize] = k as u32);
        let mut triangles: Vec<[u32; 3]> = self.triangles.into_iter().flatten().collect();
        random.shuffle(&mut triangles);
        let turned = triangles.iter().map(|t| {
            let first = (random.unit() * 3.0) as usize;
            std::array::from_fn::<u32, 3, _>(|k| number[t[(first + k) % 3] as usize])
        });
        let turned: Vec<[u32; 3]> = turned.collect();
        PolyMesh {
            positions: order.iter().map(|&v| pose * self.points[v as usize] * scan.scale + shift).collect(),
            faces: turned.iter().map(|t| &t[..]).collect(),
            ..PolyMesh::default()
        }
    }
}
