//! The mirror image of a surface in itself.
//!
//! Most of what artists lay is symmetric. A symmetric example that lies mirrored on an input lies there unmirrored as well, with each
//! vertex where its mirror image was: which of the two is right is no question of evidence, which hardly tells them apart. *Ours,
//! not a paper's.*

use super::held::VertexLandmark;
use super::similarity::eigen;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use nalgebra::Matrix3;

/// Mean distance of vertices' mirror images from the surface, in its √area, up to which it is symmetric: bodies, animals and busts
/// have up to .005, hands and feet .024 and more (tests/records/poses-2026-11-28.md).
const SYMMETRIC: f64 = 0.006;
/// Vertices that are mirrored to find the plane.
const SAMPLES: usize = 500;
/// Times that a plane is fitted to what it mirrors.
const ROUNDS: usize = 5;

/// Where the mirror image of each vertex lies on the surface: vertices with their weights, whose sum is 1.
#[derive(Clone, Debug)]
pub struct Symmetry {
    images: Vec<[(u32, f64); 3]>,
}

/// The plane n · x = d.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: Vec3,
    d: f64,
}

impl Plane {
    fn mirrored(&self, x: &Vec3) -> Vec3 {
        x - self.normal * (2.0 * (self.normal.dot(x) - self.d))
    }
}

