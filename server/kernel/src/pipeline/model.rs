//! Uploads: read, repaired, cut into primitives.

use super::cut::{Cut, CutMethod, ExtraParts, Grain};
use super::error::{PipelineError, Refusal};
use super::parts;
use crate::compose::apart::alone;
use crate::compose::surface::ComposedSurface;
use crate::mesh::{self, FaceLabels, Format, Limits, NONE, PolyMesh, Prepared, TriMesh, Vec3};
use crate::segment::{PartCount, Segmented, fused, segment, without_small_handles};
use crate::topology::form::share_of_form;
use crate::topology::{Components, Patch, Topology, TopologyError};
use std::collections::HashSet;
use std::sync::{Arc, OnceLock};

/// Faces of a segment, of those that tell of its form, that are enough to choose an example by: several are tried, and laid on
/// it in rough poses before.
pub const FACES_CHOSEN_MIN: u64 = 256;
/// A larger share of a scan's area is most of it. *Untuned.*
const MOST: f64 = 0.5;
/// Faces of a mesh, of the same kind, that may be a scan: enough for two segments. One of fewer is laid on with less care, and one
/// example is tried.
pub const FACES_OF_SCAN_MIN: u64 = 2 * FACES_CHOSEN_MIN;
/// Most segments: each costs memory and time, however few its faces are. Labels may ask for no more.
pub const SEGMENTS_MAX: usize = 128;

/// A segment of a model, as it is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Its topology.
    pub topology: Topology,
    /// Polygons that belong to it.
    pub faces: u64,
    /// How many of them tell of its form ([`share_of_form`]).
    pub form: u64,
    /// Small holes in it that are counted as filled.
    pub holes: u32,
    /// Its share of the surface's area.
    pub share: f64,
    /// Tells whether it is flat.
    pub is_flat: bool,
    /// Tells whether it borders on no other, and makes up most of the surface: eyes, teeth or a belt lie beside it.
    pub is_main: bool,
}

/// A mesh that was read, checked, repaired and cut.
#[derive(Debug)]
pub struct Model {
    /// The mesh as uploaded.
    pub mesh: Arc<PolyMesh>,
    /// Its format.
    pub format: Format,
    /// What was repaired, a sentence each.
    pub repairs: Vec<String>,
    /// The segment of each face, where [`Cut::parts`] and [`Grain::Faces`] asked for an automatic cut, or it was cut as an
    /// example is.
    pub labels: Option<Vec<i64>>,
    /// The part of each face besides the whole, from 1, and 0 for none, where [`Cut::besides`] asked for parts and there are some.
    pub besides: Option<Vec<i64>>,
    /// The surface, and which of its vertices each vertex of the upload became.
    pub(crate) prepared: Prepared,
    /// The surface cut into its segments, the parts aside.
    pub(crate) segmented: Segmented,
    /// Parts of the surface that are segments, too, after those of `segmented`, which then is whole.
    pub(crate) parts: Vec<Patch>,
    /// The example that it was cut alike, laid on it whole.
    pub(crate) laid: Option<WholeMap>,
    /// Whether it was cut where another surface ends, so that its boundary means nothing.
    pub(crate) is_part: bool,
    /// The share of the faces of each segment that tell of its form, once it is asked for.
    pub(crate) form_shares: OnceLock<Vec<f64>>,
}

/// An example laid on an input whole.
#[derive(Debug)]
pub(crate) struct WholeMap {
    /// The example.
    pub(crate) example: Arc<Model>,
    /// Its faces on the input.
    pub(crate) mesh: PolyMesh,
    /// Where the vertices of its surface went; `None` for those of small components.
    pub(crate) places: Vec<Option<Vec3>>,
    /// Whether it lies mirrored.
    pub(crate) mirrored: bool,
    /// Cost of the registration, and log of the ratio of the moduli.
    pub(crate) cost: f64,
    pub(crate) modulus_log: f64,
}

impl WholeMap {
    /// Whether it was this example.
    pub(crate) fn is_of(&self, example: &Arc<PolyMesh>) -> bool {
        let own = &self.example.mesh;
        Arc::ptr_eq(own, example) || (own.positions == example.positions && own.faces == example.faces)
    }
}

impl Model {
    /// A segment's surface.
    ///
    /// # Errors
    /// [`PipelineError::Internal`] where there is no such segment.
    pub fn patch(&self, segment: u32) -> Result<&Patch, PipelineError> {
        let count = self.segmented.parts.len() + self.parts.len();
        self.patches()
            .nth(segment as usize)
            .ok_or_else(|| PipelineError::Internal(format!("segment {segment} of {count}")))
    }

