//! How well an example lies on an input when it is laid roughly: enough to choose among many, at a tenth of what a map costs.
//!
//! Each start (the likeliest rigid [`poses`], ways to match tips, or another example that leads) comes to rest as a whole and
//! bends down to a twentieth of √area. The evidence of the best is that of a finished map, roughly. *Ours, not a paper's.*

use super::places::{PlaceSearch, Placement, Start};
use super::ways::MatchedTips;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::mesh::tri::TriMesh;
use crate::numerics::stop::Stop;
use crate::settle::{PosedSurface, PreparedInput, Similarity, Thoroughness, VertexLandmark, poses, poses_on};
use std::sync::Arc;

/// Poses that are laid.
const POSED: usize = 3;
/// Points by which one example leads another.
const LEADING: usize = 24;
/// An example whose best rough pose on another scores less is no part of it. *Untuned:* the face of one person on the head of
/// another has more than half.
const PART_FROM: f64 = 0.35;
/// A part has at most this share of the whole's area: else either is as much a part of the other. *Untuned.*
const PART_MAX: f64 = 0.7;

/// A surface that is laid, or laid on.
#[derive(Clone, Copy, Debug)]
pub struct Shape<'a> {
    /// Its mesh.
    pub mesh: &'a TriMesh,
    /// Whether it has no rim: then it is no part of anything.
    pub is_closed: bool,
}

/// The mesh of an example that lies on an input, which leads others there of which it is a part: a face leads a head.
#[derive(Clone, Copy, Debug)]
pub struct LeadMesh<'a> {
    /// Its mesh.
    pub mesh: &'a TriMesh,
    /// Where each of its vertices lies on the input.
    pub places: &'a [Vec3],
}

/// An input made ready for all examples that are laid on it roughly.
#[derive(Debug)]
pub struct RoughInput {
    ready: Arc<PreparedInput>,
    posed: PosedSurface,
}

impl RoughInput {
    /// Prepares; `None` where the input has no area.
    pub fn new(input: Shape<'_>) -> Option<Self> {
        let ready = Arc::new(PlaceSearch::ready_roughly(input.mesh)?);
        Some(Self { ready, posed: PosedSurface::sought(input.mesh, !input.is_closed, Thoroughness::Roughly) })
    }
}

/// An example on an input, roughly.
#[derive(Clone, Debug)]
pub struct RoughFit {
    /// How sure it is: [`crate::settle::Evidence::agreement`].
    pub agreement: f64,
    /// [`crate::settle::Evidence::local_relief`].
    pub local_relief: f64,
    /// Share of the input's area that the example lies on.
    pub covered: f64,
    /// Share of the example's area for which the input has nothing, although it does not end there.
    pub off: f64,
    /// Where each vertex of the example lies.
    pub places: Vec<Vec3>,
    /// Whether it lies mirrored.
    pub mirrored: bool,
    /// How far tips that led it there end from their matches in the mean, in √area of the input.
    pub apart: f64,
    /// From where it was laid, if that was as a whole.
    pub start: Option<Start>,
}

/// Lays an example roughly on an input that is ready; `None` where there is no way to, or when stopped. `tips`: ways to match the
/// tips of both.
pub fn rough(
    example: Shape<'_>,
    (input, ready): (&TriMesh, &RoughInput),
    tips: &[MatchedTips],
    lead: Option<LeadMesh<'_>>,
    stop: Stop<'_>,
) -> Option<RoughFit> {
    let mut search = PlaceSearch::roughly(example.mesh, (input, Arc::clone(&ready.ready)))?;
    match lead {
        Some(lead) => {
            search = search.holding(&leading(lead, example, input, stop)?);
            search.tries(&search.carried()?, stop);
        }
        None => {
            search.tries_tips(tips, None, stop);
            // Limbs tell more of two wholes than a rigid pose, if they have any.
            if !(example.is_closed && ready.posed.is_whole() && search.lies_well()) {
                let found = poses_on(example.mesh, !example.is_closed, &ready.posed, stop);
                let posed: Vec<Start> =
                    found.iter().take(POSED).map(|(_, pose)| Start::posed(example.mesh, pose)).collect();
                search.tries_poses(&posed, stop);
            }
            search.tries_axes(tips, stop);
        }
    }
    let best = search.best().filter(|_| !stop())?;
    Some(RoughFit::of(best, search.best_start(), example.mesh))
}

