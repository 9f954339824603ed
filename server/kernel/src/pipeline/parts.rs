//! The parts of an example that is kept whole: what else of it may inspire a scan that falls into parts.

use super::error::{PipelineError, Refusal};
use crate::mesh::TriMesh;
use crate::segment::{PartCount, segment};
use crate::topology::{Patch, Topology, classify, submesh};
use std::sync::Arc;

/// A part of fewer faces has no layout of its own to give.
const FACES_MIN: usize = 16;
/// Fewer parts are as good as the whole.
const PARTS_MIN: usize = 2;
/// Most parts, those of most faces: each is unfolded, drawn and stored.
const PARTS_MAX: usize = 32;

/// The part of each face of an upload of `faces` faces, from 1, and 0 for none, as automatic segmentation cuts the `whole`
/// between its faces; `None` where it falls into fewer than two parts that are worth keeping.
pub(crate) fn sought(whole: &Patch, faces: usize) -> Option<Vec<i64>> {
    if whole.topology == Topology::Torus {
        return None;
    }
    let surface = &whole.mesh;
    let cut = segment(surface, PartCount::Protrusions).ok()?.between_polygons(surface).ok()?;
    let mut part_of: Vec<Option<usize>> = vec![None; faces];
    for (part, patch) in cut.parts.iter().enumerate() {
        for &t in &patch.triangle_of {
            *part_of.get_mut(surface.polygon_of[t as usize] as usize)? = Some(part);
        }
    }
    let mut count = vec![0; cut.parts.len()];
    part_of.iter().flatten().for_each(|&part| count[part] += 1);
    let mut kept: Vec<usize> = (0..count.len()).filter(|&part| count[part] >= FACES_MIN).collect();
    kept.sort_by_key(|&part| (std::cmp::Reverse(count[part]), part));
    kept.truncate(PARTS_MAX);
    kept.sort_unstable();
    let number = |part: usize| kept.binary_search(&part).map_or(0, |at| at as i64 + 1);
    (kept.len() >= PARTS_MIN).then(|| part_of.into_iter().map(|part| part.map_or(0, number)).collect())
}

/// The parts that labels name on a surface, in order; 0 names none.
///
/// # Errors
/// [`Refusal::LabelsInvalid`] where a face has no label, or a part is no primitive.
pub(crate) fn patches(surface: &TriMesh, labels: &[i64]) -> Result<Vec<Patch>, PipelineError> {
    let invalid = |detail: String| PipelineError::refused(Refusal::LabelsInvalid, detail);
    let mut members: Vec<Vec<u32>> = Vec::new();
    for (t, &face) in surface.polygon_of.iter().enumerate() {
        let label = labels.get(face as usize).ok_or_else(|| {
            invalid(format!("expected a part, or 0, for each face, found {} for face {face} and more", labels.len()))
        })?;
        // The most that a model may have, whatever a record says.
        let Some(part) = usize::try_from(label - 1).ok().filter(|&part| part < PARTS_MAX) else { continue };
        if members.len() <= part {
            members.resize(part + 1, Vec::new());
        }
        members[part].push(t as u32);
    }
    let patch = |(part, triangle_of): (usize, Vec<u32>)| {
        let (mesh, vertex_of) = submesh(surface, &triangle_of);
        let topology = classify(&mesh).map_err(|error| invalid(format!("part {}: {error}", part + 1)))?;
        Ok(Patch { topology, mesh: Arc::new(mesh), vertex_of, triangle_of, holes: Vec::new(), left_out: 0 })
    };
    members.into_iter().enumerate().map(patch).collect()
}
