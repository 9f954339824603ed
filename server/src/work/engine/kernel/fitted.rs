//! Examples laid on inputs that may end elsewhere, or be closed where the example is open.
//!
//! The map of both as wholes, then maps of parts ([`extents`]), then rough poses ([`poses`]) are starts; each settles on the
//! input with its boundary free ([`Rests`]), until one is convincing. Faces of the example that lie beyond the input are left
//! out, and what of the input lies beyond the example is continued by rows of quads, where that is asked for.

use super::super::{Encoded, Encoding, EngineError, Fitted, Mapped, Model, Opaque, Reach, Refusal, Registration, Side};
use super::constrain::{self, locate};
use super::from_whole::OfWhole;
use super::model::{ModelInner, has_form};
use super::registered::{self, Registered};
use super::sound;
use super::spanned::span;
use super::{Source, facts, fresh, internal};
use crate::pool::Stop;
use quadmuse_kernel::encode::index::Location;
use quadmuse_kernel::extent::{Crop, Extent, extents};
use quadmuse_kernel::fit::rest::{Rested, Rests, Start};
use quadmuse_kernel::fit::{Cropped, Surface, beyond, crop, crop_between, within, without};
use quadmuse_kernel::map::CrossMap;
use quadmuse_kernel::map::assemble::select;
use quadmuse_kernel::map::atlas::likely_matches;
use quadmuse_kernel::map::bend::{Pin, bend};
use quadmuse_kernel::map::reembed::{Ground, turn_back};
use quadmuse_kernel::map::untangle::inward;
use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{PolyMesh, TriMesh, Vec3};
use quadmuse_kernel::register::{Entry, Flip, LevenbergMarquardt, Query};
use quadmuse_kernel::segment::{Segmented, segment_above};
use quadmuse_kernel::settle::{Evidence, Landmark as KernelLandmark, Similarity, poses};
use quadmuse_kernel::topology::{Components, Patch, Topology, primitive};
use quadmuse_kernel::unfold::Uv;
use quadmuse_proto::{
    Beyond, ConstraintEdit, Covers, Landmark, MapEvidence, NewConstraint, OnFold, Topology as Primitive, Verdict,
};
use std::sync::{Arc, OnceLock};

/// The finest level at which parts are registered, in pixels a side.
const SIDE: usize = 128;
/// Pairs of parts that are laid.
const LAID: usize = 2;
/// Extents of which neither share differs by more are the same.
const SAME_SHARE: f64 = 0.02;
/// Ways to match the tips that are tried, of either orientation.
const LED: usize = 2;
/// Below this relief rough poses are tried.
const DOUBTFUL: f64 = 0.65;
/// Poses that are settled.
const POSED: usize = 5;
/// A map that settled must have so much more relief than the one of the charts, which keeps boundaries and sharp edges.
const SETTLED_MARGIN: f64 = 0.01;
/// A landmark that is missed by less, in % of the √area of the input, is met.
const MISSED_MIN_PERCENT: f64 = 0.05;
/// A larger share of faces that are spanned is told.
const SPANNED_TOLD: f64 = 0.02;
/// Less of the example beyond the input is none.
const LOST_MIN: f64 = 0.01;
/// More of the input within the example is all of it.
const COVERED: f64 = 0.97;

/// Whether examples of one topology can be laid on inputs of another.
pub(super) fn reaches(example: Primitive, query: Primitive) -> bool {
    let has_caps = |topology| matches!(topology, Primitive::Disc | Primitive::Sphere);
    example == query || has_caps(example) && has_caps(query)
}

/// The topologies of the examples that a query is ranked against: a disc may lie about either pole of a closed surface.
pub(super) fn ranked_against(query: Primitive) -> Vec<Primitive> {
    match query {
        Primitive::Sphere => vec![Primitive::Sphere, Primitive::Disc],
        _ => vec![query],
    }
}

