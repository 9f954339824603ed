//! Examples laid on inputs that may end elsewhere, or be closed where the example is open.
//!
//! The map of both as wholes, the match of their tips, then rough poses ([`poses`]) are starts; each settles on the input with its
//! boundary free ([`PlaceSearch`]), until one is convincing. Faces of the example that lie beyond the input are left
//! out, and what of the input lies beyond the example is continued by rows of quads, where that is asked for.

use super::constrain::{self, locate};
use super::constraint::{ConstraintEdit, Landmark, NewConstraint, OnFold};
use super::error::{PipelineError, Refusal, Stop, internal, stopped};
use super::finished::{JudgedBy, MapParameters, finish, is_alike};
use super::mapped::{Fitted, Lead, Verdict, Wishes};
use super::registered::{self, Registered};
use super::side::{Encoded, SegmentFacts, Side};
use crate::encode::index::Location;
use crate::fit::UnfoldedPatch;
use crate::fit::places::{PlaceSearch, Placement, Start};
use crate::fit::rough::{between, between_by, spread};
use crate::fit::ways::MatchedTips;
use crate::map::atlas::{TipMatch, likely_matches};
use crate::mesh::bvh::Bvh;
use crate::mesh::{TriMesh, Vec3};
use crate::numerics::side_by_side;
use crate::numerics::stage::Stage;
use crate::register::{Entry, LevenbergMarquardt, Query};
use crate::segment::Segmented;
use crate::settle::{Thoroughness, VertexLandmark, poses};
use crate::topology::{Patch, Topology};
use std::sync::{Arc, OnceLock};

/// The finest level at which surfaces are registered, in pixels a side.
const SIDE: usize = 128;
/// Ways to match the tips that are tried, of either orientation.
const LED: usize = 2;
/// Below this relief rough poses are tried.
const DOUBTFUL: f64 = 0.65;
/// An example that agrees so much when it is laid roughly lies there, and no other pose is sought. *Untuned:* heads on a statue's pedestal or
/// hair agree less than .05.
const SURE_ROUGHLY: f64 = 0.1;
/// Poses that are settled.
const POSED: usize = 5;
/// The same of one closed surface on another, as a whole.
const POSED_WHOLE: usize = 3;
/// The same on what is no scan.
const POSED_FEW: usize = 2;
/// A map that settled must have so much more relief than the one of the charts, which keeps boundaries and sharp edges.
const SETTLED_MARGIN: f64 = 0.01;
/// Where it has so much more than the charts lay it with before their map settles, that need not settle. *Untuned.*
const FAR_AHEAD: f64 = 0.1;
/// More of the input within the example is all of it.
pub(crate) const COVERED: f64 = 0.97;

/// Whether examples of one topology can be laid on inputs of another.
pub fn reaches(example: Topology, query: Topology) -> bool {
    let has_caps = |topology| matches!(topology, Topology::Disc | Topology::Sphere);
    example == query || has_caps(example) && query != Topology::Torus
}

/// The topologies of the examples that a query is ranked against: a disc may lie about either pole of a closed surface, and what
/// has rims may be all that is there of something with fewer, if it is no part of a scan that was cut: a body without head and arm
/// has those of a tube.
pub fn ranked_against(query: Topology, is_most: bool) -> Vec<Topology> {
    match query {
        _ if !Stage::Topologies.is_on() => vec![query],
        Topology::Sphere => vec![Topology::Sphere, Topology::Disc],
        Topology::Disc if is_most => vec![Topology::Disc, Topology::Sphere],
        Topology::Annulus if is_most => vec![Topology::Annulus, Topology::Disc, Topology::Sphere],
        _ => vec![query],
    }
}