impl Symmetry {
    /// Finds the plane of symmetry; `None` where a surface has none.
    pub fn of(mesh: &TriMesh) -> Option<Self> {
        let (area, tree) = (mesh.total_area(), Bvh::new(mesh));
        let step = mesh.positions.len().div_ceil(SAMPLES).max(1);
        let samples: Vec<Vec3> = mesh.positions.iter().step_by(step).copied().collect();
        let (centre, moments) = moments(mesh);
        let (_, axes) = eigen([0, 1, 2].map(|i| [0, 1, 2].map(|j| moments[(i, j)])));
        let along = |k: usize| Vec3::new(axes[0][k], axes[1][k], axes[2][k]);
        let planes = (0..3).map(|k| Plane { normal: along(k), d: along(k).dot(&centre) });
        let (away, plane) =
            planes.filter_map(|plane| fitted(plane, &samples, &tree)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        if away.is_nan() || away > SYMMETRIC * area.sqrt() {
            return None;
        }
        let image = |x: &Vec3| {
            let place = tree.closest(plane.mirrored(x));
            let corners = mesh.triangles.get(place.triangle as usize)?;
            Some([0, 1, 2].map(|k| (corners[k], place.barycentric[k])))
        };
        Some(Self { images: mesh.positions.iter().map(image).collect::<Option<_>>()? })
    }

    /// Sends each vertex to where its mirror image lies: turns a mirrored place of the surface into one that is not, and the reverse.
    pub fn swapped(&self, positions: &[Vec3]) -> Vec<Vec3> {
        let at = |image: &[(u32, f64); 3]| image.iter().map(|(v, w)| positions[*v as usize] * *w).sum();
        self.images.iter().map(at).collect()
    }

    /// The same of a landmark: the mirror image of its point goes where the point went.
    pub fn swapped_landmark(&self, landmark: &VertexLandmark) -> VertexLandmark {
        VertexLandmark { corners: self.images[landmark.vertex() as usize], to: landmark.to }
    }
}

/// A plane moved to where it mirrors the points onto the surface best, and how far from it they then are in the mean; `None` where the
/// surface has no triangle.
fn fitted(mut plane: Plane, samples: &[Vec3], tree: &Bvh) -> Option<(f64, Plane)> {
    let n = samples.len().max(1) as f64;
    let mut best: Option<(f64, Plane)> = None;
    for _ in 0..=ROUNDS {
        let found: Vec<_> = samples.iter().map(|x| tree.closest(plane.mirrored(x))).collect();
        let away = found.iter().map(|place| place.distance).sum::<f64>() / n;
        if best.is_none_or(|(least, _)| away < least) {
            best = Some((away, plane));
        }
        // Reflections are I − 2 n nᵀ: the one that carries x̄ onto ȳ best has the least eigenvector of Σ x̄ ȳᵀ + ȳ x̄ᵀ.
        let middle = |sum: Vec3| sum / n;
        let (from, to) = (middle(samples.iter().sum()), middle(found.iter().map(|place| place.point).sum()));
        let pairs = samples.iter().zip(&found).map(|(x, place)| (x - from, place.point - to));
        let sum: Matrix3<f64> = pairs.map(|(x, y)| x * y.transpose() + y * x.transpose()).sum();
        let (values, vectors) = eigen([0, 1, 2].map(|i| [0, 1, 2].map(|j| sum[(i, j)])));
        let least = (1..3).fold(0, |b, k| if values[k] < values[b] { k } else { b });
        let normal = Vec3::new(vectors[0][least], vectors[1][least], vectors[2][least]);
        plane = Plane { normal, d: normal.dot(&(from + to)) / 2.0 };
    }
    best.filter(|(away, _)| away.is_finite())
}

/// A surface's centre, and the moments of its area about that: symmetric surfaces have a plane of symmetry across one of the axes.
fn moments(mesh: &TriMesh) -> (Vec3, Matrix3<f64>) {
    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
    let (mut area, mut centre) = (0.0, Vec3::zeros());
    for (k, t) in mesh.triangles.iter().enumerate() {
        let of = mesh.area(k);
        (area, centre) = (area + of, centre + corners(t).iter().sum::<Vec3>() * (of / 3.0));
    }
    let centre = centre / area.max(f64::MIN_POSITIVE);
    // ∫ x xᵀ over a triangle is its area / 12 · (Σ p pᵀ + (Σ p)(Σ p)ᵀ).
    let of = |(k, t): (usize, &[u32; 3])| {
        let points = corners(t).map(|p| p - centre);
        let sum: Vec3 = points.iter().sum();
        let squares: Matrix3<f64> = points.iter().map(|p| p * p.transpose()).sum();
        (squares + sum * sum.transpose()) * (mesh.area(k) / 12.0)
    };
    (centre, mesh.triangles.iter().enumerate().map(of).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A bumpy sheet that is the same on both sides of x = 0, but for some bump of its own on one side; turned a little.
    fn sheet(bump: f64) -> TriMesh {
        let flat = grid(40, 30, false, false);
        let most = flat.positions.iter().fold(0.0f64, |most, p| most.max(p.x));
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.2, 0.9);
        let place = |p: &Vec3| {
            let (x, y) = (2.0 * p.x / most - 1.0, 1.3 * p.y / most);
            let own = bump * (1.0 - ((x - 0.5).hypot(y - 0.5) / 0.3).powi(2)).max(0.0);
            turn * Vec3::new(x, y, 0.3 * (4.0 * x.abs() + y).sin() + own)
        };
        TriMesh::from_triangles(flat.positions.iter().map(place).collect(), flat.triangles.clone()).expect("a sheet")
    }

    #[test]
    fn each_vertex_has_its_mirror_image_on_a_symmetric_surface() {
        let mesh = sheet(0.0);
        let symmetry = Symmetry::of(&mesh).expect("symmetric");
        // Laid mirrored and sent to its images it lies as it is.
        let mirrored: Vec<Vec3> = symmetry.swapped(&mesh.positions);
        let moved = mirrored.iter().zip(&mesh.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(moved > 1.9, "the ends change places: {moved}");
        let back = symmetry.swapped(&mirrored);
        let off = back.iter().zip(&mesh.positions).map(|(a, b)| (a - b).norm()).sum::<f64>() / back.len() as f64;
        assert!(off < 2e-3, "{off}");
        let to = Bvh::new(&mesh).closest(mesh.positions[0]);
        let landmark = VertexLandmark { corners: [(0, 1.0), (0, 0.0), (0, 0.0)], to };
        let swapped = symmetry.swapped_landmark(&landmark);
        assert!(swapped.distance(&mirrored) < 1e-2 && swapped.distance(&mesh.positions) > 1.0);
    }

    #[test]
    fn a_bump_on_one_side_is_no_symmetry() {
        assert!(Symmetry::of(&sheet(0.4)).is_none());
    }
}