/// Lays an example where it fits best.
pub(super) fn fit(
    from: Option<&Registration>,
    example: &Side,
    query: &Side,
    (beyond, landmarks): (Beyond, &[Landmark]),
    stop: &Stop,
) -> Result<Fitted, EngineError> {
    let held = held(landmarks, example, query)?;
    let from = from.map(|from| of_wholes(from, example, query, stop)).transpose()?.flatten();
    let by_charts = |from: &Registration| -> Result<Fitted, EngineError> {
        let mut mapped = registered::map(from, example, query, stop)?;
        if !landmarks.is_empty() {
            let set = landmarks.iter().map(as_constraint).collect();
            let edit = ConstraintEdit { set, on_fold: OnFold::Resolve, ..ConstraintEdit::default() };
            let edited = constrain::edit(&mapped, &edit, example, query, stop)?;
            mapped = registered::map(&edited, example, query, stop)?;
        }
        Ok(Fitted { mapped, example: example.clone(), query: query.clone() })
    };
    let on: &ModelInner = query.model.inner.open()?;
    let free = |side: &Side| {
        let topology = side.encoded.encoding.facts.topology;
        matches!(topology, Primitive::Disc | Primitive::Sphere) && on.may_settle(query.segment)
    };
    if let Some(from) = from.as_ref().filter(|_| !free(example) || !free(query)) {
        return by_charts(from);
    }
    let (one, two) = (surface(example)?, surface(query)?);
    let whole = from.as_ref().map(|from| registered::whole(from, example, query, stop)).transpose()?;
    let whole = whole.map(|whole| Start { positions: whole.positions, mirrored: whole.mirrored });
    let input = Arc::clone(&two.query.chart.mesh);
    let relief = |rests: &Rests| whole.as_ref().and_then(|whole| rests.relief(whole)).unwrap_or(-1.0);
    let settled = settled(whole.as_ref(), (example, &one), (query, &two), (&input, &held), &relief, stop)?;
    match (settled, &from) {
        (Some(rested), from) => {
            let fitted = rest(rested, (example, &one), (query, &two), (beyond, &held), stop)?;
            let covers = fitted.mapped.reach.covers;
            // Where boundary on boundary is a good map, the two surfaces end alike.
            if !held.is_empty() {
                return Ok(fitted);
            }
            let ends_elsewhere = covers.example < 1.0 || covers.input < COVERED;
            let folds = fitted.mapped.folds;
            let alike = from.as_ref().filter(|_| ends_elsewhere || folds > 0).map(by_charts).transpose()?;
            let is_better = |alike: &Fitted| {
                alike.mapped.verdict == Verdict::Good && (ends_elsewhere || alike.mapped.folds < folds)
            };
            Ok(alike.filter(is_better).unwrap_or(fitted))
        }
        (None, Some(from)) => by_charts(from),
        (None, None) => {
            let detail =
                "expected an example of which a part matches the input, or the reverse, found none; choose another";
            Err(EngineError::refused(Refusal::NotEncodable, detail))
        }
    }
}

/// The best place at which the example settles, if it is better than where the charts lay it.
fn settled(
    whole: Option<&Start>,
    (example, one): (&Side, &Surface),
    (query, two): (&Side, &Surface),
    (input, held): (&TriMesh, &[Held]),
    relief: &dyn Fn(&Rests) -> f64,
    stop: &Stop,
) -> Result<Option<Rested>, EngineError> {
    let stopped = || stop.reason().is_some();
    let mesh = &one.patch.mesh;
    let Some(mut rests) = Rests::new(mesh, input) else { return Ok(None) };
    if !held.is_empty() {
        let trees = (Bvh::new(mesh), Bvh::new(input));
        let at = |h: &Held| KernelLandmark::between(mesh, &trees.0.closest(h.from), trees.1.closest(h.at));
        let landmarks: Vec<KernelLandmark> = held.iter().filter_map(at).collect();
        rests = rests.holding(&landmarks);
    }
    // What three points or more say of the pose is not sought.
    if let Some(carried) = rests.carried() {
        rests.tries(&carried, &stopped);
        stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
        return Ok(rests.into_best(&stopped));
    }
    if let Some(whole) = whole {
        rests.tries(whole, &stopped);
    }
    if has_form(input) && !rests.is_convincing() {
        let trees = (Bvh::new(mesh), Bvh::new(input));
        let (own, there) = (&one.query.chart.mesh, &two.query.chart.mesh);
        let solver = LevenbergMarquardt::default();
        for tips in &likely_matches(&one.query, &two.query, &solver, LED, &stopped) {
            let pair = |(a, b): &(u32, u32)| {
                let (from, at) = (own.positions.get(*a as usize)?, there.positions.get(*b as usize)?);
                KernelLandmark::between(mesh, &trees.0.closest(*from), trees.1.closest(*at))
            };
            rests.tries_led(&tips.iter().filter_map(pair).collect::<Vec<_>>(), &stopped);
            if rests.is_convincing() {
                break;
            }
        }
    }
    // Of two closed surfaces neither ends anywhere.
    let closed = |side: &Side| side.encoded.encoding.facts.topology == Primitive::Sphere;
    let may_be_part = !(closed(example) && closed(query));
    if may_be_part && has_form(input) && !rests.is_convincing() {
        for start in parts(example, query, (one, two), stop)? {
            rests.tries(&start, &stopped);
            if rests.is_convincing() {
                break;
            }
        }
    }
    if may_be_part && rests.best().is_none_or(|best| best.evidence.relief < DOUBTFUL) {
        for (_, pose) in poses(mesh, input, [!closed(example), !closed(query)], &stopped).iter().take(POSED) {
            let positions = mesh.positions.iter().map(|x| pose.apply(x)).collect();
            rests.tries_whole(&Start { positions, mirrored: false }, &stopped);
            if rests.is_convincing() {
                break;
            }
        }
    }
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
    let least = relief(&rests) + SETTLED_MARGIN;
    let best = rests.into_best(&stopped);
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
    Ok(best.filter(|best| best.evidence.relief > least))
}

