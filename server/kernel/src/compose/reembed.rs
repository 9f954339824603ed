//! Lays crumpled regions of a net anew.
//!
//! The middle of a long edge, put on the nearest place of the surface, may land on the other side of an ear or a wing; the
//! quads around it then look away from the surface. Faces that look away, widened by some rings, form a disc of the net
//! whose rim lies well. The surface to the left of the rim is a disc too ([`region`]). Both are mapped to the unit disc:
//! the surface by a harmonic map with its border on the circle, the net by Tutte's embedding, whose rim is where the
//! surface's map has it. Each inner vertex goes to the place of the surface that has its image. A net of squares has a
//! uniform embedding that is nearly conformal, as the surface's map is, so that rings around the tip of an ear stay rings.
//! *Source:* Tutte, *How to draw a graph* (1963). *Ours, not the paper's:* on a region that looks away.

mod disc;
mod region;

use super::fit::samples;
use super::net::{Fans, Net};
use super::optimise::optimise;
use super::smooth::Target;
use crate::encode::index::Location;
use crate::measure::facing::{Facing, Turned};
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::numerics::stop;
use disc::{harmonic, tutte};
use region::Surroundings;
use std::collections::BTreeSet;

/// Rings around the faces that look away, each tried on what the one before left. *Untuned.*
const RINGS: [usize; 4] = [1, 2, 4, 7];
/// Share of a face that looks away, from which on it is laid anew.
const AWAY: f64 = 0.3;
/// Largest share of the net's faces that one region may have: a wider one is more than its rim can tell. *Untuned.*
const REGION_MAX: f64 = 0.25;
/// Rounds of optimisation of what was laid anew.
const ROUNDS: u32 = 40;
/// Points of the part of the surface that a region is laid on.
const SAMPLES: usize = 400;

/// Lays the regions of a net anew that look away from the surface, or pass over it by more than `passed`, where less of them
/// does so then; the net's boundary stays, and so does what `stays`. `points` are spread evenly over the surface.
pub(super) fn reembed(
    net: &mut Net,
    points: &[Vec3],
    (surface, target): (&TriMesh, &Target),
    passed: f64,
    stays: &dyn Fn(Vec3) -> bool,
) {
    let looks = Looks::new(net, surface, target, passed);
    let surroundings = Surroundings::new(surface, target.tree());
    for rings in RINGS {
        let flawed = looks.flawed(net, points);
        if flawed.is_empty() {
            break;
        }
        for patch in patches(net, &flawed, rings) {
            stop::ask();
            if !patch.inner.iter().any(|&v| stays(net.positions[v as usize])) {
                patch.mend(net, target, &looks, &surroundings);
            }
        }
    }
}

/// Tells what of a net is flawed.
struct Looks<'a> {
    facing: Facing<'a>,
    /// Distance from which on a point of the surface is passed over.
    passed: f64,
}

impl<'a> Looks<'a> {
    fn new(net: &Net, surface: &'a TriMesh, target: &'a Target, passed: f64) -> Self {
        let edge = (surface.total_area() / net.faces().count().max(1) as f64).sqrt();
        Self { facing: Facing::new(surface, target.tree(), edge), passed }
    }

    fn of(&self, net: &Net, face: u32) -> Turned {
        let corners: Vec<Vec3> = net.face(face).iter().map(|&v| net.positions[v as usize]).collect();
        self.facing.turned(&corners)
    }

    /// The faces that look away, and those next to points of the surface that are passed over.
    fn flawed(&self, net: &Net, points: &[Vec3]) -> BTreeSet<u32> {
        let mut found: BTreeSet<u32> =
            net.faces().map(|(f, _)| f).filter(|&f| self.of(net, f).share() > AWAY).collect();
        let fans = net.fans();
        let tree = Bvh::new(&fans.mesh);
        let near = points.iter().map(|&x| tree.closest(x)).filter(|near| near.distance > self.passed);
        found.extend(near.filter_map(|near| fans.face.get(near.triangle as usize)));
        found
    }

    /// The share of some faces' area that looks away, and that of a part of the surface, given by points, that is passed over.
    fn flaw(&self, net: &Net, faces: &BTreeSet<u32>, points: &[Vec3]) -> f64 {
        let mut all = Turned::default();
        faces.iter().for_each(|&f| all.add(self.of(net, f)));
        let tree = Bvh::new(&Fans::of(&net.positions, faces.iter().map(|&f| (f, net.face(f)))).mesh);
        let passed = points.iter().filter(|&&x| tree.closest(x).distance > self.passed).count();
        all.share() + passed as f64 / points.len().max(1) as f64
    }
}

/// A disc of a net's faces.
struct Patch {
    faces: BTreeSet<u32>,
    /// Its rim, with the faces on the left.
    rim: Vec<u32>,
    /// The vertices within the rim, in order.
    inner: Vec<u32>,
}

