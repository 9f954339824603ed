//! A map that covers a part of a scan, with what lies around it.
//!
//! The scan is cut along the map's rim. What is left is ranked as a query of several segments is, and takes the examples that
//! fit, and regular layouts elsewhere. Segments beside that of the map stay as they are, and keep the maps that were laid on them.

use super::headline::{BroughtMap, is_crumpled};
use super::sound::SurroundingMaps;
use super::{BARE_MIN, MeasuredComposition, bare, laid, stitched_sound};
use crate::pool::{Job, Lane, Stop, StopReason};
use crate::work::engine::{AllowedFlaws, Encoded, Engine, EngineError, Model, Part, StitchOptions};
use crate::work::laying::best_map;
use crate::work::mapping::LiveMap;
use crate::work::query::LiveQuery;
use crate::work::worth::tries;
use crate::work::{Work, WorkError, search};
use futures_util::future::join_all;
use quadmuse_proto::{Beyond, ExampleId};
use std::sync::Arc;

/// A scan cut along the rim of a map, and what each of its segments takes: the first is the map.
pub(super) struct RimCut {
    cut: Arc<Model>,
    parts: Vec<Part>,
    /// A regular layout for each segment whose example may give way.
    instead: Vec<Option<Arc<Encoded>>>,
    /// What is told of each segment's map.
    laid: Vec<Option<BroughtMap>>,
    /// Where each segment has its map from, if it has one.
    origins: Vec<Option<Origin>>,
}

/// Where a segment of the cut has its map from.
enum Origin {
    /// A segment of the query keeps its own.
    Kept(u32),
    /// An example of this name was laid on what is left around the map.
    Laid(String),
}

/// The map of several that has most of a scan, if it leaves much of its segment bare: it could not be stitched with its neighbours.
pub(super) fn centre(model: &Model, maps: &[Option<Arc<LiveMap>>]) -> Option<Arc<LiveMap>> {
    let is_example = |map: &&Arc<LiveMap>| map.example_id() != ExampleId::TEMPLATE;
    // Of equals the first.
    let order = |a: &&Arc<LiveMap>, b: &&Arc<LiveMap>| {
        a.share_of(model).total_cmp(&b.share_of(model)).then(b.segment.cmp(&a.segment))
    };
    let most = maps.iter().flatten().filter(is_example).max_by(order)?;
    (maps.len() > 1 && bare(most) > BARE_MIN).then(|| Arc::clone(most))
}

impl RimCut {
    /// Cuts the scan of `live` along the rim of `map`, one of the `maps` that were laid on its segments, and finds what the rest takes;
    /// `None` where nothing lies beyond the map, or the rest can't be laid.
    pub(super) async fn of(
        work: &Arc<Work>,
        live: &Arc<LiveQuery>,
        (map, maps): (&LiveMap, &[Option<Arc<LiveMap>>]),
        job: &Job,
    ) -> Result<Option<Self>, WorkError> {
        let newest = map.newest();
        let (engine, model, mapped) = (Arc::clone(&work.engine), Arc::clone(&live.model), newest.mapped.clone());
        let segment = newest.summary.segment;
        let cut = work.pool.run(job, Lane::Lay, move |_| engine.around(&model, segment, &mapped)).await??;
        let Some((cut, own)) = cut else { return Ok(None) };
        let cut = Arc::new(cut);
        let kept = kept(&live.model, segment, &cut);
        let new = cut.segments.len() - kept.len();
        let rest = match search::of_rest(work, live, &cut, new).await {
            Ok(rest) => rest,
            Err(error) if error.stop_reason() == Some(StopReason::Cancelled) => return Err(error),
            // The map alone is better than nothing.
            Err(error) => {
                tracing::info!(query = %live.id, %error, "what lies around a map is left bare");
                return Ok(None);
            }
        };
        let mut found = Self {
            cut: Arc::clone(&cut),
            parts: vec![Part::Kept(own)],
            instead: vec![None],
            laid: vec![Some(laid(&newest))],
            origins: vec![Some(Origin::Kept(segment))],
        };
        let one = async |segment: usize| match tries(&cut.segments, segment) {
            0 => Ok(None),
            _ => best_map(work, &rest, (segment as u32, 1), Beyond::Extend).await,
        };
        let brought = join_all((1..new).map(one)).await.into_iter().map(|map| (map, None));
        let own = kept.into_iter().map(|k| (Ok(maps.get(k as usize).cloned().flatten()), Some(k)));
        for (segment, (map, from)) in (1..).zip(brought.chain(own)) {
            let Ok(encoded) = rest.encoded(segment).await else { return Ok(None) };
            match map {
                Err(error) if error.stop_reason() == Some(StopReason::Cancelled) => return Err(error),
                // A regular layout is there at once.
                map => found.push(work, encoded, map.ok().flatten().as_deref(), from),
            }
        }
        Ok(Some(found))
    }