/// Lays an example where it fits best.
pub(crate) fn fit(
    from: Option<&Registered>,
    example: &Side,
    query: &Side,
    wishes: &Wishes,
    stop: Stop,
) -> Result<Fitted, PipelineError> {
    let Wishes { beyond, landmarks, lead, rough } = wishes;
    let held = held(landmarks, example, query)?;
    let from = from.map(|from| of_wholes(from, example, query, stop)).transpose()?.flatten();
    let by_charts = |from: &Registered| -> Result<Fitted, PipelineError> {
        let mut mapped = registered::map(from, example, query, stop)?;
        if !landmarks.is_empty() {
            let set = landmarks.iter().map(as_constraint).collect();
            let edit = ConstraintEdit { set, on_fold: OnFold::Resolve, ..ConstraintEdit::default() };
            let edited = constrain::edit(&mapped.registration, &mapped.constraints, &edit, example, query, stop)?;
            mapped = registered::map(&edited, example, query, stop)?;
        }
        Ok(Fitted { mapped, example: example.clone(), query: query.clone() })
    };
    let on = &*query.model;
    let free = |side: &Side| {
        let topology = side.encoded.facts.topology;
        matches!(topology, Topology::Disc | Topology::Sphere) && on.may_settle(query.segment)
    };
    if let Some(from) = from.as_ref().filter(|_| !free(example) || !free(query)) {
        return by_charts(from);
    }
    let (one, two) = (surface(example)?, surface(query)?);
    let input = Arc::clone(&two.query.chart.mesh);
    let led = match lead.as_ref().filter(|_| held.is_empty()) {
        Some(lead) => led(lead, (example, &one), &input, stop)?,
        None => Vec::new(),
    };
    let lies = rough.as_ref().map(|rough| Start {
        positions: rough.places.to_vec(),
        mirrored: rough.mirrored,
        apart: rough.apart,
    });
    let sure = rough.as_ref().filter(|rough| rough.agreement >= SURE_ROUGHLY);
    let posed = sure.map(|rough| rough.start.as_deref().map_or(&[][..], std::slice::from_ref));
    let known = StartHints { held: &held, led: &led, rough: lies.as_ref(), posed };
    let settled = settled(from.as_ref(), (example, &one), (query, &two), (&input, known), stop)?;
    let are_wholes = on.are_wholes(query.segment, [one.patch.topology, two.patch.topology]);
    let asked = MapParameters { beyond: *beyond, held: &held, are_wholes };
    let finished = |placement| finish(placement, (example, &one), (query, &two), asked, stop);
    match (settled, &from) {
        (Some(BestPlacement { placement, is_better: false }), Some(from)) => {
            // What settled may serve where the map of the charts does not.
            let charted = by_charts(from)?;
            if charted.mapped.verdict < Verdict::Poor {
                return Ok(charted);
            }
            let fitted = finished(placement)?;
            Ok(if fitted.mapped.verdict < charted.mapped.verdict { fitted } else { charted })
        }
        (Some(BestPlacement { placement, is_better: true }), from) => {
            let fitted = finished(placement)?;
            let covers = fitted.mapped.reach.covers;
            // Where boundary on boundary is a good map, the two surfaces end alike.
            if !held.is_empty() {
                return Ok(fitted);
            }
            let ends_elsewhere = covers.example < 1.0 || covers.input < COVERED;
            let folds = fitted.mapped.folds;
            let Some(from) = from.as_ref().filter(|_| ends_elsewhere || folds > 0) else { return Ok(fitted) };
            let alike = registered::good_map(from, example, query, stop)?;
            let alike = alike.filter(|alike| ends_elsewhere || alike.folds < folds);
            let as_wholes = |mapped| Fitted { mapped, example: example.clone(), query: query.clone() };
            Ok(alike.map_or(fitted, as_wholes))
        }
        (None, Some(from)) => by_charts(from),
        (_, None) => {
            let detail =
                "expected an example of which a part matches the input, or the reverse, found none; choose another";
            Err(PipelineError::refused(Refusal::NotEncodable, detail))
        }
    }
}

