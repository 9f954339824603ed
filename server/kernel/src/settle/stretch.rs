//! Stretches the example to tips of the input that it leaves bare: a dog's legs to a camel's feet.
//!
//! Where limbs differ in length, the shorter comes to rest with its end on the middle of the longer, and nothing pulls it on: all that
//! is near meets something. What is bare is gathered into pieces; the example's end that is nearest to the tip of each goes there,
//! with the limb free to follow, and the rest where it lies. Pieces that border on the example's rim lie beyond it, and stay bare.
//! *Ours, not a paper's.*

use super::elastic::Body;
use super::held::FramedLandmark;
use super::rest::Rest;
use super::tree::KdTree;
use super::{LaidRoughly, Manner, Setting, Settled, Settler};
use crate::mesh::Vec3;
use crate::mesh::disjoint::Sets;
use crate::numerics::stop::Stop;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A point of the input that is farther from the example's vertices, in √area of the example, is bare.
pub(super) const BARE: f64 = 0.05;
/// The tip of a piece that is bare is at least so far from them. *Untuned.*
const TIP: f64 = 0.08;
/// Tips that are reached at a time, the farthest.
const TIPS: usize = 6;
/// Bare points so near to each other, in mean distances of samples, are of one piece.
const LINKED: f64 = 2.5;
/// So many times as far as a tip is from an end, the example stays where it lies; nearer, by the square of the distance: a limb that
/// is wholly free takes along what is beside it. *Untuned.*
const FREE: f64 = 2.0;
/// Scales at which it follows, rounds at each, and the scale from which it bends thereafter.
const FOLLOWING: [(f64, usize); 4] = [(0.2, 0), (0.14, 0), (0.1, 0), (0.07, 1)];
const ROUNDS: usize = 3;
const FROM: f64 = 0.051;

/// The part of an input that an example leaves bare.
#[derive(Clone, Debug, Default)]
pub struct BareArea {
    /// The share of the input's area.
    pub share: f64,
    /// The tips of its pieces, the farthest from the example first.
    pub tips: Vec<BareTip>,
}

/// The tip of a piece of the input that is bare.
#[derive(Clone, Copy, Debug)]
pub struct BareTip {
    /// Where it is, in the example's frame.
    at: Vec3,
    /// The example's own vertex that is nearest.
    end: u32,
    /// How far the example is.
    away: f64,
}

impl Settler<'_> {
    /// Finds what an example leaves bare where it came to rest, but for what lies beyond its rim.
    pub fn bare(&self, laid: &LaidRoughly) -> BareArea {
        let places = laid.pose.deformed(&self.rest, &self.nodes[laid.level]);
        bare(&self.rest, self.between.own, &laid.setting, &places)
    }

    /// Settles it again with its ends on some of these tips; `None` when stopped.
    pub fn stretched(&self, laid: &LaidRoughly, tips: &[BareTip], stop: Stop<'_>) -> Option<(Settled, LaidRoughly)> {
        let setting = &laid.setting;
        let places = laid.pose.deformed(&self.rest, &self.nodes[laid.level]);
        let hold =
            |tip: &BareTip| FramedLandmark { corners: [(tip.end, 1.0), (tip.end, 0.0), (tip.end, 0.0)], to: tip.at };
        let held: Vec<FramedLandmark> = setting.held.iter().copied().chain(tips.iter().map(hold)).collect();
        let mut weights = vec![1.0_f64; places.len()];
        for tip in tips {
            let from = places[tip.end as usize];
            let mut seed = vec![false; places.len()];
            seed[tip.end as usize] = true;
            let reach = FREE * (tip.at - from).norm();
            let limb = self.rest.grown(seed, |v| (places[v] - from).norm() < reach);
            for (v, weight) in weights.iter_mut().enumerate().filter(|(v, _)| limb[*v]) {
                *weight = f64::min(*weight, ((places[v] - from).norm() / reach).powi(2));
            }
        }
        let (mut pose, mut level) = (laid.pose.clone(), laid.level);
        let mut body: Body<'_> = self.body(level)?;
        for (r, wanted) in FOLLOWING {
            self.change(&mut pose, &mut body, &mut level, wanted)?;
            body.follow(&mut pose, (&places, &weights), &held, (r, ROUNDS), stop)?;
        }
        let setting = Arc::new(Setting { held, ..(**setting).clone() });
        self.bend(setting, (pose, level), [0.0, FROM], Manner::Following, stop)
    }
}