/// The registration of all of both: the one given, unless that is of a part; `None` where the topologies differ.
fn of_wholes(
    from: &Registration,
    example: &Side,
    query: &Side,
    stop: &Stop,
) -> Result<Option<Registration>, EngineError> {
    let registered: &Registered = from.inner.open()?;
    if registered.entry.best().unfolded.is_whole() {
        return Ok(Some(from.clone()));
    }
    let (one, two) = (fresh(&example.encoded.encoding)?, fresh(&query.encoded.encoding)?);
    registration(one, two, stop)
}

/// Registers two surfaces that end alike; `None` where the topologies differ.
fn registration(one: &Query, two: &Query, stop: &Stop) -> Result<Option<Registration>, EngineError> {
    let stopped = || stop.reason().is_some();
    let solver = LevenbergMarquardt::default();
    let Some(mut entry) = Entry::coarse(two, one.encoding(), &solver, &stopped) else { return Ok(None) };
    while entry.side() < SIDE {
        entry.advance(two, one.encoding(), &solver, &stopped).map_err(internal)?;
    }
    entry.refine_poles(two, one.encoding(), &solver, &stopped).map_err(internal)?;
    registered::checked(entry, stop).map(Some)
}

/// Starts from the best pairs of parts, each laid like surfaces that end alike.
fn parts(
    example: &Side,
    query: &Side,
    (one, two): (&Surface, &Surface),
    stop: &Stop,
) -> Result<Vec<Start>, EngineError> {
    let stopped = || stop.reason().is_some();
    let mut found: Vec<Extent> = Vec::new();
    for extent in extents(&one.query, &two.query, &LevenbergMarquardt::default(), &stopped) {
        let apart = |a: &Crop, b: &Crop| (a.share - b.share).abs() > SAME_SHARE;
        let is_new = found.iter().all(|f| {
            apart(&f.one, &extent.one) || apart(&f.two, &extent.two) || f.registration.flip != extent.registration.flip
        });
        if is_new && !(extent.one.is_whole() && extent.two.is_whole()) {
            found.push(extent);
        }
    }
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
    let mut starts = Vec::new();
    for extent in found {
        let first = if extent.one.is_whole() { None } else { Some(crop_between(one, &extent.one)) };
        let second = if extent.two.is_whole() { None } else { Some(crop(two, &extent.two)) };
        if matches!(first, Some(None)) || matches!(second, Some(None)) {
            continue;
        }
        let (first, second) = (first.flatten(), second.flatten());
        let part_of_one = first.as_ref().map(|first| first.segmented.parts[0].vertex_of.clone());
        let example = first.map_or_else(|| Ok(example.clone()), |first| of_example(example, first))?;
        let query = second.map_or_else(|| Ok(query.clone()), |second| of_query(query, second))?;
        let (from, to) = (fresh(&example.encoded.encoding)?, fresh(&query.encoded.encoding)?);
        let Some(registration) = registration(from, to, stop)? else { continue };
        let laid = registered::whole(&registration, &example, &query, stop)?;
        starts.push(Start {
            positions: completed(&one.patch.mesh, part_of_one.as_deref(), laid.positions, laid.mirrored),
            mirrored: laid.mirrored,
        });
        if starts.len() == LAID {
            break;
        }
    }
    Ok(starts)
}