/// Tells what is known of where an example belongs, before anything is sought.
#[derive(Clone, Copy, Default)]
struct StartHints<'a> {
    /// Points that are held.
    held: &'a [LocatedLandmark],
    /// Points that lead there: they are held while it settles, but not met exactly.
    led: &'a [VertexLandmark],
    /// How it lies when it is laid roughly.
    rough: Option<&'a Start>,
    /// The poses to settle from where it agrees when it is laid roughly, so that none need be sought: the one from which it was laid,
    /// if it was from one.
    posed: Option<&'a [Start]>,
}

/// Where points of an example belong on the input, by a map of another example that lies on both; none where the other does not
/// lie on this example.
fn led(
    lead: &Lead,
    (example, one): (&Side, &UnfoldedPatch),
    input: &TriMesh,
    stop: Stop,
) -> Result<Vec<VertexLandmark>, PipelineError> {
    let part = surface(&lead.example)?;
    let own = Arc::clone(&one.query.chart.mesh);
    let found = settled(None, (&lead.example, &part), (example, one), (&own, StartHints::default()), stop)?;
    let found = found.map(|best| best.placement).filter(|found| found.evidence.relief >= DOUBTFUL);
    let Some(found) = found else { return Ok(Vec::new()) };
    let on_part = Bvh::new(&part.patch.mesh);
    let mesh = &lead.example.model.mesh;
    let kept: Vec<u32> = lead.kept.clone().unwrap_or_else(|| (0..mesh.positions.len() as u32).collect());
    let carried = |(&v, &there): (&u32, &Vec3)| {
        let place = on_part.closest(*mesh.positions.get(v as usize)?);
        let corners = part.patch.mesh.triangles.get(place.triangle as usize)?;
        let is_lost = corners.iter().any(|&v| found.lost[v as usize] || found.off[v as usize]);
        let point = |k: usize| found.places[corners[k] as usize].point * place.barycentric[k];
        (!is_lost).then(|| (point(0) + point(1) + point(2), there))
    };
    let pairs: Vec<(Vec3, Vec3)> = kept.iter().zip(&lead.mesh.positions).filter_map(carried).collect();
    Ok(between(&one.patch.mesh, input, &spread(&pairs)))
}

/// The best place at which an example settles.
struct BestPlacement {
    placement: Placement,
    /// True where it is better than where the charts lay it.
    is_better: bool,
}