/// Finds what an example leaves bare whose vertices lie at `places`, in its frame. The first `own` are its own, and one of these is
/// stretched to a tip: what is between them is not kept.
fn bare(rest: &Rest, own: usize, setting: &Setting, places: &[Vec3]) -> BareArea {
    let samples = &setting.coarse.samples;
    let coordinates = |x: &Vec3| [x.x, x.y, x.z];
    let vertices = KdTree::new(places.iter().map(coordinates));
    let ends = KdTree::new(places[..own].iter().map(coordinates));
    let points: Vec<(BareTip, f64)> = (samples.points.iter().zip(&samples.shares))
        .filter_map(|(x, share)| {
            let (_, squared) = vertices.nearest(&coordinates(x))?;
            let (end, _) = ends.nearest(&coordinates(x)).filter(|_| squared > BARE * BARE)?;
            Some((BareTip { at: *x, end, away: squared.sqrt() }, *share))
        })
        .collect();
    let link = LINKED * (setting.area / samples.points.len().max(1) as f64).sqrt();
    let mut found = BareArea::default();
    for piece in pieces(&points.iter().map(|(tip, _)| tip.at).collect::<Vec<_>>(), link) {
        let by_distance = |a: &&usize, b: &&usize| points[**a].0.away.total_cmp(&points[**b].0.away);
        let (Some(root), Some(tip)) = (piece.iter().min_by(by_distance), piece.iter().max_by(by_distance)) else {
            continue;
        };
        let (root, tip) = (points[*root].0, points[*tip].0);
        if tip.away >= TIP && !rest.rim[root.end as usize] {
            found.share += piece.iter().map(|k| points[*k].1).sum::<f64>();
            found.tips.push(tip);
        }
    }
    found.tips.sort_by(|a, b| b.away.total_cmp(&a.away));
    found.tips.truncate(TIPS);
    found
}

