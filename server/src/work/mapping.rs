//! Maps: an example chosen from the ranking is laid on the input, and its constraints are edited.
//!
//! An example that was passed over at a coarse level is first registered through the levels it missed.

use super::engine::{Encoding, Engine, EngineError, Lead, Mapped, Model, Refusal, Side, Wishes};
use super::ingest;
use super::making::{self, Making, Tell, tell_nobody};
use super::query::{LiveQuery, MAPS_MAX, ms_since};
use super::ranking::Candidate;
use super::search::{caught_up, newcomer};
use super::{REQUEST_TIME_MAX, Work, WorkError, composing, landmarks};
use crate::pool::{Job, Lane};
use quadmuse_proto::constraint::CONSTRAINTS_MAX;
use quadmuse_proto::{
    Beyond, ConstraintEdit, ConstraintOrigin, Covers, EntryState, Example, ExampleId, MakingState, Map, MapId,
    MapTimings, NewMap, Product,
};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Memory that laying takes for each face of the input: its samples, and the trees and grids it is sought in.
const MEMORY_PER_INPUT_FACE: u64 = 600;

/// A map, and what is needed to edit it.
pub struct LiveMap {
    /// Its id.
    pub id: MapId,
    /// The query's segment.
    pub segment: u32,
    /// `None` for a regular layout.
    example: Option<Side>,
    query: Side,
    example_id: ExampleId,
    /// How the input is treated where it reaches beyond the example.
    pub beyond: Beyond,
    edits: tokio::sync::Mutex<()>,
    newest: Mutex<Arc<MapState>>,
    /// Its share of the memory.
    _held: Job,
}

/// A revision of a map.
pub struct MapState {
    /// The mesh, the constraints and how good it is.
    pub mapped: Mapped,
    /// The map as it goes over the wire.
    pub summary: Map,
}

impl MapState {
    /// Tells whether the user has moved or added a constraint.
    pub fn is_edited(&self) -> bool {
        self.mapped.constraints.iter().any(|c| c.origin == ConstraintOrigin::User)
    }
}