    /// The surfaces of all segments, in order.
    fn patches(&self) -> impl Iterator<Item = &Patch> {
        self.segmented.parts.iter().chain(&self.parts)
    }

    /// Tells whether a segment makes up most of it, by area.
    pub(crate) fn is_most(&self, segment: u32) -> bool {
        let area = |patch: &Patch| patch.mesh.total_area();
        self.patch(segment).is_ok_and(|patch| area(patch) > MOST * self.segmented.mesh.total_area())
    }

    /// Tells whether an example and a segment are two wholes, of which neither ends anywhere: both are closed, by their topologies, and
    /// the segment makes up most of the scan.
    pub(crate) fn are_wholes(&self, segment: u32, topologies: [Topology; 2]) -> bool {
        topologies == [Topology::Sphere; 2] && self.is_most(segment)
    }

    /// Tells whether it was cut at its waist: its two segments are no parts of a composition, but what one is laid out around.
    pub fn is_at_waist(&self) -> bool {
        self.segmented.is_waist
    }

    /// Whether a segment is all of an upload, so that its boundary is where its artist let it end.
    pub(crate) fn is_whole(&self, segment: u32) -> bool {
        self.segmented.parts.len() == 1 && segment == 0 && !self.is_part
    }

    /// The same mesh cut otherwise, with no parts besides.
    pub(crate) fn recut(&self, segmented: Segmented, is_part: bool) -> Self {
        Self {
            mesh: Arc::clone(&self.mesh),
            format: self.format,
            repairs: self.repairs.clone(),
            labels: None,
            besides: self.besides.clone(),
            prepared: self.prepared.clone(),
            segmented,
            parts: Vec::new(),
            laid: None,
            is_part,
            form_shares: OnceLock::new(),
        }
    }

    /// The mesh, whose faces tell the segment that they belong to.
    pub fn labelled_by_segment(&self) -> PolyMesh {
        let mut mesh = PolyMesh::clone(&self.mesh);
        // Of a whole that has parts besides, each face tells its part.
        let labels = self.besides.clone().unwrap_or_else(|| self.face_labels(mesh.faces.len()));
        mesh.attributes.segments = Some(labels);
        mesh
    }

    /// The surface as it was repaired, uncut.
    pub fn surface(&self) -> &TriMesh {
        &self.prepared.mesh
    }

    /// Tells of each segment whether it has its components of the surface to itself, so that it needs no stitching.
    pub fn alone(&self) -> Vec<bool> {
        alone(self.ground().input())
    }

    /// The segments as they are told, numbered from 0: where it has parts besides its whole, the whole first.
    pub fn segments(&self) -> Vec<Segment> {
        let all = self.surface().total_area().max(f64::MIN_POSITIVE);
        let segment = |(number, p): (u32, &Patch)| {
            let share = p.mesh.total_area() / all;
            let is_alone = || self.segmented.seams.iter().all(|seam| !seam.parts.contains(&number));
            Segment {
                topology: p.topology,
                faces: count_polygons(&self.segmented, p),
                form: self.form(number),
                holes: p.holes.len() as u32,
                share,
                is_flat: p.mesh.is_flat(),
                is_main: share > MOST && is_alone(),
            }
        };
        (0..).zip(self.patches()).map(segment).collect()
    }

    /// The segment of each face of the upload, as it is told.
    pub(crate) fn face_labels(&self, faces: usize) -> Vec<i64> {
        self.part_of_faces(faces).into_iter().map(i64::from).collect()
    }

    /// The segment of each face of the upload; 0 for faces that preparing dropped.
    pub(crate) fn part_of_faces(&self, faces: usize) -> Vec<u32> {
        let mut part_of = vec![0; faces];
        for (t, &part) in self.segmented.part_of.iter().enumerate() {
            if let Some(place) = part_of.get_mut(self.segmented.mesh.polygon_of[t] as usize) {
                *place = part;
            }
        }
        part_of
    }

