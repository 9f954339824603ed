//! Lays crumpled regions of a net anew.
//!
//! A vertex that is put on the nearest place of the surface, as the neighbours of a tip are when that is moved to
//! cover an ear ([`cover`](super::cover)), may land on the other side of it; the quads around it then look away from
//! the surface. Faces that look away, or pass over the surface, widened by some rings, form a disc of the net whose
//! rim lies well. The surface to the left of the rim is a disc too ([`region`]). Both are mapped to the unit disc:
//! the surface by a harmonic map with its border on the circle, the net by Tutte's embedding, whose rim is where the
//! surface's map has it. Each inner vertex goes to the place of the surface that has its image. A net of squares has
//! a uniform embedding that is nearly conformal, as the surface's map is, so that rings around the tip of an ear stay
//! rings.
//! *Source:* Tutte, *How to draw a graph* (1963). *Ours, not the paper's:* on a region that looks away.

mod disc;
mod region;

use super::net::{Fans, Net};
use super::optimise::optimise;
use super::smooth::Target;
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::facing::{Facing, TurnedArea};
use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::{many_in_halves, stop};
use disc::{harmonic, tutte};
use region::Surroundings;
use std::collections::BTreeSet;

/// Rings around flawed faces, each tried where the one before did not mend them. *Untuned*; eight mend few regions and take half of the
/// time, but without them a face seen from the front has angles of 21.9° in place of 16.3° (`tests/records/field-2026-11-27.md`).
const RINGS: [usize; 5] = [1, 2, 3, 5, 8];
/// Times that all is looked through.
const PASSES: usize = 2;
/// Share of a flaw that may be left for a region to be mended. *Untuned.*
const HALF: f64 = 0.5;
/// Share of a face that looks away, from which on it is laid anew. *Untuned.*
const AWAY: f64 = 0.3;
/// Largest share of the net's faces that one region may have: a wider one is more than its rim can tell. *Untuned.*
const REGION_MAX: f64 = 0.25;
/// A region that is laid anew with so many times the flaw it had is not evened out: of 536 such regions 16 were better thereafter, and
/// evening them out took three fifths of the time (tests/records/threads-2026-11-28.md).
const HOPELESS: f64 = 2.0;
/// Rounds of optimisation of what was laid anew. *Untuned.*
const ROUNDS: u32 = 40;

/// Lays the regions of a net anew that look away from the surface, or pass over it by more than `passed`, where less of them
/// does so then; the net's boundary stays, and so does what `stays`. `points` are spread evenly over the surface.
pub(super) fn reembed(
    net: &mut Net,
    points: &[Vec3],
    (surface, target): (&TriMesh, &Target),
    passed: f64,
    stays: &dyn Fn(Vec3) -> bool,
) {
    let looks = FlawFinder::new(net, surface, target, passed);
    let surroundings = Surroundings::new(surface, target.tree());
    for _ in 0..PASSES {
        let (flawed, nearest) = looks.flawed(net, points);
        let mut next_to: Vec<Vec<u32>> = vec![Vec::new(); net.face_slots()];
        for (k, &face) in nearest.iter().enumerate().filter(|(_, face)| **face != NONE) {
            next_to[face as usize].push(k as u32);
        }
        for faces in connected(net, flawed) {
            // The flaw goes with a rim that lies well: of one farther out more of the layout moves.
            for rings in RINGS {
                stop::ask();
                let Some(patch) = FaceDisc::around(net, &faces, rings) else { continue };
                if patch.inner.iter().any(|&v| stays(net.positions[v as usize])) {
                    break;
                }
                let mut own: Vec<u32> = patch.faces.iter().flat_map(|&f| next_to[f as usize].iter().copied()).collect();
                own.sort_unstable();
                let own: Vec<Vec3> = own.into_iter().map(|k| points[k as usize]).collect();
                if patch.mend(net, &own, (target, &looks, &surroundings)) {
                    break;
                }
            }
        }
    }
}

/// Finds the faces of a net that are flawed.
struct FlawFinder<'a> {
    facing: Facing<'a>,
    /// Distance from which on a point of the surface is passed over.
    passed: f64,
}

impl<'a> FlawFinder<'a> {
    fn new(net: &Net, surface: &'a TriMesh, target: &'a Target, passed: f64) -> Self {
        let edge = (surface.total_area() / net.faces().count().max(1) as f64).sqrt();
        Self { facing: Facing::new(surface, target.tree(), edge), passed }
    }

