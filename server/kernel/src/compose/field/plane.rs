//! A tangent plane at each vertex, with complex numbers as its vectors.
//!
//! The plane of vertex j is laid on that of i by the least rotation that takes the one normal to the other. *Source:*
//! Jakob, Tarini, Panozzo, Sorkine-Hornung, *Instant field-aligned meshes* (2015), §3.

use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use std::ops::{Add, Mul, Sub};

/// A complex number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Complex {
    pub(super) re: f64,
    pub(super) im: f64,
}

impl Complex {
    pub(super) fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    pub(super) fn from_angle(angle: f64) -> Self {
        Self::new(angle.cos(), angle.sin())
    }

    pub(super) fn conj(self) -> Self {
        Self::new(self.re, -self.im)
    }

    pub(super) fn norm_squared(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    pub(super) fn norm(self) -> f64 {
        self.norm_squared().sqrt()
    }

    pub(super) fn angle(self) -> f64 {
        self.im.atan2(self.re)
    }

    /// The same direction with length 1; 1 for 0.
    pub(super) fn unit(self) -> Self {
        let norm = self.norm();
        if norm > 0.0 { self * norm.recip() } else { Self::new(1.0, 0.0) }
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.re + other.re, self.im + other.im)
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.re - other.re, self.im - other.im)
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self::new(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)
    }
}

impl Mul<f64> for Complex {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self::new(self.re * by, self.im * by)
    }
}

/// Normal and axes at each vertex.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    pub(super) normal: Vec<Vec3>,
    axes: Vec<[Vec3; 2]>,
}

impl Planes {
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let normal: Vec<Vec3> =
            mesh.vertex_area_vectors().iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vec3::z)).collect();
        let axes = normal.iter().map(|n| axes(*n)).collect();
        Self { normal, axes }
    }

    /// A vector's part in the plane of a vertex.
    pub(super) fn flat(&self, v: u32, vector: Vec3) -> Complex {
        let [x, y] = self.axes[v as usize];
        Complex::new(vector.dot(&x), vector.dot(&y))
    }

    /// The angle at which the first axis of a halfedge's head lies when its plane is laid on that of its tail.
    pub(super) fn transport(&self, mesh: &TriMesh, h: u32) -> f64 {
        let (i, j) = (mesh.tail(h), mesh.head(h));
        self.flat(i, turned(self.axes[j as usize][0], self.normal[j as usize], self.normal[i as usize])).angle()
    }
}

/// Any two axes at right angles to a normal, and with it a right-handed frame.
fn axes(n: Vec3) -> [Vec3; 2] {
    let other = if n.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    let x = (other - n * n.dot(&other)).normalize();
    [x, n.cross(&x)]
}

/// A vector by the least rotation from one unit normal to another.
fn turned(v: Vec3, from: Vec3, to: Vec3) -> Vec3 {
    let (axis, cos) = (from.cross(&to), from.dot(&to));
    if cos <= -1.0 + 1e-9 {
        return v;
    }
    v * cos + axis.cross(&v) + axis * (axis.dot(&v) / (1.0 + cos))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tri::NONE;
    use crate::topology::tests::grid;

    #[test]
    fn there_and_back_is_no_turn() {
        let mesh = grid(9, 7, true, true);
        let planes = Planes::new(&mesh);
        for h in (0..mesh.twins.len() as u32).filter(|&h| mesh.twin(h) != NONE) {
            let sum = planes.transport(&mesh, h) + planes.transport(&mesh, mesh.twin(h));
            assert!(sum.sin().abs() < 1e-12 && sum.cos() > 0.0, "{h}: {sum}");
        }
    }

    #[test]
    fn the_least_rotation_takes_one_normal_to_the_other() {
        let (a, b) = (Vec3::new(1.0, 2.0, 2.0).normalize(), Vec3::new(-2.0, 1.0, 0.5).normalize());
        assert!((turned(a, a, b) - b).norm() < 1e-12);
        let across = a.cross(&b);
        assert!((turned(across, a, b) - across).norm() < 1e-12);
    }
}