impl LiveMap {
    /// The newest revision.
    pub fn newest(&self) -> Arc<MapState> {
        Arc::clone(&self.newest.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The example.
    pub fn example_id(&self) -> ExampleId {
        self.example_id
    }

    /// The example's side; `None` for a regular layout.
    pub fn example(&self) -> Option<&Side> {
        self.example.as_ref()
    }

    /// The share of a scan's faces that it covers.
    pub fn share_of(&self, scan: &Model) -> f64 {
        self.newest().summary.covers.input * scan.share_of(self.segment)
    }

    fn put(&self, state: MapState) -> Arc<MapState> {
        let state = Arc::new(state);
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = Arc::clone(&state);
        state
    }
}

/// Maps an example on a query.
///
/// # Errors
/// What is not there, [`WorkError::TopologyDiffers`], refusals of the pool and of the engine.
pub async fn create(work: &Arc<Work>, live: &Arc<LiveQuery>, wanted: NewMap) -> Result<Arc<LiveMap>, WorkError> {
    made(work, live, (MapId::generate_on(work.server), wanted), &tell_nobody).await
}

/// Maps an example on a query, on a task of its own; the map's id.
///
/// # Errors
/// What is wrong with the request; what goes wrong later, the map's making tells.
pub fn start(work: &Arc<Work>, live: &Arc<LiveQuery>, wanted: NewMap) -> Result<(MapId, Arc<Making>), WorkError> {
    check(work, live, &wanted)?;
    let id = MapId::generate_on(work.server);
    let handles = (Arc::clone(work), Arc::clone(live));
    let make = move |tell: Arc<dyn Fn(&'static str, f64) + Send + Sync>| async move {
        made(&handles.0, &handles.1, (id, wanted), &*tell).await.map(drop)
    };
    Ok((id, making::start(work, live, (Product::Map, id.to_string()), make)?))
}

/// Checks what can be told before anything is computed.
fn check(work: &Work, live: &LiveQuery, wanted: &NewMap) -> Result<(), WorkError> {
    if live.maps().len() >= MAPS_MAX {
        return Err(WorkError::TooMany { of: "maps", limit: MAPS_MAX });
    }
    landmarks::check(wanted)?;
    live.check_segment(wanted.segment)?;
    let (of, count, segment) = match wanted.example {
        ExampleId::TEMPLATE => ("the template", 1, wanted.example_segment),
        id => {
            let example = work.catalogue.example(id)?;
            landmarks::held(&example, wanted)?;
            ("the example", example.segments.len(), wanted.example_segment)
        }
    };
    if segment as usize >= count {
        return Err(WorkError::NoSuchSegment { of, count, segment });
    }
    check_topology(work, live, wanted)
}

/// Checks that surfaces of these two kinds can be compared at all.
fn check_topology(work: &Work, live: &LiveQuery, wanted: &NewMap) -> Result<(), WorkError> {
    if wanted.example == ExampleId::TEMPLATE {
        return Ok(());
    }
    let example = work.catalogue.example(wanted.example)?;
    let expected = live.model.segments.get(wanted.segment as usize).map(|segment| segment.topology);
    let found = example.segments.get(wanted.example_segment as usize).map(|segment| segment.topology);
    match (expected, found) {
        (Some(expected), Some(found)) if expected != found && !work.engine.reaches(found, expected) => {
            Err(WorkError::TopologyDiffers { expected, found })
        }
        _ => Ok(()),
    }
}

async fn made(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    (id, wanted): (MapId, NewMap),
    tell: Tell<'_>,
) -> Result<Arc<LiveMap>, WorkError> {
    let start = Instant::now();
    check(work, live, &wanted)?;
    if wanted.example == ExampleId::TEMPLATE {
        return made_of_template(work, live, (id, &wanted), tell).await;
    }
    let (example, segment) = (work.catalogue.example(wanted.example)?, wanted.example_segment);
    let query = live.encoded(wanted.segment).await?;
    tell("comparing the example with the scan", 0.1);
    let estimate = memory_of(&*work.engine, example.bytes, live.model.mesh.faces.len());
    let job = work.admit(live.caller.user, estimate, REQUEST_TIME_MAX)?;
    let encoding = Arc::new(query.encoding.clone());
    let candidate = registered(work, &job, live, &wanted, &encoding).await?;
    let register_ms = ms_since(start);
    tell("reading the example", 0.3);
    let landmarks = landmarks::held(&example, &wanted)?;
    let lead = match candidate.as_ref().and_then(|candidate| candidate.lead).filter(|_| landmarks.is_empty()) {
        Some(of) => lead(work, live, wanted.segment, of).await?,
        None => None,
    };
    let rough = candidate.as_ref().and_then(|candidate| candidate.rough.clone());
    let rough_agreement = rough.as_ref().map(|rough| rough.agreement);
    let score = candidate.as_ref().map(|candidate| candidate.score);
    let wishes = Wishes { beyond: wanted.beyond, landmarks: landmarks.clone(), lead, rough };
    let example_side = example_side(work, &job, &example, segment).await?;
    let query_side = Side { model: Arc::clone(&live.model), segment: wanted.segment, encoded: query };
    let (from, (one, two)) = (candidate.map(|c| Arc::clone(&c.registration)), (example_side, query_side));
    tell("laying the example on the scan", 0.4);
    let engine = Arc::clone(&work.engine);
    let fit = move |stop: &_| engine.fit(from.as_deref(), &one, &two, &wishes, stop);
    let fitted = work.pool.run(&job, Lane::Lay, fit).await??;
    let mut mapped = fitted.mapped;
    mapped.reasons = landmarks::called(mapped.reasons, &landmarks);
    if let Some(stitched) = &mut mapped.stitched {
        stitched.reasons = landmarks::called(std::mem::take(&mut stitched.reasons), &landmarks);
    }
    let timings = MapTimings { register_ms, map_ms: ms_since(start) - register_ms, total_ms: ms_since(start) };
    let (agreement, local) = mapped.evidence.map(|evidence| (evidence.agreement, evidence.local_relief)).unzip();
    let (verdict, covers) = (mapped.verdict.as_str(), mapped.reach.covers);
    tracing::debug!(query = %live.id, example = %example.name, segment, verdict, agreement, local, ?covers, score, laid_roughly = rough_agreement, reasons = ?mapped.reasons, ms = timings.map_ms, "laid");
    let summary = summary(live, id, wanted.segment, (wanted.example, segment), 1, &mapped, timings);
    let held = job.kept(work.engine.memory_of_map(example.bytes));
    let (sides, beyond) = ((Some(fitted.example), fitted.query), wanted.beyond);
    Ok(keep(live, held, sides, beyond, MapState { mapped, summary }))
}

/// The map of an example that leads another, made where it is not there yet.
async fn lead(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    segment: u32,
    (example, example_segment): (ExampleId, u32),
) -> Result<Option<Lead>, WorkError> {
    let there = find(live, segment, (example, example_segment));
    let map = match there {
        Some(map) => map,
        None => {
            let new = NewMap { beyond: Beyond::Extend, ..NewMap::new(segment, example, example_segment) };
            Box::pin(made(work, live, (MapId::generate_on(work.server), new), &tell_nobody)).await?
        }
    };
    let mapped = map.newest().mapped.clone();
    Ok(map.example().map(|example| Lead { example: example.clone(), mapped }))
}

/// The map of an example on a segment, if there is one.
pub fn find(live: &LiveQuery, segment: u32, of: (ExampleId, u32)) -> Option<Arc<LiveMap>> {
    let is_this = |map: &&Arc<LiveMap>| {
        let summary = &map.newest().summary;
        summary.segment == segment && (summary.example, summary.example_segment) == of
    };
    live.maps().values().find(is_this).cloned()
}

/// Lays a regular layout on a segment, in place of an example.
async fn made_of_template(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    (id, wanted): (MapId, &NewMap),
    tell: Tell<'_>,
) -> Result<Arc<LiveMap>, WorkError> {
    let start = Instant::now();
    let encoded = live.encoded(wanted.segment).await?;
    tell("laying a regular layout on the scan", 0.3);
    let job = work.admit(live.caller.user, composing::memory(0, &live.model), REQUEST_TIME_MAX)?;
    let side = Side { model: Arc::clone(&live.model), segment: wanted.segment, encoded };
    let (engine, query) = (Arc::clone(&work.engine), side.clone());
    let mapped = work.pool.run(&job, Lane::Lay, move |stop| engine.template(&query, stop)).await??;
    let timings = MapTimings { register_ms: 0.0, map_ms: ms_since(start), total_ms: ms_since(start) };
    let summary = summary(live, id, wanted.segment, (wanted.example, 0), 1, &mapped, timings);
    let held = job.kept(work.engine.memory_of_map(0));
    Ok(keep(live, held, (None, side), wanted.beyond, MapState { mapped, summary }))
}

/// Keeps a new map with its query.
fn keep(
    live: &LiveQuery,
    held: Job,
    (example, query): (Option<Side>, Side),
    beyond: Beyond,
    state: MapState,
) -> Arc<LiveMap> {
    let id = state.summary.id;
    let map = Arc::new(LiveMap {
        id,
        segment: state.summary.segment,
        example,
        query,
        example_id: state.summary.example,
        beyond,
        edits: tokio::sync::Mutex::default(),
        newest: Mutex::new(Arc::new(state)),
        _held: held,
    });
    live.maps().insert(id, Arc::clone(&map));
    map
}

/// A map of a query.
///
/// # Errors
/// [`WorkError::NoSuchMap`], [`WorkError::NotMade`].
pub fn get(live: &LiveQuery, id: MapId) -> Result<Arc<LiveMap>, WorkError> {
    let there = live.maps().get(&id).cloned();
    there.ok_or_else(|| live.makings.missing(Product::Map, &id).unwrap_or(WorkError::NoSuchMap(id)))
}

/// Takes a map out; one that is made is cancelled.
///
/// # Errors
/// [`WorkError::NoSuchMap`].
pub fn remove(live: &LiveQuery, id: MapId) -> Result<(), WorkError> {
    let is_gone = live.makings.remove(Product::Map, &id) || live.maps().remove(&id).is_some();
    is_gone.then_some(()).ok_or(WorkError::NoSuchMap(id))
}

/// Edits a map's constraints: all of the edit or nothing.
///
/// # Errors
/// Refusals of the edit, of the pool and of the engine.
pub async fn constrain(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    id: MapId,
    edit: ConstraintEdit,
) -> Result<Arc<MapState>, WorkError> {
    let start = Instant::now();
    let map = get(live, id)?;
    // One edit at a time: each builds on the one before.
    let _turn = map.edits.lock().await;
    let before = map.newest();
    let added = edit.set.iter().filter(|c| c.id.is_none()).count();
    if before.mapped.constraints.len().saturating_add(added) > CONSTRAINTS_MAX {
        let found = before.mapped.constraints.len() + added;
        return Err(WorkError::parameter("set", format!("to leave at most {CONSTRAINTS_MAX} constraints"), found));
    }
    let job = work.admit(live.caller.user, 0, REQUEST_TIME_MAX)?;
    let Some(one) = map.example.clone() else {
        let detail =
            "expected the map of an example, found a regular layout, which has no constraints; choose an example";
        return Err(EngineError::refused(Refusal::ConstraintInvalid, detail).into());
    };
    let example = (map.example_id, one.segment);
    let (engine, two, from) = (Arc::clone(&work.engine), map.query.clone(), Arc::clone(&before));
    let quantum = move |stop: &_| {
        let registration = engine.constrain(&from.mapped, &edit, &one, &two, stop)?;
        engine.edited(&registration, &from.mapped, &one, &two, stop)
    };
    let mapped = work.pool.run(&job, Lane::Edit, quantum).await??;
    let timings = MapTimings { register_ms: 0.0, map_ms: ms_since(start), total_ms: ms_since(start) };
    let revision = before.summary.revision + 1;
    let summary = summary(live, id, map.segment, example, revision, &mapped, timings);
    Ok(map.put(MapState { mapped, summary }))
}

/// The candidate, registered at the query's full resolution; resumed if it was passed over. `None` where the example is of
/// another topology, and is compared when it is laid.
async fn registered(
    work: &Arc<Work>,
    job: &Job,
    live: &Arc<LiveQuery>,
    wanted: &NewMap,
    query: &Arc<Encoding>,
) -> Result<Option<Candidate>, WorkError> {
    let is_wanted =
        |c: &&Candidate| c.resident.example.id == wanted.example && c.resident.segment == wanted.example_segment;
    let board = live.board();
    let ranking = board.rankings.get(wanted.segment as usize).cloned().unwrap_or_default();
    let mut candidate = match ranking.candidates.iter().find(is_wanted) {
        Some(candidate) => candidate.clone(),
        None => {
            let (example, segment) = (wanted.example, wanted.example_segment);
            let snapshot = work.catalogue.snapshot();
            let resident = snapshot.segment(example, segment).ok_or(WorkError::NotEncodedYet { example, segment })?;
            let (expected, found) = (query.facts.topology, resident.facts.topology);
            if expected != found {
                return match work.engine.reaches(found, expected) {
                    true => Ok(None),
                    false => Err(WorkError::TopologyDiffers { expected, found }),
                };
            }
            newcomer(work, job, Arc::clone(resident), Arc::clone(query)).await?
        }
    };
    let was_done = candidate.state == EntryState::Done;
    candidate = caught_up(work, job, Lane::Lay, candidate, query, live.options.resolution).await?;
    // While the query goes on, its own schedule decides what stands in the ranking.
    if !was_done && live.is_final() {
        let resumed = Candidate { state: EntryState::Done, ..candidate.clone() };
        live.publish_resumed(wanted.segment as usize, resumed);
    }
    Ok(Some(candidate))
}

async fn example_side(work: &Arc<Work>, job: &Job, example: &Example, segment: u32) -> Result<Side, WorkError> {
    let model = ingest::model(work, job, Lane::Lay, example).await?;
    let encoded = ingest::example_encoded(work, job, Lane::Lay, (example, &model, segment)).await?;
    Ok(Side { model, segment, encoded })
}

fn summary(
    live: &LiveQuery,
    id: MapId,
    segment: u32,
    (example, example_segment): (ExampleId, u32),
    revision: u64,
    mapped: &Mapped,
    timings: MapTimings,
) -> Map {
    let reach = &mapped.reach;
    let unextruded = mapped.unextruded();
    let (own_vertices, own_faces) =
        reach.own.unwrap_or((unextruded.positions.len() as u64, unextruded.faces.len() as u64));
    Map {
        id,
        query: live.id,
        state: MakingState::Done,
        progress: 1.0,
        segment,
        example,
        example_segment,
        revision,
        flip: mapped.registration.flip,
        shift_u: mapped.registration.shift_u,
        energy: mapped.registration.energy,
        resolution: mapped.registration.level,
        constraints: mapped.constraints.clone(),
        vertices: mapped.mesh.positions.len() as u64,
        faces: mapped.mesh.faces.len() as u64,
        own_vertices,
        own_faces,
        kept: reach.kept.clone(),
        covers: Covers { example: reach.covers.example, input: reach.covers.input },
        inspired: reach.inspired.unwrap_or(if example == ExampleId::TEMPLATE { 0.0 } else { 1.0 }),
        folds: mapped.folds,
        distortion: mapped.distortion.clone(),
        verdict: mapped.verdict,
        reasons: mapped.reasons.clone(),
        evidence: mapped.evidence,
        timings,
    }
}

/// Bytes that a map takes: those of its example, which is read, and of its input, on which it settles.
fn memory_of(engine: &dyn Engine, example_bytes: u64, input_faces: usize) -> u64 {
    engine.memory_estimate(example_bytes) + input_faces as u64 * MEMORY_PER_INPUT_FACE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::engine::fake::FakeEngine;

    #[test]
    fn a_map_is_paid_for_with_what_its_input_and_its_example_take() {
        let of = |bytes, faces| memory_of(&FakeEngine, bytes, faces);
        assert_eq!(of(900, 0) - of(0, 0), FakeEngine.memory_estimate(900) - FakeEngine.memory_estimate(0));
        assert_eq!(of(900, 100_000) - of(900, 0), 100_000 * MEMORY_PER_INPUT_FACE);
    }
}
