//! The parts of an example that is kept whole: what else of it may inspire a scan that falls into parts.

use super::super::{EngineError, Refusal};
use quadmuse_kernel::mesh::TriMesh;
use quadmuse_kernel::segment::{PartCount, segment};
use quadmuse_kernel::topology::{Patch, Topology, classify, submesh};

/// A part of fewer faces has no layout of its own to give.
const FACES_MIN: usize = 16;
/// Fewer parts are as good as the whole.
const PARTS_MIN: usize = 2;
/// Most parts, those of most faces: each is unfolded, drawn and stored.
const PARTS_MAX: usize = 32;

/// The part of each face of an upload of `faces` faces, from 1, and 0 for none, as automatic segmentation cuts the `whole`
/// between its faces; `None` where it falls into fewer than two parts that are worth keeping.
pub(super) fn sought(whole: &Patch, faces: usize) -> Option<Vec<i64>> {
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
pub(super) fn patches(surface: &TriMesh, labels: &[i64]) -> Result<Vec<Patch>, EngineError> {
    let invalid = |detail: String| EngineError::refused(Refusal::LabelsInvalid, detail);
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
        Ok(Patch { topology, mesh, vertex_of, triangle_of, holes: Vec::new(), left_out: 0 })
    };
    members.into_iter().enumerate().map(patch).collect()
}

#[cfg(test)]
mod tests {
    use super::super::KernelEngine;
    use crate::demo;
    use crate::pool::Stop;
    use crate::work::engine::{Besides, Cut, Engine, Grain, Model};
    use quadmuse_kernel::mesh::{Format, write};
    use quadmuse_proto::{MeshFormat, Topology};

    fn sample(name: &str, besides: Besides) -> Model {
        let sample = demo::corpus().into_iter().find(|sample| sample.name == name).expect("a sample");
        let bytes = write(&sample.mesh, Format::Obj).expect("writable");
        let cut = Cut { grain: Grain::Faces, besides, ..Cut::default() };
        KernelEngine::default().read(&bytes, Some(MeshFormat::Obj), &cut, &Stop::new(None)).expect("a mesh")
    }

    #[test]
    fn an_animal_is_whole_and_has_parts_of_its_own_faces_that_come_back_by_their_labels() {
        let pig = sample("pig", Besides::Sought);
        let labels = pig.besides.clone().expect("parts");
        assert_eq!(pig.segments[0].topology, Topology::Sphere);
        assert_eq!(pig.segments[0].faces, pig.mesh.faces.len() as u64);
        assert!(pig.segments.len() > 4, "{:?}", pig.segments);
        for (number, segment) in (1..).zip(&pig.segments[1..]) {
            let faces = labels.iter().filter(|label| **label == number).count() as u64;
            assert!(segment.faces == faces && faces >= 16, "{segment:?}, {faces} faces");
            assert_ne!(segment.topology, Topology::Sphere);
        }
        let known = sample("pig", Besides::Known(labels.clone()));
        assert_eq!((&known.segments, known.besides), (&pig.segments, Some(labels.clone())));
        let engine = KernelEngine::default();
        let told = engine.told_apart(&pig).expect("a mesh");
        assert_eq!(told.attributes.segments.as_ref(), Some(&labels), "each face tells its part");
        let [first, again] = [&pig, &sample("pig", Besides::Known(labels))].map(|model| {
            let part = engine.encode(model, 2, &Stop::new(None)).expect("encoded");
            engine.pack(&part.encoding).expect("packed")
        });
        assert_eq!(first, again);
    }

    #[test]
    fn what_has_no_protrusions_is_whole_alone_and_so_is_all_where_no_parts_are_wanted() {
        let ear = sample("ear_human", Besides::Sought);
        assert_eq!((ear.segments.len(), ear.besides), (1, None));
        let pig = sample("pig", Besides::Nothing);
        assert_eq!((pig.segments.len(), pig.besides), (1, None));
    }

    #[test]
    fn labels_that_are_none_of_the_mesh_are_refused() {
        let sample = demo::corpus().into_iter().find(|sample| sample.name == "pig").expect("a sample");
        let bytes = write(&sample.mesh, Format::Obj).expect("writable");
        let faces = sample.mesh.faces.len();
        let scattered = (0..faces as i64).map(|face| face % 2 + 1).collect();
        for labels in [vec![1; faces - 1], scattered] {
            let cut = Cut { besides: Besides::Known(labels), ..Cut::default() };
            let read = KernelEngine::default().read(&bytes, Some(MeshFormat::Obj), &cut, &Stop::new(None));
            assert!(matches!(read, Err(super::EngineError::Refused { refusal: super::Refusal::LabelsInvalid, .. })));
        }
    }
}
