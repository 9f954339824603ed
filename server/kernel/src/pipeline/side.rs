//! One side of a map: a segment of a model, unfolded and encoded.

use super::error::{PipelineError, Refusal, Stop, stopped};
use super::model::Model;
use crate::encode::Encoding;
use crate::rank::bending::bending;
use crate::register::Query;
use crate::topology::Topology;
use crate::unfold::{Chart, UnfoldOptions};
use std::sync::Arc;

/// Flips of so large a share of the edges are worth a word: a clean mesh needs fewer.
const FLIPS_SHARE_NOTED: f64 = 0.05;

/// The facts that are known of an encoded segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentFacts {
    /// Its topology.
    pub topology: Topology,
    /// Its modulus.
    pub modulus: f64,
    /// Polygons that belong to it.
    pub faces: u64,
    /// Feature points found.
    pub features: u32,
    /// How its surface bends, as ∫ mean curvature / √area.
    pub bending: f32,
}

impl SegmentFacts {
    pub(super) fn of(encoding: &Encoding, faces: u64, bending: f32) -> Self {
        Self {
            topology: encoding.topology,
            modulus: encoding.modulus,
            faces,
            features: encoding.features.len() as u32,
            bending,
        }
    }
}

/// A segment, encoded for ranking and unfolded for mapping.
#[derive(Debug)]
pub struct Encoded {
    /// What is known of it.
    pub facts: SegmentFacts,
    /// The unfolded segment with its pictures.
    pub query: Arc<Query>,
    /// What unfolding had to mend, a sentence each.
    pub repairs: Vec<String>,
}

/// One side of a map.
#[derive(Clone, Debug)]
pub struct Side {
    /// The mesh.
    pub model: Arc<Model>,
    /// Which segment of it.
    pub segment: u32,
    /// That segment, encoded.
    pub encoded: Arc<Encoded>,
}

/// Unfolds and encodes a segment.
///
/// # Errors
/// [`Refusal::NotEncodable`], [`PipelineError::Stopped`].
pub fn encode(model: &Model, segment: u32, stop: Stop) -> Result<Encoded, PipelineError> {
    let patch = model.patch(segment)?;
    stopped(stop)?;
    let query = Query::new(patch, &UnfoldOptions::default())
        .map_err(|e| PipelineError::refused(Refusal::NotEncodable, format!("segment {segment}: {e}")))?;
    let facts = SegmentFacts::of(query.encoding(), model.faces(segment), bending(&patch.mesh) as f32);
    let repairs = unfolding(segment, &query.chart);
    Ok(Encoded { facts, query: Arc::new(query), repairs })
}

/// What unfolding had to do beyond the usual, in numbers.
fn unfolding(segment: u32, chart: &Chart) -> Vec<String> {
    let (report, edges) = (&chart.report, 1.5 * chart.mesh.triangles.len() as f64);
    let mut steps = Vec::new();
    if report.flips as f64 > FLIPS_SHARE_NOTED * edges {
        steps.push(format!("{} edges flipped to Delaunay", report.flips));
    }
    if report.mollified > 0.0 {
        steps.push(format!("edges lengthened by {:.0e} of their mean", report.mollified));
    }
    if report.clamped > 0 {
        steps.push(format!("{} negative weights clamped", report.clamped));
    }
    if report.uv_flips > 0 {
        steps.push(format!("{} of {} triangles turned over in the plane", report.uv_flips, chart.corners.len()));
    }
    if steps.is_empty() { Vec::new() } else { vec![format!("unfolding segment {segment}: {}", steps.join(", "))] }
}
