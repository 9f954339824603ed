//! Turning faces back that a blended map turned over.
//!
//! Where charts disagree their mean may fold. The vertices of a folded face, and then of its surroundings, move to the
//! mean of their neighbours and back onto the surface, until no face looks inward or the rounds are spent. *Ours.*

use std::sync::OnceLock;

use super::CrossMap;
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::{TriMesh, area_between};
use crate::unfold::Chart;

/// Rounds at most.
const ROUNDS_MAX: usize = 60;
/// Rounds after which the neighbours of a folded face's vertices move too.
const ROUNDS_ALONE: usize = 15;

/// Untangles a map of `mesh` (the example's patch) onto the mesh of `input`. `mirror` is −1 for mirrored maps, which
/// turn every face. Boundary vertices stay. `tree` is that of the input's mesh, made where it is needed and is not there yet.
/// Returns how many polygons still look inward, beside those whose vertices all lie on the boundary.
pub fn untangle(mesh: &TriMesh, cross: &mut CrossMap, input: &Chart, mirror: f64, tree: &OnceLock<Bvh>) -> usize {
    let facing = PolygonFacing::new(mesh, cross, input, mirror);
    if facing.inward().next().is_none() {
        return 0;
    }
    let bvh = tree.get_or_init(|| Bvh::new(&input.mesh));
    turn_out(facing, (mesh, cross), input, &mesh.boundary_vertices(), bvh)
}

/// The same for polygons that have a vertex which is not `fixed`; `bvh` is the tree of the input's mesh.
pub fn untangle_within(
    mesh: &TriMesh,
    cross: &mut CrossMap,
    input: &Chart,
    mirror: f64,
    (fixed, bvh): (&[bool], &Bvh),
) {
    turn_out(PolygonFacing::new(mesh, cross, input, mirror), (mesh, cross), input, fixed, bvh);
}

/// Moves the vertices that are not `fixed` until no polygon that has one looks inward, or the rounds are spent; keeps the best.
fn turn_out(
    mut facing: PolygonFacing,
    (mesh, cross): (&TriMesh, &mut CrossMap),
    input: &Chart,
    fixed: &[bool],
    bvh: &Bvh,
) -> usize {
    let neighbours = neighbours(mesh);
    let may_turn = |facing: &PolygonFacing| -> Vec<u32> {
        facing.inward().filter(|&f| facing.corners(mesh, f).any(|v| !fixed[v as usize])).collect()
    };
    let mut best: Option<(usize, CrossMap)> = None;
    for round in 0..ROUNDS_MAX {
        let folded = may_turn(&facing);
        if folded.is_empty() {
            return 0;
        }
        if best.as_ref().is_none_or(|(count, _)| folded.len() < *count) {
            best = Some((folded.len(), cross.clone()));
        }
        let mut moving: Vec<u32> = folded.iter().flat_map(|&f| facing.corners(mesh, f)).collect();
        if round >= ROUNDS_ALONE {
            let around: Vec<u32> = moving.iter().flat_map(|&v| neighbours[v as usize].iter().copied()).collect();
            moving.extend(around);
        }
        moving.sort_unstable();
        moving.dedup();
        moving.retain(|&v| !fixed[v as usize] && !neighbours[v as usize].is_empty());
        let mean = |&v: &u32| {
            let around = &neighbours[v as usize];
            around.iter().map(|&w| cross.positions[w as usize]).sum::<Vec3>() / around.len() as f64
        };
        let targets: Vec<Vec3> = moving.iter().map(mean).collect();
        for (&v, target) in moving.iter().zip(targets) {
            let closest = bvh.closest(target);
            if (closest.triangle as usize) < input.mesh.triangles.len() {
                cross.locations[v as usize] = closest.into();
                cross.positions[v as usize] = closest.point;
            }
        }
        facing.moved(mesh, cross, input, &moving);
    }
    let last = may_turn(&facing).len();
    match best {
        Some((count, state)) if count < last => {
            *cross = state;
            count
        }
        _ => last,
    }
}

/// A polygon with less than this share of the area that it would have on the input is crumpled. *Untuned.*
const CRUMPLED: f64 = 0.05;

/// A polygon that looks inward counts as so many that are crumpled: linings of eyes and mouths may be small where the input has
/// none, a limb may not be drawn into its root. *Untuned.*
const INWARD_COUNTS: usize = 8;

