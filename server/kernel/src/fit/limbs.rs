//! The axes of limbs, which lead an example into another pose.
//!
//! Tips alone lead an arm straight through the air to where a bent one ends, and it settles on what is near. Its surface tells the way:
//! what is as far from a tip along the surface is a ring about the limb, however the limb is bent, and the middles of such rings are
//! points of its axis. Those of the example go to those of the input, from the tip to where the limb is no ring any more. *Ours, not a
//! paper's.*

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::mesh::Vec3;
use crate::mesh::disjoint::Sets;
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::{NONE, TriMesh};
use crate::settle::{AxisPoint, VertexLandmark};

/// Rings are so far apart, and the last is so far from its tip at most, in √area of the example.
const STEP: f64 = 0.06;
const RINGS: usize = 14;
/// A ring has at least this share of all that is as far from the tip: the rest is in small pieces beside it.
const ONE_RING: f64 = 0.9;
/// A ring about a limb is at most so many times as long as it is far from the tip; on a plane it is 2π times as long. *Untuned.*
const NARROW: f64 = 4.0;
/// Rings of which one is so many times as long as the other, in the √area of each, are none of the same limb. *Untuned.*
const ALIKE: f64 = 2.5;

/// A surface with distances along it from its tips, each found once.
pub struct TipDistances<'a> {
    pub(super) mesh: &'a TriMesh,
    marcher: Marcher<'a>,
    known: Mutex<BTreeMap<u32, Arc<Vec<f64>>>>,
}

impl<'a> TipDistances<'a> {
    /// Prepares a surface.
    pub fn new(mesh: &'a TriMesh) -> Self {
        Self { mesh, marcher: Marcher::new(mesh), known: Mutex::default() }
    }

    /// Distances of all vertices from one.
    fn from(&self, tip: u32) -> Arc<Vec<f64>> {
        let known = |tip| self.known.lock().unwrap_or_else(PoisonError::into_inner).get(&tip).cloned();
        known(tip).unwrap_or_else(|| {
            let found = Arc::new(self.marcher.distances(&[tip]));
            self.known.lock().unwrap_or_else(PoisonError::into_inner).insert(tip, Arc::clone(&found));
            found
        })
    }
}

/// A ring about a limb: all its points are as far from the limb's tip.
struct LimbRing {
    middle: Vec3,
    length: f64,
    /// Vertices beside it.
    beside: Vec<u32>,
}

/// Points of the axes of an example's limbs, with those of an input's, by tips that match.
pub fn axis_points(example: &TipDistances<'_>, input: &TipDistances<'_>, tips: &[VertexLandmark]) -> Vec<AxisPoint> {
    let ends: Vec<(u32, u32)> = tips.iter().filter_map(|tip| ends(tip, input.mesh)).collect();
    let sizes = [example, input].map(|side| side.mesh.total_area().sqrt());
    let mut found = Vec::new();
    for (k, &(own, there)) in ends.iter().enumerate() {
        let (from_own, from_there) = (example.from(own), input.from(there));
        let others = ends.iter().enumerate().filter(|(other, _)| *other != k).map(|(_, end)| *end);
        let apart = others.fold([0.0; 2], |[a, b], (v, w)| [a + from_own[v as usize], b + from_there[w as usize]]);
        let longer = apart[1] / apart[0];
        if !(longer.is_finite() && longer > 0.0) {
            continue;
        }
        let levels: Vec<f64> = (1..=RINGS).map(|n| n as f64 * STEP * sizes[0]).collect();
        let about = rings(example.mesh, &from_own, &levels);
        let with_corners: Vec<(LimbRing, [(u32, f64); 3], f64)> = about
            .into_iter()
            .flatten()
            .filter_map(|ring| {
                let corners = spanning(example.mesh, &ring)?;
                let away: f64 = corners.iter().map(|(v, w)| w * from_own[*v as usize]).sum();
                (ring.length <= NARROW * away).then_some((ring, corners, away))
            })
            .collect();
        let levels: Vec<f64> = with_corners.iter().map(|(_, _, away)| away * longer).collect();
        let around = rings(input.mesh, &from_there, &levels);
        for ((ring, corners, _), other) in with_corners.into_iter().zip(around) {
            let Some(other) = other else { continue };
            let ratio = (other.length / sizes[1]) / (ring.length / sizes[0]);
            if (1.0 / ALIKE..=ALIKE).contains(&ratio) {
                found.push(AxisPoint { corners, to: other.middle });
            }
        }
    }
    found
}

