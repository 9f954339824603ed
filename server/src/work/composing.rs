//! Compositions: the maps chosen for a query's segments, stitched into one mesh of quads.

mod headline;
mod regular;
mod side_by_side;
mod sound;
mod surrounded;
mod waist;

use super::engine::{
    AllowedFlaws, BARE, BARE_MIN, Encoded, EngineError, Judgement, Model, OnePart, Part, StitchOptions,
};
use super::laying;
use super::making::{self, Making, Tell};
use super::mapping::{LiveMap, MapState, get};
use super::query::{LiveQuery, ms_since};
use super::{REQUEST_TIME_MAX, Work, WorkError};
use crate::pool::{Job, Lane, Stop, StopReason};
use futures_util::StreamExt;
use headline::{BroughtMap, Headline, headline, is_crumpled};
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::composition::{DENSITY_MAX, SMOOTHING_MAX};
use quadmuse_proto::{
    Composition, CompositionId, CompositionPart, ExampleId, MakingState, NewComposition, Product, Verdict,
};
use side_by_side::{as_mapped, closer, standing, unstitched};
use sound::{MeasuredComposition, stitched_sound};
use std::sync::Arc;
use std::time::Instant;
use surrounded::RimCut;

/// Examples that make up less of a composition give way to a regular layout of all of it, unless they were chosen: they are not
/// worth the seams about them. *Untuned:* on seven scans with less, regular layouts had .38 of the change of angles and .55 of the
/// extraordinary vertices, and none of the examples showed (tests/records/floor-2026-11-27.md).
pub(super) const INSPIRED_LEAST: f64 = 0.1;

/// Most compositions a query.
pub const COMPOSITIONS_MAX: usize = 64;

/// Most faces of a composition.
const FACES_MAX: u64 = 4_000_000;

/// Faces that a composition is taken to have at least: regular layouts, and subdividing to follow the input, make some.
const FACES_LEAST: u64 = 16_000;

/// The share of a composition's progress at which all parts have their maps.
const LAID_SHARE: f64 = 0.7;

/// Memory that stitching takes for each face, at most.
const MEMORY_PER_FACE: u64 = 1500;

/// Memory that stitching takes for each face of the input: its surface, and the trees it is sought in.
const MEMORY_PER_INPUT_FACE: u64 = 300;

/// Where that was too little, this many times as much is admitted, once.
const MEMORY_TIMES: u64 = 8;

/// Memory that the stitched mesh takes for each face, as long as it is held.
const MEMORY_PER_FACE_HELD: u64 = 200;

/// A composition and its mesh.
pub struct LiveComposition {
    /// Its share of the memory.
    _held: Job,
    /// The composition as it goes over the wire.
    pub summary: Composition,
    /// The mesh.
    pub mesh: Arc<PolyMesh>,
}

/// Stitches maps of a query, on a task of its own, which waits for those that are still being made; segments that are not named
/// are filled. Returns the composition's id.
///
/// # Errors
/// What is wrong with the request; what goes wrong later, the composition's making tells.
pub fn start(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    wanted: NewComposition,
) -> Result<(CompositionId, Arc<Making>), WorkError> {
    let under_way: Vec<Arc<Making>> =
        wanted.parts.iter().filter_map(|part| live.makings.under_way(Product::Map, &part.map)).collect();
    if under_way.is_empty() {
        check(live, &wanted)?;
    }
    let id = CompositionId::generate_on(work.server);
    let handles = (Arc::clone(work), Arc::clone(live));
    let make = move |tell: Arc<dyn Fn(&'static str, f64) + Send + Sync>| async move {
        for map in under_way {
            tell("waiting for its maps", 0.0);
            map.over().await;
        }
        made(&handles.0, &handles.1, (id, wanted), &*tell).await.map(drop)
    };
    Ok((id, making::start(work, live, (Product::Composition, id.to_string()), make)?))
}

/// Checks what can be told before anything is computed; the maps that are named.
fn check(live: &LiveQuery, wanted: &NewComposition) -> Result<Vec<Option<Arc<LiveMap>>>, WorkError> {
    let named = maps_of(live, wanted)?;
    if live.compositions().len() >= COMPOSITIONS_MAX {
        return Err(WorkError::TooMany { of: "compositions", limit: COMPOSITIONS_MAX });
    }
    Ok(named)
}