    /// The surface that the segments cut up, as it is composed.
    pub(crate) fn ground(&self) -> ComposedSurface<'_> {
        ComposedSurface::of(&self.segmented)
    }

    /// Whether an example laid on a segment may come to rest elsewhere than its chart says. What was laid whole has its place;
    /// what has too little form does not tell one place from another.
    pub(crate) fn may_settle(&self, segment: u32) -> bool {
        self.laid.is_none() && self.form(segment) >= FACES_CHOSEN_MIN
    }

    /// Tells whether the mesh, whatever it is cut into, has as many triangles that tell of its form as a scan: what has fewer is
    /// laid on with less care.
    pub(crate) fn is_scan(&self) -> bool {
        let triangles = |p: &Patch| p.mesh.triangles.len() as f64;
        let parts = &self.segmented.parts;
        let all: f64 = parts.iter().map(triangles).sum();
        let form: f64 = parts.iter().zip(self.form_shares()).map(|(p, share)| triangles(p) * share).sum();
        all > 0.0 && form / all * self.prepared.mesh.triangles.len() as f64 >= FACES_OF_SCAN_MIN as f64
    }

    /// Whether a segment has enough triangles to have tips, and parts that one would tell apart. `surface`: that segment as it is
    /// charted, which may have more triangles than were sent.
    pub(crate) fn has_tips(&self, segment: u32, surface: &TriMesh) -> bool {
        let has_form = surface.triangles.len() as u64 >= FACES_CHOSEN_MIN;
        has_form && (self.is_scan() || self.form(segment) >= FACES_CHOSEN_MIN)
    }

    /// Polygons of a segment that tell of its form.
    fn form(&self, segment: u32) -> u64 {
        let share = self.form_shares().get(segment as usize).copied().unwrap_or_default();
        (share * self.faces(segment) as f64).round() as u64
    }

    /// The share of the faces of each segment that tell of its form.
    fn form_shares(&self) -> &[f64] {
        self.form_shares.get_or_init(|| self.patches().map(|patch| share_of_form(&patch.mesh)).collect())
    }

    /// Polygons of a segment.
    pub(crate) fn faces(&self, segment: u32) -> u64 {
        self.patch(segment).map_or(0, |patch| count_polygons(&self.segmented, patch))
    }
}

/// Reads, repairs and cuts. `format`: that of the bytes, where it is known.
///
/// # Errors
/// [`PipelineError::Refused`].
pub fn read(bytes: &[u8], format: Option<Format>, cut: &Cut, limits: &Limits) -> Result<Model, PipelineError> {
    let wanted = format.or_else(|| Format::sniff(bytes));
    let mesh = mesh::read(bytes, wanted, limits)?;
    // Who tells how the faces are to be cut means them as they are.
    let is_as_sent = cut.labels.is_some() || cut.way == CutMethod::Groups || !is_scan(cut);
    let prepared = if is_as_sent { mesh::prepare(&mesh) } else { mesh::prepare_scan(&mesh) }?;
    let views = if is_as_sent || few_faces(&prepared) { None } else { fused(&prepared) };
    let prepared = views.unwrap_or(prepared);
    let (prepared, handles) = if is_as_sent || few_faces(&prepared) { (prepared, 0) } else { unhandled(prepared) };
    let mut segmented = cut_up(&mesh, &prepared, cut)?.sharing(&prepared.mesh);
    segmented.handles_opened += handles;
    let asked = cut.parts.is_some() && cut.grain == Grain::Faces;
    let besides = besides(&mesh, &prepared.mesh, &segmented, &cut.besides)?;
    let (besides, parts) = besides.map_or((None, Vec::new()), |(labels, parts)| (Some(labels), parts));
    let repaired = prepared.repairs.iter().map(ToString::to_string);
    let opened = Some(segmented.handles_opened).filter(|count| *count > 0).map(handles_note);
    let repairs =
        repaired.chain(opened).chain(segmented.parts.iter().flat_map(|part| mended(part, &segmented))).collect();
    let (faces, format) = (mesh.faces.len(), wanted.unwrap_or(Format::Obj));
    let mesh = Arc::new(mesh);
    let model = Model {
        mesh,
        format,
        repairs,
        labels: None,
        besides,
        prepared,
        segmented,
        parts,
        laid: None,
        is_part: false,
        form_shares: OnceLock::new(),
    };
    let labels = asked.then(|| model.face_labels(faces));
    Ok(Model { labels, ..model })
}

/// A scan with its small handles cut, and how many were.
fn unhandled(prepared: Prepared) -> (Prepared, u32) {
    match without_small_handles(&prepared.mesh) {
        Some((mesh, count)) => (Prepared { mesh: Arc::new(mesh), ..prepared }, count as u32),
        None => (prepared, 0),
    }
}

