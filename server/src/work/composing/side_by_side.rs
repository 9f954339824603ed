//! Maps of several segments side by side, where stitching them breaks the mesh or loses the examples.

use super::headline::is_crumpled;
use super::sound::{KEPT, MeasuredComposition};
use super::{BARE_MIN, bare};
use crate::work::engine::{AllowedFlaws, Engine, EngineError, LayoutOwner, Model, PolyMesh, Stitched};
use crate::work::mapping::{LiveMap, MapState};
use quadmuse_proto::Verdict;
use std::sync::Arc;

/// A segment with this share of a scan's faces is most of it.
const MOST: f64 = 0.5;

/// Maps whose faces lie no farther from the scan than this in the mean, as a share of its diagonal, follow it.
const CLOSE: f64 = 0.0025;
/// Split faces follow it more closely if they are no farther than this share of what they were. *Untuned.*
const CLOSER: f64 = 0.7;

/// A map that leaves more of its segment bare is no layout of it. *Untuned.*
const STANDS_BARE_MAX: f64 = 0.5;

/// Finds the maps that can stand side by side without being stitched, with their segments. They are sound, and cover most of their segment.
/// They are those of segments that have their components of the scan to themselves (`alone`), where these are most of it, or all others do,
/// too; or else that of the one segment that is most.
pub(super) fn standing(model: &Model, alone: &[bool], maps: &[Option<Arc<LiveMap>>]) -> Vec<(usize, Arc<LiveMap>)> {
    let all: u64 = model.segments.iter().map(|segment| segment.faces).sum();
    let faces = |number: usize| model.segments.get(number).map_or(0, |segment| segment.faces);
    let is_most = |some: &[(usize, Arc<LiveMap>)]| {
        some.iter().map(|(number, _)| faces(*number)).sum::<u64>() as f64 >= MOST * all as f64
    };
    let can_stand =
        |map: &&Arc<LiveMap>| map.newest().summary.verdict < Verdict::Broken && bare(map) <= STANDS_BARE_MAX;
    let standing = |(number, map): (usize, &Option<Arc<LiveMap>>)| {
        let map = map.as_ref().filter(can_stand)?;
        Some((number, Arc::clone(map)))
    };
    let mapped: Vec<(usize, Arc<LiveMap>)> = maps.iter().enumerate().filter_map(standing).collect();
    let apart: Vec<(usize, Arc<LiveMap>)> =
        mapped.iter().filter(|(number, _)| alone.get(*number) == Some(&true)).cloned().collect();
    let are_all_alone = alone.len() == model.segments.len() && !alone.contains(&false);
    if is_most(&apart) || (are_all_alone && !apart.is_empty()) {
        return apart;
    }
    mapped.into_iter().find(|one| is_most(std::slice::from_ref(one))).into_iter().collect()
}

/// The map that is most of what stands side by side in place of a stitched mesh; `None` where no map does, it leaves little bare, or
/// other examples make up so much that what is laid out around the one would lose them.
pub(super) fn most(model: &Model, found: &MeasuredComposition, maps: &[Option<Arc<LiveMap>>]) -> Option<Arc<LiveMap>> {
    if found.unstitched.is_empty() || found.appraisal.covered > 1.0 - BARE_MIN {
        return None;
    }
    let faces = |segment: u32| model.segments.get(segment as usize).map_or(0, |segment| segment.faces);
    let is_map = |segment: &u32| found.made.is_example(*segment as usize);
    let most = found.unstitched.iter().copied().filter(is_map).max_by_key(|segment| faces(*segment))?;
    let examples = &found.appraisal.examples;
    let is_kept = *examples.get(most as usize)? >= KEPT * examples.iter().sum::<f64>();
    maps.get(most as usize).filter(|_| is_kept)?.clone()
}

