//! The measured result of a composition: whether it is sound, and which of two is better.

use super::headline::{BroughtMap, OWN_MAX, is_crumpled};
use crate::pool::Stop;
use crate::work::engine::{
    AllowedFlaws, Appraisal, Encoded, Engine, EngineError, Model, Part, StitchOptions, Stitched,
};
use crate::work::mapping::LiveMap;
use std::sync::Arc;

/// Where examples have less than this share of the scan that their maps cover, they were lost.
const LOST: f64 = 0.5;

/// A result that covers more of a scan is better where its examples keep this share of their area.
pub(super) const KEPT: f64 = 0.9;

/// A layout follows a scan as well as another if it leaves no more bare than this share beyond what that does, and lies no farther from
/// it than so many times as far. *Untuned.*
const COVERED_LESS: f64 = 0.02;
const AWAY_MORE: f64 = 1.25;

/// The result of a composition, with how it was measured.
pub(super) struct MeasuredComposition {
    pub(super) made: Stitched,
    pub(super) appraisal: Appraisal,
    /// Segments whose examples gave way to regular layouts.
    pub(super) gave_way: Vec<u32>,
    /// The segments on which alone there is a mesh, where that is maps side by side; else empty.
    pub(super) unstitched: Vec<u32>,
    /// Tells what lies around a map, where the scan was cut along its rim.
    pub(super) around: Option<SurroundingMaps>,
}

/// The maps on a scan that was cut along the rim of a map.
pub(super) struct SurroundingMaps {
    /// The maps on the segments of the cut, for the headline.
    pub(super) laid: Vec<Option<BroughtMap>>,
    /// The segments of the query whose maps stand: that of the map in the middle, and others that kept theirs.
    pub(super) stand: Vec<u32>,
}

impl MeasuredComposition {
    pub(super) fn of(made: Stitched, appraisal: Appraisal) -> Self {
        Self { made, appraisal, gave_way: Vec::new(), unstitched: Vec::new(), around: None }
    }

    /// Tells whether the maps that stand side by side would be better, if they are sound: this mesh is broken or crumpled, or its
    /// examples have less than half of what they have there.
    pub(super) fn is_poor_beside(&self, standing: &[(usize, Arc<LiveMap>)], model: &Model) -> bool {
        let inspired = self.appraisal.examples.iter().sum::<f64>() * self.appraisal.covered;
        let beside: f64 = standing.iter().map(|(_, map)| map.share_of(model)).sum();
        !self.appraisal.flaws.is_empty() || is_crumpled(&self.appraisal) || inspired < LOST * beside
    }

    /// Tells whether a regular layout is sound, follows the scan as well as another result, and, where that is regular, too, has no
    /// more extraordinary vertices a quad. Beside a result that is not sound nothing more is asked, and beside the scan's own
    /// triangles, which nothing follows as well, not that it lies as near.
    pub(super) fn is_layout_no_worse_than(&self, other: &Self) -> bool {
        let (own, others) = (&self.appraisal, &other.appraisal);
        let extraordinary =
            |sound: &Self| sound.made.extraordinary_vertices as f64 / sound.made.mesh.faces.len().max(1) as f64;
        let is_near = own.away <= AWAY_MORE * others.away || others.own > OWN_MAX;
        let follows = own.covered >= others.covered - COVERED_LESS && is_near;
        let has_examples = others.examples.iter().any(|share| *share > 0.0);
        let is_as_regular = has_examples || extraordinary(self) <= extraordinary(other);
        own.flaws.is_empty() && (!others.flaws.is_empty() || (follows && is_as_regular))
    }

    /// Tells whether it covers more of the scan by layouts than another, and keeps its examples.
    pub(super) fn is_better_than(&self, other: &Self) -> bool {
        let inspired = |sound: &Self| sound.appraisal.examples.iter().sum::<f64>() * sound.appraisal.covered;
        let laid_out = |sound: &Self| (1.0 - sound.appraisal.own) * sound.appraisal.covered;
        laid_out(self) > laid_out(other) && inspired(self) >= KEPT * inspired(other)
    }
}

/// Stitches, and measures the result. Where it is no use as it is, the examples on the segments that are to blame give way to
/// regular layouts, unless they were chosen.
pub(super) fn stitched_sound(
    engine: &dyn Engine,
    model: &Model,
    (mut parts, instead): (Vec<Part>, &[Option<Arc<Encoded>>]),
    (how, allowed): (StitchOptions, AllowedFlaws),
    stop: &Stop,
) -> Result<MeasuredComposition, EngineError> {
    let made = engine.compose(model, &parts, how, stop)?;
    let appraisal = engine.appraise(model, &made, allowed)?;
    let is_example = |segment: &u32| made.is_example(*segment as usize);
    if appraisal.flaws.is_empty() {
        return Ok(MeasuredComposition::of(made, appraisal));
    }
    // First those that are to blame; then all, since what no example stands on is laid out as one.
    let blamed: Vec<u32> = appraisal.flawed.iter().copied().filter(is_example).collect();
    let all: Vec<u32> = (0..parts.len() as u32).filter(is_example).collect();
    let blamed = if blamed.len() < all.len() { blamed } else { Vec::new() };
    for giving_way in [blamed, all] {
        let mut gave_way = Vec::new();
        for segment in giving_way {
            let slots = (parts.get_mut(segment as usize), instead.get(segment as usize));
            if let (Some(part), Some(Some(instead))) = slots {
                *part = Part::Template(Arc::clone(instead));
                gave_way.push(segment);
            }
        }
        if gave_way.is_empty() {
            continue;
        }
        let mut again = engine.compose(model, &parts, how, stop)?;
        let after = engine.appraise(model, &again, allowed)?;
        if after.flaws.is_empty() {
            let segments = gave_way.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            let why = appraisal.flaws.join("; ");
            again.notes.push(format!("examples gave way to regular layouts on segments {segments}: {why}"));
            return Ok(MeasuredComposition { gave_way, ..MeasuredComposition::of(again, after) });
        }
    }
    Ok(MeasuredComposition::of(made, appraisal))
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_kernel::mesh::PolyMesh;

    /// A result with so many extraordinary vertices, as far from the scan.
    fn sound(extraordinary_vertices: u64, away: f64, own: f64) -> MeasuredComposition {
        let made = Stitched::as_it_is(Arc::new(PolyMesh::default()), Vec::new());
        let appraisal = Appraisal { away, own, covered: 1.0, ..Appraisal::default() };
        MeasuredComposition::of(Stitched { extraordinary_vertices, ..made }, appraisal)
    }

    #[test]
    fn a_regular_layout_is_no_worse_than_a_scans_own_triangles_which_lie_nearer() {
        let regular = sound(100, 0.001, 0.0);
        assert!(!regular.is_layout_no_worse_than(&sound(1000, 0.0001, 0.0)), "another layout lies nearer");
        assert!(regular.is_layout_no_worse_than(&sound(1000, 0.0001, 1.0)));
        assert!(!regular.is_layout_no_worse_than(&sound(50, 0.0001, 1.0)), "its triangles are more regular");
        let mut bare = sound(100, 0.001, 0.0);
        bare.appraisal.covered = 0.9;
        assert!(!bare.is_layout_no_worse_than(&sound(1000, 0.0001, 1.0)));
    }
}
