//! The example at rest: unit area, vertex normals, and evenly spread nodes that stand for its vertices.
//!
//! Nodes cover the surface in balls of radius √(c/m) along its edges; each vertex belongs to the nearest one (Voronoi), and
//! two nodes are neighbours where an edge of the mesh runs between their cells. Weights w_ij are such that
//! Σ w |e_j − e_i|² = 2 · area, as those of the cotangent Laplacian; where every vertex is a node, they are the cotangents.
//! A vertex follows x_v = Σ_k ω_k (x_k + L_k (e_v − e_k)). *Source:* Sumner, Schmid and Pauly 2007 (embedded
//! deformation: blending). *Ours, not the paper's:* neighbours along the surface only; the rim is covered first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};
use nalgebra::Matrix3;

/// Nodes with which a vertex moves.
pub(super) const BLENDED: usize = 4;
/// m balls of radius √(this/m) that cover unit area, measured.
const BALL_AREA: f64 = 0.7;
/// All vertices become nodes where there are at most this many times the nodes wanted.
const ALL_BELOW: f64 = 1.4;
/// Cotangent weights are held between these.
const WEIGHT_RANGE: [f64; 2] = [0.05, 5.0];

/// The example in its own frame: area 1, centred, mirrored where the map mirrors.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) normals: Vec<Vec3>,
    /// Of each vertex; they sum to 1.
    pub(super) areas: Vec<f64>,
    pub(super) rim: Vec<bool>,
    /// Neighbours of each vertex, as ranges of `beside`.
    starts: Vec<u32>,
    beside: Vec<u32>,
}

/// Vertices that stand for all.
#[derive(Clone, Debug)]
pub(super) struct Nodes {
    pub(super) vertices: Vec<u32>,
    /// They sum to 1.
    pub(super) areas: Vec<f64>,
    /// The nearest node of each vertex.
    pub(super) owner: Vec<u32>,
    /// Neighbours with their weight, each pair once, i < j.
    pub(super) edges: Vec<(u32, u32, f64)>,
    /// With which nodes a vertex moves, and how much.
    pub(super) blend: Vec<[(u32, f64); BLENDED]>,
}

/// Where nodes are, and the local affine map of each.
#[derive(Clone, Debug, Default)]
pub(super) struct Pose {
    pub(super) places: Vec<Vec3>,
    pub(super) maps: Vec<Matrix3<f64>>,
}

impl Rest {
    /// `None` for a mesh without area.
    pub(super) fn new(mesh: &TriMesh, mirror: f64) -> Option<Self> {
        let n = mesh.positions.len();
        let (area, sign) = (mesh.total_area(), if mirror < 0.0 { -1.0 } else { 1.0 });
        if !(area > 0.0 && area.is_finite()) {
            return None;
        }
        let centre = mesh.positions.iter().sum::<Vec3>() / n as f64;
        let positions: Vec<Vec3> = (mesh.positions.iter())
            .map(|p| (p - centre).component_mul(&Vec3::new(sign, 1.0, 1.0)) / area.sqrt())
            .collect();
        let triangles: Vec<[u32; 3]> =
            mesh.triangles.iter().map(|&[a, b, c]| if sign < 0.0 { [a, c, b] } else { [a, b, c] }).collect();
        let (normals, areas) = vertex_normals(&positions, &triangles);
        let mut rim = vec![false; n];
        let mut pairs = Vec::with_capacity(mesh.twins.len() * 2);
        for h in 0..mesh.twins.len() as u32 {
            let ends = [mesh.tail(h), mesh.head(h)];
            if mesh.twin(h) == NONE {
                ends.iter().for_each(|v| rim[*v as usize] = true);
            }
            pairs.extend([ends, [ends[1], ends[0]]]);
        }
        let (starts, beside) = ranges(n, pairs);
        Some(Self { positions, triangles, normals, areas, rim, starts, beside })
    }

    /// A set of vertices grown along edges into those that `may` join.
    pub(super) fn grown(&self, mut set: Vec<bool>, may: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut todo: Vec<u32> = (0..set.len() as u32).filter(|v| set[*v as usize]).collect();
        while let Some(v) = todo.pop() {
            for &u in self.around(v) {
                if !set[u as usize] && may(u as usize) {
                    set[u as usize] = true;
                    todo.push(u);
                }
            }
        }
        set
    }