/// The maps of some segments side by side, without those to blame for what is wrong with them, and beside them what was `stitched`
/// on segments that have their components of the scan to themselves (`alone`), where that is sound; `None` where no map is left.
pub(super) fn unstitched(
    engine: &dyn Engine,
    model: &Model,
    mut standing: Vec<(usize, Arc<LiveMap>)>,
    (stitched, alone): (&Stitched, &[bool]),
    allowed: AllowedFlaws,
) -> Result<Option<MeasuredComposition>, EngineError> {
    let stands = |standing: &[(usize, Arc<LiveMap>)], segment: u32| standing.iter().any(|(n, _)| *n as u32 == segment);
    let mut beside: Vec<u32> = (0u32..).zip(alone).filter(|(_, alone)| **alone).map(|(segment, _)| segment).collect();
    beside.retain(|segment| !stands(&standing, *segment));
    while !standing.is_empty() {
        let rest = engine.of_segments(model, stitched, &beside)?;
        let rest = Some(rest).filter(|(mesh, _)| !mesh.faces.is_empty());
        let mut made = as_mapped(&standing, rest.as_ref(), model.segments.len());
        beside.iter().map(|segment| *segment as usize).for_each(|k| made.standing[k] = stitched.standing[k]);
        let appraisal = engine.appraise(model, &made, AllowedFlaws { bare: 1.0, ..allowed })?;
        if appraisal.flaws.is_empty() {
            let mut unstitched: Vec<u32> = standing.iter().map(|(number, _)| *number as u32).collect();
            unstitched.extend(&beside);
            return Ok(Some(MeasuredComposition { unstitched, ..MeasuredComposition::of(made, appraisal) }));
        }
        let is_flawed = |segment: &u32| appraisal.flawed.contains(segment);
        if beside.iter().any(is_flawed) {
            beside.retain(|segment| !is_flawed(segment));
            continue;
        }
        let count = standing.len();
        standing.retain(|(number, _)| !is_flawed(&(*number as u32)));
        if standing.len() == count && beside.is_empty() {
            break;
        }
        if standing.len() == count {
            // What is wrong is told of no segment.
            beside.clear();
        }
    }
    Ok(None)
}

/// Maps that stand as they are, with their faces split where they are too large to follow the scan: so often as that brings them
/// closer, and leaves them sound.
pub(super) fn closer(
    engine: &dyn Engine,
    model: &Model,
    mut best: MeasuredComposition,
    allowed: AllowedFlaws,
) -> Result<MeasuredComposition, EngineError> {
    for splits in 0.. {
        if best.appraisal.away <= CLOSE || !best.appraisal.flaws.is_empty() {
            break;
        }
        let Some(made) = engine.split(model, &best.made, splits)? else { break };
        let appraisal = engine.appraise(model, &made, allowed)?;
        let is_closer = appraisal.away <= CLOSER * best.appraisal.away;
        let is_smooth = !is_crumpled(&appraisal) || is_crumpled(&best.appraisal);
        if !appraisal.flaws.is_empty() || !is_closer || !is_smooth {
            break;
        }
        best = MeasuredComposition { made, appraisal, ..best };
    }
    Ok(best)
}

/// Maps as a composition of `count` segments, with a mesh beside them and its faces that bridge a gap.
pub(super) fn as_mapped(
    maps: &[(usize, Arc<LiveMap>)],
    beside: Option<&(Arc<PolyMesh>, Vec<u32>)>,
    count: usize,
) -> Stitched {
    let newest: Vec<Arc<MapState>> = maps.iter().map(|(_, map)| map.newest()).collect();
    let mapped = newest.iter().map(|state| (&state.mapped.mesh, &state.mapped.reach.bridging[..]));
    let beside = beside.map(|(mesh, bridging)| (mesh, &bridging[..]));
    let all: Vec<(&Arc<PolyMesh>, &[u32])> = mapped.chain(beside).collect();
    let is_map = |segment: usize| maps.iter().any(|(number, _)| *number == segment);
    let standing = |segment| if is_map(segment) { LayoutOwner::Example } else { LayoutOwner::Regular };
    Stitched::as_mapped(&all, (0..count).map(standing).collect())
}
