//! A surface under refinement that knows of every vertex and triangle where it lies on the surface.

use crate::mesh::Vec3;
use crate::mesh::split;
use crate::mesh::tri::{NONE, TriMesh, pair_halfedges};
use crate::numerics::stop;

/// On what a vertex lies: a vertex (twice the same number), an edge (its vertices, the lower first), or the inside of a
/// triangle ([`INSIDE`]).
type Carrier = [u32; 2];

const INSIDE: Carrier = [NONE; 2];

/// A refinement of a surface. The surface's vertices come first.
#[derive(Clone, Debug)]
pub(super) struct Refined {
    pub(super) mesh: TriMesh,
    /// Triangle of the surface in which each triangle lies.
    pub(super) source_of: Vec<u32>,
    carriers: Vec<Carrier>,
}

impl Refined {
    pub(super) fn of(surface: &TriMesh) -> Self {
        Self {
            source_of: (0..surface.triangles.len() as u32).collect(),
            carriers: (0..surface.positions.len() as u32).map(|v| [v, v]).collect(),
            mesh: surface.clone(),
        }
    }

    /// Splits every edge longer than `length_max` until none is, or there are `triangles_max` triangles.
    pub(super) fn split_long_edges(&mut self, length_max: f64, triangles_max: usize) {
        for _ in 0..ROUNDS_MAX {
            let at = |h: u32| {
                let (a, b) = (self.mesh.tail(h) as usize, self.mesh.head(h) as usize);
                ((self.mesh.positions[a] - self.mesh.positions[b]).norm() > length_max).then_some(0.5)
            };
            let splits: Vec<Option<f64>> = (0..self.mesh.twins.len() as u32).map(at).collect();
            let long = splits.iter().flatten().count();
            if long == 0 || self.mesh.triangles.len() + long > triangles_max {
                return;
            }
            *self = self.split(&splits);
        }
    }

    /// Splits edges: `splits` holds, for each halfedge, where between its tail (0) and its head (1); of the two
    /// halfedges of an edge the lower one counts.
    fn split(&self, splits: &[Option<f64>]) -> Self {
        let mut out = Builder::new(self);
        let on = out.split_edges(splits);
        for t in 0..self.mesh.triangles.len() as u32 {
            stop::pass(1);
            let pieces = pieces(&self.mesh, t, &on, &out.positions);
            out.extend(t, pieces);
        }
        out.finish()
    }

    /// The phantom flags: an edge on one of the surface's keeps that one's flag, others are phantom.
    pub(super) fn flag_phantoms(&mut self, surface: &TriMesh) {
        let flag = |h: u32| {
            let t = self.source_of[h as usize / 3];
            let ends = [self.mesh.tail(h), self.mesh.head(h)].map(|v| self.carriers[v as usize]);
            let edge = common(ends[0], ends[1]);
            let on = (3 * t..3 * t + 3).find(|&g| {
                let (a, b) = (surface.tail(g), surface.head(g));
                edge == [a.min(b), a.max(b)]
            });
            on.is_none_or(|g| surface.phantom[g as usize])
        };
        self.mesh.phantom = (0..self.mesh.twins.len() as u32).map(flag).collect();
    }
}

const ROUNDS_MAX: usize = 12;

/// On what the edge between two vertices lies.
fn common(a: Carrier, b: Carrier) -> Carrier {
    if a == INSIDE || b == INSIDE {
        return INSIDE;
    }
    let all = [a[0], a[1], b[0], b[1]];
    let (low, high) = (all.into_iter().min().unwrap_or(NONE), all.into_iter().max().unwrap_or(NONE));
    if low != high && all.into_iter().all(|v| v == low || v == high) { [low, high] } else { INSIDE }
}

/// Collects the pieces of a finer refinement.
pub(super) struct Builder<'a> {
    from: &'a Refined,
    pub(super) positions: Vec<Vec3>,
    carriers: Vec<Carrier>,
    triangles: Vec<[u32; 3]>,
    source_of: Vec<u32>,
    polygon_of: Vec<u32>,
}