/// Where each vertex of an example goes when those of a part of it are laid: the others follow the part as a whole.
fn completed(example: &TriMesh, part: Option<&[u32]>, laid: Vec<Vec3>, mirrored: bool) -> Vec<Vec3> {
    let Some(part) = part else { return laid };
    let reflected = |x: &Vec3| if mirrored { Vec3::new(-x.x, x.y, x.z) } else { *x };
    let pairs = part.iter().zip(&laid).map(|(&v, x)| (reflected(&example.positions[v as usize]), *x, 1.0));
    let fit = Similarity::fit(pairs).unwrap_or_else(Similarity::identity);
    let mut all: Vec<Vec3> = example.positions.iter().map(|x| fit.apply(&reflected(x))).collect();
    part.iter().zip(&laid).for_each(|(&v, x)| all[v as usize] = *x);
    all
}

fn surface(side: &Side) -> Result<Surface, EngineError> {
    let model: &ModelInner = side.model.inner.open()?;
    Ok(Surface {
        patch: Arc::new(model.patch(side.segment)?.clone()),
        query: Arc::clone(fresh(&side.encoded.encoding)?),
    })
}

/// The side that a part of an example is.
fn of_example(whole: &Side, cropped: Cropped) -> Result<Side, EngineError> {
    let model: &ModelInner = whole.model.inner.open()?;
    let patch = model.patch(whole.segment)?;
    let part = &cropped.surface.patch;
    let number = |of: &[u32], v: &u32| of.get(*v as usize).copied().unwrap_or(0);
    let part = Patch {
        vertex_of: part.vertex_of.iter().map(|v| number(&patch.vertex_of, v)).collect(),
        triangle_of: part.triangle_of.iter().map(|t| number(&patch.triangle_of, t)).collect(),
        ..(**part).clone()
    };
    let mut part_of = vec![1; model.segmented.mesh.triangles.len()];
    part.triangle_of.iter().for_each(|&t| part_of[t as usize] = 0);
    let segmented = Segmented { part_of, parts: vec![part], seams: Vec::new(), ..model.segmented.clone() };
    Ok(side(whole, model, segmented, cropped.surface.query))
}

/// The side that a part of a query is; what is left beside it are the model's other segments.
fn of_query(whole: &Side, cropped: Cropped) -> Result<Side, EngineError> {
    let model: &ModelInner = whole.model.inner.open()?;
    Ok(side(whole, model, cropped.segmented, cropped.surface.query))
}

fn side(whole: &Side, of: &ModelInner, segmented: Segmented, query: Arc<Query>) -> Side {
    let inner = ModelInner { prepared: of.prepared.clone(), segmented, laid: None, is_part: true };
    let facts = facts(query.encoding(), inner.faces(0), 0.0);
    let encoding = Encoding { facts, inner: Opaque::new(Source::Fresh(query)) };
    Side {
        model: Arc::new(Model {
            segments: inner.segments(),
            labels: None,
            inner: Opaque::new(inner),
            ..(*whole.model).clone()
        }),
        segment: 0,
        encoded: Arc::new(Encoded { encoding, chart: Opaque::new(()), repairs: Vec::new() }),
    }
}