    fn of(&self, net: &Net, face: u32) -> TurnedArea {
        let corners: Vec<Vec3> = net.face(face).iter().map(|&v| net.positions[v as usize]).collect();
        self.facing.turned(&corners)
    }

    /// The faces that look away, and those next to points of the surface that are passed over; and the face next to each point.
    fn flawed(&self, net: &Net, points: &[Vec3]) -> (BTreeSet<u32>, Vec<u32>) {
        let faces: Vec<u32> = net.faces().map(|(f, _)| f).collect();
        let away = many_in_halves(&faces, |&f| self.of(net, f).share() > AWAY);
        let mut found: BTreeSet<u32> = faces.into_iter().zip(away).filter(|(_, away)| *away).map(|(f, _)| f).collect();
        let fans = net.fans();
        let tree = Bvh::new(&fans.mesh);
        let mut nearest = Vec::with_capacity(points.len());
        for near in tree.closest_to_all(points) {
            let face = fans.face.get(near.triangle as usize).copied().unwrap_or(NONE);
            nearest.push(face);
            if near.distance > self.passed && face != NONE {
                found.insert(face);
            }
        }
        (found, nearest)
    }

    /// The share of some faces' area that looks away, and that of some points of the surface that they pass over.
    fn flaw(&self, net: &Net, faces: &BTreeSet<u32>, points: &[Vec3]) -> f64 {
        let mut all = TurnedArea::default();
        let faces: Vec<u32> = faces.iter().copied().collect();
        many_in_halves(&faces, |&f| self.of(net, f)).into_iter().for_each(|turned| all.add(turned));
        let tree = Bvh::new(&Fans::of(&net.positions, faces.iter().map(|&f| (f, net.face(f)))).mesh);
        let passed = tree.closest_to_all(points).iter().filter(|near| near.distance > self.passed).count();
        all.share() + passed as f64 / points.len().max(1) as f64
    }
}

/// A disc of a net's faces.
struct FaceDisc {
    faces: BTreeSet<u32>,
    /// Its rim, with the faces on the left.
    rim: Vec<u32>,
    /// The vertices within the rim, in order.
    inner: Vec<u32>,
}

/// The faces that share a corner with one.
fn around(net: &Net, face: u32) -> impl Iterator<Item = u32> {
    net.face(face).iter().flat_map(|&v| net.at(v).iter().copied())
}

/// Some faces in sets that are connected by corners, the largest first.
fn connected(net: &Net, mut left: BTreeSet<u32>) -> Vec<BTreeSet<u32>> {
    let mut found = Vec::new();
    while let Some(first) = left.pop_first() {
        let (mut faces, mut front) = (BTreeSet::new(), vec![first]);
        while let Some(f) = front.pop() {
            faces.insert(f);
            front.extend(around(net, f).filter(|g| left.remove(g)));
        }
        found.push(faces);
    }
    found.sort_by_key(|faces| std::cmp::Reverse(faces.len()));
    found
}

/// The faces that some faces enclose: sets of fewer than they are themselves, with nothing beyond.
fn enclosed(net: &Net, faces: &BTreeSet<u32>) -> BTreeSet<u32> {
    let mut found = BTreeSet::new();
    let mut outside: BTreeSet<u32> =
        faces.iter().flat_map(|&f| around(net, f)).filter(|f| !faces.contains(f)).collect();
    while let Some(first) = outside.pop_first() {
        let (mut set, mut front) = (BTreeSet::from([first]), vec![first]);
        while let Some(f) = front.pop().filter(|_| set.len() < faces.len()) {
            front.extend(around(net, f).filter(|g| !faces.contains(g) && set.insert(*g)));
        }
        outside.retain(|f| !set.contains(f));
        if set.len() < faces.len() {
            found.extend(set);
        }
    }
    found
}

impl FaceDisc {
    /// Some faces, widened by some rings, and what they enclose; `None` where that is no disc, or too wide.
    fn around(net: &Net, faces: &BTreeSet<u32>, rings: usize) -> Option<Self> {
        let most = REGION_MAX * net.faces().count() as f64;
        let mut wide = faces.clone();
        for _ in 0..rings {
            if wide.len() as f64 > most {
                return None;
            }
            wide = wide.iter().flat_map(|&f| around(net, f)).collect();
        }
        if let Some(patch) = Self::of(net, wide.clone()).filter(|_| wide.len() as f64 <= most) {
            return Some(patch);
        }
        wide.extend(enclosed(net, &wide));
        (wide.len() as f64 <= most).then(|| Self::of(net, wide)).flatten()
    }

