//! Examples laid roughly, to choose among many.

use super::error::{PipelineError, Stop, stopped};
use super::fitted::matched_tips;
use super::model::Model;
use crate::fit::places::Start;
use crate::fit::rough::{LeadMesh, RoughInput, Shape, rough};
use crate::mesh::Vec3;
use crate::register::Query;
use crate::topology::{Patch, Topology};
use std::sync::Arc;

/// Share of a scan from which on a rough fit of another whole lies all over it. *Untuned:* bodies on a man in armour cover .8 and .9.
const ALL_OVER: f64 = 0.7;
/// It agrees so much there. *Untuned.*
const ALL_OVER_FROM: f64 = -0.15;
/// [`RoughPlacement::local_relief`] from which on a rough fit speaks for an example: of 86 maps 30 had less when they were laid roughly, of
/// which two were right (tests/records/windows-2026-11-30.md).
const LOCAL_FROM: f64 = 0.2;
/// Ways to match tips that are tried, of either orientation.
const MATCHED: usize = 1;

/// Tells how an example lies on a query, roughly.
#[derive(Clone, Debug, Default)]
pub struct RoughPlacement {
    /// How well its relief agrees as a whole, below 1, less what its bend counts.
    pub agreement: f64,
    /// How well its relief agrees within windows, where the example has any.
    pub local_relief: f64,
    /// Share of the query's area that it lies on.
    pub covered: f64,
    /// Share of the example's area for which the query has nothing: it would be spanned flat.
    pub off: f64,
    /// Where each vertex of its surface lies.
    pub places: Arc<Vec<Vec3>>,
    /// Whether it lies mirrored.
    pub mirrored: bool,
    /// How far tips that led it there end from their matches in the mean, in √area of the query.
    pub apart: f64,
    /// True where both are closed, and the query is most of its scan: neither ends anywhere.
    pub are_wholes: bool,
    /// From where it was laid, if that was as a whole.
    pub start: Option<Arc<Start>>,
}

impl RoughPlacement {
    /// Of a known sureness, on nothing.
    pub fn of(sureness: f64) -> Self {
        Self { agreement: sureness, local_relief: 0.5 * sureness + LOCAL_FROM, ..Self::default() }
    }

    /// How sure it is, below 1, by its relief as a whole and within windows: more than 0 where it may be right.
    pub fn sureness(&self) -> f64 {
        0.5 * self.agreement + self.local_relief - LOCAL_FROM
    }

    /// Rates it against others on the same query: how sure it is, times the share that it covers, less what is spanned.
    pub fn worth(&self) -> f64 {
        let sure = self.sureness();
        if sure > 0.0 { sure * self.covered * (1.0 - self.off) } else { sure }
    }

    /// How likely the query is an example of its kind all over, where both are wholes: a man in armour is a man, though no bump of
    /// him agrees. `None` where it is not, or agrees too little.
    pub fn all_over(&self) -> Option<f64> {
        let sure = self.agreement - ALL_OVER_FROM;
        (self.are_wholes && self.covered >= ALL_OVER && sure >= 0.0).then_some(sure * self.covered * (1.0 - self.off))
    }
}

/// An example that lies on a query, to lead another there of which it is a part.
#[derive(Clone, Copy, Debug)]
pub struct RoughLead<'a> {
    /// The example.
    pub model: &'a Model,
    /// Its segment.
    pub segment: u32,
    /// How it lies.
    pub rough: &'a RoughPlacement,
}

/// A query's segment made ready for all examples that are laid on it roughly; `None` where it has no caps, or no area.
///
/// # Errors
/// [`PipelineError::Internal`].
pub fn ready(query: &Model, segment: u32) -> Result<Option<RoughInput>, PipelineError> {
    Ok(shape(query.patch(segment)?).and_then(RoughInput::new))
}

/// Lays an example's segment on a query's roughly, at a tenth of what a map costs; `None` where either has no caps. `ready`: the
/// query's segment.
/// `encodings`: of both, where tips are to be matched. `lead`: an example that lies on the query, and tells where this one belongs.
///
/// # Errors
/// [`PipelineError::Stopped`], [`PipelineError::Internal`].
pub fn lay(
    (example, of_example): (&Model, u32),
    (query, of_query, ready): (&Model, u32, &RoughInput),
    encodings: Option<[&Query; 2]>,
    lead: Option<RoughLead<'_>>,
    stop: Stop,
) -> Result<Option<RoughPlacement>, PipelineError> {
    let (one, two) = (example.patch(of_example)?, query.patch(of_query)?);
    let (Some(example), Some(input)) = (shape(one), shape(two)) else { return Ok(None) };
    let tips = encodings.map_or_else(Vec::new, |pair| matched_tips(pair, (example.mesh, input.mesh), MATCHED, stop));
    let part = match lead {
        Some(lead) => {
            Some(LeadMesh { mesh: &lead.model.patch(lead.segment)?.mesh, places: lead.rough.places.as_slice() })
        }
        None => None,
    };
    let are_wholes = query.are_wholes(of_query, [one.topology, two.topology]);
    let found = rough(example, (input.mesh, ready), &tips, part, stop);
    stopped(stop)?;
    Ok(found.map(|fit| RoughPlacement {
        agreement: fit.agreement,
        local_relief: fit.local_relief,
        covered: fit.covered,
        off: fit.off,
        places: Arc::new(fit.places),
        mirrored: fit.mirrored,
        apart: fit.apart,
        are_wholes,
        start: fit.start.map(Arc::new),
    }))
}

fn shape(patch: &Patch) -> Option<Shape<'_>> {
    let is_closed = patch.topology == Topology::Sphere;
    (patch.topology != Topology::Torus).then_some(Shape { mesh: &patch.mesh, is_closed })
}