impl<'a> Builder<'a> {
    pub(super) fn new(from: &'a Refined) -> Self {
        let (positions, carriers) = (from.mesh.positions.clone(), from.carriers.clone());
        Self { from, positions, carriers, triangles: Vec::new(), source_of: Vec::new(), polygon_of: Vec::new() }
    }

    /// New vertices on edges; the vertex on each halfedge ([`NONE`] where there is none). See [`Refined::split`].
    pub(super) fn split_edges(&mut self, splits: &[Option<f64>]) -> Vec<u32> {
        let mesh = &self.from.mesh;
        let mut on = vec![NONE; mesh.twins.len()];
        for h in 0..mesh.twins.len() as u32 {
            let g = mesh.twin(h);
            let (true, Some(s)) = (g == NONE || h < g, splits[h as usize]) else { continue };
            let (a, b) = (mesh.tail(h) as usize, mesh.head(h) as usize);
            on[h as usize] = self.positions.len() as u32;
            if g != NONE {
                on[g as usize] = on[h as usize];
            }
            self.positions.push(mesh.positions[a] * (1.0 - s) + mesh.positions[b] * s);
            self.carriers.push(common(self.carriers[a], self.carriers[b]));
        }
        on
    }

    /// A new vertex inside a triangle.
    pub(super) fn inside(&mut self, position: Vec3) -> u32 {
        self.positions.push(position);
        self.carriers.push(INSIDE);
        self.positions.len() as u32 - 1
    }

    /// Adds what triangle `t` is cut into.
    pub(super) fn extend(&mut self, t: u32, pieces: impl IntoIterator<Item = [u32; 3]>) {
        for piece in pieces {
            self.triangles.push(piece);
            self.source_of.push(self.from.source_of[t as usize]);
            self.polygon_of.push(self.from.mesh.polygon_of[t as usize]);
        }
    }

    pub(super) fn finish(self) -> Refined {
        // Splitting a manifold mesh conformingly leaves it manifold.
        let twins = pair_halfedges(&self.triangles).unwrap_or_else(|_| vec![NONE; 3 * self.triangles.len()]);
        let phantom = vec![false; twins.len()];
        let mesh = TriMesh {
            positions: self.positions,
            triangles: self.triangles,
            twins,
            phantom,
            polygon_of: self.polygon_of,
        };
        Refined { mesh, source_of: self.source_of, carriers: self.carriers }
    }
}

/// The triangles that replace triangle `t` when the halfedges with a vertex `on` them are split there; a quad is cut along
/// its shorter diagonal.
pub(super) fn pieces(mesh: &TriMesh, t: u32, on: &[u32], positions: &[Vec3]) -> Vec<[u32; 3]> {
    let length = |x: u32, y: u32| (positions[x as usize] - positions[y as usize]).norm_squared();
    split::pieces(mesh, t, on, |[a, b, _], [p, q]| length(a, p) <= length(b, q))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn refining_keeps_area_topology_and_phantoms() {
        let mut surface = grid(4, 3, true, false);
        // Each square is a polygon: its diagonal is phantom.
        for t in 0..surface.triangles.len() as u32 {
            surface.polygon_of[t as usize] = t / 2;
            let diagonal = if t % 2 == 0 { 3 * t + 2 } else { 3 * t };
            surface.phantom[diagonal as usize] = true;
        }
        let real = |m: &TriMesh| -> f64 {
            let length = |h: u32| (m.positions[m.head(h) as usize] - m.positions[m.tail(h) as usize]).norm();
            (0..m.twins.len() as u32).filter(|&h| !m.phantom[h as usize]).map(length).sum()
        };
        let mut refined = Refined::of(&surface);
        refined.split_long_edges(0.3, 10_000);
        refined.flag_phantoms(&surface);
        assert!(refined.mesh.triangles.len() > 4 * surface.triangles.len());
        assert!((refined.mesh.total_area() - surface.total_area()).abs() < 1e-12);
        assert_eq!(crate::topology::classify(&refined.mesh), crate::topology::classify(&surface));
        assert_eq!(refined.mesh.positions[..surface.positions.len()], surface.positions);
        assert!((real(&refined.mesh) - real(&surface)).abs() < 1e-9);
    }
}
