//! What of the input the map leaves out: surface with no face near it, and features that the example lacks.
//!
//! A finger the example has not is either passed by, and then there is surface far from every face, or covered by a few
//! faces drawn out over it, and then the faces at its tip are many times as large as they were on the example. *Ours,
//! not the paper's.*

use crate::encode::Feature;
use crate::encode::index::PlanarIndex;
use crate::map::CrossMap;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::unfold::Chart;

/// Input vertices looked at, at most, evenly spread over their numbers.
const SAMPLES_MAX: usize = 4_000;
/// Surface farther from every face than this share of a face's usual edge has none near it.
const NEAR_EDGES: f64 = 0.5;
/// The same for maps of very small faces, as a share of √area.
const NEAR_MIN: f64 = 0.005;
/// log₂ of how much larger, against all, faces are on a feature of the input that the example has not.
const MISSING_LOG2: f64 = 2.0;

/// What the map leaves out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Share of the input's area with no face near it.
    pub uncovered_share: f64,
    /// Features of the input.
    pub features: usize,
    /// Those at which the example's faces are drawn out: it has no such feature.
    pub missing: usize,
}

/// Points of the surface at which its features lie.
pub fn feature_points(features: &[Feature], chart: &Chart, index: &PlanarIndex) -> Vec<Vec3> {
    features.iter().map(|f| index.locate(chart, f.uv).point(chart)).collect()
}

/// Measures a map of `example` on the surface `input`, whose features lie at `features`.
pub fn coverage(example: &TriMesh, cross: &CrossMap, input: &TriMesh, features: &[Vec3]) -> Coverage {
    let mapped = TriMesh { positions: cross.positions.clone(), ..example.clone() };
    let tree = Bvh::new(&mapped);
    let near = (NEAR_EDGES * usual_edge(&mapped)).max(NEAR_MIN * input.total_area().sqrt());
    let mut masses = vec![0.0; input.positions.len()];
    for (t, corners) in input.triangles.iter().enumerate() {
        let third = input.area(t) / 3.0;
        corners.iter().for_each(|&v| masses[v as usize] += third);
    }
    let step = input.positions.len().div_ceil(SAMPLES_MAX).max(1);
    let (mut far, mut all) = (0.0, 0.0);
    let taken = || input.positions.iter().zip(&masses).step_by(step).filter(|(_, mass)| **mass > 0.0);
    let points: Vec<Vec3> = taken().map(|(p, _)| *p).collect();
    for ((_, mass), closest) in taken().zip(tree.closest_to_all(&points)) {
        all += mass;
        if closest.distance > near {
            far += mass;
        }
    }
    let growth = growth(example, &mapped);
    let whole = (mapped.total_area() / example.total_area()).log2();
    let is_missing = |p: &&Vec3| {
        let face = mapped.triangles.get(tree.closest(**p).triangle as usize);
        face.is_some_and(|f| f.iter().map(|&v| growth[v as usize]).sum::<f64>() / 3.0 - whole > MISSING_LOG2)
    };
    Coverage {
        uncovered_share: if all > 0.0 { far / all } else { 0.0 },
        features: features.len(),
        missing: features.iter().filter(is_missing).count(),
    }
}

/// Median length of the polygons' edges.
fn usual_edge(mesh: &TriMesh) -> f64 {
    mesh.median_length((0..mesh.twins.len() as u32).filter(|&h| !mesh.phantom[h as usize]))
}

/// log₂ of how much larger the faces about each vertex are on `after` than on `before`.
fn growth(before: &TriMesh, after: &TriMesh) -> Vec<f64> {
    let mut areas = vec![[0.0f64; 2]; before.positions.len()];
    for (t, corners) in before.triangles.iter().enumerate() {
        let [a, b] = [before.area(t), after.area(t)];
        for &v in corners {
            areas[v as usize][0] += a;
            areas[v as usize][1] += b;
        }
    }
    areas.iter().map(|[a, b]| (b.max(1e-300) / a.max(1e-300)).log2()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::index::Location;
    use crate::mesh::bounding_box;
    use crate::topology::tests::grid;

    /// A sheet with a cone of `height` in its middle, and where its tip is.
    fn spiked(height: f64) -> (TriMesh, Vec3) {
        let mut sheet = grid(40, 40, false, false);
        let [low, high] = bounding_box(&sheet.positions).expect("a sheet");
        let (middle, size) = (0.5 * (low + high), (high - low).norm());
        for p in &mut sheet.positions {
            let from = (*p - middle).xy().norm() / size;
            p.z = height * size * (1.0 - from / 0.06).max(0.0);
        }
        (sheet, Vec3::new(middle.x, middle.y, height * size))
    }

    fn laid(positions: &[Vec3]) -> CrossMap {
        let at = Location { triangle: 0, barycentric: [1.0, 0.0, 0.0] };
        CrossMap { positions: positions.to_vec(), locations: vec![at; positions.len()] }
    }

    #[test]
    fn a_spike_that_is_passed_by_is_uncovered() {
        let ((flat, _), (input, tip)) = (spiked(0.0), spiked(0.5));
        let c = coverage(&flat, &laid(&flat.positions), &input, &[tip]);
        assert!(c.uncovered_share > 0.1, "{c:?}");
        let whole = coverage(&input, &laid(&input.positions), &input, &[tip]);
        assert_eq!(whole, Coverage { uncovered_share: 0.0, features: 1, missing: 0 });
    }

    #[test]
    fn a_spike_that_faces_are_drawn_out_over_is_missing() {
        let ((flat, _), (input, tip)) = (spiked(0.0), spiked(0.5));
        let c = coverage(&flat, &laid(&input.positions), &input, &[tip, input.positions[0]]);
        assert_eq!((c.uncovered_share, c.features, c.missing), (0.0, 2, 1), "{c:?}");
    }
}
