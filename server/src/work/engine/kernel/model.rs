//! Uploads: read, repaired, cut into primitives.

use super::super::{Besides, Cut, EngineError, Grain, Model, ModelSegment, Opaque, Refusal};
use super::{parts, topology_out};
use crate::work::worth::{FACES_CHOSEN_MIN, FACES_OF_SCAN_MIN};
use quadmuse_kernel::compose::surface::ComposedSurface;
use quadmuse_kernel::mesh::{
    self, FaceLabels, Format, Limits, MeshError, MeshErrorKind, NONE, PolyMesh, Prepared, TriMesh, Vec3,
};
use quadmuse_kernel::segment::{PartCount, Segmented, fused, segment};
use quadmuse_kernel::topology::{self, Patch, TopologyError};
use quadmuse_proto::{Components, MeshFormat, Segmentation, segment::Parts};
use std::sync::Arc;

/// What a model keeps for encoding and mapping.
#[derive(Debug)]
pub(super) struct ModelInner {
    /// The surface, and which of its vertices each vertex of the upload became.
    pub(super) prepared: Prepared,
    /// The surface cut into its segments, the parts aside.
    pub(super) segmented: Segmented,
    /// Parts of the surface that are segments, too, after those of `segmented`, which then is whole.
    pub(super) parts: Vec<Patch>,
    /// The example that it was cut alike, laid on it whole.
    pub(super) laid: Option<WholeMap>,
    /// Whether it was cut where another surface ends, so that its boundary means nothing.
    pub(super) is_part: bool,
}

/// An example laid on an input whole.
#[derive(Debug)]
pub(super) struct WholeMap {
    /// The example.
    pub(super) example: Model,
    /// Its faces on the input.
    pub(super) mesh: PolyMesh,
    /// Where the vertices of its surface went; `None` for those of small components.
    pub(super) places: Vec<Option<Vec3>>,
    /// Whether it lies mirrored.
    pub(super) mirrored: bool,
    /// Cost of the registration, and log of the ratio of the moduli.
    pub(super) cost: f64,
    pub(super) modulus_log: f64,
}

impl WholeMap {
    /// Whether it was this example.
    pub(super) fn is_of(&self, example: &Arc<PolyMesh>) -> bool {
        let own = &self.example.mesh;
        Arc::ptr_eq(own, example) || (own.positions == example.positions && own.faces == example.faces)
    }
}

impl ModelInner {
    /// A segment's surface.
    pub(super) fn patch(&self, segment: u32) -> Result<&Patch, EngineError> {
        let count = self.segmented.parts.len() + self.parts.len();
        self.patches()
            .nth(segment as usize)
            .ok_or_else(|| EngineError::Internal(format!("segment {segment} of {count}")))
    }

    /// The surfaces of all segments, in order.
    fn patches(&self) -> impl Iterator<Item = &Patch> {
        self.segmented.parts.iter().chain(&self.parts)
    }

    /// Whether a segment is all of an upload, so that its boundary is where its artist let it end.
    pub(super) fn is_whole(&self, segment: u32) -> bool {
        self.segmented.parts.len() == 1 && segment == 0 && !self.is_part
    }

    /// The segments as they are told.
    pub(super) fn segments(&self) -> Vec<ModelSegment> {
        let segment = |p: &Patch| ModelSegment {
            topology: topology_out(p.topology),
            faces: count_polygons(&self.segmented, p),
            holes: p.holes.len() as u32,
        };
        self.patches().map(segment).collect()
    }

    /// The segment of each face of the upload, as it is told.
    pub(super) fn labels(&self, faces: usize) -> Vec<i64> {
        self.part_of_faces(faces).into_iter().map(i64::from).collect()
    }

    /// The segment of each face of the upload; 0 for faces that preparing dropped.
    pub(super) fn part_of_faces(&self, faces: usize) -> Vec<u32> {
        let mut part_of = vec![0; faces];
        for (t, &part) in self.segmented.part_of.iter().enumerate() {
            if let Some(place) = part_of.get_mut(self.segmented.mesh.polygon_of[t] as usize) {
                *place = part;
            }
        }
        part_of
    }

    /// The surface that the segments cut up, as it is composed.
    pub(super) fn ground(&self) -> ComposedSurface<'_> {
        ComposedSurface::of(&self.segmented)
    }

    /// Whether an example laid on a segment may come to rest elsewhere than its chart says. What was laid whole has its place;
    /// what has few faces has too little form to tell one place from another by.
    pub(super) fn may_settle(&self, segment: u32) -> bool {
        self.laid.is_none() && self.faces(segment) >= FACES_CHOSEN_MIN
    }

    /// Whether the mesh, whatever it is cut into, has as many triangles as a scan: what has fewer is laid on with less care.
    pub(super) fn is_scan(&self) -> bool {
        !few_faces(&self.prepared)
    }

    /// Whether a segment has enough triangles to have tips, and parts that one would tell apart. `surface`: that segment as it is
    /// charted, which may have more triangles than were sent.
    pub(super) fn has_tips(&self, segment: u32, surface: &TriMesh) -> bool {
        let has_form = surface.triangles.len() as u64 >= FACES_CHOSEN_MIN;
        has_form && (self.is_scan() || self.faces(segment) >= FACES_CHOSEN_MIN)
    }

    /// Polygons of a segment.
    pub(super) fn faces(&self, segment: u32) -> u64 {
        self.patch(segment).map_or(0, |patch| count_polygons(&self.segmented, patch))
    }
}