/// The map of an example that has settled.
fn rest(
    rested: Rested,
    (example, one): (&Side, &Surface),
    (query, two): (&Side, &Surface),
    (beyond, held): (Beyond, &[Held]),
    stop: &Stop,
) -> Result<Fitted, EngineError> {
    let Rested { places, lost, off, mirrored, evidence } = rested;
    let mut locations: Vec<Location> = places.into_iter().map(Location::from).collect();
    let mut bare: Vec<bool> = lost.iter().zip(&off).map(|(lost, off)| *lost || *off).collect();
    let is_less = evidence.lost > LOST_MIN;
    let less = if is_less { without(one, &lost) } else { None };
    let (mut example, mut surface) = (example.clone(), one.clone());
    let mut share = 1.0;
    if let Some(less) = less {
        let left = &less.surface.patch.vertex_of;
        locations = left.iter().map(|&v| locations[v as usize]).collect();
        bare = left.iter().map(|&v| bare[v as usize]).collect();
        share = less.surface.patch.mesh.total_area() / one.patch.mesh.total_area();
        surface = less.surface.clone();
        example = of_example(&example, less)?;
    }
    let chart = &two.query.chart;
    let positions: Vec<Vec3> = locations.iter().map(|l| l.point(chart)).collect();
    let mut cross = CrossMap { locations, positions };
    let spanned = span(&mut cross, &surface.patch.mesh, &bare, chart);
    let sign = registered::sign(mirrored);
    let ground = Ground { chart, index: two.query.index() };
    turn_back(&surface.patch.mesh, &mut cross, &ground, sign, &OnceLock::new());
    let turned = inward(&surface.patch.mesh, &cross, chart, sign);
    let turned_there = turned.iter().filter(|f| spanned.binary_search(f).is_ok()).count();
    let (pinned, missed) = pinned(held, (&surface, &cross), two, mirrored);
    let registration = described(&surface, two, (cross.clone(), pinned), mirrored)?;
    let mut mapped = registered::map(&registration, &example, query, stop)?;
    let field = within(&surface.patch.mesh, &cross.positions, &two.patch.mesh);
    let rest = field.and_then(|field| rest_of(&two.patch.mesh, &field));
    let covered = rest.as_ref().map_or(1.0, |rest| 1.0 - rest.mesh.total_area() / two.patch.mesh.total_area());
    mapped.reach = Reach {
        covers: Covers { example: share, input: covered },
        kept: (share < 1.0).then(|| kept(&example)).transpose()?,
        spanned: spanned.len() as f64 / mapped.mesh.faces.len().max(1) as f64,
        ..Reach::default()
    };
    mapped.evidence = Some(MapEvidence {
        relief: evidence.relief,
        shear: evidence.shear,
        scale_spread: evidence.scale_spread,
        bend: evidence.bend,
        residual: evidence.residual,
        normal_disagreement: evidence.normal_disagreement,
    });
    // What is spanned is flat, and which way it looks says nothing.
    mapped.folds = mapped.folds.saturating_sub(turned_there as u64);
    let folded = mapped.folds as f64 / (mapped.mesh.faces.len() as f64 - spanned.len() as f64).max(1.0);
    (mapped.verdict, mapped.reasons) = judged(&evidence, folded);
    if mapped.reach.spanned > SPANNED_TOLD {
        let percent = 100.0 * mapped.reach.spanned;
        mapped
            .reasons
            .push(format!("the scan has nothing for {percent:.0} % of the example's faces: they are spanned flat"));
    }
    mapped.reasons.extend(missed);
    let mut fitted = Fitted { mapped, example, query: query.clone() };
    if beyond == Beyond::Extend && covered < COVERED {
        extend(&mut fitted, rest.as_ref());
    }
    Ok(fitted)
}

/// A landmark with its ends found.
struct Held {
    /// The point of the example.
    from: Vec3,
    /// The place on the input's unfolded surface.
    to: Location,
    /// The point there.
    at: Vec3,
}

/// A constraint of the caller's: its name and ends.
type Pinned = (String, (Location, Location));

/// Finds the ends of landmarks.
fn held(landmarks: &[Landmark], example: &Side, query: &Side) -> Result<Vec<Held>, EngineError> {
    if landmarks.is_empty() {
        return Ok(Vec::new());
    }
    let (one, two) = (&fresh(&example.encoded.encoding)?.chart, &fresh(&query.encoded.encoding)?.chart);
    let trees = (OnceLock::new(), OnceLock::new());
    let find = |(k, landmark): (usize, &Landmark)| {
        let end = |end: &str| format!("landmarks[{k}].{end}");
        let from = locate(&landmark.on_example, example, one, &trees.0, &end("on_example"))?.point(one);
        let to = locate(&landmark.on_input, query, two, &trees.1, &end("on_input"))?;
        Ok(Held { from, to, at: to.point(two) })
    };
    landmarks.iter().enumerate().map(find).collect()
}

fn as_constraint(landmark: &Landmark) -> NewConstraint {
    let Landmark { on_example, on_input, .. } = landmark.clone();
    NewConstraint { id: None, on_example: Some(on_example), on_input: Some(on_input) }
}

