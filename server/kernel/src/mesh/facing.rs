//! Which way the faces of a layout look, compared with the surface that they lie on.
//!
//! A spike, a crumple and a limb that is spanned by a few quads keep their vertices on the surface, and their edges close to it.
//! Their faces look another way than the surface does. The surface's normals are averaged over about half a face, so that
//! noise turns none. *Ours, not the paper's.*

use super::Vec3;
use super::bvh::Bvh;
use super::tri::{NONE, TriMesh};
use crate::numerics::stop;

/// Cosine of the angle from which on a face looks another way: 60°.
const TURNED_COS: f64 = 0.5;
/// Points of a triangle that are looked at, by their weights of the corners.
const POINTS: [[f64; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];
/// Passes of averaging for a face as long as one edge of the surface: n passes reach as far as √n edges. *Untuned.*
const PASSES: f64 = 0.1;
/// Passes at most.
const PASSES_MAX: f64 = 16.0;

/// How much of some faces looks away from the surface.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TurnedArea {
    /// Their area.
    area: f64,
    /// The part of it that looks more than 60° away.
    away: f64,
}

impl TurnedArea {
    /// Several together.
    pub(crate) fn of(all: impl IntoIterator<Item = Self>) -> Self {
        let mut sum = Self::default();
        all.into_iter().for_each(|one| sum.add(one));
        sum
    }

    /// The part of the area that looks away, as a share of the area of `all`.
    pub(crate) fn share_of(self, all: Self) -> f64 {
        self.away / all.area.max(f64::MIN_POSITIVE)
    }

    /// Adds others.
    pub(crate) fn add(&mut self, other: Self) {
        (self.area, self.away) = (self.area + other.area, self.away + other.away);
    }

    /// The share of the area that looks away.
    pub(crate) fn share(self) -> f64 {
        self.share_of(self)
    }
}

/// A surface with its normals at the scale of a layout.
pub(crate) struct Facing<'a> {
    surface: &'a TriMesh,
    tree: &'a Bvh,
    normals: Vec<Vec3>,
}

impl<'a> Facing<'a> {
    /// Prepares a surface for faces with edges of a length; `tree` is the surface's.
    pub(crate) fn new(surface: &'a TriMesh, tree: &'a Bvh, edge: f64) -> Self {
        let count = surface.triangles.len().max(1) as f64;
        // The edge of an equilateral triangle of the mean area.
        let own = (4.0 / 3f64.sqrt() * surface.total_area() / count).sqrt().max(f64::MIN_POSITIVE);
        let passes = (PASSES * (edge / own).powi(2)).clamp(0.0, PASSES_MAX).round() as usize;
        let mut normals = units(surface.vertex_area_vectors());
        for _ in 0..passes {
            normals = averaged(surface, &normals);
        }
        Self { surface, tree, normals }
    }

    /// How much of a polygon looks away; it is cut into a fan from its first corner.
    pub(crate) fn turned(&self, corners: &[Vec3]) -> TurnedArea {
        let mut all = TurnedArea::default();
        for k in 1..corners.len().saturating_sub(1) {
            let [a, b, c] = [corners[0], corners[k], corners[k + 1]];
            let normal = 0.5 * (b - a).cross(&(c - a));
            let away = POINTS.iter().filter(|[u, v, w]| self.is_turned(a * *u + b * *v + c * *w, normal)).count();
            let area = normal.norm();
            all.add(TurnedArea { area, away: area * away as f64 / POINTS.len() as f64 });
        }
        all
    }

    fn is_turned(&self, at: Vec3, normal: Vec3) -> bool {
        let near = self.tree.closest(at);
        if near.triangle == NONE {
            return true;
        }
        let corners = self.surface.triangles[near.triangle as usize];
        let smooth: Vec3 = (0..3).map(|k| self.normals[corners[k] as usize] * near.barycentric[k]).sum();
        let sharp = self.surface.area_vector(near.triangle as usize);
        let looks_away = |there: Vec3| normal.dot(&there) < TURNED_COS * normal.norm() * there.norm();
        looks_away(smooth) && looks_away(sharp)
    }
}

/// Normals of the vertices, each the mean of those of the triangles around it, by area.
fn averaged(surface: &TriMesh, normals: &[Vec3]) -> Vec<Vec3> {
    let mut sums = vec![Vec3::zeros(); normals.len()];
    for (t, corners) in surface.triangles.iter().enumerate() {
        stop::pass(1);
        let own = corners.iter().map(|&v| normals[v as usize]).sum::<Vec3>() * surface.area(t);
        corners.iter().for_each(|&v| sums[v as usize] += own);
    }
    units(sums)
}

/// Vectors of length 1; those without a direction stay 0.
fn units(vectors: Vec<Vec3>) -> Vec<Vec3> {
    vectors.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A flat sheet of n × n squares whose vertices are moved up and down by so much, without chance.
    fn rough(n: u32, by: f64) -> TriMesh {
        let mut sheet = grid(n, n, false, false);
        let noise = |k: usize| by * (2.0 * (k as f64 * 0.618_034).fract() - 1.0);
        sheet.positions.iter_mut().enumerate().for_each(|(k, p)| p.z = noise(k));
        sheet
    }

    fn quad(heights: [f64; 4]) -> [Vec3; 4] {
        let corners = [[0.3, 0.3], [0.7, 0.3], [0.7, 0.7], [0.3, 0.7]];
        [0, 1, 2, 3].map(|k| Vec3::new(corners[k][0], corners[k][1], heights[k]))
    }

    /// The share of a quad that looks away from a sheet.
    fn turned(surface: &TriMesh, corners: &[Vec3]) -> f64 {
        let tree = Bvh::new(surface);
        Facing::new(surface, &tree, 0.4).turned(corners).share()
    }

    #[test]
    fn noise_turns_no_face() {
        // Edges of 1/40 that rise by up to 1/20: triangles lean by more than 60°.
        let surface = rough(40, 0.025);
        assert_eq!(turned(&surface, &quad([0.0; 4])), 0.0);
        assert_eq!(turned(&surface, &quad([0.0, 0.1, 0.0, 0.1])), 0.0);
    }

    #[test]
    fn a_spike_stands_off_and_a_face_that_looks_inward_is_turned() {
        let flat = rough(40, 0.0);
        assert_eq!(turned(&flat, &quad([0.0, 0.0, 1.0, 1.0])), 1.0);
        let spike = turned(&flat, &quad([0.0, 0.0, 1.0, 0.0]));
        assert!((0.4..=1.0).contains(&spike), "half of it stands up: {spike}");
        let mut over = quad([0.0; 4]);
        over.reverse();
        assert!((turned(&flat, &over) - 1.0).abs() < 1e-12);
    }
}