/// Memory that a composition of so many faces takes on an input.
pub(super) fn memory(faces: u64, input: &Model) -> u64 {
    faces.max(FACES_LEAST) * MEMORY_PER_FACE + input.mesh.faces.len() as u64 * MEMORY_PER_INPUT_FACE
}

/// Stitches maps of a query, as [`start`] does, while the caller waits.
///
/// # Errors
/// Mistakes of the request; refusals of the pool and of the engine.
pub async fn create(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    wanted: NewComposition,
    tell: Tell<'_>,
) -> Result<Arc<LiveComposition>, WorkError> {
    made(work, live, (CompositionId::generate_on(work.server), wanted), tell).await
}

async fn made(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    (id, wanted): (CompositionId, NewComposition),
    tell: Tell<'_>,
) -> Result<Arc<LiveComposition>, WorkError> {
    let start = Instant::now();
    let named = check(live, &wanted)?;
    let CompositionInputs { mut parts, mut summaries, mut templates, mut maps, mut laid, mut instead } =
        gathered(work, live, &wanted, named, tell).await?;
    tell("stitching", LAID_SHARE);
    let needed = memory(faces_at(&parts, wanted.density)?, &live.model);
    let job = work.admit(live.caller.user, needed, REQUEST_TIME_MAX)?;
    let (engine, mut model) = (Arc::clone(&work.engine), Arc::clone(&live.model));
    let mut allowed = allowed(&maps);
    let how = StitchOptions { smoothing: wanted.smoothing, density: wanted.density };
    let mut one = one_example(&maps).filter(|_| wanted.density == 0 && !model.is_waist);
    let lone = lone(&maps, allowed.bare);
    // Maps as they are have the density of their examples.
    let mut alone = lone.clone().filter(|_| wanted.density == 0);
    // Whoever names maps wants all of them.
    let is_open = wanted.parts.is_empty() && wanted.keep.is_empty();
    let of_several = surrounded::centre(&model, &maps).filter(|_| is_open && !model.is_waist);
    let centres = match model.is_waist {
        true => waist::by_worth(&model, &maps),
        false => lone.iter().chain(&of_several).cloned().collect(),
    };
    let mut around = None;
    for map in centres {
        let may_fail = alone.is_some() || of_several.is_some() || model.is_waist;
        around = laid_around(work, live, (&map, &maps), &job, (how, allowed, may_fail)).await?;
        if around.is_some() {
            break;
        }
    }
    // Whatever that took.
    let job = job.renew(Some(REQUEST_TIME_MAX));
    if model.is_waist && around.is_none() {
        (model, parts) = waist::in_primitives(work, live, &job).await?;
        (instead, maps, laid) = (Vec::new(), Vec::new(), Vec::new());
        summaries = Vec::new();
        templates = (0..live.model.segments.len() as u32).collect();
    }
    // Examples that would make up too little give way in the end: what nobody named is not stitched for that first.
    let share: f64 = maps.iter().flatten().map(|map| map.share_of(&model)).sum();
    let is_too_little = match &lone {
        Some(_) => share < ALONE_MIN && wanted.keep.is_empty(),
        None => share < INSPIRED_LEAST && is_open && may_give_way(&maps, &wanted, 0),
    };
    let is_too_little = is_too_little && around.is_none() && !model.is_waist;
    if is_too_little {
        (alone, one) = (None, None);
        let segments = 0..parts.len() as u32;
        parts = regular::templates(live, segments.clone()).await?;
        (instead, maps, laid) = (Vec::new(), Vec::new(), Vec::new());
        (summaries, templates) = (Vec::new(), segments.collect());
        allowed = AllowedFlaws::default();
    }
    let again = (Arc::clone(&engine), Arc::clone(&model), parts.clone(), instead.clone());
    let (laid_maps, is_kept) = (maps.clone(), !wanted.keep.is_empty());
    let stitch = move |stop: &Stop| -> Result<MeasuredComposition, EngineError> {
        if let Some(sound) = around {
            return Ok(sound);
        }
        // What was chosen for its layout keeps its faces.
        let split = |sound: MeasuredComposition, allowed: AllowedFlaws| match is_kept {
            true => Ok(sound),
            false => closer(&*engine, &model, sound, allowed),
        };
        if let Some(alone) = alone.map(|map| as_mapped(&[(0, map)], None, 1)) {
            let appraisal = engine.appraise(&model, &alone, allowed)?;
            return split(MeasuredComposition::of(alone, appraisal), allowed);
        }
        // One example on all segments needs no stitching: it comes back whole.
        if let Some((example, parts)) = &one
            && let Some(whole) = engine.rejoin(&model, example, parts, stop)?
        {
            let appraisal = engine.appraise(&model, &whole, allowed)?;
            return Ok(MeasuredComposition::of(whole, appraisal));
        }
        let sound = stitched_sound(&*engine, &model, (parts, &instead), (how, allowed), stop)?;
        let by_itself = engine.alone(&model)?;
        let standing = if wanted.density == 0 { standing(&model, &by_itself, &maps) } else { Vec::new() };
        if standing.is_empty() || !sound.is_poor_beside(&standing, &model) {
            return Ok(sound);
        }
        let beside = unstitched(&*engine, &model, standing, (&sound.made, &by_itself), allowed)?;
        let is_result =
            |beside: &MeasuredComposition| beside.appraisal.covered >= ALONE_MIN && beside.appraisal.away <= AWAY_MAX;
        let is_smoother =
            |beside: &MeasuredComposition| !sound.appraisal.flaws.is_empty() || !is_crumpled(&beside.appraisal);
        match beside.filter(|beside| is_result(beside) && is_smoother(beside)) {
            Some(beside) => split(beside, AllowedFlaws { bare: 1.0, ..allowed }),
            None => Ok(sound),
        }
    };
    let mut job = job;
    let mut found: Result<MeasuredComposition, WorkError> =
        WorkError::joined(work.pool.run(&job, Lane::Lay, stitch).await);
    if found.as_ref().err().and_then(WorkError::stop_reason) == Some(StopReason::Memory) {
        // Of a mesh of very many handles the estimate is too low. What it takes is paid for, if there is as much.
        drop(job);
        job = work.admit(live.caller.user, needed * MEMORY_TIMES, REQUEST_TIME_MAX)?;
        let (engine, model, parts, instead) = again;
        let plainly = move |stop: &Stop| stitched_sound(&*engine, &model, (parts, &instead), (how, allowed), stop);
        found = WorkError::joined(work.pool.run(&job, Lane::Lay, plainly).await);
    }
    let mut found = found?;
    // What could not be stitched may be laid out around the map that is most of it.
    if let Some(map) = side_by_side::most(&live.model, &found, &laid_maps)
        && wanted.keep.is_empty()
    {
        let around = laid_around(work, live, (&map, &laid_maps), &job, (how, allowed, true)).await?;
        if let Some(around) = around.filter(|around| around.is_better_than(&found)) {
            found = around;
        }
    }
    if let Some(around) = found.around.take() {
        templates.extend(summaries.iter().map(|part| part.segment).filter(|segment| !around.stand.contains(segment)));
        summaries.retain(|part| around.stand.contains(&part.segment));
        laid = around.laid;
        laid.iter_mut().flatten().for_each(|laid| laid.reasons.retain(|reason| !reason.starts_with(BARE)));
    }
    if is_too_little && lone.is_none() {
        found.made.notes.push(regular::gave_way(&regular::makes_up(share)));
    }
    let mut headline = headline_of(&found, &laid, &live.model);
    let is_usable = headline.verdict < Verdict::Poor && headline.inspired >= INSPIRED_LEAST;
    if let Some(reason) = regular::reason(&headline, &found.appraisal)
        && may_give_way(&laid_maps, &wanted, found.gave_way.len())
        && let Some(mut instead) = regular::regular(work, live, &job, (&found, is_usable, how)).await?
    {
        instead.made.notes.push(regular::gave_way(&reason));
        headline = headline_of(&instead, &laid, &live.model);
        (summaries, templates) = (Vec::new(), (0..live.model.segments.len() as u32).collect());
        found = instead;
    }
    let MeasuredComposition { made: stitched, appraisal, gave_way, unstitched, .. } = found;
    templates.extend(&gave_way);
    summaries.retain(|part| !gave_way.contains(&part.segment));
    if !unstitched.is_empty() {
        let is_example = |segment: u32| stitched.is_example(segment as usize);
        summaries.retain(|part| unstitched.contains(&part.segment) && is_example(part.segment));
        templates.retain(|segment| unstitched.contains(segment) && !is_example(*segment));
    }
    templates.sort_unstable();
    let counts = super::ingest::counts_of(&stitched.mesh);
    let held = job.kept(counts.faces * MEMORY_PER_FACE_HELD);
    tracing::debug!(query = %live.id, covered = appraisal.covered, away = appraisal.away, turned = appraisal.turned, "stitched");
    let summary = Composition {
        id,
        query: live.id,
        state: MakingState::Done,
        progress: 1.0,
        verdict: headline.verdict,
        inspired: headline.inspired,
        reasons: headline.reasons,
        covers: headline.covers,
        parts: summaries,
        templates,
        smoothing: wanted.smoothing,
        density: wanted.density,
        vertices: counts.vertices,
        quads: counts.quads,
        triangles: counts.triangles,
        extraordinary_vertices: stitched.extraordinary_vertices,
        extraordinary_before: stitched.extraordinary_before,
        notes: stitched.notes,
        total_ms: ms_since(start),
    };
    let composition = Arc::new(LiveComposition { _held: held, summary, mesh: stitched.mesh });
    live.compositions().insert(composition.summary.id, Arc::clone(&composition));
    Ok(composition)
}