/// Landmarks as constraints of the map of a surface, and a sentence for each that is met nearly only: one whose face lies on the
/// boundary, or that would fold the map.
fn pinned(
    held: &[Held],
    (one, cross): (&Surface, &CrossMap),
    two: &Surface,
    mirrored: bool,
) -> (Vec<Pinned>, Vec<String>) {
    let own_tree = Bvh::new(&one.query.chart.mesh);
    let (mesh, tree) = (&one.patch.mesh, Bvh::new(&one.patch.mesh));
    let (chart, input) = (&two.query.chart, Bvh::new(&two.query.chart.mesh));
    let (size, sign) = (chart.mesh.total_area().sqrt(), registered::sign(mirrored));
    let pin = |held: &Held| Pin { on_example: tree.closest(held.from).into(), to: held.at };
    let can_be = |pins: &[Pin]| bend(mesh, cross, pins, chart, sign, &input).is_ok();
    let fit_together = can_be(&held.iter().map(pin).collect::<Vec<_>>());
    let (mut kept, mut pins, mut missed): (Vec<Pinned>, Vec<Pin>, Vec<String>) = Default::default();
    for (k, held) in held.iter().enumerate() {
        pins.push(pin(held));
        if fit_together || can_be(&pins) {
            kept.push((format!("l{}", k + 1), (own_tree.closest(held.from).into(), held.to)));
            continue;
        }
        let Some(Pin { on_example, .. }) = pins.pop() else { continue };
        let corners = mesh.triangles.get(on_example.triangle as usize).copied().unwrap_or_default();
        let at: Vec3 = (0..3).map(|k| cross.positions[corners[k] as usize] * on_example.barycentric[k]).sum();
        let percent = 100.0 * (at - held.at).norm() / size;
        if percent > MISSED_MIN_PERCENT {
            missed.push(format!("landmark {} is met but for {percent:.2} % of the scan's size", k + 1));
        }
    }
    (kept, missed)
}

/// A registration that stands for a map given by places.
fn described(
    one: &Surface,
    two: &Surface,
    (cross, pinned): (CrossMap, Vec<Pinned>),
    mirrored: bool,
) -> Result<Registration, EngineError> {
    let flip = Flip { u: mirrored, v: false };
    let (chart, tree) = (&two.query.chart, Bvh::new(&two.query.chart.mesh));
    let (own, own_tree) = (&one.query, Bvh::new(&one.patch.mesh));
    let taken = |uv: Uv| -> Option<Uv> {
        let near = own_tree.closest(own.index().locate(&own.chart, uv).point(&own.chart));
        let corners = one.patch.mesh.triangles.get(near.triangle as usize)?;
        let to: Vec3 = (0..3).map(|k| cross.positions[corners[k] as usize] * near.barycentric[k]).sum();
        Some(Location::from(tree.closest(to)).uv(chart))
    };
    let features = own.encoding().features.iter().filter_map(|f| Some((flip.apply(f.uv), taken(f.uv)?)));
    let (p, q) = features.unzip();
    let entry = Entry::laid(&two.query, flip, SIDE, p, q).ok_or_else(|| internal("expected an unfolded query"))?;
    let of_whole = OnceLock::new();
    let _ = of_whole.set(OfWhole::settled(&one.patch, cross, mirrored));
    Ok(registered::describe(Registered { of_whole: Arc::new(of_whole), pinned, ..Registered::of(entry) }))
}

/// The vertices of an example's file that the faces of its segment use, in order.
fn kept(example: &Side) -> Result<Vec<u32>, EngineError> {
    let inner: &ModelInner = example.model.inner.open()?;
    let mesh = &example.model.mesh;
    let mut used = vec![false; mesh.positions.len()];
    for &t in &inner.patch(example.segment)?.triangle_of {
        let face = inner.segmented.mesh.polygon_of[t as usize] as usize;
        mesh.faces.face(face).iter().for_each(|&v| used[v as usize] = true);
    }
    Ok((0..used.len() as u32).filter(|&v| used[v as usize]).collect())
}

/// What of an input lies beyond the example.
fn rest_of(input: &TriMesh, field: &[f64]) -> Option<Patch> {
    let mut cut = segment_above(input, field).ok()?;
    (cut.parts.len() > 1).then(|| cut.parts.swap_remove(1))
}

