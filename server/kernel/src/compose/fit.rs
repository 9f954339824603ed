//! How far a mesh lies from the surface that it was laid on, and the surface from it.
//!
//! Means over points spread evenly by area on one of them, of the distance to the nearest point of the other. A protrusion
//! that was cut short shows in the second only. *Ours, not the paper's.*

use super::net::Fans;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, Vec3};
use std::sync::Arc;

/// Points on each.
const SAMPLES: usize = 6000;
/// Fractions that spread points within triangles: powers of the plastic number's inverse.
const SPREAD: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];

/// Mean distances between a mesh and a surface, in the unit of the positions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    /// From the mesh to the surface.
    pub out: f64,
    /// From the surface to the mesh.
    pub back: f64,
}

impl Fit {
    /// Means of distances of points of the mesh, and of points of the surface.
    pub(super) fn of(out: &[(Vec3, f64)], back: &[(Vec3, f64)]) -> Self {
        Self { out: mean(out), back: mean(back) }
    }

    /// The larger of the two.
    pub fn worst(&self) -> f64 {
        self.out.max(self.back)
    }
}

/// A surface prepared for measuring.
#[derive(Clone, Debug)]
pub struct MeasuredSurface {
    points: Vec<Vec3>,
    bvh: Arc<Bvh>,
}

impl MeasuredSurface {
    /// Of a surface.
    pub fn new(surface: &TriMesh) -> Self {
        Self::with_tree(surface, Arc::new(Bvh::new(surface)))
    }

    /// The same with the surface's tree.
    pub fn with_tree(surface: &TriMesh, bvh: Arc<Bvh>) -> Self {
        Self { points: samples(surface), bvh }
    }

    /// Points of it, spread evenly by area.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// How a mesh of polygons fits it.
    pub fn fit(&self, mesh: &PolyMesh) -> Fit {
        let [out, back] = self.distances(mesh);
        Fit::of(&out, &back)
    }

    /// The distance of each point of a mesh of polygons from it, and of each of its points from the mesh.
    pub fn distances(&self, mesh: &PolyMesh) -> [Vec<(Vec3, f64)>; 2] {
        let other = Self::new(&Fans::of(&mesh.positions, (0..).zip(mesh.faces.iter())).mesh);
        let to = |points: &[Vec3], bvh: &Bvh| {
            points.iter().zip(bvh.closest_to_all(points)).map(|(&p, near)| (p, near.distance)).collect()
        };
        [to(&other.points, &self.bvh), to(&self.points, &other.bvh)]
    }
}

fn mean(distances: &[(Vec3, f64)]) -> f64 {
    let sum: f64 = distances.iter().map(|d| d.1).filter(|d| d.is_finite()).sum();
    sum / distances.len().max(1) as f64
}

/// Points spread evenly by area.
fn samples(mesh: &TriMesh) -> Vec<Vec3> {
    let mut points = Vec::with_capacity(SAMPLES);
    let step = mesh.total_area() / SAMPLES as f64;
    if step <= 0.0 || !step.is_finite() {
        return points;
    }
    let mut up_to = 0.0;
    for (t, corners) in mesh.triangles.iter().enumerate() {
        up_to += mesh.area(t);
        while points.len() < SAMPLES && (points.len() as f64 + 0.5) * step < up_to {
            let k = points.len() as f64;
            let (mut a, mut b) = ((k * SPREAD[0]).fract(), (k * SPREAD[1]).fract());
            if a + b > 1.0 {
                (a, b) = (1.0 - a, 1.0 - b);
            }
            let [p, q, r] = corners.map(|v| mesh.positions[v as usize]);
            points.push(p + (q - p) * a + (r - p) * b);
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    #[test]
    fn a_sheet_that_is_cut_short_is_missed_by_the_surface_alone() {
        let surface = grid(8, 8, false, false);
        let mut net = sheet(4, 4);
        net.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x / 8.0, p.y / 4.0, 0.0));
        let fit = MeasuredSurface::new(&surface).fit(&net.into_mesh().0);
        assert!(fit.out < 1e-12, "{fit:?}");
        // Half of the surface lies 0 to 1/2 away.
        assert!((fit.back - 0.125).abs() < 0.005, "{fit:?}");
    }
}