/// Returns the headline of a composition, given the maps that were brought for its segments.
fn headline_of(found: &MeasuredComposition, brought: &[Option<BroughtMap>], model: &Model) -> Headline {
    let mut headline = headline(brought, &found.appraisal);
    if !found.unstitched.is_empty() {
        headline.tell_side_by_side(found.unstitched.len() < model.segments.len());
    }
    headline
}

/// Tells whether there are more examples than the `gone` that gave way already, and nobody chose one of them by hand: whoever names a
/// poor map wants it all the same.
fn may_give_way(maps: &[Option<Arc<LiveMap>>], wanted: &NewComposition, gone: usize) -> bool {
    let is_example = |map: &&Arc<LiveMap>| map.example_id() != ExampleId::TEMPLATE;
    let mut there = maps.iter().flatten().filter(is_example);
    let is_any_left = there.clone().count() > gone;
    wanted.keep.is_empty() && is_any_left && there.all(|map| !map.newest().mapped.is_poor_stitched())
}

/// A map with what lies around it; `None` where nothing does, or it is not sound. Where there is something else to fall back on, it
/// is `None` at its deadline, too: half of a composition's time.
async fn laid_around(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    (map, maps): (&LiveMap, &[Option<Arc<LiveMap>>]),
    job: &Job,
    (how, allowed, may_fail): (StitchOptions, AllowedFlaws, bool),
) -> Result<Option<MeasuredComposition>, WorkError> {
    let Some(surrounded) = RimCut::of(work, live, (map, maps), job).await? else { return Ok(None) };
    let (job, engine) = (job.renew(Some(REQUEST_TIME_MAX / 2)), Arc::clone(&work.engine));
    let stitch = move |stop: &Stop| surrounded.stitched(&*engine, (how, allowed), stop);
    match WorkError::joined(work.pool.run(&job, Lane::Lay, stitch).await) {
        Err(error) if may_fail && error.stop_reason().is_some_and(|reason| reason != StopReason::Cancelled) => Ok(None),
        found => found,
    }
}

