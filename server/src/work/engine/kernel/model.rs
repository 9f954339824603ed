//! Uploads: read, repaired, cut into primitives.

use super::super::{Cut, EngineError, Model, ModelSegment, Opaque, Refusal};
use super::topology_out;
use quadmuse_kernel::mesh::{
    self, FaceLabels, Format, Limits, MeshError, MeshErrorKind, NONE, PolyMesh, Prepared, TriMesh,
};
use quadmuse_kernel::topology::{self, Patch, TopologyError};
use quadmuse_proto::{MeshFormat, Segmentation};
use std::sync::Arc;

/// What a model keeps for encoding and mapping.
#[derive(Debug)]
pub(super) struct ModelInner {
    /// The surface, and which of its vertices each vertex of the upload became.
    pub(super) prepared: Prepared,
    patches: Vec<Patch>,
}

impl ModelInner {
    /// A segment's surface.
    pub(super) fn patch(&self, segment: u32) -> Result<&Patch, EngineError> {
        let count = self.patches.len();
        self.patches.get(segment as usize).ok_or_else(|| EngineError::Internal(format!("segment {segment} of {count}")))
    }

    /// The surface that the segments cut up, and which of them each of its triangles belongs to.
    pub(super) fn segmented(&self) -> (&TriMesh, Vec<u32>) {
        let surface = &self.prepared.mesh;
        let mut owner = vec![NONE; surface.triangles.len()];
        for (segment, patch) in self.patches.iter().enumerate() {
            patch.triangle_of.iter().for_each(|&t| owner[t as usize] = segment as u32);
        }
        (surface, owner)
    }

    /// Polygons of a segment.
    pub(super) fn faces(&self, segment: u32) -> u64 {
        self.patches.get(segment as usize).map_or(0, |patch| count_polygons(&self.prepared, patch))
    }
}

/// Reads, repairs and cuts.
pub(super) fn read(bytes: &[u8], format: Option<MeshFormat>, cut: &Cut, limits: &Limits) -> Result<Model, EngineError> {
    let wanted = format.map(format_of).or_else(|| Format::sniff(bytes));
    let mesh = mesh::read(bytes, wanted, limits).map_err(refused)?;
    let prepared = mesh::prepare(&mesh).map_err(refused)?;
    let patches = cut_up(&mesh, &prepared, cut)?;
    let segment = |p: &Patch| ModelSegment { topology: topology_out(p.topology), faces: count_polygons(&prepared, p) };
    Ok(Model {
        format: wanted.map_or(MeshFormat::Obj, format_back),
        repairs: prepared.repairs.iter().map(ToString::to_string).collect(),
        segments: patches.iter().map(segment).collect(),
        mesh: Arc::new(mesh),
        inner: Opaque::new(ModelInner { prepared, patches }),
    })
}

fn cut_up(mesh: &PolyMesh, prepared: &Prepared, cut: &Cut) -> Result<Vec<Patch>, EngineError> {
    let surface = &prepared.mesh;
    if let Some(labels) = &cut.labels {
        let expected = mesh.faces.len();
        if labels.len() != expected {
            let detail = format!("expected one label for each of {expected} faces, found {}", labels.len());
            return Err(EngineError::refused(Refusal::LabelsInvalid, detail));
        }
        return topology::by_labels(surface, labels).map_err(cannot_cut);
    }
    match cut.way {
        Segmentation::Whole => topology::whole(surface).map(|p| vec![p]).map_err(cannot_cut),
        Segmentation::Groups => {
            let labels = group_labels(mesh).ok_or_else(|| {
                EngineError::refused(
                    Refusal::LabelsInvalid,
                    "expected groups (OBJ g or usemtl, PLY face property segment), found none",
                )
            })?;
            topology::by_labels(surface, &labels).map_err(cannot_cut)
        }
        Segmentation::Auto => {
            let whole = match topology::whole(surface) {
                Ok(patch) => return Ok(vec![patch]),
                Err(error) => error,
            };
            let labels = group_labels(mesh).ok_or_else(|| cannot_cut(whole.clone()))?;
            topology::by_labels(surface, &labels).map_err(|_| cannot_cut(whole))
        }
    }
}

/// One label a face: groups, else materials, else segment numbers; `None` where there is at most one.
fn group_labels(mesh: &PolyMesh) -> Option<Vec<i64>> {
    let numbers = |labels: &FaceLabels| -> Vec<i64> {
        labels.of_face.iter().map(|&l| if l == NONE { -1 } else { i64::from(l) }).collect()
    };
    let several = |labels: &Vec<i64>| labels.iter().any(|l| *l != labels[0]);
    let a = &mesh.attributes;
    let groups = a.groups.as_ref().map(numbers).filter(several);
    let materials = || a.materials.as_ref().map(numbers).filter(several);
    groups.or_else(materials).or_else(|| a.segments.clone().filter(several))
}

fn count_polygons(prepared: &Prepared, patch: &Patch) -> u64 {
    let mut faces: Vec<u32> = patch.triangle_of.iter().map(|&t| prepared.mesh.polygon_of[t as usize]).collect();
    faces.sort_unstable();
    faces.dedup();
    faces.len() as u64
}

fn cannot_cut(error: TopologyError) -> EngineError {
    let refusal = match error {
        TopologyError::Empty => Refusal::Empty,
        TopologyError::LabelCount { .. } => Refusal::LabelsInvalid,
        _ => Refusal::TopologyUnsupported,
    };
    let way_out = "; give the segments yourself (groups in the file, or one integer a face in the part `segments`)";
    EngineError::refused(refusal, format!("{error}{way_out}"))
}

/// A refusal of the kernel's readers.
pub(super) fn refused(error: MeshError) -> EngineError {
    let refusal = match error.code() {
        MeshErrorKind::Unreadable => Refusal::Unreadable,
        MeshErrorKind::Empty => Refusal::Empty,
        MeshErrorKind::NotManifold => Refusal::NotManifold,
        MeshErrorKind::TooLarge => Refusal::TooLarge,
        MeshErrorKind::FormatUnknown => Refusal::FormatUnknown,
        MeshErrorKind::TopologyUnsupported => Refusal::TopologyUnsupported,
    };
    EngineError::refused(refusal, error.to_string())
}

/// The kernel's name of a format.
pub(super) fn format_of(format: MeshFormat) -> Format {
    match format {
        MeshFormat::Obj => Format::Obj,
        MeshFormat::Ply => Format::Ply,
        MeshFormat::Off => Format::Off,
        MeshFormat::Stl => Format::Stl,
        MeshFormat::Glb => Format::Glb,
    }
}

fn format_back(format: Format) -> MeshFormat {
    match format {
        Format::Obj => MeshFormat::Obj,
        Format::Ply => MeshFormat::Ply,
        Format::Off => MeshFormat::Off,
        Format::Stl => MeshFormat::Stl,
        Format::Glb => MeshFormat::Glb,
    }
}
