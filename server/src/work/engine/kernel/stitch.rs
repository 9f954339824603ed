//! Compositions and templates.

use super::super::{
    Encoded, EngineError, Mapped, Model, Opaque, Part, Refusal, Registration, Side, Stitched, Stitching,
};
use super::fresh;
use super::model::ModelInner;
use crate::pool::Stop;
use quadmuse_kernel::compose::{self, Segmented, Way, net::Net, subdivide, template};
use quadmuse_kernel::mesh::PolyMesh;
use quadmuse_proto::{Distortion, Flip, Histogram, Verdict};
use std::sync::Arc;

/// Most faces that a density may ask for.
const FACES_MAX: usize = 4_000_000;
/// Quads of a template on an input of which nothing else tells a density.
const TEMPLATE_QUADS: f64 = 4000.0;

/// Stitches one part a segment.
pub(super) fn compose(query: &Model, parts: &[Part], how: Stitching, stop: &Stop) -> Result<Stitched, EngineError> {
    let inner: &ModelInner = query.inner.open()?;
    let (surface, owner) = inner.segmented();
    let input = Segmented { surface, owner: &owner, count: parts.len() };
    let mut notes = Vec::new();
    let mut meshes: Vec<Option<PolyMesh>> = Vec::new();
    for (segment, part) in parts.iter().enumerate() {
        meshes.push(match part {
            Part::Mapped(mesh) => Some(at_density(mesh, segment, how.density, &mut notes)?),
            Part::Template(_) => None,
        });
    }
    stopped(stop)?;
    let known: Vec<Option<&PolyMesh>> = meshes.iter().map(Option::as_ref).collect();
    let edges = compose::edges_beside(input, &known);
    let overall = (surface.total_area() / TEMPLATE_QUADS).sqrt() * 0.5f64.powi(how.density);
    let mut whole = Vec::new();
    for (segment, (mesh, part)) in meshes.into_iter().zip(parts).enumerate() {
        whole.push(match (mesh, part) {
            (Some(mesh), _) => mesh,
            (None, Part::Template(encoded)) => {
                stopped(stop)?;
                notes.push(format!("segment {segment} is a regular layout"));
                layout(encoded, edges.get(segment).copied().flatten().unwrap_or(overall))?
            }
            (None, Part::Mapped(_)) => return Err(EngineError::Internal("a part without a mesh".into())),
        });
    }
    stopped(stop)?;
    let made = compose::compose(input, &whole, how.smoothing)
        .map_err(|e| EngineError::refused(Refusal::CompositionInvalid, e.to_string()))?;
    let report = &made.report;
    match report.way {
        Way::Direct => {}
        Way::PartsSubdivided => {
            let which: Vec<String> = (0..report.subdivided.len())
                .filter(|&s| report.subdivided[s] > 0)
                .map(|s| format!("{s} ({} times)", report.subdivided[s]))
                .collect();
            notes.push(format!("to fit their neighbours these segments' parts were subdivided: {}", which.join(", ")));
        }
        Way::AllSubdivided => notes.push(format!("everything was subdivided once, to {} quads", made.mesh.faces.len())),
        Way::InputSubdivided => {
            let unusable: Vec<String> = report.unusable.iter().map(ToString::to_string).collect();
            notes.push(format!(
                "no part was used: the input's own triangles were cut into quads (parts that don't fit: {})",
                unusable.join(", ")
            ));
        }
    }
    Ok(Stitched {
        extraordinary_vertices: report.extraordinary_after as u64,
        extraordinary_before: report.extraordinary_before as u64,
        mesh: Arc::new(made.mesh),
        notes,
    })
}

fn stopped(stop: &Stop) -> Result<(), EngineError> {
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))
}

/// A part, subdivided or coarsened; its faces are counted before the work.
fn at_density(mesh: &PolyMesh, segment: usize, density: i32, notes: &mut Vec<String>) -> Result<PolyMesh, EngineError> {
    if density == 0 {
        return Ok(mesh.clone());
    }
    let mut net = Net::from_mesh(mesh);
    if density > 0 {
        let faces = 4usize.saturating_pow(density as u32 - 1).saturating_mul(mesh.faces.corners().len());
        if faces > FACES_MAX {
            let detail = format!(
                "expected a density at which segment {segment} has at most {FACES_MAX} faces, found {density}, at which it has {faces}; ask for less"
            );
            return Err(EngineError::refused(Refusal::CompositionInvalid, detail));
        }
        (0..density).for_each(|_| net = subdivide::subdivide(&net));
    }
    for step in 0..-density {
        let Some(coarser) = subdivide::coarsen(&net) else {
            notes.push(format!("the layout of segment {segment} could be coarsened {step} times"));
            break;
        };
        net = coarser;
    }
    Ok(net.into_mesh().0)
}

/// A regular layout on an unfolded segment.
fn layout(encoded: &Encoded, edge: f64) -> Result<PolyMesh, EngineError> {
    let query = fresh(&encoded.encoding)?;
    Ok(template::template(&query.chart, query.index(), template::grid_for(&query.chart, edge)))
}

/// A regular layout in place of a mapped example.
pub(super) fn template(query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
    stopped(stop)?;
    let inner: &ModelInner = query.model.inner.open()?;
    let edge = (inner.segmented().0.total_area() / TEMPLATE_QUADS).sqrt();
    let mesh = Arc::new(layout(&query.encoded, edge)?);
    let none = || Histogram { edges: vec![0.0, 1.0], counts: vec![0], ..Histogram::default() };
    Ok(Mapped {
        part: Arc::clone(&mesh),
        mesh,
        registration: Registration {
            level: 0,
            energy: 0.0,
            flip: Flip::default(),
            shift_u: 0.0,
            inner: Opaque::new(()),
        },
        constraints: Vec::new(),
        folds: 0,
        distance_max: 0.0,
        distortion: Distortion { angle: none(), area: none() },
        verdict: Verdict::Fair,
        reasons: vec!["a regular layout, made for this segment: no example was laid on it".into()],
    })
}
