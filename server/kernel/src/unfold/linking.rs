//! How often two closed curves in space wind around each other.
//!
//! lk(a, b) = the signed crossings, seen along one direction, at which a lies above b. Crossings are decided by exact
//! predicates on the projected points, so that the sum is an integer of the curves and not of rounding.

use crate::mesh::Vec3;
use robust::{Coord, orient2d};

/// A rotation by 1 about (1, 2, 3), askew to anything that a modeller aligns; its last row is the direction of view.
const FRAME: [[f64; 3]; 3] = [[0.5731, -0.6090, 0.5483], [0.7403, 0.6716, -0.0279], [-0.3513, 0.4219, 0.8358]];

/// A projected point: along the picture, and height above it.
type ProjectedPoint = ([f64; 2], f64);

/// The linking number of two disjoint closed polylines.
pub fn linking_number(a: &[Vec3], b: &[Vec3]) -> i64 {
    let seen = |p: &Vec3| -> ProjectedPoint {
        let along = |k: usize| FRAME[k][0] * p.x + FRAME[k][1] * p.y + FRAME[k][2] * p.z;
        ([along(0), along(1)], along(2))
    };
    let (a, b): (Vec<ProjectedPoint>, Vec<ProjectedPoint>) =
        (a.iter().map(seen).collect(), b.iter().map(seen).collect());
    let mut number = 0;
    for i in 0..a.len() {
        let (p0, p1) = (a[i], a[(i + 1) % a.len()]);
        let (low, high) = (lower(p0.0, p1.0), upper(p0.0, p1.0));
        for j in 0..b.len() {
            let (q0, q1) = (b[j], b[(j + 1) % b.len()]);
            let apart = (0..2).any(|k| q0.0[k].max(q1.0[k]) < low[k] || q0.0[k].min(q1.0[k]) > high[k]);
            if !apart {
                number += crossing(p0, p1, q0, q1);
            }
        }
    }
    number
}

fn lower(p: [f64; 2], q: [f64; 2]) -> [f64; 2] {
    [p[0].min(q[0]), p[1].min(q[1])]
}

fn upper(p: [f64; 2], q: [f64; 2]) -> [f64; 2] {
    [p[0].max(q[0]), p[1].max(q[1])]
}

/// ±1 where the segments cross and the first is above, else 0. Points on a line count to its left.
fn crossing(p0: ProjectedPoint, p1: ProjectedPoint, q0: ProjectedPoint, q1: ProjectedPoint) -> i64 {
    let coord = |p: [f64; 2]| Coord { x: p[0], y: p[1] };
    let side = |a: ProjectedPoint, b: ProjectedPoint, c: ProjectedPoint| orient2d(coord(a.0), coord(b.0), coord(c.0));
    let (s0, s1) = (side(p0, p1, q0), side(p0, p1, q1));
    if (s0 >= 0.0) == (s1 >= 0.0) {
        return 0;
    }
    let (r0, r1) = (side(q0, q1, p0), side(q0, q1, p1));
    if (r0 >= 0.0) == (r1 >= 0.0) {
        return 0;
    }
    let at = |s: f64, t: f64| if s == t { 0.5 } else { s / (s - t) };
    let (on_q, on_p) = (at(s0, s1), at(r0, r1));
    let above = p0.1 + on_p * (p1.1 - p0.1) > q0.1 + on_q * (q1.1 - q0.1);
    i64::from(above) * if s1 >= 0.0 { 1 } else { -1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(n: usize, centre: Vec3, x: Vec3, y: Vec3) -> Vec<Vec3> {
        let angle = |k: usize| std::f64::consts::TAU * k as f64 / n as f64;
        (0..n).map(|k| centre + x * angle(k).cos() + y * angle(k).sin()).collect()
    }

    #[test]
    fn chained_rings_are_linked_once_either_way_round() {
        let a = circle(17, Vec3::zeros(), Vec3::x(), Vec3::y());
        let b = circle(23, Vec3::x(), Vec3::x(), Vec3::z());
        let number = linking_number(&a, &b);
        assert_eq!((number.abs(), linking_number(&b, &a)), (1, number));
        let turned: Vec<Vec3> = b.iter().rev().copied().collect();
        assert_eq!(linking_number(&a, &turned), -number);
    }

    #[test]
    fn rings_side_by_side_are_not() {
        let a = circle(17, Vec3::zeros(), Vec3::x(), Vec3::y());
        for centre in [Vec3::new(3.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.4), Vec3::new(0.3, 0.2, 5.0)] {
            assert_eq!(linking_number(&a, &circle(23, centre, Vec3::x() * 0.9, Vec3::y())), 0);
        }
    }
}