/// Polygons of a map that look inward or are crumpled.
pub struct FaceFlaws<'a> {
    inward: &'a [u32],
    crumpled: Vec<u32>,
}

impl<'a> FaceFlaws<'a> {
    /// Finds the polygons that are crumpled, beside those that look `inward`, in order.
    pub fn of(mesh: &TriMesh, cross: &CrossMap, inward: &'a [u32]) -> Self {
        Self { inward, crumpled: crumpled(mesh, cross) }
    }

    /// How much is wrong with some polygons: the less, the better they lie.
    pub fn among(&self, polygons: impl Iterator<Item = u32>) -> usize {
        let of = |f: u32, set: &[u32]| usize::from(set.binary_search(&f).is_ok());
        polygons.map(|f| INWARD_COUNTS * of(f, self.inward) + of(f, &self.crumpled)).sum()
    }
}

/// The polygons of `mesh` that are crumpled, in order.
fn crumpled(mesh: &TriMesh, cross: &CrossMap) -> Vec<u32> {
    let count = mesh.polygon_of.iter().max().map_or(0, |&f| f as usize + 1);
    let (mut own, mut laid) = (vec![0.0; count], vec![0.0; count]);
    for (t, (corners, &f)) in mesh.triangles.iter().zip(&mesh.polygon_of).enumerate() {
        own[f as usize] += mesh.area(t);
        laid[f as usize] += area_between(corners.map(|v| cross.positions[v as usize]));
    }
    let growth = laid.iter().sum::<f64>() / own.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let is_crumpled = |f: &u32| laid[*f as usize] < CRUMPLED * growth * own[*f as usize];
    (0..count as u32).filter(is_crumpled).collect()
}

/// How far each polygon looks out of the input: kept while vertices move, so that a round costs what it moves.
struct PolygonFacing {
    mirror: f64,
    /// The input's normal at each vertex.
    normals: Vec<Vec3>,
    /// Twice the area, signed, of each polygon: below 0 it looks inward.
    values: Vec<f64>,
    /// Triangles of polygon `f`, in order: `triangles[starts[f]..starts[f + 1]]`.
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl PolygonFacing {
    fn new(mesh: &TriMesh, cross: &CrossMap, input: &Chart, mirror: f64) -> Self {
        let count = mesh.polygon_of.iter().max().map_or(0, |&f| f as usize + 1);
        let mut starts = vec![0u32; count + 1];
        mesh.polygon_of.iter().for_each(|&f| starts[f as usize + 1] += 1);
        (0..count).for_each(|f| starts[f + 1] += starts[f]);
        let (mut filled, mut triangles) = (starts.clone(), vec![0; mesh.triangles.len()]);
        for (t, &f) in mesh.polygon_of.iter().enumerate() {
            triangles[filled[f as usize] as usize] = t as u32;
            filled[f as usize] += 1;
        }
        let normals = cross.locations.iter().map(|&l| normal_at(input, l)).collect();
        let mut facing = Self { mirror, normals, values: vec![0.0; count], starts, triangles };
        (0..count as u32).for_each(|f| facing.measure(mesh, cross, f));
        facing
    }

    fn of(&self, f: u32) -> &[u32] {
        &self.triangles[self.starts[f as usize] as usize..self.starts[f as usize + 1] as usize]
    }

    fn corners<'a>(&'a self, mesh: &'a TriMesh, f: u32) -> impl Iterator<Item = u32> + 'a {
        self.of(f).iter().flat_map(|&t| mesh.triangles[t as usize])
    }

    fn measure(&mut self, mesh: &TriMesh, cross: &CrossMap, f: u32) {
        let of = |&t: &u32| {
            let corners = mesh.triangles[t as usize];
            let [a, b, c] = corners.map(|v| cross.positions[v as usize]);
            let outward: Vec3 = corners.iter().map(|&v| self.normals[v as usize]).sum();
            self.mirror * (b - a).cross(&(c - a)).dot(&outward)
        };
        self.values[f as usize] = self.of(f).iter().map(of).sum();
    }

    /// Measures the polygons about some vertices that moved.
    fn moved(&mut self, mesh: &TriMesh, cross: &CrossMap, input: &Chart, vertices: &[u32]) {
        let mut has_moved = vec![false; self.normals.len()];
        for &v in vertices {
            has_moved[v as usize] = true;
            self.normals[v as usize] = normal_at(input, cross.locations[v as usize]);
        }
        for f in 0..self.values.len() as u32 {
            if self.corners(mesh, f).any(|v| has_moved[v as usize]) {
                self.measure(mesh, cross, f);
            }
        }
    }

    fn inward(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.values.len() as u32).filter(|&f| self.values[f as usize] < 0.0)
    }
}