/// The map after an edit, continued to where the input ends if it was before.
pub(super) fn edited(
    from: &Registration,
    before: &Mapped,
    example: &Side,
    query: &Side,
    stop: &Stop,
) -> Result<Mapped, EngineError> {
    let mapped = registered::map(from, example, query, stop)?.after(before);
    let registered: &Registered = from.inner.open()?;
    let (Some(of_whole), Some(_)) = (registered.of_whole.get(), before.reach.own) else { return Ok(mapped) };
    let (of, on): (&ModelInner, &ModelInner) = (example.model.inner.open()?, query.model.inner.open()?);
    let (one, two) = (&of.patch(example.segment)?.mesh, &on.patch(query.segment)?.mesh);
    let field = within(one, of_whole.positions(), two);
    let mut fitted = Fitted { mapped, example: example.clone(), query: query.clone() };
    extend(&mut fitted, field.and_then(|field| rest_of(two, &field)).as_ref());
    Ok(fitted.mapped)
}

/// A map without the rows that continue it; `None` where it has none.
pub(super) fn own(mapped: &Mapped) -> Option<Mapped> {
    let (_, faces) = mapped.reach.own?;
    let keep: Vec<bool> = (0..mapped.mesh.faces.len() as u64).map(|f| f < faces).collect();
    let mesh = Arc::new(select(&mapped.mesh, &keep));
    let mut own = Mapped { part: Arc::clone(&mesh), mesh, ..mapped.clone() };
    (own.reach.own, own.reach.inspired) = (None, None);
    own.reasons.push("the rest of the scan is left bare: rows of quads would leave it".into());
    Some(own)
}

/// Continues a map to where the input ends.
fn extend(fitted: &mut Fitted, rest: Option<&Patch>) {
    let found = rest.and_then(|rest| primitive(&rest.mesh, Components::Largest).ok());
    let rest = found.filter(|rest| matches!(rest.topology, Topology::Annulus | Topology::Disc));
    let mapped = &mut fitted.mapped;
    let own = &mapped.mesh;
    let Some(grown) = rest.and_then(|rest| beyond::continued(own, &rest)) else {
        mapped.reasons.push("the rest of the scan is left bare: rows of quads can't go round its openings".into());
        return;
    };
    let (all, part) = (area(&grown), area(own));
    mapped.reach.own = Some((own.positions.len() as u64, own.faces.len() as u64));
    mapped.reach.inspired = Some(part / all.max(f64::MIN_POSITIVE));
    mapped.mesh = Arc::new(grown);
    mapped.part = Arc::clone(&mapped.mesh);
}

fn area(mesh: &PolyMesh) -> f64 {
    mesh.faces.iter().map(|face| sound::area(mesh, face)).sum()
}

/// Confidence from which on a settled map is good, or fair; calibrated in tests/records.
const CONFIDENCE: [f64; 2] = [0.4, -0.08];
/// Share of faces that look inward up to which it is good, or fair: hidden faces of bodies do in the truth too.
const FOLDED: [f64; 2] = [0.02, 0.06];

/// The verdict on a map that has settled, with a sentence for each measure that is not good. Relief falls where shapes
/// differ, and bend grows where the map is wrong, so neither is told alone.
fn judged(evidence: &Evidence, folded: f64) -> (Verdict, Vec<String>) {
    let confidence = evidence.agreement();
    let mut reasons = Vec::new();
    let mut measure = |is_good: bool, is_fair: bool, why: &str| {
        if !is_good {
            reasons.push(why.to_owned());
        }
        if is_good {
            Verdict::Good
        } else if is_fair {
            Verdict::Fair
        } else {
            Verdict::Poor
        }
    };
    let [good, fair] = CONFIDENCE;
    let alike =
        measure(confidence >= good, confidence >= fair, "bumps and hollows of the example lie on others of the scan");
    let [good, fair] = FOLDED;
    let smooth = measure(folded <= good, folded <= fair, "some faces look into the scan");
    (worse(alike, smooth), reasons)
}

fn worse(a: Verdict, b: Verdict) -> Verdict {
    if a == Verdict::Poor || b == Verdict::Poor {
        Verdict::Poor
    } else if a == Verdict::Fair || b == Verdict::Fair {
        Verdict::Fair
    } else {
        Verdict::Good
    }
}
