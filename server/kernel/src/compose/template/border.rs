//! Where the points of a segment's boundary lie in its chart.
//!
//! *Ours, not the paper's.*

use crate::compose::layout::Curve;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{NONE, TriMesh, nearest_share, next};
use crate::unfold::Chart;

/// Lengths that differ by less than this share of a loop are the same.
const SAME: f64 = 1e-6;

/// The boundary of a chart's surface.
#[derive(Clone, Debug)]
pub struct Border {
    bvh: Bvh,
    /// For each edge its ends, and their u and v.
    edges: Vec<([Vec3; 2], [[f64; 2]; 2])>,
    /// Its loops, and the u and v at the ends of each of their edges.
    loops: Vec<(Curve, Vec<[[f64; 2]; 2]>)>,
}

impl Border {
    /// Of a chart.
    pub fn new(chart: &Chart) -> Self {
        let mesh = &*chart.mesh;
        let all: Vec<u32> = (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) == NONE).collect();
        let triangles = all.iter().map(|&h| [mesh.tail(h), mesh.head(h), mesh.head(h)]).collect();
        let bvh = Bvh::new(&TriMesh { positions: mesh.positions.clone(), triangles, ..TriMesh::default() });
        let uv = |h: u32| chart.corners[h as usize / 3][h as usize % 3];
        let uvs = |h: u32| [uv(h), uv(next(h))];
        let ends = |h: u32| [mesh.tail(h), mesh.head(h)].map(|v| mesh.positions[v as usize]);
        let curve = |ring: Vec<u32>| {
            let mut along = vec![0.0];
            for &h in &ring {
                let [p, q] = ends(h);
                along.push(along[along.len() - 1] + (q - p).norm());
            }
            let points = ring.iter().map(|&h| ends(h)[0]).collect();
            (Curve { points, along, runs: Vec::new(), smoothed: Vec::new() }, ring.into_iter().map(uvs).collect())
        };
        let loops = mesh.boundary_loops().into_iter().map(curve).collect();
        Self { bvh, edges: all.iter().map(|&h| (ends(h), uvs(h))).collect(), loops }
    }

    /// u and v of the boundary's point nearest to one given; `None` where there is no boundary.
    fn nearest(&self, p: Vec3) -> Option<[f64; 2]> {
        let (ends, uv) = self.edges.get(self.bvh.closest(p).triangle as usize)?;
        Some(between(*uv, nearest_share(*ends, p)))
    }

    /// u and v at places on a curve, told by lengths along it: where a boundary nearly touches itself, points alone could
    /// not tell on which side they lie. `None` if the curve is no loop of the chart.
    fn along(&self, curve: &Curve, at: &[f64]) -> Option<Vec<[f64; 2]>> {
        let (length, start) = (curve.length(), *curve.points.first()?);
        let is_same = |p: Vec3, q: Vec3| (p - q).norm() <= SAME * length;
        let found = self.loops.iter().filter(|(ring, _)| (ring.length() - length).abs() <= SAME * length);
        let mut offsets = found.flat_map(|(ring, uv)| {
            let starts = (0..ring.points.len()).filter(move |&k| is_same(ring.points[k], start));
            starts.map(move |k| (ring, uv, ring.along[k]))
        });
        let (ring, uv, offset) =
            offsets.find(|(ring, _, offset)| at.iter().all(|s| is_same(ring.point(offset + s), curve.point(*s))))?;
        let place = |s: &f64| {
            let (k, t) = ring.place(offset + s)?;
            Some(between(*uv.get(k)?, t))
        };
        at.iter().map(place).collect()
    }

    /// u at places on a curve, in order and told by lengths along it, unwound so that they increase over less than a period
    /// (decrease, where v = 1: given with its sign turned), and whether it is that at v = 1.
    pub fn unwound(&self, curve: &Curve, at: &[f64]) -> Option<(Vec<f64>, End)> {
        let by_points = || at.iter().map(|&s| self.nearest(curve.point(s))).collect::<Option<Vec<_>>>();
        let uv = self.along(curve, at).or_else(by_points)?;
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

fn between([a, b]: [[f64; 2]; 2], t: f64) -> [f64; 2] {
    [0, 1].map(|k| a[k] + (b[k] - a[k]) * t)
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
    use crate::compose::layout::layout;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn both_loops_of_an_annulus_go_around_once_in_order() {
        let mesh = grid(24, 8, true, false);
        let chart = unfold(&whole(&mesh).expect("an annulus"), &UnfoldOptions::default()).expect("solvable");
        let border = Border::new(&chart);
        let mut ends = Vec::new();
        for curve in &layout(&mesh, &vec![0; mesh.triangles.len()], 1).curves[0] {
            let at = &curve.along[..curve.points.len()];
            let (u, end) = border.unwound(curve, at).expect("a boundary");
            let (by_points, _) = Border { loops: Vec::new(), ..border.clone() }.unwound(curve, at).expect("a boundary");
            let is_same = |x: f64, y: f64| (x - y - (x - y).round()).abs() < 1e-9;
            assert!(u.iter().zip(&by_points).all(|(x, y)| is_same(*x, *y)));
            assert!(u.windows(2).all(|w| w[0] < w[1] && w[1] - w[0] < 0.2), "{u:?}");
            assert!(u[u.len() - 1] - u[0] > 0.9);
            ends.push(end);
        }
        assert!(ends.contains(&End::Bottom) && ends.contains(&End::Top));
    }
    #[test]
    fn the_two_sides_of_a_slit_are_told_apart() {
        // A sheet slit along x from the left to its middle: the sides of the slit lie on each other.
        let mut mesh = grid(16, 16, false, false);
        let at = |i: u32, j: u32| j * 17 + i;
        let copies: Vec<u32> = (0..8).map(|i| at(i, 8)).collect();
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(copies.iter().map(|&v| mesh.positions[v as usize]).collect::<Vec<Vec3>>());
        for t in &mut mesh.triangles {
            if t.iter().all(|&v| mesh.positions[v as usize].y > 0.5 - 1e-9) {
                *t = t.map(|v| copies.iter().position(|&c| c == v).map_or(v, |k| first + k as u32));
            }
        }
        let mesh = TriMesh::from_triangles(mesh.positions, mesh.triangles).expect("a slit sheet");
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let found = layout(&mesh, &vec![0; mesh.triangles.len()], 1);
        let curve = &found.curves[0][0];
        let at = &curve.along[..curve.points.len()];
        let (u, _) = Border::new(&chart).unwound(curve, at).expect("a boundary");
        assert!(u.windows(2).all(|w| w[1] - w[0] > 1e-7 && w[1] - w[0] < 0.2), "{u:?}");
    }
}