    /// Of faces; `None` where they are no disc.
    fn of(net: &Net, faces: BTreeSet<u32>) -> Option<Self> {
        let mut edges: BTreeSet<(u32, u32)> = BTreeSet::new();
        for &f in &faces {
            let c = net.face(f);
            edges.extend((0..c.len()).map(|k| (c[k], c[(k + 1) % c.len()])));
        }
        let vertices: BTreeSet<u32> = edges.iter().map(|e| e.0).collect();
        let on_rim: Vec<(u32, u32)> = edges.iter().filter(|(a, b)| !edges.contains(&(*b, *a))).copied().collect();
        let edge_count = (edges.len() + on_rim.len()) / 2;
        if vertices.len() + faces.len() != edge_count + 1 || on_rim.is_empty() {
            return None;
        }
        let mut rim = vec![on_rim[0].0];
        loop {
            let last = *rim.last()?;
            let at = on_rim.partition_point(|e| e.0 < last);
            let &(from, to) = on_rim.get(at)?;
            if from != last || on_rim.get(at + 1).is_some_and(|e| e.0 == last) || rim.len() > on_rim.len() {
                return None;
            }
            if to == rim[0] {
                break;
            }
            rim.push(to);
        }
        if rim.len() != on_rim.len() {
            return None;
        }
        let outer: BTreeSet<u32> = rim.iter().copied().collect();
        let inner = vertices.difference(&outer).copied().collect::<Vec<u32>>();
        (!inner.is_empty()).then_some(Self { faces, rim, inner })
    }

    /// Lays the patch anew, if less of it is flawed then; tells whether half of the flaw is gone. `points` are those of the
    /// surface that it is next to.
    fn mend(
        &self,
        net: &mut Net,
        points: &[Vec3],
        (target, looks, surroundings): (&Target, &FlawFinder<'_>, &Surroundings<'_>),
    ) -> bool {
        let rim: Vec<Vec3> = self.rim.iter().map(|&v| net.positions[v as usize]).collect();
        let Some(sheet) = surroundings.left_of(&rim, self.faces.len() as f64 / net.faces().count().max(1) as f64)
        else {
            return false;
        };
        let places = |net: &Net| self.inner.iter().map(|&v| net.positions[v as usize]).collect::<Vec<Vec3>>();
        let before = looks.flaw(net, &self.faces, points);
        let mut best = (before, places(net));
        if self.lay(net, &rim, &sheet).is_some() {
            let laid = looks.flaw(net, &self.faces, points);
            if laid < before {
                best = (laid, places(net));
            }
            if laid < HOPELESS * before {
                self.even_out(net, target);
                let evened_out = looks.flaw(net, &self.faces, points);
                // Evened out it is taken where it is as good.
                if evened_out < before && evened_out <= best.0 {
                    best = (evened_out, places(net));
                }
            }
        }
        let (flaw, places) = best;
        self.inner.iter().zip(places).for_each(|(&v, p)| net.positions[v as usize] = p);
        flaw <= HALF * before
    }

    /// Puts the inner vertices where the maps of the patch and of the surface to the unit disc agree; `None` where there are none.
    fn lay(&self, net: &mut Net, rim: &[Vec3], sheet: &TriMesh) -> Option<()> {
        let flat = harmonic(sheet)?;
        let tree = Bvh::new(sheet);
        let on_disc = |p: Vec3| {
            let place = tree.closest(p);
            let corners = sheet.triangles.get(place.triangle as usize)?;
            let at = |k: usize| corners.iter().zip(place.barycentric).map(|(&v, w)| w * flat[v as usize][k]).sum();
            Some([at(0), at(1)])
        };
        let rim: Vec<[f64; 2]> = rim.iter().map(|&p| on_disc(p)).collect::<Option<_>>()?;
        let quads: Vec<&[u32]> = self.faces.iter().map(|&f| net.face(f)).collect();
        let inner = tutte(&quads, (&self.rim, &rim), &self.inner)?;
        let picture = TriMesh {
            positions: flat.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect(),
            triangles: sheet.triangles.clone(),
            ..TriMesh::default()
        };
        let tree = Bvh::new(&picture);
        for (&v, [x, y]) in self.inner.iter().zip(inner) {
            let place: Location = tree.closest(Vec3::new(x, y, 0.0)).into();
            let corners = sheet.triangles.get(place.triangle as usize)?;
            net.positions[v as usize] =
                corners.iter().zip(place.barycentric).map(|(&c, w)| sheet.positions[c as usize] * w).sum();
        }
        Some(())
    }