/// The vertices of example and input at which a tip is.
fn ends(tip: &VertexLandmark, input: &TriMesh) -> Option<(u32, u32)> {
    Some((tip.vertex(), tip.to.vertex(input)?))
}

/// The rings at some distances from a tip; `None` where what is as far is more than one, or nothing.
fn rings(mesh: &TriMesh, distance: &[f64], levels: &[f64]) -> Vec<Option<LimbRing>> {
    // Of each level the segments in which it crosses triangles: the edges at their ends, and the ends.
    let mut crossed: Vec<Vec<([u32; 2], [Vec3; 2])>> = vec![Vec::new(); levels.len()];
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let d = corners.map(|v| distance[v as usize]);
        let (least, most) = (d[0].min(d[1]).min(d[2]), d[0].max(d[1]).max(d[2]));
        if !most.is_finite() {
            continue;
        }
        for (level, crossed) in levels.iter().zip(&mut crossed).filter(|(l, _)| least < **l && **l <= most) {
            let mut ends = (0..3).filter_map(|k| {
                let (a, b) = (k, (k + 1) % 3);
                if (d[a] < *level) == (d[b] < *level) {
                    return None;
                }
                let half = (3 * t + k) as u32;
                let twin = mesh.twin(half);
                let edge = if twin == NONE { half } else { half.min(twin) };
                let share = (level - d[a]) / (d[b] - d[a]);
                let [from, to] = [a, b].map(|k| mesh.positions[corners[k] as usize]);
                Some((edge, from + (to - from) * share))
            });
            if let (Some(one), Some(two)) = (ends.next(), ends.next()) {
                crossed.push(([one.0, two.0], [one.1, two.1]));
            }
        }
    }
    crossed.iter().map(|segments| ring(mesh, segments)).collect()
}

fn ring(mesh: &TriMesh, segments: &[([u32; 2], [Vec3; 2])]) -> Option<LimbRing> {
    let mut number: BTreeMap<u32, u32> = BTreeMap::new();
    for edge in segments.iter().flat_map(|s| s.0) {
        let next = number.len() as u32;
        number.entry(edge).or_insert(next);
    }
    let mut sets = Sets::new(number.len());
    segments.iter().for_each(|(edges, _)| sets.join(number[&edges[0]], number[&edges[1]]));
    let mut lengths: BTreeMap<u32, f64> = BTreeMap::new();
    let length = |ends: &[Vec3; 2]| (ends[1] - ends[0]).norm();
    for (edges, ends) in segments {
        *lengths.entry(sets.root(number[&edges[0]])).or_default() += length(ends);
    }
    let all: f64 = lengths.values().sum();
    let (&root, &longest) = lengths.iter().max_by(|a, b| a.1.total_cmp(b.1))?;
    if !(longest >= ONE_RING * all && longest > 0.0) {
        return None;
    }
    let mut ring = LimbRing { middle: Vec3::zeros(), length: longest, beside: Vec::new() };
    for (edges, ends) in segments {
        if sets.root(number[&edges[0]]) == root {
            ring.middle += (ends[0] + ends[1]) * (0.5 * length(ends) / longest);
            ring.beside.extend(edges.iter().map(|&half| mesh.tail(half)));
        }
    }
    Some(ring)
}