/// Maps alone that cover less of the scan are no result: a regular layout of all of it is. *Untuned.*
const ALONE_MIN: f64 = 0.25;

/// Nor are those whose faces lie farther off the scan on average, as a share of its diagonal: a cage of a dozen quads. As far may
/// an example lie that is moved onto its scan (`pipeline/as_one`).
const AWAY_MAX: f64 = 0.01;

/// The one map of a query where it leaves some of the scan bare.
fn lone(maps: &[Option<Arc<LiveMap>>], bare: f64) -> Option<Arc<LiveMap>> {
    let [Some(map)] = maps else { return None };
    (bare > BARE_MIN).then(|| Arc::clone(map))
}

/// What the maps of all segments are on purpose. A map that leaves some of the scan bare does so alone: beside others the rest is
/// theirs.
fn allowed(maps: &[Option<Arc<LiveMap>>]) -> AllowedFlaws {
    let spanned = maps.iter().flatten().map(|map| map.newest().mapped.reach.spanned).fold(0.0, f64::max);
    let bare = match maps {
        [Some(map)] => bare(map),
        _ => 0.0,
    };
    AllowedFlaws { spanned, bare }
}

/// The share of its segment that a map leaves bare, where no rows of quads continue it.
fn bare(map: &LiveMap) -> f64 {
    let reach = &map.newest().mapped.reach;
    if reach.own.is_some() { 0.0 } else { 1.0 - reach.covers.input }
}