/// The discs around some faces, widened by some rings. What is no disc, or too wide, is left out.
fn patches(net: &Net, away: &BTreeSet<u32>, rings: usize) -> Vec<Patch> {
    let around = |f: u32| net.face(f).iter().flat_map(|&v| net.at(v).iter().copied()).collect::<Vec<u32>>();
    let mut wide = away.clone();
    for _ in 0..rings {
        wide = wide.iter().flat_map(|&f| around(f)).collect();
    }
    let most = REGION_MAX * net.faces().count() as f64;
    let mut left = wide;
    let mut found = Vec::new();
    while let Some(&first) = left.first() {
        let (mut faces, mut front) = (BTreeSet::new(), vec![first]);
        left.remove(&first);
        while let Some(f) = front.pop() {
            faces.insert(f);
            front.extend(around(f).into_iter().filter(|g| left.remove(g)));
        }
        if faces.len() as f64 <= most {
            found.extend(Patch::of(net, faces));
        }
    }
    found
}

impl Patch {
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

    /// Lays the patch anew, if less of it is flawed then.
    fn mend(&self, net: &mut Net, target: &Target, looks: &Looks<'_>, surroundings: &Surroundings<'_>) {
        let rim: Vec<Vec3> = self.rim.iter().map(|&v| net.positions[v as usize]).collect();
        let Some(sheet) = surroundings.left_of(&rim) else { return };
        let points = samples(&sheet, SAMPLES);
        let places = |net: &Net| self.inner.iter().map(|&v| net.positions[v as usize]).collect::<Vec<Vec3>>();
        let mut best = (looks.flaw(net, &self.faces, &points), places(net));
        let before = best.0;
        if self.lay(net, &rim, &sheet).is_some() {
            for evened_out in [false, true] {
                if evened_out {
                    self.even_out(net, target);
                }
                let now = looks.flaw(net, &self.faces, &points);
                // Evened out it is taken where it is as good.
                if now < best.0 || (evened_out && best.0 < before && now <= best.0) {
                    best = (now, places(net));
                }
            }
        }
        self.inner.iter().zip(best.1).for_each(|(&v, p)| net.positions[v as usize] = p);
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
    use crate::compose::net::tests::sheet;
    use crate::topology::tests::grid;

    /// A horn of height .5 in the middle of a sheet of side 1, and a net of 10 × 10 quads on it.
    fn horn() -> (TriMesh, Net) {
        let mut surface = grid(60, 60, false, false);
        let height = |p: &Vec3| 0.5 * (1.0 - ((p.x - 0.5).hypot(p.y - 0.5) / 0.2)).max(0.0);
        surface.positions.iter_mut().for_each(|p| p.z = height(p));
        let mut net = sheet(10, 10);
        net.positions.iter_mut().for_each(|p| *p /= 10.0);
        net.positions.iter_mut().for_each(|p| p.z = height(p));
        (surface, net)
    }

    fn share(net: &Net, surface: &TriMesh, target: &Target) -> f64 {
        let faces = net.faces().map(|(f, _)| f).collect();
        Looks::new(net, surface, target, f64::INFINITY).flaw(net, &faces, &[])
    }

    #[test]
    fn a_crumpled_region_is_smooth_again_and_the_rest_stays() {
        let (surface, mut net) = horn();
        let target = Target::new(&surface);
        let smooth = share(&net, &surface, &target);
        // What is nearest to the other side of the horn: its faces look inward.
        let inside = |p: &Vec3| (p.x - 0.5).hypot(p.y - 0.5) < 0.25;
        let crumpled: Vec<Vec3> =
            net.positions.iter().map(|p| if inside(p) { Vec3::new(1.0 - p.x, p.y, p.z) } else { *p }).collect();
        let before = std::mem::replace(&mut net.positions, crumpled);
        assert!(share(&net, &surface, &target) > smooth + 0.05);
        let points = samples(&surface, 1_000);
        reembed(&mut net, &points, (&surface, &target), 0.02, &|_| false);
        assert!(share(&net, &surface, &target) <= smooth + 1e-9);
        let far = |p: &Vec3| (p.x - 0.5).abs().max((p.y - 0.5).abs()) > 0.45;
        assert!(before.iter().zip(&net.positions).filter(|(p, _)| far(p)).all(|(p, q)| p == q));
        let top = net.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!(top > 0.25, "the horn is still covered: {top}");
    }

    #[test]
    fn faces_around_a_hole_are_no_disc() {
        let net = sheet(3, 3);
        let ring: BTreeSet<u32> = (0..9).filter(|f| *f != 4).collect();
        assert!(Patch::of(&net, ring).is_none());
        let all = Patch::of(&net, (0..9).collect()).expect("a disc");
        assert_eq!((all.rim.len(), all.inner), (12, vec![5, 6, 9, 10]));
    }
}
