//! Walking along a surface: straight on, over edges, until the length is spent or the boundary reached.
//!
//! A straight line on a triangle mesh is one that stays straight when the triangles it crosses are laid flat
//! (discrete geodesic; Polthier and Schmies 1998). *Ours:* what the map needs to move a vertex without leaving the
//! surface or jumping to a sheet that is near in space only.

use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};

/// Triangles crossed at most.
const CROSSINGS_MAX: usize = 256;
/// Barycentric coordinates below this lie on the edge.
const ON_EDGE: f64 = 1e-12;

/// Walks from `place` along the tangential part of `step`, by that part's length. Ends on the boundary if it gets
/// there. Walks through a vertex leave it by the triangle next to it.
pub fn walk(mesh: &TriMesh, place: Location, step: Vec3) -> Location {
    let mut at = place;
    let Some(mut frame) = Frame::new(mesh, at.triangle) else { return place };
    let mut direction = frame.flat(step);
    let mut entered = NONE;
    for _ in 0..CROSSINGS_MAX {
        let rates = frame.rates(direction);
        // How far along `direction` each edge (opposite to corner k) is.
        let reach = |k: usize| match rates[k] < 0.0 && 3 * at.triangle + (k as u32 + 1) % 3 != entered {
            true => at.barycentric[k].max(0.0) / -rates[k],
            false => f64::INFINITY,
        };
        let k = (0..3).min_by(|&a, &b| reach(a).total_cmp(&reach(b))).unwrap_or(0);
        let (ends_inside, share) = (reach(k) >= 1.0, reach(k).min(1.0));
        for j in 0..3 {
            at.barycentric[j] = (at.barycentric[j] + share * rates[j]).max(0.0);
        }
        if ends_inside {
            return normalised(at);
        }
        at.barycentric[k] = 0.0;
        at = normalised(at);
        // The edge opposite to corner k is the halfedge that starts at the next corner.
        let h = 3 * at.triangle + (k as u32 + 1) % 3;
        let twin = mesh.twin(h);
        if twin == NONE {
            return at;
        }
        let rest = direction.map(|x| x * (1.0 - share));
        let along = frame.along((k + 1) % 3, rest);
        let (from, to) = (at.barycentric[(k + 1) % 3], at.barycentric[(k + 2) % 3]);
        let mut barycentric = [0.0; 3];
        barycentric[twin as usize % 3] = to;
        barycentric[(twin as usize + 1) % 3] = from;
        at = Location { triangle: twin / 3, barycentric };
        let Some(next) = Frame::new(mesh, at.triangle) else { return at };
        direction = next.across(twin as usize % 3, along);
        (frame, entered) = (next, twin);
    }
    at
}

fn normalised(mut at: Location) -> Location {
    let sum: f64 = at.barycentric.iter().sum();
    at.barycentric.iter_mut().for_each(|b| *b = if *b < ON_EDGE { 0.0 } else { *b / sum });
    at
}

/// A triangle laid flat: its corners in the plane, the first at the origin, the second on the x axis.
struct Frame {
    axes: [Vec3; 2],
    corners: [[f64; 2]; 3],
    area_2: f64,
}

impl Frame {
    fn new(mesh: &TriMesh, triangle: u32) -> Option<Self> {
        let [a, b, c] = mesh.triangles[triangle as usize].map(|v| mesh.positions[v as usize]);
        let x = (b - a).try_normalize(0.0)?;
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        let y = normal.cross(&x);
        let corners = [[0.0, 0.0], [(b - a).norm(), 0.0], [(c - a).dot(&x), (c - a).dot(&y)]];
        let area_2 = corners[1][0] * corners[2][1];
        (area_2 > 0.0).then_some(Self { axes: [x, y], corners, area_2 })
    }

    fn flat(&self, step: Vec3) -> [f64; 2] {
        [step.dot(&self.axes[0]), step.dot(&self.axes[1])]
    }

    /// Change of the barycentric coordinates along `d`.
    fn rates(&self, d: [f64; 2]) -> [f64; 3] {
        [0, 1, 2].map(|k| {
            let (b, c) = (self.corners[(k + 1) % 3], self.corners[(k + 2) % 3]);
            let edge = [c[0] - b[0], c[1] - b[1]];
            (edge[0] * d[1] - edge[1] * d[0]) / self.area_2
        })
    }

    /// `d` along and across the edge that starts at corner `k`; across is positive inwards.
    fn along(&self, k: usize, d: [f64; 2]) -> [f64; 2] {
        let e = self.edge(k);
        [d[0] * e[0] + d[1] * e[1], d[1] * e[0] - d[0] * e[1]]
    }

    /// The direction that continues, in the triangle whose edge starts at corner `k`, one that left its neighbour with
    /// `along` and across that same edge.
    fn across(&self, k: usize, [along, across]: [f64; 2]) -> [f64; 2] {
        // The edge runs the other way here, and outwards there is inwards here.
        let (e, a, c) = (self.edge(k), -along, -across);
        [a * e[0] - c * e[1], a * e[1] + c * e[0]]
    }

    fn edge(&self, k: usize) -> [f64; 2] {
        let (b, c) = (self.corners[k], self.corners[(k + 1) % 3]);
        let d = [c[0] - b[0], c[1] - b[1]];
        let length = d[0].hypot(d[1]).max(1e-300);
        [d[0] / length, d[1] / length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    fn point(mesh: &TriMesh, at: Location) -> Vec3 {
        mesh.triangles[at.triangle as usize]
            .iter()
            .zip(at.barycentric)
            .map(|(&v, b)| mesh.positions[v as usize] * b)
            .sum()
    }

    #[test]
    fn on_a_plane_a_walk_is_a_straight_line() {
        let mesh = grid(12, 12, false, false);
        let start = Location { triangle: 40, barycentric: [0.2, 0.3, 0.5] };
        for angle in 0..24 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(angle) / 24.0).sin_cos();
            let step = Vec3::new(0.2 * cos, 0.2 * sin, 0.0);
            let wanted = point(&mesh, start) + step;
            if wanted.x.min(wanted.y) > 0.0 && wanted.x.max(wanted.y) < 1.0 {
                assert!((point(&mesh, walk(&mesh, start, step)) - wanted).norm() < 1e-12, "angle {angle}");
            }
        }
    }

    #[test]
    fn a_walk_over_a_fold_keeps_its_length_and_its_angle_to_the_fold() {
        let mut mesh = grid(12, 12, false, false);
        // Folded at x = 0.5: the right half stands upright.
        for p in &mut mesh.positions {
            if p.x > 0.5 {
                *p = Vec3::new(0.5, p.y, p.x - 0.5);
            }
        }
        let start = walk(&mesh, Location { triangle: 0, barycentric: [1.0, 0.0, 0.0] }, Vec3::new(0.4, 0.2, 0.0));
        let end = point(&mesh, walk(&mesh, start, Vec3::new(0.3, 0.1, 0.0)));
        assert!((end - Vec3::new(0.5, 0.3, 0.2)).norm() < 1e-9, "{end:?}");
    }

    #[test]
    fn a_walk_off_the_surface_ends_on_its_boundary() {
        let mesh = grid(8, 8, false, false);
        let start = Location { triangle: 20, barycentric: [0.3, 0.3, 0.4] };
        let end = point(&mesh, walk(&mesh, start, Vec3::new(0.0, 9.0, 0.0)));
        assert!((end.y - 1.0).abs() < 1e-12);
    }
}
