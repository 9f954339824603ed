//! Where the points of a segment's boundary lie in its chart.
//!
//! *Ours, not the paper's.*

use crate::compose::layout::Curve;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{TriMesh, nearest_share, next};
use crate::unfold::Chart;

/// Lengths that differ by less than this share of a loop are the same.
const SAME: f64 = 1e-6;

/// An edge of the boundary.
#[derive(Clone, Copy, Debug)]
struct Edge {
    ends: [Vec3; 2],
    /// u and v at its ends.
    uv: [[f64; 2]; 2],
    /// Lengths along its loop at its ends.
    along: [f64; 2],
}

impl Edge {
    fn at(&self, share: f64) -> BorderPoint {
        let [u, v] = between(self.uv, share);
        BorderPoint { u, v, along: self.along[0] + share * (self.along[1] - self.along[0]) }
    }
}

/// A point on the boundary.
#[derive(Clone, Copy, Debug)]
struct BorderPoint {
    u: f64,
    v: f64,
    /// Length along the loop.
    along: f64,
}

/// The boundary of a chart's surface.
#[derive(Clone, Debug)]
pub struct Border {
    bvh: Bvh,
    /// Its edges, loop by loop.
    edges: Vec<Edge>,
    /// Its loops, and the first edge of each.
    loops: Vec<(Curve, usize)>,
}

/// Places on a loop of a chart, in order.
#[derive(Clone, Debug)]
pub struct Unwound {
    /// At which end the loop lies.
    pub end: End,
    /// u of each, increasing over less than a period; where v = 1 it decreases, and is given with its sign turned.
    pub u: Vec<f64>,
    /// The length of each along the chart's boundary loop, within one turn: far out on an elongated surface u is crowded
    /// beyond what can be told apart, lengths are not.
    pub along: Vec<f64>,
}

impl Border {
    /// Of a chart.
    pub fn new(chart: &Chart) -> Self {
        let mesh = &*chart.mesh;
        let uv = |h: u32| chart.corners[h as usize / 3][h as usize % 3];
        let (mut edges, mut loops): (Vec<Edge>, Vec<(Curve, usize)>) = Default::default();
        let mut triangles = Vec::new();
        for ring in mesh.boundary_loops() {
            let (first, mut along) = (edges.len(), vec![0.0]);
            for &h in &ring {
                let ends = [mesh.tail(h), mesh.head(h)].map(|v| mesh.positions[v as usize]);
                let start = along[along.len() - 1];
                along.push(start + (ends[1] - ends[0]).norm());
                edges.push(Edge { ends, uv: [uv(h), uv(next(h))], along: [start, along[along.len() - 1]] });
                triangles.push([mesh.tail(h), mesh.head(h), mesh.head(h)]);
            }
            let points = ring.iter().map(|&h| mesh.positions[mesh.tail(h) as usize]).collect();
            loops.push((Curve { points, along, runs: Vec::new(), smoothed: Vec::new() }, first));
        }
        let bvh = Bvh::new(&TriMesh { positions: mesh.positions.clone(), triangles, ..TriMesh::default() });
        Self { bvh, edges, loops }
    }

    /// Its loop; `None` where it has none, or several.
    pub fn only_loop(&self) -> Option<&Curve> {
        match &self.loops[..] {
            [(curve, _)] => Some(curve),
            _ => None,
        }
    }

    /// The boundary's point nearest to one given; `None` where there is no boundary.
    fn nearest(&self, p: Vec3) -> Option<BorderPoint> {
        let edge = self.edges.get(self.bvh.closest(p).triangle as usize)?;
        Some(edge.at(nearest_share(edge.ends, p)))
    }

    /// Places on a curve, told by lengths along it: where a boundary nearly touches itself, points alone could not tell on
    /// which side they lie. `None` if the curve is no loop of the chart.
    fn along(&self, curve: &Curve, at: &[f64]) -> Option<Vec<BorderPoint>> {
        let (length, start) = (curve.length(), *curve.points.first()?);
        let is_same = |p: Vec3, q: Vec3| (p - q).norm() <= SAME * length;
        let found = self.loops.iter().filter(|(ring, _)| (ring.length() - length).abs() <= SAME * length);
        let mut offsets = found.flat_map(|(ring, first)| {
            let starts = (0..ring.points.len()).filter(move |&k| is_same(ring.points[k], start));
            starts.map(move |k| (ring, first, ring.along[k]))
        });
        let (ring, first, offset) =
            offsets.find(|(ring, _, offset)| at.iter().all(|s| is_same(ring.point(offset + s), curve.point(*s))))?;
        let place = |s: &f64| {
            let (k, t) = ring.place(offset + s)?;
            Some(self.edges.get(first + k)?.at(t))
        };
        at.iter().map(place).collect()
    }

    /// Places on a curve, in order and told by lengths along it.
    pub fn unwound(&self, curve: &Curve, at: &[f64]) -> Option<Unwound> {
        let by_points = || at.iter().map(|&s| self.nearest(curve.point(s))).collect::<Option<Vec<_>>>();
        let places = self.along(curve, at).or_else(by_points)?;
        let mean = places.iter().map(|place| place.v).sum::<f64>() / places.len().max(1) as f64;
        let (end, sign) = if mean > 0.5 { (End::Top, -1.0) } else { (End::Bottom, 1.0) };
        let u = increasing(places.iter().map(|place| sign * place.u), 1.0);
        let along = increasing(places.iter().map(|place| place.along), curve.length());
        (!places.is_empty()).then_some(Unwound { end, u, along })
    }
}

/// Values that go around once, each that of a period, so that they increase over less than one.
fn increasing(values: impl ExactSizeIterator<Item = f64>, period: f64) -> Vec<f64> {
    let n = values.len();
    let least = 1e-6 / n as f64 * period;
    let mut all: Vec<f64> = Vec::with_capacity(n);
    for x in values {
        let next = match (all.first(), all.last()) {
            (Some(first), Some(before)) => {
                let step = (x - before).rem_euclid(period);
                // A step back by rounding is none.
                let step = if step > 0.9 * period { least } else { step.max(least) };
                (before + step).min(first + period - least * (n - all.len()) as f64)
            }
            _ => x,
        };
        all.push(next);
    }
    all
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
            let Unwound { end, u, along } = border.unwound(curve, at).expect("a boundary");
            let by_points = Border { loops: Vec::new(), ..border.clone() }.unwound(curve, at).expect("a boundary");
            let is_same = |x: f64, y: f64| (x - y - (x - y).round()).abs() < 1e-9;
            assert!(u.iter().zip(&by_points.u).all(|(x, y)| is_same(*x, *y)));
            assert!(along.iter().zip(&by_points.along).all(|(x, y)| (x - y).abs() < 1e-9));
            assert!((0..at.len()).all(|k| (along[k] - along[0] - (at[k] - at[0])).abs() < 1e-9), "{along:?}");
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
        let u = Border::new(&chart).unwound(curve, at).expect("a boundary").u;
        assert!(u.windows(2).all(|w| w[1] - w[0] > 1e-7 && w[1] - w[0] < 0.2), "{u:?}");
    }
}