impl RoughFit {
    fn of(placement: &Placement, start: Option<Start>, example: &TriMesh) -> Self {
        let evidence = &placement.evidence;
        let places = placement.places.iter().map(|place| place.point).collect();
        let is_off =
            |t: &usize| example.triangles[*t].iter().all(|&v| placement.off[v as usize] && !placement.lost[v as usize]);
        let off = (0..example.triangles.len()).filter(is_off).map(|t| example.area(t)).sum::<f64>();
        let off = off / example.total_area().max(f64::MIN_POSITIVE);
        Self {
            agreement: evidence.agreement(),
            local_relief: evidence.local_relief,
            covered: evidence.covered,
            off,
            places,
            mirrored: placement.mirrored,
            apart: placement.apart,
            start,
        }
    }
}

/// Points of an example with where they belong on the input, by a part of the example that lies there; `None` where that is no
/// part of it.
fn leading(lead: LeadMesh<'_>, example: Shape<'_>, input: &TriMesh, stop: Stop<'_>) -> Option<Vec<VertexLandmark>> {
    let may_be_part = [true, false];
    let found = poses(lead.mesh, example.mesh, may_be_part, Thoroughness::Roughly, stop);
    let share = |pose: &Similarity| pose.scale.powi(2) * lead.mesh.total_area() / example.mesh.total_area();
    let (_, pose) = found.first().filter(|(score, pose)| *score >= PART_FROM && share(pose) <= PART_MAX)?;
    let pairs: Vec<(Vec3, Vec3)> =
        lead.mesh.positions.iter().zip(lead.places).map(|(from, there)| (pose.apply(from), *there)).collect();
    Some(between(example.mesh, input, &spread(&pairs)))
}

/// Landmarks from points near the example to points near the input.
pub fn between(example: &TriMesh, input: &TriMesh, pairs: &[(Vec3, Vec3)]) -> Vec<VertexLandmark> {
    between_by((example, &Bvh::new(example)), &Bvh::new(input), pairs)
}

/// The same by the trees of both.
pub fn between_by(
    (example, on_example): (&TriMesh, &Bvh),
    on_input: &Bvh,
    pairs: &[(Vec3, Vec3)],
) -> Vec<VertexLandmark> {
    let landmark =
        |(from, to): &(Vec3, Vec3)| VertexLandmark::between(example, &on_example.closest(*from), on_input.closest(*to));
    pairs.iter().filter_map(landmark).collect()
}

