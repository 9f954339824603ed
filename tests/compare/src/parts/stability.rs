//! One shape in several forms: how much of it belongs to the same part.

use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::tri::NONE;
use quadmuse_kernel::mesh::{TriMesh, Vec3};
use quadmuse_kernel::segment::Segmented;
use std::collections::BTreeMap;

/// Share of the area of `surface` on which two labels of its triangles agree, labels matched so that it is large:
/// the pair with the most area first.
pub fn overlap(surface: &TriMesh, one: &[u32], two: &[u32]) -> f64 {
    let mut shared: BTreeMap<(u32, u32), f64> = BTreeMap::new();
    for (t, pair) in one.iter().copied().zip(two.iter().copied()).enumerate() {
        *shared.entry(pair).or_default() += surface.area(t);
    }
    let mut pairs: Vec<((u32, u32), f64)> = shared.into_iter().collect();
    pairs.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let (mut taken_one, mut taken_two, mut sum) = (Vec::new(), Vec::new(), 0.0);
    for ((a, b), area) in pairs {
        if !taken_one.contains(&a) && !taken_two.contains(&b) {
            taken_one.push(a);
            taken_two.push(b);
            sum += area;
        }
    }
    sum / surface.total_area()
}

/// Of one part in two forms: shares of the surface's area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartOverlap {
    /// Its area in the first.
    pub area: f64,
    /// Its area in the second.
    pub other: f64,
    /// What belongs to it in both.
    pub shared: f64,
}

impl PartOverlap {
    /// What is shared, of the larger of the two.
    pub fn overlap(&self) -> f64 {
        self.shared / self.area.max(self.other).max(f64::MIN_POSITIVE)
    }
}

/// For each part of the first labels, how much of it the same part of the second covers.
pub fn parts_overlap(surface: &TriMesh, one: &[u32], two: &[u32]) -> Vec<PartOverlap> {
    let count = one.iter().max().map_or(0, |l| *l as usize + 1);
    let mut parts = vec![PartOverlap::default(); count];
    let total = surface.total_area();
    for (t, (&a, &b)) in one.iter().zip(two).enumerate() {
        let area = surface.area(t) / total;
        parts[a as usize].area += area;
        if let Some(part) = parts.get_mut(b as usize) {
            part.other += area;
        }
        if a == b {
            parts[a as usize].shared += area;
        }
    }
    parts
}

/// The part of each triangle of `surface`, told by the nearest point of a cut surface in the same place.
pub fn transferred(surface: &TriMesh, cut: &Segmented) -> Vec<u32> {
    let bvh = Bvh::new(&cut.mesh);
    let part = |t: &[u32; 3]| {
        let middle = t.iter().map(|&v| surface.positions[v as usize]).sum::<Vec3>() / 3.0;
        let closest = bvh.closest(middle);
        cut.part_of.get(closest.triangle as usize).copied().unwrap_or(NONE)
    };
    surface.triangles.iter().map(part).collect()
}

/// The mirror image, faces turned so that they look outward again; triangles keep their numbers.
pub fn mirrored(surface: &TriMesh) -> Option<TriMesh> {
    let positions = surface.positions.iter().map(|p| Vec3::new(-p.x, p.y, p.z)).collect();
    let triangles = surface.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    TriMesh::from_triangles(positions, triangles).ok()
}

/// The same surface with its triangles at other places.
pub fn moved(surface: &TriMesh, positions: &[Vec3]) -> Option<TriMesh> {
    let fits = positions.len() == surface.positions.len();
    fits.then(|| TriMesh { positions: positions.to_vec(), ..surface.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_other_names_agree_and_others_do_not() {
        let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let square = TriMesh::from_triangles(positions.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).expect("a square");
        assert!((overlap(&square, &[0, 1], &[5, 3]) - 1.0).abs() < 1e-12);
        assert!((overlap(&square, &[0, 1], &[2, 2]) - 0.5).abs() < 1e-12);
    }
    #[test]
    fn a_part_is_compared_with_the_part_of_the_same_name() {
        let positions = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let square = TriMesh::from_triangles(positions.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).expect("a square");
        let overlaps =
            |two: &[u32]| parts_overlap(&square, &[0, 1], two).iter().map(|p| p.overlap()).collect::<Vec<_>>();
        assert_eq!(overlaps(&[0, 1]), [1.0, 1.0]);
        assert_eq!(overlaps(&[0, 0]), [0.5, 0.0]);
        assert_eq!(overlaps(&[1, 0]), [0.0, 0.0]);
    }
}