/// What is told of a map that takes part in a composition.
fn laid(map: &MapState) -> BroughtMap {
    let Judgement { verdict, reasons } = map.mapped.stitched();
    BroughtMap { verdict, reasons, inspired: map.summary.inspired, covers_example: map.summary.covers.example }
}

/// The inputs of a composition.
#[derive(Default)]
struct CompositionInputs {
    parts: Vec<Part>,
    summaries: Vec<CompositionPart>,
    /// Segments without an example.
    templates: Vec<u32>,
    /// The map of each segment that has one that is not poor, or was chosen.
    maps: Vec<Option<Arc<LiveMap>>>,
    /// What is told of the map of each segment that has one.
    laid: Vec<Option<BroughtMap>>,
    /// Each segment that takes an example which may give way, for a regular layout.
    instead: Vec<Option<Arc<Encoded>>>,
}

/// One part a segment: what is named, else the best map, else a regular layout.
async fn gathered(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    wanted: &NewComposition,
    named: Vec<Option<Arc<LiveMap>>>,
    tell: Tell<'_>,
) -> Result<CompositionInputs, WorkError> {
    let mut all = CompositionInputs::default();
    let count = named.len().max(1) as f64;
    // What lies around a side of a waist is laid out around it.
    let is_around = live.model.is_waist && named.iter().any(Option::is_some);
    let unnamed = (0u32..).zip(&named).filter(|(_, named)| named.is_none() && !is_around);
    let unnamed: Vec<u32> = unnamed.map(|(segment, _)| segment).collect();
    let mut best = laying::best_maps(work, live, &unnamed, wanted.beyond);
    for (segment, named) in (0u32..).zip(named) {
        tell("laying examples on the parts", LAID_SHARE * f64::from(segment) / count);
        let is_named = named.is_some();
        let map = match named {
            Some(map) => Some(map),
            None if is_around => None,
            None => match best.next().await {
                Some(Err(error)) if !laying::is_late(&error) => return Err(error),
                found => found.and_then(Result::ok).flatten(),
            },
        };
        // Beside others, or of the whole, a regular layout is laid anew, along a field where it can be.
        let map = map.filter(|map| wanted.keep.contains(&segment) || !is_plain_layout(map));
        let Some(map) = map else {
            all.maps.push(None);
            all.laid.push(None);
            all.instead.push(None);
            all.templates.push(segment);
            all.parts.push(Part::Template(live.encoded(segment).await?));
            continue;
        };
        let taken = CompositionPart { segment, map: map.id };
        let newest = map.newest();
        all.laid.push((map.example_id() != ExampleId::TEMPLATE).then(|| laid(&newest)));
        let (part, whole) = (Arc::clone(&newest.mapped.part), Arc::clone(&newest.mapped.mesh));
        if !is_named && newest.mapped.is_poor_stitched() {
            all.templates.push(segment);
            all.maps.push(None);
            all.instead.push(None);
            let instead = live.encoded(segment).await?;
            all.parts.push(match newest.mapped.verdict {
                // Nobody is told to name it all the same.
                Verdict::Broken => Part::Template(instead),
                _ => Part::Poor(instead),
            });
            continue;
        }
        all.summaries.push(taken);
        let may_give_way = !newest.mapped.is_of_whole && !wanted.keep.contains(&segment);
        all.instead.push(if may_give_way { Some(live.encoded(segment).await?) } else { None });
        all.parts.push(if newest.mapped.is_of_whole {
            Part::OfWhole(part)
        } else if wanted.keep.contains(&segment) {
            Part::Kept(part)
        } else {
            Part::Mapped { part, whole }
        });
        all.maps.push(Some(map));
    }
    Ok(all)
}

/// Tells whether a map is a regular layout that nobody has edited.
fn is_plain_layout(map: &LiveMap) -> bool {
    map.example_id() == ExampleId::TEMPLATE && !map.newest().is_edited()
}