/// The mesh of a model, whose faces tell the segment that they belong to.
pub(super) fn told_apart(model: &Model) -> Result<Arc<PolyMesh>, EngineError> {
    let inner: &ModelInner = model.inner.open()?;
    let mut mesh = PolyMesh::clone(&model.mesh);
    // Of a whole that has parts besides, each face tells its part.
    let labels = model.besides.clone().unwrap_or_else(|| inner.labels(mesh.faces.len()));
    mesh.attributes.segments = Some(labels);
    Ok(Arc::new(mesh))
}

/// Reads, repairs and cuts.
pub(super) fn read(bytes: &[u8], format: Option<MeshFormat>, cut: &Cut, limits: &Limits) -> Result<Model, EngineError> {
    let wanted = format.map(format_of).or_else(|| Format::sniff(bytes));
    let mesh = mesh::read(bytes, wanted, limits).map_err(refused)?;
    // Who tells how the faces are to be cut means them as they are.
    let is_as_sent = cut.labels.is_some() || cut.way == Segmentation::Groups || !is_scan(cut);
    let prepared = if is_as_sent { mesh::prepare(&mesh) } else { mesh::prepare_scan(&mesh) }.map_err(refused)?;
    let views = if is_as_sent || few_faces(&prepared) { None } else { fused(&prepared) };
    let prepared = views.unwrap_or(prepared);
    let segmented = cut_up(&mesh, &prepared, cut)?;
    let asked = cut.parts.is_some() && cut.grain == Grain::Faces;
    let besides = besides(&mesh, &prepared.mesh, &segmented, &cut.besides)?;
    let (besides, parts) = besides.map_or((None, Vec::new()), |(labels, parts)| (Some(labels), parts));
    let inner = ModelInner { prepared, segmented, parts, laid: None, is_part: false };
    Ok(Model {
        format: wanted.map_or(MeshFormat::Obj, format_back),
        repairs: inner
            .prepared
            .repairs
            .iter()
            .map(ToString::to_string)
            .chain(inner.segmented.parts.iter().flat_map(|part| mended(part, inner.segmented.handles_opened)))
            .collect(),
        segments: inner.segments(),
        labels: asked.then(|| inner.labels(mesh.faces.len())),
        besides,
        mesh: Arc::new(mesh),
        inner: Opaque::new(inner),
    })
}

/// The parts besides the whole, with the part of each face; `None` where there are none.
fn besides(
    mesh: &PolyMesh,
    surface: &TriMesh,
    segmented: &Segmented,
    wanted: &Besides,
) -> Result<Option<(Vec<i64>, Vec<Patch>)>, EngineError> {
    match (wanted, segmented.parts.as_slice()) {
        (Besides::Known(labels), [_]) => Ok(Some((labels.clone(), parts::patches(surface, labels)?))),
        // What can't be cut between its faces is kept whole, as it is then without them.
        (Besides::Sought, [whole]) => Ok(parts::sought(whole, mesh.faces.len())
            .and_then(|labels| parts::patches(surface, &labels).ok().map(|parts| (labels, parts)))),
        _ => Ok(None),
    }
}

/// Whether it is read as a scan, which has gaps and falls into pieces; an example is as its artist made it.
fn is_scan(cut: &Cut) -> bool {
    cut.components == Components::Largest && cut.grain == Grain::Free
}

fn few_faces(prepared: &Prepared) -> bool {
    (prepared.mesh.triangles.len() as u64) < FACES_OF_SCAN_MIN
}

