//! Triangles that are turned over in the domain are laid anew.
//!
//! No intrinsic triangle turns over as v is solved for. The surface's own triangles are others, and the share of area
//! below v is no linear function of v: drawn with straight edges, a few turn over, most of them where a scan is ragged.
//! Their vertices, and those some rings around, move to the weighted mean of their neighbours in (u, v),
//! w_ab = (tan α/2 + tan β/2)/|x_a − x_b| > 0, as often as it takes.
//! *Source:* Tutte, *How to draw a graph* (1963); Floater, *Mean value coordinates* (2003). *Ours, not the paper's.*

use super::{corner_uvs, signed_area};
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::numerics::stop;
use crate::topology;

/// Rings about turned triangles that are laid anew with them, each number tried on what the one before left.
const RINGS: [usize; 4] = [1, 2, 4, 8];
/// Sweeps over a region at most, and between two looks at it.
const SWEEPS_MAX: usize = 240;
const SWEEPS_BETWEEN: usize = 6;
/// Beyond this share of turned triangles something else is wrong, and nothing is moved.
const TURNED_SHARE_MAX: f64 = 0.1;

/// Holds what stays of a chart while its vertices move.
#[derive(Clone, Copy, Debug)]
pub struct ChartStructure<'a> {
    /// The mesh.
    pub mesh: &'a TriMesh,
    /// Along halfedge a → b, u grows by u_b − u_a − jump.
    pub jumps: &'a [i32],
    /// The poles' vertices.
    pub poles: &'a [u32],
}

/// u and v of each vertex with as few triangles turned over as can be had. Boundary, poles and the vertices next to them
/// stay.
pub fn relaxed(plane: &ChartStructure, u: &[f64], v: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut at = Places { u: u.to_vec(), v: v.to_vec() };
    let all = 0..plane.mesh.triangles.len() as u32;
    let mut turned: Vec<u32> = all.filter(|&t| plane.is_turned(t, &at)).collect();
    if turned.len() as f64 <= TURNED_SHARE_MAX * plane.mesh.triangles.len() as f64 {
        let fixed = plane.fixed();
        for rings in RINGS {
            if turned.is_empty() {
                break;
            }
            for region in regions(plane.mesh, &turned, rings) {
                region.lay(plane, &fixed, &mut at);
            }
            turned.retain(|&t| plane.is_turned(t, &at));
        }
    }
    (at.u, at.v)
}

/// Where the vertices are.
struct Places {
    u: Vec<f64>,
    v: Vec<f64>,
}

impl ChartStructure<'_> {
    fn is_turned(&self, t: u32, at: &Places) -> bool {
        let jumps = &self.jumps[3 * t as usize..3 * t as usize + 3];
        let corners = self.mesh.triangles[t as usize];
        signed_area(&corner_uvs(corners, &at.u, jumps, &at.v, self.poles)) < 0.0
    }

    /// Vertices that stay.
    fn fixed(&self) -> Vec<bool> {
        let mut fixed = self.mesh.boundary_vertices();
        for corners in self.mesh.triangles.iter().filter(|c| c.iter().any(|x| self.poles.contains(x))) {
            corners.iter().for_each(|&x| fixed[x as usize] = true);
        }
        fixed
    }
}

/// A connected part of the mesh about turned triangles, in order.
struct TurnedRegion {
    triangles: Vec<u32>,
}

fn regions(mesh: &TriMesh, turned: &[u32], rings: usize) -> Vec<TurnedRegion> {
    let mut inside = vec![false; mesh.triangles.len()];
    turned.iter().for_each(|&t| inside[t as usize] = true);
    topology::widen(mesh, &mut inside, rings);
    let sets = topology::connected(mesh, &inside).into_iter().filter(|set| inside[set[0] as usize]);
    sets.map(|triangles| TurnedRegion { triangles }).collect()
}

impl TurnedRegion {
    /// Lays the region anew, unless it has no fewer turned triangles by it.
    fn lay(&self, plane: &ChartStructure, fixed: &[bool], at: &mut Places) {
        let turned = |at: &Places| self.triangles.iter().filter(|&&t| plane.is_turned(t, at)).count();
        let movable = self.neighbours(plane, fixed);
        let mut best = turned(at);
        let places = |at: &Places| -> Vec<[f64; 2]> {
            movable.iter().map(|(v, _)| [at.u[*v as usize], at.v[*v as usize]]).collect()
        };
        let mut kept = places(at);
        for _ in 0..SWEEPS_MAX / SWEEPS_BETWEEN {
            stop::pass(SWEEPS_BETWEEN * movable.len());
            for (x, around) in (0..SWEEPS_BETWEEN).flat_map(|_| &movable) {
                let all: f64 = around.iter().map(|n| n.weight).sum();
                let mean = |of: &dyn Fn(&Neighbour) -> f64| around.iter().map(|n| n.weight * of(n)).sum::<f64>() / all;
                let (u, v) = (mean(&|n| at.u[n.vertex as usize] + n.jump), mean(&|n| at.v[n.vertex as usize]));
                (at.u[*x as usize], at.v[*x as usize]) = (u, v);
            }
            let now = turned(at);
            if now < best {
                best = now;
                kept = places(at);
            }
            if best == 0 {
                break;
            }
        }
        for ((x, _), [u, v]) in movable.iter().zip(kept) {
            (at.u[*x as usize], at.v[*x as usize]) = (u, v);
        }
    }

