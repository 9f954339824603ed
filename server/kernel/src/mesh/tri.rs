//! A triangle mesh with phantom edges; connectivity stands apart from positions.
//!
//! Halfedge `h = 3t + k` runs from corner `k` of triangle `t` to corner `k + 1 (mod 3)`. An edge is *phantom* when
//! tessellation inserted it into a polygon. *Source:* paper §6.

use super::Vec3;
use crate::numerics::stop;

/// "No element" in any index array of the kernel.
pub const NONE: u32 = u32::MAX;

/// An oriented manifold triangle mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Triangles as vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Opposite halfedge of each halfedge; [`NONE`] on the boundary. Length 3 × triangles.
    pub twins: Vec<u32>,
    /// Whether the halfedge was inserted by tessellation. Length 3 × triangles.
    pub phantom: Vec<bool>,
    /// Index of the polygon that each triangle was cut from.
    pub polygon_of: Vec<u32>,
}

/// An edge with more than two faces, or two faces that run along it the same way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadEdge {
    /// Its vertices.
    pub vertices: [u32; 2],
    /// Halfedges found on it.
    pub halfedges: u32,
}

/// The next halfedge in the same triangle.
#[inline]
pub fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The previous halfedge in the same triangle.
#[inline]
pub fn prev(h: u32) -> u32 {
    if h.is_multiple_of(3) { h + 2 } else { h - 1 }
}

