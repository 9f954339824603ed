//! How vertices follow a point that is moved along the surface. *Ours, not the paper's.*

use crate::encode::index::Location;
use crate::map::CrossMap;
use crate::map::snap::Targets;
use crate::map::snap::spread::{neighbours, turned};
use crate::map::untangle::normal_at;
use crate::map::walk::walk;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::geodesic::Marcher;
use crate::unfold::Chart;

/// Steps of a way along the surface at most.
const STEPS: usize = 16;
/// A point has arrived where no more than this share of its way is left.
const ARRIVED: f64 = 0.05;
/// A way along the surface is at most so many times as long as the straight one; else there is none.
const DETOUR: f64 = 4.0;
/// Walks of the corners that hold a point until it is where it is to be.
const WALKS: usize = 6;

/// A corner of the face that holds a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct HoldingCorner {
    /// The vertex.
    pub(super) vertex: u32,
    /// Its barycentric weight.
    pub(super) share: f64,
    /// It moves with the point.
    pub(super) moves: bool,
}

/// How much of a point the corners hold that move.
pub(super) fn shares(held: &[HoldingCorner; 3]) -> f64 {
    held.iter().filter(|corner| corner.moves).map(|corner| corner.share).sum()
}

/// A point that was moved.
#[derive(Clone, Debug)]
pub(super) struct MovedPoint {
    /// Direction in which it leaves, times the length of its way along the surface.
    pub(super) way: Vec3,
    /// The input's normal where it leaves.
    normal: Vec3,
    /// The corners that moved, and where they are.
    corners: Vec<(u32, Location)>,
}

/// A map whose vertices follow points that are moved.
pub(super) struct Follow<'a> {
    /// The map.
    pub(super) cross: &'a CrossMap,
    /// The input.
    pub(super) input: &'a Chart,
    /// Its mesh's tree.
    pub(super) bvh: &'a Bvh,
    /// Distances on the example where it is laid.
    pub(super) marcher: &'a Marcher<'a>,
}

/// Tells how vertices would follow one point.
struct PointInfluence {
    /// Distance of each from the point along the surface; infinite beyond its reach.
    distances: Vec<f64>,
    /// The point's way, carried to each vertex.
    ways: Vec<Vec3>,
}

