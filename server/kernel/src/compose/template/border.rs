//! Where the points of a segment's boundary lie in its chart.
//!
//! *Ours, not the paper's.*

use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh, next};
use crate::unfold::Chart;

/// The boundary of a chart's surface.
#[derive(Clone, Debug)]
pub struct Border {
    bvh: Bvh,
    /// For each edge its ends, and their u and v.
    edges: Vec<([Vec3; 2], [[f64; 2]; 2])>,
}

impl Border {
    /// Of a chart.
    pub fn new(chart: &Chart) -> Self {
        let mesh = &*chart.mesh;
        let all: Vec<u32> = (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE).collect();
        let triangles = all.iter().map(|&h| [mesh.tail(h), mesh.head(h), mesh.head(h)]).collect();
        let bvh = Bvh::new(&TriMesh { positions: mesh.positions.clone(), triangles, ..TriMesh::default() });
        let uv = |h: u32| chart.corners[h as usize / 3][h as usize % 3];
        let ends = |h: u32| [mesh.tail(h), mesh.head(h)].map(|v| mesh.positions[v as usize]);
        Self { bvh, edges: all.iter().map(|&h| (ends(h), [uv(h), uv(next(h))])).collect() }
    }

    /// u and v of the boundary's point nearest to one given; `None` where there is no boundary.
    pub fn uv(&self, p: Vec3) -> Option<[f64; 2]> {
        let (ends, uv) = self.edges.get(self.bvh.closest(p).triangle as usize)?;
        let e = ends[1] - ends[0];
        let t = if e.norm_squared() > 0.0 { ((p - ends[0]).dot(&e) / e.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
        Some([0, 1].map(|k| uv[0][k] + (uv[1][k] - uv[0][k]) * t))
    }

    /// u of points in order around a boundary, unwound so that they increase over less than a period (decrease, where
    /// v = 1: given with its sign turned), and whether it is that at v = 1.
    pub fn unwound(&self, points: &[Vec3]) -> Option<(Vec<f64>, End)> {
        let uv: Vec<[f64; 2]> = points.iter().map(|&p| self.uv(p)).collect::<Option<_>>()?;
        let mean = uv.iter().map(|x| x[1]).sum::<f64>() / uv.len().max(1) as f64;
        let (end, sign) = if mean > 0.5 { (End::Top, -1.0) } else { (End::Bottom, 1.0) };
        let n = uv.len();
        let first = sign * uv.first()?[0];
        let least = 1e-6 / n as f64;
        let mut all = vec![first];
        for x in &uv[1..] {
            let before = all[all.len() - 1];
            let step = (sign * x[0] - before).rem_euclid(1.0);
            // A step back by rounding is none.
            let step = if step > 0.9 { least } else { step.max(least) };
            all.push((before + step).min(first + 1.0 - least * (n - all.len()) as f64));
        }
        Some((all, end))
    }
}

/// An end of a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// v = 0.
    Bottom,
    /// v = 1.
    Top,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn both_loops_of_an_annulus_go_around_once_in_order() {
        let mesh = grid(24, 8, true, false);
        let chart = unfold(&whole(&mesh).expect("an annulus"), &UnfoldOptions::default()).expect("solvable");
        let border = Border::new(&chart);
        let mut ends = Vec::new();
        for ring in mesh.boundary_loops() {
            let points: Vec<Vec3> = ring.iter().map(|&h| mesh.positions[mesh.tail(h) as usize]).collect();
            let (u, end) = border.unwound(&points).expect("a boundary");
            assert!(u.windows(2).all(|w| w[0] < w[1] && w[1] - w[0] < 0.2), "{u:?}");
            assert!(u[u.len() - 1] - u[0] > 0.9);
            ends.push(end);
        }
        assert!(ends.contains(&End::Bottom) && ends.contains(&End::Top));
    }
}