/// The share of the way from `a` to `b`, 0 to 1, at which it is nearest to a point; 0 where they are one.
pub fn nearest_share([a, b]: [Vec3; 2], to: Vec3) -> f64 {
    ((to - a).dot(&(b - a)) / (b - a).norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

/// The area of the triangle with these corners.
pub fn area_between([a, b, c]: [Vec3; 3]) -> f64 {
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// The normals of a quad's halves on both sides of its diagonal from corner 1 to corner 3, each twice as long as its area.
pub fn halves_of([a, b, c, d]: [Vec3; 4]) -> [Vec3; 2] {
    [(b - a).cross(&(d - a)), (d - c).cross(&(b - c))]
}

/// Length of the mean normal from which on a surface is flat: its normals then differ by 2.6° from their mean. Of 162 scans and
/// examples two are flat and have 1.0000, the next has .80 (tests/records/one-way-2026-11-27.md).
const FLAT_FROM: f64 = 0.999;

/// Tells whether a surface is flat by normals that are as long as the areas that they stand for; one without area is not.
pub fn is_flat(normals: impl Iterator<Item = Vec3>) -> bool {
    let (sum, area) = normals.fold((Vec3::zeros(), 0.0), |(sum, area), n| (sum + n, area + n.norm()));
    area > 0.0 && sum.norm() >= FLAT_FROM * area
}

/// Pairs the halfedges of oriented triangles by sorting; [`NONE`] on the boundary.
///
/// # Errors
/// The first edge (by vertex number) that is not shared by at most two opposite halfedges.
pub fn pair_halfedges(triangles: &[[u32; 3]]) -> Result<Vec<u32>, BadEdge> {
    let mut keyed: Vec<(u64, u32)> = Vec::with_capacity(3 * triangles.len());
    for (t, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
            keyed.push((key, (3 * t + k) as u32));
        }
    }
    stop::pass(keyed.len());
    keyed.sort_unstable();
    stop::pass(keyed.len());
    let mut twins = vec![NONE; 3 * triangles.len()];
    for run in keyed.chunk_by(|x, y| x.0 == y.0) {
        let bad = BadEdge { vertices: [(run[0].0 >> 32) as u32, run[0].0 as u32], halfedges: run.len() as u32 };
        match run {
            [_] => {}
            [(_, g), (_, h)] => {
                let tail = |h: u32| triangles[h as usize / 3][h as usize % 3];
                if tail(*g) == tail(*h) {
                    return Err(bad);
                }
                twins[*g as usize] = *h;
                twins[*h as usize] = *g;
            }
            _ => return Err(bad),
        }
    }
    Ok(twins)
}

impl TriMesh {
    /// A mesh of plain triangles: no phantom edge, each triangle its own polygon.
    ///
    /// # Errors
    /// See [`pair_halfedges`].
    pub fn from_triangles(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, BadEdge> {
        let twins = pair_halfedges(&triangles)?;
        let (phantom, polygon_of) = (vec![false; twins.len()], (0..triangles.len() as u32).collect());
        Ok(Self { positions, triangles, twins, phantom, polygon_of })
    }

    /// Vertex at which halfedge `h` starts.
    #[inline]
    pub fn tail(&self, h: u32) -> u32 {
        self.triangles[h as usize / 3][h as usize % 3]
    }

    /// Vertex at which halfedge `h` ends.
    #[inline]
    pub fn head(&self, h: u32) -> u32 {
        self.tail(next(h))
    }

    /// Opposite halfedge of `h`, or [`NONE`].
    #[inline]
    pub fn twin(&self, h: u32) -> u32 {
        self.twins[h as usize]
    }

    /// The share of halfedge `h`, 0 at its tail and 1 at its head, at which it is nearest to a point.
    pub fn nearest_share(&self, h: u32, to: Vec3) -> f64 {
        let [a, b] = [self.tail(h), self.head(h)].map(|v| self.positions[v as usize]);
        nearest_share([a, b], to)
    }

    /// The point at a share of halfedge `h`.
    pub fn point_on(&self, h: u32, share: f64) -> Vec3 {
        self.positions[self.tail(h) as usize].lerp(&self.positions[self.head(h) as usize], share)
    }

    /// Normal of triangle `t`, as long as its area.
    pub fn area_vector(&self, t: usize) -> Vec3 {
        let [a, b, c] = self.triangles[t].map(|v| self.positions[v as usize]);
        0.5 * (b - a).cross(&(c - a))
    }

    /// The sum of [`Self::area_vector`] over the triangles about each vertex: its normal, not of unit length.
    pub fn vertex_area_vectors(&self) -> Vec<Vec3> {
        let mut sums = vec![Vec3::zeros(); self.positions.len()];
        for (t, corners) in self.triangles.iter().enumerate() {
            let normal = self.area_vector(t);
            corners.iter().for_each(|&v| sums[v as usize] += normal);
        }
        sums
    }

    /// The median length of some halfedges; 0 where there is none.
    pub fn median_length(&self, halfedges: impl Iterator<Item = u32>) -> f64 {
        let length = |h: u32| (self.positions[self.head(h) as usize] - self.positions[self.tail(h) as usize]).norm();
        let mut lengths: Vec<f64> = halfedges.map(length).collect();
        let middle = lengths.len() / 2;
        if lengths.is_empty() { 0.0 } else { *lengths.select_nth_unstable_by(middle, f64::total_cmp).1 }
    }

    /// Area of triangle `t`.
    pub fn area(&self, t: usize) -> f64 {
        self.area_vector(t).norm()
    }

    /// Area of the whole surface, summed in triangle order.
    pub fn total_area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| self.area(t)).sum()
    }

    /// Tells whether it lies in a plane but for a few degrees: then nothing stands out from it.
    pub fn is_flat(&self) -> bool {
        is_flat((0..self.triangles.len()).map(|t| self.area_vector(t)))
    }

    /// Whether each vertex lies on the boundary.
    pub fn boundary_vertices(&self) -> Vec<bool> {
        let mut on = vec![false; self.positions.len()];
        for h in 0..self.twins.len() as u32 {
            if self.twin(h) == NONE {
                on[self.tail(h) as usize] = true;
                on[self.head(h) as usize] = true;
            }
        }
        on
    }

    /// The boundary loops, each as its halfedges in order (the surface on the left). Loops start at their lowest
    /// halfedge and are sorted by it.
    pub fn boundary_loops(&self) -> Vec<Vec<u32>> {
        let mut seen = vec![false; self.twins.len()];
        let mut loops = Vec::new();
        for start in 0..self.twins.len() as u32 {
            if self.twin(start) != NONE || seen[start as usize] {
                continue;
            }
            let mut ring = Vec::new();
            let mut h = start;
            while !seen[h as usize] {
                seen[h as usize] = true;
                ring.push(h);
                h = self.next_on_boundary(h);
            }
            loops.push(ring);
        }
        loops
    }

    /// The boundary halfedge that starts where boundary halfedge `h` ends.
    fn next_on_boundary(&self, h: u32) -> u32 {
        let mut g = next(h);
        while self.twin(g) != NONE {
            g = next(self.twin(g));
        }
        g
    }

    /// The vertices that share an edge with each vertex.
    pub fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut of: Vec<Vec<u32>> = vec![Vec::new(); self.positions.len()];
        for h in 0..self.twins.len() as u32 {
            of[self.tail(h) as usize].push(self.head(h));
            if self.twin(h) == NONE {
                of[self.head(h) as usize].push(self.tail(h));
            }
        }
        of
    }

    /// One outgoing halfedge a vertex ([`NONE`] for isolated vertices); on the boundary, the boundary halfedge, from
    /// which turning counter-clockwise (`prev`, then `twin`) visits every face of the vertex.
    pub fn outgoing(&self) -> Vec<u32> {
        let mut out = vec![NONE; self.positions.len()];
        for h in 0..self.twins.len() as u32 {
            let v = self.tail(h) as usize;
            if out[v] == NONE || self.twin(h) == NONE {
                out[v] = h;
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fan(n: u32) -> TriMesh {
        let mut positions = vec![Vec3::zeros()];
        positions.extend((0..n).map(|k| {
            let a = std::f64::consts::TAU * f64::from(k) / f64::from(n);
            Vec3::new(a.cos(), a.sin(), 0.0)
        }));
        let triangles = (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect();
        TriMesh::from_triangles(positions, triangles).expect("a fan is manifold")
    }

    #[test]
    fn twins_are_an_involution_and_run_the_other_way() {
        let mesh = fan(7);
        for h in 0..mesh.twins.len() as u32 {
            let g = mesh.twin(h);
            if g != NONE {
                assert_eq!(mesh.twin(g), h);
                assert_eq!((mesh.tail(g), mesh.head(g)), (mesh.head(h), mesh.tail(h)));
            }
        }
    }

    #[test]
    fn a_fan_has_one_loop_that_runs_around_it() {
        let loops = fan(7).boundary_loops();
        assert_eq!(loops.len(), 1);
        assert_eq!(loops[0].len(), 7);
    }

    #[test]
    fn an_edge_with_three_faces_is_named() {
        let error = pair_halfedges(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]).expect_err("three faces on 0–1");
        assert_eq!(error, BadEdge { vertices: [0, 1], halfedges: 3 });
    }

    #[test]
    fn two_faces_along_an_edge_the_same_way_are_refused() {
        assert!(pair_halfedges(&[[0, 1, 2], [0, 1, 3]]).is_err());
    }
}
