//! The flat end of a surface: where a head, a bust or a limb was closed by a plane.
//!
//! A region is grown about each of some seeds while triangles face alike and lie in one plane; the largest is the end, if what
//! borders on it bends away from it sharply. *Ours, not the paper's.*

use crate::mesh::Vec3;
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::stop;
use crate::segment::segment_labels;
use crate::topology::{Components, Patch, Topology, primitive};

/// Seeds, spread evenly over the area.
const SEEDS: usize = 24;
/// A triangle of the end turns from its plane's normal by less than this, as a cosine, and lies no farther off the plane than this share
/// of √area. *Untuned.*
const ALIKE: f64 = 0.94;
const OFF_MAX: f64 = 0.03;
/// Share of the area from which on a flat region is the end. *Untuned.*
const AREA_MIN: f64 = 0.02;
/// An edge is sharp where the strip beside the end, so wide as a share of the end's √area, turns from it by 45° in the mean, as a cosine.
/// About the top of a dome such a strip turns by 30°. *Untuned.*
const BESIDE: f64 = 0.15;
const BENT: f64 = 0.7;

/// A disc cut where its flat end begins: the annulus about its rim, and the end. `None` where it has none.
pub fn flat_end(disc: &TriMesh) -> Option<[Patch; 2]> {
    let plain = Plain::new(disc);
    let (area, end) = plain.largest()?;
    if area < AREA_MIN * plain.area || !plain.is_sharp(&end, area) {
        return None;
    }
    let parts = segment_labels(disc, end.is_in.iter().map(|&is_in| u32::from(is_in)).collect()).parts;
    let [around, end] = &parts[..] else { return None };
    // Openings of a part that borders on another are filled.
    let whole = |patch: &Patch| primitive(&patch.mesh, Components::Largest).ok();
    let (around, end) = (whole(around)?, whole(end)?);
    (around.topology == Topology::Annulus && end.topology == Topology::Disc).then_some([around, end])
}

/// A plane through a point.
#[derive(Clone, Copy)]
struct Plane {
    point: Vec3,
    normal: Vec3,
}

/// A flat region.
struct FlatRegion {
    plane: Plane,
    is_in: Vec<bool>,
}

/// The triangles of a surface.
struct Plain<'a> {
    mesh: &'a TriMesh,
    area: f64,
    areas: Vec<f64>,
    normals: Vec<Vec3>,
    middles: Vec<Vec3>,
}

impl<'a> Plain<'a> {
    fn new(mesh: &'a TriMesh) -> Self {
        let all = 0..mesh.triangles.len();
        stop::pass(all.len());
        let middle = |t: usize| mesh.triangles[t].iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / 3.0;
        let areas: Vec<f64> = all.clone().map(|t| mesh.area(t)).collect();
        let normals = all.clone().map(|t| mesh.area_vector(t).try_normalize(0.0).unwrap_or_default()).collect();
        Self { mesh, area: areas.iter().sum(), areas, normals, middles: all.map(middle).collect() }
    }

    /// The largest flat region that does not reach the rim, with its area.
    fn largest(&self) -> Option<(f64, FlatRegion)> {
        let mut best: Option<(f64, FlatRegion)> = None;
        let (mut sum, mut next) = (0.0, 0.5);
        for t in 0..self.areas.len() {
            sum += self.areas[t];
            if sum < next * self.area / SEEDS as f64 {
                continue;
            }
            next += 1.0;
            if best.as_ref().is_some_and(|(_, best)| best.is_in[t]) {
                continue;
            }
            // The seed's own plane is that of one triangle.
            let seed = self.grown(t, Plane { point: self.middles[t], normal: self.normals[t] });
            let region = self.grown(t, self.fitted(&seed));
            let area: f64 = self.triangles(&region).map(|t| self.areas[t]).sum();
            if best.as_ref().is_none_or(|best| area > best.0) && !self.reaches_rim(&region) {
                best = Some((area, region));
            }
        }
        best
    }