    /// The vertices that may move, in order, each with its neighbours. All their triangles belong to the region.
    fn neighbours(&self, plane: &ChartStructure, fixed: &[bool]) -> Vec<(u32, Vec<Neighbour>)> {
        let mesh = plane.mesh;
        let own = &self.triangles;
        let is_own = |h: u32| own.binary_search(&(h / 3)).is_ok();
        let mut vertices: Vec<u32> = own.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let mut around: Vec<(u32, Vec<Neighbour>)> = vertices.iter().map(|&v| (v, Vec::new())).collect();
        let mut stays: Vec<bool> = vertices.iter().map(|&v| fixed[v as usize]).collect();
        for &t in own {
            let corners = mesh.triangles[t as usize];
            for k in 0..3u32 {
                let h = 3 * t + k;
                let (a, b, c) = (corners[k as usize], mesh.head(h), corners[(k as usize + 2) % 3]);
                let Ok(i) = vertices.binary_search(&a) else { continue };
                // The edges a → b and c → a of this triangle; what is across both must be of the region too.
                let into = 3 * t + (k + 2) % 3;
                stays[i] |= !is_own(mesh.twin(h)) || !is_own(mesh.twin(into));
                let [x, p, q] = [a, b, c].map(|v| mesh.positions[v as usize]);
                let tangent = half_tangent(p - x, q - x);
                let jump = |h: u32| f64::from(plane.jumps[h as usize]);
                for (vertex, place, jump) in [(b, p, -jump(h)), (c, q, jump(into))] {
                    let weight = tangent / (place - x).norm().max(f64::MIN_POSITIVE);
                    around[i].1.push(Neighbour { vertex, jump, weight });
                }
            }
        }
        around.into_iter().zip(stays).filter(|(_, stays)| !stays).map(|(movable, _)| movable).collect()
    }
}

struct Neighbour {
    vertex: u32,
    /// What its u is raised by, beside the vertex's own.
    jump: f64,
    weight: f64,
}

/// tan(α/2) of the angle between two directions; in bounds, so that slivers do not rule.
pub fn half_tangent(p: Vec3, q: Vec3) -> f64 {
    let (dot, cross) = (p.dot(&q), p.cross(&q).norm());
    (cross / (dot + dot.hypot(cross)).max(f64::MIN_POSITIVE)).clamp(0.01, 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_vertex_drawn_over_its_neighbours_comes_back_also_across_the_seam() {
        let mesh = grid(16, 12, true, false);
        // Round the ring in u, up it in v, with u that jumps where it closes.
        let angle = |v: usize| (mesh.positions[v].y.atan2(mesh.positions[v].x) / std::f64::consts::TAU).rem_euclid(1.0);
        let u: Vec<f64> = (0..mesh.positions.len()).map(angle).collect();
        let jumps: Vec<i32> = (0..mesh.twins.len() as u32)
            .map(|h| (u[mesh.head(h) as usize] - u[mesh.tail(h) as usize]).round() as i32)
            .collect();
        let (low, high) = mesh.positions.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.z), h.max(p.z)));
        let v: Vec<f64> = mesh.positions.iter().map(|p| (p.z - low) / (high - low)).collect();
        let plane = ChartStructure { mesh: &mesh, jumps: &jumps, poles: &[] };
        let count = |u: &[f64], v: &[f64]| {
            let at = Places { u: u.to_vec(), v: v.to_vec() };
            let turned = (0..mesh.triangles.len() as u32).filter(|&t| plane.is_turned(t, &at)).count();
            turned.min(mesh.triangles.len() - turned)
        };
        assert_eq!(count(&u, &v), 0);
        for dragged in (0..mesh.positions.len()).filter(|&x| v[x] > 0.3 && v[x] < 0.7).step_by(5) {
            let mut moved = u.clone();
            moved[dragged] += 0.13;
            assert!(count(&moved, &v) > 0);
            let (u, v) = relaxed(&plane, &moved, &v);
            assert_eq!(count(&u, &v), 0, "vertex {dragged}");
        }
    }
}