/// The faces that the mapped parts will have together, about; known before the work.
fn faces_at(parts: &[Part], density: i32) -> Result<u64, WorkError> {
    let faces_of = |part: &Part| match part {
        Part::Mapped { part, .. } | Part::Kept(part) | Part::OfWhole(part) => part.faces.len() as u64,
        Part::Poor(_) | Part::Template(_) => 0,
    };
    let faces =
        parts.iter().map(faces_of).sum::<u64>().saturating_mul(4u64.saturating_pow(density.max(0).unsigned_abs()));
    if faces > FACES_MAX {
        let expected = format!("at which all parts together have at most {FACES_MAX} faces");
        return Err(WorkError::parameter("density", expected, format!("{density}, at which they have {faces}")));
    }
    Ok(faces)
}

/// A composition of a query.
///
/// # Errors
/// [`WorkError::NoSuchComposition`], [`WorkError::NotMade`].
pub fn find(live: &LiveQuery, id: CompositionId) -> Result<Arc<LiveComposition>, WorkError> {
    let there = live.compositions().get(&id).cloned();
    there.ok_or_else(|| live.makings.missing(Product::Composition, &id).unwrap_or(WorkError::NoSuchComposition(id)))
}

/// Takes a composition out; one that is made is cancelled.
///
/// # Errors
/// [`WorkError::NoSuchComposition`].
pub fn remove(live: &LiveQuery, id: CompositionId) -> Result<(), WorkError> {
    let is_gone = live.makings.remove(Product::Composition, &id) || live.compositions().remove(&id).is_some();
    is_gone.then_some(()).ok_or(WorkError::NoSuchComposition(id))
}

/// The example from which all segments of the query take their maps, if it is one, with those maps.
fn one_example(maps: &[Option<Arc<LiveMap>>]) -> Option<(Arc<Model>, Vec<OnePart>)> {
    let maps: Vec<&Arc<LiveMap>> = maps.iter().map(Option::as_ref).collect::<Option<_>>()?;
    let first = maps.first().filter(|_| maps.len() > 1)?;
    if maps.iter().any(|map| map.example_id() != first.example_id()) {
        return None;
    }
    let part = |map: &&Arc<LiveMap>| {
        let (example_segment, newest) = (map.example()?.segment, map.newest());
        let is_edited = newest.is_edited();
        let mesh = Arc::clone(newest.mapped.unextruded());
        Some(OnePart { segment: map.segment, example_segment, mesh, is_edited })
    };
    Some((Arc::clone(&first.example()?.model), maps.iter().map(part).collect::<Option<_>>()?))
}

/// Checks rounds of smoothing and steps of density.
///
/// # Errors
/// [`WorkError::Parameter`].
pub(super) fn check_options(smoothing: u32, density: i32) -> Result<(), WorkError> {
    if smoothing > SMOOTHING_MAX {
        return Err(WorkError::parameter("smoothing", format!("from 0 to {SMOOTHING_MAX}"), smoothing));
    }
    if density.unsigned_abs() > DENSITY_MAX.unsigned_abs() {
        return Err(WorkError::parameter("density", format!("from -{DENSITY_MAX} to {DENSITY_MAX}"), density));
    }
    Ok(())
}

/// The maps named, one slot a segment: each segment at most once, each with a map of its own.
fn maps_of(live: &LiveQuery, wanted: &NewComposition) -> Result<Vec<Option<Arc<LiveMap>>>, WorkError> {
    check_options(wanted.smoothing, wanted.density)?;
    let mut maps: Vec<Option<Arc<LiveMap>>> = vec![None; live.model.segments.len()];
    if let Some(&segment) = wanted.keep.iter().find(|&&segment| segment as usize >= maps.len()) {
        return Err(WorkError::NoSuchSegment { of: "the query", count: maps.len(), segment });
    }
    for part in &wanted.parts {
        let map = get(live, part.map)?;
        if map.segment != part.segment {
            let expected = format!("to name the segment of map {}, {}", part.map, map.segment);
            return Err(WorkError::parameter("parts", expected, part.segment));
        }
        let (of, count, segment) = ("the query", maps.len(), part.segment);
        let slot = maps.get_mut(segment as usize).ok_or(WorkError::NoSuchSegment { of, count, segment })?;
        if slot.replace(map).is_some() {
            let expected = "to name each segment once";
            return Err(WorkError::parameter("parts", expected, format!("segment {segment} again")));
        }
    }
    Ok(maps)
}