/// Gathers points into pieces: each is nearer than `link` to another of its piece. Their numbers, in order.
fn pieces(points: &[Vec3], link: f64) -> Vec<Vec<usize>> {
    let cell_of = |x: &Vec3| [x.x, x.y, x.z].map(|c| (c / link).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    let mut sets = Sets::new(points.len());
    for (k, x) in points.iter().enumerate() {
        let [i, j, l] = cell_of(x);
        for d in 0..27 {
            let beside = [(i, d / 9), (j, d / 3 % 3), (l, d % 3)].map(|(at, step)| at.saturating_add(step - 1));
            let near = cells.get(&beside).into_iter().flatten().filter(|other| (points[**other] - x).norm() < link);
            near.for_each(|other| sets.join(*other as u32, k as u32));
        }
        cells.entry([i, j, l]).or_default().push(k);
    }
    let mut found: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    (0..points.len()).for_each(|k| found.entry(sets.root(k as u32)).or_default().push(k));
    found.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::super::Options;
    use super::*;
    use crate::mesh::bvh::Bvh;
    use crate::mesh::tri::TriMesh;
    use crate::topology::tests::grid;

    /// A bumpy sheet of side 2 with limbs of some height at some places.
    fn sheet(n: u32, limbs: &[(f64, [f64; 2])]) -> TriMesh {
        let flat = grid(n, n, false, false);
        let bump = |p: &Vec3| 0.2 * (3.0 * p.x + 0.4).sin() * (2.9 * p.y).cos();
        let limb = |p: &Vec3| -> f64 {
            let at = |(height, [x, y]): &(f64, [f64; 2])| {
                height * (1.0 - ((p.x - x).hypot(p.y - y) / 0.3).powi(2)).max(0.0).powi(2)
            };
            limbs.iter().map(at).sum()
        };
        let place = |p: &Vec3| Vec3::new(2.0 * p.x, 2.0 * p.y, 0.0);
        let positions = flat.positions.iter().map(place).map(|p| Vec3::new(p.x, p.y, bump(&p) + limb(&p))).collect();
        TriMesh::from_triangles(positions, flat.triangles.clone()).expect("a sheet")
    }

    fn settled<'a>(example: &TriMesh, input: &'a TriMesh) -> (Settler<'a>, Settled, LaidRoughly) {
        let settler = Settler::new(example, input, 1.0, &Options::default()).expect("areas");
        let (_, rough) = settler.rough(&example.positions, Manner::Whole, &|| false).expect("laid");
        let (settled, laid) = settler.fine_from(&rough, &|| false).expect("settled");
        (settler, settled, laid)
    }

    #[test]
    fn a_limb_that_is_too_short_is_stretched_to_the_tip() {
        let (example, input) = (sheet(40, &[(0.3, [1.0, 1.0])]), sheet(90, &[(2.0, [1.0, 1.0])]));
        let (settler, before, laid) = settled(&example, &input);
        let bare = settler.bare(&laid);
        let top = |s: &Settled| s.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!(bare.tips.len() == 1 && bare.share > 0.01 && top(&before) < 1.5, "{bare:?} {}", top(&before));
        let (after, stretched) = settler.stretched(&laid, &bare.tips, &|| false).expect("settled");
        let left = settler.bare(&stretched);
        assert!(left.tips.is_empty() && top(&after) > 1.9, "{left:?} {}", top(&after));
        assert!(settler.stretched(&laid, &bare.tips, &|| true).is_none());
    }

    #[test]
    fn a_limb_beside_one_that_is_stretched_stays_where_it_lies() {
        let limbs = |height: f64| [(height, [0.7, 1.0]), (1.0, [1.35, 1.0])];
        let (example, input) = (sheet(40, &limbs(0.3)), sheet(90, &limbs(1.4)));
        let (settler, before, laid) = settled(&example, &input);
        let bare = settler.bare(&laid);
        let (after, stretched) = settler.stretched(&laid, &bare.tips, &|| false).expect("settled");
        let top = |of: &Settled, x: f64| {
            let near = of.positions.iter().filter(|p| (p.x - x).abs() < 0.2);
            near.map(|p| p.z).fold(0.0, f64::max)
        };
        let tops = [top(&before, 1.35), top(&after, 1.35), top(&after, 0.7)];
        let left = settler.bare(&stretched);
        assert!(bare.tips.len() == 1 && left.share < bare.share, "{bare:?} {left:?}");
        assert!((tops[1] - tops[0]).abs() < 0.1 && tops[2] > 1.2, "{tops:?}");
    }

    #[test]
    fn a_coarse_example_is_stretched_by_a_vertex_of_its_own() {
        let (example, input) = (sheet(10, &[(0.3, [1.0, 1.0])]), sheet(90, &[(2.0, [1.0, 1.0])]));
        let (settler, _, laid) = settled(&example, &input);
        let tips = settler.bare(&laid).tips;
        assert!(!tips.is_empty() && tips.iter().all(|tip| (tip.end as usize) < example.positions.len()), "{tips:?}");
        let (after, _) = settler.stretched(&laid, &tips, &|| false).expect("settled");
        let top = after.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!(after.places.len() == example.positions.len() && top > 1.8, "{top}");
    }

    #[test]
    fn points_that_are_linked_are_of_one_piece() {
        let at = |x: f64, y: f64| Vec3::new(x, y, -x);
        let points = [at(0.0, 0.0), at(5.0, 0.0), at(0.0, 0.9), at(5.0, 0.5), at(0.0, 1.8), at(0.0, 3.0)];
        assert_eq!(pieces(&points, 1.0), [vec![0, 2, 4], vec![1, 3], vec![5]]);
        assert!(pieces(&[], 1.0).is_empty());
    }

    #[test]
    fn what_lies_beyond_the_rim_is_no_limb() {
        let (whole, input) = (sheet(40, &[(0.3, [1.0, 1.0])]), sheet(90, &[(0.3, [1.0, 1.0])]));
        let is_in = |t: &[u32; 3]| t.iter().all(|&v| whole.positions[v as usize].x < 1.4);
        let triangles: Vec<[u32; 3]> = whole.triangles.iter().copied().filter(is_in).collect();
        let mut number = vec![u32::MAX; whole.positions.len()];
        let mut positions = Vec::new();
        for &v in triangles.iter().flatten() {
            if number[v as usize] == u32::MAX {
                number[v as usize] = positions.len() as u32;
                positions.push(whole.positions[v as usize]);
            }
        }
        let triangles = triangles.iter().map(|t| t.map(|v| number[v as usize])).collect();
        let part = TriMesh::from_triangles(positions, triangles).expect("a part");
        let (settler, before, laid) = settled(&part, &input);
        let far = Bvh::new(&TriMesh { positions: before.positions, ..part.clone() });
        assert!(input.positions.iter().any(|p| far.closest(*p).distance > 0.4), "much lies beyond it");
        assert!(settler.bare(&laid).tips.is_empty());
    }
}
