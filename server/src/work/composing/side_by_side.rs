//! Maps of several segments side by side, where stitching them breaks the mesh or loses the examples.

use super::Sound;
use crate::work::engine::{Allowed, Engine, EngineError, Model, PolyMesh, Stitched};
use crate::work::mapping::{LiveMap, MapState};
use std::sync::Arc;

/// A segment with this share of a scan's faces is most of it.
const MOST: f64 = 0.5;

/// Maps that can stand side by side without being stitched, with their segments: those of segments that have their components of the
/// scan to themselves (`alone`), where these are most of it, or else that of the one segment that is.
pub(super) fn standing(model: &Model, alone: &[bool], maps: &[Option<Arc<LiveMap>>]) -> Vec<(usize, Arc<LiveMap>)> {
    let all: u64 = model.segments.iter().map(|segment| segment.faces).sum();
    let faces = |number: usize| model.segments.get(number).map_or(0, |segment| segment.faces);
    let is_most = |some: &[(usize, Arc<LiveMap>)]| {
        some.iter().map(|(number, _)| faces(*number)).sum::<u64>() as f64 >= MOST * all as f64
    };
    let mapped: Vec<(usize, Arc<LiveMap>)> =
        maps.iter().enumerate().filter_map(|(number, map)| Some((number, Arc::clone(map.as_ref()?)))).collect();
    let apart: Vec<(usize, Arc<LiveMap>)> =
        mapped.iter().filter(|(number, _)| alone.get(*number) == Some(&true)).cloned().collect();
    if is_most(&apart) {
        return apart;
    }
    mapped.into_iter().find(|one| is_most(std::slice::from_ref(one))).into_iter().collect()
}

/// The maps of some segments side by side, without those to blame for what is wrong with them; `None` where none is left.
pub(super) fn unstitched(
    engine: &dyn Engine,
    model: &Model,
    mut standing: Vec<(usize, Arc<LiveMap>)>,
    allowed: Allowed,
) -> Result<Option<Sound>, EngineError> {
    while !standing.is_empty() {
        let made = as_mapped(&standing, model.segments.len());
        let appraisal = engine.appraise(model, &made, Allowed { bare: 1.0, ..allowed })?;
        let count = standing.len();
        if appraisal.flaws.is_empty() {
            let unstitched = standing.iter().map(|(number, _)| *number as u32).collect();
            return Ok(Some(Sound { unstitched, ..Sound::of(made, appraisal) }));
        }
        standing.retain(|(number, _)| !appraisal.flawed.contains(&(*number as u32)));
        if standing.len() == count {
            break;
        }
    }
    Ok(None)
}

/// Maps as a composition of `count` segments.
pub(super) fn as_mapped(maps: &[(usize, Arc<LiveMap>)], count: usize) -> Stitched {
    let newest: Vec<Arc<MapState>> = maps.iter().map(|(_, map)| map.newest()).collect();
    let mapped: Vec<(&Arc<PolyMesh>, &[u32])> =
        newest.iter().map(|state| (&state.mapped.mesh, &state.mapped.reach.bridging[..])).collect();
    Stitched::as_mapped(&mapped, (0..count).map(|k| maps.iter().any(|(number, _)| *number == k)).collect())
}