/// Settles the example from all starts until one is convincing; `None` where it settles nowhere. `from`: how the charts lay it, if they
/// do.
fn settled(
    from: Option<&Registered>,
    (example, one): (&Side, &UnfoldedPatch),
    (query, two): (&Side, &UnfoldedPatch),
    (input, known): (&TriMesh, StartHints<'_>),
    stop: Stop,
) -> Result<Option<BestPlacement>, PipelineError> {
    if !Stage::Settle.is_on() {
        return Ok(None);
    }
    let mesh = &one.patch.mesh;
    let tree = Arc::clone(two.query.tree());
    let Some(mut search) = PlaceSearch::with_tree(mesh, input, tree) else { return Ok(None) };
    if !known.led.is_empty() {
        // Let go of, what lies right would be drawn away by what the example has beyond: a head by a crown.
        search = search.holding(known.led);
    } else if !known.held.is_empty() {
        let trees = (Bvh::new(mesh), Bvh::new(input));
        let at = |h: &LocatedLandmark| VertexLandmark::between(mesh, &trees.0.closest(h.from), trees.1.closest(h.at));
        let landmarks: Vec<VertexLandmark> = known.held.iter().filter_map(at).collect();
        search = search.holding(&landmarks);
    }
    // What three points or more say of the pose is not sought.
    if let Some(carried) = search.carried() {
        search.tries(&carried, stop);
        stopped(stop)?;
        return Ok(search.settle_best(|_| true, stop).map(|placement| BestPlacement { placement, is_better: true }));
    }
    let by_charts = || from.map(|from| registered::start(from, example, query, stop)).transpose();
    let of_rough = || known.rough.map(|rough| search.tried(rough, stop));
    let (whole, of_rough) = side_by_side(by_charts, of_rough);
    let start = |(positions, mirrored)| Start { positions, mirrored, apart: 0.0 };
    let whole = whole?.map(start);
    if let Some(whole) = &whole {
        search.tries(whole, stop);
    }
    search.take(of_rough.into_iter().flatten());
    let on = &*query.model;
    if on.has_tips(query.segment, input) && Stage::Tips.is_on() && !search.is_convincing() {
        let matches = matched_tips([&one.query, &two.query], (mesh, input), LED, stop);
        search.tries_tips(&matches, whole.as_ref(), stop);
        search.tries_axes(&matches, stop);
    }
    let closed = |side: &Side| side.encoded.facts.topology == Topology::Sphere;
    let are_closed = closed(example) && closed(query);
    // Of two closed surfaces neither ends anywhere, and limbs tell more than a rigid pose, if they have any.
    let is_open = match are_closed {
        true => !search.lies_well(),
        false => search.best().is_none_or(|best| best.evidence.relief < DOUBTFUL),
    };
    if is_open && Stage::Poses.is_on() {
        let (sought, most) = match on.is_scan() {
            _ if are_closed => (Thoroughness::Roughly, POSED_WHOLE),
            true if on.is_most(query.segment) => (Thoroughness::Thoroughly, POSED),
            true => (Thoroughness::ByMiddle, POSED),
            false => (Thoroughness::Quickly, POSED_FEW),
        };
        let find = || -> Vec<Start> {
            let found = poses(mesh, input, [!closed(example), !closed(query)], sought, stop);
            found.iter().take(most).map(|(_, pose)| Start::posed(mesh, pose)).collect()
        };
        let posed = known.posed.map_or_else(find, <[Start]>::to_vec);
        match are_closed {
            true => search.tries_poses(&posed, stop),
            false => search.tries_poses_as_they_stand(&posed, stop),
        }
    }
    stopped(stop)?;
    let are_wholes = on.are_wholes(query.segment, [one.patch.topology, two.patch.topology]);
    let judged_by = JudgedBy::of(one, are_wholes);
    let best = search.settle_best(|evidence| is_alike(evidence, judged_by), stop);
    stopped(stop)?;
    let Some(placement) = best else { return Ok(None) };
    let ahead = |of: &Start| search.relief(of).map_or(f64::INFINITY, |relief| placement.evidence.relief - relief);
    let is_better = match (from, whole) {
        // The charts' map gains a little when it settles, too.
        (Some(from), Some(whole)) if ahead(&whole) < FAR_AHEAD => {
            let whole = registered::whole(from, example, query, stop)?;
            ahead(&start((whole.positions, whole.mirrored))) > SETTLED_MARGIN
        }
        _ => true,
    };
    Ok(Some(BestPlacement { placement, is_better }))
}

/// The likeliest ways to match the tips of two surfaces, at most `most` of either orientation.
pub(crate) fn matched_tips(
    [one, two]: [&Query; 2],
    (mesh, input): (&TriMesh, &TriMesh),
    most: usize,
    stop: Stop,
) -> Vec<MatchedTips> {
    let (own, there) = (&one.chart.mesh, &two.chart.mesh);
    let pair = |(a, b): &(u32, u32)| Some((*own.positions.get(*a as usize)?, *there.positions.get(*b as usize)?));
    let matches = likely_matches(one, two, &LevenbergMarquardt::default(), most, stop);
    if matches.is_empty() {
        return Vec::new();
    }
    let (on_example, on_input) = (Bvh::new(mesh), Bvh::new(input));
    let landmarks = |TipMatch { pairs, mirrored }: &TipMatch| {
        let pairs: Vec<(Vec3, Vec3)> = pairs.iter().filter_map(pair).collect();
        MatchedTips { landmarks: between_by((mesh, &on_example), &on_input, &pairs), mirrored: *mirrored }
    };
    matches.iter().map(landmarks).collect()
}

/// The registration of all of both: the one given, unless that is of a part; `None` where the topologies differ.
fn of_wholes(from: &Registered, example: &Side, query: &Side, stop: Stop) -> Result<Option<Registered>, PipelineError> {
    if example.encoded.facts.topology != query.encoded.facts.topology {
        // The ranking compared it with a surface that was filled, or with a part.
        return Ok(None);
    }
    if from.entry.best().unfolded.is_whole() {
        return Ok(Some(from.clone()));
    }
    let (one, two) = (&example.encoded.query, &query.encoded.query);
    registration(one, two, stop)
}

/// Registers two surfaces that end alike; `None` where the topologies differ.
pub(crate) fn registration(one: &Query, two: &Query, stop: Stop) -> Result<Option<Registered>, PipelineError> {
    let solver = LevenbergMarquardt::default();
    let Some(mut entry) = Entry::coarse(two, one.encoding(), &solver, stop) else { return Ok(None) };
    while entry.side() < SIDE {
        entry.advance(two, one.encoding(), &solver, stop).map_err(internal)?;
    }
    entry.refine_poles(two, one.encoding(), &solver, stop).map_err(internal)?;
    registered::checked(entry, stop).map(Some)
}

fn surface(side: &Side) -> Result<UnfoldedPatch, PipelineError> {
    let model = &*side.model;
    Ok(UnfoldedPatch { patch: Arc::new(model.patch(side.segment)?.clone()), query: Arc::clone(&side.encoded.query) })
}

/// The side that a part of an example is.
pub(crate) fn of_example(whole: &Side, cropped: &UnfoldedPatch) -> Result<Side, PipelineError> {
    let model = &*whole.model;
    let patch = model.patch(whole.segment)?;
    let part = &cropped.patch;
    let number = |of: &[u32], v: &u32| of.get(*v as usize).copied().unwrap_or(0);
    let part = Patch {
        vertex_of: part.vertex_of.iter().map(|v| number(&patch.vertex_of, v)).collect(),
        triangle_of: part.triangle_of.iter().map(|t| number(&patch.triangle_of, t)).collect(),
        ..(**part).clone()
    };
    let mut part_of = vec![1; model.segmented.mesh.triangles.len()];
    part.triangle_of.iter().for_each(|&t| part_of[t as usize] = 0);
    let segmented = Segmented { part_of, parts: vec![part], seams: Vec::new(), ..model.segmented.clone() };
    Ok(side(whole, segmented, Arc::clone(&cropped.query)))
}

fn side(whole: &Side, segmented: Segmented, query: Arc<Query>) -> Side {
    let model = whole.model.recut(segmented, true);
    let facts = SegmentFacts::of(query.encoding(), model.faces(0), 0.0);
    Side { model: Arc::new(model), segment: 0, encoded: Arc::new(Encoded { facts, query, repairs: Vec::new() }) }
}

/// A landmark with its ends found.
pub(crate) struct LocatedLandmark {
    /// The point of the example.
    pub(crate) from: Vec3,
    /// The place on the input's unfolded surface.
    pub(crate) to: Location,
    /// The point there.
    pub(crate) at: Vec3,
}

/// Finds the ends of landmarks.
fn held(landmarks: &[Landmark], example: &Side, query: &Side) -> Result<Vec<LocatedLandmark>, PipelineError> {
    if landmarks.is_empty() {
        return Ok(Vec::new());
    }
    let (one, two) = (&&example.encoded.query.chart, &&query.encoded.query.chart);
    let trees = (OnceLock::new(), OnceLock::new());
    let find = |(k, landmark): (usize, &Landmark)| {
        let end = |end: &str| format!("landmarks[{k}].{end}");
        let from = locate(&landmark.on_example, example, one, &trees.0, &end("on_example"))?.point(one);
        let to = locate(&landmark.on_input, query, two, &trees.1, &end("on_input"))?;
        Ok(LocatedLandmark { from, to, at: to.point(two) })
    };
    landmarks.iter().enumerate().map(find).collect()
}

fn as_constraint(landmark: &Landmark) -> NewConstraint {
    let Landmark { on_example, on_input } = landmark.clone();
    NewConstraint { id: None, on_example: Some(on_example), on_input: Some(on_input) }
}