impl Follow<'_> {
    /// Moves a point with the corners that hold it. They walk along the surface, so that none jumps to a sheet that is near in space only;
    /// where there is no way, they jump.
    pub(super) fn moved(&self, held: &[HoldingCorner; 3], to: Vec3) -> MovedPoint {
        let start = held.map(|corner| self.cross.locations[corner.vertex as usize]);
        let share = shares(held);
        let left = |at: &[Location; 3]| to - (0..3).map(|k| at[k].point(self.input) * held[k].share).sum::<Vec3>();
        let stepped = |at: &[Location; 3], step: &dyn Fn(Location) -> Location| {
            let mut next = *at;
            (0..3).filter(|k| held[*k].moves).for_each(|k| next[k] = step(at[k]));
            next
        };
        let point = (0..3).map(|k| self.cross.positions[held[k].vertex as usize] * held[k].share).sum::<Vec3>();
        let from = self.bvh.closest(point).into();
        let (chord, normal) = (left(&start), normal_at(self.input, from));
        let way = self.straight(from, to).or_else(|| self.around(held, (point, to)));
        let way_there = way.unwrap_or(chord) / share;
        let carried = |at: Location| walk(&self.input.mesh, at, turned(way_there, normal, normal_at(self.input, at)));
        let mut at = stepped(&start, &carried);
        if left(&at).norm() > chord.norm() {
            at = start;
        }
        for _ in 0..WALKS {
            let rest = left(&at) / share;
            let next = stepped(&at, &|from| walk(&self.input.mesh, from, rest));
            if left(&next).norm() >= left(&at).norm() {
                break;
            }
            at = next;
        }
        if left(&at).norm() > ARRIVED * chord.norm() {
            let jumped = stepped(&start, &|from| self.bvh.closest(from.point(self.input) + chord / share).into());
            if left(&jumped).norm() < left(&at).norm() {
                at = jumped;
            }
        }
        let corners = (0..3).filter(|k| held[*k].moves).map(|k| (held[k].vertex, at[k])).collect();
        MovedPoint { way: way_there, normal, corners }
    }

    /// The way from a place to a point, if always going towards it gets there.
    fn straight(&self, from: Location, to: Vec3) -> Option<Vec3> {
        let chord = to - from.point(self.input);
        let (mut at, mut first, mut length) = (from, Vec3::zeros(), 0.0);
        for _ in 0..STEPS {
            let (step, normal) = (to - at.point(self.input), normal_at(self.input, at));
            if step.norm() <= ARRIVED * chord.norm() {
                break;
            }
            let along = step - normal * normal.dot(&step);
            if first == Vec3::zeros() {
                first = along;
            }
            length += along.norm();
            at = walk(&self.input.mesh, at, along);
        }
        let has_arrived = (to - at.point(self.input)).norm() <= ARRIVED * chord.norm();
        has_arrived.then(|| first.try_normalize(0.0).unwrap_or_default() * length)
    }

    /// The way from one point to another where it goes around an edge: down the slope of the distance from its end.
    fn around(&self, held: &[HoldingCorner; 3], (point, to): (Vec3, Vec3)) -> Option<Vec3> {
        let mesh = self.marcher.mesh();
        let nearest = |v: &u32| (mesh.positions[*v as usize] - to).norm_squared();
        let end = (0..mesh.positions.len() as u32).min_by(|a, b| nearest(a).total_cmp(&nearest(b)))?;
        let distances = self.marcher.distances_within(&[end], DETOUR * (to - point).norm());
        let [a, b, c] = held.map(|corner| mesh.positions[corner.vertex as usize]);
        let [da, db, dc] = held.map(|corner| distances[corner.vertex as usize]);
        let (e, f) = (b - a, c - a);
        let normal = e.cross(&f);
        // The gradient of a linear function on a triangle.
        let slope = (f.cross(&normal) * (db - da) + normal.cross(&e) * (dc - da)) / normal.norm_squared();
        let length = da * held[0].share + db * held[1].share + dc * held[2].share;
        slope.try_normalize(0.0).filter(|s| s.iter().all(|x| x.is_finite())).map(|s| -s * length)
    }

    /// The map with what was moved where it goes, and those within `reach` moved along; and where what was moved is. Each vertex
    /// follows every point, the nearest most; the boundary is one that stays.
    pub(super) fn all(&self, moved: &[MovedPoint], border: &[bool], reach: f64) -> (CrossMap, Targets) {
        let targets: Targets = moved.iter().flat_map(|one| one.corners.iter().copied()).collect();
        let rim: Vec<u32> = (0..border.len() as u32).filter(|&v| border[v as usize]).collect();
        let stays = PointInfluence {
            distances: self.marcher.distances_within(&rim, reach),
            ways: vec![Vec3::zeros(); border.len()],
        };
        let all: Vec<PointInfluence> = moved.iter().map(|one| self.following(one, reach)).chain([stays]).collect();
        let mut out = self.cross.clone();
        for (&v, place) in &targets {
            (out.locations[v as usize], out.positions[v as usize]) = (*place, place.point(self.input));
        }
        let is_free = |v: &usize| !border[*v] && !targets.contains_key(&(*v as u32));
        for v in (0..border.len()).filter(is_free) {
            let (mut sum, mut weights) = (Vec3::zeros(), 0.0);
            for PointInfluence { distances, ways } in all.iter().filter(|of| of.distances[v].is_finite()) {
                let (x, weight) = (1.0 - distances[v] / reach, distances[v].powi(2).max(f64::MIN_POSITIVE).recip());
                sum += ways[v] * (weight * x * x * (3.0 - 2.0 * x));
                weights += weight;
            }
            if sum != Vec3::zeros() {
                let place = walk(&self.input.mesh, self.cross.locations[v], sum / weights);
                (out.locations[v], out.positions[v]) = (place, place.point(self.input));
            }
        }
        (out, targets)
    }

    /// How what is within `reach` of a point would follow it. Each vertex carries the mean of what its nearer neighbours carry, turned as
    /// the input's normal turns from them to it.
    fn following(&self, moved: &MovedPoint, reach: f64) -> PointInfluence {
        let normal = |v: u32| normal_at(self.input, self.cross.locations[v as usize]);
        let group: Vec<u32> = moved.corners.iter().map(|(v, _)| *v).collect();
        let distances = self.marcher.distances_within(&group, reach);
        let mut ways = vec![Vec3::zeros(); distances.len()];
        for &v in &group {
            ways[v as usize] = turned(moved.way, moved.normal, normal(v));
        }
        if moved.way == Vec3::zeros() {
            return PointInfluence { distances, ways };
        }
        let near: Vec<u32> = (0..distances.len() as u32).filter(|&v| distances[v as usize].is_finite()).collect();
        let around = neighbours(self.marcher.mesh(), &near);
        let mut order: Vec<usize> = (0..near.len()).filter(|&i| distances[near[i] as usize] > 0.0).collect();
        order.sort_by(|&a, &b| distances[near[a] as usize].total_cmp(&distances[near[b] as usize]));
        for i in order {
            let v = near[i];
            let to = normal(v);
            let carried = |&w: &u32| turned(ways[w as usize], normal(w), to);
            let nearer = || around[i].iter().filter(|&&w| distances[w as usize] < distances[v as usize]);
            ways[v as usize] = nearer().map(carried).sum::<Vec3>() / nearer().count().max(1) as f64;
        }
        PointInfluence { distances, ways }
    }
}