    /// Makes quads of what was laid that are more alike: the embedding crowds them where the surface's map is strained.
    fn even_out(&self, net: &mut Net, target: &Target) {
        let number = |v: u32| self.inner.binary_search(&v).ok();
        let corners: BTreeSet<u32> = self.faces.iter().flat_map(|&f| net.face(f).iter().copied()).collect();
        let corners: Vec<u32> = corners.into_iter().collect();
        let renumbered = |v: &u32| corners.partition_point(|c| c < v) as u32;
        let faces = self.faces.iter().map(|&f| net.face(f).iter().map(renumbered).collect()).collect();
        let mut own = Net::new(corners.iter().map(|&v| net.positions[v as usize]).collect(), faces);
        let stiffness: Vec<f64> =
            corners.iter().map(|&v| if number(v).is_some() { 0.0 } else { f64::INFINITY }).collect();
        optimise(&mut own, target, &stiffness, ROUNDS);
        for (&v, p) in corners.iter().zip(own.positions).filter(|(v, _)| number(**v).is_some()) {
            net.positions[v as usize] = p;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::fit::MeasuredSurface;
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    /// A horn of height .25 in the middle of a sheet of side 1, and a net of 20 × 20 quads on it.
    fn horn() -> (TriMesh, Net) {
        let mut surface = grid(60, 60, false, false);
        let height = |p: &Vec3| 0.25 * (1.0 - ((p.x - 0.5).hypot(p.y - 0.5) / 0.12)).max(0.0);
        surface.positions.iter_mut().for_each(|p| p.z = height(p));
        let mut net = sheet(20, 20);
        net.positions.iter_mut().for_each(|p| *p /= 20.0);
        net.positions.iter_mut().for_each(|p| p.z = height(p));
        (surface, net)
    }

    fn share(net: &Net, surface: &TriMesh, target: &Target) -> f64 {
        let faces = net.faces().map(|(f, _)| f).collect();
        FlawFinder::new(net, surface, target, f64::INFINITY).flaw(net, &faces, &[])
    }

    #[test]
    fn a_crumpled_region_is_smooth_again_and_the_rest_stays() {
        let (surface, mut net) = horn();
        let target = Target::new(&surface);
        let smooth = share(&net, &surface, &target);
        // What is nearest to the other side of the horn: its faces look inward.
        let inside = |p: &Vec3| (p.x - 0.5).hypot(p.y - 0.5) < 0.15;
        let crumpled: Vec<Vec3> =
            net.positions.iter().map(|p| if inside(p) { Vec3::new(1.0 - p.x, p.y, p.z) } else { *p }).collect();
        let before = std::mem::replace(&mut net.positions, crumpled);
        let flawed = share(&net, &surface, &target);
        assert!(flawed > smooth + 0.02, "{smooth} {flawed}");
        let measured = MeasuredSurface::new(&surface);
        reembed(&mut net, measured.points(), (&surface, &target), 0.02, &|_| false);
        let left = share(&net, &surface, &target);
        assert!(left - smooth < 0.2 * (flawed - smooth), "{smooth} {flawed} {left}");
        let far = |p: &Vec3| (p.x - 0.5).abs().max((p.y - 0.5).abs()) > 0.45;
        assert!(before.iter().zip(&net.positions).filter(|(p, _)| far(p)).all(|(p, q)| p == q));
        let top = net.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!(top > 0.15, "the horn is still covered: {top}");
    }

    #[test]
    fn faces_around_a_hole_are_no_disc() {
        let net = sheet(3, 3);
        let ring: BTreeSet<u32> = (0..9).filter(|f| *f != 4).collect();
        assert!(FaceDisc::of(&net, ring).is_none());
        let all = FaceDisc::of(&net, (0..9).collect()).expect("a disc");
        assert_eq!((all.rim.len(), all.inner), (12, vec![5, 6, 9, 10]));
    }
}
