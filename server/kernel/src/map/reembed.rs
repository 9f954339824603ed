//! Letting a map come to rest: polish, and folded regions laid anew.
//!
//! Where a map looks inward its region, widened by some rings, is a sheet of the example whose rim is laid well. In one
//! chart of the input, in the equal-area picture about its nearer pole, each inner vertex takes the weighted mean of its
//! neighbours, x_v = Σ w_vj x_j / Σ w_vj with w_vj = (tan α/2 + tan β/2)/|x_v − x_j| on the example. All w > 0, so that
//! over a convex rim nothing folds.
//! *Source:* Tutte, *How to draw a graph* (1963); Floater, *Mean value coordinates* (2003). *Ours, not the paper's:* in
//! the chart that presses the region least, so that no vertex is drawn from one finger to the next.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use super::CrossMap;
use super::polish::{PolishOptions, polish};
use super::untangle::{FaceFlaws, inward, untangle};
use crate::encode::index::PlanarIndex;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::topology::{self, Topology};
use crate::unfold::relax::half_tangent;
use crate::unfold::{Chart, Uv, signed_area};

/// Times at most that a map is polished, and then what still looks inward laid anew.
const PASSES_MAX: usize = 2;
/// Rings about the folded faces, each tried on what the one before left.
const RINGS: [usize; 4] = [2, 4, 8, 12];
/// Largest share of the example's triangles that one region may take: a wider one is too much to lay by its rim.
const REGION_MAX: f64 = 0.1;
/// Sweeps over a region at most, and the step (in the picture, whose radius is 1) at which it has come to rest.
const SWEEPS_MAX: usize = 1_000;
const AT_REST: f64 = 1e-9;

/// A chart of the input that places are looked up in. All share one mesh.
pub struct InputChart<'a> {
    /// The chart: of a disc or a sphere.
    pub chart: &'a Chart,
    /// Its planar index.
    pub index: &'a PlanarIndex,
}

/// Polishes a map of `mesh` (the example's patch), and lays anew what looks inward before and after. `mirror` is −1 for
/// mirrored maps. The boundary stays. Returns how many polygons still look inward.
pub fn settle(mesh: &TriMesh, cross: &mut CrossMap, grounds: &[InputChart], mirror: f64) -> usize {
    let Some(first) = grounds.first() else { return 0 };
    let tree = OnceLock::new();
    let mut left = lay_anew(mesh, cross, grounds, mirror);
    for _ in 0..PASSES_MAX {
        polish(mesh, cross, first.chart, mirror, &PolishOptions::default());
        left = untangle(mesh, cross, first.chart, mirror, &tree);
        if left > 0 {
            left = lay_anew(mesh, cross, grounds, mirror);
        }
        if left == 0 {
            break;
        }
    }
    left
}

/// Turns back the faces of a map that look inward, and lays the regions of `mesh` anew where that is not enough. The boundary stays.
/// `tree` is that of the input's mesh, made where it is needed and is not there yet.
pub fn turn_back(mesh: &TriMesh, cross: &mut CrossMap, ground: &InputChart, mirror: f64, tree: &OnceLock<Bvh>) {
    if untangle(mesh, cross, ground.chart, mirror, tree) > 0 {
        lay_anew(mesh, cross, std::slice::from_ref(ground), mirror);
    }
}

/// Lays the regions of `mesh` anew whose faces look inward; one that does not get better by it stays. Only on discs and
/// spheres. Returns how many polygons still look inward.
fn lay_anew(mesh: &TriMesh, cross: &mut CrossMap, grounds: &[InputChart], mirror: f64) -> usize {
    let Some(first) = grounds.first() else { return 0 };
    let mut turned = inward(mesh, cross, first.chart, mirror);
    if !matches!(first.chart.topology, Topology::Disc | Topology::Sphere) {
        return turned.len();
    }
    for rings in RINGS {
        if turned.is_empty() {
            break;
        }
        let mut regions = regions(mesh, &turned, rings);
        regions.retain(|r| r.triangles.len() as f64 <= REGION_MAX * mesh.triangles.len() as f64);
        if regions.is_empty() {
            continue;
        }
        let before = cross.clone();
        for region in &regions {
            region.lay(mesh, cross, grounds);
        }
        let after = inward(mesh, cross, first.chart, mirror);
        let [is, was] = [FaceFlaws::of(mesh, cross, &after), FaceFlaws::of(mesh, &before, &turned)];
        regions.retain(|region| {
            let polygons = region.polygons(mesh);
            is.among(polygons.iter().copied()) >= was.among(polygons.iter().copied())
        });
        for &v in regions.iter().flat_map(|no_better| &no_better.inner) {
            cross.locations[v as usize] = before.locations[v as usize];
            cross.positions[v as usize] = before.positions[v as usize];
        }
        turned = if regions.is_empty() { after } else { inward(mesh, cross, first.chart, mirror) };
    }
    turned.len()
}