    fn triangles<'r>(&self, region: &'r FlatRegion) -> impl Iterator<Item = usize> + 'r {
        (0..region.is_in.len()).filter(|&t| region.is_in[t])
    }

    /// Grows a region from a triangle over all that is joined to it and lies in a plane.
    fn grown(&self, seed: usize, plane: Plane) -> FlatRegion {
        let off = OFF_MAX * self.area.sqrt();
        let fits = |t: usize| {
            self.normals[t].dot(&plane.normal) > ALIKE && (self.middles[t] - plane.point).dot(&plane.normal).abs() < off
        };
        let mut is_in = vec![false; self.areas.len()];
        is_in[seed] = true;
        let mut todo = vec![seed];
        while let Some(t) = todo.pop() {
            stop::pass(1);
            for h in 3 * t as u32..3 * t as u32 + 3 {
                let twin = self.mesh.twin(h);
                let beside = twin as usize / 3;
                if twin != NONE && !is_in[beside] && fits(beside) {
                    is_in[beside] = true;
                    todo.push(beside);
                }
            }
        }
        FlatRegion { plane, is_in }
    }

    /// Returns the mean plane of a region.
    fn fitted(&self, region: &FlatRegion) -> Plane {
        let (mut area, mut point, mut normal) = (0.0, Vec3::zeros(), Vec3::zeros());
        for t in self.triangles(region) {
            area += self.areas[t];
            point += self.areas[t] * self.middles[t];
            normal += self.areas[t] * self.normals[t];
        }
        Plane { point: point / area.max(f64::MIN_POSITIVE), normal: normal.try_normalize(0.0).unwrap_or_default() }
    }

    fn reaches_rim(&self, region: &FlatRegion) -> bool {
        self.triangles(region).any(|t| (3 * t as u32..3 * t as u32 + 3).any(|h| self.mesh.twin(h) == NONE))
    }

    /// Tells whether what lies beside a region bends away from it sharply, not as a dome does.
    fn is_sharp(&self, region: &FlatRegion, area: f64) -> bool {
        let near = BESIDE * area.sqrt();
        let Plane { point, normal } = region.plane;
        let is_beside = |&t: &usize| !region.is_in[t] && (self.middles[t] - point).dot(&normal).abs() < near;
        let beside = (0..region.is_in.len()).filter(is_beside);
        let (all, alike) = beside.fold((0.0, 0.0), |(all, alike), t| {
            (all + self.areas[t], alike + self.areas[t] * self.normals[t].dot(&normal))
        });
        all > 0.0 && alike < BENT * all
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// A sheet with its middle pressed down to a bowl; height by the distance from the middle, from 0 to 1.
    pub(in crate::fit) fn bowl(n: u32, height: impl Fn(f64) -> f64) -> TriMesh {
        let flat = grid(n, n, false, false);
        let size = flat.positions.iter().fold(0.0f64, |most, p| most.max(p.x));
        let place = |p: &Vec3| {
            let (x, y) = (2.0 * p.x / size - 1.0, 2.0 * p.y / size - 1.0);
            // Squares become circles.
            let (far, round) = (x.abs().max(y.abs()), x.hypot(y).max(f64::MIN_POSITIVE));
            Vec3::new(x * far / round, y * far / round, height(far))
        };
        TriMesh::from_triangles(flat.positions.iter().map(place).collect(), flat.triangles.clone()).expect("a bowl")
    }

    #[test]
    fn a_flat_bottom_is_the_end_of_a_bowl_and_a_round_one_is_none() {
        let flat = bowl(40, |far| 4.0 * (far - 0.5).max(0.0));
        let [around, end] = flat_end(&flat).expect("a bottom");
        let height = |patch: &Patch| patch.mesh.positions.iter().fold(0.0f64, |most, p| most.max(p.z));
        assert!(height(&end) < 1e-9 && (height(&around) - 2.0).abs() < 1e-9);
        let area = end.mesh.total_area();
        assert!((area - 0.25 * std::f64::consts::PI).abs() < 0.02, "{area}");
        assert!(flat_end(&bowl(40, |far| 1.0 - (1.0 - far * far).max(0.0).sqrt())).is_none(), "a hemisphere");
        assert!(flat_end(&bowl(40, |far| 0.3 * far * far)).is_none(), "a shallow one");
        assert!(flat_end(&bowl(40, |_| 0.0)).is_none(), "a sheet reaches its rim");
    }
}
