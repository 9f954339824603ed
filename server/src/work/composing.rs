//! Compositions: the maps chosen for a query's segments, stitched into one mesh of quads.

use super::engine::{Model, Stitched};
use super::mapping::{LiveMap, get};
use super::query::{LiveQuery, ms_since};
use super::{REQUEST_TIME_MAX, Work, WorkError};
use crate::pool::Lane;
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::composition::SMOOTHING_MAX;
use quadmuse_proto::{Composition, CompositionId, NewComposition};
use std::sync::Arc;
use std::time::Instant;

/// Most compositions a query.
pub const COMPOSITIONS_MAX: usize = 64;

/// A composition and its mesh.
pub struct LiveComposition {
    /// The composition as it goes over the wire.
    pub summary: Composition,
    /// The mesh.
    pub mesh: Arc<PolyMesh>,
}

/// Stitches maps of a query.
///
/// # Errors
/// Refusals of the parts, of the pool and of the engine.
pub async fn create(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    wanted: NewComposition,
) -> Result<Arc<LiveComposition>, WorkError> {
    let start = Instant::now();
    let meshes = meshes_of(live, &wanted)?;
    if live.compositions().len() >= COMPOSITIONS_MAX {
        return Err(WorkError::TooMany { of: "compositions", limit: COMPOSITIONS_MAX });
    }
    let job = work.pool.admit(live.caller.user, 0, Some(REQUEST_TIME_MAX))?;
    let (engine, model, smoothing) = (Arc::clone(&work.engine), Arc::clone(&live.model), wanted.smoothing);
    let one = one_example(live, &wanted)?;
    let stitch = move |stop: &_| {
        // One example on all segments needs no stitching: it comes back whole.
        if let Some((example, parts)) = &one
            && let Some(whole) = engine.rejoin(&model, example, parts, stop)?
        {
            return Ok(whole);
        }
        engine.compose(&model, &meshes, smoothing, stop)
    };
    let Stitched { mesh, extraordinary_vertices } = work.pool.run(&job, Lane::Edit, stitch).await??;
    let counts = super::ingest::counts_of(&mesh);
    let summary = Composition {
        id: CompositionId::generate(),
        query: live.id,
        parts: wanted.parts,
        smoothing,
        vertices: counts.vertices,
        quads: counts.quads,
        triangles: counts.triangles,
        extraordinary_vertices,
        total_ms: ms_since(start),
    };
    let composition = Arc::new(LiveComposition { summary, mesh });
    live.compositions().insert(composition.summary.id, Arc::clone(&composition));
    Ok(composition)
}

/// A composition of a query.
///
/// # Errors
/// [`WorkError::NoSuchComposition`].
pub fn find(live: &LiveQuery, id: CompositionId) -> Result<Arc<LiveComposition>, WorkError> {
    live.compositions().get(&id).cloned().ok_or(WorkError::NoSuchComposition(id))
}

/// The example from which all segments of the query take their maps, if it is one, with the query's segment, the
/// example's and the mapped mesh of each part.
fn one_example(
    live: &LiveQuery,
    wanted: &NewComposition,
) -> Result<Option<(Arc<Model>, Vec<(u32, u32, Arc<PolyMesh>)>)>, WorkError> {
    let maps = wanted.parts.iter().map(|part| get(live, part.map)).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = maps.first().filter(|_| maps.len() > 1 && maps.len() == live.model.segments.len()) else {
        return Ok(None);
    };
    if maps.iter().any(|map| map.example_id() != first.example_id()) {
        return Ok(None);
    }
    let part = |map: &Arc<LiveMap>| (map.segment, map.example().segment, Arc::clone(&map.newest().mapped.mesh));
    Ok(Some((Arc::clone(&first.example().model), maps.iter().map(part).collect())))
}

/// The mapped meshes of the parts: each segment at most once, each with a map of its own.
fn meshes_of(live: &LiveQuery, wanted: &NewComposition) -> Result<Vec<(u32, Arc<PolyMesh>)>, WorkError> {
    if wanted.smoothing > SMOOTHING_MAX {
        return Err(WorkError::parameter("smoothing", format!("from 0 to {SMOOTHING_MAX}"), wanted.smoothing));
    }
    if wanted.parts.is_empty() {
        return Err(WorkError::parameter("parts", "with at least one part", "none"));
    }
    let mut meshes: Vec<(u32, Arc<PolyMesh>)> = Vec::new();
    for part in &wanted.parts {
        let map = get(live, part.map)?;
        if map.segment != part.segment {
            let expected = format!("to name the segment of map {}, {}", part.map, map.segment);
            return Err(WorkError::parameter("parts", expected, part.segment));
        }
        if meshes.iter().any(|(segment, _)| *segment == part.segment) {
            let expected = "to name each segment once";
            return Err(WorkError::parameter("parts", expected, format!("segment {} again", part.segment)));
        }
        meshes.push((part.segment, Arc::clone(&map.newest().mapped.mesh)));
    }
    meshes.sort_by_key(|(segment, _)| *segment);
    Ok(meshes)
}