/// Three vertices beside a ring with weights that bring them near its middle; `None` where they are no triangle.
fn spanning(mesh: &TriMesh, ring: &LimbRing) -> Option<[(u32, f64); 3]> {
    let at = |v: u32| mesh.positions[v as usize];
    let farthest =
        |from: &dyn Fn(Vec3) -> f64| ring.beside.iter().copied().max_by(|&a, &b| from(at(a)).total_cmp(&from(at(b))));
    let one = farthest(&|p| (p - ring.middle).norm())?;
    let two = farthest(&|p| (p - at(one)).norm())?;
    let three = farthest(&|p| (p - at(one)).cross(&(p - at(two))).norm())?;
    let (a, b, to) = (at(two) - at(one), at(three) - at(one), ring.middle - at(one));
    let normal = a.cross(&b);
    let area = normal.norm_squared();
    if area.is_nan() || area <= 0.0 {
        return None;
    }
    let (second, third) = (to.cross(&b).dot(&normal) / area, a.cross(&to).dot(&normal) / area);
    let weights = [1.0 - second - third, second, third];
    let is_within = weights.iter().all(|w| (0.1..=0.8).contains(w));
    let weights = if is_within { weights } else { [1.0 / 3.0; 3] };
    Some([(one, weights[0]), (two, weights[1]), (three, weights[2])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::bvh::Bvh;
    use crate::topology::tests::grid;

    const RADIUS: f64 = 0.08;

    /// A point at some way along a tube that is bent in its middle by a quarter turn, or straight, and its axis there.
    fn along(s: f64, bent: bool) -> (Vec3, Vec3) {
        match bent && s > 0.5 {
            true => (Vec3::new(0.5, s - 0.5, 0.0), Vec3::new(-1.0, 0.0, 0.0)),
            false => (Vec3::new(s, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)),
        }
    }

    /// A tube of length 1.
    fn tube(around: u32, rows: u32, bent: bool) -> TriMesh {
        let flat = grid(around, rows, true, false);
        let place = |p: &Vec3| {
            let (angle, s) = (p.y.atan2(p.x), p.z / 3.0);
            let (middle, side) = along(s, bent);
            middle + side * (RADIUS * angle.cos()) + Vec3::new(0.0, 0.0, RADIUS * angle.sin())
        };
        TriMesh::from_triangles(flat.positions.iter().map(place).collect(), flat.triangles.clone()).expect("a tube")
    }

    fn tips(example: &TriMesh, input: &TriMesh) -> Vec<VertexLandmark> {
        let trees = (Bvh::new(example), Bvh::new(input));
        let tip = |s: f64| {
            let end = |bent: bool| along(s, bent).0 + along(s, bent).1 * RADIUS;
            VertexLandmark::between(example, &trees.0.closest(end(false)), trees.1.closest(end(true)))
        };
        [0.0, 1.0].into_iter().filter_map(tip).collect()
    }

    #[test]
    fn axes_go_around_an_elbow() {
        let (example, input) = (tube(12, 24, false), tube(20, 70, true));
        let tips = tips(&example, &input);
        let found = axis_points(&TipDistances::new(&example), &TipDistances::new(&input), &tips);
        assert!(found.len() >= 8, "{}", found.len());
        for point in found {
            let s: f64 = point.corners.iter().map(|(v, w)| example.positions[*v as usize].x * w).sum();
            let off = (along(s, true).0 - point.to).norm();
            // A ring is as far from a tip at one side of the rim, and so is slanted; it is less so on both sides alike.
            assert!(off < 0.08, "{s}: {off}");
        }
    }

    #[test]
    fn what_is_two_rings_has_no_axis() {
        // As far from the middle of a tube are two rings.
        let tube = tube(12, 40, false);
        let side = TipDistances::new(&tube);
        let middle = (0..tube.positions.len() as u32).min_by(|&a, &b| {
            let away = |v: u32| (tube.positions[v as usize] - Vec3::new(0.5, RADIUS, 0.0)).norm();
            away(a).total_cmp(&away(b))
        });
        let distance = side.from(middle.expect("a vertex"));
        let found = rings(&tube, &distance, &[0.35, 0.45]);
        assert!(found.iter().all(Option::is_none));
        let from_end = side.from(0);
        assert!(rings(&tube, &from_end, &[0.35, 0.45, 9.0]).iter().map(Option::is_some).eq([true, true, false]));
    }
}