/// A connected part of the example about faces that look inward.
struct InwardRegion {
    triangles: Vec<u32>,
    /// Vertices that may move, in order: no triangle outside the region touches them.
    inner: Vec<u32>,
}

fn regions(mesh: &TriMesh, turned: &[u32], rings: usize) -> Vec<InwardRegion> {
    let mut inside: Vec<bool> = mesh.polygon_of.iter().map(|f| turned.binary_search(f).is_ok()).collect();
    topology::widen(mesh, &mut inside, rings);
    let mut fixed = mesh.boundary_vertices();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        corners.iter().for_each(|&v| fixed[v as usize] |= !inside[t]);
    }
    let region = |triangles: Vec<u32>| {
        let corners = triangles.iter().flat_map(|&t| mesh.triangles[t as usize]);
        let mut inner: Vec<u32> = corners.filter(|&v| !fixed[v as usize]).collect();
        inner.sort_unstable();
        inner.dedup();
        InwardRegion { triangles, inner }
    };
    topology::connected(mesh, &inside).into_iter().filter(|set| inside[set[0] as usize]).map(region).collect()
}

impl InwardRegion {
    /// Its polygons, in order.
    fn polygons(&self, mesh: &TriMesh) -> Vec<u32> {
        let mut own: Vec<u32> = self.triangles.iter().map(|&t| mesh.polygon_of[t as usize]).collect();
        own.sort_unstable();
        own.dedup();
        own
    }

    fn lay(&self, mesh: &TriMesh, cross: &mut CrossMap, grounds: &[InputChart]) {
        let pressed = |s: &&InputChart| self.pressed(cross, s.chart);
        let Some(sheet) = grounds.iter().min_by(|a, b| pressed(a).total_cmp(&pressed(b))) else { return };
        let picture = self.picture(cross, sheet.chart);
        let mut at: Vec<[f64; 2]> = vec![[0.0; 2]; mesh.positions.len()];
        for &v in self.triangles.iter().flat_map(|&t| &mesh.triangles[t as usize]) {
            at[v as usize] = picture.flat(cross.locations[v as usize].uv(sheet.chart));
        }
        let weights = self.weights(mesh);
        for _ in 0..SWEEPS_MAX {
            let mut moved = 0.0f64;
            for (&v, around) in self.inner.iter().zip(&weights) {
                let all: f64 = around.iter().map(|(_, w)| w).sum();
                let mean = |k: usize| around.iter().map(|&(j, w)| w * at[j as usize][k]).sum::<f64>() / all;
                let to = [mean(0), mean(1)];
                moved = moved.max((to[0] - at[v as usize][0]).abs() + (to[1] - at[v as usize][1]).abs());
                at[v as usize] = to;
            }
            if moved < AT_REST {
                break;
            }
        }
        for &v in &self.inner {
            let place = sheet.index.locate(sheet.chart, picture.uv(at[v as usize]));
            (cross.locations[v as usize], cross.positions[v as usize]) = (place, place.point(sheet.chart));
        }
    }

    /// How much a chart presses the surface together where the region lies: mean of log₂ of area per area of the domain.
    fn pressed(&self, cross: &CrossMap, chart: &Chart) -> f64 {
        let of = |v: &u32| {
            let t = cross.locations[*v as usize].triangle as usize;
            (chart.mesh.area(t).max(1e-300) / signed_area(&chart.corners[t]).abs().max(1e-300)).log2()
        };
        self.inner.iter().map(of).sum::<f64>() / self.inner.len().max(1) as f64
    }