    fn around(&self, v: u32) -> &[u32] {
        &self.beside[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }

    /// Mean length of the edges at each vertex, where the vertices lie at `positions`.
    pub(super) fn edge_lengths(&self, positions: &[Vec3]) -> Vec<f64> {
        let mean = |v: u32| {
            let around = self.around(v);
            let sum: f64 = around.iter().map(|u| (positions[*u as usize] - positions[v as usize]).norm()).sum();
            sum / around.len().max(1) as f64
        };
        (0..positions.len() as u32).map(mean).collect()
    }

    /// About `count` evenly spread nodes, or every vertex where there are few more.
    pub(super) fn nodes(&self, count: usize) -> Nodes {
        let n = self.positions.len();
        if n as f64 <= ALL_BELOW * count as f64 {
            let of = |v: u32| [(v, 1.0), (v, 0.0), (v, 0.0), (v, 0.0)];
            return Nodes {
                vertices: (0..n as u32).collect(),
                areas: self.areas.clone(),
                owner: (0..n as u32).collect(),
                edges: self.cotangents(),
                blend: (0..n as u32).map(of).collect(),
            };
        }
        let (vertices, owner) = self.cover((BALL_AREA / count as f64).sqrt());
        let mut areas = vec![0.0; vertices.len()];
        (0..n).for_each(|v| areas[owner[v] as usize] += self.areas[v]);
        let mut pairs = Vec::new();
        for v in 0..n as u32 {
            for u in self.around(v) {
                let ends = [owner[v as usize], owner[*u as usize]];
                if ends[0] != ends[1] {
                    pairs.push(ends);
                }
            }
        }
        let (starts, beside) = ranges(vertices.len(), pairs);
        let around = |k: u32| &beside[starts[k as usize] as usize..starts[k as usize + 1] as usize];
        let at = |k: u32| self.positions[vertices[k as usize] as usize];
        let pairs = (0..vertices.len() as u32).flat_map(|i| around(i).iter().map(move |j| (i, *j)));
        let mut edges: Vec<(u32, u32, f64)> = pairs.filter(|(i, j)| i < j).map(|(i, j)| (i, j, 0.0)).collect();
        let squares: f64 = edges.iter().map(|(i, j, _)| (at(*i) - at(*j)).norm_squared()).sum();
        edges.iter_mut().for_each(|e| e.2 = 2.0 / squares.max(f64::MIN_POSITIVE));
        let blend = (0..n).map(|v| blend(owner[v], around(owner[v]), |k| (at(k) - self.positions[v]).norm())).collect();
        Nodes { vertices, areas, owner, edges, blend }
    }

    /// Vertices whose balls of a radius cover all, and the nearest of them to each vertex.
    fn cover(&self, radius: f64) -> (Vec<u32>, Vec<u32>) {
        let n = self.positions.len();
        let (mut distance, mut owner, mut centres) = (vec![f64::INFINITY; n], vec![0u32; n], Vec::new());
        let mut front = BinaryHeap::new();
        let first = (0..n as u32).filter(|v| self.rim[*v as usize]);
        for v in first.chain((0..n as u32).filter(|v| !self.rim[*v as usize])) {
            if distance[v as usize] <= radius {
                continue;
            }
            let number = centres.len() as u32;
            centres.push(v);
            (distance[v as usize], owner[v as usize]) = (0.0, number);
            // Distances are not negative, so that their bits are in their order.
            front.push(Reverse((0u64, v)));
            while let Some(Reverse((bits, u))) = front.pop() {
                let so_far = f64::from_bits(bits);
                if so_far > distance[u as usize] {
                    continue;
                }
                for &x in self.around(u) {
                    let d = so_far + (self.positions[x as usize] - self.positions[u as usize]).norm();
                    if d < distance[x as usize] && d <= radius {
                        (distance[x as usize], owner[x as usize]) = (d, number);
                        front.push(Reverse((d.to_bits(), x)));
                    }
                }
            }
        }
        (centres, owner)
    }

    /// Edges of the mesh with their cotangent weights.
    fn cotangents(&self) -> Vec<(u32, u32, f64)> {
        let mut edges = Vec::with_capacity(3 * self.triangles.len());
        for t in &self.triangles {
            for k in 0..3 {
                let (c, a, b) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
                let (e, f) = (self.between(c, a), self.between(c, b));
                let cotangent = e.dot(&f) / e.cross(&f).norm().max(1e-300);
                edges.push((a.min(b), a.max(b), 0.5 * cotangent));
            }
        }
        edges.sort_by(|x, y| (x.0, x.1).cmp(&(y.0, y.1)).then(x.2.total_cmp(&y.2)));
        let sum =
            |run: &[(u32, u32, f64)]| run.iter().map(|e| e.2).sum::<f64>().clamp(WEIGHT_RANGE[0], WEIGHT_RANGE[1]);
        edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)).map(|run| (run[0].0, run[0].1, sum(run))).collect()
    }

    fn between(&self, a: u32, b: u32) -> Vec3 {
        self.positions[b as usize] - self.positions[a as usize]
    }
}