/// An input that was cut at its waist, cut into primitives instead.
///
/// # Errors
/// [`PipelineError::Refused`] where it can't be cut.
pub fn in_primitives(model: &Model) -> Result<Model, PipelineError> {
    let segmented = segment(model.surface(), PartCount::AsNeeded).map_err(cannot_cut)?;
    Ok(model.recut(segmented, false))
}

/// The parts besides the whole, with the part of each face; `None` where there are none.
fn besides(
    mesh: &PolyMesh,
    surface: &TriMesh,
    segmented: &Segmented,
    wanted: &ExtraParts,
) -> Result<Option<(Vec<i64>, Vec<Patch>)>, PipelineError> {
    match (wanted, segmented.parts.as_slice()) {
        (ExtraParts::Known(labels), [_]) => Ok(Some((labels.clone(), parts::patches(surface, labels)?))),
        // What can't be cut between its faces is kept whole, as it is then without them.
        (ExtraParts::Sought, [whole]) => Ok(parts::sought(whole, mesh.faces.len())
            .and_then(|labels| parts::patches(surface, &labels).ok().map(|parts| (labels, parts)))),
        _ => Ok(None),
    }
}

/// Whether it is read as a scan, which has gaps and falls into pieces; an example is as its artist made it.
fn is_scan(cut: &Cut) -> bool {
    cut.components == Components::SmallLeftOut && cut.grain == Grain::Free
}

fn few_faces(prepared: &Prepared) -> bool {
    (prepared.mesh.triangles.len() as u64) < FACES_OF_SCAN_MIN
}

fn cut_up(mesh: &PolyMesh, prepared: &Prepared, cut: &Cut) -> Result<Segmented, PipelineError> {
    let surface = &prepared.mesh;
    if let Some(labels) = &cut.labels {
        let expected = mesh.faces.len();
        if labels.len() != expected {
            let detail = format!("expected one label for each of {expected} faces, found {}", labels.len());
            return Err(PipelineError::refused(Refusal::LabelsInvalid, detail));
        }
        return Segmented::by_labels(surface, few(labels)?).map_err(cannot_cut);
    }
    let meant = |whole: Segmented| if is_scan(cut) { whole.closed() } else { whole };
    match cut.way {
        CutMethod::Whole => Segmented::primitive(surface, cut.components).map(meant).map_err(cannot_cut),
        CutMethod::Groups => {
            let labels = group_labels(mesh).ok_or_else(|| {
                PipelineError::refused(
                    Refusal::LabelsInvalid,
                    "expected groups (OBJ g or usemtl, PLY face property segment), found none",
                )
            })?;
            Segmented::by_labels(surface, few(&labels)?).map_err(cannot_cut)
        }
        CutMethod::Auto => {
            let count = cut.parts.unwrap_or_default();
            let at_waist = count == PartCount::AtWaist && is_scan(cut);
            if let Some(found) = at_waist.then(|| Segmented::at_waist(surface)).flatten() {
                return Ok(found);
            }
            if matches!(count, PartCount::AsNeeded | PartCount::AtWaist) {
                let few_groups = || group_labels(mesh).filter(|labels| few(labels).is_ok());
                let groups = || few_groups().and_then(|labels| Segmented::by_labels(surface, &labels).ok());
                let repaired = || Segmented::primitive(surface, cut.components).ok();
                let pieces = || is_scan(cut).then(|| Segmented::mended(surface)).flatten();
                let is_grouped = few_groups().is_some();
                let opened = || (is_scan(cut) && !is_grouped).then(|| Segmented::opened(surface)).flatten();
                let as_it_is = || Segmented::whole(surface).ok().or_else(groups);
                let ended = || Segmented::with_two_ends(surface).ok().filter(|_| is_scan(cut) && !is_grouped);
                if let Some(whole) = opened().or_else(as_it_is).or_else(repaired).or_else(pieces).or_else(ended) {
                    return Ok(meant(whole));
                }
            }
            let free = segment(surface, count).map_err(cannot_cut)?;
            match cut.grain {
                Grain::Free if is_scan(cut) => Ok(free.of_largest_pieces(SEGMENTS_MAX)),
                Grain::Free => Ok(free),
                Grain::Faces => free.between_polygons(surface).map_err(cannot_cut),
            }
        }
    }
}