fn cut_up(mesh: &PolyMesh, prepared: &Prepared, cut: &Cut) -> Result<Segmented, EngineError> {
    let surface = &prepared.mesh;
    if let Some(labels) = &cut.labels {
        let expected = mesh.faces.len();
        if labels.len() != expected {
            let detail = format!("expected one label for each of {expected} faces, found {}", labels.len());
            return Err(EngineError::refused(Refusal::LabelsInvalid, detail));
        }
        return Segmented::by_labels(surface, few(labels)?).map_err(cannot_cut);
    }
    let policy = match cut.components {
        Components::Largest => topology::Components::Crumbs,
        Components::Refuse => topology::Components::Refuse,
    };
    let meant = |whole: Segmented| if is_scan(cut) { whole.closed() } else { whole };
    match cut.way {
        Segmentation::Whole => Segmented::primitive(surface, policy).map(meant).map_err(cannot_cut),
        Segmentation::Groups => {
            let labels = group_labels(mesh).ok_or_else(|| {
                EngineError::refused(
                    Refusal::LabelsInvalid,
                    "expected groups (OBJ g or usemtl, PLY face property segment), found none",
                )
            })?;
            Segmented::by_labels(surface, few(&labels)?).map_err(cannot_cut)
        }
        Segmentation::Auto => {
            let count = match cut.parts {
                None => PartCount::AsNeeded,
                Some(Parts::None) => PartCount::AsNeeded,
                Some(Parts::Auto) => PartCount::Protrusions,
                Some(Parts::Count(n)) => PartCount::About(n as usize),
            };
            if count == PartCount::AsNeeded {
                let few_groups = || group_labels(mesh).filter(|labels| few(labels).is_ok());
                let groups = || few_groups().and_then(|labels| Segmented::by_labels(surface, &labels).ok());
                let repaired = || Segmented::primitive(surface, policy).ok();
                let pieces = || is_scan(cut).then(|| Segmented::mended(surface)).flatten();
                let is_grouped = few_groups().is_some();
                let opened = || (is_scan(cut) && !is_grouped).then(|| Segmented::opened(surface)).flatten();
                let as_it_is = || Segmented::whole(surface).ok().or_else(groups);
                if let Some(whole) = opened().or_else(as_it_is).or_else(repaired).or_else(pieces) {
                    return Ok(meant(whole));
                }
            }
            let free = segment(surface, count).map_err(cannot_cut)?;
            match cut.grain {
                Grain::Free => Ok(free),
                Grain::Faces => free.between_polygons(surface).map_err(cannot_cut),
            }
        }
    }
}

/// Labels that ask for no more segments than a mesh may have: each costs memory and time, however few its faces are.
fn few(labels: &[i64]) -> Result<&[i64], EngineError> {
    let refused = |error: crate::work::WorkError| EngineError::refused(Refusal::LabelsInvalid, error.to_string());
    crate::work::ingest::check_labels(labels).map_err(refused)?;
    Ok(labels)
}

/// What was left out of a patch, will be filled, or was opened, to make it a primitive.
fn mended(patch: &Patch, handles_opened: u32) -> Vec<String> {
    let mut sentences = Vec::new();
    if patch.left_out > 0 {
        let n = patch.left_out;
        let s = if n == 1 { "" } else { "s" };
        sentences.push(format!("{n} small component{s} beside the largest left out"));
    }
    if handles_opened > 0 {
        let s = if handles_opened == 1 { "" } else { "s" };
        sentences.push(format!("{handles_opened} handle{s} cut open for the computation; maps keep to the surface"));
    }
    // Both sides of each such cut are holes, too.
    let n = patch.holes.len().saturating_sub(2 * handles_opened as usize);
    if n > 0 {
        let edges = patch.holes.iter().map(Vec::len).max().unwrap_or(0);
        let s = if n == 1 { "" } else { "s" };
        sentences.push(format!(
            "{n} small hole{s} (the longest of {edges} edges) filled for the computation; maps keep to the surface"
        ));
    }
    sentences
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

fn count_polygons(segmented: &Segmented, patch: &Patch) -> u64 {
    let mut faces: Vec<u32> = patch.triangle_of.iter().map(|&t| segmented.mesh.polygon_of[t as usize]).collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::work::worth::tries;

    #[test]
    fn each_face_tells_the_segment_that_it_was_cut_into() {
        let text = b"v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 0\nv 2 1 0\ng a\nf 1 2 5 4\ng b\nf 2 3 6 5\n";
        let cut = Cut { way: Segmentation::Groups, ..Cut::default() };
        let model = read(text, None, &cut, &Limits::default()).expect("a model of two groups");
        assert_eq!(model.segments.len(), 2);
        let labels = told_apart(&model).expect("a mesh").attributes.segments.clone().expect("segments");
        assert_eq!(labels.len(), 2);
        assert_ne!(labels[0], labels[1]);
        assert!(model.mesh.attributes.segments.is_none(), "the input itself stays as it was read");
    }

    #[test]
    fn a_triangle_that_a_scan_writes_a_thousand_times_is_one_and_an_example_keeps_all() {
        let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
        let text = format!("solid x\n{}endsolid x\n", facet.repeat(1000));
        let told = |grain| {
            let cut = Cut { components: Components::Largest, grain, ..Cut::default() };
            let model = read(text.as_bytes(), None, &cut, &Limits::default()).expect("a model");
            assert_eq!(model.mesh.faces.len(), 1000, "what was sent stays as it is");
            (model.repairs.iter().any(|repair| repair.starts_with("999 duplicate faces")), model.segments)
        };
        let (is_told, scan) = told(Grain::Free);
        assert!(is_told && scan.len() == 1, "one piece of a thousand");
        assert_eq!((scan[0].faces, tries(&scan, 0)), (1, 0));
        assert!(!told(Grain::Faces).0, "an artist's are left alone");
    }
}