/// Some pairs of points, the first of each as far from the others' as may be.
pub fn spread(pairs: &[(Vec3, Vec3)]) -> Vec<(Vec3, Vec3)> {
    let mut away = vec![f64::INFINITY; pairs.len()];
    let mut chosen = Vec::new();
    while chosen.len() < LEADING.min(pairs.len()) {
        let Some(next) = (0..pairs.len()).max_by(|&a, &b| away[a].total_cmp(&away[b])) else { break };
        chosen.push(pairs[next]);
        for (away, (point, _)) in away.iter_mut().zip(pairs) {
            *away = away.min((point - pairs[next].0).norm());
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::{ball, grid};

    /// A sheet with bumps that nothing else has, from x = `from` to `to` of 0 to 1.
    fn sheet(n: u32, from: f64, to: f64) -> TriMesh {
        let flat = grid(n, n, false, false);
        let size = flat.positions.iter().fold(0.0f64, |most, p| most.max(p.x).max(p.y));
        let bump = |x: f64, y: f64| {
            0.16 * (5.0 * x + 0.4).sin() * (3.9 * y).cos() + 0.08 * (7.1 * y + 2.0 * x).sin() + 0.2 * (x - 0.3).powi(2)
        };
        let place = |p: &Vec3| {
            let (x, y) = (from + (to - from) * p.x / size, p.y / size);
            Vec3::new(x, y, bump(2.0 * x, 2.0 * y))
        };
        let positions = flat.positions.iter().map(place).collect();
        TriMesh::from_triangles(positions, flat.triangles.clone()).expect("a sheet")
    }

    fn open(mesh: &TriMesh) -> Shape<'_> {
        Shape { mesh, is_closed: false }
    }

    fn closed(mesh: &TriMesh) -> Shape<'_> {
        Shape { mesh, is_closed: true }
    }

    fn on(example: Shape<'_>, input: &TriMesh, lead: Option<LeadMesh<'_>>) -> Option<RoughFit> {
        rough(example, (input, &RoughInput::new(open(input))?), &[], lead, &|| false)
    }

    #[test]
    fn what_is_like_the_input_agrees_better_than_what_is_not() {
        let (input, like) = (sheet(48, 0.0, 1.0), sheet(30, 0.0, 1.0));
        let mut other = sheet(30, 0.0, 1.0);
        other.positions.iter_mut().for_each(|p| p.z = 0.3 * (9.0 * p.x).cos() * (8.0 * p.y + 1.0).sin());
        let agreement = |example: &TriMesh| on(open(example), &input, None).expect("a fit").agreement;
        let (right, wrong) = (agreement(&like), agreement(&other));
        assert!(right > 0.5, "{right}");
        assert!(right > wrong + 0.2, "{right} {wrong}");
    }

    #[test]
    fn a_part_leads_the_whole_to_its_place() {
        let (input, whole, part) = (sheet(56, 0.0, 1.0), sheet(36, 0.0, 1.0), sheet(24, 0.0, 0.5));
        let lead = LeadMesh { mesh: &part, places: &part.positions };
        let fit = on(open(&whole), &input, Some(lead)).expect("a part of it");
        let off: f64 = fit.places.iter().zip(&whole.positions).map(|(at, p)| (at - p).norm()).sum();
        assert!(off / (whole.positions.len() as f64) < 0.02, "{off}");
        let mut other = sheet(24, 0.0, 1.0);
        other.positions.iter_mut().for_each(|p| p.z = 0.4 * (9.0 * p.x).cos() * (8.0 * p.y + 1.0).sin());
        let lead = LeadMesh { mesh: &other, places: &other.positions };
        assert!(on(open(&whole), &input, Some(lead)).is_none());
    }

    #[test]
    fn a_closed_example_without_limbs_is_laid_on_a_closed_input_as_a_whole() {
        let egg = |n: u32, long: f64| {
            let mut mesh = ball(n);
            mesh.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x * (1.0 + 0.4 * p.z), p.y, long * p.z));
            mesh
        };
        let input = egg(40, 2.0);
        let ready = RoughInput::new(closed(&input)).expect("an area");
        let laid = |example: &TriMesh| rough(closed(example), (&input, &ready), &[], None, &|| false).expect("a fit");
        let like = laid(&egg(24, 2.0));
        assert!(
            like.agreement > 0.5 && like.covered > 0.9 && like.start.is_some(),
            "{} {}",
            like.agreement,
            like.covered
        );
        assert!(laid(&egg(24, 0.4)).agreement < like.agreement - 0.2);
    }

    #[test]
    fn points_are_spread_over_all_of_them() {
        let pairs: Vec<(Vec3, Vec3)> = (0..100).map(|k| Vec3::new(f64::from(k), 0.0, 0.0)).map(|p| (p, p)).collect();
        let chosen = spread(&pairs);
        assert_eq!(chosen.len(), LEADING);
        let mut at: Vec<f64> = chosen.iter().map(|c| c.0.x).collect();
        at.sort_by(f64::total_cmp);
        assert!((at[0], at[LEADING - 1]) == (0.0, 99.0) && at.windows(2).all(|w| w[1] - w[0] <= 7.0), "{at:?}");
    }
}