/// Polygons that look into the input, in order.
pub fn inward(mesh: &TriMesh, cross: &CrossMap, input: &Chart, mirror: f64) -> Vec<u32> {
    PolygonFacing::new(mesh, cross, input, mirror).inward().collect()
}

/// Normal of the input's triangle at a place.
pub fn normal_at(input: &Chart, place: Location) -> Vec3 {
    input.mesh.area_vector(place.triangle as usize).try_normalize(0.0).unwrap_or_else(Vec3::zeros)
}

/// Polygons that a map turns over in the input's chart, in order; those wider than a quarter of a period, which are at a pole, are left
/// out. `mirror` is −1 for mirrored maps.
pub fn turned_in_domain(mesh: &TriMesh, cross: &CrossMap, input: &Chart, mirror: f64) -> Vec<u32> {
    const WIDTH_MAX: f64 = 0.25;
    let uv: Vec<[f64; 2]> = cross.locations.iter().map(|l| l.uv(input)).collect();
    let is_turned = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| uv[v as usize]);
        let beside = |x: [f64; 2]| [x[0] - a[0] - (x[0] - a[0]).round(), x[1] - a[1]];
        let (b, c) = (beside(b), beside(c));
        let is_wide = [b[0], c[0], b[0] - c[0]].iter().any(|du| du.abs() > WIDTH_MAX);
        !is_wide && mirror * (b[0] * c[1] - b[1] * c[0]) < 0.0
    };
    let turned = (0..mesh.triangles.len()).filter(|&t| is_turned(&mesh.triangles[t]));
    let mut polygons: Vec<u32> = turned.map(|t| mesh.polygon_of[t]).collect();
    polygons.sort_unstable();
    polygons.dedup();
    polygons
}

/// Neighbours along edges of polygons (phantom edges left out).
fn neighbours(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); mesh.positions.len()];
    for h in (0..mesh.twins.len() as u32).filter(|&h| !mesh.phantom[h as usize]) {
        around[mesh.tail(h) as usize].push(mesh.head(h));
        around[mesh.head(h) as usize].push(mesh.tail(h));
    }
    for list in &mut around {
        list.sort_unstable();
        list.dedup();
    }
    around
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, unfold};

    #[test]
    fn a_vertex_dragged_over_its_neighbours_comes_back() {
        let mesh = grid(12, 12, false, false);
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let place = |p: Vec3| Location::from(bvh.closest(p));
        let mut positions = mesh.positions.clone();
        positions[13 * 6 + 6] += Vec3::new(0.2, 0.03, 0.0);
        let mut cross = CrossMap { locations: positions.iter().map(|p| place(*p)).collect(), positions };
        assert!(!inward(&mesh, &cross, &chart, 1.0).is_empty());
        assert_eq!(untangle(&mesh, &mut cross, &chart, 1.0, &OnceLock::new()), 0);
    }

    #[test]
    fn what_is_drawn_into_a_point_is_crumpled_and_looks_outward() {
        let mesh = grid(12, 12, false, false);
        let chart = unfold(&whole(&mesh).expect("a disc"), &UnfoldOptions::default()).expect("solvable");
        let bvh = Bvh::new(&chart.mesh);
        let at = |place: &dyn Fn(&Vec3) -> Vec3| {
            let positions: Vec<Vec3> = mesh.positions.iter().map(place).collect();
            CrossMap { locations: positions.iter().map(|p| bvh.closest(*p).into()).collect(), positions }
        };
        let middle = mesh.positions[6 * 13 + 6];
        let is_near = |p: &Vec3| (p - middle).norm() < 0.3;
        let drawn_in = at(&|p| if is_near(p) { middle + 0.01 * (p - middle) } else { *p });
        let turned = inward(&mesh, &drawn_in, &chart, 1.0);
        assert!(turned.is_empty() && crumpled(&mesh, &drawn_in).len() > 10, "{turned:?}");
        assert!(crumpled(&mesh, &at(&|p| *p)).is_empty());
    }
}