    /// Adds what the next segment takes: the map of an example that fits, or else a regular layout. `from` is the segment of the query
    /// that the map was laid on, if it is one of the query's.
    fn push(&mut self, work: &Work, encoded: Arc<Encoded>, map: Option<&LiveMap>, from: Option<u32>) {
        let map = map.filter(|map| map.example_id() != ExampleId::TEMPLATE && !map.newest().mapped.is_poor_stitched());
        self.origins.push(map.and_then(|map| match from {
            Some(segment) => Some(Origin::Kept(segment)),
            None => Some(Origin::Laid(work.catalogue.example(map.example_id()).ok()?.name.clone())),
        }));
        let Some(newest) = map.map(LiveMap::newest) else {
            self.parts.push(Part::Template(encoded));
            self.instead.push(None);
            self.laid.push(None);
            return;
        };
        let (part, whole) = (Arc::clone(&newest.mapped.part), Arc::clone(&newest.mapped.mesh));
        self.parts.push(Part::Mapped { part, whole });
        self.instead.push(Some(encoded));
        // Its segment is none of the query's, which reasons could name.
        self.laid.push(Some(BroughtMap { reasons: Vec::new(), ..laid(&newest) }));
    }

    /// Stitches all of it; `None` where that is not sound, or crumpled, or the map has no part in it.
    pub(super) fn stitched(
        self,
        engine: &dyn Engine,
        (how, allowed): (StitchOptions, AllowedFlaws),
        stop: &Stop,
    ) -> Result<Option<MeasuredComposition>, EngineError> {
        let allowed = AllowedFlaws { bare: 0.0, ..allowed };
        let MeasuredComposition { mut made, appraisal, .. } =
            stitched_sound(engine, &self.cut, (self.parts, &self.instead), (how, allowed), stop)?;
        tracing::debug!(flaws = ?appraisal.flaws, standing = ?made.standing, notes = ?made.notes, "what lies around a map");
        let stands = made.is_example(0) && appraisal.flaws.is_empty() && !is_crumpled(&appraisal);
        // Segments of the cut are none of the query's, which notes could name.
        made.notes.retain(|note| !note.contains("segment"));
        let (mut around, mut names) = (SurroundingMaps { laid: self.laid, stand: Vec::new() }, Vec::new());
        let used = self.origins.into_iter().enumerate().filter(|(segment, _)| made.is_example(*segment));
        for origin in used.filter_map(|(_, origin)| origin) {
            match origin {
                Origin::Kept(segment) => around.stand.push(segment),
                Origin::Laid(name) => names.push(name),
            }
        }
        names.sort_unstable();
        names.dedup();
        if !names.is_empty() {
            made.notes.push(format!("other examples around the first: {}", names.join(", ")));
        }
        Ok(stands.then_some(MeasuredComposition { around: Some(around), ..MeasuredComposition::of(made, appraisal) }))
    }
}

/// Finds the segments of a scan beside one that was cut, where they are the last of the cut, as they were; else none.
fn kept(scan: &Model, segment: u32, cut: &Model) -> Vec<u32> {
    let others: Vec<u32> = (0..scan.segments.len() as u32).filter(|k| *k != segment).collect();
    let Some(last) = cut.segments.len().checked_sub(others.len()).filter(|first| *first > 0) else { return Vec::new() };
    let are_same = others.iter().zip(&cut.segments[last..]).all(|(k, now)| {
        let before = &scan.segments[*k as usize];
        (before.topology, before.faces) == (now.topology, now.faces)
    });
    if are_same && !scan.is_waist { others } else { Vec::new() }
}