impl Pose {
    /// The rest itself.
    pub(super) fn of(rest: &Rest, nodes: &Nodes) -> Self {
        Self {
            places: nodes.vertices.iter().map(|v| rest.positions[*v as usize]).collect(),
            maps: vec![Matrix3::identity(); nodes.vertices.len()],
        }
    }

    /// Where every vertex is.
    pub(super) fn deformed(&self, rest: &Rest, nodes: &Nodes) -> Vec<Vec3> {
        let at = |v: usize| {
            (nodes.blend[v].iter())
                .filter(|(_, w)| *w > 0.0)
                .map(|(k, w)| {
                    let e = rest.positions[v] - rest.positions[nodes.vertices[*k as usize] as usize];
                    (self.places[*k as usize] + self.maps[*k as usize] * e) * *w
                })
                .sum()
        };
        (0..rest.positions.len()).map(at).collect()
    }

    /// The same pose on other nodes; `vertices` is what [`deformed`](Self::deformed) gave.
    pub(super) fn on(&self, nodes: &Nodes, other: &Nodes, vertices: &[Vec3]) -> Self {
        let blended = |v: u32| nodes.blend[v as usize].iter().map(|(k, w)| self.maps[*k as usize] * *w).sum();
        Self {
            places: other.vertices.iter().map(|v| vertices[*v as usize]).collect(),
            maps: other.vertices.iter().map(|v| blended(*v)).collect(),
        }
    }
}

/// The nearest nodes among a vertex's own and its neighbours, with weights (1 − d/d_max)² that sum to 1.
fn blend(own: u32, around: &[u32], distance: impl Fn(u32) -> f64) -> [(u32, f64); BLENDED] {
    let mut near: Vec<(f64, u32)> = around.iter().chain([&own]).map(|k| (distance(*k), *k)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let farthest =
        near.get(BLENDED).or(near.last()).map_or(0.0, |x| x.0) * if near.len() > BLENDED { 1.0 } else { 1.3 };
    let mut chosen = [(own, 0.0); BLENDED];
    for (slot, (d, k)) in chosen.iter_mut().zip(&near) {
        *slot = (*k, (1.0 - d / farthest.max(f64::MIN_POSITIVE)).max(0.0).powi(2));
    }
    let sum: f64 = chosen.iter().map(|c| c.1).sum();
    if sum > 0.0 {
        chosen.iter_mut().for_each(|c| c.1 /= sum);
    } else {
        chosen = [(own, 0.0); BLENDED];
        chosen[0].1 = 1.0;
    }
    chosen
}

/// Unit normals of vertices, and the share of the area that each has.
pub(super) fn vertex_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<Vec3>, Vec<f64>) {
    let (mut normals, mut areas) = (vec![Vec3::zeros(); positions.len()], vec![0.0; positions.len()]);
    let mut sum = 0.0;
    for t in triangles {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        let n = 0.5 * (b - a).cross(&(c - a));
        let third = n.norm() / 3.0;
        sum += 3.0 * third;
        for v in t {
            normals[*v as usize] += n;
            areas[*v as usize] += third;
        }
    }
    normals.iter_mut().for_each(|n| *n = n.try_normalize(0.0).unwrap_or_else(Vec3::z));
    areas.iter_mut().for_each(|a| *a /= sum.max(f64::MIN_POSITIVE));
    (normals, areas)
}

/// Second numbers of pairs, sorted and once each, in ranges by the first.
fn ranges(n: usize, mut pairs: Vec<[u32; 2]>) -> (Vec<u32>, Vec<u32>) {
    pairs.sort_unstable();
    pairs.dedup();
    let mut starts = vec![0u32; n + 1];
    pairs.iter().for_each(|p| starts[p[0] as usize + 1] += 1);
    (0..n).for_each(|v| starts[v + 1] += starts[v]);
    (starts, pairs.into_iter().map(|p| p[1]).collect())
}