    fn picture(&self, cross: &CrossMap, chart: &Chart) -> EqualAreaDisc {
        let height = |v: &u32| cross.locations[*v as usize].uv(chart)[1];
        let mean = self.inner.iter().map(height).sum::<f64>() / self.inner.len().max(1) as f64;
        EqualAreaDisc::about(chart, mean)
    }

    /// Mean value weights of the neighbours of each inner vertex.
    fn weights(&self, mesh: &TriMesh) -> Vec<Vec<(u32, f64)>> {
        let mut weights: Vec<Vec<(u32, f64)>> = vec![Vec::new(); self.inner.len()];
        for &t in &self.triangles {
            let corners = mesh.triangles[t as usize];
            for k in 0..3 {
                let (v, a, b) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
                let Ok(i) = self.inner.binary_search(&v) else { continue };
                let [x, p, q] = [v, a, b].map(|v| mesh.positions[v as usize]);
                let tangent = half_tangent(p - x, q - x);
                for (j, y) in [(a, p), (b, q)] {
                    let w = tangent / (y - x).norm().max(1e-300);
                    match weights[i].iter_mut().find(|(other, _)| *other == j) {
                        Some(entry) => entry.1 += w,
                        None => weights[i].push((j, w)),
                    }
                }
            }
        }
        weights
    }
}

/// The equal-area picture about one end of a chart: r² is the share of the area nearer to that end.
pub(super) struct EqualAreaDisc {
    about_top: bool,
}

impl EqualAreaDisc {
    /// About the end of a disc's or sphere's chart that is nearer to `v`; discs have but one.
    pub(super) fn about(chart: &Chart, v: f64) -> Self {
        Self { about_top: chart.topology == Topology::Disc || v >= 0.5 }
    }

    pub(super) fn flat(&self, [u, v]: Uv) -> [f64; 2] {
        let r = (if self.about_top { 1.0 - v } else { v }).max(0.0).sqrt();
        let (sin, cos) = (TAU * u).sin_cos();
        [r * cos, r * sin]
    }

    pub(super) fn uv(&self, [x, y]: [f64; 2]) -> Uv {
        let area = (x * x + y * y).min(1.0);
        [(y.atan2(x) / TAU).rem_euclid(1.0), if self.about_top { 1.0 - area } else { area }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::index::Location;
    use crate::mesh::Vec3;
    use crate::mesh::bvh::Bvh;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    /// A sheet mapped onto itself, all vertices near its middle thrown to the other side of it.
    fn turned_about() -> (TriMesh, Chart, CrossMap) {
        let mesh = grid(40, 40, false, false);
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let middle = 0.5 * (mesh.positions[0] + mesh.positions[41 * 41 - 1]);
        let turned = |p: &Vec3| {
            let from = p - middle;
            let near = from.norm() < 0.06;
            let c = bvh.closest(if near { middle + Vec3::new(-from.x, from.y, from.z) } else { *p });
            (Location::from(c), c.point)
        };
        let (locations, positions) = mesh.positions.iter().map(turned).unzip();
        (mesh, chart, CrossMap { locations, positions })
    }

    #[test]
    fn a_region_that_is_turned_over_is_laid_anew() {
        let (mesh, chart, mut cross) = turned_about();
        let index = PlanarIndex::new(&chart);
        assert!(inward(&mesh, &cross, &chart, 1.0).len() > 10);
        assert_eq!(lay_anew(&mesh, &mut cross, &[InputChart { chart: &chart, index: &index }], 1.0), 0);
        for (v, location) in cross.locations.iter().enumerate() {
            assert!((location.point(&chart) - cross.positions[v]).norm() < 1e-12);
        }
    }

    #[test]
    fn a_map_without_folds_is_only_polished() {
        let (mesh, chart, _) = turned_about();
        let bvh = Bvh::new(&chart.mesh);
        let at = |p: &Vec3| {
            let c = bvh.closest(*p);
            (Location::from(c), c.point)
        };
        let (locations, positions): (Vec<Location>, Vec<Vec3>) = mesh.positions.iter().map(at).unzip();
        let mut cross = CrossMap { locations, positions };
        let index = PlanarIndex::new(&chart);
        assert_eq!(settle(&mesh, &mut cross, &[InputChart { chart: &chart, index: &index }], 1.0), 0);
        let off = mesh.positions.iter().zip(&cross.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(off < 1e-6, "{off}");
    }
}