/// Labels that ask for no more segments than a mesh may have.
///
/// # Errors
/// [`Refusal::LabelsInvalid`].
pub fn few(labels: &[i64]) -> Result<&[i64], PipelineError> {
    let mut found = HashSet::new();
    if labels.iter().any(|label| found.insert(label) && found.len() > SEGMENTS_MAX) {
        let detail = format!(
            "expected `segments` to give at most {SEGMENTS_MAX} segments, found more than {SEGMENTS_MAX} labels"
        );
        return Err(PipelineError::refused(Refusal::LabelsInvalid, detail));
    }
    Ok(labels)
}

fn handles_note(count: u32) -> String {
    let s = if count == 1 { "" } else { "s" };
    format!("{count} handle{s} cut open for the computation; maps keep to the surface")
}

/// Tells what was left out of a patch, or will be filled, to make it a primitive.
fn mended(patch: &Patch, of: &Segmented) -> Vec<String> {
    let handles_opened = of.handles_opened;
    let mut sentences = Vec::new();
    if patch.left_out > 0 {
        let n = patch.left_out;
        let s = if n == 1 { "" } else { "s" };
        sentences.push(format!("{n} small component{s} beside the largest left out"));
    }
    if of.is_waist {
        // The openings that it leaves are no holes that anybody could see.
        return sentences;
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

fn cannot_cut(error: TopologyError) -> PipelineError {
    let refusal = match error {
        TopologyError::Empty => Refusal::Empty,
        TopologyError::LabelCount { .. } => Refusal::LabelsInvalid,
        _ => Refusal::TopologyUnsupported,
    };
    let way_out = "; give the segments yourself (groups in the file, or one integer a face in the part `segments`)";
    PipelineError::refused(refusal, format!("{error}{way_out}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_face_tells_the_segment_that_it_was_cut_into() {
        let text = b"v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 0\nv 2 1 0\ng a\nf 1 2 5 4\ng b\nf 2 3 6 5\n";
        let cut = Cut { way: CutMethod::Groups, ..Cut::default() };
        let model = read(text, None, &cut, &Limits::default()).expect("a model of two groups");
        assert_eq!(model.segments().len(), 2);
        let labels = model.labelled_by_segment().attributes.segments.expect("segments");
        assert_eq!(labels.len(), 2);
        assert_ne!(labels[0], labels[1]);
        assert!(model.mesh.attributes.segments.is_none(), "the input itself stays as it was read");
    }

    #[test]
    fn what_borders_on_no_other_and_is_most_of_the_surface_is_its_main_segment() {
        let is_main = |text: &str, groups: &str| {
            let cut = Cut { way: CutMethod::Groups, ..Cut::default() };
            let text = format!("{text}{groups}");
            let model = read(text.as_bytes(), None, &cut, &Limits::default()).expect("a model of two groups");
            model.segments().iter().map(|segment| (segment.is_main, segment.is_flat)).collect::<Vec<_>>()
        };
        let joined = "v 0 0 0\nv 3 0 0\nv 4 0 0\nv 0 1 0\nv 3 1 0\nv 4 1 0\n";
        assert_eq!(is_main(joined, "g a\nf 1 2 5 4\ng b\nf 2 3 6 5\n"), [(false, true); 2], "they share an edge");
        let apart = "v 0 0 0\nv 3 0 0\nv 3 1 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 6 1 1\nv 5 1 0\n";
        assert_eq!(is_main(apart, "g a\nf 1 2 3 4\ng b\nf 5 6 7 8\n"), [(true, true), (false, false)]);
    }

    #[test]
    fn a_triangle_that_a_scan_writes_a_thousand_times_is_one_and_an_example_keeps_all() {
        let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
        let text = format!("solid x\n{}endsolid x\n", facet.repeat(1000));
        let cut_by = |grain| {
            let cut = Cut { components: Components::SmallLeftOut, grain, ..Cut::default() };
            let model = read(text.as_bytes(), None, &cut, &Limits::default()).expect("a model");
            assert_eq!(model.mesh.faces.len(), 1000, "what was sent stays as it is");
            (model.repairs.iter().any(|repair| repair.starts_with("999 duplicate faces")), model.segments())
        };
        let (is_noted, scan) = cut_by(Grain::Free);
        assert!(is_noted && scan.len() == 1, "one piece of a thousand");
        assert_eq!(scan[0].faces, 1);
        assert!(!cut_by(Grain::Faces).0, "an artist's are left alone");
    }
}
